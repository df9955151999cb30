"""The autopilot on a bench: found on links, its parameters read, and set while it is disarmed.

A machine without I/O, for `setup`: bytes and time in, bytes out. It never arms, and commands no
motion. No part of a flight uses it. Source: https://mavlink.io/en/services/parameter.html.
"""

from __future__ import annotations

import enum
import math
import struct
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

from ..settings.link_config import LinkRole
from ..types import AutopilotKind
from .autopilots import profile
from .autopilots.parameter_names import Parameters
from .codec import Codec
from .dialect import Message, create, mavlink
from .identity import Autopilot, AutopilotConflict
from .parameters import parameter_value
from .peers import Address
from .session import Session, SystemStatus
from .telemetry import Telemetry
from .translate_outgoing import parameter_request_message

LONGEST_S = 20.0
"""Time after which what was not reported counts as unknown."""
_SETTLED_S = 3.0
"""Time for two messages of the battery, three heartbeats."""
_ANSWER_S = 0.7
"""Time for an answer, a slow radio included."""
_MOST_TRIES = 5
_HEARTBEAT_S = 2.5
"""Age of the last HEARTBEAT up to which an autopilot counts as disarmed: it comes once a second."""
_SILENT_S = 6.0
"""Age at which no further parameter is set."""
_PARAM_VALUE = int(mavlink.MAVLINK_MSG_ID_PARAM_VALUE)


class SetStatus(enum.Enum):
    """Result of setting one parameter."""

    SET = "set"
    """Its value was read back."""
    REFUSED = "refused"
    """It was read back, with another value."""
    UNANSWERED = "unanswered"
    ARMED = "armed"
    """Not sent: the autopilot was armed."""
    SILENT = "silent"
    """Not sent: no heartbeat told that the autopilot was disarmed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """A parameter by its name in the firmware, and the value that it is to have, in its unit."""

    name: str
    value: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SetResult:
    """Result of a change. value: as read back; None if it was not."""

    change: Change
    status: SetStatus
    value: float | None = None


class AutopilotReader:
    """Finds the autopilot on links, reads its parameters, and sets some of them, one by one."""

    def __init__(self, links: Iterable[str], *, component_id: int = 195) -> None:
        self._session = Session(
            links=dict.fromkeys(links, LinkRole.AUTOPILOT), component_id=component_id
        )
        self._reader = Codec(system_id=1, component_id=component_id, wanted={_PARAM_VALUE})
        self._writer = Codec(system_id=1, component_id=component_id)
        self._found_s: float | None = None
        self._now_s = 0.0
        self._out: list[bytes] = []
        self._waiting: deque[Change] = deque()
        self._tries = 0
        self._asked_s = -math.inf
        self._reads_back = False
        """True from the answer to PARAM_SET on: the value is read once more."""
        self._last_value: float | None = None
        self.types: dict[str, int] = {}
        """MAV_PARAM_TYPE of the reported parameters by name."""
        self.results: list[SetResult] = []
        """Results of the changes so far, in order."""
        self.conflict: AutopilotConflict | None = None
        """A second autopilot."""
        self.received_bytes = 0

    @property
    def autopilot(self) -> Autopilot | None:
        """The autopilot that was received first."""
        return self._session.autopilot

    @property
    def telemetry(self) -> Telemetry:
        """Latest telemetry."""
        return self._session.telemetry

    @property
    def parameters(self) -> Parameters:
        """Parameters by key; those that were not reported are None."""
        requests, known = self._session.requests, profile(self._kind)
        return requests.parameters.with_silence(known.setup_parameters)

    @property
    def read(self) -> float:
        """Share of the parameters that are known, or known to be missing."""
        keys = profile(self._kind).setup_parameters
        known = sum(key in self._session.requests.parameters for key in keys)
        return known / len(keys) if keys else 1.0

    @property
    def done(self) -> bool:
        """True once everything was read, or after too long."""
        if self._found_s is None:
            return False
        passed_s = self._now_s - self._found_s
        complete = self.read >= 1.0 and self.telemetry.firmware is not None
        return passed_s >= (_SETTLED_S if complete else LONGEST_S)

    @property
    def _kind(self) -> AutopilotKind | None:
        return None if self.autopilot is None else self.autopilot.kind

    def receive(self, link: str, data: bytes, now_s: float, address: Address | None = None) -> None:
        """Takes bytes from a link, split anywhere; never raises."""
        self.received_bytes += len(data)
        self._session.receive(link, data, now_s, address)

    def tick(self, now_s: float) -> None:
        """Runs one cycle; to be called at 10 Hz or more."""
        self._now_s = now_s
        self._session.tick(now_s, SystemStatus.STANDBY)
        for event in self._session.events_received():
            if isinstance(event, AutopilotConflict):
                self.conflict = event
        for _, packet in self._session.received_packets():
            for message in self._reader.receive(packet):
                self._take_value(message)
        autopilot = self.autopilot
        if autopilot is None:
            return
        if self._found_s is None:
            self._found_s = now_s
            self._session.requests.want_parameters(profile(autopilot.kind).setup_parameters)
        if self._waiting:
            self._set(autopilot)

    def data_to_send(self) -> list[tuple[str, bytes]]:
        """Packets since the last call, in order, each with its link's name."""
        sent = self._session.data_to_send()
        if self.autopilot is not None:
            sent += [(self.autopilot.link, packet) for packet in self._out]
        self._out.clear()
        return sent

    def peers(self, link: str) -> tuple[Address, ...]:
        """Addresses to which a listening link sends."""
        return self._session.peers(link)

    def set(self, changes: Iterable[Change]) -> None:
        """Begins to set parameters, one by one, each read back before the next."""
        self._waiting.extend(changes)

    @property
    def setting(self) -> bool:
        """True while changes wait for their result."""
        return bool(self._waiting)

    def _set(self, autopilot: Autopilot) -> None:
        """Sends the next PARAM_SET or PARAM_REQUEST_READ; ends all changes of an armed aircraft."""
        status = self.telemetry.autopilot
        age_s = math.inf if status is None else self._now_s - (status.armed_s or status.received_s)
        if status is not None and status.armed:
            self._end_all(SetStatus.ARMED)
            return
        if age_s > _SILENT_S:
            self._end_all(SetStatus.SILENT)
            return
        if self._now_s - self._asked_s < _ANSWER_S or age_s > _HEARTBEAT_S:
            return
        if self._tries >= _MOST_TRIES:
            self._end(SetStatus.UNANSWERED if self._last_value is None else SetStatus.REFUSED)
            return
        change = self._waiting[0]
        self._tries += 1
        self._asked_s = self._now_s
        self._writer.system_id = autopilot.system_id
        if self._reads_back:
            message = parameter_request_message(target=autopilot.ids, name=change.name)
        else:
            message = self._set_message(autopilot, change)
        self._out.append(self._writer.encode(message))

    def _set_message(self, autopilot: Autopilot, change: Change) -> Message:
        kind = self.types.get(change.name, int(mavlink.MAV_PARAM_TYPE_REAL32))
        value = change.value
        if kind < mavlink.MAV_PARAM_TYPE_REAL32 and profile(autopilot.kind).integers_bytewise:
            (value,) = struct.unpack("<f", struct.pack("<i", round(value)))
        return create(
            "PARAM_SET",
            target_system=autopilot.system_id,
            target_component=autopilot.component_id,
            param_id=change.name.encode("ascii"),
            param_value=value,
            param_type=kind,
        )

    def _take_value(self, message: Message) -> None:
        autopilot = self.autopilot
        source = (message.get_srcSystem(), message.get_srcComponent())
        if autopilot is None or source != autopilot.ids:
            return
        self.types[message.param_id] = message.param_type
        if not self._waiting or message.param_id != self._waiting[0].name or not self._tries:
            return
        value = parameter_value(message, autopilot.kind)
        wanted = self._waiting[0].value
        same = value is not None and math.isclose(value, wanted, rel_tol=1e-6, abs_tol=1e-6)
        self._last_value = value
        if self._reads_back and same:
            self._end(SetStatus.SET)
            return
        # Its echo: read it once more. Read back with another value: set it again.
        self._reads_back = not self._reads_back
        self._asked_s = -math.inf

    def _end(self, status: SetStatus) -> None:
        change = self._waiting.popleft()
        self.results.append(SetResult(change=change, status=status, value=self._last_value))
        self._tries, self._asked_s = 0, -math.inf
        self._reads_back, self._last_value = False, None

    def _end_all(self, status: SetStatus) -> None:
        while self._waiting:
            self._end(status)

"""Parameters of the component: the settings that may be changed in flight. No I/O.

Inputs: requests of the parameter protocol and of the extended one. Outputs: values, refusals, and
events of values that were set. The set is fixed after the start; an INT32 is encoded as the
vehicle's autopilot does: PX4 by its bytes, ArduPilot by its number. Sources:
https://mavlink.io/en/services/parameter.html, https://mavlink.io/en/services/parameter_ext.html.

A value is checked in 0.3 ms: of a link one is set in a cycle, others wait. A packet that is no
later than its sender's last one for that parameter is a copy, or was overtaken: it sets nothing. A
refusal is answered by PARAM_ERROR, and by the value that stays, which older ground stations read.
"""

from __future__ import annotations

import enum
import math
import struct
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from ...settings.flight_parameters import FlightParameters, ParameterError, flight_parameters
from ...settings.link_config import LinkRole
from ...types import AutopilotKind
from ..autopilots import profile
from ..commands import Sender
from ..dialect import Message, create, mavlink
from ..parameters import PAYLOAD_STARTS, parameter_value
from ..rate_limits import SenderLimit
from .component_service import Asker
from .link_budget import fastest_setpoints_hz

_LIST = int(mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_LIST)
_READ = int(mavlink.MAVLINK_MSG_ID_PARAM_REQUEST_READ)
_SET = int(mavlink.MAVLINK_MSG_ID_PARAM_SET)
_EXT_LIST = int(mavlink.MAVLINK_MSG_ID_PARAM_EXT_REQUEST_LIST)
_EXT_READ = int(mavlink.MAVLINK_MSG_ID_PARAM_EXT_REQUEST_READ)
_EXT_SET = int(mavlink.MAVLINK_MSG_ID_PARAM_EXT_SET)
_REAL32 = int(mavlink.MAV_PARAM_TYPE_REAL32)
_INT32 = int(mavlink.MAV_PARAM_TYPE_INT32)
"""The extended types of these have the same numbers."""
_EXT_FORMATS = {
    1: "<B",
    2: "<b",
    3: "<H",
    4: "<h",
    5: "<I",
    6: "<i",
    7: "<Q",
    8: "<q",
    9: "<f",
    10: "<d",
}
"""Formats of MAV_PARAM_EXT_TYPEs: the bytes of param_value begin with the value."""
_EXT_VALUE_AT = 18
"""Start of param_value in the payload of PARAM_EXT_SET."""
_ID_BYTES = 16
_RATE = "SETPOINT_RATE"
_EXT_VALUE_BYTES = 128
_MOST_WAITING = 64
"""Limit of values that wait to be set; a ground station repeats what gets no answer."""
_MOST_PACKETS = 1000
"""Limit of packets whose copies are known: more than four links may set in `_OVERTAKEN_S`."""
_OVERTAKEN_S = 1.0
"""Greatest delay of a copy, or of a packet that a later one has overtaken: in this time a ground
station sends fewer than 128 packets, so that their numbers give the order."""


class _Error(enum.IntEnum):
    """MAV_PARAM_ERROR."""

    DOES_NOT_EXIST = 1
    VALUE_OUT_OF_RANGE = 2
    PERMISSION_DENIED = 3


_ACCEPTED, _VALUE_UNSUPPORTED, _FAILED = range(3)
"""PARAM_ACK results of the extended protocol."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterSet:
    """A parameter that a sender has set to another value."""

    name: str
    value: float
    before: float
    sender: Sender


@dataclass(frozen=True, slots=True, kw_only=True)
class ParameterRefused:
    """A value that was not set. reason: a text for operators, with name, value, what is allowed."""

    reason: str
    sender: Sender


class _Setting(NamedTuple):
    """A value to set. value: NaN where its type has none."""

    name: str
    value: float
    asker: Asker
    extended: bool


class _Source(NamedTuple):
    """A parameter, and the sender that sets it, on whichever links its packets come."""

    name: str
    system_id: int
    component_id: int


class _Packet(NamedTuple):
    """The last packet of a source."""

    sequence: int
    received_s: float


class ParameterServer:
    """Answers requests, and keeps the present values.

    links: name and role of each. autopilot: returns the kind of the autopilot, None if unknown.
    """

    MESSAGE_IDS = frozenset({_LIST, _READ, _SET, _EXT_LIST, _EXT_READ, _EXT_SET})

    def __init__(
        self,
        parameters: FlightParameters,
        links: Mapping[str, LinkRole],
        autopilot: Callable[[], AutopilotKind | None],
    ) -> None:
        self.parameters = parameters
        """The present values."""
        self._rows = tuple(flight_parameters().values())
        self._indices = {row.name: index for index, row in enumerate(self._rows)}
        self._autopilot = autopilot
        to_autopilot = (link for link, role in links.items() if role is not LinkRole.OPERATOR)
        self._fastest_hz = min(map(fastest_setpoints_hz, to_autopilot), default=math.inf)
        """Greatest rate of setpoints that all lines to the autopilot carry."""
        self._listed: dict[str, dict[tuple[int, bool], None]] = {link: {} for link in links}
        """Values to send, by link: index, and True for the extended protocol; in order, once."""
        self._waiting: dict[str, deque[_Setting]] = {link: deque() for link in self._listed}
        self._more: dict[str, deque[Message]] = {link: deque() for link in self._listed}
        """Further answers to the last setting of a link."""
        self._last: dict[_Source, _Packet] = {}
        """The latest `_MOST_PACKETS`, the oldest first."""
        self._set_s = dict.fromkeys(self._listed, -math.inf)
        """Time of the last cycle in which a value was set or refused, by link."""
        self._sets = SenderLimit(burst=100, rate_hz=10.0, link_burst=200, link_rate_hz=40.0)
        self._texts = SenderLimit(burst=5, rate_hz=0.5, link_burst=10, link_rate_hz=1.0)
        self._events: list[ParameterSet | ParameterRefused] = []

    def events_received(self) -> list[ParameterSet | ParameterRefused]:
        """Returns the events since the last call."""
        events, self._events = self._events, []
        return events

    def set_back(self, refused: FlightParameters, in_force: FlightParameters) -> None:
        """Sets the values of `refused` back to those in force, and sends these on all links.

        A value that was set again since then stays, where it is valid beside them.
        """
        names = [
            name
            for name in refused.differing(in_force)
            if self.parameters.value(name) == refused.value(name)
        ]
        before = self.parameters
        self.parameters = before.with_values_of(names, in_force) or in_force
        for name in self.parameters.differing(before):
            for listed in self._listed.values():
                listed[self._indices[name], False] = None

    def handle(self, message: Message, asker: Asker, now_s: float) -> list[Message]:
        """Takes a request; returns the value or the error that a single one gets.

        Only lists are answered where they are requested of all components.
        """
        kind, link = message.get_msgId(), asker.sender.link
        extended = kind in {_EXT_LIST, _EXT_READ, _EXT_SET}
        if kind in {_LIST, _EXT_LIST}:
            for index in range(len(self._rows)):
                self._listed[link][index, extended] = None
            return []
        if not message.target_component:
            return []
        index = getattr(message, "param_index", -1)
        index = self._indices.get(message.param_id, -1) if index == -1 else index
        if not 0 <= index < len(self._rows):
            return [] if extended else [self._error(message, asker)]
        if kind in {_READ, _EXT_READ}:
            return [self._value(index, extended=extended)]
        self._take(message, asker, extended=extended, now_s=now_s)
        return []

    def _take(self, message: Message, asker: Asker, *, extended: bool, now_s: float) -> None:
        """Takes a value to set, for a later cycle; leaves out a copy, and one too many."""
        name, sender, sequence = message.param_id, asker.sender, message.get_seq()
        source = _Source(name, sender.system_id, sender.component_id)
        waiting, last = self._waiting[sender.link], self._last.get(source)
        if (
            last is not None
            and (last.sequence - sequence) % 256 < 128
            and now_s - last.received_s <= _OVERTAKEN_S
        ):
            return
        if len(waiting) < _MOST_WAITING and self._sets.allows(sender, now_s):
            self._last.pop(source, None)
            if len(self._last) >= _MOST_PACKETS:
                del self._last[next(iter(self._last))]
            self._last[source] = _Packet(sequence, now_s)
            value = _extended_value(message) if extended else None
            if not extended:
                value = parameter_value(message, self._autopilot())
            waiting.append(_Setting(name, math.nan if value is None else value, asker, extended))

    def next_answer(self, link: str, _most_bytes: int, now_s: float) -> Message | None:
        """Next answer on a link: to a value that is set now, then of a list or a change."""
        if self._more[link]:
            return self._more[link].popleft()
        if self._waiting[link] and now_s != self._set_s[link]:
            self._set_s[link] = now_s
            first, *more = self._set(self._waiting[link].popleft(), now_s)
            self._more[link].extend(more)
            return first
        if not self._listed[link]:
            return None
        index, extended = next(iter(self._listed[link]))
        del self._listed[link][index, extended]
        return self._value(index, extended=extended)

    def _set(self, setting: _Setting, now_s: float) -> list[Message]:
        """Sets a value, if it may be set; returns the answers."""
        name, value, asker, extended = setting
        before, index = self.parameters.value(name), self._indices[name]
        error: _Error | None = None
        reason = asker.objection
        if reason is not None:
            error = _Error.PERMISSION_DENIED
        else:
            try:
                self._check_rate(name, value)
                self.parameters = self.parameters.with_value(name, value)
            except ParameterError as refused:
                error, reason = _Error.VALUE_OUT_OF_RANGE, str(refused)
        if reason is not None and self._texts.allows(asker.sender, now_s):
            self._events.append(ParameterRefused(reason=reason, sender=asker.sender))
        now = self.parameters.value(name)
        if now != before:
            self._events.append(
                ParameterSet(name=name, value=now, before=before, sender=asker.sender)
            )
            for link, listed in self._listed.items():
                if extended or link != asker.sender.link:
                    listed[index, False] = None
        if extended:
            results = {None: _ACCEPTED, _Error.VALUE_OUT_OF_RANGE: _VALUE_UNSUPPORTED}
            return [self._acknowledgement(index, results.get(error, _FAILED))]
        answers = [] if error is None else [_error_message(asker, name, -1, error)]
        return [*answers, self._value(index, extended=False)]

    def _check_rate(self, name: str, value: float) -> None:
        """Raises ParameterError for a rate of setpoints that a line does not carry.

        One that is no greater than the present one is permitted.
        """
        if name == _RATE and value > max(self._fastest_hz, self.parameters.value(_RATE)):
            fastest = f"the line carries {math.floor(self._fastest_hz)}"
            raise ParameterError(f"{_RATE} is {value:g}, {fastest}")

    def _value(self, index: int, *, extended: bool) -> Message:
        """PARAM_VALUE, or PARAM_EXT_VALUE, of a parameter."""
        if extended:
            return create("PARAM_EXT_VALUE", **self._extended(index), **self._place(index))
        row = self._rows[index]
        value = self.parameters.value(row.name)
        if row.is_integer and profile(self._autopilot()).integers_bytewise:
            (value,) = struct.unpack("<f", struct.pack("<i", int(value)))
        return create(
            "PARAM_VALUE",
            param_id=row.name.encode(),
            param_value=value,
            param_type=_INT32 if row.is_integer else _REAL32,
            **self._place(index),
        )

    def _place(self, index: int) -> dict[str, int]:
        return {"param_count": len(self._rows), "param_index": index}

    def _acknowledgement(self, index: int, result: int) -> Message:
        return create("PARAM_EXT_ACK", **self._extended(index), param_result=result)

    def _extended(self, index: int) -> dict[str, Any]:
        """Fields of a value in the extended protocol: its bytes."""
        row = self._rows[index]
        value = self.parameters.value(row.name)
        packed = struct.pack("<i", int(value)) if row.is_integer else struct.pack("<f", value)
        return {
            "param_id": row.name.encode(),
            "param_value": packed.ljust(_EXT_VALUE_BYTES, b"\x00"),
            "param_type": _INT32 if row.is_integer else _REAL32,
        }

    def _error(self, message: Message, asker: Asker) -> Message:
        """PARAM_ERROR for a parameter that does not exist."""
        index = getattr(message, "param_index", -1)
        return _error_message(asker, message.param_id, index, _Error.DOES_NOT_EXIST)


def _error_message(asker: Asker, name: str, index: int, error: _Error) -> Message:
    return create(
        "PARAM_ERROR",
        target_system=asker.sender.system_id,
        target_component=asker.sender.component_id,
        param_id=name.encode("ascii", errors="replace")[:_ID_BYTES],
        param_index=index,
        error=error,
    )


def _extended_value(message: Message) -> float | None:
    """Value of a PARAM_EXT_SET, from its bytes: their text form ends at the first zero."""
    code = _EXT_FORMATS.get(message.param_type)
    if code is None:
        return None
    packet = message.get_msgbuf()  # whole: its last field, the type, is not 0
    (value,) = struct.unpack_from(code, packet, PAYLOAD_STARTS[packet[0]] + _EXT_VALUE_AT)
    return float(value)

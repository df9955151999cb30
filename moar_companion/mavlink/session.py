"""The companion's side of MAVLink over all its links: bytes and time in, bytes and events out.

A machine without I/O and without a clock. The service feeds it with `receive`, calls `tick` at the
rate at which it thinks (10 Hz or more), takes `events_received` and `telemetry`, and writes
what `data_to_send` returns.

Heartbeats come from `tick` alone, so that a companion whose thinking has stopped falls silent.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

from ..config import LinkRole
from ..types import AutopilotKind, LinkStatistics, Telemetry, Vector
from . import modes, services, translate, translate_outgoing
from .codec import Codec
from .commands import Answer, Command, CommandCancelled, CommandLedger, CommandResult
from .dialect import Message, mavlink
from .identity import (
    Autopilot,
    AutopilotConflict,
    AutopilotFound,
    AutopilotRestarted,
    BootClock,
    Identity,
)
from .outbox import Outbox
from .places import PlaceRequests
from .rates import DEFAULT_RATES_HZ, RateRequests
from .texts import Severity, StatusTexts
from .translate_outgoing import SystemStatus

__all__ = ["CommandAnswered", "Event", "Session", "Severity", "SystemStatus"]

_MAX_PACKETS = 4096
"""Kept for a record until they are taken: ten seconds of PX4."""

_HEARTBEAT = int(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
_RADIO_STATUS = int(mavlink.MAVLINK_MSG_ID_RADIO_STATUS)
_COMMAND_CANCEL = 80
_SET_MESSAGE_INTERVAL = int(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL)
_REQUEST_MESSAGE = int(mavlink.MAV_CMD_REQUEST_MESSAGE)
_DO_SET_MODE = int(mavlink.MAV_CMD_DO_SET_MODE)


@dataclass(frozen=True, slots=True, kw_only=True)
class CommandAnswered:
    """The autopilot's COMMAND_ACK to a mode that was requested.

    Not the last word: PX4 sends ACCEPTED and 4 ms later TEMPORARILY_REJECTED for OFFBOARD without
    a stream. The mode in the heartbeat is.
    """

    command: int
    result: int


Event = (
    Command
    | CommandCancelled
    | AutopilotFound
    | AutopilotRestarted
    | AutopilotConflict
    | CommandAnswered
)


class Session:
    """One companion on its links.

    links: name of each link and who is there. system_id, component_id: ours; the system id is the
    autopilot's once one is heard. message_rates_hz: wanted rates by autopilot kind and message id.
    """

    def __init__(
        self,
        *,
        links: Mapping[str, LinkRole],
        system_id: int = 1,
        component_id: int = 195,
        message_rates_hz: Mapping[AutopilotKind, Mapping[int, float]] = DEFAULT_RATES_HZ,
    ) -> None:
        self._roles = dict(links)
        self._component_id = component_id
        self._handlers: dict[int, Callable[[str, Message, float], None]] = {
            int(mavlink.MAVLINK_MSG_ID_COMMAND_LONG): self._receive_command,
            int(mavlink.MAVLINK_MSG_ID_COMMAND_INT): self._receive_command,
            _COMMAND_CANCEL: self._receive_command,
            int(mavlink.MAVLINK_MSG_ID_COMMAND_ACK): self._receive_acknowledgement,
            **dict.fromkeys(services.MESSAGE_IDS, self._receive_request),
        }
        wanted = (
            translate.MESSAGE_IDS
            | self._handlers.keys()
            | {int(mavlink.MAVLINK_MSG_ID_SYSTEM_TIME)}
        )
        self._codecs = {
            name: Codec(system_id=system_id, component_id=component_id, wanted=wanted)
            for name in links
        }
        self._system_id = system_id
        self._message_rates_hz = message_rates_hz
        self._identity = Identity()
        self._boot_clock = BootClock()
        self._rates = RateRequests()
        self._places = PlaceRequests()
        self._outbox = Outbox(links)
        self._ledger = CommandLedger()
        self._texts = StatusTexts()
        self._telemetry = Telemetry()
        self._events: list[Event] = []
        self._packets: deque[tuple[float, bytes]] = deque(maxlen=_MAX_PACKETS)
        self._packet_s = 0.0
        self._now_s = 0.0

    # What is known

    @property
    def telemetry(self) -> Telemetry:
        """The autopilot's last words, our link's statistics, the radio's and ground stations'."""
        return self._telemetry

    @property
    def system_id(self) -> int:
        """Our system id: the configured one until an autopilot is heard, then its."""
        return self._system_id

    @property
    def autopilot(self) -> Autopilot | None:
        """The autopilot that was heard first."""
        return self._identity.autopilot

    @property
    def control_allowed(self) -> bool:
        """Whether there is one autopilot, and only one, to control."""
        return self._identity.autopilot is not None and not self._identity.conflict

    def events_received(self) -> list[Event]:
        """What has happened since the last call, in order."""
        events, self._events = self._events, []
        return events

    def packets_heard(self) -> list[tuple[float, bytes]]:
        """Whole packets of all links since the last call, with their times, for a record.

        The oldest are dropped when nobody takes them; those with a secret never appear.
        """
        packets = list(self._packets)
        self._packets.clear()
        return packets

    def data_to_send(self) -> list[tuple[str, bytes]]:
        """Packets since the last call, in order, each with its link's name.

        Nothing before the first `tick`: a heartbeat is the first thing ever sent.
        """
        return [(link, self._codecs[link].encode(message)) for link, message in self._outbox.take()]

    # In

    def receive(self, link: str, data: bytes, now_s: float) -> None:
        """Takes bytes from a link, split anywhere. Never raises, whatever they are."""
        self._now_s = now_s
        codec = self._codecs[link]
        for message in codec.receive(data):
            self._receive_message(link, message, now_s)
        self._packets.extend((now_s, packet) for packet in codec.packets)

    def _receive_message(self, link: str, message: Message, now_s: float) -> None:
        if _source(message) == (self._system_id, self._component_id):
            return
        message_id = message.get_msgId()
        if message_id == _HEARTBEAT:
            self._receive_heartbeat(link, message, now_s)
        autopilot = self._identity.autopilot
        if autopilot is not None and _is_from(autopilot, link, message):
            self._packet_s = now_s
            self._rates.hear(message_id)
            boot_s = translate.boot_time_s(message)
            if boot_s is not None and self._boot_clock.hear(boot_s):
                self._restart(AutopilotRestarted(autopilot=autopilot), now_s)
            self._telemetry = translate.update(self._telemetry, message, now_s)
        elif message_id == _RADIO_STATUS:
            # A telemetry radio speaks for itself, as system 51, component 68.
            self._telemetry = translate.update(self._telemetry, message, now_s)
        handler = self._handlers.get(message_id)
        if handler is not None:
            handler(link, message, now_s)

    def _receive_heartbeat(self, link: str, message: Message, now_s: float) -> None:
        if translate.is_ground_station(message):
            self._telemetry = translate.update(self._telemetry, message, now_s)
            return
        if self._roles[link] is not LinkRole.AUTOPILOT:
            return
        event = self._identity.hear(message, link=link, now_s=now_s)
        if isinstance(event, AutopilotFound):
            self._system_id = event.autopilot.system_id
            for codec in self._codecs.values():
                codec.system_id = self._system_id
            self._start_conversation(event, now_s)
        elif isinstance(event, AutopilotRestarted):
            self._boot_clock.reset()
            self._restart(event, now_s)
        elif event is not None:
            self._events.append(event)

    def _restart(self, event: AutopilotRestarted, now_s: float) -> None:
        """Nothing the autopilot said before its restart holds any more; its mode comes at 1 Hz."""
        before = self._telemetry
        self._telemetry = Telemetry(
            autopilot=before.autopilot,
            radio=before.radio,
            ground_station=before.ground_station,
            link=before.link,
        )
        self._start_conversation(event, now_s)

    def _start_conversation(self, event: AutopilotFound | AutopilotRestarted, now_s: float) -> None:
        """Asks for streams and origin, with a heartbeat before all else."""
        kind = event.autopilot.kind
        self._events.append(event)
        self._rates.start(
            self._message_rates_hz.get(kind, {}),
            silent=kind is AutopilotKind.ARDUPILOT,
            now_s=now_s,
        )
        self._places = PlaceRequests()
        self._outbox.hurry_heartbeat(now_s)

    def _receive_command(self, link: str, message: Message, now_s: float) -> None:
        reception = self._ledger.receive(
            message,
            link=link,
            system_id=self._system_id,
            component_id=self._component_id,
            now_s=now_s,
        )
        if reception.event is not None:
            self._events.append(reception.event)
        self._acknowledge(reception.answer, link)

    def _receive_acknowledgement(self, link: str, message: Message, _now_s: float) -> None:
        autopilot = self._identity.autopilot
        if autopilot is None or not _is_from(autopilot, link, message):
            return
        target = (message.target_system, message.target_component)
        if target not in {(0, 0), (self._system_id, self._component_id)}:
            return
        if message.command == _SET_MESSAGE_INTERVAL:
            self._rates.answered(message.result)
        elif message.command == _DO_SET_MODE:
            self._events.append(CommandAnswered(command=_DO_SET_MODE, result=message.result))

    def _receive_request(self, link: str, message: Message, now_s: float) -> None:
        autopilot = self._identity.autopilot
        answer = services.answer(
            message,
            ours=(self._system_id, self._component_id),
            autopilot=_address(autopilot) if autopilot else None,
            now_s=now_s,
        )
        if answer is not None:
            self._outbox.send(link, answer)

    # Out

    def tick(self, now_s: float, system_status: SystemStatus) -> None:
        """Sends what is due: our heartbeat, requests for streams, origin and home."""
        self._now_s = now_s
        self._outbox.send_heartbeat_if_due(now_s, system_status)
        self._identity.forget_silent(now_s)
        autopilot = self._identity.autopilot
        if autopilot is None:
            return
        self._update_link_statistics(autopilot)
        if not self._identity.alive(now_s):
            return
        rate = self._rates.next_request(now_s)
        if rate is not None:
            self._command(autopilot, _SET_MESSAGE_INTERVAL, *rate)
        place = self._places.next_request(self._telemetry, now_s)
        if place is not None:
            self._command(autopilot, _REQUEST_MESSAGE, place)

    def _update_link_statistics(self, autopilot: Autopilot) -> None:
        counted = self._codecs[autopilot.link].statistics(*_address(autopilot))
        statistics = LinkStatistics(
            received_s=self._packet_s,
            packets_received=counted.received,
            packets_lost=counted.lost,
        )
        self._telemetry = replace(self._telemetry, link=statistics)

    def send_setpoint(
        self, position_ned_m: Vector, velocity_ned_mps: Vector, yaw_rad: float, now_s: float
    ) -> bool:
        """Streams one setpoint to the autopilot; False when there is none to control.

        Raises ValueError when a value is not finite.
        """
        autopilot = self._identity.autopilot
        message = translate_outgoing.setpoint_message(
            target=_address(autopilot) if autopilot else (0, 0),
            position_ned_m=position_ned_m,
            velocity_ned_mps=velocity_ned_mps,
            yaw_rad=yaw_rad,
            now_s=now_s,
        )
        if autopilot is None or not self.control_allowed:
            return False
        self._outbox.send(autopilot.link, message)
        return True

    def request_own_mode(self) -> bool:
        """Asks once for OFFBOARD or GUIDED; False when there is no autopilot to control.

        Never repeated by itself: both autopilots accept it during a failsafe, and cancel that.
        """
        return self._request_mode(modes.own_mode_parameters)

    def request_land(self) -> bool:
        """Asks once for the autopilot's LAND mode; False when there is none to control."""
        return self._request_mode(modes.land_parameters)

    def _request_mode(self, parameters_of: Callable[..., tuple[int, int, int] | None]) -> bool:
        autopilot = self._identity.autopilot
        status = self._telemetry.autopilot
        if autopilot is None or not self.control_allowed:
            return False
        parameters = parameters_of(autopilot.kind, armed=status is not None and status.armed)
        if parameters is None:
            return False
        self._command(autopilot, _DO_SET_MODE, *parameters)
        return True

    def answer(
        self,
        command: Command,
        result: CommandResult,
        *,
        progress: int = 0,
        result_param2: int = 0,
    ) -> bool:
        """Acknowledges a received command on its link; False when no answer is due any more."""
        answer = self._ledger.answer(
            command, result, progress=progress, result_param2=result_param2, now_s=self._now_s
        )
        self._acknowledge(answer, command.sender.link)
        return answer is not None

    def send_named_value(self, name: str, value: float, now_s: float) -> None:
        """NAMED_VALUE_FLOAT on all links; what is not finite is not sent.

        Raises ValueError when the name is longer than 10 ASCII characters.
        """
        message = translate_outgoing.named_value_message(name, value, now_s)
        if message is not None:
            self._outbox.send_to_all(message)

    def send_text(self, severity: Severity, text: str, now_s: float) -> None:
        """STATUSTEXT on all links, in chunks; the same text not again within 10 s."""
        for message in self._texts.messages(severity, text, now_s):
            self._outbox.send_to_all(message)

    def _acknowledge(self, answer: Answer | None, link: str) -> None:
        if answer is not None:
            self._outbox.send(link, answer.message())

    def _command(self, autopilot: Autopilot, command: int, *parameters: float) -> None:
        """A COMMAND_LONG to the autopilot; parameters not given are 0."""
        message = translate_outgoing.command_message(
            target=_address(autopilot), command=command, parameters=parameters
        )
        self._outbox.send(autopilot.link, message)


def _address(autopilot: Autopilot) -> tuple[int, int]:
    return autopilot.system_id, autopilot.component_id


def _source(message: Message) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()


def _is_from(autopilot: Autopilot, link: str, message: Message) -> bool:
    """Whether the autopilot says this, on the link on which it is ours."""
    return link == autopilot.link and _source(message) == _address(autopilot)

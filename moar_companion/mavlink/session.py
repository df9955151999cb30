"""The companion's side of MAVLink over all its links: bytes and time in, bytes and events out.

A machine without I/O and without a clock. The service calls `receive` with bytes and `tick` at the
rate of its control loop (10 Hz or more), takes `events_received` and `telemetry`, and writes the
bytes of `data_to_send`.

Only `tick` sends heartbeats, so that they stop when the control loop stalls.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Mapping
from functools import partial

from ..config import Commands, LinkRole
from ..types import AutopilotKind, FenceItem, Telemetry, Vector
from . import fence_download, modes, ping_timesync, telemetry_receiver, translate_outgoing
from .codec import Codec, packet_source
from .command_dedup import CommandDedup
from .commands import Answer, Command, CommandCancelled, CommandResult, Sender
from .dialect import Message, mavlink
from .fence_download import FenceDownload
from .identity import Autopilot, AutopilotConflict, AutopilotFound, AutopilotRestarted
from .message_rates import DEFAULT_RATES_HZ, MessageRates, on_network
from .mode_requests import DO_SET_MODE, CommandAnswered, ModeRequests
from .origin_home_requests import OriginHomeRequests
from .outbox import Outbox
from .parameters import ParameterRequests
from .peers import Address, AutopilotElsewhere, PeerRefused, Peers, Precedence
from .permissions import Permissions
from .signing import LinkSigning, Refusal
from .statustext import Severity, StatusTexts
from .telemetry_receiver import ModeLeft, TelemetryReceiver
from .timesync_rtt import TimesyncRtt
from .translate_motors import MOTOR_PARAMETERS
from .translate_outgoing import SystemStatus
from .translate_status import GNSS_PARAMETERS

__all__ = ["CommandAnswered", "Event", "Session", "Severity", "SystemStatus"]

_MAX_PACKETS = 4096
"""Limit of packets kept for a record until they are taken: ten seconds of PX4."""

_COMMAND_CANCEL = 80
_SET_MESSAGE_INTERVAL = int(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL)
_REQUEST_MESSAGE = int(mavlink.MAV_CMD_REQUEST_MESSAGE)
_AUTOPILOT_VERSION = int(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION)
_HEARTBEAT = int(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
_HEARTBEAT_PERIOD_S = 1.0

Event = (
    Command
    | CommandCancelled
    | AutopilotFound
    | AutopilotRestarted
    | AutopilotConflict
    | AutopilotElsewhere
    | CommandAnswered
    | ModeLeft
    | PeerRefused
)


class Session:
    """One companion on its links.

    links: name and role of each link. system_id, component_id: the companion's; once an autopilot
    is found the companion takes its system id. commands: rules for permitted senders.
    message_rates_hz: wanted rates by autopilot kind and message id. signing: of the links on which
    all packets are signed.
    """

    def __init__(
        self,
        *,
        links: Mapping[str, LinkRole],
        system_id: int = 1,
        component_id: int = 195,
        commands: Commands | None = None,
        message_rates_hz: Mapping[AutopilotKind, Mapping[int, float]] = DEFAULT_RATES_HZ,
        signing: Mapping[str, LinkSigning] | None = None,
    ) -> None:
        self._roles = dict(links)
        self._component_id = component_id
        self._handlers: dict[int, Callable[[str, Message, float], None]] = {
            int(mavlink.MAVLINK_MSG_ID_COMMAND_LONG): self._receive_command,
            int(mavlink.MAVLINK_MSG_ID_COMMAND_INT): self._receive_command,
            _COMMAND_CANCEL: self._receive_command,
            int(mavlink.MAVLINK_MSG_ID_COMMAND_ACK): self._receive_acknowledgement,
            int(mavlink.MAVLINK_MSG_ID_PARAM_VALUE): self._receive_parameter,
            **dict.fromkeys(ping_timesync.MESSAGE_IDS, self._receive_request),
            **dict.fromkeys(fence_download.MESSAGE_IDS, self._receive_fence),
        }
        self._signing = dict(signing or {})
        make_codec = partial(
            Codec,
            system_id=system_id,
            component_id=component_id,
            wanted=telemetry_receiver.MESSAGE_IDS | self._handlers.keys(),
        )
        makers = {name: partial(make_codec, signing=self._signing.get(name)) for name in links}
        self._codecs = {name: make() for name, make in makers.items()}
        """Encoder of each link; its peers have the decoders."""
        self._peers = {name: Peers(name, role, makers[name]) for name, role in links.items()}
        self._permissions = Permissions(commands or Commands())
        self._system_id = system_id
        self._message_rates_hz = message_rates_hz
        self._listener = TelemetryReceiver()
        self._unidentified: tuple[str, tuple[int, int]] | None = None
        """Link and ids of a received autopilot whose heartbeat has not come yet."""
        self._identify_s = -math.inf
        self._rates = MessageRates()
        self._places = OriginHomeRequests()
        self._parameters = ParameterRequests()
        self._fence: FenceDownload | None = None
        self._modes = ModeRequests()
        self._round_trips = TimesyncRtt()
        self._answers = ping_timesync.answer_limit()
        self._outbox = Outbox(links)
        self._ledger = CommandDedup(commands)
        self._texts = StatusTexts()
        self._events: list[Event] = []
        self._packets: deque[tuple[float, bytes]] = deque(maxlen=_MAX_PACKETS)
        self._now_s = 0.0

    # State

    @property
    def telemetry(self) -> Telemetry:
        """Latest telemetry of the autopilot, its link, the radio and ground stations."""
        return self._listener.telemetry

    @property
    def system_id(self) -> int:
        """System id of the companion: the configured one, then that of the found autopilot."""
        return self._system_id

    @property
    def autopilot(self) -> Autopilot | None:
        """Autopilot that was received first."""
        return self._listener.autopilot

    @property
    def control_allowed(self) -> bool:
        """True while there is exactly one autopilot to control."""
        return self.autopilot is not None and self.conflict is None

    @property
    def conflict(self) -> str | None:
        """Text for a received second autopilot, under any ids; None without one."""
        return self._listener.identity.conflict

    @property
    def parameters(self) -> Mapping[str, float | None]:
        """Parameters requested by `want_parameters`, by name; None: never reported."""
        return self._parameters.values

    @property
    def fence_items(self) -> tuple[FenceItem, ...] | None:
        """Fence that was uploaded to the autopilot, once `want_fence` was called.

        None while unknown; empty without a fence.
        """
        return None if self._fence is None else self._fence.items

    @property
    def fence_silent(self) -> bool:
        """True while the autopilot does not answer requests of its uploaded fence."""
        return self._fence is not None and self._fence.silent

    @property
    def mode_unanswered(self) -> bool:
        """True from a mode request until the autopilot answers it."""
        return self._modes.unanswered

    @property
    def signing_timestamps(self) -> dict[str, int]:
        """Time stamp of each signed link: a later process must start after it."""
        return {link: signing.timestamp for link, signing in self._signing.items()}

    @property
    def signing_references(self) -> dict[str, int]:
        """Reference time stamp for new senders of each signed link, for a later process."""
        return {link: signing.reference for link, signing in self._signing.items()}

    @property
    def signers_behind_s(self) -> dict[str, dict[int, float]]:
        """Lag of the systems that are refused as too old, by signed link and system id."""
        return {link: dict(signing.behind_s) for link, signing in self._signing.items()}

    @property
    def signing_ahead_s(self) -> float:
        """Greatest lead of the reference for new senders over the wall clock, of all links."""
        return max((signing.ahead_s for signing in self._signing.values()), default=0.0)

    @property
    def packets_refused(self) -> dict[str, dict[Refusal, int]]:
        """Count of refused packets by signed link and reason."""
        return {link: dict(signing.refused) for link, signing in self._signing.items()}

    def events_received(self) -> list[Event]:
        """Returns the events since the last call, in order."""
        events, self._events = self._events, []
        return events

    def packets_heard(self) -> list[tuple[float, bytes]]:
        """Whole packets of all links since the last call, with their times, for a record.

        Without packets with a secret and those with the autopilot's ids from a foreign address.
        The oldest are dropped if the service does not take them.
        """
        packets = list(self._packets)
        self._packets.clear()
        return packets

    def data_to_send(self, *, control: bool = True) -> list[tuple[str, bytes]]:
        """Returns the packets since the last call, in order, each with its link's name.

        None before the first `tick`: a heartbeat is always sent first. Without `control` setpoints
        and mode requests are discarded.
        """
        waiting = self._outbox.take()
        return self._encoded(item for item in waiting if control or not _controls(item[1]))

    def peers(self, link: str) -> tuple[Address, ...]:
        """Addresses to which a listening link sends; empty for other links."""
        return self._peers[link].addresses(self._now_s)

    def precedence(self, link: str, address: Address | None) -> Precedence:
        """Reading order of the bytes from an address under overload."""
        return self._peers[link].precedence(address)

    def control_to_send(self) -> list[tuple[str, bytes]]:
        """Returns the waiting packets that command motion: setpoints and mode requests."""
        return self._encoded(self._outbox.take(_controls))

    def _encoded(self, messages: Iterable[tuple[str, Message]]) -> list[tuple[str, bytes]]:
        return [(link, self._codecs[link].encode(message)) for link, message in messages]

    # In

    def note_wall_clock(self, wall_s: float) -> None:
        """Takes the wall clock, in seconds since 1970, for the time stamps of signatures."""
        for signing in self._signing.values():
            signing.advance(wall_s)

    def receive(self, link: str, data: bytes, now_s: float, address: Address | None = None) -> None:
        """Takes any bytes from a link, split anywhere; never raises.

        address: sender of a datagram to a listening link; None on all other links.
        """
        self._now_s = now_s
        peers, before = self._peers[link], self.autopilot
        known = None if before is None else _address(before)
        codec = peers.codec(address)
        messages = codec.receive(data)
        forged = peers.is_forged(address, codec.sound_sources, known, now_s)
        for message in messages:
            if not forged or _source(message) != known:
                self._receive_message(link, message, now_s)
        autopilot = self.autopilot
        if autopilot is not None and link == autopilot.link and not forged:
            if _address(autopilot) != known:
                for other in self._peers.values():
                    other.forget_autopilot()
                peers.is_forged(address, codec.sound_sources, _address(autopilot), now_s)
            for source, message_id in codec.unwanted:
                if source == _address(autopilot):
                    self._rates.hear_unused(message_id, link, now_s)
        sources = {source for source in codec.sound_sources if not forged or source != known}
        peers.admit(address, sources, partial(self._may_be_peer, link), now_s)
        self._events += peers.events_received()
        self._packets.extend(
            (now_s, packet)
            for packet in codec.packets
            if not forged or packet_source(packet) != known
        )

    def _may_be_peer(self, link: str, system_id: int) -> bool:
        """Returns True if the link may send to this system: the vehicle's or one with permission.

        Before the autopilot is known, also the system whose heartbeat is requested.
        """
        vehicle_id, asked = self._system_id, self._unidentified
        if self.autopilot is None and asked is not None and asked[0] == link:
            vehicle_id = asked[1][0]
        allows = self._permissions.allows_system
        return system_id == vehicle_id or allows(system_id, vehicle_id=vehicle_id)

    def _receive_message(self, link: str, message: Message, now_s: float) -> None:
        if _source(message) == (self._system_id, self._component_id):
            return
        event = self._listener.hear(message, link=link, role=self._roles[link], now_s=now_s)
        if isinstance(event, AutopilotFound):
            self._system_id = event.autopilot.system_id
            for codec in self._codecs.values():
                codec.system_id = self._system_id
        if isinstance(event, (AutopilotFound, AutopilotRestarted)):
            self._start_conversation(event, now_s)
        elif event is not None:
            self._events.append(event)
        if (
            self.autopilot is None
            and self._roles[link] is LinkRole.AUTOPILOT
            and message.get_srcComponent() == mavlink.MAV_COMP_ID_AUTOPILOT1
        ):
            self._unidentified = (link, _source(message))
        message_id = message.get_msgId()
        if self._listener.is_autopilots(message, link):
            self._rates.hear(message_id)
        handler = self._handlers.get(message_id)
        if handler is not None:
            handler(link, message, now_s)

    def _start_conversation(self, event: AutopilotFound | AutopilotRestarted, now_s: float) -> None:
        """Starts the requests of streams and origin, with a heartbeat first."""
        kind = event.autopilot.kind
        self._events.append(event)
        rates_hz = self._message_rates_hz.get(kind, {})
        self._rates.start(
            rates_hz if _on_serial_port(event.autopilot) else on_network(rates_hz),
            silent=kind is AutopilotKind.ARDUPILOT,
            now_s=now_s,
        )
        self._places = OriginHomeRequests()
        self._round_trips = TimesyncRtt()
        self._parameters.restart()
        if self._fence is not None:
            self._fence.restart()
        self._outbox.hurry_heartbeat(now_s)

    def _receive_command(self, link: str, message: Message, now_s: float) -> None:
        reception = self._ledger.receive(
            message,
            link=link,
            system_id=self._system_id,
            component_id=self._component_id,
            now_s=now_s,
            signed=message.get_signed(),
        )
        if reception.event is not None:
            self._events.append(reception.event)
        self._acknowledge(reception.answer, link)

    def _receive_acknowledgement(self, link: str, message: Message, now_s: float) -> None:
        if not self._listener.is_autopilots(message, link):
            return
        target = (message.target_system, message.target_component)
        if target not in {(0, 0), (self._system_id, self._component_id)}:
            return
        if message.command == _SET_MESSAGE_INTERVAL:
            self._rates.answered(message.result)
        answered = self._modes.answered(message, now_s)
        if answered is not None:
            self._events.append(answered)

    def _receive_parameter(self, link: str, message: Message, _now_s: float) -> None:
        autopilot = self.autopilot
        if autopilot is not None and self._listener.is_autopilots(message, link):
            self._parameters.hear(message, autopilot.kind)

    def _receive_fence(self, link: str, message: Message, now_s: float) -> None:
        target = (message.target_system, message.target_component)
        ours = target == (self._system_id, self._component_id)
        autopilot, fence = self.autopilot, self._fence
        if autopilot is None or fence is None or not ours:
            return
        if self._listener.is_autopilots(message, link):
            end = fence.hear(message, _address(autopilot), now_s)
            if end is not None:
                self._outbox.send(link, end)

    def _receive_request(self, link: str, message: Message, now_s: float) -> None:
        autopilot = self.autopilot
        answer = ping_timesync.answer(
            message,
            ours=(self._system_id, self._component_id),
            autopilot=_address(autopilot) if autopilot else None,
            now_s=now_s,
        )
        is_autopilots = self._listener.is_autopilots(message, link)
        if answer is not None and (is_autopilots or self._may_ask(link, message, now_s)):
            self._outbox.send(link, answer)
        if is_autopilots:
            self._round_trips.hear(message, now_s)

    def _may_ask(self, link: str, message: Message, now_s: float) -> bool:
        """Returns True if a request's sender gets an answer: one that may be a peer, within a rate.

        An answer goes to all peers of a link and uses its bandwidth to the autopilot.
        """
        system_id, component_id = _source(message)
        sender = Sender(link=link, system_id=system_id, component_id=component_id)
        return self._may_be_peer(link, system_id) and self._answers.allows(sender, now_s)

    # Out

    def tick(self, now_s: float, system_status: SystemStatus, custom_mode: int = 0) -> None:
        """Queues all due messages: heartbeat, requests of streams, places, parameters, fence."""
        self._now_s = now_s
        self._outbox.send_heartbeat_if_due(now_s, system_status, custom_mode)
        self._listener.identity.forget_silent(now_s)
        autopilot = self.autopilot
        if autopilot is None:
            self._identify(now_s)
            return
        codec = self._peers[autopilot.link].autopilots_codec
        statistics = codec.statistics(*_address(autopilot))
        trips = self._round_trips
        self._listener.count_packets(statistics, trips.least_s(now_s), trips.shortest_s)
        if not self._listener.identity.alive(now_s):
            return
        question = self._round_trips.next_request(_address(autopilot), now_s)
        if question is not None:
            self._outbox.send(autopilot.link, question)
        rate = self._rates.next_request(now_s, autopilot.link, shared=self._is_shared(autopilot))
        if rate is not None:
            self._command(autopilot, _SET_MESSAGE_INTERVAL, *rate)
        place = self._places.next_request(self.telemetry, now_s)
        if place is not None:
            self._command(autopilot, _REQUEST_MESSAGE, place)
        if autopilot.kind is AutopilotKind.ARDUPILOT and self.telemetry.second_gnss is not None:
            self._parameters.want(GNSS_PARAMETERS)
        if self.telemetry.motors is not None:
            self._parameters.want(MOTOR_PARAMETERS.get(autopilot.kind, ()))
        for parameter in self._parameters.requests(now_s):
            request = translate_outgoing.parameter_request_message(
                target=_address(autopilot), name=parameter
            )
            self._outbox.send(autopilot.link, request)
        if self._fence is not None:
            asked = self._fence.next_request(_address(autopilot), now_s)
            if asked is not None:
                self._outbox.send(autopilot.link, asked)

    def _identify(self, now_s: float) -> None:
        """Requests the heartbeat of a received autopilot: the next may be 1 s away."""
        if self._unidentified is None or now_s < self._identify_s + _HEARTBEAT_PERIOD_S:
            return
        self._identify_s = now_s
        link, target = self._unidentified
        request = translate_outgoing.command_message(
            target=target, command=_REQUEST_MESSAGE, parameters=(_HEARTBEAT,)
        )
        self._outbox.send(link, request)

    def _is_shared(self, autopilot: Autopilot) -> bool:
        """Returns True if the autopilot's link ever carried another sender.

        A serial port has one reader, the companion: the autopilot forwards other senders there from
        links with their own streams.
        """
        if _on_serial_port(autopilot):
            return False
        known = {_address(autopilot), (self._system_id, self._component_id)}
        return any(source not in known for source in self._peers[autopilot.link].sources)

    def want_parameters(self, names: Iterable[str], *, changing: bool = False) -> None:
        """Adds parameters to request, and again after the autopilot's restart.

        changing: requests them periodically, for parameters that may change in flight.
        """
        self._parameters.want(names, changing=changing)

    def want_fence(self) -> None:
        """Starts the periodic download of the uploaded fence."""
        self._fence = self._fence or FenceDownload()

    def request_version(self) -> None:
        """Requests AUTOPILOT_VERSION once, if an autopilot is known."""
        if self.autopilot is not None:
            self._command(self.autopilot, _REQUEST_MESSAGE, _AUTOPILOT_VERSION)

    def send_setpoint(
        self, position_ned_m: Vector, velocity_ned_mps: Vector, yaw_rad: float, now_s: float
    ) -> bool:
        """Queues one setpoint to the autopilot; returns False if there is none to control.

        During a conflict a setpoint at rest is still sent, as the last setpoint to the controlled
        autopilot. It carries that autopilot's ids, so that others ignore it (measured). A second
        autopilot with the same ids comes to rest, too, if earlier setpoints have moved it.

        Raises ValueError if a value is not finite.
        """
        autopilot = self.autopilot
        message = translate_outgoing.setpoint_message(
            target=_address(autopilot) if autopilot else (0, 0),
            position_ned_m=position_ned_m,
            velocity_ned_mps=velocity_ned_mps,
            yaw_rad=yaw_rad,
            now_s=now_s,
        )
        if autopilot is None or (any(velocity_ned_mps) and not self.control_allowed):
            return False
        self._outbox.send(autopilot.link, message)
        return True

    def request_own_mode(self) -> bool:
        """Requests OFFBOARD or GUIDED once; returns False if there is no autopilot to control.

        Never repeated automatically: both autopilots accept it in a failsafe, and cancel that.
        """
        return self._request_mode(modes.own_mode_parameters)

    def request_land(self) -> bool:
        """Requests the autopilot's LAND mode once; returns False if there is none to control."""
        return self._request_mode(modes.land_parameters)

    def _request_mode(self, parameters_of: Callable[..., tuple[int, int, int] | None]) -> bool:
        autopilot = self.autopilot
        status = self.telemetry.autopilot
        if autopilot is None or not self.control_allowed:
            return False
        parameters = parameters_of(autopilot.kind, armed=status is not None and status.armed)
        if parameters is None:
            return False
        self._command(autopilot, DO_SET_MODE, *parameters)
        self._modes.note_request(self._now_s)
        return True

    def answer(
        self,
        command: Command,
        result: CommandResult,
        *,
        progress: int = 0,
        result_param2: int = 0,
    ) -> bool:
        """Acknowledges a received command on its link; returns False if no answer is due."""
        answer = self._ledger.answer(
            command, result, progress=progress, result_param2=result_param2, now_s=self._now_s
        )
        self._acknowledge(answer, command.sender.link)
        return answer is not None

    def send_named_value(self, name: str, value: float, now_s: float) -> None:
        """Queues NAMED_VALUE_FLOAT on all links, if the value is finite.

        Raises ValueError if the name is longer than 10 ASCII characters.
        """
        message = translate_outgoing.named_value_message(name, value, now_s)
        if message is not None:
            self._outbox.send_to_all(message)

    def send_text(
        self,
        severity: Severity,
        text: str,
        now_s: float,
        *,
        news: bool = False,
        link: str | None = None,
    ) -> None:
        """Queues a STATUSTEXT in chunks; the same text not within 10 s, unless it is news.

        link: the only link; None: all links.
        """
        for message in self._texts.messages(severity, text, now_s, news=news, link=link):
            if link is None:
                self._outbox.send_to_all(message)
            else:
                self._outbox.send(link, message)

    def _acknowledge(self, answer: Answer | None, link: str) -> None:
        if answer is not None:
            self._outbox.send(link, answer.message())

    def _command(self, autopilot: Autopilot, command: int, *parameters: float) -> None:
        """Queues a COMMAND_LONG to the autopilot; parameters not given are 0."""
        message = translate_outgoing.command_message(
            target=_address(autopilot), command=command, parameters=parameters
        )
        self._outbox.send(autopilot.link, message)


def _address(autopilot: Autopilot) -> tuple[int, int]:
    return autopilot.system_id, autopilot.component_id


def _on_serial_port(autopilot: Autopilot) -> bool:
    return autopilot.link.startswith("serial:")


def _source(message: Message) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()


def _controls(message: Message) -> bool:
    """Returns True if a message commands motion."""
    name: str = message.get_type()
    asks_for_mode = name == "COMMAND_LONG" and message.command == DO_SET_MODE
    return asks_for_mode or name == "SET_POSITION_TARGET_LOCAL_NED"

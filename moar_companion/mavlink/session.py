"""The companion's side of MAVLink over all its links: bytes and time in, bytes and events out.

A machine without I/O and without a clock. The service calls `receive` with bytes, and `tick` at the
rate of its control loop (10 Hz or more). It takes `events_received`, `commands.waiting` and
`telemetry`, and writes the bytes of `data_to_send`.

Only `tick` sends heartbeats, so that they stop when the control loop stalls.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from functools import partial

from ..settings.config import Commands
from ..settings.flight_parameters import FlightParameters
from ..settings.link_config import LinkRole
from ..types import AutopilotKind, Vector
from . import autopilot_requests, camera, gimbal, telemetry_receiver, translate_outgoing
from .autopilot_control import AutopilotControl, CommandAnswered, commands_motion
from .autopilot_requests import AutopilotRequests
from .codec import Codec, packet_source
from .commands import (
    Command,
    CommandAnswer,
    CommandCancelled,
    CommandResult,
    DeniedCommand,
    Sender,
    UnsupportedCommand,
)
from .component.component_service import Asker
from .component.parameter_server import ParameterRefused, ParameterSet
from .component.path_mission import MissionRefused
from .component.services import ComponentServices
from .dialect import Message, mavlink
from .identity import Autopilot, AutopilotConflict, AutopilotFound, AutopilotRestarted
from .outbox import Outbox
from .own_ids import ComponentConflict, OwnIds
from .peers import Address, AutopilotElsewhere, PeerRefused, Peers, Precedence
from .received_commands import ReceivedCommands, answer_to
from .signing import LinkSigning, SignedLinks
from .statustext import Severity, StatusTexts
from .telemetry import Telemetry
from .telemetry_receiver import ModeLeft, TelemetryReceiver
from .translate_outgoing import SystemStatus

__all__ = ["CommandAnswered", "Event", "Session", "Severity", "SystemStatus"]

_MAX_PACKETS = 4096
"""Limit of packets kept for a record until they are taken: ten seconds of PX4."""

_COMMAND_ACK = int(mavlink.MAVLINK_MSG_ID_COMMAND_ACK)
_COMMAND_CANCEL = 80
_COMMANDS = frozenset(
    {
        int(mavlink.MAVLINK_MSG_ID_COMMAND_LONG),
        int(mavlink.MAVLINK_MSG_ID_COMMAND_INT),
        _COMMAND_CANCEL,
    }
)
_WANTED = (
    telemetry_receiver.MESSAGE_IDS
    | autopilot_requests.MESSAGE_IDS
    | ComponentServices.MESSAGE_IDS
    | camera.MESSAGE_IDS
    | gimbal.MESSAGE_IDS
    | _COMMANDS
    | {_COMMAND_ACK}
)
"""Messages that are read; the others are only counted."""

_PAYLOAD_IDS = (
    camera.MESSAGE_IDS | gimbal.MESSAGE_IDS | {int(mavlink.MAVLINK_MSG_ID_HEARTBEAT), _COMMAND_ACK}
)
"""Messages that camera and gimbal read."""

Event = (
    UnsupportedCommand
    | DeniedCommand
    | CommandCancelled
    | AutopilotFound
    | AutopilotRestarted
    | AutopilotConflict
    | AutopilotElsewhere
    | ComponentConflict
    | CommandAnswered
    | MissionRefused
    | ModeLeft
    | ParameterRefused
    | ParameterSet
    | PeerRefused
)


class Session:
    """One companion on its links.

    links: name and role of each link. system_id, component_id: the companion's; once an autopilot
    is found the companion takes its system id. commands: rules for permitted senders.
    message_rates_hz: wanted rates by message id; None: those of the autopilot's kind. obstacles:
    requests the distances of obstacles from the autopilot, too; a sensor's are read in any case.
    signing: of the links on which all packets are signed. parameters: settings that ground stations
    may change; None: there are none.
    """

    def __init__(
        self,
        *,
        links: Mapping[str, LinkRole],
        system_id: int = 1,
        component_id: int = 195,
        commands: Commands | None = None,
        message_rates_hz: Mapping[int, float] | None = None,
        obstacles: bool = False,
        signing: Mapping[str, LinkSigning] | None = None,
        parameters: FlightParameters | None = None,
    ) -> None:
        self._roles = dict(links)
        self._component_id = component_id
        self.signing = SignedLinks(signing or {})
        """Time stamps and refused packets of the signed links."""
        make_codec = partial(Codec, system_id=system_id, component_id=component_id, wanted=_WANTED)
        makers = {name: partial(make_codec, signing=self.signing.of(name)) for name in links}
        self._codecs = {name: make() for name, make in makers.items()}
        """Encoder of each link; its peers have the decoders."""
        self._peers = {name: Peers(name, role, makers[name]) for name, role in links.items()}
        self._system_id = system_id
        self._receiver = TelemetryReceiver()
        self._outbox = Outbox(links, commands_motion)
        self._control = AutopilotControl(self._receiver, self._outbox)
        self.requests = AutopilotRequests(
            self._receiver,
            self._outbox,
            message_rates_hz,
            obstacles=obstacles,
            signed=signing or (),
        )
        """Requests of the autopilot: parameters, fence, message rates."""
        self.commands = ReceivedCommands(commands)
        """Commands to the companion, until their final answers."""
        self.services = ComponentServices(links, component_id, parameters, self._autopilot_kind)
        """Services for ground stations."""
        self.camera = camera.CameraClient()
        """The camera on the autopilot's system, once it is wanted."""
        self.gimbal = gimbal.GimbalClient()
        """The gimbal on the autopilot's system, once it is wanted."""
        self._texts = StatusTexts()
        self._own_ids = OwnIds()
        self._events: list[Event] = []
        self._packets: deque[tuple[float, bytes]] = deque(maxlen=_MAX_PACKETS)
        self._now_s = 0.0

    # State

    @property
    def telemetry(self) -> Telemetry:
        """Latest telemetry of the autopilot, its link, the radio and ground stations."""
        return self._receiver.telemetry

    @property
    def system_id(self) -> int:
        """System id of the companion: the configured one, then that of the found autopilot."""
        return self._system_id

    @property
    def ids(self) -> tuple[int, int]:
        """System and component id of the companion."""
        return self._system_id, self._component_id

    @property
    def autopilot(self) -> Autopilot | None:
        """Autopilot that was received first."""
        return self._receiver.autopilot

    def _autopilot_kind(self) -> AutopilotKind | None:
        return None if self.autopilot is None else self.autopilot.kind

    @property
    def parameters(self) -> FlightParameters | None:
        """Present values of the settings that ground stations may change; None: there are none."""
        server = self.services.parameters
        return None if server is None else server.parameters

    @property
    def conflict(self) -> str | None:
        """Text for a received second autopilot, under any ids; None without one."""
        return self._receiver.identity.conflict

    @property
    def mode_unanswered(self) -> bool:
        """True from a mode request until the autopilot answers it."""
        return self._control.unanswered

    def events_received(self) -> list[Event]:
        """Returns the events since the last call, in order."""
        events, self._events = self._events, []
        return events

    def received_packets(self) -> list[tuple[float, bytes]]:
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
        waiting = self._outbox.take(self._now_s)
        return self._encoded(item for item in waiting if control or not commands_motion(item[1]))

    def peers(self, link: str) -> tuple[Address, ...]:
        """Addresses to which a listening link sends; empty for other links."""
        return self._peers[link].addresses(self._now_s)

    def precedence(self, link: str, address: Address | None) -> Precedence:
        """Reading order of the bytes from an address under overload."""
        return self._peers[link].precedence(address)

    def control_to_send(self) -> list[tuple[str, bytes]]:
        """Returns the waiting packets that command motion: setpoints and mode requests."""
        return self._encoded(self._outbox.take_control())

    def _encoded(self, messages: Iterable[tuple[str, Message]]) -> list[tuple[str, bytes]]:
        packets = []
        for link, message in messages:
            packet = self._own_ids.encoded(message, self._codecs[link])
            self._outbox.sent(link, len(packet), self._now_s)
            packets.append((link, packet))
        return packets

    # In

    def receive(self, link: str, data: bytes, now_s: float, address: Address | None = None) -> None:
        """Takes any bytes from a link, split anywhere; never raises.

        address: sender of a datagram to a listening link; None on all other links.
        """
        # A packet that waited to be read arrived before the last cycle.
        self._now_s = max(self._now_s, now_s)
        peers, before = self._peers[link], self.autopilot
        known = None if before is None else before.ids
        codec = peers.codec(address)
        messages = codec.receive(data)
        forged = peers.is_forged(address, codec.sound_sources, known, now_s)
        for message in messages:
            if not forged or _source(message) != known:
                self._receive_message(link, message, now_s)
        autopilot = self.autopilot
        if autopilot is not None and link == autopilot.link and not forged:
            if autopilot.ids != known:
                for other in self._peers.values():
                    other.forget_autopilot()
                peers.is_forged(address, codec.sound_sources, autopilot.ids, now_s)
            for source, message_id in codec.unwanted:
                if source == autopilot.ids:
                    self.requests.count_unused(message_id, link, now_s)
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
        vehicle_id, asked = self._system_id, self.requests.unidentified
        if self.autopilot is None and asked is not None and asked[0] == link:
            vehicle_id = asked[1][0]
        return self.commands.permissions.may_request(system_id, vehicle_id=vehicle_id)

    def _receive_message(self, link: str, message: Message, now_s: float) -> None:
        if _source(message) == self.ids:
            self._events += self._own_ids.receive(message, now_s)
            return
        event = self._receiver.handle(message, link=link, role=self._roles[link], now_s=now_s)
        if isinstance(event, AutopilotFound):
            self._system_id = event.autopilot.system_id
            for codec in self._codecs.values():
                codec.system_id = self._system_id
        if event is not None:
            self._events.append(event)
        if isinstance(event, (AutopilotFound, AutopilotRestarted)):
            self.requests.start(event.autopilot, now_s)
        if (
            self.autopilot is None
            and self._roles[link] is LinkRole.AUTOPILOT
            and message.get_srcComponent() == mavlink.MAV_COMP_ID_AUTOPILOT1
        ):
            self.requests.unidentified = (link, _source(message))
        message_id, autopilot = message.get_msgId(), self.autopilot
        if autopilot is not None and self._receiver.is_autopilots(message, link):
            self.requests.handle(message, autopilot, self.ids, now_s)
            if message_id == _COMMAND_ACK:
                self._receive_acknowledgement(message, now_s)
        if (
            message_id in _PAYLOAD_IDS
            and autopilot is not None
            and self._roles[link] is LinkRole.AUTOPILOT
            and message.get_srcSystem() == autopilot.system_id
        ):
            self.camera.handle(message, link, self.ids, now_s)
            self.gimbal.handle(message, link, self.ids, now_s)
        if message_id in _COMMANDS:
            self._receive_command(link, message, now_s)
        elif message_id in ComponentServices.MESSAGE_IDS:
            self._receive_request(link, message, now_s)

    def _receive_command(self, link: str, message: Message, now_s: float) -> None:
        reception = self.commands.receive(
            message,
            link=link,
            system_id=self._system_id,
            component_id=self._component_id,
            now_s=now_s,
            signed=message.get_signed(),
        )
        if reception.accepted is not None and reception.accepted.permitted:
            self._receiver.note_order(reception.accepted.sender.system_id)
        if reception.event is not None:
            self._events.append(reception.event)
        answer, asked = reception.answer, reception.asked
        if asked is not None:
            result = self.services.carry_out(asked, now_s)
            answer = None if result is None else answer_to(asked, result)
        self._acknowledge(answer, link)

    def _receive_acknowledgement(self, message: Message, now_s: float) -> None:
        if (message.target_system, message.target_component) not in {(0, 0), self.ids}:
            return
        self.requests.answered(message)
        answered = self._control.answered(message, now_s)
        if answered is not None:
            self._events.append(answered)

    def _receive_request(self, link: str, message: Message, now_s: float) -> None:
        """Passes a request to the services, if its sender may be a peer.

        An answer is sent to all peers of a link and uses its bandwidth to the autopilot.
        """
        system_id, component_id = _source(message)
        is_autopilots = self._receiver.is_autopilots(message, link)
        if not is_autopilots and not self._may_be_peer(link, system_id):
            return
        sender = Sender(link=link, system_id=system_id, component_id=component_id)
        objection = self.commands.permissions.objection(
            sender, vehicle_id=self._system_id, signed=message.get_signed()
        )
        answer = self.services.receive(
            message,
            Asker(sender=sender, objection=objection, on_board=system_id == self._system_id),
            ours=self.ids,
            is_autopilots=is_autopilots,
            now_s=now_s,
        )
        if answer is not None:
            self._outbox.send(link, answer)

    # Out

    def tick(self, now_s: float, system_status: SystemStatus, custom_mode: int = 0) -> None:
        """Queues the heartbeat, requests that are due, and then answers of the services."""
        self._now_s = now_s
        self._outbox.send_heartbeat_if_due(now_s, system_status, custom_mode)
        self.services.published.offer("HEARTBEAT", partial(_heartbeat, system_status, custom_mode))
        self._receiver.identity.forget_silent(now_s)
        self._send_requests(now_s)
        for link, message in self.services.due(now_s, self._outbox.is_behind):
            self._outbox.send(link, message)
        self._events += self.services.events_received()

    def _send_requests(self, now_s: float) -> None:
        """Queues the requests to the autopilot that are due; counts its packets."""
        autopilot = self.autopilot
        if autopilot is None:
            self.requests.identify(now_s)
            return
        peers = self._peers[autopilot.link]
        statistics = peers.autopilots_codec.statistics(*autopilot.ids)
        self._receiver.count_packets(statistics, *self.requests.round_trips_s(now_s))
        if self._receiver.identity.is_present(now_s):
            others = bool(peers.sources - {autopilot.ids, self.ids})
            self.requests.send_due(autopilot, now_s, others=others)
        self.send_payload(now_s)

    def want_payload(self, now_s: float) -> None:
        """Starts the search for camera and gimbal, and requests what they report."""
        self.camera.want(now_s)
        self.gimbal.want(now_s)
        self.requests.want_messages(gimbal.RATES_HZ, now_s)

    def send_payload(self, now_s: float) -> None:
        """Queues what is due for camera and gimbal, which are not always the autopilot's."""
        autopilot = self.autopilot
        if autopilot is None:
            return
        known = (autopilot.link, autopilot.ids)
        for link, message in self.camera.due(known, now_s):
            self._outbox.send(link, message)
        for link, message in self.gimbal.due(known, self.ids, now_s):
            self._outbox.send(link, message)

    def send_setpoint(
        self, position_ned_m: Vector, velocity_ned_mps: Vector, yaw_rad: float, now_s: float
    ) -> bool:
        """Queues one setpoint to the autopilot; returns False if there is none to control.

        Raises ValueError if a value is not finite.
        """
        return self._control.send_setpoint(position_ned_m, velocity_ned_mps, yaw_rad, now_s)

    def request_own_mode(self, now_s: float) -> bool:
        """Requests OFFBOARD or GUIDED once; returns False if there is no autopilot to control."""
        return self._control.request_own_mode(now_s)

    def request_land(self, now_s: float) -> bool:
        """Requests the autopilot's LAND mode once; returns False if there is none to control."""
        return self._control.request_land(now_s)

    def answer(
        self,
        command: Command,
        result: CommandResult,
        now_s: float,
        *,
        progress: int = 0,
        result_param2: int = 0,
    ) -> bool:
        """Acknowledges a received command on its link; returns False if no answer is due."""
        answer = self.commands.answer(
            command, result, progress=progress, result_param2=result_param2, now_s=now_s
        )
        self._acknowledge(answer, command.sender.link)
        return answer is not None

    def send_text(
        self,
        severity: Severity,
        text: str,
        now_s: float,
        *,
        is_new: bool = False,
        link: str | None = None,
    ) -> None:
        """Queues a STATUSTEXT in chunks; the same text not within 10 s, unless it is new.

        link: the only link; None: all links.
        """
        for message in self._texts.messages(severity, text, now_s, is_new=is_new, link=link):
            if link is None:
                self._outbox.send_to_all(message)
            else:
                self._outbox.send(link, message)

    def _acknowledge(self, answer: CommandAnswer | None, link: str) -> None:
        if answer is not None:
            self._outbox.send(link, answer.message())


def _heartbeat(system_status: SystemStatus, custom_mode: int, _now_s: float) -> list[Message]:
    return [translate_outgoing.heartbeat_message(system_status, custom_mode)]


def _source(message: Message) -> tuple[int, int]:
    return message.get_srcSystem(), message.get_srcComponent()

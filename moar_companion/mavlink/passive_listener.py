"""Passive observer: packets of all senders on a link to telemetry and events. No I/O.

Unlike the session it sends nothing. It reads the packets of the autopilot and its radio, of
ground stations, and of the companion itself, which a recording contains, too.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..settings.link_config import LinkRole
from ..types import AutopilotKind
from . import telemetry_receiver, translate
from .codec import Codec
from .commands import (
    ORDERS,
    Command,
    CommandResult,
    DeniedCommand,
    MissionCommand,
    PauseContinue,
    interpret,
)
from .dialect import LINK_NODE_STATUS_ID, Message, mavlink
from .identity import AutopilotConflict, AutopilotFound, AutopilotRestarted
from .modes import is_multirotor
from .packet_count import SourceStatistics
from .statustext import ReceivedText, ReceivedTexts
from .telemetry import Telemetry
from .telemetry_receiver import ModeLeft, TelemetryReceiver
from .translate_radio import RADIO_IDS

GROUND_STATION = "ground_station"
"""The input that is not of the aircraft."""
_LINK = "recording"
_ORDERS = frozenset(command for command, _ in ORDERS.values())
_HEARTBEAT = int(mavlink.MAVLINK_MSG_ID_HEARTBEAT)
_STATUSTEXT = int(mavlink.MAVLINK_MSG_ID_STATUSTEXT)
_COMMAND_LONG = int(mavlink.MAVLINK_MSG_ID_COMMAND_LONG)
_COMMANDS = frozenset({_COMMAND_LONG, int(mavlink.MAVLINK_MSG_ID_COMMAND_INT)})
_COMMAND_ACK = int(mavlink.MAVLINK_MSG_ID_COMMAND_ACK)
_INPUTS: dict[str, tuple[int, ...]] = {
    "gps": (mavlink.MAVLINK_MSG_ID_GPS_RAW_INT, mavlink.MAVLINK_MSG_ID_GPS2_RAW),
    "estimator": (
        mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS,
        mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT,
        mavlink.MAVLINK_MSG_ID_ODOMETRY,
    ),
    "battery": (mavlink.MAVLINK_MSG_ID_BATTERY_STATUS, mavlink.MAVLINK_MSG_ID_SYS_STATUS),
    "wind": (mavlink.MAVLINK_MSG_ID_WIND_COV, mavlink.MAVLINK_MSG_ID_WIND),
    "attitude": (mavlink.MAVLINK_MSG_ID_ATTITUDE,),
    "local_position": (mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,),
    "global_position": (mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,),
    "home": (mavlink.MAVLINK_MSG_ID_HOME_POSITION,),
    "landed": (mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE,),
    "motors": (
        mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW,
        mavlink.MAVLINK_MSG_ID_ACTUATOR_OUTPUT_STATUS,
    ),
    "magnetometer": (mavlink.MAVLINK_MSG_ID_HIGHRES_IMU, mavlink.MAVLINK_MSG_ID_RAW_IMU),
    "link_node": (LINK_NODE_STATUS_ID,),
    "radio": tuple(RADIO_IDS),
    "remote_control": (mavlink.MAVLINK_MSG_ID_RC_CHANNELS,),
}
_INPUT_OF = {message_id: name for name, ids in _INPUTS.items() for message_id in ids}


@dataclass(frozen=True, slots=True, kw_only=True)
class Input:
    """Count of a source's messages. last_s: time of the last; None if none was received."""

    messages: int = 0
    last_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class TextReceived:
    """STATUSTEXT of the autopilot or, with `ours`, of the companion."""

    ours: bool
    text: ReceivedText


@dataclass(frozen=True, slots=True, kw_only=True)
class AnswerReceived:
    """COMMAND_ACK of the companion to an order."""

    command: int
    result: CommandResult


ListenerEvent = (
    AutopilotFound
    | AutopilotRestarted
    | AutopilotConflict
    | Command
    | TextReceived
    | AnswerReceived
)


class PassiveListener:
    """Observer of one link. component_id: the companion's."""

    def __init__(self, *, component_id: int = 195) -> None:
        self._component_id = component_id
        self._codec = Codec(
            system_id=1,
            component_id=component_id,
            wanted=telemetry_receiver.MESSAGE_IDS | _COMMANDS | {_STATUSTEXT, _COMMAND_ACK},
        )
        self._listener = TelemetryReceiver()
        self._texts = {False: ReceivedTexts(), True: ReceivedTexts()}
        self.inputs = {name: Input() for name in ("autopilot", GROUND_STATION, *_INPUTS)}
        """Count and last time of the messages of each telemetry source."""
        self.vehicle_type: str | None = None
        """Name of the MAV_TYPE of the autopilot's vehicle."""
        self.leans = True
        """True if the vehicle's lean shows wind; also for generic, home-built copters' type."""

    @property
    def telemetry(self) -> Telemetry:
        """Latest telemetry of all sources."""
        return self._listener.telemetry

    @property
    def autopilot(self) -> AutopilotKind | None:
        """Kind of the autopilot that was received first."""
        autopilot = self._listener.autopilot
        return None if autopilot is None else autopilot.kind

    @property
    def sources(self) -> dict[tuple[int, int], SourceStatistics]:
        """Packet counts by system and component id, in the order of their first packets."""
        return {source: self._codec.statistics(*source) for source in self._codec.sources}

    def handle(self, packet: bytes, now_s: float) -> list[ListenerEvent]:
        """Takes a packet of any content; returns its events. Never raises."""
        events: list[ListenerEvent] = []
        for message in self._codec.receive(packet):
            events += self._handle(message, now_s)
        return events

    def tick(self, now_s: float) -> None:
        """Updates the packet counts; drops a second autopilot that is silent."""
        self._listener.identity.forget_silent(now_s)
        autopilot = self._listener.autopilot
        if autopilot is not None:
            counted = self._codec.statistics(autopilot.system_id, autopilot.component_id)
            self._listener.count_packets(counted)

    def _handle(self, message: Message, now_s: float) -> list[ListenerEvent]:
        before = self._listener.telemetry
        event = self._listener.handle(message, link=_LINK, role=LinkRole.AUTOPILOT, now_s=now_s)
        # The mode is in the telemetry.
        events: list[ListenerEvent] = (
            [] if event is None or isinstance(event, ModeLeft) else [event]
        )
        message_id = message.get_msgId()
        if self._listener.telemetry is not before and message_id in _INPUT_OF:
            self._count(_INPUT_OF[message_id], now_s)
        if message_id == _HEARTBEAT:
            if translate.is_ground_station(message):
                self._count(GROUND_STATION, now_s)
            elif self._listener.is_autopilots(message, _LINK) and translate.autopilot_kind(message):
                self._count("autopilot", now_s)
                self.leans = message.type == mavlink.MAV_TYPE_GENERIC or is_multirotor(message.type)
                self.vehicle_type = type_in_words(message.type)
        elif message_id == _STATUSTEXT:
            events += self._handle_text(message)
        elif message_id in _COMMANDS:
            events += self._handle_order(message)
        elif message_id == _COMMAND_ACK and self._is_ours(message) and message.command in _ORDERS:
            events += _answer(message)
        return events

    def _count(self, name: str, now_s: float) -> None:
        self.inputs[name] = Input(messages=self.inputs[name].messages + 1, last_s=now_s)

    def _handle_text(self, message: Message) -> list[ListenerEvent]:
        ours = self._is_ours(message)
        if not ours and not self._listener.is_autopilots(message, _LINK):
            return []
        return [TextReceived(ours=ours, text=text) for text in self._texts[ours].handle(message)]

    def _handle_order(self, message: Message) -> list[ListenerEvent]:
        """Returns an order to the companion; no repeats with a confirmation above 0."""
        autopilot = self._listener.autopilot
        if autopilot is None or message.command not in _ORDERS or _is_repeat(message):
            return []
        order = interpret(
            message,
            link=_LINK,
            system_id=autopilot.system_id,
            component_id=self._component_id,
        )
        if isinstance(order, (MissionCommand, PauseContinue)):
            self._listener.note_order(message.get_srcSystem())
        return [order] if isinstance(order, (MissionCommand, PauseContinue, DeniedCommand)) else []

    def _is_ours(self, message: Message) -> bool:
        """Returns True for a message of the companion."""
        autopilot = self._listener.autopilot
        source = (message.get_srcSystem(), message.get_srcComponent())
        return autopilot is not None and source == (autopilot.system_id, self._component_id)


def _is_repeat(message: Message) -> bool:
    return message.get_msgId() == _COMMAND_LONG and bool(message.confirmation > 0)


def _answer(message: Message) -> list[ListenerEvent]:
    try:
        result = CommandResult(message.result)
    except ValueError:
        return []
    return [AnswerReceived(command=message.command, result=result)]


def type_in_words(vehicle_type: int) -> str:
    """Name of a MAV_TYPE for texts."""
    known = mavlink.enums["MAV_TYPE"].get(vehicle_type)
    if known is None:
        return f"type {vehicle_type}"
    return str(known.name).removeprefix("MAV_TYPE_").replace("_", " ").lower()

"""Messages to PX4, each passed to the part that answers it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import all as mavlink

from sitl.commands import read_command, source, timesync_answer
from sitl.fence_areas import FenceAreas, payload_fields
from sitl.links import AUTOPILOT_COMPONENT, SYSTEM
from sitl.parameter_server import ParameterServer
from sitl.px4 import texts
from sitl.px4.commander import Commander
from sitl.px4.commands import Commands
from sitl.px4.offboard import OffboardStream, Refused, read_local_ned
from sitl.sticks import Sticks
from sitl.wire import layout
from sitl.world import World

Send = Callable[[str, str, bytes], None]
"""Send a payload: link, message name, payload."""


@dataclass(slots=True, kw_only=True)
class Receivers:
    """Parts that handle the messages."""

    world: World
    boot_us: int
    commander: Commander
    commands: Commands
    stream: OffboardStream
    sticks: Sticks
    server: ParameterServer
    areas: FenceAreas
    text_sender: texts.TextSender
    send: Send


class Inbox:
    """The table of messages that PX4 handles; all others are ignored."""

    def __init__(self, receivers: Receivers) -> None:
        """Connect the handlers."""
        self._r = receivers
        self._handlers: dict[str, Callable[[str, Any], None]] = {
            "HEARTBEAT": self._heartbeat,
            "COMMAND_LONG": self._command,
            "COMMAND_INT": self._command,
            "SET_POSITION_TARGET_LOCAL_NED": self._position_setpoint,
            "MANUAL_CONTROL": self._manual_control,
            "PARAM_REQUEST_LIST": self._parameter,
            "PARAM_REQUEST_READ": self._parameter,
            "PARAM_SET": self._parameter,
            "MISSION_REQUEST_LIST": self._mission,
            "MISSION_REQUEST_INT": self._mission,
            "MISSION_COUNT": self._mission,
            "MISSION_ITEM_INT": self._mission,
            "MISSION_ACK": self._mission,
            "TIMESYNC": self._timesync,
            "PING": self._ping,
        }

    def take(self, link: str, message: Any) -> None:
        """Handle one message that arrived on a link."""
        handler = self._handlers.get(message.get_type())
        if handler is not None:
            handler(link, message)

    def _heartbeat(self, _: str, message: Any) -> None:
        if message.type == mavlink.MAV_TYPE_GCS:
            self._r.commander.ground_station.receive_heartbeat()
        elif message.type == mavlink.MAV_TYPE_ONBOARD_CONTROLLER:
            self._r.commander.companion.receive_heartbeat()

    def _command(self, link: str, message: Any) -> None:
        if message.target_system == SYSTEM and message.target_component in (
            0,
            AUTOPILOT_COMPONENT,
        ):
            self._r.commands.run(read_command(link, message))

    def _position_setpoint(self, _: str, message: Any) -> None:
        if not _for_autopilot(message):
            return
        try:
            setpoint = read_local_ned(message, self._r.world.quad.yaw)
        except Refused as refused:
            self._r.text_sender.send(texts.CRITICAL, str(refused))
            return
        self._r.stream.take(setpoint, self._r.world.now_us)

    def _manual_control(self, _: str, message: Any) -> None:
        if message.target in (0, SYSTEM):
            self._r.sticks.take(message, self._r.world.now_us)

    def _parameter(self, link: str, message: Any) -> None:
        if _for_autopilot(message):
            for payload in self._r.server.answer(link, message):
                self._r.send(link, "PARAM_VALUE", payload)

    def _mission(self, link: str, message: Any) -> None:
        answer = self._r.areas.answer(message) if _for_autopilot(message) else None
        if answer is not None:
            kind = layout(answer[0])
            fields = payload_fields(kind.fields, answer, message)
            self._r.send(link, answer[0], kind.payload(**fields))

    def _timesync(self, link: str, message: Any) -> None:
        if message.tc1 == 0:
            since_boot_us = self._r.world.now_us - self._r.boot_us
            self._r.send(link, "TIMESYNC", timesync_answer(message, since_boot_us))

    def _ping(self, link: str, message: Any) -> None:
        if message.target_system == 0 and message.target_component == 0:
            system, component = source(message)
            payload = layout("PING").payload(
                time_usec=message.time_usec,
                seq=message.seq,
                target_system=system,
                target_component=component,
            )
            self._r.send(link, "PING", payload)


def _for_autopilot(message: Any) -> bool:
    return message.target_system in (0, SYSTEM) and message.target_component in (
        0,
        AUTOPILOT_COMPONENT,
    )

"""Messages to ArduPilot, each passed to the part that answers it."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from sitl.ardupilot.commander import Commander
from sitl.ardupilot.commands import Commands
from sitl.ardupilot.fence import Fence
from sitl.ardupilot.flight import Flight
from sitl.ardupilot.guided import read_local_ned
from sitl.ardupilot.modes import Mode
from sitl.ardupilot.navigation import Navigation
from sitl.ardupilot.streams import Schedule
from sitl.commands import read_command, source, timesync_answer
from sitl.fence_areas import FenceAreas, payload_fields
from sitl.links import Router
from sitl.parameter_server import ParameterServer
from sitl.parameters import Parameters
from sitl.sticks import Sticks
from sitl.wire import layout
from sitl.world import World

_SIGNAL_KEPT_S: Final = 7.0
_UNKNOWN_SIGNAL: Final = 255
_SIGNAL_BY_RADIO_STATUS: Final = 5
_UNCHANGED_US: Final = 65535
"""Values of a channel in RC_CHANNELS_OVERRIDE."""


@dataclass(slots=True, kw_only=True)
class Receivers:
    """Parts that handle the messages."""

    world: World
    router: Router
    boot_us: int
    parameters: Parameters
    navigation: Navigation
    flight: Flight
    fence: Fence
    commander: Commander
    commands: Commands
    sticks: Sticks
    server: ParameterServer
    areas: FenceAreas
    schedules: dict[str, Schedule]


class Inbox:
    """The table of messages that ArduPilot handles; all others are ignored."""

    def __init__(self, receivers: Receivers) -> None:
        """Connect the handlers."""
        self._r = receivers
        self._signal: tuple[int, int] | None = None
        """The last RADIO_STATUS: rssi, and its time."""
        self._handlers: dict[str, Callable[[str, Any], None]] = {
            "HEARTBEAT": self._heartbeat,
            "COMMAND_LONG": self._command,
            "COMMAND_INT": self._command,
            "SET_MODE": self._set_mode,
            "SET_POSITION_TARGET_LOCAL_NED": self._position_setpoint,
            "REQUEST_DATA_STREAM": self._data_stream,
            "MANUAL_CONTROL": self._manual_control,
            "RC_CHANNELS_OVERRIDE": self._override_channels,
            "RADIO_STATUS": self._radio_status,
            "PARAM_REQUEST_LIST": self._parameter,
            "PARAM_REQUEST_READ": self._parameter,
            "PARAM_SET": self._parameter,
            "MISSION_REQUEST_LIST": self._mission,
            "MISSION_REQUEST_INT": self._mission,
            "MISSION_COUNT": self._mission,
            "MISSION_ITEM_INT": self._mission,
            "MISSION_ACK": self._mission,
            "TIMESYNC": self._timesync,
        }

    def take(self, link: str, message: Any) -> None:
        """Handle one message; `FloatingPointError` when it crashes the process."""
        handler = self._handlers.get(message.get_type())
        if handler is not None:
            handler(link, message)

    @property
    def rssi(self) -> int:
        """RC_CHANNELS.rssi: unknown, or with RSSI_TYPE 5 the radio's last report."""
        if self._r.parameters.value("RSSI_TYPE") != _SIGNAL_BY_RADIO_STATUS:
            return _UNKNOWN_SIGNAL
        if self._signal is None:
            return 0
        rssi, received_us = self._signal
        return rssi if self._r.world.now_us - received_us <= _SIGNAL_KEPT_S * 1e6 else 0

    def _from_ground_station(self, message: Any) -> bool:
        return source(message)[0] == self._r.parameters.value("SYSID_MYGCS")

    def _heartbeat(self, _: str, message: Any) -> None:
        if self._from_ground_station(message):
            self._r.commander.handle_ground_station()

    def _command(self, link: str, message: Any) -> None:
        self._r.commands.run(read_command(link, message))

    def _set_mode(self, _: str, message: Any) -> None:
        self._r.commander.request_mode(message.custom_mode)

    def _position_setpoint(self, _: str, message: Any) -> None:
        r = self._r
        if r.commander.mode is not Mode.GUIDED:
            return
        nav = r.navigation
        request = read_local_ned(message, (nav.x, nav.y, nav.z), r.world.quad.yaw)
        if request is None:
            return
        place = request.position_ned_m
        if place is None or not r.fence.forbids(*nav.from_home_m(place), nav.on_map(place)):
            r.flight.guided.take(request, r.world.now_us)

    def _data_stream(self, link: str, message: Any) -> None:
        rate_hz = message.req_message_rate if message.start_stop else 0
        self._r.schedules[link].set_stream(message.req_stream_id, rate_hz, self._r.world.now_us)

    def _manual_control(self, _: str, message: Any) -> None:
        if self._from_ground_station(message):
            self._r.sticks.take(message, self._r.world.now_us)

    def _override_channels(self, _: str, message: Any) -> None:
        """Take channel 5, the flight mode switch."""
        if not self._from_ground_station(message):
            return
        self._r.commander.handle_ground_station()
        if message.chan5_raw != _UNCHANGED_US:
            lasts_us = round(self._r.parameters.value("RC_OVERRIDE_TIME") * 1e6)
            self._r.sticks.override_switch(message.chan5_raw, self._r.world.now_us + lasts_us)

    def _radio_status(self, link: str, message: Any) -> None:
        self._r.schedules[link].handle_radio(message.txbuf)
        self._signal = (message.rssi, self._r.world.now_us)

    def _parameter(self, link: str, message: Any) -> None:
        """A set is announced on all links."""
        received_by = self._r.router.links if message.get_type() == "PARAM_SET" else (link,)
        for payload in self._r.server.answer(link, message):
            for name in received_by:
                self._send(name, "PARAM_VALUE", payload)

    def _mission(self, link: str, message: Any) -> None:
        answer = self._r.areas.answer(message)
        if answer is not None:
            kind = layout(answer[0])
            fields = payload_fields(kind.fields, answer, message)
            self._send(link, answer[0], kind.payload(**fields))

    def _timesync(self, link: str, message: Any) -> None:
        if message.tc1 == 0:
            since_boot_us = self._r.world.now_us - self._r.boot_us
            self._send(link, "TIMESYNC", timesync_answer(message, since_boot_us))

    def _send(self, link: str, name: str, payload: bytes) -> None:
        self._r.router.links[link].send(layout(name), payload)

"""An operator's ground station in raw MAVLink over UDP: a pilot's displays and actions."""

from __future__ import annotations

import math
import socket
import struct
import time
from collections.abc import Callable
from typing import Any, Final

from pymavlink.dialects.v20 import all as mavlink

from .manners import Manner

_SLOW_CLOCK = 1.015
"""The clock of the real PX4's simulator runs 1.0 to 1.3 % slow: 2 s in a flight of 160 s."""
_HEARTBEAT_S: Final = 1.0
_ANSWER_TIMEOUT_S: Final = 5.0
"""In real time: the duration of a plan does not depend on the simulator's speed."""
_RESENT_S: Final = 1.5
_MOST_SENT: Final = 4
"""Repeats as MAVLink's command protocol requires, where a link loses commands or answers."""
_REASON_S: Final = 1.0
"""Longest wait for the text after an answer of the companion, in real time."""
_COMPILING_S: Final = 600.0
_AGAIN_S: Final = 3.0
"""Longest compilation of the planner at the companion's first start, in real time too, and the
period of the orders meanwhile. The companion reports its reason at most every 2 s."""
_POLL_S: Final = 0.05
_COMPANION: Final = mavlink.MAV_COMP_ID_PATHPLANNER
_INTERVAL_US: Final = 250_000
_UNKNOWN_MV: Final = 65_535
_RESULTS: Final = {
    number: entry.name.removeprefix("MAV_RESULT_")
    for number, entry in mavlink.enums["MAV_RESULT"].items()
}

INSPECTION: Final = 1
EXIT: Final = 2
EVACUATION: Final = 3


class OperatorError(Exception):
    """An event that the operator expected did not happen; one line."""


class Operator:
    """A ground station (255/190) on a UDP port. Reads while it waits; has no other pauses.

    Its seconds are those of the simulator, `speed` of them in a real one. `meanwhile` is called
    while it waits.
    """

    def __init__(
        self, port: int, manner: Manner, *, speed: float, meanwhile: Callable[[], None]
    ) -> None:
        """Listen; OSError when the port is taken."""
        self._manner = manner
        self._speed = speed
        self._meanwhile = meanwhile
        self._boot_s: float | None = None
        self._first_s: tuple[float, float] | None = None
        """Our clock and the autopilot's when that was first received."""
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", port))
        self._socket.settimeout(_POLL_S / max(1.0, speed))
        self._peer: tuple[str, int] | None = None
        self._codec = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)
        self._codec.robust_parsing = True
        self._heartbeat_due_s = 0.0
        self._answers: dict[int, int] = {}
        self._parameters: dict[str, Any] = {}
        self.autopilot_received = False
        self.companion_received = False
        self.armed = False
        self.custom_mode = 0
        self._healthy = False
        # If the autopilot does not report it, the autopilot's own checks include it.
        self._position_known = mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT not in manner.requested
        self.landed_state = 0
        self.battery_percent: int | None = None
        self.battery_v: float | None = None
        self.altitude_m = 0.0
        self.heading_deg = 0.0
        self.texts: list[str] = []
        self.landing = False
        self.home_altitude_m: float | None = None

    def wait_for(self, what: str, condition: Callable[[], bool], timeout_s: float) -> None:
        """Read until a condition holds; OperatorError with its name after the time."""
        if not self.wait_until(condition, timeout_s):
            raise OperatorError(f"{what}: not within {timeout_s:g} s")

    def wait_until(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Read until a condition holds, or for a time; True if it held."""
        deadline_s = self._now_s() + timeout_s
        while not condition():
            if self._now_s() > deadline_s:
                return False
            self.read()
            self._meanwhile()
        return True

    @property
    def ready_to_arm(self) -> bool:
        """True when the autopilot would arm, and has a position."""
        return self._healthy and self._position_known

    @property
    def lag_s(self) -> float:
        """Delay of the autopilot's clock since it was first received; real seconds.

        Beyond that of a clock that is a little slow, as PX4's simulator's is.
        """
        if self._boot_s is None or self._first_s is None:
            return 0.0
        first_s, first_boot_s = self._first_s
        passed_s = (self._boot_s - first_boot_s) * _SLOW_CLOCK
        return (self._now_s() - first_s - passed_s) / self._speed

    def _now_s(self) -> float:
        return time.monotonic() * self._speed

    def read(self) -> None:
        """Take received data, after a short wait; send the heartbeat when it is due."""
        now_s = self._now_s()
        if self._peer is not None and now_s >= self._heartbeat_due_s:
            self._heartbeat_due_s = now_s + _HEARTBEAT_S
            self._send(mavlink.MAVLink_heartbeat_message(mavlink.MAV_TYPE_GCS, 8, 0, 0, 4, 3))
        try:
            data, peer = self._socket.recvfrom(65536)
        except TimeoutError:
            return
        self._peer = peer
        for message in self._codec.parse_buffer(data) or []:
            self._take(message)

    def command(self, name: str, number: int, *parameters: float, component: int = 1) -> None:
        """Send a command, again while it is not answered; OperatorError when it is not ACCEPTED."""
        padded = (*parameters, *[0.0] * (7 - len(parameters)))
        self._answers.pop(number, None)
        texts = len(self.texts)
        for confirmation in range(_MOST_SENT):
            self._send(
                mavlink.MAVLink_command_long_message(1, component, number, confirmation, *padded)
            )
            if self.wait_until(lambda: number in self._answers, _RESENT_S * max(1.0, self._speed)):
                break
        self.wait_for(
            f"an answer to {name}",
            lambda: (
                self._answers.get(number, mavlink.MAV_RESULT_IN_PROGRESS)
                != mavlink.MAV_RESULT_IN_PROGRESS
            ),
            _ANSWER_TIMEOUT_S * max(1.0, self._speed),
        )
        result = self._answers[number]
        if result != mavlink.MAV_RESULT_ACCEPTED:
            words = _RESULTS.get(result, str(result))
            reason = self._reason(words, texts) if component == _COMPANION else None
            raise OperatorError(f"{name}: {words}" + (f" ({reason})" if reason else ""))

    def _reason(self, result: str, since: int) -> str | None:
        """The companion's text about an answer, among those since a number of texts; it follows.

        None where none comes.
        """
        end = f", {result.rpartition('_')[2].lower()}"

        def reasons() -> list[str]:
            return [text for text in self.texts[since:] if text.endswith(end)]

        self.wait_until(lambda: bool(reasons()), _REASON_S * max(1.0, self._speed))
        return next(iter(reversed(reasons())), None)

    def set_parameter(self, name: str, value: float) -> None:
        """Set a parameter of the autopilot; OperatorError when there is none, or it is refused."""
        known = self._parameter(
            name, mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), -1)
        )
        whole = known.param_type not in {
            mavlink.MAV_PARAM_TYPE_REAL32,
            mavlink.MAV_PARAM_TYPE_REAL64,
        }
        sent = value
        if whole and self._manner.parameters_bytewise:
            (sent,) = struct.unpack("<f", struct.pack("<i", round(value)))
        echoed = self._parameter(
            name,
            mavlink.MAVLink_param_set_message(1, 1, name.encode(), sent, known.param_type),
        )
        (wanted,) = struct.unpack("<f", struct.pack("<f", sent))
        if struct.pack("<f", echoed.param_value) != struct.pack("<f", wanted):
            raise OperatorError(f"{name}: {value:g} was refused")

    def _parameter(self, name: str, question: Any) -> Any:
        """The autopilot's PARAM_VALUE in answer to a question."""
        self._parameters.pop(name, None)
        self._send(question)
        timeout_s = _ANSWER_TIMEOUT_S * max(1.0, self._speed)
        self.wait_for(f"parameter {name}", lambda: name in self._parameters, timeout_s)
        return self._parameters[name]

    def request_messages(self) -> None:
        """Request the messages that the autopilot does not send by itself."""
        for number in self._manner.requested:
            name = f"the request for message {number}"
            self.command(name, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, number, _INTERVAL_US)

    def take_off(self, height_m: float) -> None:
        """Arm and climb to a height above where the aircraft stands; a new flight begins."""
        self.landing = False
        self.texts.clear()
        if self._manner.takes_off_in_given_mode:
            self.give_mode()
            self.command("arm", mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)
            self.command("take-off", mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, height_m)
            return
        self.wait_for("a home position", lambda: self.home_altitude_m is not None, 10.0)
        altitude_m = (self.home_altitude_m or 0.0) + height_m
        nan = math.nan
        self.command("take-off", mavlink.MAV_CMD_NAV_TAKEOFF, nan, 0, 0, nan, nan, nan, altitude_m)
        self.command("arm", mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1)

    def turn(self, heading_deg: float) -> None:
        """Have an aircraft that hovers turn to a compass direction."""
        if self._manner.takes_off_in_given_mode:
            self.command("turn", mavlink.MAV_CMD_CONDITION_YAW, heading_deg % 360.0)
            return
        nan, yaw_rad = math.nan, math.radians(heading_deg)
        self.command("turn", mavlink.MAV_CMD_DO_REPOSITION, -1, 1, 0, yaw_rad, nan, nan, nan)

    def give_mode(self) -> None:
        """Give the mode in which the autopilot follows the companion, and wait until it is on."""
        name, given = self._manner.given_mode, self._manner.given_custom_mode
        self.command(name, mavlink.MAV_CMD_DO_SET_MODE, 1, *self._manner.given)
        self.wait_for(f"{name} mode", lambda: self.custom_mode == given, 3.0)

    def land(self) -> None:
        """Give the autopilot's LAND mode; the companion then releases control."""
        self.landing = True
        self.command("LAND", mavlink.MAV_CMD_DO_SET_MODE, 1, *self._manner.land)

    def order(self, name: str, mission: int, index: int = -1) -> None:
        """Order a mission of the companion; waits during IN_PROGRESS and its compilation.

        index: of the target or landing point, -1 for all or any.
        """
        deadline_s = self._now_s() + _COMPILING_S * self._speed
        while True:
            try:
                self.command(name, mavlink.MAV_CMD_USER_1, mission, index, component=_COMPANION)
            except OperatorError as error:
                if "compiling planner" not in str(error) or self._now_s() > deadline_s:
                    raise
                self.texts.clear()
                self.wait_until(lambda: False, _AGAIN_S * self._speed)
            else:
                return

    def wait_compiled(self) -> None:
        """Wait for the companion's planner, where the companion has reported its compilation."""
        if any("compiling planner" in text for text in self.texts):
            ready = "MOAR: the planner is ready"
            self.wait_for(ready, lambda: self.has_received(ready), _COMPILING_S * self._speed)

    def has_received(self, text: str) -> bool:
        """Return True if the companion has sent a text that begins so."""
        return any(known.startswith(text) for known in self.texts)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _send(self, message: Any) -> None:
        if self._peer is None:
            return
        data = message.pack(self._codec)
        self._codec.seq = (self._codec.seq + 1) % 256
        self._socket.sendto(data, self._peer)

    def _take(self, message: Any) -> None:
        companion = message.get_srcComponent() == _COMPANION
        match message.get_type():
            case "HEARTBEAT" if companion:
                self.companion_received = True
            case "HEARTBEAT" if message.get_srcComponent() == 1:
                self.autopilot_received = True
                self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
                self.custom_mode = message.custom_mode
            case "STATUSTEXT" if companion:
                self.texts.append(message.text)
            case "SYS_STATUS":
                prearm = mavlink.MAV_SYS_STATUS_PREARM_CHECK
                self._healthy = bool(message.onboard_control_sensors_health & prearm)
                if message.battery_remaining >= 0:
                    self.battery_percent = message.battery_remaining
                if message.voltage_battery not in {0, _UNKNOWN_MV}:
                    self.battery_v = message.voltage_battery / 1000.0
            case "EKF_STATUS_REPORT":
                self._position_known = bool(message.flags & mavlink.EKF_POS_HORIZ_ABS)
            case "EXTENDED_SYS_STATE":
                self.landed_state = message.landed_state
            case "GLOBAL_POSITION_INT":
                self._boot_s = message.time_boot_ms / 1000.0
                if self._first_s is None:
                    self._first_s = self._now_s(), self._boot_s
                self.altitude_m = message.relative_alt / 1000.0
                self.heading_deg = message.hdg / 100.0
                self.home_altitude_m = (message.alt - message.relative_alt) / 1000.0
            case "PARAM_VALUE" if message.get_srcComponent() == 1:
                self._parameters[message.param_id] = message
            case "COMMAND_ACK":
                self._answers[message.command] = message.result

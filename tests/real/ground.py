"""The operator as a ground station that stores texts, modes and the origin; and a joystick."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pymavlink.dialects.v20 import all as mavlink

from sitl.demonstration.manners import MANNERS
from sitl.demonstration.operator import Operator
from tests.liveness.tap import clock_s

COMPANION = 195
EVACUATION, RELEASE = 3, 4
_STICKS_S = 0.1
_REQUEST_MESSAGE, _USER_1, _PAUSE_CONTINUE = 512, 31010, 193
_CHANNEL_5_LOITER_US = 1555
"""The fourth position of ArduPilot's mode switch."""

TAKEOVER_MODE = {"px4": (4, 3), "ardupilot": (5, 0)}
"""HOLD; LOITER."""


@dataclass(frozen=True)
class Text:
    """A received text, assembled from its chunks."""

    time_s: float
    companion: bool
    text: str


@dataclass(frozen=True)
class Mode:
    """Content of an autopilot heartbeat that differs from the previous one."""

    time_s: float
    custom_mode: int
    system_status: int
    armed: bool


class GroundStation(Operator):
    """An operator with a joystick, which is sent while held. look: called while it waits."""

    def __init__(self, port, autopilot, *, speed, look):
        super().__init__(port, MANNERS[autopilot], speed=speed, meanwhile=self._wait)
        self._look = look
        self._autopilot = autopilot
        self._sticks = None
        self._sticks_due_s = 0.0
        self._chunks = {}
        self.received_texts = []
        self.modes = []
        self.origin = None

    def hold_sticks(self, *, pitch=0.0, roll=0.0):
        """Hold a joystick, the throttle in its middle."""
        self._sticks = (round(1000 * pitch), round(1000 * roll), 500, 0)

    def drop_sticks(self):
        self._sticks = None

    def fall_silent(self):
        """Stop sending heartbeats and sticks."""
        self._heartbeat_due_s = math.inf
        self.drop_sticks()

    def resume_sending(self):
        self._heartbeat_due_s = 0.0

    def flip_mode_switch(self):
        """Turn the remote control's mode switch to LOITER (ArduPilot)."""
        channels = [65535] * 4 + [_CHANNEL_5_LOITER_US] + [65535] * 13
        self._send(mavlink.MAVLink_rc_channels_override_message(1, 1, *channels))

    def ask_for_mode(self, mode):
        """Request a mode without waiting for an answer."""
        self._send(
            mavlink.MAVLink_command_long_message(1, 1, 176, 0, 1, *mode, *[0.0] * (6 - len(mode)))
        )

    def go_on(self):
        self.command("continue", _PAUSE_CONTINUE, 1, component=COMPANION)

    def order_target(self, mission, index):
        self.command("the order", _USER_1, mission, index, component=COMPANION)

    def reboot(self):
        self.command("reboot", 246, 1)

    def request_origin(self):
        """Request the origin of the local frame until it is received."""
        self.origin = None
        for _ in range(5):
            self._send(
                mavlink.MAVLink_command_long_message(
                    1, 1, _REQUEST_MESSAGE, 0, mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, *[0.0] * 6
                )
            )
            if self.wait_until(lambda: self.origin is not None, 1.0 * self._speed):
                return

    def reset_autopilot(self):
        """Discard the data of an autopilot that restarts."""
        self.autopilot_received = self._healthy = False
        self._position_known = self._autopilot != "ardupilot"
        self.landed_state = 0
        self.home_altitude_m = self.origin = None

    def _wait(self):
        self._look()
        self._move_sticks()

    def _move_sticks(self):
        now_s = self._now_s()
        if self._sticks is not None and now_s >= self._sticks_due_s:
            self._sticks_due_s = now_s + _STICKS_S
            pitch, roll, throttle, yaw = self._sticks
            self._send(mavlink.MAVLink_manual_control_message(1, pitch, roll, throttle, yaw, 0))

    def _take(self, message):
        super()._take(message)
        match message.get_type():
            case "STATUSTEXT":
                self._handle(message)
            case "HEARTBEAT" if message.get_srcComponent() == 1:
                armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
                content = (message.custom_mode, message.system_status, armed)
                last = self.modes[-1] if self.modes else None
                if last is None or content != (last.custom_mode, last.system_status, last.armed):
                    self.modes.append(Mode(clock_s(), *content))
            case "GPS_GLOBAL_ORIGIN":
                self.origin = (
                    message.latitude * 1e-7,
                    message.longitude * 1e-7,
                    message.altitude * 1e-3,
                )

    def _handle(self, message):
        """Assemble the chunks of a text; an incomplete text has the chunks that arrived."""
        companion = message.get_srcComponent() == COMPANION
        key = (companion, message.id)
        if message.id and message.chunk_seq and key in self._chunks:
            number = self._chunks[key]
            before = self.received_texts[number]
            self.received_texts[number] = Text(before.time_s, companion, before.text + message.text)
            return
        self._chunks[key] = len(self.received_texts)
        self.received_texts.append(Text(clock_s(), companion, message.text))

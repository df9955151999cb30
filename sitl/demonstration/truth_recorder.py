"""The true state of a real autopilot's simulator: recorded, and passed to a reader.

It is written in the form of the fake autopilot's truth log.
"""

from __future__ import annotations

import math
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import all as mavlink

_LAST_HEARTBEAT_S: Final = 3.0
"""Longest wait for a heartbeat without arming, after the flight; one comes each second."""
TRUTH_HZ: Final = 50
_STATE_INTERVAL_US: Final = 200_000
_ASK_AGAIN_S: Final = 2.0
_POLL_S: Final = 0.2
_ON_GROUND: Final = int(mavlink.MAV_LANDED_STATE_ON_GROUND)


@dataclass(frozen=True, slots=True, kw_only=True)
class TruePose:
    """True pose and velocity of the aircraft. attitude_rad: roll, pitch, yaw."""

    time_s: float
    latitude_deg: float
    longitude_deg: float
    altitude_amsl_m: float
    attitude_rad: tuple[float, float, float]
    velocity_ned_mps: tuple[float, float, float]


Look = Callable[[TruePose], None]


def true_pose(message: Any, time_s: float) -> TruePose:
    """The pose of a HIL_STATE_QUATERNION (PX4) or SIM_STATE (ArduPilot)."""
    if message.get_type() == "SIM_STATE":
        latitude_e7, longitude_e7, altitude_m = message.lat_int, message.lon_int, message.alt
        attitude_rad = (message.roll, message.pitch, message.yaw)
        velocity_ned_mps = (message.vn, message.ve, message.vd)
    else:
        latitude_e7, longitude_e7, altitude_m = message.lat, message.lon, message.alt * 1e-3
        velocity_ned_mps = (message.vx * 1e-2, message.vy * 1e-2, message.vz * 1e-2)
        w, x, y, z = message.attitude_quaternion
        attitude_rad = (
            math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y)),
            math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x)))),
            math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)),
        )
    return TruePose(
        time_s=time_s,
        latitude_deg=latitude_e7 * 1e-7,
        longitude_deg=longitude_e7 * 1e-7,
        altitude_amsl_m=altitude_m,
        attitude_rad=attitude_rad,
        velocity_ned_mps=velocity_ned_mps,
    )


class TruthRecorder:
    """Writes each true state that the simulator sends, and calls `look` with it in its own thread.

    Times are of a clock that runs `speed` times as fast as real time.
    """

    def __init__(
        self, port: int, path: Path, *, speed: float, ask: bool, look: Look | None = None
    ) -> None:
        """Listen; ask: the autopilot sends only requested messages."""
        self._speed, self._ask, self._look = speed, ask, look
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", port))
        self._socket.settimeout(_POLL_S)
        self._codec = mavlink.MAVLink(None, srcSystem=254, srcComponent=1)
        self._codec.robust_parsing = True
        self._armed, self._on_ground = False, True
        self._asked_s = self._received_s = 0.0
        self._start_s = time.monotonic()
        self._file = path.open("w", encoding="utf-8", buffering=1)
        self._file.write("time_s,latitude_deg,longitude_deg,altitude_amsl_m,armed,on_ground\n")
        self._ending = threading.Event()
        self._end_s = 0.0
        self._thread = threading.Thread(target=self._record, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop listening, once the aircraft is disarmed: its next heartbeat says so."""
        self._end_s = time.monotonic() + _LAST_HEARTBEAT_S
        self._ending.set()
        self._thread.join()
        self._socket.close()
        self._file.close()

    def _record(self) -> None:
        while not self._ending.is_set() or (self._armed and time.monotonic() < self._end_s):
            try:
                data, peer = self._socket.recvfrom(65536)
            except (TimeoutError, ConnectionError):
                continue
            for message in self._codec.parse_buffer(data) or []:
                self._take(message)
            now_s = time.monotonic()
            if self._ask and now_s - max(self._asked_s, self._received_s) > _ASK_AGAIN_S:
                self._asked_s = now_s
                self._request(peer)

    def _request(self, peer: tuple[str, int]) -> None:
        for number, interval_us in (
            (mavlink.MAVLINK_MSG_ID_SIM_STATE, 1e6 / TRUTH_HZ),
            (mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, _STATE_INTERVAL_US),
        ):
            command = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
            message = mavlink.MAVLink_command_long_message(
                1, 1, command, 0, number, interval_us, *[0.0] * 5
            )
            self._socket.sendto(message.pack(self._codec), peer)

    def _take(self, message: Any) -> None:
        match message.get_type():
            case "HEARTBEAT" if message.get_srcComponent() == 1:
                self._armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            case "EXTENDED_SYS_STATE":
                self._on_ground = message.landed_state == _ON_GROUND
            case "HIL_STATE_QUATERNION" | "SIM_STATE":
                self._received_s = time.monotonic()
                pose = true_pose(message, (self._received_s - self._start_s) * self._speed)
                self._write(pose)
                if self._look is not None:
                    self._look(pose)

    def _write(self, pose: TruePose) -> None:
        self._file.write(
            f"{pose.time_s:.3f},{pose.latitude_deg:.7f},"
            f"{pose.longitude_deg:.7f},{pose.altitude_amsl_m:.4f},"
            f"{int(self._armed)},{int(self._on_ground)}\n"
        )

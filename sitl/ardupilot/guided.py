"""GUIDED's target: SET_POSITION_TARGET_LOCAL_NED as ArduPilot takes it.

Inputs: messages with their arrival time. Outputs: the target. Measured on ArduCopter 4.6.3: an
ignored bit of one axis ignores all three. Combinations and frames that it cannot fly stop the
vehicle. A NaN position crashes the process. No setpoint is acknowledged.
"""

import math
from dataclasses import dataclass, replace
from typing import Any, Final

from sitl.ardupilot.state import GuidedTarget

Vector = tuple[float, float, float]
_LOCAL, _LOCAL_OFFSET, _BODY, _BODY_OFFSET = 1, 7, 8, 9
_POSITION_BITS, _VELOCITY_BITS, _ACCELERATION_BITS = 0x007, 0x038, 0x1C0
_FORCE_BIT, _YAW_BIT, _YAW_RATE_BIT = 0x200, 0x400, 0x800


@dataclass(frozen=True, slots=True, kw_only=True)
class Request:
    """Request of a message; None where it has none. Metres from the EKF origin, radians."""

    position_ned_m: Vector | None = None
    velocity_ned_mps: Vector | None = None
    yaw_rad: float | None = None
    yaw_rate_radps: float | None = None


STOP: Final = Request(velocity_ned_mps=(0.0, 0.0, 0.0))


def read_local_ned(message: Any, position_ned_m: Vector, yaw_rad: float) -> Request | None:
    """Translate a SET_POSITION_TARGET_LOCAL_NED; None when it is ignored.

    `position_ned_m` and `yaw_rad` are the vehicle's, about which relative frames turn. Raises
    `FloatingPointError` for a position that is no number, as the autopilot's process does.
    """
    mask: int = message.type_mask
    position_used = not mask & _POSITION_BITS
    velocity_used = not mask & _VELOCITY_BITS
    acceleration_used = not mask & _ACCELERATION_BITS
    if mask & _FORCE_BIT and acceleration_used:
        return None
    frame = message.coordinate_frame
    if frame not in (_LOCAL, _LOCAL_OFFSET, _BODY, _BODY_OFFSET):
        return STOP
    turn_rad = yaw_rad if frame in (_BODY, _BODY_OFFSET) else 0.0
    position = velocity = None
    if position_used:
        position = _turned((message.x, message.y, message.z), turn_rad)
        if not all(map(math.isfinite, position)):
            raise FloatingPointError("position is not a number")
        if frame != _LOCAL:
            north, east, down = position
            here_n, here_e, here_d = position_ned_m
            position = (here_n + north, here_e + east, here_d + down)
    if velocity_used:
        velocity = _turned((message.vx, message.vy, message.vz), turn_rad)
        if not all(map(math.isfinite, velocity)):
            return STOP
    if not (velocity_used or (position_used and not acceleration_used)):
        return STOP
    return Request(
        position_ned_m=position,
        velocity_ned_mps=velocity,
        yaw_rad=None if mask & _YAW_BIT else message.yaw + turn_rad,
        yaw_rate_radps=None if mask & _YAW_RATE_BIT else message.yaw_rate,
    )


def _turned(vector: Vector, yaw_rad: float) -> Vector:
    x, y, z = vector
    cos_y, sin_y = math.cos(yaw_rad), math.sin(yaw_rad)
    return x * cos_y - y * sin_y, x * sin_y + y * cos_y, z


class Guided:
    """The request in use, and the take-off that a request replaces."""

    def __init__(self) -> None:
        """Stop."""
        self.request = STOP
        self.takeoff_z_m: float | None = None
        self._last_us = 0

    def stop(self) -> None:
        """Clear the request and stop: on entering the mode."""
        self.request = STOP
        self.takeoff_z_m = None

    def take(self, request: Request, now_us: int) -> None:
        """Use a request; it ends a take-off under way without a text."""
        self.request = request
        self.takeoff_z_m = None
        self._last_us = now_us

    def step(self, dt: float, now_us: int, timeout_s: float) -> None:
        """Move the target along at its velocity, until no request has come for GUID_TIMEOUT."""
        request = self.request
        if request.velocity_ned_mps is None:
            return
        if now_us - self._last_us > timeout_s * 1e6:
            self.request = replace(request, velocity_ned_mps=(0.0, 0.0, 0.0), yaw_rate_radps=None)
        elif request.position_ned_m is not None:
            (x, y, z), (vx, vy, vz) = request.position_ned_m, request.velocity_ned_mps
            self.request = replace(request, position_ned_m=(x + vx * dt, y + vy * dt, z + vz * dt))

    def target(self, place: Vector) -> GuidedTarget:
        """Return the target for POSITION_TARGET_LOCAL_NED."""
        if self.takeoff_z_m is not None:
            return GuidedTarget(
                position_ned_m=(place[0], place[1], self.takeoff_z_m),
                velocity_ned_mps=None,
                yaw_rad=None,
            )
        request = self.request
        return GuidedTarget(
            position_ned_m=request.position_ned_m,
            velocity_ned_mps=request.velocity_ned_mps,
            yaw_rad=request.yaw_rad,
        )

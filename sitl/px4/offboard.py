"""The offboard setpoint stream: SET_POSITION_TARGET_LOCAL_NED as PX4 v1.17 takes it.

Inputs: messages with their arrival time. Outputs: the current setpoint, the state of the stream,
or the text with which a message is refused. Measured on PX4 v1.17.0: frames 1 (all kinds) and 8
(velocity or acceleration only) work; 7, 9, 12, 20 are refused, as are masks without any setpoint
and the force bit; NaN in one position axis discards the whole position without a text.
"""

import math
from dataclasses import dataclass
from typing import Any, Final

FRAME_LOCAL_NED: Final = 1
FRAME_BODY_NED: Final = 8
_POSITION_BITS, _VELOCITY_BITS, _ACCELERATION_BITS = 0x007, 0x038, 0x1C0
_FORCE_BIT, _YAW_BIT, _YAW_RATE_BIT = 0x200, 0x400, 0x800
NAN: Final = math.nan
Vector = tuple[float, float, float]
_NONE: Final[Vector] = (NAN, NAN, NAN)


@dataclass(frozen=True, slots=True, kw_only=True)
class Setpoint:
    """Setpoint to fly; NaN in an axis means none for it. Local NED metres, radians."""

    position_ned_m: Vector = _NONE
    velocity_ned_mps: Vector = _NONE
    acceleration_ned_mps2: Vector = _NONE
    yaw_rad: float = NAN
    yaw_rate_radps: float = NAN

    @property
    def wants(self) -> bool:
        """True if it demands more than a heading."""
        return any(
            math.isfinite(value)
            for vector in (
                self.position_ned_m,
                self.velocity_ned_mps,
                self.acceleration_ned_mps2,
            )
            for value in vector
        )


class Refused(Exception):  # noqa: N818 - it is an answer, not an error of ours
    """The message cannot be used; the text is PX4's."""


def read_local_ned(message: Any, yaw_rad: float) -> Setpoint:
    """Translate a SET_POSITION_TARGET_LOCAL_NED, or raise `Refused`.

    `yaw_rad` is the vehicle's heading, by which a body frame is turned.
    """
    mask: int = message.type_mask
    position = _axes((message.x, message.y, message.z), mask & _POSITION_BITS)
    velocity = _axes((message.vx, message.vy, message.vz), (mask & _VELOCITY_BITS) >> 3)
    acceleration = _axes((message.afx, message.afy, message.afz), (mask & _ACCELERATION_BITS) >> 6)
    if message.coordinate_frame == FRAME_BODY_NED:
        position = _NONE
        velocity = _turned(velocity, yaw_rad)
        acceleration = _turned(acceleration, yaw_rad)
    elif message.coordinate_frame != FRAME_LOCAL_NED:
        raise Refused(
            f"SET_POSITION_TARGET_LOCAL_NED coordinate frame {message.coordinate_frame} unsupported"
        )
    if mask & _FORCE_BIT:
        raise Refused("SET_POSITION_TARGET_LOCAL_NED force not supported")
    if math.isfinite(position[0]) != math.isfinite(position[1]):
        position = _NONE
    setpoint = Setpoint(
        position_ned_m=position,
        velocity_ned_mps=velocity,
        acceleration_ned_mps2=acceleration,
        yaw_rad=NAN if mask & _YAW_BIT else message.yaw,
        yaw_rate_radps=NAN if mask & _YAW_RATE_BIT else message.yaw_rate,
    )
    if not setpoint.wants:
        raise Refused("SET_POSITION_TARGET_LOCAL_NED invalid")
    return setpoint


def _axes(values: Vector, ignored: int) -> Vector:
    x, y, z = (NAN if ignored >> i & 1 else value for i, value in enumerate(values))
    return x, y, z


def _turned(vector: Vector, yaw_rad: float) -> Vector:
    x, y, z = vector
    cos_y, sin_y = math.cos(yaw_rad), math.sin(yaw_rad)
    return x * cos_y - y * sin_y, x * sin_y + y * cos_y, z


class OffboardStream:
    """The last setpoint and its time."""

    def __init__(self) -> None:
        """Start without a setpoint."""
        self.setpoint: Setpoint | None = None
        self.last_us: int | None = None

    def take(self, setpoint: Setpoint, now_us: int) -> None:
        """Note a good setpoint."""
        self.setpoint = setpoint
        self.last_us = now_us

    def alive(self, now_us: int, timeout_s: float) -> bool:
        """Return True if a setpoint arrived within the time-out (COM_OF_LOSS_T)."""
        return self.last_us is not None and now_us - self.last_us <= timeout_s * 1e6

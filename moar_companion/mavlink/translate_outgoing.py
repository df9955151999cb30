"""MAVLink messages that the companion sends. Pure; the opposite direction is `translate`.

Sources: the message definitions, and measurements of PX4 v1.17/v1.18 and ArduCopter 4.6.3.
"""

from __future__ import annotations

import enum

from ..types import Vector
from .dialect import Message, create, mavlink

POSITION_VELOCITY_YAW = 0x9C0
"""POSITION_TARGET_TYPEMASK: accelerations and yaw rate ignored; both autopilots apply it."""

_MAX_FLOAT = 3.4028234663852886e38
_NAME_LENGTH = 10


class SystemStatus(enum.IntEnum):
    """MAV_STATE of the companion's heartbeat."""

    BOOT = 1
    STANDBY = 3
    ACTIVE = 4
    CRITICAL = 5


def heartbeat_message(system_status: SystemStatus, custom_mode: int) -> Message:
    """HEARTBEAT of an onboard controller; each component defines its own custom_mode."""
    return create(
        "HEARTBEAT",
        type=mavlink.MAV_TYPE_ONBOARD_CONTROLLER,
        autopilot=mavlink.MAV_AUTOPILOT_INVALID,
        base_mode=0,
        custom_mode=custom_mode,
        system_status=int(system_status),
        mavlink_version=3,
    )


def setpoint_message(
    *,
    target: tuple[int, int],
    position_ned_m: Vector,
    velocity_ned_mps: Vector,
    yaw_rad: float,
    now_s: float,
) -> Message:
    """SET_POSITION_TARGET_LOCAL_NED: position, feed-forward velocity, yaw; MAV_FRAME_LOCAL_NED.

    target: system and component id. Raises ValueError if a value is not finite: a NaN position
    crashes ArduPilot's process, and PX4 drops it silently.
    """
    values = (*position_ned_m, *velocity_ned_mps, yaw_rad)
    if not all(is_sendable(value) for value in values):
        raise ValueError(f"a setpoint must be finite: {values}")
    return mavlink.MAVLink_set_position_target_local_ned_message(
        milliseconds(now_s),
        *target,
        mavlink.MAV_FRAME_LOCAL_NED,
        POSITION_VELOCITY_YAW,
        *position_ned_m,
        *velocity_ned_mps,
        0.0,
        0.0,
        0.0,
        yaw_rad,
        0.0,
    )


def command_message(
    *, target: tuple[int, int], command: int, parameters: tuple[float, ...]
) -> Message:
    """COMMAND_LONG to a system and component id; missing parameters are 0."""
    padded = (*parameters, *[0.0] * (7 - len(parameters)))
    return create(
        "COMMAND_LONG",
        target_system=target[0],
        target_component=target[1],
        command=command,
        confirmation=0,
        **{f"param{number}": value for number, value in enumerate(padded, start=1)},
    )


def parameter_request_message(*, target: tuple[int, int], name: str) -> Message:
    """PARAM_REQUEST_READ of one parameter by its name."""
    return create(
        "PARAM_REQUEST_READ",
        target_system=target[0],
        target_component=target[1],
        param_id=name.encode("ascii"),
        param_index=-1,
    )


def named_value_message(name: str, value: float, now_s: float, *, whole: bool = False) -> Message:
    """NAMED_VALUE_FLOAT, or NAMED_VALUE_INT of a whole number.

    Raises ValueError unless the name has 1 to 10 ASCII characters.
    """
    if not (name.isascii() and 0 < len(name) <= _NAME_LENGTH):
        raise ValueError(f"{name!r} is not a name of 1 to {_NAME_LENGTH} ASCII characters")
    return create(
        "NAMED_VALUE_INT" if whole else "NAMED_VALUE_FLOAT",
        time_boot_ms=milliseconds(now_s),
        name=name.encode("ascii"),
        value=int(value) if whole else value,
    )


def is_sendable(value: float) -> bool:
    """Returns True if a value is finite as MAVLink's float (single precision)."""
    return abs(value) <= _MAX_FLOAT


def milliseconds(now_s: float) -> int:
    """Companion's clock as MAVLink's time_boot_ms, which wraps after 49 days."""
    return int(now_s * 1000.0) & 0xFFFFFFFF

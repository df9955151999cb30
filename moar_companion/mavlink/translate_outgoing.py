"""MAVLink messages that the companion sends. Pure; the opposite direction is `translate`.

Sources: the message definitions, and measurements of PX4 v1.17/v1.18 and ArduCopter 4.6.3.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Sequence

from ..types import Vector
from .dialect import Message, create, mavlink

POSITION_VELOCITY_YAW = 0x9C0
"""POSITION_TARGET_TYPEMASK: accelerations and yaw rate ignored; both autopilots apply it."""

_MAX_FLOAT = 3.4028234663852886e38
_NAME_LENGTH = 10
_TRAJECTORY_POINTS = 5
_UNUSED_8, _UNUSED_16, _UNUSED_32 = 0xFF, 0xFFFF, 0xFFFFFFFF
_UNUSED_SIGNED_8, _UNUSED_SIGNED_16 = 0x7F, 0x7FFF
"""Values of fields that are not known: the greatest of their types."""
_MIB = 2**20


class SystemStatus(enum.IntEnum):
    """MAV_STATE of the companion's heartbeat."""

    BOOT = 1
    STANDBY = 3
    ACTIVE = 4
    CRITICAL = 5
    EMERGENCY = 6


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
    *,
    target: tuple[int, int],
    command: int,
    parameters: tuple[float, ...],
    confirmation: int = 0,
) -> Message:
    """COMMAND_LONG to a system and component id; missing parameters are 0.

    confirmation: number of the same packets before this one.
    """
    padded = (*parameters, *[0.0] * (7 - len(parameters)))
    return create(
        "COMMAND_LONG",
        target_system=target[0],
        target_component=target[1],
        command=command,
        confirmation=confirmation,
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


def trajectory_messages(points_ned_m: Sequence[Vector], now_s: float) -> list[Message]:
    """TRAJECTORY_REPRESENTATION_WAYPOINTS: the first five points, in local NED; none without one.

    Speeds, accelerations and headings are NaN: unknown. command: no MAV_CMD.
    """
    if not points_ned_m:
        return []
    first_ned_m = points_ned_m[:_TRAJECTORY_POINTS]
    unused = _TRAJECTORY_POINTS - len(first_ned_m)
    axes = [[*axis, *[math.nan] * unused] for axis in zip(*first_ned_m, strict=True)]
    unknown = [math.nan] * _TRAJECTORY_POINTS
    return [
        create(
            "TRAJECTORY_REPRESENTATION_WAYPOINTS",
            time_usec=int(now_s * 1e6),
            valid_points=len(first_ned_m),
            **dict(zip(("pos_x", "pos_y", "pos_z"), axes, strict=True)),
            **dict.fromkeys(("vel_x", "vel_y", "vel_z", "acc_x", "acc_y", "acc_z"), unknown),
            **dict.fromkeys(("pos_yaw", "vel_yaw"), unknown),
            command=[_UNUSED_16] * _TRAJECTORY_POINTS,
        )
    ]


def computer_status_messages(
    now_s: float,
    *,
    memory_bytes: tuple[float, float] | None,
    disk_bytes: tuple[float, float] | None,
) -> list[Message]:
    """ONBOARD_COMPUTER_STATUS; none where nothing is known. What is not known is marked so.

    memory_bytes, disk_bytes: those in use, and all; None where unknown.
    """
    if memory_bytes is None and disk_bytes is None:
        return []
    ram_mib, disk_mib = (
        [_UNUSED_32] * 2 if pair is None else [min(int(part / _MIB), _UNUSED_32) for part in pair]
        for pair in (memory_bytes, disk_bytes)
    )
    return [
        create(
            "ONBOARD_COMPUTER_STATUS",
            time_usec=int(now_s * 1e6),
            uptime=milliseconds(now_s),
            type=0,
            cpu_cores=[_UNUSED_8] * 8,
            cpu_combined=[_UNUSED_8] * 10,
            gpu_cores=[_UNUSED_8] * 4,
            gpu_combined=[_UNUSED_8] * 10,
            temperature_board=_UNUSED_SIGNED_8,
            temperature_core=[_UNUSED_SIGNED_8] * 8,
            fan_speed=[_UNUSED_SIGNED_16] * 4,
            ram_usage=ram_mib[0],
            ram_total=ram_mib[1],
            storage_type=[_UNUSED_32] * 4,
            storage_usage=[disk_mib[0], *[_UNUSED_32] * 3],
            storage_total=[disk_mib[1], *[_UNUSED_32] * 3],
            **dict.fromkeys(
                ("link_type", "link_tx_rate", "link_rx_rate", "link_tx_max", "link_rx_max"),
                [_UNUSED_32] * 6,
            ),
            status_flags=0,
        )
    ]


def is_sendable(value: float) -> bool:
    """Returns True if a value is finite as MAVLink's float (single precision)."""
    return abs(value) <= _MAX_FLOAT


def milliseconds(now_s: float) -> int:
    """Companion's clock as MAVLink's time_boot_ms, which wraps after 49 days."""
    return int(now_s * 1000.0) & 0xFFFFFFFF

"""Geometry of an aim: from the aircraft and its camera to a point. Pure.

Angles: elevation up from the horizon, heading from north to the right. The camera is at the
aircraft's place: its lever arm is far below the error of that.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ...mavlink.gimbal import GimbalAttitude
from ...types import Vector
from ..estimation.plane_to_local import PlaneToLocal

_NO_HEADING_M = 0.1
"""Level distance below which a point has no heading: it is above or below."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Direction:
    """Direction from the aircraft to a point. heading_rad: None straight above or below."""

    elevation_rad: float
    heading_rad: float | None
    distance_m: float


def direction_to(aim_m: tuple[float, float], position_m: Vector, plane: PlaneToLocal) -> Direction:
    """Direction to a point (x, z) of the site's plane from a place (x, y, z)."""
    x_m, y_m, z_m = position_m
    north, east, down = plane.velocity_to_ned((aim_m[0] - x_m, -y_m, aim_m[1] - z_m))
    level_m = math.hypot(north, east)
    return Direction(
        elevation_rad=math.atan2(-down, level_m),
        heading_rad=math.atan2(east, north) if level_m >= _NO_HEADING_M else None,
        distance_m=math.hypot(level_m, down),
    )


def camera_axis(aim: Direction, attitude: GimbalAttitude, body_rad: Vector) -> tuple[float, float]:
    """Elevation and heading of the camera's axis. body_rad: roll, pitch, yaw of the aircraft.

    Of servos the frame is not known: the reading that is nearer to the aim counts.
    """
    level = (attitude.pitch_rad, attitude.heading_rad(body_rad[2]))
    if not attitude.by_servos:
        return level
    turned = _from_body(attitude.pitch_rad, attitude.yaw_rad, body_rad)
    return min(level, turned, key=lambda axis: angle_rad(aim, *axis))


def _from_body(pitch_rad: float, yaw_rad: float, body_rad: Vector) -> tuple[float, float]:
    """Elevation and heading of an axis with this pitch and yaw from the body."""
    roll, pitch, yaw = body_rad
    forward, right = (
        math.cos(pitch_rad) * math.cos(yaw_rad),
        math.cos(pitch_rad) * math.sin(yaw_rad),
    )
    down = -math.sin(pitch_rad)
    right, down = (
        right * math.cos(roll) - down * math.sin(roll),
        right * math.sin(roll) + down * math.cos(roll),
    )
    forward, down = (
        forward * math.cos(pitch) + down * math.sin(pitch),
        down * math.cos(pitch) - forward * math.sin(pitch),
    )
    return math.asin(max(-1.0, min(1.0, -down))), yaw + math.atan2(right, forward)


def angle_rad(direction: Direction, elevation_rad: float, heading_rad: float) -> float:
    """Angle between a direction and an axis of this elevation and heading."""
    turn = 0.0 if direction.heading_rad is None else direction.heading_rad - heading_rad
    cosine = math.sin(direction.elevation_rad) * math.sin(elevation_rad) + math.cos(
        direction.elevation_rad
    ) * math.cos(elevation_rad) * math.cos(turn)
    return math.acos(max(-1.0, min(1.0, cosine)))

"""Distances of obstacles: OBSTACLE_DISTANCE and OBSTACLE_DISTANCE_3D to `Telemetry`. Pure.

Part of `translate`, which names the sources. A sensor's own computer sends them (component 196 or
another), or PX4, which joins its distance sensors to OBSTACLE_DISTANCE. ArduPilot sends neither.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from ..types import Vector
from .dialect import Message, mavlink
from .telemetry import Attitude, Proximity, Telemetry

_UNKNOWN_CM = 65535
_NORTH_FRAMES = {int(mavlink.MAV_FRAME_GLOBAL), int(mavlink.MAV_FRAME_LOCAL_NED)}
"""Level, from north clockwise. GLOBAL is the default of a message without the field."""
_HEADING_FRAME = int(mavlink.MAV_FRAME_LOCAL_FRD)
"""Level, from the heading clockwise."""
_BODY_FRAME = int(mavlink.MAV_FRAME_BODY_FRD)
_ATTITUDE_MAX_AGE_S = 0.5
"""At 90°/s the directions of older attitudes are wrong by 45° and more."""
_INSTANT_S = 0.2
"""Time within which a sensor sends the obstacles of one instant."""
_MOST_POINTS = 500
"""Limit of the obstacles of one instant."""


def _obstacle_distance(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    """Telemetry with the distances in the sectors of a plane; unchanged by unclear directions.

    A distance that is unknown, 0 or outside of the sensor's range is no measurement.
    """
    width_deg = message.increment_f or float(message.increment)
    if not (math.isfinite(width_deg) and width_deg and math.isfinite(message.angle_offset)):
        return telemetry
    to_body = _to_body(message.frame, telemetry.attitude, now_s)
    if to_body is None:
        return telemetry
    points = []
    for sector in range(round(min(len(message.distances), 360.0 / abs(width_deg)))):
        distance_cm = message.distances[sector]
        if distance_cm in {0, _UNKNOWN_CM}:
            continue
        if message.min_distance <= distance_cm <= message.max_distance:
            angle_rad = math.radians(message.angle_offset + sector * width_deg)
            distance_m = 0.01 * distance_cm
            level = distance_m * math.cos(angle_rad), distance_m * math.sin(angle_rad), 0.0
            points.append(_left_and_up(to_body(level)))
    return _seen(telemetry, message, message.time_usec * 1e-6, tuple(points), now_s)


def _obstacle_distance_3d(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    """Telemetry with an obstacle's point; those of one instant of a sensor come one by one.

    Unchanged by points in other axes than the aircraft's. A point that is not finite or outside of
    the sensor's range is none, but shows that the sensor works.
    """
    if message.frame != _BODY_FRAME:
        return telemetry
    point = (message.x, message.y, message.z)
    stamp_s = message.time_boot_ms * 1e-3
    before = telemetry.proximity
    points: tuple[Vector, ...] = ()
    if (
        before is not None
        and (before.sender, before.stamp_s) == (message.get_srcComponent(), stamp_s)
        and stamp_s
        and now_s - before.received_s <= _INSTANT_S
    ):
        points = before.points_m[-_MOST_POINTS:]
    if _is_measured(math.hypot(*point), message.min_distance, message.max_distance):
        points = (*points, _left_and_up(point))
    return _seen(telemetry, message, stamp_s, points, now_s)


def _seen(
    telemetry: Telemetry,
    message: Message,
    stamp_s: float,
    points_m: tuple[Vector, ...],
    now_s: float,
) -> Telemetry:
    proximity = Proximity(
        received_s=now_s,
        x_m=tuple(point[0] for point in points_m),
        y_m=tuple(point[1] for point in points_m),
        z_m=tuple(point[2] for point in points_m),
        sender=message.get_srcComponent(),
        stamp_s=stamp_s,
    )
    return replace(telemetry, proximity=proximity)


def _is_measured(distance_m: float, least_m: float, greatest_m: float) -> bool:
    """Returns True for a distance within the range; a range that is not finite limits nothing."""
    if not math.isfinite(distance_m) or distance_m == 0.0 or distance_m < least_m:
        return False
    return not 0.0 < greatest_m < distance_m


def _to_body(
    frame: int, attitude: Attitude | None, now_s: float
) -> Callable[[Vector], Vector] | None:
    """Rotation from a frame's axes to forward, right, down of the aircraft; None: it is unknown."""
    if frame == _BODY_FRAME:
        return lambda vector: vector
    if attitude is None or now_s - attitude.received_s > _ATTITUDE_MAX_AGE_S:
        return None
    if frame in _NORTH_FRAMES:
        yaw_rad = attitude.yaw_rad
    elif frame == _HEADING_FRAME:
        yaw_rad = 0.0
    else:
        return None
    angles = (yaw_rad, attitude.pitch_rad, attitude.roll_rad)
    if not all(map(math.isfinite, angles)):
        return None
    (sin_y, cos_y), (sin_p, cos_p), (sin_r, cos_r) = ((math.sin(a), math.cos(a)) for a in angles)

    def rotate(vector: Vector) -> Vector:
        x, y, z = vector
        x, y = cos_y * x + sin_y * y, cos_y * y - sin_y * x
        x, z = cos_p * x - sin_p * z, cos_p * z + sin_p * x
        y, z = cos_r * y + sin_r * z, cos_r * z - sin_r * y
        return x, y, z

    return rotate


def _left_and_up(body: Vector) -> Vector:
    forward, right, down = body
    return forward, -right, -down


TRANSLATORS: dict[int, Callable[[Telemetry, Message, float], Telemetry]] = {
    mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE: _obstacle_distance,
    mavlink.MAVLINK_MSG_ID_OBSTACLE_DISTANCE_3D: _obstacle_distance_3d,
}

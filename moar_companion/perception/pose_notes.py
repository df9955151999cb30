"""Poses of the aircraft and measured points, as sent from companion to perception. Values."""

from __future__ import annotations

from dataclasses import dataclass

from ..planner.site import PlanePoint
from ..types import Vector


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionNote:
    """LOCAL_POSITION_NED in the site's frame, at its time on the companion's clock.

    jumped_m: sum of all jumps of the estimate so far; tracks and cells move with it. A sum stays
    right after lost notes. offset_m: of the line's frame, that the aircraft is flown with.
    """

    time_s: float
    position_m: Vector
    jumped_m: Vector = (0.0, 0.0, 0.0)
    offset_m: PlanePoint = (0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class AttitudeNote:
    """ATTITUDE: aerospace angles of the body in NED, at its time on the companion's clock."""

    time_s: float
    roll_rad: float
    pitch_rad: float
    yaw_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class PointsNote:
    """Measured points in the aircraft's frame (x forward, y left, z up), at their time.

    From OBSTACLE_DISTANCE and OBSTACLE_DISTANCE_3D.
    """

    time_s: float
    points_m: tuple[Vector, ...]


PoseNote = PositionNote | AttitudeNote | PointsNote

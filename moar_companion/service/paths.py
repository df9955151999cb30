"""From a plan to the points that are flown, and the legs among them that were checked as a whole.

Inputs: a plan of the plane and where it begins in flight; outputs: points in the site's frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..guidance.trajectory import FloatArray, PathPoints
from ..mission.gate import Corridor
from ..planner.plan import Plan
from ..site import PlanePoint
from ..types import Vector

_TOLERANCE_M = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckedLeg:
    """A leg through what is not free. room_m: from the hull on it to the nearest keep-out."""

    points_m: Corridor
    room_m: float

    def has_room(self, widened_m: float) -> bool:
        """Whether it may be flown where the distance from obstacles has grown by so much."""
        return self.room_m >= widened_m - _TOLERANCE_M


def flown(
    plan: Plan, start_m: Vector, escape_end_m: PlanePoint | None, slow_mps: float
) -> PathPoints:
    """A plan's points from where it begins in flight, which is in its first cell.

    Any straight from within a cell to the centre of the next stays in cells that the plan may
    pass; a plan of one state leads to its cell's centre. slow_mps: on an escape leg.
    """
    points = _in_space(plan.waypoints.position_m)
    speed = plan.waypoints.speed_mps[1:]
    start = np.array(start_m)[None]
    if escape_end_m is not None or len(points) == 1:
        return PathPoints(
            position_m=np.concatenate([start, points]),
            speed_mps=np.concatenate([[slow_mps], speed]),
        )
    return PathPoints(position_m=np.concatenate([start, points[1:]]), speed_mps=speed)


def standing(position_m: Vector) -> PathPoints:
    """A path of one point."""
    return PathPoints(position_m=np.array(position_m)[None], speed_mps=np.zeros(0))


def checked_legs(
    plan: Plan, path: PathPoints, escape_end_m: PlanePoint | None
) -> tuple[CheckedLeg, ...]:
    """The escape leg and the landing leg of a plan that is flown by a path.

    An escape leg leads away from what is near: it has all the room there is.
    """
    points = [vector(point) for point in path.position_m]
    legs = []
    if escape_end_m is not None:
        legs.append(CheckedLeg(points_m=tuple(points[:2]), room_m=math.inf))
    if plan.landing_leg is not None:
        landing = tuple(points[-1 - len(plan.landing_leg.points_m) :])
        legs.append(CheckedLeg(points_m=landing, room_m=plan.landing_leg.room_m))
    return tuple(legs)


def vector(values: FloatArray) -> Vector:
    """Three plain numbers."""
    return float(values[0]), float(values[1]), float(values[2])


def _in_space(points_m: FloatArray) -> FloatArray:
    """Points (n, 2) of the plane as (n, 3) of the site's frame."""
    return np.stack([points_m[:, 0], np.zeros(len(points_m)), points_m[:, 1]], axis=1)

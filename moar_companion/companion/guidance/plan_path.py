"""Flown points of a plan, and the legs among them that were checked as a whole.

Inputs: a plan of the plane and its start in flight; outputs: points in the site's frame.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...planner.plan_values import Plan
from ...planner.site import PlanePoint
from ...types import Vector
from ..safety.setpoint_gate import Corridor
from .trajectory import FloatArray, PathPoints

_TOLERANCE_M = 1e-6
_BESIDE_M = 1.0
"""An aircraft farther beside the plane first returns to it straight."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckedLeg:
    """A leg through cells that are not free. room_m: from the hull on it to the nearest keep-out.

    is_entry: an escape or recovery leg, which may begin outside the autopilot's fence. barred: by
    an obstacle that was seen after the leg was checked.
    """

    points_m: Corridor
    room_m: float
    is_entry: bool = False
    barred: bool = False

    @property
    def begins_beside(self) -> bool:
        """True if the leg leads back from beside the plane."""
        return abs(self.points_m[0][1]) > _BESIDE_M

    def has_room(self, widened_m: float) -> bool:
        """True if the leg may be flown with obstacles inflated by `widened_m`."""
        return not self.barred and self.room_m >= widened_m - _TOLERANCE_M


def flown(
    plan: Plan,
    start_m: Vector,
    escape_m: tuple[PlanePoint, ...],
    leg_speeds_mps: Callable[[FloatArray], FloatArray],
) -> PathPoints:
    """Points of a plan from its start in flight, which is in its first cell.

    Any straight from within a cell to the centre of the next stays in cells that the plan may
    pass; a plan of one state leads to its cell's centre. escape_m: the corners of a leg that
    leads there, the plan's first point last. leg_speeds_mps: speeds of its segments, by points
    (n, 3).
    """
    points = _in_space(plan.waypoints.position_m)
    speed = plan.waypoints.speed_mps[1:]
    corners = _in_space(np.array(escape_m[:-1]).reshape(-1, 2))
    leg = np.concatenate([approach_m(start_m), corners])
    if not escape_m and len(points) > 1:
        points = points[1:]
        leg_mps = leg_speeds_mps(leg)
    else:
        leg_mps = leg_speeds_mps(np.concatenate([leg, points[:1]]))
    return PathPoints(
        position_m=np.concatenate([leg, points]), speed_mps=np.concatenate([leg_mps, speed])
    )


def approach_m(start_m: Vector) -> FloatArray:
    """First points of a path, (1, 3), or (2, 3) from beside the plane straight to it."""
    x_m, y_m, z_m = start_m
    points_m = [start_m, (x_m, 0.0, z_m)] if abs(y_m) > _BESIDE_M else [start_m]
    return np.array(points_m)


def standing(position_m: Vector) -> PathPoints:
    """Returns a path of one point."""
    return PathPoints(position_m=np.array(position_m)[None], speed_mps=np.zeros(0))


def checked_legs(
    plan: Plan, path: PathPoints, escape_m: tuple[PlanePoint, ...]
) -> tuple[CheckedLeg, ...]:
    """Returns the leg that leads to a plan, and the plan's landing leg.

    An escape leg leads away from a near obstacle: its room is unlimited. A recovery leg was
    found by its room.
    """
    points = [vector(point) for point in path.position_m]
    legs = []
    begins = len(approach_m(points[0])) + len(escape_m)
    if begins > 1:
        entry = tuple(points[:begins])
        legs.append(CheckedLeg(points_m=entry, room_m=math.inf, is_entry=True))
    if plan.landing_leg is not None:
        landing = tuple(points[-1 - len(plan.landing_leg.points_m) :])
        legs.append(CheckedLeg(points_m=landing, room_m=plan.landing_leg.room_m))
    return tuple(legs)


def vector(values: FloatArray) -> Vector:
    """Converts to three plain numbers."""
    return float(values[0]), float(values[1]), float(values[2])


def _in_space(points_m: FloatArray) -> FloatArray:
    """Converts points (n, 2) of the plane to (n, 3) of the site's frame."""
    return np.stack([points_m[:, 0], np.zeros(len(points_m)), points_m[:, 1]], axis=1)

"""Point where a requested plan joins the flown trajectory, and the outcome of the plan."""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np

from ...planner.comparison import rest_of
from ...planner.maps import Maps
from ...planner.plan_values import Plan
from ...types import Vector
from .trajectory import PathPoints, Trajectory


@dataclass(frozen=True, kw_only=True, eq=False)
class Splice:
    """Point where a requested plan will begin.

    trajectory: the trajectory at the time of the request. joined_m: the distance along it; None
    for the aircraft's own position, off the trajectory. corner: the index of its point there;
    None if there is none. at_end: the trajectory ends there, or leaves the workspace by its
    landing leg: no part is left to plan better.
    """

    trajectory: Trajectory
    joined_m: float | None = None
    corner: int | None = None
    position_m: Vector
    velocity_mps: Vector
    at_end: bool = False

    def is_followed_by(self, path: PathPoints) -> bool:
        """True if the trajectory already continues by these points."""
        if self.corner is None:
            return False
        points_m = self.trajectory.points_m[self.corner :]
        return np.array_equal(points_m, path.position_m)

    def rest_of(self, plan: Plan, newer: Plan, maps: Maps) -> Plan | None:
        """Rest of the active plan from here, as an answer to the newer plan's request.

        None where it is not free on these maps, or the newer plan begins at no state of it.
        """
        if self.corner is None:
            return None
        # An escape leg has a point of its own before the plan's first.
        added = len(self.trajectory.points_m) - len(plan.waypoints.position_m)
        first = self.corner - added
        if not 0 <= first < len(plan.states):
            return None
        if (plan.states[first, :-1] != newer.states[0, :-1]).any():
            return None
        return rest_of(plan, maps, first, newer.request, newer.graph)


class Adoption(enum.Enum):
    """Outcome of a plan."""

    NEW_PATH = "its path is flown"
    SAME_PATH = "its path was flown already"
    KEPT_PATH = "the path that is flown is as good"
    TOO_LATE = "where it begins cannot be joined any more"

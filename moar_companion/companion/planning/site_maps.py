"""Site maps: a site and the planner's maps of it; room and clearance of a hull there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...planner.maps import Maps
from ...planner.regions import obstacle_clearance_m, obstacle_room_m
from ...planner.site import Site
from ..estimation.pose import Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class SiteMaps:
    """Site and maps of a companion that plans."""

    site: Site
    maps: Maps

    def clearance_m(self, pose: Pose, radius_m: float) -> float | None:
        """Distance from a hull at a place to the nearest obstacle; None if there is none."""
        clearance_m = float(obstacle_clearance_m(self.site, np.array(pose.position_m[::2])))
        return clearance_m - radius_m if self.site.obstacles else None

    def room_m(self, pose: Pose, radius_m: float) -> float | None:
        """Distance from a hull at a place to the nearest keep-out; None without an obstacle.

        The place is the aircraft's own, so the tracking margin does not apply. The place itself
        counts: on the border of two cells the cells' values would alternate.
        """
        room_m = float(obstacle_room_m(self.site, np.array(pose.position_m[::2])))
        return room_m + self.site.margin.tracking_m - radius_m if self.site.obstacles else None

    def dwell_s(self, stops: tuple[str, ...]) -> float:
        """Time to stay at the first of a task's targets; 0 without one."""
        return self.site.target(stops[0]).dwell_s if stops else 0.0

    def hold_s(self, stops: tuple[str, ...]) -> float:
        """Expected time at the first of a task's targets, with its pictures; 0 without one."""
        return self.site.target(stops[0]).hold_s if stops else 0.0

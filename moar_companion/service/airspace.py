"""The airspace of a flight: where its setpoints may be, and how fast there.

Inputs: the site's maps, the vehicle, what its autopilot does when nothing more is sent; places.
Outputs: speeds, and reasons to refuse a setpoint.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ..guidance.trajectory import FloatArray, PathPoints, Trajectory, make_trajectory
from ..mission.gate import distance_m, refusal
from ..planner.maps import Maps
from ..planner.reach import Reach
from ..site import Site
from ..types import Vector
from ..vehicle import Vehicle
from .loss import Loss
from .motion import Pose, Setpoint
from .paths import CheckedLeg, vector

_PER_CELL = 10
"""Samples of a straight that must be free, for each cell of its length."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Airspace:
    """What the site and the maps allow a vehicle; beside them, its checked legs are open to it.

    maps: of the site, with keep-outs as they are: what the gate widens by what is true now.
    reach: to obstacles as wide as the plan that is flown takes them; None: as on `maps`.
    """

    site: Site
    vehicle: Vehicle
    maps: Maps
    loss: Loss
    reach: Reach | None = None

    @property
    def corridor_width_m(self) -> float:
        """How far from a checked leg a setpoint may be."""
        return self.maps.grid.resolution_m

    def widened(self, reach: Reach | None) -> Airspace:
        """The same with obstacles as wide as another plan takes them."""
        return replace(self, reach=reach)

    def trajectory(self, path: PathPoints, lead_in: PathPoints | None = None) -> Trajectory:
        """How a path is flown."""
        return make_trajectory(
            path,
            lead_in=lead_in,
            acceleration_mps2=self.vehicle.guidance.acceleration_mps2,
            rounding_m=0.5 * self.maps.grid.resolution_m,
            cap=self.speed_cap_mps,
        )

    def rests_m(self, trajectory: Trajectory, from_m: float = 0.0) -> FloatArray:
        """Where it could come to rest if nothing more were sent from a distance on: (n, 2)."""
        ahead = trajectory.distance_m >= min(from_m, trajectory.length_m)
        places, speed_mps = trajectory.position_m[ahead], trajectory.speed_mps[ahead]
        beyond = trajectory.direction[ahead] * self.loss.way_m(speed_mps)[:, None]
        return np.concatenate([places, places + beyond])[:, ::2]

    def speed_cap_mps(self, position_m: FloatArray, direction: FloatArray) -> FloatArray:
        """The greatest speeds (n,) from which the aircraft comes to rest in free space.

        No lower than the site's least altitude either, nor, outside the workspace, on a leg that
        leads lower, than the leg. A path leads through the middle of its cells, so that half a cell
        is always free, and no cap is 0.
        """
        places, ways = position_m[:, ::2], direction[:, ::2]
        farthest_m = float(self.loss.way_m(np.array(self.vehicle.speed.max_mps)))
        reach = self.maps.reach if self.reach is None else self.reach
        free_m = reach.free_m(places, ways, farthest_m)
        sinks = ways[:, 1] < 0.0
        down_m = places[sinks, 1] - self._lowest_m(places)[sinks]
        free_m[sinks] = np.minimum(free_m[sinks], down_m / -ways[sinks, 1])
        return self.loss.speed_mps(np.maximum(free_m, 0.5 * self.maps.grid.resolution_m))

    def _lowest_m(self, places_m: FloatArray) -> FloatArray:
        """The heights (n,) below which nothing may come to rest that passes places (n, 2)."""
        workspace, lowest_m = self.site.workspace, places_m[:, 1].min()
        if workspace.min_altitude_m is None:
            return np.full(len(places_m), lowest_m)
        lower_m = np.maximum(workspace.lower_m, (-np.inf, workspace.min_altitude_m))
        inside = ((places_m > lower_m) & (places_m < np.array(workspace.upper_m))).all(axis=1)
        outside_m = min(lowest_m, workspace.min_altitude_m)
        return np.where(inside, workspace.min_altitude_m, outside_m)

    def free_between(self, start_m: FloatArray, end_m: Vector) -> bool:
        """Whether the setpoint may move straight from one place to another: in free cells only."""
        grid = self.maps.grid
        line = np.array(end_m) - start_m
        samples = 2 + math.ceil(float(np.sqrt(line @ line)) / grid.resolution_m * _PER_CELL)
        for part in np.linspace(0.0, 1.0, samples):
            x_m, _, z_m = vector(start_m + part * line)
            cell = grid.cell_of((x_m, z_m))
            if cell is None or self.maps.occupied[cell]:
                return False
        return True

    def strays(self, pose: Pose, legs: tuple[CheckedLeg, ...]) -> str | None:
        """How far the aircraft is too low, or outside the workspace; None where it may be.

        That is, no farther outside than it may lag behind, or no farther from a checked leg.
        """
        x_m, _, z_m = pose.position_m
        workspace, beside_m = self.site.workspace, self.vehicle.guidance.tracking_hold_m
        low_m = workspace.min_altitude_m
        outside_m = math.dist((x_m, z_m), np.clip((x_m, z_m), workspace.lower_m, workspace.upper_m))
        if low_m is not None and z_m < low_m - workspace.resolution_m:
            words = f"too low at {z_m:.1f} m, the least is {low_m:g} m"
        elif outside_m > beside_m:
            words = f"{outside_m:.1f} m outside the workspace"
        else:
            return None
        near = any(distance_m(pose.position_m, leg.points_m) <= beside_m for leg in legs)
        return None if near else words

    def refusal(
        self,
        setpoint: Setpoint,
        legs: tuple[CheckedLeg, ...],
        *,
        plane_tolerance_m: float,
        widened_m: float,
    ) -> str | None:
        """Why a setpoint must not be where it is; None when it may.

        widened_m: what the distance from obstacles grows by for a setpoint that moves.
        """
        if any(setpoint.velocity_mps):
            legs = tuple(leg for leg in legs if leg.has_room(widened_m))
        x_m, _, z_m = setpoint.position_m
        finite = math.isfinite(x_m) and math.isfinite(z_m)
        return refusal(
            setpoint.position_m,
            setpoint.velocity_mps,
            setpoint.yaw_rad,
            cell=self.maps.grid.cell_of((x_m, z_m)) if finite else None,
            occupied=self.maps.occupied,
            room_m=self.maps.room_m,
            widened_m=widened_m,
            min_altitude_m=self.site.workspace.min_altitude_m,
            corridors_m=tuple(leg.points_m for leg in legs),
            corridor_width_m=self.corridor_width_m,
            plane_tolerance_m=plane_tolerance_m,
        )

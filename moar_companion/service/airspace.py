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
from ..planner.escape import recovery_leg
from ..planner.fence import PlaneFence
from ..planner.geometry import rings
from ..planner.graph import elevation_speed_mps
from ..planner.grid import TOLERANCE, BoolArray
from ..planner.legs import leg_clearances
from ..planner.maps import Maps
from ..planner.reach import Reach
from ..planner.regions import obstacle_room_m
from ..site import Site
from ..types import Vector
from ..vehicle import Vehicle
from .loss import Loss
from .motion import Pose, Setpoint
from .paths import CheckedLeg, approach_m, vector

_PER_CELL = 10
"""Samples of a straight that must be free, for each cell of its length."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Airspace:
    """What the site and the maps allow a vehicle; beside them, its checked legs are open to it.

    maps: of the site, with keep-outs as they are: what the gate widens by what is true now.
    reach: to obstacles as wide as the plan that is flown takes them; None: as on `maps`.
    fence: of the autopilot, less its margin; None where there is none. narrowed_m: how much of the
    margin the plan that is flown does without.
    """

    site: Site
    vehicle: Vehicle
    maps: Maps
    loss: Loss
    reach: Reach | None = None
    fence: PlaneFence | None = None
    narrowed_m: float = 0.0

    @property
    def corridor_width_m(self) -> float:
        """How far from a checked leg a setpoint may be."""
        return self.maps.grid.resolution_m

    def leg_speeds_mps(self, points_m: FloatArray) -> FloatArray:
        """How fast the segments between points (n, 3) of a leg to a plan are flown: (n - 1,).

        From outside as fast as the vehicle may in their direction, from beside what is near v_MIN.
        """
        x_m, _, z_m = start_m = vector(points_m[0])
        workspace, speed = self.site.workspace, self.vehicle.speed
        outside = workspace.outside_m((x_m, z_m)) > 0.0 and z_m >= workspace.lower_m[1]
        recovers = outside and self._may_be_carried_to(start_m, math.inf, within_m=0.0)
        if recovers:
            return self.recovery_speeds_mps(points_m)
        return np.full(len(points_m) - 1, speed.min_mps)

    def recovery_speeds_mps(self, points_m: FloatArray) -> FloatArray:
        """How fast the vehicle may fly the segments between points (n, 3): (n - 1,)."""
        return elevation_speed_mps(self.vehicle.speed, np.diff(points_m, axis=0)[:, ::2])

    def widened(self, reach: Reach | None, narrowed_m: float = 0.0) -> Airspace:
        """The same with obstacles as wide as another plan takes them."""
        return replace(self, reach=reach, narrowed_m=narrowed_m)

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
        if self.fence is not None:
            np.minimum(free_m, self.fence.free_m(places, ways), out=free_m)
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
            if cell is None or (
                self.maps.occupied[cell] and not -self.narrowed_m <= self.maps.room_m[cell] < 0.0
            ):
                return False
        return True

    def is_crowded(self, places_m: FloatArray) -> bool:
        """Whether one of some places (n, 3) is within an obstacle's margin, or a cell of it."""
        least_m = self.vehicle.radius_m + self.maps.grid.resolution_m
        return bool((obstacle_room_m(self.site, places_m[:, ::2]) < least_m).any())

    def leaves_fence(self, places_m: FloatArray) -> str | None:
        """The limit of the autopilot's fence that one of some places (n, 3) is outside of.

        Within a cell, for cells are inside by their centres.
        """
        if self.fence is None:
            return None
        return self.fence.crossed(places_m[:, ::2], self.maps.grid.resolution_m)

    def carried_m(self, setpoint_m: Vector, aircraft_m: Vector, leash_m: float) -> Vector | None:
        """Where the setpoint is, at rest, that an aircraft takes along at a distance.

        That is on the straight between the two, as near to the aircraft as `leash_m` allows, where
        it may be and from where the way back to it is free; else nearer, at last where the aircraft
        is. None where that is nowhere nearer than it is, and where it is no farther than that.
        """
        setpoint, aircraft = np.array(setpoint_m), np.array(aircraft_m)
        line = setpoint - aircraft
        length_m = float(np.sqrt(line @ line))
        if length_m <= leash_m + TOLERANCE:
            return None
        step_m, least_m = 0.5 * self.maps.grid.resolution_m, self._least_m(setpoint_m[2])
        nearer_m = np.arange(leash_m - step_m, 0.0, -step_m)
        at_m = np.concatenate([np.arange(leash_m, length_m, step_m), nearer_m, [0.0]])
        places = aircraft + (at_m / length_m)[:, None] * line
        places[:, 2] = np.maximum(places[:, 2], least_m)
        for place_m in map(vector, places[self._leads_back(places, aircraft)]):
            nearer = math.dist(place_m, aircraft_m) < length_m
            if nearer and self._may_be_carried_to(place_m, least_m, self.site.margin.total_m):
                return place_m
        return None

    def is_free_leg(self, start_m: Vector, end_m: Vector) -> bool:
        """Whether a straight leg keeps every keep-out; in one it begins in, comes no nearer."""
        return bool(self._leads_back(np.array([end_m]), np.array(start_m))[0])

    def _leads_back(self, places_m: FloatArray, aircraft_m: FloatArray) -> BoolArray:
        """From which places (n, 3) the straight to the aircraft keeps every keep-out: (n,).

        Of one in which the aircraft is, it comes no nearer to the obstacle.
        """
        vertices_m, first, radius_m, keep_out_m = rings(self.site.obstacles)
        least_m = keep_out_m + self.vehicle.radius_m - self.site.margin.total_m
        ends_m = np.stack([aircraft_m[::2], *places_m[:, ::2]])
        clear_m = leg_clearances(ends_m, ends_m[0], vertices_m, first, radius_m)
        kept = clear_m[1:] >= np.minimum(clear_m[0], least_m) - TOLERANCE
        return np.asarray(kept.all(axis=1))

    def _least_m(self, from_z_m: float) -> float:
        """How low a setpoint may be carried from a height: no lower, where that is too low."""
        low_m = self.site.workspace.min_altitude_m
        return -math.inf if low_m is None else min(low_m, from_z_m)

    def keeps_clear(self, place_m: Vector) -> bool:
        """Whether a place, anywhere, is in no obstacle's own keep-out: within the margin it is."""
        return self._may_be_carried_to(place_m, place_m[2], self.site.margin.total_m)

    def _may_be_carried_to(self, place_m: Vector, from_z_m: float, within_m: float) -> bool:
        """Whether a place keeps every keep-out, also outside the workspace, and is not too low.

        from_z_m: the height from which it is carried. within_m: how far it may be in a keep-out:
        to draw an aircraft back through the margin is worse than to leave it there.
        """
        x_m, _, z_m = place_m
        if z_m < self._least_m(from_z_m):
            return False
        cell = self.maps.grid.cell_of((x_m, z_m))
        if cell is not None and self.maps.room_m[cell] < -within_m - TOLERANCE:
            return False
        room_m = float(obstacle_room_m(self.site, np.array([x_m, z_m])))
        return room_m >= self.vehicle.radius_m - within_m

    def way_back(self, place_m: Vector, widened_m: float) -> CheckedLeg | None:
        """The recovery leg from outside the workspace, or straight back to the plane in it."""
        x_m, y_m, z_m = place_m
        if abs(y_m) > self.vehicle.guidance.recovery_m:
            return None
        points_m = [vector(point) for point in approach_m(place_m)]
        if self.site.workspace.outside_m((x_m, z_m)):
            start_m = (x_m, z_m)
            corners_m = recovery_leg(
                self.site, self.vehicle, self.maps, start_m, widened_m, self.fence
            )
            if not corners_m:
                return None
            points_m += [(x_m, 0.0, z_m) for x_m, z_m in corners_m]
        return CheckedLeg(points_m=tuple(points_m), room_m=math.inf, leads_in=True)

    def strays(self, pose: Pose, legs: tuple[CheckedLeg, ...]) -> str | None:
        """How far the aircraft is too low, or outside the workspace or plane; None where it may be.

        That is, no farther outside than it may lag behind, or no farther from a checked leg.
        """
        x_m, y_m, z_m = pose.position_m
        workspace, beside_m = self.site.workspace, self.vehicle.guidance.tracking_hold_m
        low_m = workspace.min_altitude_m
        outside_m = workspace.outside_m((x_m, z_m))
        if low_m is not None and z_m < low_m - workspace.resolution_m:
            words = f"altitude {z_m:.1f} m < {low_m:g}"
        elif outside_m > beside_m:
            words = f"{outside_m:.1f} m outside the workspace"
        elif abs(y_m) > self.vehicle.guidance.leash_m:
            words = f"{abs(y_m):.1f} m from the plane"
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
        carried_from_z_m: float | None = None,
        brakes: bool = False,
    ) -> str | None:
        """Why a setpoint must not be where it is; None when it may.

        widened_m: what the distance from obstacles grows by for a setpoint that moves.
        Both as far as the plan keeps the margin.
        carried_from_z_m: at rest it may be wherever a wind can have carried it from that height;
        None where none has. brakes: it comes to rest, which it may outside the fence, too.
        """
        widened_m = max(widened_m - self.narrowed_m, -self.site.margin.total_m)
        if any(setpoint.velocity_mps):
            carried_from_z_m = None
            legs = tuple(leg for leg in legs if leg.has_room(widened_m))
            crossed = self.leaves_fence(np.array([setpoint.position_m]))
            if (
                crossed is not None
                and not brakes
                and not any(
                    leg.leads_in
                    and distance_m(setpoint.position_m, leg.points_m) <= self.corridor_width_m
                    for leg in legs
                )
            ):
                return f"the setpoint is outside {crossed}"
        x_m, _, z_m = setpoint.position_m
        finite = math.isfinite(x_m) and math.isfinite(z_m)
        if (
            finite
            and carried_from_z_m is not None
            and self._may_be_carried_to(
                setpoint.position_m, carried_from_z_m, self.site.margin.total_m
            )
        ):
            return None
        return refusal(
            setpoint.position_m,
            setpoint.velocity_mps,
            setpoint.yaw_rad,
            cell=self.maps.grid.cell_of((x_m, z_m)) if finite else None,
            occupied=self.maps.occupied,
            room_m=self.maps.room_m,
            widened_m=widened_m,
            margin_m=self.site.margin.total_m,
            min_altitude_m=self.site.workspace.min_altitude_m,
            corridors_m=tuple(leg.points_m for leg in legs),
            ways_back_m=tuple(leg.points_m for leg in legs if leg.begins_beside),
            corridor_width_m=self.corridor_width_m,
            plane_tolerance_m=plane_tolerance_m,
        )

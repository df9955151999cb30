"""The flight volume: places and speeds that are permitted for setpoints.

Inputs: the site's maps, the vehicle, the autopilot's offboard-loss behaviour; places.
Outputs: speeds, and reasons to refuse a setpoint.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

import numpy as np

from ...mavlink.autopilots.offboard_loss import OffboardLoss
from ...planner import ground_profile
from ...planner.escape import recovery_leg, refuge_leg
from ...planner.free_distance import FreeDistance, free_ahead
from ...planner.geometry import rings
from ...planner.graph import elevation_speed_mps
from ...planner.grid import TOLERANCE, BoolArray, IntArray
from ...planner.legs import leg_clearances
from ...planner.maps import Maps, too_low
from ...planner.plane_fence import PlaneFence
from ...planner.regions import leg_room_m, legs_above_ground, obstacle_room_m
from ...planner.site import Site
from ...settings.vehicle import Vehicle
from ...texts.text_format import coordinate, distance, limit_text
from ...types import Vector
from ..estimation.pose import Pose, Setpoint
from ..safety.setpoint_gate import Corridor, Refusal, distance_m, refusal
from .plan_path import CheckedLeg, approach_m, vector
from .trajectory import FloatArray, PathPoints, Trajectory, make_trajectory

_PER_CELL = 10
"""Samples of a straight line per cell of its length; each must be free."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlightVolume:
    """Flight volume that the site and the maps permit; checked legs are permitted as well.

    maps: of the site, keep-outs without inflation; the gate adds the present inflation.
    reach: to obstacles with the inflation of the active plan; None: as on `maps`.
    fence: of the autopilot, less its margin; None where there is none. narrowed_m: part of the
    margin that the active plan omits.
    """

    site: Site
    vehicle: Vehicle
    maps: Maps
    loss: OffboardLoss
    reach: FreeDistance | None = None
    fence: PlaneFence | None = None
    narrowed_m: float = 0.0

    @property
    def corridor_width_m(self) -> float:
        """Maximum distance from a checked leg to a setpoint, in metres."""
        return self.maps.grid.resolution_m

    def leg_speeds_mps(self, points_m: FloatArray) -> FloatArray:
        """Speeds (n - 1,) of the segments between points (n, 3) of a leg to a plan.

        From clear space outside the workspace: the vehicle's limit in each direction; else v_MIN.
        """
        x_m, _, z_m = start_m = vector(points_m[0])
        workspace, speed = self.site.workspace, self.vehicle.speed
        outside = workspace.outside_m((x_m, z_m)) > 0.0 and z_m >= workspace.lower_m[1]
        recovers = outside and self._may_be_carried_to(start_m, math.inf, within_m=0.0)
        if recovers:
            return self.recovery_speeds_mps(points_m)
        return np.full(len(points_m) - 1, speed.min_mps)

    def recovery_speeds_mps(self, points_m: FloatArray) -> FloatArray:
        """The vehicle's speed limits (n - 1,) on the segments between points (n, 3)."""
        return elevation_speed_mps(self.vehicle.speed, np.diff(points_m, axis=0)[:, ::2])

    def widened(self, reach: FreeDistance | None, narrowed_m: float = 0.0) -> FlightVolume:
        """Returns the same volume with the obstacle inflation of another plan."""
        return replace(self, reach=reach, narrowed_m=narrowed_m)

    def trajectory(self, path: PathPoints, lead_in: PathPoints | None = None) -> Trajectory:
        """Returns the trajectory along a path, with the speed cap."""
        return make_trajectory(
            path,
            lead_in=lead_in,
            acceleration_mps2=self.vehicle.guidance.acceleration_mps2,
            rounding_m=0.5 * self.maps.grid.resolution_m,
            cap=self.speed_cap_mps,
        )

    def rests_m(self, trajectory: Trajectory, from_m: float = 0.0) -> FloatArray:
        """Possible stop points (n, 2) if the setpoint stream ends at `from_m` or later."""
        ahead = trajectory.distance_m >= min(from_m, trajectory.length_m)
        places, speed_mps = trajectory.position_m[ahead], trajectory.speed_mps[ahead]
        beyond = trajectory.direction[ahead] * self.loss.stopping_m(speed_mps)[:, None]
        return np.concatenate([places, places + beyond])[:, ::2]

    def speed_cap_mps(self, position_m: FloatArray, direction: FloatArray) -> FloatArray:
        """Maximum speeds (n,) from which the aircraft stops in free space.

        It stops no lower than the site's minimum altitude, also ahead, where ground rises. Outside
        the workspace, on a leg that leads lower, it stops no lower than the leg. A path leads
        through cell centres. Half a cell is therefore always free, and no cap is 0.
        """
        places, directions = position_m[:, ::2], direction[:, ::2]
        farthest_m = float(self.loss.stopping_m(np.array(self.vehicle.speed.max_mps)))
        reach = self.maps.reach if self.reach is None else self.reach
        free_m = reach.free_m(places, directions, farthest_m)
        if self.fence is not None:
            np.minimum(free_m, self.fence.free_m(places, directions), out=free_m)
        if self.site.workspace.ground_m:
            np.minimum(free_m, self._above_m(places, directions, farthest_m), out=free_m)
        sinks = directions[:, 1] < 0.0
        down_m = places[sinks, 1] - self._lowest_m(places)[sinks]
        free_m[sinks] = np.minimum(free_m[sinks], down_m / -directions[sinks, 1])
        return self.loss.speed_mps(np.maximum(free_m, 0.5 * self.maps.grid.resolution_m))

    def _lowest_m(self, places_m: FloatArray) -> FloatArray:
        """Minimum heights (n,) of the stop points of an aircraft at places (n, 2)."""
        workspace, lowest_m = self.site.workspace, places_m[:, 1].min()
        if workspace.min_altitude_m is None:
            return np.full(len(places_m), lowest_m)
        floor_m = workspace.floor_m(places_m[:, 0])
        lower_m = np.array(workspace.lower_m)
        inside = ((places_m > lower_m) & (places_m < np.array(workspace.upper_m))).all(axis=1)
        inside &= places_m[:, 1] > floor_m
        # Above a profile `_above_m` is the limit: along a slope the floor sinks with the path.
        inside_m = -np.inf if workspace.ground_m else floor_m
        return np.where(inside, inside_m, np.minimum(lowest_m, floor_m))

    def _above_m(
        self, places_m: FloatArray, directions: FloatArray, farthest_m: float
    ) -> FloatArray:
        """Distances (n,) from places (n, 2) in directions (n, 2) to cells that are too low.

        Less half a cell: those cells are too low by their centres. From the workspace also to those
        below it; a leg outside of it may lead lower.
        """
        space, above_m = self.site.workspace, np.full(len(places_m), farthest_m)
        inside = ((places_m > space.lower_m) & (places_m < space.upper_m)).all(axis=1)
        for grid, rays in ((self.maps.reach.grid, inside), (self.maps.grid, ~inside)):
            low = np.ascontiguousarray(too_low(self.site, grid)).view(np.uint8)
            low.flags.writeable = False
            starts = (places_m[rays] - np.array(grid.lower_m)) / grid.resolution_m
            along = directions[rays] / grid.resolution_m
            above_m[rays] = free_ahead(low, starts, along, farthest_m)
        half_m = 0.5 * space.resolution_m
        return np.where(above_m < farthest_m, above_m - half_m, above_m)

    def free_between(self, start_m: FloatArray, end_m: Vector) -> bool:
        """True if the straight line between two places is in free cells only."""
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

    def is_barred(self, places_m: FloatArray) -> BoolArray:
        """Mask (n,) of places (n, 3) in the workspace whose cell is not free."""
        grid = self.maps.grid
        cells = np.floor((places_m[:, ::2] - grid.lower_m) / grid.resolution_m).astype(np.intp)
        inside = ((cells >= 0) & (cells < grid.shape)).all(axis=1)
        barred = np.zeros(len(places_m), dtype=np.bool_)
        barred[inside] = self.bars(cells[inside])
        return barred

    def bars(self, cells: IntArray) -> BoolArray:
        """Mask (n,) of cells (n, 2) that are not free, without the margin that the plan omits."""
        at = tuple(cells.T)
        room_m = self.maps.room_m[at]
        omitted = (room_m >= -self.narrowed_m) & (room_m < 0.0)
        return np.asarray(self.maps.occupied[at] & ~omitted)

    def is_within_margin(self, places_m: FloatArray) -> bool:
        """True if one of the places (n, 3) is within an obstacle's margin, or a cell of it."""
        least_m = self.vehicle.radius_m + self.maps.grid.resolution_m
        return bool((obstacle_room_m(self.site, places_m[:, ::2]) < least_m).any())

    def leaves_fence(self, places_m: FloatArray) -> str | None:
        """The autopilot's fence limit that one of the places (n, 3) violates; None: no limit.

        Tolerance: one cell, because cells are inside by their centres.
        """
        if self.fence is None:
            return None
        return self.fence.crossed(places_m[:, ::2], self.maps.grid.resolution_m)

    def carried_m(self, setpoint_m: Vector, aircraft_m: Vector, leash_m: float) -> Vector | None:
        """New setpoint, at rest, when the wind has moved the aircraft by more than `leash_m`.

        It is on the straight line to the aircraft, `leash_m` away, where a setpoint is permitted
        and the line to the aircraft is free. Other places follow: farther ones, then nearer ones,
        at last the aircraft's own. None within `leash_m`, or where no permitted place is nearer.
        """
        setpoint, aircraft = np.array(setpoint_m), np.array(aircraft_m)
        line = setpoint - aircraft
        length_m = float(np.sqrt(line @ line))
        if length_m <= leash_m + TOLERANCE:
            return None
        step_m, from_z_m = 0.5 * self.maps.grid.resolution_m, setpoint_m[2]
        nearer_m = np.arange(leash_m - step_m, 0.0, -step_m)
        at_m = np.concatenate([np.arange(leash_m, length_m, step_m), nearer_m, [0.0]])
        places = aircraft + (at_m / length_m)[:, None] * line
        places[:, 2] = np.maximum(places[:, 2], self._least_m(places[:, 0], from_z_m))
        kept = self._free_lines(places, aircraft, self.site.margin.total_m)
        for place_m in map(vector, places[kept]):
            nearer = math.dist(place_m, aircraft_m) < length_m
            if nearer and self._may_be_carried_to(place_m, from_z_m, self.site.margin.total_m):
                return place_m
        return None

    def is_free_leg(self, start_m: Vector, end_m: Vector) -> bool:
        """True if a straight leg is outside every keep-out, less its margin.

        If it begins in one, it must come no nearer to that obstacle.
        """
        margin_m = self.site.margin.total_m
        return bool(self._free_lines(np.array([end_m]), np.array(start_m), margin_m)[0])

    def is_rest_of_leg_free(self, corners_m: Corridor, from_m: Vector) -> bool:
        """True if the rest of a leg, from a place in its corridor, is outside every keep-out.

        If it begins in one, it must come no nearer to that obstacle.
        """
        rest = list(self._rest_of_leg(corners_m, from_m))
        if distance_m(from_m, tuple(rest)) <= self.corridor_width_m:
            rest[0] = from_m
        less_m = self.narrowed_m + self.corridor_width_m
        return all(
            self._free_lines(np.array([end_m]), np.array(start_m), less_m)[0]
            for start_m, end_m in itertools.pairwise(rest)
        )

    def _rest_of_leg(self, corners_m: Corridor, from_m: Vector) -> Corridor:
        """Corners of a leg from the last one before a place in its corridor; else all of them."""
        while len(corners_m) > 1 and distance_m(from_m, corners_m[1:]) <= self.corridor_width_m:
            corners_m = corners_m[1:]
        return corners_m

    def rechecked(self, leg: CheckedLeg, from_m: Vector) -> CheckedLeg:
        """The leg with its rest, from a place in its corridor, checked on the present obstacles.

        As in a plan, the room of a landing leg is that of its straight part outside the workspace.
        """
        barred, room_m = not self.is_rest_of_leg_free(leg.points_m, from_m), leg.room_m
        rest_m = np.array(self._rest_of_leg(leg.points_m, from_m))[:, ::2].copy()
        outside_m = [self.site.workspace.outside_m((x_m, z_m)) for x_m, z_m in rest_m.tolist()]
        outside = np.flatnonzero(np.array(outside_m) > TOLERANCE)
        if outside.size and not leg.is_entry:
            border_m = rest_m[max(0, outside[0] - 1)]
            room_m = leg_room_m(self.site, self.vehicle, border_m, rest_m[-1])
        rechecked = replace(leg, barred=barred, room_m=room_m)
        return replace(rechecked, barred=not rechecked.has_room(-self.narrowed_m))

    def _free_lines(self, places_m: FloatArray, aircraft_m: FloatArray, less_m: float) -> BoolArray:
        """Mask (n,) of places (n, 3) whose straight line to the aircraft is outside keep-outs.

        less_m: part of keep-outs that may be entered. If the aircraft is in the rest of one, the
        line comes no nearer to that obstacle.
        """
        vertices_m, first, radius_m, keep_out_m = rings(self.site.obstacles)
        least_m = keep_out_m + self.vehicle.radius_m - less_m
        ends_m = np.stack([aircraft_m[::2], *places_m[:, ::2]])
        clear_m = leg_clearances(ends_m, ends_m[0], vertices_m, first, radius_m)
        kept = (clear_m[1:] >= np.minimum(clear_m[0], least_m) - TOLERANCE).all(axis=1)
        return np.asarray(kept & legs_above_ground(self.site, ends_m[1:], ends_m[0]))

    def _least_m(self, x_m: FloatArray, from_z_m: float) -> FloatArray:
        """Minimum heights (...) of a setpoint moved to x (...): the minimum altitude.

        `from_z_m` if that is lower, but with the hull above a profile of the ground.
        """
        space = self.site.workspace
        if space.ground_m:
            ground_m = ground_profile.floor_m(space.ground_m, self.vehicle.radius_m, x_m)
            return np.minimum(space.floor_m(x_m), np.maximum(from_z_m, ground_m))
        return np.minimum(space.floor_m(x_m), from_z_m)

    def keeps_clear(self, place_m: Vector) -> bool:
        """True if a place, anywhere, is outside every keep-out less its margin."""
        return self._may_be_carried_to(place_m, place_m[2], self.site.margin.total_m)

    def _may_be_carried_to(self, place_m: Vector, from_z_m: float, within_m: float) -> bool:
        """True if a place keeps every keep-out, also outside the workspace, and is not too low.

        from_z_m: height before the move. within_m: permitted depth in a keep-out. A return through
        the margin is worse than a stay in the margin.
        """
        x_m, _, z_m = place_m
        if z_m < self._least_m(np.array(x_m), from_z_m):
            return False
        cell = self.maps.grid.cell_of((x_m, z_m))
        if cell is not None and self.maps.room_m[cell] < -within_m - TOLERANCE:
            return False
        room_m = float(obstacle_room_m(self.site, np.array([x_m, z_m])))
        return room_m >= self.vehicle.radius_m - within_m

    def entry_leg(self, place_m: Vector, widened_m: float) -> CheckedLeg | None:
        """Recovery leg from outside the workspace; inside, the straight leg back to the plane.

        Conductors run beside the plane, too: from within a keep-out or its margin the leg leaves
        that first, where it can.
        """
        x_m, y_m, z_m = place_m
        if abs(y_m) > self.vehicle.guidance.recovery_m:
            return None
        points_m, start_m = [vector(point) for point in approach_m(place_m)], (x_m, z_m)
        if self.site.workspace.outside_m(start_m):
            corners_m = recovery_leg(
                self.site, self.vehicle, self.maps, start_m, widened_m, self.fence
            )
            if not corners_m:
                return None
            points_m += [(x_m, 0.0, z_m) for x_m, z_m in corners_m]
        elif not self._may_be_carried_to(place_m, z_m, 0.0):
            anywhere = np.zeros_like(self.maps.room_m)
            end_m = refuge_leg(self.site, self.vehicle, self.maps, start_m, anywhere, widened_m)
            if end_m is not None:
                aside_m = (end_m[0], y_m, end_m[1])
                points_m = [place_m, *map(vector, approach_m(aside_m))]
        return CheckedLeg(points_m=tuple(points_m), room_m=math.inf, is_entry=True)

    def excursion(self, pose: Pose, legs: tuple[CheckedLeg, ...]) -> str | None:
        """Text for an aircraft that is too low, or outside the workspace or plane; None: it is not.

        The tracking tolerance is permitted outside the workspace, and beside a checked leg.
        """
        x_m, y_m, z_m = pose.position_m
        workspace, beside_m = self.site.workspace, self.vehicle.guidance.tracking_hold_m
        low_m = workspace.floor_at_m(x_m)
        outside_m = workspace.outside_m((x_m, z_m))
        if low_m is not None and z_m < low_m - workspace.resolution_m:
            words = f"altitude {coordinate(z_m)} m < {limit_text(low_m)}"
        elif outside_m > beside_m:
            words = f"{distance(outside_m)} m outside the workspace"
        elif abs(y_m) > self.vehicle.guidance.leash_m:
            words = f"{distance(abs(y_m))} m from the plane"
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
        sudden_m: float = 0.0,
    ) -> Refusal | None:
        """Reason to refuse a setpoint; None when the setpoint is permitted.

        widened_m: obstacle inflation for a moving setpoint, less the margin that the plan omits.
        carried_from_z_m: height from which wind has moved the setpoint; at rest, all places that
        wind can reach from there are permitted. None: no wind has moved it. brakes: the setpoint
        comes to rest, which is permitted outside the fence, and on a leg that was barred, too.
        sudden_m: depth beyond the margin in a keep-out at which it may rest.
        """
        widened_m = max(widened_m - self.narrowed_m, -self.site.margin.total_m)
        if any(setpoint.velocity_mps):
            carried_from_z_m = None
            legs = tuple(leg for leg in legs if leg.has_room(widened_m) or (brakes and leg.barred))
            crossed = self.leaves_fence(np.array([setpoint.position_m]))
            if (
                crossed is not None
                and not brakes
                and not any(
                    leg.is_entry
                    and distance_m(setpoint.position_m, leg.points_m) <= self.corridor_width_m
                    for leg in legs
                )
            ):
                return Refusal(f"sp outside {crossed}")
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
            margin_m=self.site.margin.total_m + sudden_m,
            min_altitude_m=self.site.workspace.floor_at_m(x_m) if finite else None,
            corridors_m=tuple(leg.points_m for leg in legs),
            legs_from_beside_m=tuple(leg.points_m for leg in legs if leg.begins_beside),
            corridor_width_m=self.corridor_width_m,
            plane_tolerance_m=plane_tolerance_m,
        )

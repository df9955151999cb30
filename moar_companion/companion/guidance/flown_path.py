"""The flown path: the reference on its trajectory, and the legs that were checked with it. Pure.

Inputs: a flight volume, plans, places. Outputs: the next flown path, limits and stop points of the
path ahead, and the place where a requested plan will begin.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ...planner.free_distance import FreeDistance
from ...planner.plan_values import Plan
from ...planner.site import PlanePoint
from ...types import Vector
from ..estimation.pose import Pose
from ..safety.setpoint_gate import distance_m, distances_m
from .flight_volume import FlightVolume
from .plan_path import CheckedLeg, approach_m, checked_legs, flown, standing, vector
from .splice import Splice
from .tracking import Reference
from .trajectory import FloatArray, PathPoints

_PLANNING_TIME_S = 0.3
"""Time of a plan search, in which the reference moves on; the next plan begins beyond that."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FlownPath:
    """One instant of the path that is flown.

    volume: the flight volume, with the obstacle inflation of the active plan. legs: the checked
    legs near the path; the landing leg is the last. landing_corner: index of the trajectory's
    point where the landing leg begins; None without one. outdated: the plan was made with other
    settings, as speeds.
    """

    volume: FlightVolume
    reference: Reference
    legs: tuple[CheckedLeg, ...] = ()
    landing_corner: int | None = None
    outdated: bool = False

    @classmethod
    def at(cls, volume: FlightVolume, position_m: Vector) -> FlownPath:
        """Returns a path of one place."""
        trajectory = volume.trajectory(standing(position_m))
        return cls(volume=volume, reference=Reference.start(trajectory, position_m))

    @property
    def place_m(self) -> Vector:
        """Position of the setpoint."""
        return vector(self.reference.position_m)

    @property
    def _acceleration_mps2(self) -> float:
        return self.volume.vehicle.guidance.acceleration_mps2

    # The landing leg

    @property
    def on_leg(self) -> bool:
        """True while the reference is on the landing leg."""
        return self._leaves_workspace_by(self.reference.distance_m)

    def _leaves_workspace_by(self, distance_m: float) -> bool:
        """True if the landing leg has begun at a distance along the trajectory."""
        corner = self.landing_corner
        if corner is None:
            return False
        return distance_m >= float(self.reference.trajectory.corner_m[corner])

    def resumed(self, widened_m: float) -> FlownPath | None:
        """Returns the path along the landing leg on which it was braked; None without room.

        Outside the workspace only an escape leg can be planned; the landing leg was checked when
        planned. widened_m: obstacle inflation. None, too, where a jump has moved the setpoint out
        of the leg's corridor.
        """
        stop_m, leg = self.reference.stop_m, self.legs[-1] if self.legs else None
        if leg is None or stop_m is None or not self._leaves_workspace_by(stop_m):
            return None
        if distance_m(self.place_m, leg.points_m) > self.volume.corridor_width_m:
            return None
        widened_m -= self.volume.narrowed_m
        if not leg.has_room(widened_m) or self.volume.leaves_fence(np.array(leg.points_m)):
            return None
        return replace(self, reference=replace(self.reference, stop_m=None))

    def resumed_near_leg(
        self, volume: FlightVolume, pose: Pose, widened_m: float
    ) -> FlownPath | None:
        """Returns the path resumed at an aircraft near its landing leg; None if it is not near.

        The aircraft is outside the workspace, and within the tracking tolerance of the leg. The
        setpoint begins at the aircraft, and moves over to the leg. widened_m: obstacle inflation.
        """
        x_m, _, z_m = pose.position_m
        left = self.legs[-1] if self.on_leg and self.legs else None
        if left is None or not volume.site.workspace.outside_m((x_m, z_m)):
            return None
        reach = self.volume.reach if volume.maps is self.volume.maps else None
        path = self.within(volume.widened(reach, self.volume.narrowed_m))
        volume, trajectory = path.volume, path.reference.trajectory
        there = np.array(pose.position_m)
        apart_m = np.sqrt(((trajectory.position_m - there) ** 2).sum(axis=1))
        nearest = int(apart_m.argmin())
        place_m, distance_m = trajectory.position_m[nearest], float(trajectory.distance_m[nearest])
        leg = volume.rechecked(left, vector(place_m))
        if (
            apart_m[nearest] > volume.vehicle.guidance.tracking_hold_m
            or not self._leaves_workspace_by(distance_m)
            or not leg.has_room(widened_m - volume.narrowed_m)
            or volume.leaves_fence(np.array(leg.points_m))
            or not volume.is_free_leg(pose.position_m, vector(place_m))
        ):
            return None
        approach = CheckedLeg(
            points_m=(pose.position_m, vector(place_m)), room_m=math.inf, is_entry=True
        )
        reference = replace(
            Reference.start(trajectory, pose.position_m),
            distance_m=distance_m,
            offset_m=there - place_m,
        )
        return replace(path, reference=reference, legs=(approach, leg))

    # Outside the workspace

    @property
    def outside_m(self) -> float:
        """Distance of the setpoint outside the workspace, or beside the plane, in metres."""
        x_m, y_m, z_m = self.place_m
        return max(abs(y_m), self.volume.site.workspace.outside_m((x_m, z_m)))

    @property
    def needs_recovery(self) -> bool:
        """True if the setpoint is outside the workspace, or too far beside the plane to plan."""
        x_m, _, z_m = place_m = self.place_m
        beside = len(approach_m(place_m)) > 1
        return beside or self.volume.site.workspace.outside_m((x_m, z_m)) > 0.0

    def recovery(self, widened_m: float) -> FlownPath | None:
        """Returns the recovery leg from the setpoint; None if there is none."""
        leg = self.volume.entry_leg(self.place_m, widened_m)
        return None if leg is None else self._along(leg)

    def leaving(self, end_m: PlanePoint) -> FlownPath:
        """Returns the straight leg, checked before, from the setpoint to a place in the plane."""
        points_m = [*map(vector, approach_m(self.place_m)), (end_m[0], 0.0, end_m[1])]
        return self._along(CheckedLeg(points_m=tuple(points_m), room_m=math.inf, is_entry=True))

    def _along(self, leg: CheckedLeg) -> FlownPath:
        points_m = np.array(leg.points_m)
        speed_mps = self.volume.recovery_speeds_mps(points_m)
        path = PathPoints(position_m=points_m, speed_mps=speed_mps)
        reference = Reference.start(self.volume.trajectory(path), self.place_m)
        return FlownPath(volume=self.volume, reference=reference, legs=(leg,))

    # The path ahead

    def within(self, volume: FlightVolume) -> FlownPath:
        """Returns the same path in another flight volume, which may lower the speed."""
        trajectory = self.reference.trajectory.capped(volume.speed_cap_mps, self._acceleration_mps2)
        return replace(
            self, volume=volume, reference=replace(self.reference, trajectory=trajectory)
        )

    def braked(self) -> FlownPath:
        """Returns the path that ends as soon as the acceleration limit permits."""
        return replace(self, reference=self.reference.braked(self._acceleration_mps2))

    def stopped_at(self, position_m: Vector) -> FlownPath:
        """Returns the path that ends at once at a place that the setpoint has just passed.

        Later plans begin there, on any path; a landing leg is kept within its corridor.
        """
        leg = self.legs[-1] if self.on_leg and self.legs else None
        beside_m = math.inf if leg is None else distance_m(position_m, leg.points_m)
        path = self
        if beside_m > self.volume.corridor_width_m:
            path = replace(FlownPath.at(self.volume, position_m), legs=self.legs)
        return replace(path, reference=path.reference.stopped_at(position_m))

    def leaves_fence(self) -> str | None:
        """The autopilot's fence limit that the path ahead crosses; None: no limit.

        Escape and recovery legs are permitted outside the fence.
        """
        trajectory, end_m = self.reference.trajectory, self.reference.stop_m
        ahead = trajectory.distance_m >= self.reference.distance_m
        if end_m is not None:
            ahead &= trajectory.distance_m <= end_m
        places_m = trajectory.position_m[ahead]
        crossed, width_m = self.volume.leaves_fence(places_m), self.volume.corridor_width_m
        inwards = [leg for leg in self.legs if leg.is_entry]
        if crossed is None or not inwards:
            return crossed
        from_legs_m = [distances_m(places_m, leg.points_m) for leg in inwards]
        return self.volume.leaves_fence(places_m[np.min(from_legs_m, axis=0) > width_m])

    def on_maps(self, volume: FlightVolume) -> FlownPath:
        """Returns the same path on maps with other obstacles, its legs checked on these."""
        legs = tuple(volume.rechecked(leg, self.place_m) for leg in self.legs)
        outdated = self.outdated or volume.vehicle != self.volume.vehicle
        return replace(self.within(volume), legs=legs, outdated=outdated)

    def barred_m(self) -> float | None:
        """Distance along the trajectory of the first place ahead that the maps bar; None: none.

        Places beyond the stop point of a brake count, too. Places in the corridor of a checked leg
        are barred if the leg is.
        """
        trajectory = self.reference.trajectory
        ahead = trajectory.distance_m >= self.reference.distance_m
        places_m, width_m = trajectory.position_m[ahead], self.volume.corridor_width_m
        barred = self.volume.is_barred(places_m)
        for leg in self.legs:
            barred[distances_m(places_m, leg.points_m) <= width_m] = leg.barred
        if not barred.any():
            return None
        return float(trajectory.distance_m[ahead][barred][0])

    def fade_mps(self) -> float:
        """Maximum speed of the setpoint's return to a path that was moved under it."""
        offset, slow_mps = self.reference.offset_m, self.volume.vehicle.speed.min_mps
        length_m = float(np.sqrt(offset @ offset))
        if not length_m:
            return slow_mps
        here, back = self.reference.position_m[None], -offset[None] / length_m
        return min(slow_mps, float(self.volume.speed_cap_mps(here, back)[0]))

    def rest(self) -> tuple[FloatArray, FloatArray]:
        """The points (n, 3) still ahead, and the times (n - 1,) between them, as they are flown."""
        reference = self.reference
        return reference.trajectory.rest(
            reference.distance_m, reference.speed_mps, self._acceleration_mps2
        )

    def rests_ahead_m(self) -> FloatArray:
        """Possible stop points (n, 2) ahead, to the end or brake point."""
        reference = self.reference
        if reference.stop_m is None:
            return self.volume.rests_m(reference.trajectory, reference.distance_m)
        braking = reference.trajectory.between(reference.distance_m, reference.stop_m)
        return self.volume.rests_m(self.volume.trajectory(braking))

    # The next plan

    def junction(self) -> Splice:
        """Start of a plan that is requested now: a point where the reference can still stop."""
        reference = self.reference
        trajectory = reference.trajectory
        if reference.stop_m is not None:
            return Splice(
                trajectory=trajectory,
                joined_m=reference.stop_m,
                position_m=vector(trajectory.at(reference.stop_m)[0]),
                velocity_mps=(0.0, 0.0, 0.0),
            )
        corner = trajectory.corner_after(
            reference.stopping_m(self._acceleration_mps2) + reference.speed_mps * _PLANNING_TIME_S
        )
        joined_m = float(trajectory.corner_m[corner])
        _, direction, speed = trajectory.at(joined_m)
        last = len(trajectory.corner_m) - 1 if self.landing_corner is None else self.landing_corner
        return Splice(
            trajectory=trajectory,
            joined_m=joined_m,
            corner=corner,
            position_m=vector(trajectory.points_m[corner]),
            velocity_mps=vector(speed * direction),
            at_end=corner >= last,
        )

    def junction_at(self, pose: Pose) -> Splice:
        """Start in the plane of a plan for an aircraft off its path, or beside the plane."""
        x_m, _, z_m = pose.position_m
        return Splice(
            trajectory=self.reference.trajectory,
            position_m=(x_m, 0.0, z_m),
            velocity_mps=pose.velocity_mps,
        )

    def points(self, plan: Plan, junction: Splice, escape_m: tuple[PlanePoint, ...]) -> PathPoints:
        """Points of a plan that begins at a junction."""
        return flown(plan, junction.position_m, escape_m, self.volume.leg_speeds_mps)

    def bars(self, plan: Plan, junction: Splice, escape_m: tuple[PlanePoint, ...]) -> bool:
        """True if obstacles of the volume bar a cell or a leg of a plan."""
        if self.volume.bars(plan.states[:, :-1]).any():
            return True
        legs = checked_legs(plan, self.points(plan, junction, escape_m), escape_m)
        return any(self.volume.rechecked(leg, leg.points_m[0]).barred for leg in legs)

    def joined(
        self,
        plan: Plan,
        junction: Splice,
        escape_m: tuple[PlanePoint, ...],
        reach: FreeDistance | None,
        narrowed_m: float,
    ) -> FlownPath | None:
        """Returns the path that changes to a plan at its junction; None: it is too late.

        Returns the path itself if it continues by the plan's points already, and is not outdated.
        reach, narrowed_m: as in `FlightVolume`.
        """
        reference, volume = self.reference, self.volume.widened(reach, narrowed_m)
        if junction.trajectory is not reference.trajectory:
            return None
        points = self.points(plan, junction, escape_m)
        if junction.joined_m is None:
            # The old path is free. The setpoint stays there if it is not at rest yet, or if the
            # line to the new path is not free. The aircraft then returns to it.
            resting = reference.speed_mps <= volume.vehicle.speed.min_mps
            if not resting or not self.volume.free_between(
                reference.position_m, junction.position_m
            ):
                return None
            moved = Reference.start(volume.trajectory(points), self.place_m)
        else:
            joined_m = junction.joined_m
            kept = not self.outdated and narrowed_m <= self.volume.narrowed_m
            if kept and reach == self.volume.reach and junction.is_followed_by(points):
                return self
            stop_m = reference.stopping_m(self._acceleration_mps2)
            end_m = reference.trajectory.length_m if reference.stop_m is None else reference.stop_m
            if joined_m < min(stop_m, end_m):
                return None
            lead_in = junction.trajectory.between(reference.distance_m, joined_m)
            if volume.is_within_margin(lead_in.position_m):
                volume = volume.widened(reach, max(narrowed_m, self.volume.narrowed_m))
            moved = replace(
                reference,
                trajectory=volume.trajectory(points, lead_in),
                distance_m=0.0,
                stop_m=None,
            )
        here, width_m = self.place_m, self.volume.corridor_width_m
        still_in = [leg for leg in self.legs if distance_m(here, leg.points_m) <= width_m]
        landing = plan.landing_leg
        return FlownPath(
            volume=volume,
            reference=moved,
            legs=(*still_in, *checked_legs(plan, points, escape_m)),
            landing_corner=None
            if landing is None
            else len(points.position_m) - 1 - len(landing.points_m),
        )

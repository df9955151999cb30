"""The flight: from plans to the setpoint of this instant, and where the next plan may begin.

A reference moves along a trajectory (`guidance`). Every new plan begins at a point of the present
trajectory that lies beyond the distance in which the reference can stop, so that it can be joined
without a jump whatever the plan turns out to be; what is left of the trajectory leads there. Only
when the aircraft has been pushed off its path does a plan begin at the aircraft, and the setpoint
then moves over to it.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, replace

import numpy as np

from ..frames import PlaneToLocal
from ..guidance.tracking import Reference, advanced, turned
from ..guidance.trajectory import FloatArray, PathPoints, Trajectory, make_trajectory
from ..mission.gate import Corridor, distance_m, refusal
from ..planner.maps import Maps
from ..planner.plan import Plan
from ..site import PlanePoint, Site, Target
from ..types import Mission, Vector
from ..vehicle import Vehicle, YawMode

_PER_CELL = 10
"""Samples of a straight that must be free, for each cell of its length."""
_LEAST_PATH_MPS = 0.1
"""Slower than this the path has no direction to look along."""
_PLANNING_TIME_S = 0.3
"""The reference moves on while a plan is made; the next one begins beyond that."""
_LOOK_FROM_M = 1.0
"""Nearer than this the direction to what is looked at says nothing, and the heading is kept."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """The aircraft in the site's frame (x, y, z); its heading from north."""

    position_m: Vector
    velocity_mps: Vector
    yaw_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Setpoint:
    """What is sent: position and velocity in the site's frame, heading from north."""

    position_m: Vector
    velocity_mps: Vector
    yaw_rad: float


class Adoption(enum.Enum):
    """What became of a plan."""

    NEW_PATH = "its path is flown"
    SAME_PATH = "its path was flown already"
    TOO_LATE = "where it begins cannot be joined any more"


@dataclass(frozen=True, kw_only=True, eq=False)
class Junction:
    """Where a plan that is being made will begin.

    trajectory: what was flown when the plan was asked for; corner: the index of its point; None
    for the aircraft's own place, off the trajectory. at_end: the trajectory ends there, or leaves
    the workspace by its landing leg: there is nothing left to plan better.
    """

    trajectory: Trajectory
    corner: int | None
    position_m: Vector
    velocity_mps: Vector
    at_end: bool = False


class Flight:
    """The reference and everything that moves it."""

    def __init__(self, site: Site, vehicle: Vehicle, maps: Maps, pose: Pose) -> None:
        """The setpoint is where the aircraft is."""
        self._site = site
        self._vehicle = vehicle
        self._maps = maps
        self._plan: Plan | None = None
        self._region_corner: int | None = None
        self._rest_of_leg: PathPoints | None = None
        self._braked = False
        self._corridors_m: tuple[Corridor, ...] = ()
        self._yaw_rad = pose.yaw_rad
        self._reference = Reference.start(
            self._trajectory(_standing(pose.position_m)), pose.position_m
        )

    @property
    def arrived(self) -> bool:
        """Whether the plan's end is reached; where it was braked is not its end."""
        return self._reference.arrived and not self._braked

    @property
    def on_leg(self) -> bool:
        """Whether the reference is on the landing leg."""
        return self._leaves_workspace_by(self._reference.distance_m)

    @property
    def _last_corner(self) -> int:
        """The point of the trajectory at which the planned path, without its landing leg, ends."""
        if self._region_corner is not None:
            return self._region_corner
        return len(self._reference.trajectory.corner_m) - 1

    def _leaves_workspace_by(self, distance_m: float) -> bool:
        """Whether the landing leg has begun at a distance along the trajectory."""
        corner = self._region_corner
        if corner is None:
            return False
        return distance_m >= float(self._reference.trajectory.corner_m[corner])

    def shift(self, jump_m: Vector) -> None:
        """Take the setpoint along with a position that jumped, so that the jump is not chased."""
        reference = self._reference
        self._reference = replace(reference, offset_m=reference.offset_m + np.array(jump_m))

    def error_m(self, pose: Pose) -> float:
        """How far the aircraft is from its setpoint."""
        return math.dist(self._reference.position_m, pose.position_m)

    def brake(self) -> None:
        """Come to rest on the path as soon as the acceleration allows, and stay there."""
        reference = self._reference
        stop_m = min(
            reference.stopping_m(self._vehicle.guidance.acceleration_mps2),
            reference.trajectory.length_m,
        )
        trajectory = reference.trajectory
        braking = trajectory.between(reference.distance_m, stop_m)
        if self._leaves_workspace_by(stop_m):
            self._rest_of_leg = trajectory.between(stop_m, trajectory.length_m)
        self._reference = replace(reference, trajectory=self._trajectory(braking), distance_m=0.0)
        self._braked = True
        self._region_corner = None

    def resume_leg(self) -> bool:
        """Go on along the landing leg on which the flight was braked; False when it was not.

        Outside the workspace nothing can be planned, and the leg was checked when it was.
        """
        rest, reference = self._rest_of_leg, self._reference
        if rest is None:
            return False
        trajectory = reference.trajectory
        braking = trajectory.between(reference.distance_m, trajectory.length_m)
        self._rest_of_leg = None
        self._braked = False
        self._reference = replace(
            reference, trajectory=self._trajectory(rest, braking), distance_m=0.0
        )
        self._region_corner = 0
        return True

    def junction(self) -> Junction:
        """Where a plan that is asked for now will begin: where the reference could still stop."""
        reference = self._reference
        trajectory = reference.trajectory
        corner = trajectory.corner_after(
            reference.stopping_m(self._vehicle.guidance.acceleration_mps2)
            + reference.speed_mps * _PLANNING_TIME_S
        )
        _, direction, speed = trajectory.at(float(trajectory.corner_m[corner]))
        return Junction(
            trajectory=trajectory,
            corner=corner,
            position_m=_vector(trajectory.points_m[corner]),
            velocity_mps=_vector(speed * direction),
            at_end=corner >= self._last_corner,
        )

    def junction_at(self, pose: Pose) -> Junction:
        """The beginning of a plan for an aircraft that has been pushed off its path.

        It is in the plane: an aircraft beside it comes back to it.
        """
        x_m, _, z_m = pose.position_m
        return Junction(
            trajectory=self._reference.trajectory,
            corner=None,
            position_m=(x_m, 0.0, z_m),
            velocity_mps=pose.velocity_mps,
        )

    def adopt(self, plan: Plan, junction: Junction, escape_end_m: PlanePoint | None) -> Adoption:
        """Fly a plan that begins at a junction, if the junction is still ahead."""
        reference = self._reference
        if junction.trajectory is not reference.trajectory:
            return Adoption.TOO_LATE
        path = self._path(plan, junction.position_m, escape_end_m)
        if junction.corner is None:
            # The old path is free: where the way over is not, or the setpoint has not come to
            # rest yet, it stays there, and the aircraft comes back to it.
            resting = reference.speed_mps <= self._vehicle.speed.min_mps
            if not resting or not self._free_between(reference.position_m, junction.position_m):
                return Adoption.TOO_LATE
            moved = Reference.start(self._trajectory(path), _vector(reference.position_m))
        else:
            joined_m = float(junction.trajectory.corner_m[junction.corner])
            remaining = junction.trajectory.points_m[junction.corner :]
            if remaining.shape == path.position_m.shape and (remaining == path.position_m).all():
                self._plan = plan
                return Adoption.SAME_PATH
            stop_m = reference.stopping_m(self._vehicle.guidance.acceleration_mps2)
            if joined_m < min(stop_m, reference.trajectory.length_m):
                return Adoption.TOO_LATE
            moved = replace(
                reference,
                trajectory=self._trajectory(
                    path, junction.trajectory.between(reference.distance_m, joined_m)
                ),
                distance_m=0.0,
            )
        self._enter_corridors(plan, path, escape_end_m)
        self._rest_of_leg = None
        self._braked = False
        self._reference = moved
        self._plan = plan
        self._region_corner = (
            None
            if plan.landing_leg is None
            else len(path.position_m) - 1 - len(plan.landing_leg.points_m)
        )
        return Adoption.NEW_PATH

    def advance(self, pose: Pose, step_s: float) -> None:
        """Move the reference on by one step, as far as the aircraft has kept up."""
        self._reference = advanced(
            self._reference,
            pose.position_m,
            self._vehicle.guidance,
            self._vehicle.speed.min_mps,
            step_s,
        )

    def setpoint(self, pose: Pose, plane: PlaneToLocal, step_s: float) -> Setpoint:
        """The setpoint of this instant, the heading turned by one step (0: kept)."""
        guidance = self._vehicle.guidance
        wanted = self._wanted_yaw_rad(pose, plane)
        if wanted is not None:
            self._yaw_rad = turned(self._yaw_rad, wanted, guidance.yaw_rate_radps * step_s)
        return Setpoint(
            position_m=_vector(self._reference.position_m),
            velocity_mps=_vector(self._reference.velocity_mps),
            yaw_rad=self._yaw_rad,
        )

    def refusal(self, setpoint: Setpoint, plane_tolerance_m: float) -> str | None:
        """Why a setpoint must not be sent; None when it may."""
        x_m, _, z_m = setpoint.position_m
        finite = math.isfinite(x_m) and math.isfinite(z_m)
        return refusal(
            setpoint.position_m,
            setpoint.velocity_mps,
            cell=self._maps.grid.cell_of((x_m, z_m)) if finite else None,
            occupied=self._maps.occupied,
            min_altitude_m=self._site.workspace.min_altitude_m,
            corridors_m=self._corridors_m,
            corridor_width_m=self._maps.grid.resolution_m,
            plane_tolerance_m=plane_tolerance_m,
        )

    def _trajectory(self, path: PathPoints, lead_in: PathPoints | None = None) -> Trajectory:
        return make_trajectory(
            path,
            lead_in=lead_in,
            acceleration_mps2=self._vehicle.guidance.acceleration_mps2,
            rounding_m=0.5 * self._maps.grid.resolution_m,
        )

    def _path(self, plan: Plan, start_m: Vector, escape_end_m: PlanePoint | None) -> PathPoints:
        """A plan's points from where it begins in flight, which is in its first cell.

        Any straight from within a cell to the centre of the next stays in cells that the plan may
        pass; a plan of one state leads to its cell's centre.
        """
        points = _in_space(plan.waypoints.position_m)
        speed = plan.waypoints.speed_mps[1:]
        slow = np.array([self._vehicle.speed.min_mps])
        start = np.array(start_m)[None]
        if escape_end_m is not None or len(points) == 1:
            return PathPoints(
                position_m=np.concatenate([start, points]),
                speed_mps=np.concatenate([slow, speed]),
            )
        return PathPoints(position_m=np.concatenate([start, points[1:]]), speed_mps=speed)

    def _enter_corridors(
        self, plan: Plan, path: PathPoints, escape_end_m: PlanePoint | None
    ) -> None:
        """The checked legs of the new plan, and those that the setpoint is still in."""
        here = _vector(self._reference.position_m)
        width_m = self._maps.grid.resolution_m
        kept = tuple(leg for leg in self._corridors_m if distance_m(here, leg) <= width_m)
        points = [_vector(point) for point in path.position_m]
        escape = () if escape_end_m is None else (tuple(points[:2]),)
        landing: tuple[Corridor, ...] = ()
        if plan.landing_leg is not None:
            landing = (tuple(points[-1 - len(plan.landing_leg.points_m) :]),)
        self._corridors_m = (*kept, *escape, *landing)

    def _free_between(self, start_m: FloatArray, end_m: Vector) -> bool:
        """Whether the setpoint may move straight from one place to another: in free cells only."""
        grid = self._maps.grid
        line = np.array(end_m) - start_m
        samples = 2 + math.ceil(float(np.sqrt(line @ line)) / grid.resolution_m * _PER_CELL)
        for part in np.linspace(0.0, 1.0, samples):
            x_m, _, z_m = _vector(start_m + part * line)
            cell = grid.cell_of((x_m, z_m))
            if cell is None or self._maps.occupied[cell]:
                return False
        return True

    def _wanted_yaw_rad(self, pose: Pose, plane: PlaneToLocal) -> float | None:
        """Where the nose should point; None to keep the heading."""
        guidance = self._vehicle.guidance
        if guidance.yaw_mode is YawMode.FIXED:
            return guidance.fixed_yaw_rad
        plan = self._plan
        if plan is None:
            return None
        if guidance.yaw_mode is YawMode.PATH:
            direction = _vector(self._reference.velocity_mps)
            return _yaw_rad(direction, plane, _LEAST_PATH_MPS)
        x_m, y_m, _ = pose.position_m
        target = self._target(plan)
        if target is None:
            end = plan.waypoints.position_m[-1]
            return _yaw_rad((float(end[0]) - x_m, -y_m, 0.0), plane, _LOOK_FROM_M)
        if self.arrived and target.yaw_deg is not None:
            return math.radians(target.yaw_deg)
        look_at = target.look_at_m or target.position_m
        return _yaw_rad((look_at[0] - x_m, -y_m, 0.0), plane, _LOOK_FROM_M)

    def _target(self, plan: Plan) -> Target | None:
        """The target of an inspection's plan."""
        if plan.mission is not Mission.INSPECTION:
            return None
        return self._site.target(str(plan.request.target))


def _standing(position_m: Vector) -> PathPoints:
    """A path of one point."""
    return PathPoints(position_m=np.array(position_m)[None], speed_mps=np.zeros(0))


def _in_space(points_m: FloatArray) -> FloatArray:
    """Points (n, 2) of the plane as (n, 3) of the site's frame."""
    return np.stack([points_m[:, 0], np.zeros(len(points_m)), points_m[:, 1]], axis=1)


def _yaw_rad(direction: Vector, plane: PlaneToLocal, least: float) -> float | None:
    """The heading of a direction in the site's frame; None where it is shorter than `least`."""
    if math.hypot(direction[0], direction[1]) < least:
        return None
    north, east, _ = plane.velocity_to_ned(direction)
    return math.atan2(east, north)


def _vector(values: FloatArray) -> Vector:
    return float(values[0]), float(values[1]), float(values[2])

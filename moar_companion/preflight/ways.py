"""The ways of a site: what every mission would fly from rest at its targets. Pure.

Inputs: a planner, what the autopilot does when the companion is lost. Outputs: plans, how long they
take to fly, and why nobody should die on them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..errors import InputError
from ..planner import geometry
from ..planner.grid import TOLERANCE
from ..planner.plan import Plan, PlanStatus
from ..planner.planner import Planner
from ..planner.regions import goal_region
from ..service.airspace import Airspace
from ..service.flight import Flight
from ..service.loss import Loss
from ..service.motion import Pose
from ..site import Obstacle, PlanePoint, Site
from ..types import AutopilotKind, Mission, Vector
from ..vehicle import Vehicle

_STEP_S = 0.1
"""Of a flight that is tried."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Way:
    """One way of a mission from rest; name: to people who know its target."""

    name: str
    mission: Mission
    start_m: PlanePoint
    plan: Plan

    def flown_s(self, planner: Planner) -> float:
        """How long it takes in still air, landing leg included; 0 without a plan.

        Flown by an aircraft that never falls behind its setpoint, with an autopilot as it comes: a
        plan's own duration knows nothing of how the vehicle gathers speed and brakes.
        """
        if self.plan.status is not PlanStatus.FOUND:
            return 0.0
        loss = Loss.of(planner.vehicle.autopilot or AutopilotKind.PX4, {})
        assert loss is not None  # of these two kinds
        flight, pose = self._flight(planner, loss)
        flight.adopt(self.plan, flight.junction_at(pose), ())
        steps = 0
        while not flight.arrived:
            flight.advance(pose, _STEP_S)
            pose = replace(pose, position_m=flight.progress(pose).setpoint.position_m)
            steps += 1
        return steps * _STEP_S

    def objection(self, planner: Planner, loss: Loss, home_m: Vector | None) -> str | None:
        """Why nobody should die on it, as the service says it; None when all is well."""
        if self.plan.status is not PlanStatus.FOUND:
            return None
        flight, pose = self._flight(planner, loss)
        rests_m = flight.rests_m(self.plan, flight.junction_at(pose), ())
        lag = loss.lag(planner.vehicle.guidance.acceleration_mps2)
        return lag or loss.objection(planner.maps.reach, rests_m, home_m)

    def _flight(self, planner: Planner, loss: Loss) -> tuple[Flight, Pose]:
        """A flight that has not begun, and where."""
        x_m, z_m = self.start_m
        pose = Pose(position_m=(x_m, 0.0, z_m), velocity_mps=(0.0, 0.0, 0.0), yaw_rad=0.0)
        site, vehicle, maps = planner.site, planner.vehicle, planner.maps
        return Flight(Airspace(site=site, vehicle=vehicle, maps=maps, loss=loss), pose), pose


def ways_of(planner: Planner) -> dict[str, list[Way]]:
    """By the names of targets where the vehicle can be: the ways out, and that from the one before.

    The first target's is from the start, if the vehicle can be there.
    """
    site = planner.site
    ways_out = [mission for mission in site.landing_m if unseen(planner, mission) is None]
    before = None if place_problem(planner, site.start_m) else ("the start", site.start_m)
    ways: dict[str, list[Way]] = {}
    for target in site.targets:
        place_m = target.position_m
        if place_problem(planner, place_m) is not None:
            continue
        trips: list[tuple[str, Mission, PlanePoint, str | None]] = [
            (mission.value, mission, place_m, None) for mission in ways_out
        ]
        if before is not None:
            name, start_m = before
            trips.append((f"from {name}", Mission.INSPECTION, start_m, target.name))
        ways[target.name] = [
            Way(
                name=name,
                mission=mission,
                start_m=start_m,
                plan=planner.plan(mission=mission, target=goal, start=start_m),
            )
            for name, mission, start_m, goal in trips
        ]
        before = (target.name, place_m)
    return ways


def unseen(planner: Planner, mission: Mission, index: int | None = None) -> str | None:
    """What keeps a landing point, or all of a mission (None), from being reached."""
    try:
        goal_region(planner.site, planner.vehicle, planner.maps, mission, index)
    except InputError as error:
        return error.problem
    return None


def place_problem(planner: Planner, point_m: PlanePoint) -> str | None:
    """What is wrong with a place where the vehicle should be; None: nothing."""
    grid, space = planner.maps.grid, planner.site.workspace
    cell = grid.cell_of(point_m)
    if cell is None:
        (x_low, z_low), (x_high, z_high) = grid.lower_m, grid.upper_m
        return f"outside the workspace (x {x_low:g} to {x_high:g}, z {z_low:g} to {z_high:g})"
    if not planner.maps.occupied[cell]:
        return None
    # A cell is occupied by its centre, of which the point in it is up to half a cell away.
    x_m, z_m = grid.centre_m(cell)
    if space.min_altitude_m is not None and z_m < space.min_altitude_m:
        return f"below workspace.min_altitude_m ({space.min_altitude_m:g})"
    return too_near(planner, point_m) or too_near(planner, (x_m, z_m)) or "occupied"


def requirement(site: Site, vehicle: Vehicle, obstacle: Obstacle) -> str:
    """What the distance from an obstacle is made of, in words."""
    parts = [f"vehicle radius {vehicle.radius_m:g}"]
    own_m = obstacle.keep_out_m - site.margin.total_m
    if own_m > TOLERANCE:
        parts.append(f"keep_out_m {own_m:.4g}")
    if site.margin.total_m:
        parts.append(str(site.margin))
    return ", ".join(parts)


def too_near(planner: Planner, point_m: PlanePoint) -> str | None:
    """The first obstacle that a place is too near to, with the distances."""
    for obstacle in planner.site.obstacles:
        distance_m = float(geometry.obstacle_distance_m(obstacle, np.array(point_m)))
        required_m = planner.vehicle.radius_m + obstacle.keep_out_m
        if distance_m < required_m:
            return (
                f"{distance_m:.2f} m from {obstacle.name}, must be at least {required_m:.2f} m "
                f"({requirement(planner.site, planner.vehicle, obstacle)})"
            )
    return None

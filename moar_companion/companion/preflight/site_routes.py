"""Routes of a site: the flight of every mission from rest at its targets. Pure.

Inputs: a planner, the autopilot's offboard-loss action. Outputs: plans, their flight times, and
reasons against an offboard loss on them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...errors import InputError
from ...mavlink.autopilots import PROFILES, profile
from ...mavlink.autopilots.offboard_loss import OffboardLoss
from ...mavlink.autopilots.parameter_names import Parameters
from ...planner import geometry
from ...planner.grid import TOLERANCE
from ...planner.plan_values import Plan, PlanStatus
from ...planner.planner import Planner
from ...planner.regions import goal_region
from ...planner.site import Obstacle, PlanePoint, Site
from ...risk.power import PowerModel
from ...settings.vehicle import Vehicle
from ...types import Mission, Vector
from ..estimation.pose import Pose
from ..guidance.flight_volume import FlightVolume
from ..guidance.path_follower import PathFollower
from ..safety.failsafe_paths import loss_objection

_STEP_S = 0.1
"""Time step of a simulated flight."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SiteRoute:
    """Route of a mission from rest; name: without the target."""

    name: str
    mission: Mission
    start_m: PlanePoint
    plan: Plan

    def flown_s(self, planner: Planner) -> float:
        """Flight time in still air, landing leg included; 0 without a plan.

        For an aircraft that never falls behind its setpoint, with default autopilot parameters: a
        plan's own duration ignores the vehicle's acceleration and braking. Where the vehicle file
        names no autopilot, the longest time with any.
        """
        if self.plan.status is not PlanStatus.FOUND:
            return 0.0
        kind = planner.vehicle.autopilot
        autopilots = PROFILES.values() if kind is None else (profile(kind),)
        losses = (item.offboard_loss(Parameters(item.parameters.defaults)) for item in autopilots)
        return max(self._flown_s(planner, loss) for loss in losses if loss is not None)

    def energy_wh(self, planner: Planner, power: PowerModel) -> float:
        """Energy of the flight in this time, by the powers of the vehicle file."""
        waypoints = self.plan.waypoints
        planned_s = np.diff(waypoints.time_s)
        longer_s = self.flown_s(planner) - float(planned_s.sum())
        return power.path_wh(waypoints.position_m, planned_s) + power.hover_wh(longer_s)

    def _flown_s(self, planner: Planner, loss: OffboardLoss) -> float:
        flight, pose = self._flight(planner, loss)
        flight.adopt(self.plan, flight.path.junction_at(pose), ())
        steps = 0
        while not flight.arrived:
            flight.advance(pose, _STEP_S)
            pose = replace(pose, position_m=flight.progress(pose).setpoint.position_m)
            steps += 1
        return steps * _STEP_S

    def objection(self, planner: Planner, loss: OffboardLoss, home_m: Vector | None) -> str | None:
        """Reason against an offboard loss on it, as the service reports it; None if it is safe."""
        if self.plan.status is not PlanStatus.FOUND:
            return None
        flight, pose = self._flight(planner, loss)
        rests_m = flight.rests_m(self.plan, flight.path.junction_at(pose), ())
        lag = loss.lag(planner.vehicle.guidance.acceleration_mps2)
        return lag or loss_objection(loss, planner.maps.reach, rests_m, home_m)

    def _flight(self, planner: Planner, loss: OffboardLoss) -> tuple[PathFollower, Pose]:
        """Returns a flight that has not begun, and the pose at its start."""
        x_m, z_m = self.start_m
        pose = Pose(position_m=(x_m, 0.0, z_m), velocity_mps=(0.0, 0.0, 0.0), yaw_rad=0.0)
        site, vehicle, maps = planner.site, planner.vehicle, planner.maps
        return PathFollower(
            FlightVolume(site=site, vehicle=vehicle, maps=maps, loss=loss), pose
        ), pose


def routes_of(planner: Planner) -> dict[str, list[SiteRoute]]:
    """By names of reachable targets: escape routes, and the route from the target before.

    The first target's is from the start, if the vehicle can be there.
    """
    site = planner.site
    escape_routes = [mission for mission in site.landing_m if unseen(planner, mission) is None]
    before = None if place_problem(planner, site.start_m) else ("the start", site.start_m)
    routes: dict[str, list[SiteRoute]] = {}
    for target in site.targets:
        place_m = target.position_m
        if place_problem(planner, place_m) is not None:
            continue
        trips: list[tuple[str, Mission, PlanePoint, str | None]] = [
            (mission.value, mission, place_m, None) for mission in escape_routes
        ]
        if before is not None:
            name, start_m = before
            trips.append((f"from {name}", Mission.INSPECTION, start_m, target.name))
        routes[target.name] = [
            SiteRoute(
                name=name,
                mission=mission,
                start_m=start_m,
                plan=planner.plan(mission=mission, target=goal, start=start_m),
            )
            for name, mission, start_m, goal in trips
        ]
        before = (target.name, place_m)
    return routes


def unseen(planner: Planner, mission: Mission, index: int | None = None) -> str | None:
    """Reason why a landing point, or all of a mission (None), cannot be reached; None if it can."""
    try:
        goal_region(planner.site, planner.vehicle, planner.maps, mission, index)
    except InputError as error:
        return error.problem
    return None


def place_problem(planner: Planner, point_m: PlanePoint) -> str | None:
    """Reason why the vehicle cannot be at a place; None if it can."""
    grid, space = planner.maps.grid, planner.site.workspace
    cell = grid.cell_of(point_m)
    if cell is None:
        (x_low, z_low), (x_high, z_high) = grid.lower_m, grid.upper_m
        return f"outside the workspace (x {x_low:g} to {x_high:g}, z {z_low:g} to {z_high:g})"
    if not planner.maps.occupied[cell]:
        return None
    # A cell is occupied by its centre, up to half a cell away from a point in it.
    x_m, z_m = grid.centre_m(cell)
    low_m = space.floor_at_m(x_m)
    if low_m is not None and z_m < low_m:
        above = f" above the ground: z = {low_m:.1f}" if space.ground_m else ""
        return f"below workspace.min_altitude_m ({space.min_altitude_m:g}{above})"
    return too_near(planner, point_m) or too_near(planner, (x_m, z_m)) or "occupied"


def requirement(site: Site, vehicle: Vehicle, obstacle: Obstacle) -> str:
    """Text about the parts of the distance from an obstacle."""
    parts = [f"vehicle radius {vehicle.radius_m:g}"]
    own_m = obstacle.keep_out_m - site.margin.total_m
    if own_m > TOLERANCE:
        parts.append(f"keep_out_m {own_m:.4g}")
    if site.margin.total_m:
        parts.append(str(site.margin))
    return ", ".join(parts)


def too_near(planner: Planner, point_m: PlanePoint) -> str | None:
    """Text about the first obstacle that is too near to a place, with the distances."""
    for obstacle in planner.site.obstacles:
        distance_m = float(geometry.obstacle_distance_m(obstacle, np.array(point_m)))
        required_m = planner.vehicle.radius_m + obstacle.keep_out_m
        if distance_m < required_m:
            return (
                f"{distance_m:.2f} m from {obstacle.name}, must be at least {required_m:.2f} m "
                f"({requirement(planner.site, planner.vehicle, obstacle)})"
            )
    return None

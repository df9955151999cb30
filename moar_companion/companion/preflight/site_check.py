"""Check of site and vehicle before the flight: values in, findings out. Pure.

Beyond errors that make a file unreadable: places without a possible flight, missing routes, cells
too coarse for their keep-outs, missions that cannot be ordered.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ...mavlink.autopilots import profile
from ...planner.grid import TOLERANCE
from ...planner.plan_values import PlanStatus
from ...planner.planner import Planner
from ...planner.site import Obstacle, PlanePoint
from ...risk.power import PowerModel
from ...risk.power.model import S_PER_H
from ...settings.vehicle import Vehicle
from ...types import Mission
from ..error_margin import measured_margin
from .findings import Finding, Level
from .site_routes import SiteRoute, place_problem, routes_of, too_near, unseen

_LARGE_BYTES = 500_000_000
"""Number of cells that is too many for a companion computer of 4 GB."""
_LOST_SHARE = 0.5
"""Fraction of a required clearance that may be lost between two cells."""
_BURIED_M = 0.5
"""Depth of a landing point in a profile of the ground beyond the error of a survey."""
_ENDURANCE_SHARE = 0.8
"""Fraction for the flight; the rest is for take-off and landing, the wind and waiting."""


def site_findings(planner: Planner) -> list[Finding]:
    """Returns all findings on a site and a vehicle, as the planner has them."""
    return [
        *_shifts(planner),
        _size(planner),
        _speed(planner),
        *_obstacles(planner),
        _margin(planner),
        *_ground(planner),
        _start(planner),
        *_landings(planner),
        *_targets(planner),
    ]


def _shifts(planner: Planner) -> Iterator[Finding]:
    """Names the shifts of the frame: the site stands elsewhere than it was surveyed."""
    for shift in planner.site.shifts:
        yield Finding(level=Level.NOTE, subject="frame", text=f"moved {shift}")


def _size(planner: Planner) -> Finding:
    grid = planner.maps.grid
    columns, rows = grid.shape
    arrays = [*vars(planner.maps).values(), *(getattr(planner.graph, n) for n in _GRAPH_ARRAYS)]
    size = sum(array.nbytes for array in arrays if isinstance(array, np.ndarray))
    text = (
        f"{columns} x {rows} cells of {grid.resolution_m:g} m, maps of {size * 1e-6:.0f} MB, "
        f"{planner.maps.occupied.mean():.0%} of it occupied"
    )
    if size > _LARGE_BYTES:
        remedy = "a coarser resolution_m or a smaller workspace plans faster, in less memory"
        return Finding(level=Level.WARNING, subject="workspace", text=text, remedy=remedy)
    return Finding(level=Level.OK, subject="workspace", text=text)


def _speed(planner: Planner) -> Finding:
    """Checks the vehicle's greatest speed against the room of the site."""
    vehicle, grid = planner.vehicle, planner.maps.grid
    speed_mps, acceleration_mps2 = vehicle.speed.max_mps, vehicle.guidance.acceleration_mps2
    stopping_m = 0.5 * speed_mps**2 / acceleration_mps2
    text = f"up to {speed_mps:g} m/s, stops within {stopping_m:.1f} m at {acceleration_mps2:g} m/s2"
    if 2.0 * stopping_m > max(grid.shape) * grid.resolution_m:
        return Finding(
            level=Level.NOTE, subject="speed", text=f"{text}, never reached on this site"
        )
    return Finding(level=Level.OK, subject="speed", text=text)


_GRAPH_ARRAYS = ("allowed", "safety", "speed")


def _obstacles(planner: Planner) -> Iterator[Finding]:
    """Checks the clearance of each obstacle against the cells."""
    vehicle, resolution_m = planner.vehicle, planner.maps.grid.resolution_m
    for obstacle in planner.site.obstacles:
        required_m = vehicle.radius_m + obstacle.keep_out_m
        least_m = _least_between_cells_m(obstacle, required_m, resolution_m)
        if least_m < _LOST_SHARE * required_m:
            yield Finding(
                level=Level.NO_GO,
                subject=f"obstacle {obstacle.name}",
                text=f"required clearance {required_m:g} m, between two cells of "
                f"{resolution_m:g} m it may be {least_m:.2f} m",
                remedy="set workspace.resolution_m finer, or keep_out_m of the obstacle greater",
            )


def _ground(planner: Planner) -> Iterator[Finding]:
    """Checks a profile of the ground: above it the minimum altitude is all that is kept."""
    space, margin = planner.site.workspace, planner.site.margin
    if not space.ground_m or space.min_altitude_m is None:
        return
    heights_m = [z_m for _, z_m in space.ground_m]
    text = f"z {min(heights_m):g} to {max(heights_m):g}, {space.min_altitude_m:g} m kept above it"
    needed_m = planner.vehicle.radius_m + margin.total_m
    if space.min_altitude_m >= needed_m - TOLERANCE:
        yield Finding(level=Level.OK, subject="ground", text=text)
        return
    yield Finding(
        level=Level.WARNING,
        subject="ground",
        text=f"{text}, less than hull and margin ({needed_m:.2f} m)",
        remedy="set workspace.min_altitude_m higher where the ground rises beside the path",
    )


def _margin(planner: Planner) -> Finding:
    """Checks the margin beyond keep-outs against the measured need of the autopilot."""
    vehicle, margin = planner.vehicle, planner.site.margin
    measured, autopilot = measured_margin(vehicle.autopilot), profile(vehicle.autopilot)
    stray_m = vehicle.guidance.acceleration_mps2 * autopilot.stray_s2
    measured = replace(measured, tracking_m=max(measured.tracking_m, stray_m))
    text = f"{margin.total_m:.2f} m beyond every keep_out_m: {margin}"
    if margin.position_m >= measured.position_m and margin.tracking_m >= measured.tracking_m:
        return Finding(level=Level.OK, subject="margin", text=text)
    return Finding(
        level=Level.WARNING,
        subject="margin",
        text=f"{text}; to be expected of {autopilot.name}: {measured}",
        remedy="set less only if it was measured in flight, for example with RTK: "
        "supervision.position_uncertainty_m, guidance.tracking_margin_m of the vehicle",
    )


def _least_between_cells_m(obstacle: Obstacle, required_m: float, resolution_m: float) -> float:
    """Least clearance on a diagonal between free cells, whose centres have the required one."""
    half_diagonal_squared = 0.5 * resolution_m**2
    across = (obstacle.radius_m + required_m) ** 2 - half_diagonal_squared
    return max(0.0, math.sqrt(max(0.0, across)) - obstacle.radius_m)


def _start(planner: Planner) -> Finding:
    point = planner.site.start_m
    problem = place_problem(planner, point)
    if problem is None:
        return Finding(level=Level.OK, subject="start", text=_shown(point))
    return Finding(
        level=Level.WARNING,
        subject="start",
        text=f"{_shown(point)} is {problem}",
        remedy="move it: `plan` begins there; a flight begins at the vehicle's position",
    )


def _landings(planner: Planner) -> Iterator[Finding]:
    for mission in (Mission.EXIT, Mission.EVACUATION):
        points = planner.site.landing_m.get(mission, ())
        subject = f"landing {mission.value}"
        if not points:
            yield Finding(
                level=Level.WARNING,
                subject=subject,
                text="no landing points",
                remedy=f"add landing.{mission.value}: without it no {mission.value} can be ordered",
            )
        for index, point in enumerate(points):
            problem = (
                _buried(planner, point)
                or too_near(planner, point)
                or unseen(planner, mission, index)
            )
            if problem is None:
                yield Finding(level=Level.OK, subject=f"{subject} {index}", text=_shown(point))
            else:
                yield Finding(
                    level=Level.NO_GO,
                    subject=f"{subject} {index}",
                    text=f"{_shown(point)} {problem}",
                    remedy="move or remove the landing point",
                )


def _buried(planner: Planner, point_m: PlanePoint) -> str | None:
    """Text for a landing point that is below the profile of the ground; None if it is not."""
    space = planner.site.workspace
    below_m = space.ground_at_m(point_m[0]) - point_m[1]
    if not space.ground_m or below_m < _BURIED_M:
        return None
    return f"is {below_m:.1f} m below the ground"


def _targets(planner: Planner) -> Iterator[Finding]:
    """Checks each target: its place, and every mission to it and from it."""
    site = planner.site
    if not site.targets:
        yield Finding(
            level=Level.WARNING,
            subject="targets",
            text="none",
            remedy="add targets: without them no inspection can be ordered",
        )
    routes = routes_of(planner)
    visits_s = escape_route_s = 0.0
    for target in site.targets:
        subject, point = f"target {target.name}", target.position_m
        problem = place_problem(planner, point)
        if problem is not None:
            yield Finding(
                level=Level.NO_GO,
                subject=subject,
                text=f"{_shown(point)} is {problem}",
                remedy="move the target or the obstacle",
            )
            continue
        times_s = {route: route.flown_s(planner) for route in routes[target.name]}
        yield _routes(subject, times_s)
        visits_s += target.hold_s + sum(
            time_s for route, time_s in times_s.items() if route.mission.visits_targets
        )
        escape_route_s = max(
            (time_s for route, time_s in times_s.items() if not route.mission.visits_targets),
            default=0.0,
        )
    if site.targets:
        yield _endurance(visits_s + escape_route_s, planner.vehicle)


def _routes(subject: str, times_s: dict[SiteRoute, float]) -> Finding:
    """Checks the routes to and from a target. times_s: flight time of each route."""
    lost = [route.name for route in times_s if route.plan.status is not PlanStatus.FOUND]
    if lost:
        return Finding(
            level=Level.NO_GO,
            subject=subject,
            text=f"no free path: {', '.join(lost)}",
            remedy="check the obstacles; a smaller keep_out_m or finer resolution_m may help",
        )
    times = ", ".join(f"{route.name} {time_s:.0f} s" for route, time_s in times_s.items())
    metrics = [route.plan.metrics for route in times_s if route.plan.metrics is not None]
    least_m = min((item.min_clearance_m for item in metrics), default=math.inf)
    clear = "" if math.isinf(least_m) else f", {least_m:.1f} m from obstacles at least"
    return Finding(level=Level.OK, subject=subject, text=f"{times or 'no routes'}{clear}")


def _endurance(flown_s: float, vehicle: Vehicle) -> Finding:
    power = PowerModel.of(vehicle)
    endurance_s = power.capacity_wh / power.hover_w * S_PER_H
    text = (
        f"all targets in turn and the exit take {flown_s:.0f} s, and a full battery lasts "
        f"{endurance_s:.0f} s"
    )
    if flown_s > min(_ENDURANCE_SHARE * endurance_s, endurance_s - power.reserve_s):
        keys = "power.capacity_wh and hover_w" if power.capacity_known else "risk.endurance_s"
        remedy = (
            f"inspect them in more than one flight, with {power.reserve_s:g} s left of each, or "
            f"correct {keys}"
        )
        return Finding(level=Level.WARNING, subject="flight time", text=text, remedy=remedy)
    return Finding(level=Level.OK, subject="flight time", text=text)


def _shown(point_m: PlanePoint) -> str:
    return f"({point_m[0]:g}, {point_m[1]:g})"

"""Legs from where nothing is planned to a free cell: the escape leg and the recovery leg.

A gust, a low take-off or a new obstacle can leave the vehicle where nothing is planned. The escape
leg is the shortest straight one to a free cell along which the clearance never decreases (planner
page, "Starts in flight"); it is flown at v_MIN or below. The recovery leg leads a vehicle that a
wind has carried out of the workspace back: the shortest straight one to a free cell that keeps
every keep-out. Both may begin outside the autopilot's fence, and never lead out of it.
"""

from __future__ import annotations

import numpy as np

from ..site import PlanePoint, Site
from ..vehicle import Vehicle
from .fence import PlaneFence
from .geometry import rings
from .grid import TOLERANCE, FloatArray
from .legs import leg_clearances
from .maps import Maps
from .regions import obstacle_clearance_m

_SAMPLES_PER_CELL = 10
_REACH_M = 10.0
"""An aircraft that is farther from any free cell is not near the structure at all."""
_BATCH = 64
"""Legs that are looked at together, the shortest first."""


def escape_leg(site: Site, maps: Maps, start_m: PlanePoint) -> PlanePoint | None:
    """The centre of the free cell at the end of the escape leg; None if there is no such leg."""
    start = np.array(start_m)
    here = float(obstacle_clearance_m(site, start))
    if here <= 0.0:
        return None
    grid = maps.grid
    cells = np.argwhere(~maps.occupied)
    centres = np.array(grid.lower_m) + (cells + 0.5) * grid.resolution_m
    distance = np.hypot(*(centres - start).T)
    near = np.flatnonzero(distance <= _REACH_M)
    for index in near[np.argsort(distance[near], kind="stable")]:
        places_m = _samples(maps, start, centres[index])
        clearance = obstacle_clearance_m(site, places_m)
        # Infinite without obstacles: then nothing decreases.
        away = (clearance[1:] >= clearance[:-1] - TOLERANCE).all()
        if away and _stays_inside(maps.fence, places_m):
            return float(centres[index, 0]), float(centres[index, 1])
    return None


def recovery_leg(
    site: Site,
    vehicle: Vehicle,
    maps: Maps,
    start_m: PlanePoint,
    widened_m: float = 0.0,
    fence: PlaneFence | None = None,
) -> PlanePoint | None:
    """The centre of the free cell at the end of the recovery leg; None if there is no such leg.

    start_m: outside the workspace, no farther than `recovery_m`, and not below it. Where it is
    within the margin of an obstacle, the leg comes no nearer to that one.
    widened_m: what the distance from obstacles grows by. fence: where the maps are without one.
    """
    workspace, low_m = site.workspace, site.workspace.min_altitude_m
    if start_m[1] < workspace.lower_m[1]:
        return None  # a low take-off
    if not 0.0 < workspace.outside_m(start_m) <= vehicle.guidance.recovery_m:
        return None
    if low_m is not None and start_m[1] < low_m:
        return None
    grid, start = maps.grid, np.array(start_m)
    cells = np.argwhere(~maps.occupied & (maps.room_m >= widened_m))
    centres = np.array(grid.lower_m) + (cells + 0.5) * grid.resolution_m
    fence = fence or maps.fence
    if fence is not None:
        centres = centres[fence.holds(centres)]
    nearest = np.argsort(np.hypot(*(centres - start).T), kind="stable")
    vertices_m, first, radius_m, keep_out_m = rings(site.obstacles)
    own_m = keep_out_m + vehicle.radius_m - site.margin.total_m
    needed_m = own_m + site.margin.total_m + widened_m
    at_start_m = leg_clearances(start[None], start, vertices_m, first, radius_m)[0]
    begun_m = np.maximum(own_m, at_start_m)
    for begin in range(0, len(nearest), _BATCH):
        ends = centres[nearest[begin : begin + _BATCH]]
        clear_m = leg_clearances(ends, start, vertices_m, first, radius_m)
        free = (clear_m >= np.minimum(needed_m, begun_m) - TOLERANCE).all(axis=1)
        for end in ends[free]:
            if _stays_inside(fence, _samples(maps, start, end)):
                return float(end[0]), float(end[1])
    return None


def _samples(maps: Maps, start_m: FloatArray, end_m: FloatArray) -> FloatArray:
    """Points (n, 2) along a straight leg, several in each cell."""
    length_m = float(np.hypot(*(end_m - start_m)))
    count = 2 + int(length_m / maps.grid.resolution_m * _SAMPLES_PER_CELL)
    along: FloatArray = start_m + np.linspace(0.0, 1.0, count)[:, None] * (end_m - start_m)
    return along


def _stays_inside(fence: PlaneFence | None, places_m: FloatArray) -> bool:
    """Returns whether a way through places (n, 2) never leads out of the autopilot's fence."""
    if fence is None:
        return True
    inside = fence.holds(places_m)
    return bool((inside[1:] >= inside[:-1]).all())

"""Goal regions of exit and evacuation, and the legs that lead from them to a landing point.

Source: paper, Section IV-B (grid edges visible from the landing point). What the paper leaves open:
the straight leg from a cell's outer edge to the landing point decides visibility. The flown leg
ends at rest above that point; it, too, must clear every obstacle, down to the landing point.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from ..settings.vehicle import Vehicle
from ..types import Mission
from . import geometry
from .graph import elevation_speed_mps
from .grid import TOLERANCE, BoolArray, FloatArray, IntArray
from .legs import leg_clearances
from .maps import Maps, speed_limit_mps
from .site import PlanePoint, Site

Cell = tuple[int, int]


@dataclass(frozen=True, kw_only=True, eq=False)
class LandingLeg:
    """The leg from a region cell's centre, over its outer edge, to above a landing point.

    points_m:  (n, 2)  at most one cell apart, without the cell's centre
    speed_mps: (n,)    on the way to each point; the last point is reached and held at rest
    room_m:            from the hull to the border of the nearest keep-out, outside the region's
                       cell; inf without any
    """

    landing_index: int
    length_m: float
    points_m: FloatArray
    speed_mps: FloatArray
    clearance_m: FloatArray
    """(n,) d_obs of each point."""
    room_m: float


@dataclass(frozen=True, kw_only=True, eq=False)
class GoalRegion:
    """The cells in which an exit or evacuation ends, each with its landing leg's corners.

    mask: (nx, nz); corners: per cell the landing point's index and the points of its leg;
    length_m: per cell that of its leg.
    """

    mask: BoolArray
    corners: Mapping[Cell, tuple[int, FloatArray]]
    length_m: Mapping[Cell, float]


def goal_region(
    site: Site, vehicle: Vehicle, maps: Maps, mission: Mission, landing: int | str | None = None
) -> GoalRegion:
    """The region from which a mission's landing points (or the one of index `landing`) are visible.

    Raises InputError naming the landing points when none is visible.
    """
    points = site.landing_m.get(mission, ())
    if landing is not None and landing not in range(len(points)):
        raise InputError(
            site.name,
            f"landing.{mission.value}",
            f"no landing point {landing!r}; the site has {len(points)}, counted from 0",
        )
    chosen = list(range(len(points))) if landing is None else [int(landing)]
    corners: dict[Cell, tuple[int, FloatArray]] = {}
    shortest_m: dict[Cell, float] = {}
    for index in chosen:
        cells, legs = _visible_cells(site, vehicle, maps, points[index])
        lengths = np.sqrt((np.diff(legs, axis=1) ** 2).sum(axis=2)).sum(axis=1).tolist()
        for (x, z), leg, length_m in zip(cells.tolist(), legs, lengths, strict=True):
            if length_m < shortest_m.get((x, z), math.inf):
                shortest_m[x, z] = length_m
                corners[x, z] = (index, leg)
    if not corners:
        named = ", ".join(f"({x:g}, {z:g})" for x, z in (points[i] for i in chosen))
        raise InputError(
            site.name,
            f"landing.{mission.value}",
            f"no free border cell sees {named}" if named else "the site has no landing point",
        )
    mask = np.zeros(maps.grid.shape, dtype=bool)
    mask[tuple(np.array([*corners]).T)] = True
    return GoalRegion(mask=mask, corners=corners, length_m=shortest_m)


def landing_leg(
    site: Site,
    vehicle: Vehicle,
    region: GoalRegion,
    cell: Cell,
    from_m: FloatArray | None = None,
) -> LandingLeg:
    """The leg flown from a region cell: min(v_sat, v_max) along it, at rest at its end.

    from_m: its start in the cell, (2,); the centre by default.
    """
    index, corners = region.corners[cell]
    if from_m is not None:
        # Without an outer edge the checked leg continues from the centre.
        corners = np.stack([from_m, *corners[-2:]])
    points = [corners[0]]
    for start, end in itertools.pairwise(corners):
        pieces = max(1, int(np.ceil(np.hypot(*(end - start)) / site.workspace.resolution_m)))
        points.extend(start + (end - start) * (np.arange(1, pieces + 1) / pieces)[:, None])
    path = np.array(points)
    steps = np.diff(path, axis=0)
    clearance = obstacle_clearance_m(site, path[1:])
    speed = np.minimum(
        speed_limit_mps(clearance - site.margin.total_m, vehicle.safety, vehicle.speed),
        elevation_speed_mps(vehicle.speed, steps),
    )
    return LandingLeg(
        landing_index=index,
        length_m=float(np.hypot(*steps.T).sum()),
        points_m=path[1:],
        speed_mps=speed,
        clearance_m=clearance,
        room_m=leg_room_m(site, vehicle, corners[-2], corners[-1]),
    )


def obstacle_clearance_m(site: Site, points_m: FloatArray) -> FloatArray:
    """d_obs at any points (..., 2), also outside the grid; inf without obstacles."""
    clearance = np.full(points_m.shape[:-1], np.inf)
    for obstacle in site.obstacles:
        np.minimum(clearance, geometry.obstacle_distance_m(obstacle, points_m), out=clearance)
    return clearance


def obstacle_room_m(site: Site, points_m: FloatArray) -> FloatArray:
    """From any points (..., 2) to the nearest keep-out: (...); inf without obstacles."""
    room = np.full(points_m.shape[:-1], np.inf)
    for obstacle in site.obstacles:
        distance = geometry.obstacle_distance_m(obstacle, points_m)
        np.minimum(room, distance - obstacle.keep_out_m, out=room)
    return room


def narrowest(
    site: Site, vehicle: Vehicle, points_m: FloatArray
) -> tuple[str, float, float] | None:
    """The obstacle with the least room to a path of points (n, 2); None without obstacles.

    Its name, the clearance from the hull, and the keep-out with margin that the site requires.
    """
    rooms = []
    for item in site.obstacles:
        clearance_m = float(geometry.obstacle_distance_m(item, points_m).min()) - vehicle.radius_m
        rooms.append((clearance_m - item.keep_out_m, item.name, clearance_m, item.keep_out_m))
    return min(rooms)[1:] if rooms else None


def leg_room_m(site: Site, vehicle: Vehicle, start_m: FloatArray, end_m: FloatArray) -> float:
    """From the hull on a straight leg between points (2,) to the nearest keep-out."""
    vertices_m, first, radius_m, keep_out_m = geometry.rings(site.obstacles)
    clearance = leg_clearances(start_m[None, :], end_m, vertices_m, first, radius_m)
    room = clearance[0] - keep_out_m
    return float(room.min(initial=np.inf)) - vehicle.radius_m


def _visible_cells(
    site: Site, vehicle: Vehicle, maps: Maps, landing_m: PlanePoint
) -> tuple[IntArray, FloatArray]:
    """The free cells (n, 2) with a view of a landing point, and their legs (n, 2 or 3 points, 2).

    A leg begins at the cell's centre. A cell in a corner of the workspace may occur twice.
    """
    grid = maps.grid
    above = np.array([landing_m[0], landing_m[1] + vehicle.guidance.landing_height_m])
    lowest_row = _lowest_row(site, maps)
    nowhere = np.empty((0, 2), dtype=np.int64), np.empty((0, 3, 2))
    if lowest_row is None:
        return nowhere
    half = 0.5 * grid.resolution_m
    lower = np.array([grid.lower_m[0], grid.axes_m[1][lowest_row] - half])
    upper = np.array(grid.upper_m)
    end = np.array(landing_m)
    if (end > lower + TOLERANCE).all() and (end < upper - TOLERANCE).all():
        cell = grid.cell_of(landing_m)
        if cell is None or maps.occupied[cell]:
            return nowhere
        leg = np.stack([grid.centre_m(cell), above])
        clear = _legs_clear(site, vehicle, maps, leg[:1], above).all()
        if maps.fence is not None:
            clear &= maps.fence.holds_legs(leg[:1], above)[0]
        return (np.array([cell]), leg[None]) if clear else nowhere
    cells, edges = _border(grid.shape, lowest_row)
    free = ~maps.occupied[cells[:, 0], cells[:, 1]]
    cells, edges = cells[free], edges[free]
    centres = np.array(grid.lower_m) + (cells + 0.5) * grid.resolution_m
    midpoints = centres + edges * half
    seen = ~geometry.legs_enter_rectangle(midpoints, end, lower, upper)
    for leg_end in (end, above):
        seen &= _legs_clear(site, vehicle, maps, midpoints, leg_end)
    seen &= _legs_clear(site, vehicle, maps, above[None, :], end)
    if maps.fence is not None:
        seen &= maps.fence.holds_legs(centres, above)
    centres, midpoints = centres[seen], midpoints[seen]
    legs = np.stack([centres, midpoints, np.broadcast_to(above, centres.shape)], axis=1)
    return cells[seen], legs


def _legs_clear(
    site: Site, vehicle: Vehicle, maps: Maps, starts_m: FloatArray, end_m: FloatArray
) -> BoolArray:
    """Mask (n,) of straight legs from starts (n, 2) to an end that clear all obstacles."""
    widened_m = vehicle.radius_m + maps.position_uncertainty_m - TOLERANCE
    vertices_m, first, radius_m, keep_out_m = geometry.rings(site.obstacles)
    clearance = leg_clearances(starts_m, end_m, vertices_m, first, radius_m)
    return np.asarray((clearance >= widened_m + keep_out_m).all(axis=1))


def _lowest_row(site: Site, maps: Maps) -> int | None:
    """The first row of the flyable rectangle; None if all are below the minimum altitude."""
    if site.workspace.min_altitude_m is None:
        return 0
    flyable = np.flatnonzero(maps.grid.axes_m[1] >= site.workspace.min_altitude_m - TOLERANCE)
    return int(flyable[0]) if len(flyable) else None


def _border(shape: tuple[int, ...], lowest_row: int) -> tuple[IntArray, IntArray]:
    """Border cells (n, 2) of the flyable rectangle and the outward direction of an edge of each."""
    columns, rows = np.arange(shape[0]), np.arange(lowest_row, shape[1])
    sides = [
        (columns, np.full_like(columns, lowest_row), (0, -1)),
        (columns, np.full_like(columns, shape[1] - 1), (0, 1)),
        (np.zeros_like(rows), rows, (-1, 0)),
        (np.full_like(rows, shape[0] - 1), rows, (1, 0)),
    ]
    cells = np.concatenate([np.stack([x, z], axis=1) for x, z, _ in sides])
    edges = np.concatenate([np.tile(edge, (len(x), 1)) for x, _, edge in sides])
    return cells, edges

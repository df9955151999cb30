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
from .grid import TOLERANCE, BoolArray, FloatArray, Grid, IntArray
from .legs import leg_clearances
from .maps import Maps, speed_limit_mps, too_low
from .site import PlanePoint, Site

Cell = tuple[int, int]
_SAMPLES_PER_CELL = 4
"""Samples of a landing leg per cell of its length, by which it enters flyable cells."""


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
    distances_m = geometry.distances_m(site.obstacles, points_m)
    return np.asarray(distances_m.min(axis=-1, initial=np.inf))


def obstacle_room_m(site: Site, points_m: FloatArray) -> FloatArray:
    """From any points (..., 2) to the nearest keep-out: (...); inf without obstacles."""
    keep_out_m = np.array([item.keep_out_m for item in site.obstacles])
    rooms_m = geometry.distances_m(site.obstacles, points_m) - keep_out_m
    return np.asarray(rooms_m.min(axis=-1, initial=np.inf))


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
    low = too_low(site, grid)
    nowhere = np.empty((0, 2), dtype=np.int64), np.empty((0, 3, 2))
    if low.all():
        return nowhere
    half = 0.5 * grid.resolution_m
    end = np.array(landing_m)
    lower = np.array([grid.lower_m[0], _lower_border_m(grid, low, landing_m[0])])
    upper = np.array(grid.upper_m)
    if (end > lower + TOLERANCE).all() and (end < upper - TOLERANCE).all():
        cell = grid.cell_of(landing_m)
        if cell is None or maps.occupied[cell]:
            return nowhere
        leg = np.stack([grid.centre_m(cell), above])
        clear = _legs_clear(site, vehicle, maps, leg[:1], above).all()
        clear &= legs_above_ground(site, leg[:1], above)[0]
        if maps.fence is not None:
            clear &= maps.fence.holds_legs(leg[:1], above)[0]
        return (np.array([cell]), leg[None]) if clear else nowhere
    cells, edges = _border(low)
    free = ~maps.occupied[cells[:, 0], cells[:, 1]]
    cells, edges = cells[free], edges[free]
    centres = np.array(grid.lower_m) + (cells + 0.5) * grid.resolution_m
    midpoints = centres + edges * half
    if site.ground is None:
        seen = ~geometry.legs_enter_rectangle(midpoints, end, lower, upper)
    else:
        seen = ~_legs_enter(grid, ~low, midpoints, end)
        seen &= legs_above_ground(site, midpoints, above)
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


def legs_above_ground(site: Site, starts_m: FloatArray, end_m: FloatArray) -> BoolArray:
    """Mask (n,) of straight legs from starts (n, 2) to an end (2,) that keep off the ground.

    They come no nearer to it than the minimum altitude, or than the nearer one of their ends, which
    may be low; none leads through it. Without a profile all legs do.
    """
    ground, profile_m = site.ground, site.workspace.ground_m
    if ground is None:
        return np.ones(len(starts_m), dtype=np.bool_)
    vertices_m, first, radius_m, keep_out_m = geometry.rings((ground,))
    clear_m = leg_clearances(starts_m, end_m, vertices_m, first, radius_m)[:, 0]
    ends_m = np.minimum(
        geometry.obstacle_distance_m(ground, starts_m), geometry.obstacle_distance_m(ground, end_m)
    )
    kept = clear_m >= np.minimum(keep_out_m[0], ends_m) - TOLERANCE
    # An end on the ground is at distance 0, as is a leg inside: the leg is above each point of it.
    x_m, z_m = np.array(profile_m, dtype=np.float64).T
    along_m = end_m[0] - starts_m[:, :1]
    part = (x_m - starts_m[:, :1]) / np.where(along_m == 0.0, np.inf, along_m)
    under = (part > 0.0) & (part < 1.0)
    above = starts_m[:, 1:] + part * (end_m[1] - starts_m[:, 1:]) - z_m >= -TOLERANCE
    return np.asarray(kept & (above | ~under).all(axis=1))


def _legs_enter(grid: Grid, cells: BoolArray, starts_m: FloatArray, end_m: FloatArray) -> BoolArray:
    """Mask (n,) of straight legs from starts (n, 2) to an end (2,) that enter cells (nx, nz)."""
    along_m = end_m - starts_m
    longest_m = float(np.hypot(*along_m.T).max(initial=0.0))
    count = 1 + math.ceil(longest_m / grid.resolution_m * _SAMPLES_PER_CELL)
    part = (np.arange(count) + 0.5) / count
    at = starts_m[:, None] + part[:, None] * along_m[:, None]
    indices = np.floor((at - np.array(grid.lower_m)) / grid.resolution_m).astype(np.int64)
    inside = ((indices >= 0) & (indices < grid.shape)).all(axis=2)
    x, z = np.where(inside[..., None], indices, 0).transpose(2, 0, 1)
    return np.asarray((inside & cells[x, z]).any(axis=1))


def _lower_border_m(grid: Grid, low: BoolArray, x_m: float) -> float:
    """Height of the lower border of the flyable cells at x; of those of the nearest column."""
    columns = np.flatnonzero(~low.all(axis=1))
    column = columns[np.abs(grid.axes_m[0][columns] - x_m).argmin()]
    return float(grid.axes_m[1][low[column].argmin()] - 0.5 * grid.resolution_m)


def _border(low: BoolArray) -> tuple[IntArray, IntArray]:
    """Border cells (n, 2) of the flyable cells and the outward direction of an edge of each.

    low: mask (nx, nz) of the cells below them.
    """
    columns, left = np.flatnonzero(~low.all(axis=1)), np.flatnonzero(~low[0])
    right, (last, top) = np.flatnonzero(~low[-1]), np.array(low.shape) - 1
    sides = [
        (columns, low[columns].argmin(axis=1), (0, -1)),
        (columns, np.full_like(columns, top), (0, 1)),
        (np.zeros_like(left), left, (-1, 0)),
        (np.full_like(right, last), right, (1, 0)),
    ]
    cells = np.concatenate([np.stack([x, z], axis=1) for x, z, _ in sides])
    edges = np.concatenate([np.tile(edge, (len(x), 1)) for x, _, edge in sides])
    return cells, edges

"""Legs to a free cell without a plan: the escape leg, the recovery leg and the refuge leg.

A gust, a low take-off, a pilot or a new obstacle can bring the vehicle to a place where no path can
begin.

The escape leg is the shortest straight one to a free cell along which the clearance never
decreases. It enters no keep-out. If it begins in a keep-out, it comes no nearer to that obstacle.

The recovery leg leads back a vehicle that is outside the workspace or too low: first straight up to
the minimum altitude, then by the shortest straight leg to a free cell. It enters no keep-out. Both
may begin outside the autopilot's fence, and never lead out of it.

The refuge leg leads a vehicle from anywhere to the nearest free cell where a threat does no harm: a
position error, or a landing by the autopilot itself.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..settings.vehicle import Vehicle
from .geometry import rings
from .grid import TOLERANCE, BoolArray, FloatArray, IntArray
from .legs import leg_clearances
from .maps import Maps
from .plane_fence import PlaneFence
from .regions import legs_above_ground, obstacle_clearance_m
from .site import PlanePoint, Site

Rings = tuple[FloatArray, IntArray, FloatArray, FloatArray]
"""Obstacles as `rings` gives them: vertices, first, radius, keep-out."""

_SAMPLES_PER_CELL = 10
_REACH_M = 10.0
"""Longest leg: an aircraft farther from any free cell is not near the structure."""
_BATCH = 64
"""Number of legs checked together, the shortest first."""
_REFUGE_M = 30.0
"""Longest leg to a refuge: the width of the shipped sites."""


def entry_corners(
    site: Site,
    vehicle: Vehicle,
    maps: Maps,
    start_m: PlanePoint,
    barred: BoolArray | None = None,
) -> tuple[PlanePoint, ...]:
    """Corners of the leg to a free cell, without its start, the cell's centre last; () for none.

    start_m: where no path can begin. barred: free cells (nx, nz) that must not be its end.
    """

    def recovers() -> tuple[PlanePoint, ...]:
        widened_m = maps.position_uncertainty_m
        return recovery_leg(site, vehicle, maps, start_m, widened_m, barred=barred)

    def escapes() -> tuple[PlanePoint, ...]:
        end_m = escape_leg(site, vehicle, maps, start_m, barred)
        return () if end_m is None else (end_m,)

    if _is_low(site, start_m) or site.workspace.outside_m(start_m):
        return recovers() or escapes()
    return escapes() or recovers()


def escape_leg(
    site: Site,
    vehicle: Vehicle,
    maps: Maps,
    start_m: PlanePoint,
    barred: BoolArray | None = None,
) -> PlanePoint | None:
    """The centre of the free cell at the end of the escape leg; None if there is no such leg."""
    start = np.array(start_m, dtype=np.float64)
    obstacles = rings(site.obstacles)
    at_start_m = _clear_m(obstacles, start[None], start)[0]
    if at_start_m.min(initial=np.inf) <= 0.0:
        return None
    whole_m = obstacles[-1] + vehicle.radius_m + maps.position_uncertainty_m
    least_m = np.minimum(whole_m, at_start_m)
    centres = _centres_m(maps, ~maps.occupied, barred)
    near = centres[np.hypot(*(centres - start).T) <= _REACH_M]
    for end_m in _ends_m(site, obstacles, least_m, near, start):
        places_m = _samples(maps, start, end_m)
        clearance = obstacle_clearance_m(site, places_m)
        # Infinite without obstacles: then no clearance decreases.
        away = (clearance[1:] >= clearance[:-1] - TOLERANCE).all()
        if away and _stays_inside(maps.fence, places_m):
            return _point(end_m)
    return None


def recovery_leg(
    site: Site,
    vehicle: Vehicle,
    maps: Maps,
    start_m: PlanePoint,
    widened_m: float = 0.0,
    fence: PlaneFence | None = None,
    barred: BoolArray | None = None,
) -> tuple[PlanePoint, ...]:
    """Corners of the recovery leg, without its start, a free cell's centre last; () for none.

    start_m: no farther outside the workspace than `recovery_m`. From below the minimum altitude the
    first corner is straight above it, if the leg there is free. Where the start is within the
    margin of an obstacle, the leg comes no nearer to that one. widened_m: added to the distance
    from obstacles. fence: in place of the maps' own. barred: free cells (nx, nz) that must not be
    its end.
    """
    if site.workspace.outside_m(start_m) > vehicle.guidance.recovery_m:
        return ()
    start, fence = np.array(start_m, dtype=np.float64), fence or maps.fence
    room_m = maps.room_m + maps.position_uncertainty_m
    centres = _centres_m(maps, ~maps.occupied & (room_m >= widened_m - TOLERANCE), barred)
    if fence is not None:
        centres = centres[fence.holds(centres)]
    obstacles = rings(site.obstacles)
    own_m = obstacles[-1] + vehicle.radius_m - site.margin.total_m
    at_start_m = _clear_m(obstacles, start[None], start)[0]
    least_m = np.minimum(own_m + site.margin.total_m + widened_m, np.maximum(own_m, at_start_m))

    def end_from(from_m: FloatArray) -> PlanePoint | None:
        """The nearest centre to which a leg from a place (2,) is free."""
        for end_m in _ends_m(site, obstacles, least_m, centres, from_m):
            if _stays_inside(fence, _samples(maps, from_m, end_m)):
                return _point(end_m)
        return None

    above = _above(site, maps, start) if _is_low(site, start_m) else None
    if above is not None and _kept(site, obstacles, least_m, above[None], start)[0]:
        end_m = end_from(above)
        if end_m is not None and _stays_inside(fence, _samples(maps, start, above)):
            corner_m = _point(above)
            return (end_m,) if end_m == corner_m else (corner_m, end_m)
    end_m = end_from(start)
    return () if end_m is None else (end_m,)


def refuge_leg(
    site: Site,
    vehicle: Vehicle,
    maps: Maps,
    start_m: PlanePoint,
    spare_m: FloatArray,
    widened_m: float = 0.0,
    longest_m: float = np.inf,
) -> PlanePoint | None:
    """The centre of the free cell at the end of the refuge leg; None if there is no such leg.

    spare_m: (nx, nz), tolerance of each cell beyond its need. Of the cells with a straight leg the
    nearest without a negative value is taken; where all are negative, that of the greatest. The leg
    keeps every keep-out and widened_m; where it begins nearer, it comes no nearer to that obstacle.
    """
    start, obstacles = np.array(start_m, dtype=np.float64), rings(site.obstacles)
    least_m = np.minimum(
        obstacles[-1] + vehicle.radius_m + maps.position_uncertainty_m + widened_m,
        _clear_m(obstacles, start[None], start)[0],
    )
    free = ~maps.occupied
    centres, lacking_m = _centres_m(maps, free, None), np.maximum(0.0, -spare_m[free])
    far_m = np.hypot(*(centres - start).T)
    order = np.lexsort((far_m, lacking_m))
    order = order[far_m[order] <= min(longest_m, _REFUGE_M)]
    for begin in range(0, len(order), _BATCH):
        batch_m = centres[order[begin : begin + _BATCH]]
        for end_m in batch_m[_kept(site, obstacles, least_m, batch_m, start)]:
            if _stays_inside(maps.fence, _samples(maps, start, end_m)):
                return _point(end_m)
    return None


def pocket(maps: Maps, place_m: PlanePoint) -> BoolArray:
    """The free cells (nx, nz) that are joined by their edges to the one of a place."""
    free, cell = ~maps.occupied, maps.grid.cell_of(place_m)
    joined = np.zeros_like(free)
    if cell is None:
        return joined
    joined[cell] = True
    count = 0
    while count != (count := int(joined.sum())):
        wider = joined.copy()
        wider[1:] |= joined[:-1]
        wider[:-1] |= joined[1:]
        wider[:, 1:] |= joined[:, :-1]
        wider[:, :-1] |= joined[:, 1:]
        joined = wider & free
    return joined


def _clear_m(obstacles: Rings, ends_m: FloatArray, from_m: FloatArray) -> FloatArray:
    """Least distance, (n, obstacles), of the straight legs from a place (2,) to ends (n, 2)."""
    vertices_m, first, radius_m, _ = obstacles
    return leg_clearances(ends_m, from_m, vertices_m, first, radius_m)


def _kept(
    site: Site, obstacles: Rings, least_m: FloatArray, ends_m: FloatArray, from_m: FloatArray
) -> BoolArray:
    """The legs from a place (2,) to ends (n, 2) that keep distances (obstacles,): (n,).

    And that keep off the ground.
    """
    clear_m = _clear_m(obstacles, ends_m, from_m)
    kept = (clear_m >= least_m - TOLERANCE).all(axis=1)
    return np.asarray(kept & legs_above_ground(site, ends_m, from_m))


def _ends_m(
    site: Site, obstacles: Rings, least_m: FloatArray, ends_m: FloatArray, from_m: FloatArray
) -> Iterator[FloatArray]:
    """The ends of these legs that keep their distances, the nearest first."""
    nearest = np.argsort(np.hypot(*(ends_m - from_m).T), kind="stable")
    for begin in range(0, len(nearest), _BATCH):
        batch_m = ends_m[nearest[begin : begin + _BATCH]]
        yield from batch_m[_kept(site, obstacles, least_m, batch_m, from_m)]


def _lowest_m(site: Site, x_m: float) -> float:
    """Lowest height at which paths are planned at x."""
    return max(site.workspace.lower_m[1], float(site.workspace.floor_m(x_m)))


def _is_low(site: Site, start_m: PlanePoint) -> bool:
    """Returns True if a place is below the minimum altitude, or the workspace."""
    return start_m[1] < _lowest_m(site, start_m[0]) - TOLERANCE


def _above(site: Site, maps: Maps, start_m: FloatArray) -> FloatArray | None:
    """The lowest permitted place (2,) above a low one, in its column's centre; None for none."""
    grid = maps.grid
    z_m, at_m = grid.axes_m[1], float(start_m[0])
    cell = grid.cell_of((at_m, float(z_m[0])))
    at_m = at_m if cell is None else float(grid.axes_m[0][cell[0]])
    rows = np.flatnonzero(z_m >= _lowest_m(site, at_m) - TOLERANCE)
    return np.array([at_m, z_m[rows[0]]]) if len(rows) else None


def _centres_m(maps: Maps, cells: BoolArray, barred: BoolArray | None) -> FloatArray:
    """The centres (n, 2) of cells (nx, nz) that are not barred."""
    chosen = np.argwhere(cells if barred is None else cells & ~barred)
    centres: FloatArray = np.array(maps.grid.lower_m) + (chosen + 0.5) * maps.grid.resolution_m
    return centres


def _point(place_m: FloatArray) -> PlanePoint:
    """Two plain numbers."""
    return float(place_m[0]), float(place_m[1])


def _samples(maps: Maps, start_m: FloatArray, end_m: FloatArray) -> FloatArray:
    """Points (n, 2) along a straight leg, several in each cell."""
    length_m = float(np.hypot(*(end_m - start_m)))
    count = 2 + int(length_m / maps.grid.resolution_m * _SAMPLES_PER_CELL)
    along: FloatArray = start_m + np.linspace(0.0, 1.0, count)[:, None] * (end_m - start_m)
    return along


def _stays_inside(fence: PlaneFence | None, places_m: FloatArray) -> bool:
    """Returns True if a leg through places (n, 2) never leads out of the autopilot's fence."""
    if fence is None:
        return True
    inside = fence.holds(places_m)
    return bool((inside[1:] >= inside[:-1]).all())

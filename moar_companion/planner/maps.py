"""The maps of a site, built once: distances, costs and speed limit (Eq. 2, 3, 5; Fig. 2-4)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..settings.vehicle import SafetyShape, SpeedLimits, Vehicle
from . import geometry
from .clearances import Clearances
from .distance_kernels import horizontal_distances
from .free_distance import FreeDistance
from .grid import TOLERANCE, BoolArray, FloatArray, Grid
from .plane_fence import PlaneFence
from .site import Site


@dataclass(frozen=True, kw_only=True, eq=False)
class Maps:
    """All maps of one site for one vehicle; arrays are (nx, nz), indexed `[ix, iz]`, read-only.

    position_uncertainty_m: widening of the occupied distance
    fence:                  of the autopilot, as far as it cuts the site; None without one
    occupied:               never entered
    room_m:                 from the hull to the border of the nearest keep-out; inf without any
    obstacle_distance_m:    d_obs, to the nearest obstacle's surface
    hull_distance_m:        d_ch, to the obstacles' convex hull
    horizontal_distance_m:  d_hor, to the nearest obstacle below, after the 45 degree exclusion
    collision_cost, insertion_cost, damage_cost:  C of the three (Eq. 3)
    safety_cost:            SC (Eq. 2), and the cost of places that are exposed (`with_exposed`)
    speed_limit_mps:        v_sat (Eq. 5)
    clearances, hull:       to the obstacles and to their hull, for repairs
    reach:                  cells blocked for straight flights, also outside the workspace
    """

    grid: Grid
    position_uncertainty_m: float
    fence: PlaneFence | None
    occupied: BoolArray
    room_m: FloatArray
    obstacle_distance_m: FloatArray
    hull_distance_m: FloatArray
    horizontal_distance_m: FloatArray
    collision_cost: FloatArray
    insertion_cost: FloatArray
    damage_cost: FloatArray
    safety_cost: FloatArray
    speed_limit_mps: FloatArray
    clearances: Clearances
    hull: Clearances
    reach: FreeDistance


def build_maps(
    site: Site,
    vehicle: Vehicle,
    position_uncertainty_m: float = 0.0,
    *,
    fence: PlaneFence | None = None,
    before: Maps | None = None,
) -> Maps:
    """The maps of a site for a vehicle whose position is known to `position_uncertainty_m`.

    fence: the outside is occupied, but no obstacle.
    before: maps of the site with other obstacles, which are repaired.
    """
    space = site.workspace
    grid = Grid.over(space.lower_m, space.upper_m, space.resolution_m)
    x_m, z_m = grid.axes_m
    known = () if before is None else (before.clearances, before.reach.clearances)
    clearances = Clearances.over(grid, site.obstacles, *known)
    obstacle = clearances.distance_m
    room = clearances.room_m - (vehicle.radius_m + position_uncertainty_m)
    occupied = room < -TOLERANCE
    occupied |= too_low(site, grid)
    if fence is not None:
        centres_m = np.stack(np.meshgrid(x_m, z_m, indexing="ij"), axis=-1).reshape(-1, 2)
        occupied[~fence.holds(centres_m).reshape(occupied.shape)] = True
    horizontal = horizontal_distances(x_m, z_m, *geometry.rings(site.obstacles)[:2])
    hull = Clearances.over(
        grid, geometry.hull(site.obstacles), *(() if before is None else (before.hull,))
    )
    # Distance from the true position, nearer by up to the margin (zero without a flight).
    nearest = obstacle - site.margin.total_m
    collision, insertion, damage = (
        distance_cost(distance, vehicle.safety)
        for distance in (nearest, hull.distance_m, horizontal)
    )
    shape = vehicle.safety
    maps = Maps(
        grid=grid,
        position_uncertainty_m=position_uncertainty_m,
        fence=fence,
        occupied=occupied,
        room_m=room,
        obstacle_distance_m=obstacle,
        hull_distance_m=hull.distance_m,
        horizontal_distance_m=horizontal,
        collision_cost=collision,
        insertion_cost=insertion,
        damage_cost=damage,
        safety_cost=shape.collision * collision
        + shape.insertion * insertion
        + shape.damage * damage,
        speed_limit_mps=speed_limit_mps(nearest, vehicle.safety, vehicle.speed),
        clearances=clearances,
        hull=hull,
        reach=FreeDistance.over(
            site,
            vehicle.radius_m,
            position_uncertainty_m,
            known=(clearances, *known),
        ),
    )
    for array in vars(maps).values():
        if isinstance(array, np.ndarray):
            array.flags.writeable = False
    return maps


def too_low(site: Site, grid: Grid) -> BoolArray:
    """Mask (nx, nz) of the cells whose centre is below the minimum altitude."""
    x_m, z_m = grid.axes_m
    return np.asarray(z_m[None, :] < site.workspace.floor_m(x_m)[:, None] - TOLERANCE)


def with_exposed(maps: Maps, exposed: BoolArray, shape: SafetyShape) -> Maps:
    """Maps without exposed cells, with exposed cells (nx, nz) added: these cost more."""
    safety_cost = maps.safety_cost + shape.exposure * exposed
    safety_cost.flags.writeable = False
    return replace(maps, safety_cost=safety_cost)


def distance_cost(distance_m: FloatArray, shape: SafetyShape) -> FloatArray:
    """Eq. 3: C(d), 1 below d_min, falling to 0 at d_max."""
    alpha = shape.d_min_m / (shape.d_max_m - shape.d_min_m)
    cost = np.maximum(distance_m, shape.d_min_m)
    np.divide(shape.d_max_m, np.minimum(cost, shape.d_max_m, out=cost), out=cost)
    cost -= 1.0
    cost *= alpha
    return cost


def speed_limit_mps(
    obstacle_distance_m: FloatArray, shape: SafetyShape, speed: SpeedLimits
) -> FloatArray:
    """Eq. 5: v_sat(d_obs), from v_MIN at d_min to v_MAX at d_max."""
    beta = (speed.max_mps - speed.min_mps) / (shape.d_max_m - shape.d_min_m)
    between = np.minimum(np.maximum(obstacle_distance_m, shape.d_min_m), shape.d_max_m)
    return np.asarray(speed.min_mps + beta * (between - shape.d_min_m))

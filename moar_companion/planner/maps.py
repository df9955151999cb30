"""The maps of a site, built once: distances, costs and speed limit (Eq. 2, 3, 5; Fig. 2-4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..site import Site
from ..vehicle import SafetyShape, SpeedLimits, Vehicle
from . import geometry
from .grid import TOLERANCE, BoolArray, FloatArray, Grid


@dataclass(frozen=True, kw_only=True, eq=False)
class Maps:
    """All maps of one site for one vehicle; arrays are (nx, nz), indexed `[ix, iz]`, read-only.

    position_uncertainty_m: what the occupied distance is widened by
    occupied:               never entered
    obstacle_distance_m:    d_obs, to the nearest obstacle's surface
    hull_distance_m:        d_ch, to the obstacles' convex hull
    horizontal_distance_m:  d_hor, to the nearest obstacle below, after the 45 degree exclusion
    collision_cost, insertion_cost, damage_cost:  C of the three (Eq. 3)
    safety_cost:            SC (Eq. 2)
    speed_limit_mps:        v_sat (Eq. 5)
    """

    grid: Grid
    position_uncertainty_m: float
    occupied: BoolArray
    obstacle_distance_m: FloatArray
    hull_distance_m: FloatArray
    horizontal_distance_m: FloatArray
    collision_cost: FloatArray
    insertion_cost: FloatArray
    damage_cost: FloatArray
    safety_cost: FloatArray
    speed_limit_mps: FloatArray


def build_maps(site: Site, vehicle: Vehicle, position_uncertainty_m: float = 0.0) -> Maps:
    """The maps of a site for a vehicle whose position is known to `position_uncertainty_m`."""
    space = site.workspace
    grid = Grid.over(space.lower_m, space.upper_m, space.resolution_m)
    x_m, z_m = grid.axes_m
    centres = np.stack(np.meshgrid(x_m, z_m, indexing="ij"), axis=-1)
    obstacle = np.full(grid.shape, np.inf)
    horizontal = np.full(grid.shape, np.inf)
    occupied = np.zeros(grid.shape, dtype=bool)
    if space.min_altitude_m is not None:
        occupied[:, z_m < space.min_altitude_m - TOLERANCE] = True
    for item in site.obstacles:
        distance = geometry.obstacle_distance_m(item, centres)
        np.minimum(obstacle, distance, out=obstacle)
        np.minimum(horizontal, geometry.horizontal_distance_m(item, x_m, z_m), out=horizontal)
        required_m = vehicle.radius_m + position_uncertainty_m + item.keep_out_m
        occupied |= distance < required_m - TOLERANCE
    # The paper's exclusion: below a 45 degree slope from the lowest obstacle a fall does no damage.
    above_lowest = z_m - geometry.obstacles_lowest_m(site.obstacles)
    horizontal[above_lowest[None, :] < horizontal - TOLERANCE] = np.inf
    hull = np.full(grid.shape, np.inf)
    if site.obstacles:
        hull = geometry.polygon_distance_m(geometry.hull_vertices_m(site.obstacles), centres)
    collision, insertion, damage = (
        distance_cost(distance, vehicle.safety) for distance in (obstacle, hull, horizontal)
    )
    shape = vehicle.safety
    maps = Maps(
        grid=grid,
        position_uncertainty_m=position_uncertainty_m,
        occupied=occupied,
        obstacle_distance_m=obstacle,
        hull_distance_m=hull,
        horizontal_distance_m=horizontal,
        collision_cost=collision,
        insertion_cost=insertion,
        damage_cost=damage,
        safety_cost=shape.collision * collision
        + shape.insertion * insertion
        + shape.damage * damage,
        speed_limit_mps=speed_limit_mps(obstacle, vehicle.safety, vehicle.speed),
    )
    for array in vars(maps).values():
        if isinstance(array, np.ndarray):
            array.flags.writeable = False
    return maps


def distance_cost(distance_m: FloatArray, shape: SafetyShape) -> FloatArray:
    """Eq. 3: C(d), 1 below d_min, falling to 0 at d_max."""
    alpha = shape.d_min_m / (shape.d_max_m - shape.d_min_m)
    between = np.clip(distance_m, shape.d_min_m, shape.d_max_m)
    return alpha * (shape.d_max_m / between - 1.0)


def speed_limit_mps(
    obstacle_distance_m: FloatArray, shape: SafetyShape, speed: SpeedLimits
) -> FloatArray:
    """Eq. 5: v_sat(d_obs), from v_MIN at d_min to v_MAX at d_max."""
    beta = (speed.max_mps - speed.min_mps) / (shape.d_max_m - shape.d_min_m)
    between = np.clip(obstacle_distance_m, shape.d_min_m, shape.d_max_m)
    return speed.min_mps + beta * (between - shape.d_min_m)

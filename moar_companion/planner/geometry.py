"""Plane geometry of obstacles: distances, hulls, straight legs. Arrays of points are (..., 2).

Distances are to the obstacle's surface: a conductor is a disc, a polygon is filled; inside they
are 0 (planner page, Maps).
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull

from ..site import Conductor, Obstacle, Polygon
from .grid import TOLERANCE, BoolArray, FloatArray


def obstacle_distance_m(obstacle: Obstacle, points_m: FloatArray) -> FloatArray:
    """Distance from points (..., 2) to an obstacle's surface, (...)."""
    if isinstance(obstacle, Conductor):
        offset = points_m - np.asarray(obstacle.position_m)
        distance = np.hypot(offset[..., 0], offset[..., 1])
        return np.asarray(np.maximum(distance - obstacle.radius_m, 0.0))
    return polygon_distance_m(np.asarray(obstacle.vertices_m), points_m)


def polygon_distance_m(vertices_m: FloatArray, points_m: FloatArray) -> FloatArray:
    """Distance from points (..., 2) to a filled polygon (n, 2); 0 inside. n may be 1 or 2."""
    distance = np.full(points_m.shape[:-1], np.inf)
    inside = np.zeros(points_m.shape[:-1], dtype=bool)
    x, z = points_m[..., 0], points_m[..., 1]
    for start, end in zip(vertices_m, np.roll(vertices_m, -1, axis=0), strict=True):
        np.minimum(distance, _to_segment_m(points_m, start, end), out=distance)
        crosses = (start[1] > z) != (end[1] > z)
        if crosses.any():
            at = start[0] + (z - start[1]) * (end[0] - start[0]) / (end[1] - start[1])
            inside ^= crosses & (x < at)
    return np.where(inside, 0.0, distance)


def _to_segment_m(points_m: FloatArray, start_m: FloatArray, end_m: FloatArray) -> FloatArray:
    """Distance from points to a segment; points or ends may carry the leading axes."""
    along = end_m - start_m
    length_squared = (along**2).sum(axis=-1)
    offset = points_m - start_m
    with np.errstate(invalid="ignore", divide="ignore"):
        fraction = np.clip((offset * along).sum(axis=-1) / length_squared, 0.0, 1.0)
    fraction = np.where(length_squared > 0.0, fraction, 0.0)
    nearest = offset - fraction[..., None] * along
    return np.hypot(nearest[..., 0], nearest[..., 1])


def hull_vertices_m(obstacles: tuple[Obstacle, ...]) -> FloatArray:
    """Corners (n, 2) of the convex hull of conductor centres and polygon vertices.

    Points in a line give the two ends of a segment, a single point itself; none gives (0, 2).
    """
    points = np.array(
        [
            point
            for obstacle in obstacles
            for point in (
                (obstacle.position_m,) if isinstance(obstacle, Conductor) else obstacle.vertices_m
            )
        ],
        dtype=np.float64,
    ).reshape(-1, 2)
    if len(points) < 2:
        return points
    centred = points - points.mean(axis=0)
    _, spread, axes = np.linalg.svd(centred, full_matrices=False)
    if spread[0] <= TOLERANCE:
        return points[:1]
    if len(points) < 3 or spread[1] <= TOLERANCE * max(1.0, spread[0]):
        along = centred @ axes[0]
        return points[[int(along.argmin()), int(along.argmax())]]
    return np.asarray(points[ConvexHull(points).vertices])


def horizontal_distance_m(obstacle: Obstacle, x_m: FloatArray, z_m: FloatArray) -> FloatArray:
    """Least horizontal distance, (nx, nz), to a point of the obstacle strictly below; inf if none.

    At any x the lowest point of a filled shape is on its outline, so the edges below serve.
    """
    if isinstance(obstacle, Conductor):
        x, z = obstacle.position_m
        below = z < z_m - TOLERANCE
        return np.where(below[None, :], np.abs(x_m - x)[:, None], np.inf)
    distance = np.full((len(x_m), len(z_m)), np.inf)
    vertices = obstacle.vertices_m
    for start, end in zip(vertices, (*vertices[1:], vertices[0]), strict=True):
        (x_low, z_low), (x_high, z_high) = sorted((start, end), key=lambda point: point[1])
        below = z_low < z_m - TOLERANCE
        rise = z_high - z_low
        fraction = np.clip((z_m - z_low) / rise, 0.0, 1.0) if rise > 0.0 else np.ones_like(z_m)
        x_cut = x_low + fraction * (x_high - x_low)
        left, right = np.minimum(x_low, x_cut), np.maximum(x_low, x_cut)
        gap = np.maximum(left[None, :] - x_m[:, None], x_m[:, None] - right[None, :])
        np.minimum(distance, np.where(below[None, :], np.maximum(gap, 0.0), np.inf), out=distance)
    return distance


def leg_clearance_m(obstacle: Obstacle, starts_m: FloatArray, end_m: FloatArray) -> FloatArray:
    """Least distance, (n,), from an obstacle to the straight legs from starts (n, 2) to an end."""
    if isinstance(obstacle, Conductor):
        centre = np.asarray(obstacle.position_m)
        return np.asarray(np.maximum(_to_segment_m(centre, starts_m, end_m) - obstacle.radius_m, 0))
    vertices = np.asarray(obstacle.vertices_m)
    clearance = np.minimum(
        polygon_distance_m(vertices, starts_m), polygon_distance_m(vertices, end_m[None, :])
    )
    for start, end in zip(vertices, np.roll(vertices, -1, axis=0), strict=True):
        np.minimum(clearance, _to_segment_m(start, starts_m, end_m), out=clearance)
        clearance[_legs_cross(starts_m, end_m, start, end)] = 0.0
    return clearance


def _legs_cross(
    starts_m: FloatArray, end_m: FloatArray, first_m: FloatArray, second_m: FloatArray
) -> BoolArray:
    """Whether the legs from starts (n, 2) to an end properly cross the segment first-second."""

    def side(origin: FloatArray, towards: FloatArray, point: FloatArray) -> FloatArray:
        along, offset = towards - origin, point - origin
        return np.asarray(along[..., 0] * offset[..., 1] - along[..., 1] * offset[..., 0])

    across_leg = side(starts_m, end_m, first_m) * side(starts_m, end_m, second_m) < 0.0
    across_edge = side(first_m, second_m, starts_m) * side(first_m, second_m, end_m) < 0.0
    return np.asarray(across_leg & across_edge)


def legs_enter_rectangle(
    starts_m: FloatArray, end_m: FloatArray, lower_m: FloatArray, upper_m: FloatArray
) -> BoolArray:
    """Whether straight legs from starts (n, 2) to an end pass through a rectangle's interior."""
    along = end_m - starts_m
    enter = np.zeros(len(starts_m))
    leave = np.ones(len(starts_m))
    for axis in range(2):
        low = lower_m[axis] + TOLERANCE - starts_m[:, axis]
        high = upper_m[axis] - TOLERANCE - starts_m[:, axis]
        moving = along[:, axis] != 0.0
        step = np.where(moving, along[:, axis], 1.0)
        first, second = np.minimum(low / step, high / step), np.maximum(low / step, high / step)
        within = (low < 0.0) & (high > 0.0)
        enter = np.maximum(enter, np.where(moving, first, np.where(within, 0.0, np.inf)))
        leave = np.minimum(leave, np.where(moving, second, np.where(within, 1.0, -np.inf)))
    return enter < leave


def obstacles_lowest_m(obstacles: tuple[Obstacle, ...]) -> float:
    """The lowest level of conductor centres and polygon vertices; inf without obstacles."""
    return min(
        (
            min(z for _, z in obstacle.vertices_m)
            if isinstance(obstacle, Polygon)
            else obstacle.position_m[1]
            for obstacle in obstacles
        ),
        default=np.inf,
    )

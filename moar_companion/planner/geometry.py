"""Plane geometry of obstacles: distances, hulls, rectangles. Arrays of points are (..., 2).

Distances are to the obstacle's surface: a conductor is a disc, a polygon is filled; inside they
are 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from .grid import TOLERANCE, BoolArray, FloatArray, IntArray
from .site import Obstacle, PlanePoint, Polygon


def obstacle_distance_m(obstacle: Obstacle, points_m: FloatArray) -> FloatArray:
    """Distance from points (..., 2) to an obstacle's surface, (...)."""
    outline = np.asarray(obstacle.outline_m)
    if len(outline) > 1:
        distance = polygon_distance_m(outline, points_m)
    else:
        offset = points_m - outline[0]
        distance = np.hypot(offset[..., 0], offset[..., 1])
    return np.asarray(np.maximum(distance - obstacle.radius_m, 0.0))


def distances_m(obstacles: Sequence[Obstacle], points_m: FloatArray) -> FloatArray:
    """Distances from points (..., 2) to the surfaces of n obstacles, (..., n)."""
    outlines = [obstacle.outline_m for obstacle in obstacles]
    first_m = np.array([outline[0] for outline in outlines]).reshape(-1, 2)
    offset = points_m[..., None, :] - first_m
    distance = np.hypot(offset[..., 0], offset[..., 1])
    for index, outline in enumerate(outlines):
        if len(outline) > 1:
            distance[..., index] = polygon_distance_m(np.asarray(outline), points_m)
    radii_m = np.array([obstacle.radius_m for obstacle in obstacles])
    return np.asarray(np.maximum(distance - radii_m, 0.0))


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


def rings(obstacles: tuple[Obstacle, ...]) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
    """Obstacles as the loops of `distance_kernels` take them: vertices, first, radius, keep-out."""
    outlines = [obstacle.outline_m for obstacle in obstacles]
    return (
        np.array([point for outline in outlines for point in outline]).reshape(-1, 2),
        np.cumsum([0, *map(len, outlines)]),
        np.array([item.radius_m for item in obstacles]),
        np.array([item.keep_out_m for item in obstacles]),
    )


def hull_vertices_m(obstacles: tuple[Obstacle, ...]) -> FloatArray:
    """Corners (n, 2) of the convex hull of conductor centres and polygon vertices.

    Points in a line give the two ends of a segment, a single point itself; none gives (0, 2).
    Andrew's monotone chain (1979).
    """
    points = sorted({point for obstacle in obstacles for point in obstacle.outline_m})
    corners: list[PlanePoint] = []
    for order in (points, points[::-1]):
        chain: list[PlanePoint] = []
        for point in order:
            while len(chain) > 1 and not _turns_left(chain[-2], chain[-1], point):
                chain.pop()
            chain.append(point)
        corners += chain[:-1]
    return np.array(corners or points, dtype=np.float64).reshape(-1, 2)


def hull(obstacles: tuple[Obstacle, ...]) -> tuple[Polygon, ...]:
    """The convex hull as an obstacle, of one vertex or two where it is flat; none gives none."""
    corners = tuple((x, z) for x, z in hull_vertices_m(obstacles).tolist())
    return (Polygon(name="hull", vertices_m=corners),) if corners else ()


def _turns_left(start: PlanePoint, through: PlanePoint, end: PlanePoint) -> bool:
    """Returns True if a path from start through a point to an end turns left, beyond rounding."""
    ax, az = through[0] - start[0], through[1] - start[1]
    bx, bz = end[0] - start[0], end[1] - start[1]
    return ax * bz - az * bx > TOLERANCE * math.hypot(ax, az) * math.hypot(bx, bz)


def legs_enter_rectangle(
    starts_m: FloatArray, end_m: FloatArray, lower_m: FloatArray, upper_m: FloatArray
) -> BoolArray:
    """Mask (n,) of straight legs from starts (n, 2) to an end that enter a rectangle's interior."""
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

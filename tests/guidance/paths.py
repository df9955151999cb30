"""Paths for the tests of guidance: by hand, and paths over a grid as the planner makes them."""

from __future__ import annotations

import itertools
import math

import numpy as np
from hypothesis import strategies as st

from moar_companion.companion.guidance.trajectory import PathPoints, make_trajectory

ROUNDING_M = 0.15
CELL_M = 0.3
DIRECTIONS = [(0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1)]


def path(*points, speed=0.7):
    """A path in the plane y = 0 through points (x, z); one speed, or one for each move."""
    position = np.array([(x, 0.0, z) for x, z in points], dtype=float)
    speeds = [speed] * (len(points) - 1) if isinstance(speed, float) else list(speed)
    return PathPoints(position_m=position, speed_mps=np.array(speeds, dtype=float))


def trajectory(*points, speed=0.7, acceleration=1.0, rounding=ROUNDING_M, lead_in=None):
    return make_trajectory(
        path(*points, speed=speed),
        lead_in=lead_in,
        acceleration_mps2=acceleration,
        rounding_m=rounding,
    )


@st.composite
def grid_walks(draw, least_moves=0, most_moves=25):
    """Path of grid moves, each with a speed; the path may turn back, cross itself, and stand."""
    moves = draw(
        st.lists(
            st.tuples(
                st.one_of(st.sampled_from(DIRECTIONS), st.just((0, 0))),
                st.sampled_from([0.4, 0.5, 0.7, 1.5, 2.5, 10.0]),
            ),
            min_size=least_moves,
            max_size=most_moves,
        )
    )
    points = [(0.0, 0.0, 0.0)]
    for (dx, dz), _ in moves:
        x, _, z = points[-1]
        points.append((x + CELL_M * dx, 0.0, z + CELL_M * dz))
    return PathPoints(
        position_m=np.array(points), speed_mps=np.array([speed for _, speed in moves])
    )


accelerations = st.sampled_from([0.3, 1.0, 2.0, 8.0])


def length_m(polyline):
    return float(np.sqrt((np.diff(polyline, axis=0) ** 2).sum(axis=1)).sum())


def distance_to_polyline_m(point, polyline):
    """Distance from a point to a polyline, by brute force over its segments."""
    best = math.dist(point, polyline[0])
    for start, end in itertools.pairwise(polyline):
        along = end - start
        squared = float(along @ along)
        part = 0.0 if squared == 0.0 else float((point - start) @ along) / squared
        best = min(best, math.dist(point, start + min(1.0, max(0.0, part)) * along))
    return best


def curvatures_per_m(points):
    """Curvature of the circle through each three points in a row (Menger)."""
    first, second, third = points[:-2], points[1:-1], points[2:]
    a = np.linalg.norm(second - first, axis=1)
    b = np.linalg.norm(third - second, axis=1)
    c = np.linalg.norm(third - first, axis=1)
    twice_area = np.linalg.norm(np.cross(second - first, third - first), axis=1)
    return 2.0 * twice_area / np.maximum(a * b * c, 1e-12)

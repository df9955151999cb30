"""Compiled distances from straight legs to obstacles, given as rings (`distance_kernels`)."""

from __future__ import annotations

import numpy as np

from .grid import FloatArray, IntArray
from .jit import BOOL, F8, I8, jit, read, written


@jit(F8, F8, F8, F8, F8, F8, F8)
def _to_segment(
    x: float, z: float, start_x: float, start_z: float, end_x: float, end_z: float
) -> float:
    """Distance from a point to a segment."""
    along_x, along_z = end_x - start_x, end_z - start_z
    length_squared = along_x * along_x + along_z * along_z
    share = 0.0
    if length_squared > 0.0:
        share = ((x - start_x) * along_x + (z - start_z) * along_z) / length_squared
        share = min(max(share, 0.0), 1.0)
    off_x, off_z = x - start_x - share * along_x, z - start_z - share * along_z
    return float(np.sqrt(off_x * off_x + off_z * off_z))


@jit(F8, F8, F8, F8, F8, F8, F8)
def _turn(start_x: float, start_z: float, end_x: float, end_z: float, x: float, z: float) -> float:
    """Positive where a point is to the left of a segment."""
    return (end_x - start_x) * (z - start_z) - (end_z - start_z) * (x - start_x)


@jit(BOOL, F8, F8, read(F8, 2), I8, I8)
def _inside(x: float, z: float, vertices_m: FloatArray, begin: int, end: int) -> bool:
    """Returns True if a point is inside the ring of vertices from `begin` to `end`."""
    inside = False
    before = end - 1
    for corner in range(begin, end):
        from_z, to_z = vertices_m[before, 1], vertices_m[corner, 1]
        if (from_z > z) != (to_z > z):
            share = (z - from_z) / (to_z - from_z)
            from_x = vertices_m[before, 0]
            inside ^= x < from_x + share * (vertices_m[corner, 0] - from_x)
        before = corner
    return inside


@jit(written(F8, 2), read(F8, 2), read(F8), read(F8, 2), read(I8), read(F8))
def leg_clearances(
    starts_m: FloatArray,
    end_m: FloatArray,
    vertices_m: FloatArray,
    first: IntArray,
    radius_m: FloatArray,
) -> FloatArray:
    """Least distance, (n, rings), of the straight legs from starts (n, 2) to an end; 0 inside."""
    x1, z1 = end_m[0], end_m[1]
    clearance = np.empty((len(starts_m), len(radius_m)))
    for leg in range(len(starts_m)):
        x0, z0 = starts_m[leg, 0], starts_m[leg, 1]
        for ring in range(len(radius_m)):
            begin, end = first[ring], first[ring + 1]
            nearest = np.inf
            before = end - 1
            for corner in range(begin, end):
                x, z = vertices_m[corner, 0], vertices_m[corner, 1]
                nearest = min(nearest, _to_segment(x, z, x0, z0, x1, z1))
                if end - begin > 1:
                    from_x, from_z = vertices_m[before, 0], vertices_m[before, 1]
                    nearest = min(nearest, _to_segment(x0, z0, from_x, from_z, x, z))
                    nearest = min(nearest, _to_segment(x1, z1, from_x, from_z, x, z))
                    from_side = _turn(x0, z0, x1, z1, from_x, from_z)
                    side = _turn(x0, z0, x1, z1, x, z)
                    start_side = _turn(from_x, from_z, x, z, x0, z0)
                    end_side = _turn(from_x, from_z, x, z, x1, z1)
                    if from_side * side < 0.0 and start_side * end_side < 0.0:
                        nearest = 0.0
                before = corner
            if end - begin > 2 and (
                _inside(x0, z0, vertices_m, begin, end) or _inside(x1, z1, vertices_m, begin, end)
            ):
                nearest = 0.0
            clearance[leg, ring] = max(nearest - radius_m[ring], 0.0)
    return clearance

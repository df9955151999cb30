"""Ground that is not flat: its profile in the plane of a site, and the lowest heights above it.

A profile is the points `(x, z)` of the ground, x rising; it goes on level beyond its ends. Pure.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
Points = Sequence[tuple[float, float]]

_BEYOND_M = 1_000.0
"""Length of the level ground beyond the ends: no flight goes as far."""
_DEEP_M = 1_000.0
"""Depth of the ground as a filled shape."""


def height_m(profile_m: Points, x_m: npt.ArrayLike) -> FloatArray:
    """Height of the ground at x (...)."""
    at, heights = np.array(profile_m, dtype=np.float64).T
    return np.asarray(np.interp(np.asarray(x_m, dtype=np.float64), at, heights))


def outline_m(profile_m: Points) -> tuple[tuple[float, float], ...]:
    """Corners of the ground as a filled shape, down to below all of it."""
    (left_m, left_z_m), (right_m, right_z_m) = profile_m[0], profile_m[-1]
    bottom_m = min(z_m for _, z_m in profile_m) - _DEEP_M
    left_m, right_m = left_m - _BEYOND_M, right_m + _BEYOND_M
    ends = ((right_m, right_z_m), (right_m, bottom_m), (left_m, bottom_m))
    return ((left_m, left_z_m), *profile_m, *ends)


def floor_m(profile_m: Points, distance_m: float, x_m: npt.ArrayLike) -> FloatArray:
    """Least height at x (...) that is at least `distance_m` from the ground, to the side, too.

    The upper edge of a disc of this radius that rolls over the profile: on level ground the
    distance is added, on a slope more. Of each straight piece the disc's highest place is taken,
    where it touches the piece or an end of it.
    """
    points = np.array(outline_m(profile_m)[:-2], dtype=np.float64)
    (from_x, from_z), (to_x, to_z) = points[:-1].T, points[1:].T
    slope = (to_z - from_z) / (to_x - from_x)
    x = np.asarray(x_m, dtype=np.float64)[..., None]
    at = np.clip(x + distance_m * slope / np.sqrt(1.0 + slope**2), from_x, to_x)
    above = distance_m**2 - (at - x) ** 2
    top = from_z + slope * (at - from_x) + np.sqrt(np.maximum(above, 0.0))
    return np.asarray(np.where(above >= 0.0, top, -np.inf).max(axis=-1))

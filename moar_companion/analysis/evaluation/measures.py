"""Measures of sweeps: range ratio, coverage, switches, hypervolume, quartiles.

environments/README defines each where the paper leaves it open.
"""

from __future__ import annotations

import numpy as np

from ...planner.grid import FloatArray

_EQUAL = 1e-9


def range_ratio(values: FloatArray, compared: FloatArray) -> float:
    """Range of values over the range of others; NaN where the others have none."""
    span = float(np.ptp(compared)) if len(compared) else 0.0
    return float(np.ptp(values)) / span if span > _EQUAL else np.nan


def coverage(values: FloatArray, one: float, other: float) -> float:
    """Part of the interval between two values that lies within the range of `values`.

    NaN where the two are equal or one is missing.
    """
    low, high = min(one, other), max(one, other)
    if not high - low > _EQUAL:
        return np.nan
    covered = min(high, float(values.max())) - max(low, float(values.min()))
    return covered / (high - low) if covered > _EQUAL else 0.0


def first_nearer(levels: FloatArray, values: FloatArray, one: float, other: float) -> float:
    """The first level at which a value is nearer to `other` than to `one`; NaN if none is."""
    if not abs(other - one) > _EQUAL:
        return np.nan
    nearer = np.flatnonzero(np.abs(values - other) < np.abs(values - one))
    return float(levels[nearer[0]]) if len(nearer) else np.nan


def half_passed(levels: FloatArray, values: FloatArray) -> float:
    """The first level at which half of the change from the first to the last value is passed."""
    change = values[-1] - values[0]
    if abs(change) <= _EQUAL:
        return np.nan
    return float(levels[np.flatnonzero((values - values[0]) / change >= 0.5)[0]])


def greatest_step(values: FloatArray) -> float:
    """The greatest change between neighbours, over the range of all; NaN without any change."""
    span = float(np.ptp(values))
    return float(np.abs(np.diff(values)).max()) / span if span > _EQUAL else np.nan


def greatest_gap(points: FloatArray, values: FloatArray) -> float:
    """The greatest gap between points within the range of `values`, over that range.

    Lower limit of the greatest step of values that are taken from the points.
    """
    low, high = float(values.min()), float(values.max())
    if not high - low > _EQUAL:
        return np.nan
    within = np.sort(points[(points >= low - _EQUAL) & (points <= high + _EQUAL)])
    return float(np.diff(within).max()) / (high - low) if len(within) > 1 else 1.0


def hypervolume(points: FloatArray, reference: FloatArray) -> float:
    """Volume that points (n, 3), each to be small, dominate below a reference point (3,)."""
    better = points[(points < reference).all(axis=1)]
    if not len(better):
        return 0.0
    ordered = better[np.argsort(better[:, 2], kind="stable")]
    tops = np.append(ordered[1:, 2], reference[2])
    areas = [_area(ordered[: at + 1, :2], reference[:2]) for at in range(len(ordered))]
    return float(np.dot(tops - ordered[:, 2], areas))


def quartiles(values: FloatArray) -> tuple[int, float, float, float]:
    """Number of known values, first quartile, median and third quartile."""
    known = values[np.isfinite(values)]
    if not len(known):
        return 0, np.nan, np.nan, np.nan
    first, median, third = np.percentile(known, [25.0, 50.0, 75.0])
    return len(known), float(first), float(median), float(third)


def _area(points: FloatArray, reference: FloatArray) -> float:
    """Area that points (n, 2) dominate below a reference point (2,)."""
    ordered = points[np.lexsort((points[:, 1], points[:, 0]))]
    heights = np.minimum.accumulate(ordered[:, 1])
    widths = np.diff(np.append(ordered[:, 0], reference[0]))
    return float(np.dot(widths, reference[1] - heights))

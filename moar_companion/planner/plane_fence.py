"""The autopilot's fence in the site's vertical plane: the area in which plans may lead.

Inputs: places (n, 2) of the plane, legs, directions. Outputs: masks of those inside, distances to
the fence, and the limit that is crossed. The outside is never entered, but it is no obstacle: it
changes no distance and no cost.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .grid import TOLERANCE, BoolArray, FloatArray

Interval = tuple[float, float]
_EVERYWHERE: Interval = (-math.inf, math.inf)


@dataclass(frozen=True, slots=True, kw_only=True)
class Bound:
    """One limit, with its margin taken off. name: for texts, as "GF_MAX_HOR_DIST 10 m".

    x_m: the intervals within which it is kept, in order and apart; z_m: the heights.
    """

    name: str
    x_m: tuple[Interval, ...] = (_EVERYWHERE,)
    z_m: Interval = _EVERYWHERE

    def holds(self, places_m: FloatArray, beyond_m: float = 0.0) -> BoolArray:
        """Mask (n,) of places (n, 2) that are inside, or up to `beyond_m` outside along an axis."""
        return np.asarray(
            (self._interval(places_m, beyond_m) >= 0) & self._high(places_m, beyond_m)
        )

    def holds_legs(self, starts_m: FloatArray, end_m: FloatArray, beyond_m: float) -> BoolArray:
        """Mask (n,) of straight legs from starts (n, 2) to an end (2,) that are inside."""
        end_m = end_m[None, :]
        interval = self._interval(starts_m, beyond_m)
        same = (interval >= 0) & (interval == self._interval(end_m, beyond_m))
        return np.asarray(same & self._high(starts_m, beyond_m) & self._high(end_m, beyond_m))

    def free_m(self, places_m: FloatArray, directions: FloatArray) -> FloatArray:
        """Distance to the limit from places (n, 2) along unit vectors: (n,); inf from outside."""
        free = np.full(len(places_m), np.inf)
        for low, high in self.x_m:
            inside = (places_m[:, 0] >= low - TOLERANCE) & (places_m[:, 0] <= high + TOLERANCE)
            free[inside] = _ahead(places_m[inside, 0], directions[inside, 0], (low, high))
        inside = self._high(places_m, 0.0)
        upwards = _ahead(places_m[inside, 1], directions[inside, 1], self.z_m)
        free[inside] = np.minimum(free[inside], upwards)
        return free

    def _interval(self, places_m: FloatArray, beyond_m: float) -> np.ndarray:
        """The number of the interval that holds each place; -1 for none."""
        found = np.full(len(places_m), -1)
        more_m = beyond_m + TOLERANCE
        for number, (low, high) in enumerate(self.x_m):
            found[(places_m[:, 0] >= low - more_m) & (places_m[:, 0] <= high + more_m)] = number
        return found

    def _high(self, places_m: FloatArray, beyond_m: float) -> BoolArray:
        (low, high), z_m, more_m = self.z_m, places_m[:, 1], beyond_m + TOLERANCE
        return np.asarray((z_m >= low - more_m) & (z_m <= high + more_m))


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaneFence:
    """All limits. margin_m: margin of each to the autopilot's limit."""

    bounds: tuple[Bound, ...]
    margin_m: float

    def holds(self, places_m: FloatArray, beyond_m: float = 0.0) -> BoolArray:
        """Mask (n,) of places (n, 2) inside all limits, or no more than `beyond_m` outside."""
        inside = np.ones(len(places_m), dtype=bool)
        for bound in self.bounds:
            inside &= bound.holds(places_m, beyond_m)
        return inside

    def holds_legs(
        self, starts_m: FloatArray, end_m: FloatArray, beyond_m: float = 0.0
    ) -> BoolArray:
        """Mask (n,) of straight legs from starts (n, 2) to an end (2,) that are inside."""
        inside = np.ones(len(starts_m), dtype=bool)
        for bound in self.bounds:
            inside &= bound.holds_legs(starts_m, end_m, beyond_m)
        return inside

    def crossed(self, places_m: FloatArray, beyond_m: float = 0.0) -> str | None:
        """Name of the first limit that some place (n, 2) is outside of; None if all are inside."""
        for bound in self.bounds:
            if not bound.holds(places_m, beyond_m).all():
                return bound.name
        return None

    def free_m(self, places_m: FloatArray, directions: FloatArray) -> FloatArray:
        """Distance to the nearest limit from places (n, 2) along unit vectors (n, 2): (n,)."""
        free = np.full(len(places_m), np.inf)
        for bound in self.bounds:
            np.minimum(free, bound.free_m(places_m, directions), out=free)
        return free

    def cutting(self, corners_m: FloatArray) -> PlaneFence | None:
        """The limits that cut the rectangle around points (n, 2); None where none does.

        Straight legs within that rectangle keep all other limits.
        """
        lower, upper = corners_m.min(axis=0), corners_m.max(axis=0)
        cut = tuple(
            bound for bound in self.bounds if not bound.holds_legs(lower[None], upper, 0.0)[0]
        )
        return PlaneFence(bounds=cut, margin_m=self.margin_m) if cut else None


def _ahead(values: FloatArray, directions: FloatArray, interval: Interval) -> FloatArray:
    """Distance in directions over which values stay within an interval."""
    low, high = interval
    left = np.where(directions > 0.0, high - values, values - low)
    speed = np.abs(directions)
    ahead = np.full(len(values), np.inf)
    np.divide(np.maximum(left, 0.0), speed, out=ahead, where=speed > TOLERANCE)
    return ahead

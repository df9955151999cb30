"""Obstacle inflation: extra distance from obstacles in plans, beyond their keep-outs.

Input: position uncertainty beyond that in the keep-outs, at each moment; output: the inflation for
plans, in steps, never less than needed. It grows at once, and shrinks when less would have been
enough for a while, so that noise in a measurement causes no new plan. Pure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

STEP_M = 0.1
"""A third of a usual cell: less would not change its maps."""
_SLACK_M = 0.1
"""Fluctuation of receivers' accuracies under an open sky."""
_SHRINKS_AFTER_S = 3.0
"""Less than the time after which `uncertainty` clears (5 s): the first plan after that hold uses
the smaller inflation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ObstacleInflation:
    """width_m: inflation in plans. since_s, less_m: start and size of a smaller need."""

    width_m: float = 0.0
    less_m: float = 0.0
    since_s: float | None = None

    def followed(self, needed_m: float, now_s: float) -> ObstacleInflation:
        """Returns the inflation after a cycle that needs `needed_m`."""
        if needed_m > self.width_m:
            return ObstacleInflation(width_m=_stepped_m(needed_m))
        enough_m = _stepped_m(needed_m + _SLACK_M) if needed_m > 0.0 else 0.0
        if enough_m >= self.width_m:
            return ObstacleInflation(width_m=self.width_m)
        if self.since_s is None:
            return ObstacleInflation(width_m=self.width_m, less_m=enough_m, since_s=now_s)
        less_m = max(self.less_m, enough_m)
        if now_s - self.since_s >= _SHRINKS_AFTER_S:
            return ObstacleInflation(width_m=less_m)
        return ObstacleInflation(width_m=self.width_m, less_m=less_m, since_s=self.since_s)


def _stepped_m(needed_m: float) -> float:
    """Smallest whole number of steps that is enough."""
    steps = math.ceil(needed_m / STEP_M)
    while steps * STEP_M < needed_m:
        steps += 1  # where the quotient was rounded down
    return steps * STEP_M

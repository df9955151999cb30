"""The widening: by how much more than their keep-outs obstacles are avoided in plans.

Input: by how much the position is known worse than keep-outs allow for, at each moment; output:
what plans are made with, in steps, never less than needed. It grows at once, and shrinks when less
would have done for a while, so that a measurement that wavers makes no plan anew. Pure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

STEP_M = 0.1
"""A third of a usual cell: less would not change its maps."""
_SLACK_M = 0.1
"""Receivers' accuracies waver by as much under an open sky."""
_SHRINKS_AFTER_S = 3.0
"""Less than the time for which the supervisor's hold on the uncertainty outlasts it: the first
plan after that is made with what is true again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Widening:
    """width_m: what plans are made with. since_s: when less began to do, and how much then."""

    width_m: float = 0.0
    less_m: float = 0.0
    since_s: float | None = None

    def followed(self, needed_m: float, now_s: float) -> Widening:
        """The widening after a look at what is needed now."""
        if needed_m > self.width_m:
            return Widening(width_m=_stepped_m(needed_m))
        enough_m = _stepped_m(needed_m + _SLACK_M) if needed_m > 0.0 else 0.0
        if enough_m >= self.width_m:
            return Widening(width_m=self.width_m)
        if self.since_s is None:
            return Widening(width_m=self.width_m, less_m=enough_m, since_s=now_s)
        less_m = max(self.less_m, enough_m)
        if now_s - self.since_s >= _SHRINKS_AFTER_S:
            return Widening(width_m=less_m)
        return Widening(width_m=self.width_m, less_m=less_m, since_s=self.since_s)


def _stepped_m(needed_m: float) -> float:
    """The least whole number of steps that is enough."""
    steps = math.ceil(needed_m / STEP_M)
    while steps * STEP_M < needed_m:
        steps += 1  # where the quotient was rounded down
    return steps * STEP_M

"""Calibrates the adaptation of the weights: the exact front along its line, for one start and goal.

Inputs: base weights, and the optimum for any weights. Output: a `Calibration` (`adaptation`).

The line of weights leads from time and energy alone over the base weights to safety alone. On it, a
path's J is linear in k_S, and the least J over all paths concave. Two optima of different weights
are neighbours if no path costs less at the k_S at which both cost the same. Otherwise the optimum
there is between them. The widest gap is divided first. n points take 2 n - 1 plans.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable
from typing import NamedTuple

from ..types import Weights
from .adaptation import Calibration, on_line
from .plan_values import Cost

MOST_PLANS = 64
"""Limit of the plans of one calibration; gaps that are then left are small ones of a long front."""
_TOLERANCE = 1e-9
"""Costs closer than this, relative, are equal."""

Solve = Callable[[Weights], Cost]


class _Optimum(NamedTuple):
    """SC d and k_T TC + k_E EC (k_T + k_E = 1) of the optimum at k_S `place`."""

    place: float
    safety: float
    rest: float

    def total(self, place: float) -> float:
        """J of the path at another k_S."""
        return place * self.safety + (1.0 - place) * self.rest


class _Gap(NamedTuple):
    """Two optima, of the lesser k_S first; both cost the same at k_S `place`."""

    narrowness: float
    place: float
    before: _Optimum
    after: _Optimum


def calibrated(base: Weights, solve: Solve) -> Calibration:
    """The calibration by the optima along the line of `base`."""
    share = on_line(base, 0.0)

    def optimum(place: float) -> _Optimum:
        cost = solve(on_line(base, place))
        return _Optimum(place, cost.safety, share.time * cost.time + share.energy * cost.energy)

    fast, middle, safe = optimum(0.0), optimum(base.safety), optimum(1.0)
    open_gaps = [*_gap(fast, middle), *_gap(middle, safe)]
    heapq.heapify(open_gaps)
    switches: list[_Gap] = []
    for _ in range(MOST_PLANS - 3):
        if not open_gaps:
            break
        gap = heapq.heappop(open_gaps)
        between, least = optimum(gap.place), gap.before.total(gap.place)
        if between.total(gap.place) >= least - _TOLERANCE * max(1.0, least):
            switches.append(gap)
            continue
        for part in (*_gap(gap.before, between), *_gap(between, gap.after)):
            heapq.heappush(open_gaps, part)
    corners = [(-1.0, 0.0), (0.0, base.safety), (1.0, 1.0)]
    for gap in (*switches, *open_gaps):
        if gap.place <= base.safety:
            ends = (gap.before.rest, gap.after.rest, middle.rest, fast.rest)
        else:
            ends = (gap.before.safety, gap.after.safety, middle.safety, safe.safety)
        demand = _midway(*ends)
        if demand is not None:
            corners.append((-demand if gap.place <= base.safety else demand, gap.place))
    return Calibration(*(tuple(column) for column in zip(*sorted(corners), strict=True)))


def _gap(before: _Optimum, after: _Optimum) -> list[_Gap]:
    """The gap between two optima; [] where they are the same point."""
    safer, dearer = before.safety - after.safety, after.rest - before.rest
    if min(safer, dearer) <= _TOLERANCE * max(1.0, before.safety, after.rest):
        return []
    return [_Gap(-(safer + dearer), dearer / (safer + dearer), before, after)]


def _midway(before: float, after: float, begin: float, end: float) -> float | None:
    """Position of the middle of two values between `begin`, 0, and `end`, 1; None on either."""
    span = begin - end
    part = (begin - 0.5 * (before + after)) / span if span > 0.0 else 0.0
    return part if _TOLERANCE < part < 1.0 - _TOLERANCE else None

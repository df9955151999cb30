"""The whole trade-off of one planning problem: its supported Pareto front, and its sensitivity.

Inputs: a planner and a request. Outputs: every sum of safety, time and energy that is the optimum
of J for some weights, with these weights. Further outputs: the changes of weights and of risk
indices at which the path changes. Exact, as plans are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ...types import RiskIndices, Weights
from ..adaptation import Adaptation
from ..grid import FloatArray
from ..plan_values import Plan, PlanRequest
from ..planner import Planner
from ..whole_front import WholeFront

_TOLERANCE = 1e-9
"""Costs closer than this, relative, are equal."""
_HALVINGS = 30
"""Bisections for the end of a range: to 1e-9."""
_STEP = 1e-6
"""Distance to either side, for a slope."""
_NAMES = ("safety", "time", "energy")
_EXTREMES: FloatArray = np.eye(3)


@dataclass(frozen=True, kw_only=True, eq=False)
class Supported:
    """A point of the front. sums: (3,) SC d, TC and EC; region: (n, 3), corners of its weights."""

    plan: Plan
    sums: FloatArray
    region: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class StableRange:
    """A value, the slope of J with it, and the values between which the path stays the best."""

    value: float
    slope: float
    lower: float
    upper: float


def pareto_front(planner: Planner, request: PlanRequest) -> list[Supported]:
    """The supported Pareto front, safest first; empty unless there is a path.

    J is the least of `weights . sums` over the front, so the plans known at any time bound it from
    above: by a roof of facets over the triangle of weights. Where J meets the roof at all corners
    of its facets, J equals the roof: J is concave and each facet is flat. At a corner where J is
    lower, the plan there is new and cuts off that corner.
    """
    facets: list[Supported] = []
    corners = [*_EXTREMES]
    while corners:
        weights = corners.pop()
        plan = planner.solve(replace(request, weights=Weights.normalised(*weights.tolist())))
        if plan.cost is None:
            return []
        sums = np.array((plan.cost.safety, plan.cost.time, plan.cost.energy))
        roof = min((float(weights @ facet.sums) for facet in facets), default=np.inf)
        if plan.cost.total >= roof - _TOLERANCE * max(1.0, plan.cost.total):
            continue
        region = _EXTREMES
        for facet in facets:
            region = _clipped(region, facet.sums - sums)
        if len(region) < 3:
            continue
        kept = []
        for facet in facets:
            left = _clipped(facet.region, sums - facet.sums)
            if len(left) > 2:
                kept.append(replace(facet, region=left))
        facets = [*kept, Supported(plan=plan, sums=sums, region=region)]
        corners.extend(region)
    return sorted(facets, key=lambda facet: tuple(facet.sums))


def front_document(
    plan: Plan,
    front: list[Supported],
    ranges: dict[str, dict[str, StableRange]],
    whole: WholeFront | None,
) -> dict[str, Any]:
    """The front and the sensitivity of a plan as a JSON document; infinite clearances are null.

    whole: of the plan's weights, all trade-offs of safety and effort.
    """
    own = plan.to_dict()
    return {
        **{key: own[key] for key in ("site", "mission", "target", "status", "risk", "weights")},
        "start_m": list(plan.request.start_m),
        "start_velocity_mps": own["start_velocity_mps"],
        "cost": own["cost"],
        "points": [
            {
                **dict(zip(_NAMES, point.sums.tolist(), strict=True)),
                "weights": [dict(zip(_NAMES, corner, strict=True)) for corner in corners],
                "metrics": path["metrics"],
                "states": path["states"],
            }
            for point in front
            for corners, path in [(point.region.tolist(), point.plan.to_dict())]
        ],
        "trade_offs": [] if whole is None else _trade_offs(whole),
        "sensitivity": {
            kind: {name: asdict(item) for name, item in items.items()}
            for kind, items in ranges.items()
        },
    }


def _trade_offs(whole: WholeFront) -> list[dict[str, Any]]:
    """All trade-offs of safety and effort, safest first; supported: some weights reach it."""
    rows = []
    for at, supported in enumerate(whole.supported.tolist()):
        path = whole.plan(at).to_dict()
        sums = {name: path["cost"][name] for name in _NAMES}
        rows.append(
            {
                **sums,
                "effort": float(whole.second[at]),
                "supported": supported,
                "metrics": path["metrics"],
                "states": path["states"],
            }
        )
    return rows


def sensitivity(
    planner: Planner, plan: Plan, adaptation: Adaptation
) -> dict[str, dict[str, StableRange]]:
    """Ranges of the weights and of the risk indices, by name, about a plan that was found.

    adaptation: makes the plan's weights of its risk. A weight moves while the others keep their
    ratio, a risk index while the others stay. Either way the weights move along a line: a path that
    is best at two places is best between them.
    """
    own = np.array([getattr(plan.weights, name) for name in _NAMES])
    risk = plan.request.risk
    weights = {}
    for name, extreme, value in zip(_NAMES, _EXTREMES, own.tolist(), strict=True):
        others = own * (1.0 - extreme)
        others = others / others.sum() if others.any() else (1.0 - extreme) / 2.0
        weights[name] = _range(planner, plan, value, partial(_mixed, extreme, others))
    return {
        "weights": weights,
        "risk": {
            name: _range(planner, plan, value, partial(_adjusted, adaptation, risk, name))
            for name, value in risk.as_dict().items()
        },
    }


def _mixed(extreme: FloatArray, others: FloatArray, value: float) -> Weights:
    return Weights.normalised(*(value * extreme + (1.0 - value) * others).tolist())


def _adjusted(adaptation: Adaptation, risk: RiskIndices, name: str, value: float) -> Weights:
    return adaptation.weights(RiskIndices(**(risk.as_dict() | {name: value})))


def _range(
    planner: Planner, plan: Plan, value: float, weights_at: Callable[[float], Weights]
) -> StableRange:
    """The range of a value in [0, 1] that leads to weights."""

    def cost(at: float) -> float:
        """J of the plan's own path."""
        return _total(plan, weights_at(at))

    def is_best(at: float) -> bool:
        best = planner.solve(replace(plan.request, weights=weights_at(at))).cost
        return best is not None and cost(at) <= best.total + _TOLERANCE * max(1.0, best.total)

    def end(outer: float) -> float:
        """The last value towards an outer one at which the path is best."""
        if is_best(outer):
            return outer
        inner = value
        for _ in range(_HALVINGS):
            middle = 0.5 * (inner + outer)
            inner, outer = (middle, outer) if is_best(middle) else (inner, middle)
        return inner

    below, above = max(value - _STEP, 0.0), min(value + _STEP, 1.0)
    slope = (cost(above) - cost(below)) / (above - below)
    return StableRange(value=value, slope=slope, lower=end(0.0), upper=end(1.0))


def _total(plan: Plan, weights: Weights) -> float:
    """J that a found plan's path has for other weights."""
    cost = plan.cost
    assert cost is not None
    return weights.safety * cost.safety + weights.time * cost.time + weights.energy * cost.energy


def _clipped(region: FloatArray, normal: FloatArray) -> FloatArray:
    """The part of a convex polygon (n, 3) where `normal . point` is not negative."""
    side = region @ normal
    corners: list[FloatArray] = []
    for at in range(len(region)):
        after = (at + 1) % len(region)
        if side[at] >= 0.0:
            corners.append(region[at])
        if side[at] * side[after] < 0.0:
            share = side[at] / (side[at] - side[after])
            corners.append(region[at] + share * (region[after] - region[at]))
    apart = [
        corner
        for at, corner in enumerate(corners)
        if np.abs(corner - corners[at - 1]).max() > _TOLERANCE
    ]
    return np.array(apart).reshape(-1, 3)

"""A problem under other levels of risk (paper, Fig. 1b and 8): the change of its path.

Inputs: a planner, a request, an adaptation. Outputs: its plans under `RISK_LEVELS`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...types import RiskIndices, Weights
from ..adaptation import Adaptation
from ..plan_values import Plan, PlanRequest
from ..planner import Planner

RISK_LEVELS = (
    RiskIndices(),
    RiskIndices(wind=0.5),
    RiskIndices(wind=1.0),
    RiskIndices(wind=1.0, communication=1.0, localization=1.0),
    RiskIndices(battery=0.5),
    RiskIndices(battery=1.0),
    RiskIndices(wind=1.0, battery=1.0),
)
"""The corners of the paper's Fig. 8, and halfway where its paths change most. In Eq. 9 the indices
of communication and localization do the same, and less than that of the wind."""


def alternatives(
    planner: Planner, request: PlanRequest, adaptation: Adaptation
) -> tuple[Plan, ...]:
    """The plans of a problem under each of `RISK_LEVELS`, their weights by `adaptation`.

    Raises InputError as `Planner.plan`.
    """
    return tuple(
        planner.solve(replace(request, risk=risk).adapted(adaptation)) for risk in RISK_LEVELS
    )


def unmoved_words(planner: Planner, plan: Plan, others: Sequence[Plan]) -> str:
    """Sentence on the risks that do not move a plan's path, and the reason; empty if some do.

    others: its `alternatives`. Wind, communication and localization raise the weight of safety.
    """
    if plan.cost is None or plan.metrics is None or not others:
        return ""
    for_safety = [other for other in others if not other.request.risk.battery]
    if not all(same_path(plan, other) for other in for_safety):
        return ""
    kept = "wind, communication and localization do not move the path"
    if all(same_path(plan, other) for other in others):
        kept = "no risk moves the path"
    safest = planner.solve(replace(plan.request, weights=Weights.normalised(1.0, 0.0, 0.0)))
    if safest.cost is None or safest.metrics is None or same_path(plan, safest):
        return f"{kept}: it is the safest"
    return (
        f"{kept}: the safest has safety cost {safest.cost.safety:.2f} "
        f"(this {plan.cost.safety:.2f}), takes {safest.metrics.duration_s:.1f} s "
        f"({plan.metrics.duration_s:.1f} s), needs energy {safest.cost.energy:.2f} "
        f"({plan.cost.energy:.2f})"
    )


def safety_words(plan: Plan) -> str:
    """Safety of a plan: `safety cost 3.67, clearance 4.09 m on average, 1.43 m at least`."""
    if plan.cost is None or plan.metrics is None:
        return plan.status.value
    words, metrics = f"safety cost {plan.cost.safety:.2f}", plan.metrics
    if math.isfinite(metrics.mean_clearance_m):
        words += (
            f", clearance {metrics.mean_clearance_m:.2f} m on average, "
            f"{metrics.min_clearance_m:.2f} m at least"
        )
    return words


def same_path(plan: Plan, other: Plan) -> bool:
    """Returns True if two plans pass the same cells."""
    return np.array_equal(plan.states[:, :-1], other.states[:, :-1])


def risk_words(risk: RiskIndices) -> str:
    """The indices that are not 0, as a text: `wind 1, battery 0.5`."""
    shown = [f"{name} {value:g}" for name, value in risk.as_dict().items() if value]
    return ", ".join(shown) or "no risk"

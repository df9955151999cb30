"""A problem under other levels of risk (paper, Fig. 1b and 8): the change of its path.

Inputs: a planner, a request, an adaptation. Outputs: its plans under `RISK_LEVELS`.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...adaptation import Adaptation
from ...types import RiskIndices
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


def same_path(plan: Plan, other: Plan) -> bool:
    """Returns True if two plans pass the same cells."""
    return np.array_equal(plan.states[:, :-1], other.states[:, :-1])


def risk_words(risk: RiskIndices) -> str:
    """The indices that are not 0, as a text: `wind 1, battery 0.5`."""
    shown = [f"{name} {value:g}" for name, value in risk.as_dict().items() if value]
    return ", ".join(shown) or "no risk"

"""When a plan in flight is made anew: on time, when a risk has moved, never too often."""

from __future__ import annotations

from ..config import Replanning
from ..types import RiskIndices


def replan_reason(
    policy: Replanning, *, planned_risk: RiskIndices, risk: RiskIndices, age_s: float
) -> str | None:
    """Why to plan again, `age_s` after the last plan; None when there is no reason."""
    if age_s < policy.min_interval_s:
        return None
    before = planned_risk.as_dict()
    for name, value in risk.as_dict().items():
        if abs(value - before[name]) >= policy.risk_change:
            return f"{name} risk {before[name]:.2f} -> {value:.2f}"
    return "time" if age_s >= policy.period_s else None

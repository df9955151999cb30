"""Rules for a new plan in flight, and for keeping the path that is flown.

A new plan is due periodically, after a risk has left its dead band, and after obstacles have become
wider or less wide; not too often. The new path has to be better by a margin. Without the margin,
noise on the risks would change between two paths of nearly equal cost every few seconds.
"""

from __future__ import annotations

from ...settings.config import Replanning
from ...types import RiskIndices


def replan_reason(
    policy: Replanning,
    *,
    planned_risk: RiskIndices,
    risk: RiskIndices,
    planned_widening_m: float,
    widening_m: float,
    age_s: float,
) -> str | None:
    """Reason to plan again, `age_s` after the last plan; None if there is no reason.

    planned_widening_m, widening_m: inflation of obstacles beyond their keep-outs, at the last
    plan and now; in steps, so that any change counts.
    """
    if age_s < policy.min_interval_s:
        return None
    if widening_m != planned_widening_m:
        return f"obstacles wider by {planned_widening_m:.1f} -> {widening_m:.1f} m"
    before = planned_risk.as_dict()
    for name, value in risk.as_dict().items():
        if abs(value - before[name]) >= policy.risk_change:
            return f"{name} risk {before[name]:.2f} -> {value:.2f}"
    return "time" if age_s >= policy.period_s else None


def stays(policy: Replanning, *, flown_cost: float, new_cost: float) -> bool:
    """True if a path that is still free stays. Costs: J of both from one place, by new weights."""
    return flown_cost - new_cost <= policy.improvement * flown_cost

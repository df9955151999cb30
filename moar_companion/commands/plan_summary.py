"""Text of `moar-companion plan`: summary of a plan and of the further results requested."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..planner.plan_values import Plan
    from ..planner.refinement import Refinement


def summary(
    plan: Plan,
    notes: Mapping[str, str],
    refined: Refinement | None,
    explanation: dict[str, Any],
    others: Sequence[Plan],
    unmoved: str,
) -> str:
    """The plan in a few lines; refined path, explanation and other plans where there are any.

    notes: lines with their labels. unmoved: of the risks that do not move the path.
    """
    return "".join(
        [
            _plan_lines(plan, notes),
            _refined_lines(refined),
            _explanation_lines(explanation),
            _alternative_lines(plan, others),
            f"  {'':9}  {unmoved}\n" if unmoved else "",
        ]
    )


def _plan_lines(plan: Plan, notes: Mapping[str, str]) -> str:
    target = "" if plan.request.target is None else f" of {plan.request.target}"
    if not plan.mission.visits_targets and target:
        target = f" to landing point {plan.request.target}"
    lines = [f"{plan.site}: {plan.mission.value}{target}: {plan.status.value}"]
    weights, compute = plan.weights, plan.compute
    if plan.cost is not None and plan.metrics is not None:
        cost, metrics = plan.cost, plan.metrics
        lines.append(
            f"  cost       J = {cost.total:.3f} (safety {cost.safety:.3f}, "
            f"time {cost.time:.3f} s, energy {cost.energy:.3f})"
        )
        lines.append(
            f"  path       {metrics.length_m:.1f} m in {metrics.duration_s:.1f} s, "
            f"{len(plan.waypoints.time_s)} waypoints, "
            f"velocity change {metrics.velocity_change_mps:.1f} m/s"
        )
        leg = plan.landing_leg
        if leg is not None:
            leg_s = metrics.duration_s - cost.time
            lines.append(
                f"  {'':9}  of these the landing leg, not in the cost: "
                f"{leg.length_m:.1f} m in {leg_s:.1f} s"
            )
        lines.append(
            "  clearance  no obstacles"
            if math.isinf(metrics.min_clearance_m)
            else f"  clearance  {metrics.mean_clearance_m:.2f} m on average, "
            f"{metrics.min_clearance_m:.2f} m at least"
        )
    lines += [f"  {label:9}  {words}" for label, words in notes.items()]
    lines.append(
        f"  weights    safety {weights.safety:.3f}, time {weights.time:.3f}, "
        f"energy {weights.energy:.3f}"
    )
    lines.append(
        f"  computed   maps {compute.map_words}, search {compute.search_words}, "
        f"{compute.expanded} expanded"
    )
    return "\n".join(lines) + "\n"


def _refined_lines(refined: Refinement | None) -> str:
    """The refined path in a line of the summary; none where there is none."""
    if refined is None:
        return ""
    metrics = refined.metrics
    return (
        f"  refined    {metrics.length_m:.1f} m in {metrics.duration_s:.1f} s, "
        f"{len(refined.points_m)} points; as continuous paths J = {refined.cost.total:.3f}, "
        f"{refined.plan_cost.total:.3f} unrefined; {refined.compute_words}\n"
    )


def _explanation_lines(explanation: dict[str, Any]) -> str:
    """The explanation in the lines of the summary; none where there is none."""
    lines = [
        f"  {label:9}  {part['words']}\n"
        for label, part in (
            ("by risk", explanation.get("weights")),
            ("", explanation.get("path")),
        )
        if part is not None
    ]
    return "".join(lines)


def _alternative_lines(plan: Plan, others: Sequence[Plan]) -> str:
    """The plans under other risks in lines of the summary."""
    from ..planner.analysis.alternatives import risk_words, safety_words, same_path  # noqa: PLC0415

    lines: list[str] = []
    for other in others:
        words, metrics = risk_words(other.request.risk), other.metrics
        figures = other.status.value
        if metrics is not None:
            figures = f"{metrics.length_m:.1f} m in {metrics.duration_s:.1f} s"
            figures += f", {safety_words(other)}"
            figures += ", the same path" if same_path(plan, other) else ""
        lines.append(f"  {'' if lines else 'others':9}  {words}: {figures}\n")
    return "".join(lines)

"""Reasons to plan again in flight."""

from __future__ import annotations

import pytest

from moar_companion.companion.plan_requests import PlanBasis, replan_reason, stays
from moar_companion.settings.config import Replanning
from moar_companion.types import RiskIndices

POLICY = Replanning(period_s=2.0, risk_change=0.1, min_interval_s=0.3)


def reason(age_s, *, before=None, now=None, policy=POLICY, widening_m=(0.0, 0.0)):
    basis = PlanBasis(risk=RiskIndices(**(before or {})), widening_m=widening_m[0])
    return replan_reason(policy, basis, RiskIndices(**(now or {})), widening_m[1], age_s)


@pytest.mark.parametrize(
    ("case", "age_s", "wind", "expected"),
    [
        ("calm, just planned", 0.0, 0.0, None),
        ("calm, almost due", 1.99, 0.0, None),
        ("calm, due", 2.0, 0.0, "time"),
        ("calm, overdue", 60.0, 0.0, "time"),
        ("a small change", 1.0, 0.09, None),
        ("a change", 1.0, 0.1, "wind risk 0.00 -> 0.10"),
        ("a change too soon after the last plan", 0.29, 1.0, None),
        ("a change after the least interval", 0.3, 1.0, "wind risk 0.00 -> 1.00"),
        ("a change, and due", 2.0, 1.0, "wind risk 0.00 -> 1.00"),
    ],
)
def test_a_plan_is_renewed_by_time_or_risk(case, age_s, wind, expected):
    assert reason(age_s, now={"wind": wind}) == expected


@pytest.mark.parametrize("index", ["wind", "communication", "localization", "battery"])
def test_each_index_counts_upwards_and_downwards(index):
    assert reason(1.0, before={index: 0.2}, now={index: 0.5}) == f"{index} risk 0.20 -> 0.50"
    assert reason(1.0, before={index: 0.5}, now={index: 0.2}) == f"{index} risk 0.50 -> 0.20"


@pytest.mark.parametrize("widening_m", [(0.0, 0.1), (0.7, 0.2)])
def test_a_change_of_the_obstacle_inflation_is_a_reason(widening_m):
    before_m, now_m = widening_m
    text = f"obstacles wider by {before_m:.1f} -> {now_m:.1f} m"
    assert reason(0.3, widening_m=widening_m) == text
    assert reason(0.29, widening_m=widening_m) is None
    assert reason(1.0, widening_m=(now_m, now_m)) is None


def test_small_changes_of_all_indices_are_no_reason():
    names = ("wind", "communication", "localization", "battery")
    assert reason(1.0, now=dict.fromkeys(names, 0.09)) is None


def test_a_plan_is_renewed_at_most_once_per_interval():
    policy = Replanning(period_s=0.1, risk_change=0.1, min_interval_s=0.5)
    assert reason(0.4, policy=policy, now={"wind": 1.0}) is None
    assert reason(0.5, policy=policy) == "time"


@pytest.mark.parametrize(
    ("case", "flown", "new", "kept"),
    [
        ("the same path", 5.0, 5.0, True),
        ("a path that saves a little", 5.0, 4.95, True),
        ("a path that saves the margin", 5.0, 4.89, False),
        ("a path that saves much", 5.0, 2.0, False),
        ("a path that costs more, by another rounding", 5.0, 5.0 + 1e-9, True),
        ("nothing to save", 0.0, 0.0, True),
    ],
)
def test_a_path_stays_unless_another_saves_the_margin(case, flown, new, kept):
    policy = Replanning(improvement=0.02)
    assert stays(policy, flown_cost=flown, new_cost=new) is kept


def test_without_a_margin_every_better_path_is_taken():
    policy = Replanning(improvement=0.0)
    assert not stays(policy, flown_cost=5.0, new_cost=5.0 - 1e-9)

"""When a plan in flight is made anew."""

from __future__ import annotations

import pytest

from moar_companion.config import Replanning
from moar_companion.mission.replanning import replan_reason
from moar_companion.types import RiskIndices

POLICY = Replanning(period_s=2.0, risk_change=0.1, min_interval_s=0.3)


def reason(age_s, *, before=None, now=None, policy=POLICY):
    return replan_reason(
        policy,
        planned_risk=RiskIndices(**(before or {})),
        risk=RiskIndices(**(now or {})),
        age_s=age_s,
    )


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
def test_time_or_risk_is_the_reason(case, age_s, wind, expected):
    assert reason(age_s, now={"wind": wind}) == expected


@pytest.mark.parametrize("index", ["wind", "communication", "localization", "battery"])
def test_each_index_counts_upwards_and_downwards(index):
    assert reason(1.0, before={index: 0.2}, now={index: 0.5}) == f"{index} risk 0.20 -> 0.50"
    assert reason(1.0, before={index: 0.5}, now={index: 0.2}) == f"{index} risk 0.50 -> 0.20"


def test_small_changes_of_all_are_no_reason():
    names = ("wind", "communication", "localization", "battery")
    assert reason(1.0, now=dict.fromkeys(names, 0.09)) is None


def test_never_more_often_than_the_interval_even_when_the_period_is_shorter():
    policy = Replanning(period_s=0.1, risk_change=0.1, min_interval_s=0.5)
    assert reason(0.4, policy=policy, now={"wind": 1.0}) is None
    assert reason(0.5, policy=policy) == "time"

"""A problem under other levels of risk: the plans of the planner, and their description."""

from __future__ import annotations

from dataclasses import replace

import pytest

from moar_companion import Planner, RiskIndices, Site
from moar_companion.planner.adaptation import Adaptation
from moar_companion.planner.analysis.alternatives import (
    RISK_LEVELS,
    alternatives,
    risk_words,
    safety_words,
    same_path,
    unmoved_words,
)
from moar_companion.settings.config import shipped_configs
from moar_companion.types import Mission, Weights
from tests.vehicles import named_vehicle

SITE = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
FLOWN = named_vehicle("linedrone_uniform")


@pytest.fixture(scope="module")
def planner():
    return Planner(SITE, FLOWN)


@pytest.mark.parametrize("mission", list(Mission))
def test_each_level_of_risk_has_the_plan_of_its_weights(planner, mission):
    base = Weights.normalised(2.0, 1.0, 1.0)
    request = planner.plan(mission=mission, start=(14.0, 12.0), velocity=(0.3, 0.0)).request
    plans = alternatives(planner, request, Adaptation(base=base))
    assert [plan.request.risk for plan in plans] == list(RISK_LEVELS)
    for plan in plans:
        assert plan.weights == base.adjusted(plan.request.risk)
        again = planner.plan(
            mission=mission,
            target=request.target,
            start=(14.0, 12.0),
            velocity=(0.3, 0.0),
            weights=plan.weights,
        )
        assert same_path(plan, again)
        assert plan.cost == again.cost


def test_risk_moves_the_path(planner):
    request = planner.plan(mission="inspection", target="splice-inner").request
    plans = alternatives(planner, request, Adaptation.of(FLOWN, Mission.INSPECTION))
    assert not all(same_path(plans[0], plan) for plan in plans)
    by_risk = {plan.request.risk: plan for plan in plans}
    safe = by_risk[RiskIndices(wind=0.5)]
    hasty = by_risk[RiskIndices(battery=1.0)]
    assert safe.cost.safety < hasty.cost.safety


def test_the_reason_is_told_where_no_risk_moves_the_path(planner):
    request = planner.plan(mission="inspection", target="splice-inner").request
    plans = alternatives(planner, request, Adaptation.of(FLOWN, Mission.INSPECTION))
    safest = planner.solve(replace(request, weights=Weights.normalised(1.0, 0.0, 0.0)))
    fastest = planner.solve(replace(request, weights=Weights.normalised(0.0, 1.0, 0.0)))
    assert not same_path(safest, fastest)
    assert unmoved_words(planner, safest, [safest]) == "no risk moves the path: it is the safest"
    words = unmoved_words(planner, fastest, [fastest])
    assert f"safety cost {safest.cost.safety:.2f} (this {fastest.cost.safety:.2f})" in words
    assert unmoved_words(planner, plans[0], [safest, fastest]) == ""
    assert unmoved_words(planner, fastest, []) == ""


def test_the_safety_of_a_plan_is_its_cost_and_its_clearance_or_the_reason_of_no_plan(planner):
    plan = planner.plan(mission="inspection", target="splice-inner")
    words = safety_words(plan)
    assert words.startswith(f"safety cost {plan.cost.safety:.2f}, clearance ")
    assert words.endswith(f"{plan.metrics.min_clearance_m:.2f} m at least")
    none = planner.plan(mission="exit", start=(-5.0, 2.0))
    assert safety_words(none) == "out_of_bounds"
    assert unmoved_words(planner, none, [none]) == ""


def test_a_problem_without_a_plan_has_none_under_any_risk(planner):
    request = planner.plan(mission="exit", start=(-5.0, 2.0)).request
    plans = alternatives(planner, request, Adaptation.of(FLOWN, Mission.EXIT))
    assert {plan.status.value for plan in plans} == {"out_of_bounds"}


@pytest.mark.parametrize(
    ("risk", "words"),
    [
        (RiskIndices(), "no risk"),
        (RiskIndices(wind=0.5), "wind 0.5"),
        (RiskIndices(wind=1.0, battery=0.25), "wind 1, battery 0.25"),
    ],
)
def test_risks_are_described_in_text(risk, words):
    assert risk_words(risk) == words

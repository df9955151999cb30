"""Weights under risks by a calibration: the properties hold for any calibration, weights, risks."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moar_companion.planner.adaptation import Adaptation, Calibration, safety_demand
from moar_companion.settings.vehicle import AdaptationKind
from moar_companion.types import RiskIndices, Weights

properties = settings(deadline=None, max_examples=60, derandomize=True, database=None)
index = st.floats(0.0, 1.0)
risks = st.builds(RiskIndices, wind=index, communication=index, localization=index, battery=index)
ALL_BUT_BATTERY = RiskIndices(wind=1.0, communication=1.0, localization=1.0)


@st.composite
def rules(draw):
    """Calibrated rules: zeros among the base weights; a random broken line, or none."""
    parts = [draw(st.just(0.0) | st.floats(0.01, 1.0)) for _ in range(3)]
    base = Weights.normalised(*parts) if any(parts) else Weights(0.2, 0.3, 0.5)
    if draw(st.booleans()):
        return Adaptation(base=base, kind=AdaptationKind.CALIBRATED)
    demand, safety = [-1.0, 0.0, 1.0], [0.0, base.safety, 1.0]
    for low, high, bottom, top in ((-1.0, 0.0, 0.0, base.safety), (0.0, 1.0, base.safety, 1.0)):
        count = draw(st.integers(0, 4))
        shares = draw(st.lists(st.integers(1, 99), min_size=count, max_size=count, unique=True))
        demand += [low + (high - low) * share / 100.0 for share in shares]
        safety += [bottom + (top - bottom) * draw(index) for _ in shares]
    line = Calibration(tuple(sorted(demand)), tuple(sorted(safety)))
    return Adaptation(base=base, kind=AdaptationKind.CALIBRATED, calibration=line)


def test_the_paper_s_rule_is_equation_9():
    base, risk = Weights(0.43, 0.14, 0.43), RiskIndices(wind=0.5, battery=0.2)
    assert Adaptation(base=base).weights(risk) == base.adjusted(risk)


@properties
@given(rules())
def test_without_risk_the_base_weights_and_with_all_but_the_battery_s_safety_alone(rule):
    assert rule.weights(RiskIndices()) == rule.base
    assert rule.weights(ALL_BUT_BATTERY) == Weights(1.0, 0.0, 0.0)
    assert rule.weights(RiskIndices(battery=1.0)).safety == 0.0


@properties
@given(rules(), risks, st.sampled_from(["wind", "communication", "localization", "battery"]), index)
def test_each_index_moves_the_weights_in_the_direction_of_equation_9_only(rule, risk, name, value):
    lower, upper = sorted((getattr(risk, name), value))
    before = rule.weights(replace(risk, **{name: lower}))
    after = rule.weights(replace(risk, **{name: upper}))
    if name == "battery":
        before, after = after, before
    assert after.safety >= before.safety - 1e-12
    assert after.time <= before.time + 1e-12
    assert after.energy <= before.energy + 1e-12


@properties
@given(rules(), risks, st.floats(0.0, 1.0))
def test_an_unknown_index_raised_to_its_value_never_lowers_safety(rule, risk, unknown):
    held = {
        name: max(unknown, value) for name, value in risk.as_dict().items() if name != "battery"
    }
    assert rule.weights(replace(risk, **held)).safety >= rule.weights(risk).safety - 1e-12


@properties
@given(rules(), risks)
def test_without_a_demand_for_speed_safety_is_never_below_that_of_the_base(rule, risk):
    if safety_demand(risk) >= 0.0:
        assert rule.weights(risk).safety >= rule.base.safety - 1e-12


@properties
@given(rules(), risks)
def test_time_and_energy_keep_their_ratio(rule, risk):
    weights = rule.weights(risk)
    base = rule.base if rule.base.time + rule.base.energy else Weights(0.0, 0.5, 0.5)
    assert weights.time * base.energy == pytest.approx(weights.energy * base.time, abs=1e-12)


@properties
@given(rules(), risks, st.sampled_from(["wind", "communication", "localization", "battery"]))
def test_a_small_change_of_a_risk_is_a_small_change_of_the_weights(rule, risk, name):
    value = getattr(risk, name)
    near = replace(risk, **{name: value - 1e-9 if value > 0.5 else value + 1e-9})
    line = rule.calibration or Calibration.linear(rule.base)
    steepest = max(
        (high - low) / (there - here)
        for (here, there), (low, high) in zip(
            pairwise(line.demand), pairwise(line.safety), strict=True
        )
    )
    change = abs(rule.weights(risk).safety - rule.weights(near).safety)
    assert change <= 1e-9 * steepest + 1e-12

"""Calibrated weights on random problems and fronts: what the paths do under risks."""

from __future__ import annotations

import random
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moar_companion.errors import InputError
from moar_companion.planner import calibration as calibration_module
from moar_companion.planner import planner as planner_module
from moar_companion.planner.adaptation import Adaptation, Calibration
from moar_companion.planner.calibration import calibrated
from moar_companion.planner.plan_values import Cost, PlanStatus
from moar_companion.planner.planner import Planner
from moar_companion.settings.vehicle import AdaptationKind
from moar_companion.types import RiskIndices, Weights

from .problems import conductor, make_site, make_vehicle, polygon, random_problem

seeds = st.integers(min_value=0, max_value=10**6)
properties = settings(deadline=None, max_examples=40, derandomize=True, database=None)
DEMANDS = np.linspace(-1.0, 1.0, 41).tolist()


def risk_of(demand):
    """Risks with a demand for safety."""
    if demand < 0.0:
        return RiskIndices(battery=-demand)
    return RiskIndices(wind=demand, communication=demand, localization=demand)


@st.composite
def fronts(draw):
    """Sums (n, 3) of the paths of a problem, from which the optimum for weights is chosen."""
    value = st.integers(0, 1000).map(lambda thousandth: thousandth / 100.0)
    rows = draw(st.lists(st.tuples(value, value, value), min_size=1, max_size=8))
    return np.array(rows)


def solver_of(sums):
    """The optimum by brute force; equal costs as in the planner."""

    def solve(weights):
        j = sums @ (weights.safety, weights.time, weights.energy)
        at = min(range(len(sums)), key=lambda row: (round(j[row], 12), sums[row, 1:].sum()))
        safety, time, energy = sums[at].tolist()
        return Cost(total=float(j[at]), safety=safety, time=time, energy=energy)

    return solve


def random_base(rng):
    return Weights.normalised(*(rng.choice([0.0, rng.random() + 0.01]) for _ in range(2)), 0.1)


@properties
@given(fronts(), seeds)
def test_the_safety_gained_is_in_proportion_to_half_a_gap_of_the_front(sums, seed):
    base, solve = random_base(random.Random(seed)), solver_of(sums)
    rule = Adaptation(
        base=base, kind=AdaptationKind.CALIBRATED, calibration=calibrated(base, solve)
    )
    safety = [solve(rule.weights(risk_of(demand))).safety for demand in DEMANDS if demand >= 0.0]
    span = safety[0] - safety[-1]
    # All points between the two ends along the line: by a sweep that is fine enough for the front.
    rest = sums[:, 1:] @ (base.time, base.energy) / (base.time + base.energy)
    k = np.linspace(base.safety, 1.0, 2001)[:, None]
    best = (k * sums[:, 0] + (1.0 - k) * rest).argmin(axis=1)
    widest = float(-np.diff(sums[best, 0], append=safety[-1]).min())
    for demand, value in zip(DEMANDS[20:], safety, strict=True):
        assert safety[0] - value == pytest.approx(demand * span, abs=0.5 * widest + 1e-6)


@properties
@given(fronts(), seeds)
def test_the_safety_cost_never_rises_with_the_demand_for_safety(sums, seed):
    base, solve = random_base(random.Random(seed)), solver_of(sums)
    rule = Adaptation(
        base=base, kind=AdaptationKind.CALIBRATED, calibration=calibrated(base, solve)
    )
    # On another problem than the calibrated one, too: from elsewhere, with another velocity.
    for other in (solve, solver_of(np.abs(sums - sums[:, ::-1]) + 0.01)):
        costs = [other(rule.weights(risk_of(demand))) for demand in DEMANDS]
        for before, after in pairwise(costs):
            assert after.safety <= before.safety + 1e-9


@properties
@given(seeds)
def test_a_front_of_a_single_point_leaves_safety_linear_in_the_demand(seed):
    base = random_base(random.Random(seed))
    line = calibrated(base, solver_of(np.array([[1.0, 2.0, 3.0]])))
    assert line == Calibration.linear(base)


@settings(properties, max_examples=15)
@given(seeds)
def test_plans_of_random_problems_begin_with_the_base_and_end_with_the_safest(seed):
    rng = random.Random(seed)
    problem = random_problem(rng)
    base = random_base(rng)
    problem = replace(problem, weights=base, velocity_mps=(0.0, 0.0))
    planner = Planner(problem.site, problem.vehicle)

    def plan(risk, weights=base):
        return planner.plan(
            mission=problem.mission, target=problem.target, start=problem.start_m,
            weights=weights, risk=risk, adaptation="calibrated",
        )  # fmt: skip

    try:
        calm = plan(risk_of(0.0))
    except InputError:
        return
    if calm.status is not PlanStatus.FOUND:
        assert not calm.request.adaptation.calibration
        return
    assert calm.weights == base
    safest = planner.plan(
        mission=problem.mission, target=problem.target, start=problem.start_m,
        weights=Weights(1.0, 0.0, 0.0),
    )  # fmt: skip
    assert plan(risk_of(1.0)).cost == safest.cost
    safety = [plan(risk_of(demand)).cost.safety for demand in DEMANDS[::4]]
    assert all(after <= before + 1e-9 for before, after in pairwise(safety))


def test_a_long_front_is_calibrated_with_a_limited_number_of_plans():
    asked = []
    angle = np.linspace(0.0, 0.5 * np.pi, 500)
    solve = solver_of(np.column_stack([1 - np.cos(angle), 1 - np.sin(angle), np.zeros(500)]))

    def counted(weights):
        asked.append(weights)
        return solve(weights)

    base = Weights(0.2, 0.8, 0.0)
    line = calibrated(base, counted)
    assert len(asked) <= calibration_module.MOST_PLANS
    half = Adaptation(base=base, kind=AdaptationKind.CALIBRATED, calibration=line)
    ends = [solve(half.weights(risk_of(demand))).safety for demand in (0.0, 0.5, 1.0)]
    assert ends[1] == pytest.approx(0.5 * (ends[0] + ends[2]), abs=0.03)


def test_a_calibration_is_made_once_for_a_start_and_again_for_other_maps():
    site = make_site(conductor(5.0, 4.0))
    planner = Planner(site, make_vehicle())
    risk = RiskIndices(wind=0.6)

    def line(start):
        plan = planner.plan(mission="inspection", start=start, risk=risk, adaptation="calibrated")
        return plan.request.adaptation.calibration

    first = line((0.5, 0.5))
    assert line((0.7, 0.3)) is first, "the same cell"
    assert line((0.5, 6.5)) is not first
    planner.set_obstacles((conductor(5.0, 5.0),))
    assert line((0.5, 0.5)) is not first


def test_the_oldest_calibration_is_dropped_where_there_are_too_many(monkeypatch):
    monkeypatch.setattr(planner_module, "_MOST_CALIBRATIONS", 2)
    planner = Planner(make_site(conductor(5.0, 4.0)), make_vehicle())

    def line(start):
        plan = planner.plan(
            mission="inspection",
            start=start,
            risk=RiskIndices(wind=0.6),
            adaptation="calibrated",
        )
        return plan.request.adaptation.calibration

    first, second = line((0.5, 0.5)), line((0.5, 6.5))
    line((0.5, 3.5))
    assert line((0.5, 6.5)) is second
    assert line((0.5, 0.5)) is not first


def test_a_start_from_which_no_path_leads_leaves_the_weights_uncalibrated():
    wall = polygon((4.2, -1.0), (4.8, -1.0), (4.8, 20.0), (4.2, 20.0))
    planner = Planner(make_site(wall), make_vehicle())
    plan = planner.plan(mission="inspection", risk=RiskIndices(wind=0.6), adaptation="calibrated")
    assert plan.status is PlanStatus.UNREACHABLE
    assert plan.request.adaptation.calibration is None

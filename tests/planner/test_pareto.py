"""The whole trade-off: the front has every optimum, and ranges end where the path changes."""

from __future__ import annotations

import json
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moar_companion.errors import InputError
from moar_companion.planner.adaptation import Adaptation
from moar_companion.planner.analysis.pareto import front_document, pareto_front, sensitivity
from moar_companion.planner.plan_values import PlanStatus
from moar_companion.planner.planner import Planner
from moar_companion.planner.whole_front import whole_front
from moar_companion.types import RiskIndices, Weights

from .problems import CORNERS, conductor, make_site, make_vehicle, random_problem, random_weights

seeds = st.integers(min_value=0, max_value=10**6)
properties = settings(deadline=None, max_examples=40, derandomize=True, database=None)
SITE = make_site(
    conductor(5.0, 4.0), conductor(6.0, 7.0), size=(12.0, 10.0), resolution=0.5,
    start=(1.0, 1.0), targets={"t": (10.0, 8.5)},
)  # fmt: skip


def solved(problem):
    """A planner and the plan of a problem; None unless there is a path."""
    planner = Planner(problem.site, problem.vehicle)
    try:
        plan = problem.ask(planner)
    except InputError:
        return None
    return (planner, plan) if plan.status is PlanStatus.FOUND else None


def j_of(planner, request, weights):
    plan = planner.plan(
        mission=request.mission,
        target=request.target,
        start=request.start_m,
        velocity=request.velocity_mps,
        weights=weights,
    )
    return plan.cost.total


@properties
@given(seeds)
def test_the_optimum_for_any_weights_is_the_least_of_the_front(seed):
    rng = random.Random(seed)
    found = solved(random_problem(rng))
    if found is None:
        return
    planner, plan = found
    front = pareto_front(planner, plan.request)
    sums = np.array([point.sums for point in front])
    for weights in [Weights(*corner) for corner in CORNERS] + [
        random_weights(rng) for _ in "12345"
    ]:
        j = j_of(planner, plan.request, weights)
        least = (sums @ [weights.safety, weights.time, weights.energy]).min()
        assert least == pytest.approx(j, rel=1e-8, abs=1e-8)


@properties
@given(seeds)
def test_each_point_is_best_in_its_region_and_the_regions_cover_all_weights(seed):
    found = solved(random_problem(random.Random(seed)))
    if found is None:
        return
    planner, plan = found
    front = pareto_front(planner, plan.request)
    area = 0.0
    for point in front:
        weights = Weights.normalised(*point.region.mean(axis=0).tolist())
        own = point.sums @ [weights.safety, weights.time, weights.energy]
        assert own == pytest.approx(j_of(planner, plan.request, weights), rel=1e-8, abs=1e-8)
        for second, third in zip(point.region[1:], point.region[2:], strict=False):
            area += abs(np.linalg.det([point.region[0], second, third]))
    assert area == pytest.approx(1.0, abs=1e-6)


def test_the_front_is_sorted_by_safety_and_no_point_is_dominated():
    planner = Planner(SITE, make_vehicle())
    front = pareto_front(planner, planner.plan(mission="inspection").request)
    sums = np.array([point.sums for point in front])
    assert len(front) > 3
    assert (np.diff(sums[:, 0]) >= 0.0).all()
    for one in sums:
        assert not ((sums <= one).all(axis=1) & (sums < one - 1e-9).any(axis=1)).any()


def test_without_a_path_there_is_no_front():
    planner = Planner(SITE, make_vehicle())
    plan = planner.plan(mission="inspection", start=(5.0, 4.0))
    assert plan.status is PlanStatus.START_OCCUPIED
    assert pareto_front(planner, plan.request) == []


def test_within_a_weight_range_the_path_is_best_and_beyond_the_range_another_path():
    planner = Planner(SITE, make_vehicle())
    base, risk = Weights(0.3, 0.4, 0.3), RiskIndices(wind=0.3, battery=0.1)
    plan = planner.plan(mission="inspection", weights=base, risk=risk)
    ranges = sensitivity(planner, plan, Adaptation(base=base))
    own = plan.cost
    ends = 0
    for name, item in ranges["risk"].items():
        assert item.lower <= item.value <= item.upper
        for value, best in (
            (item.lower, True), (item.upper, True),
            (item.lower - 1e-4, False), (item.upper + 1e-4, False),
        ):  # fmt: skip
            if not 0.0 <= value <= 1.0:
                continue
            weights = base.adjusted(RiskIndices(**(risk.as_dict() | {name: value})))
            mine = (
                weights.safety * own.safety + weights.time * own.time + weights.energy * own.energy
            )
            j = j_of(planner, plan.request, weights)
            assert (mine <= j + 1e-7) if best else (mine > j)
            ends += not best
    assert ends > 0


def test_the_slope_along_a_weight_is_how_j_changes_there():
    planner = Planner(SITE, make_vehicle())
    weights = Weights(0.3, 0.4, 0.3)
    plan = planner.plan(mission="inspection", weights=weights)
    time = sensitivity(planner, plan, Adaptation(base=weights))["weights"]["time"]
    more = Weights(0.5 * (1.0 - 0.401), 0.401, 0.5 * (1.0 - 0.401))
    assert time.lower <= 0.401 <= time.upper
    change = (j_of(planner, plan.request, more) - plan.cost.total) / 0.001
    assert change == pytest.approx(time.slope, rel=1e-6)


def test_the_document_is_json_and_has_every_path():
    planner = Planner(SITE, make_vehicle())
    plan = planner.plan(mission="inspection")
    front = pareto_front(planner, plan.request)
    ranges = sensitivity(planner, plan, Adaptation(base=plan.weights))
    whole = whole_front(planner, plan.request)
    document = json.loads(json.dumps(front_document(plan, front, ranges, whole), allow_nan=False))
    assert len(document["points"]) == len(front)
    for point in document["points"]:
        assert set(point) == {
            "safety", "time", "energy", "weights", "metrics", "states",
        }  # fmt: skip
        assert point["states"][0] == document["points"][0]["states"][0]
    trade_offs = document["trade_offs"]
    assert [row["safety"] for row in trade_offs] == pytest.approx(whole.first)
    assert [row["supported"] for row in trade_offs] == whole.supported.tolist()
    assert set(document["sensitivity"]) == {"weights", "risk"}
    assert set(document["sensitivity"]["risk"]) == set(RiskIndices().as_dict())
    assert set(document["sensitivity"]["weights"]["time"]) == {"value", "slope", "lower", "upper"}

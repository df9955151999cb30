"""Plans against a plain Dijkstra over (cell, heading), on random problems."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from moar_companion.errors import InputError
from moar_companion.planner.plan_values import PlanStatus
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Site
from moar_companion.settings.vehicle import Vehicle
from moar_companion.types import Mission, Weights
from tests.thorough import sampled

from . import oracle
from .problems import Problem, random_problem, random_velocity, random_weights

SITES = Path(__file__).parents[2] / "configs" / "sites"
EQUAL = 1e-13
"""Costs closer than this are equal but for rounding: the planner's second criterion counts 1e-10,
its third 1e-17."""


def expected_status(problem, maps):
    """The status before any search, in the order of the contract; None where one is due."""
    start = oracle.cell_of(problem.site.workspace, problem.start_m)
    if start is None:
        return PlanStatus.OUT_OF_BOUNDS
    if maps.occupied[start]:
        return PlanStatus.START_OCCUPIED
    if problem.mission is Mission.INSPECTION:
        (cell,) = oracle.goal_of(problem, maps)
        if cell is None:
            return PlanStatus.OUT_OF_BOUNDS
        if maps.occupied[cell]:
            return PlanStatus.TARGET_OCCUPIED
    return None


def check(problem):
    """Plans without and with tables agree with the oracle; answers what became of the problem."""
    planner = Planner(problem.site, problem.vehicle)
    maps = oracle.build_maps(problem.site, problem.vehicle)
    status = expected_status(problem, maps)
    if status is not None:
        assert problem.ask(planner).status is status
        return status.value
    goal = oracle.goal_of(problem, maps)
    if not goal:
        with pytest.raises(InputError, match="landing"):
            problem.ask(planner)
        return "no landing point"
    best = oracle.shortest(problem, maps, goal)
    cold = problem.ask(planner)
    outcome = check_plan(problem, maps, goal, best, cold)
    planner.prepare(mission=problem.mission, target=problem.target)
    prepared = problem.ask(planner)
    assert check_plan(problem, maps, goal, best, prepared) == outcome
    if best is not None:
        check_alike(cold, prepared)
    return outcome


def check_alike(cold, prepared):
    """With and without tables, plans differ at most in the order of their actions."""
    for name in ("total", "safety", "time", "energy"):
        assert getattr(prepared.cost, name) == pytest.approx(getattr(cold.cost, name), abs=1e-9)
    assert len(prepared.states) == len(cold.states)
    legs = [plan.landing_leg and plan.landing_leg.length_m for plan in (cold, prepared)]
    assert legs[0] == pytest.approx(legs[1], abs=1e-9)


def check_plan(problem, maps, goal, best, plan):
    """One plan and the oracle's best agree."""
    if best is None:
        assert plan.status is PlanStatus.UNREACHABLE
        return "unreachable"
    assert plan.status is PlanStatus.FOUND
    j, time_and_energy, actions = best
    tolerance = 1e-9 * max(1.0, j)
    assert plan.cost.total == pytest.approx(j, rel=0.0, abs=tolerance)
    terms = oracle.cost_terms(problem, maps, plan.states)
    assert (plan.cost.safety, plan.cost.time, plan.cost.energy) == pytest.approx(terms, abs=1e-9)
    assert oracle.weighted(problem.weights, terms) == pytest.approx(j, rel=0.0, abs=tolerance)
    assert oracle.ends_as_it_must(problem, goal, plan.states)
    # Among equal costs: the least time and energy, then the fewest actions.
    assert terms[1] + terms[2] <= time_and_energy + 1e-9 * max(1.0, time_and_energy)
    if abs(plan.cost.total - j) < EQUAL and abs(terms[1] + terms[2] - time_and_energy) < EQUAL:
        assert len(plan.states) - 1 <= actions
    return "found" if len(plan.states) > 1 else "already there"


@pytest.mark.parametrize(
    "batch", [0, *(pytest.param(batch, marks=pytest.mark.slow) for batch in (1, 2))]
)
def test_plans_are_the_optimum_of_a_plain_dijkstra(batch):
    rng = random.Random(f"optimality {batch}")
    outcomes = [check(random_problem(rng)) for _ in range(60)]
    assert outcomes.count("found") >= 25


@pytest.mark.slow
@pytest.mark.parametrize("batch", range(sampled(1, 4)))
def test_many_more_plans_are_the_optimum_of_a_plain_dijkstra(batch):
    rng = random.Random(f"many more {batch}")
    for _ in range(sampled(100, 300)):
        check(random_problem(rng))


@pytest.mark.slow
@pytest.mark.parametrize("mission", list(Mission))
@pytest.mark.parametrize("site", sorted(SITES.glob("*.yaml")), ids=lambda path: path.stem)
def test_plans_of_the_shipped_sites_are_the_optimum_of_a_plain_dijkstra(site, mission):
    rng = random.Random(f"{site.stem} {mission.value}")
    site, vehicle = Site.load(site), Vehicle.load(SITES.parent / "vehicles" / "linedrone.yaml")
    target = site.targets[-1].name if mission is Mission.INSPECTION else None
    begun = [
        (vehicle.weights[mission], (0.0, 0.0)),
        (Weights(1.0, 0.0, 0.0), (3.0, 1.0)),
        (random_weights(rng), random_velocity(rng, vehicle)),
    ]
    for weights, velocity in sampled([rng.choice(begun)], begun):
        outcome = check(
            Problem(
                site=site,
                vehicle=vehicle,
                mission=mission,
                target=target,
                start_m=site.start_m,
                velocity_mps=velocity,
                weights=weights,
            )
        )
        assert outcome in ("found", "already there")

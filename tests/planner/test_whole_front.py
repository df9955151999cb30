"""The whole front has every optimal trade-off, and wishes get the best path that there is."""

from __future__ import annotations

import heapq
import math
import random

import numpy as np
import pytest

from moar_companion.errors import InputError
from moar_companion.planner.plan_values import PlanStatus
from moar_companion.planner.planner import Planner
from moar_companion.planner.whole_front import Limited, Preference, Wish, choose, whole_front
from moar_companion.types import Mission, Weights

from . import oracle
from .problems import conductor, make_site, make_vehicle, random_problem

SITE = make_site(
    conductor(5.0, 4.0), conductor(6.0, 7.0), size=(12.0, 10.0), resolution=0.5,
    start=(1.0, 1.0), targets={"t": (10.0, 8.5)}, exits=[(14.0, 0.0)],
)  # fmt: skip
SAFEST, FASTEST = Preference.SAFEST, Preference.FASTEST


def wish(prefer, **limits):
    ((limited, limit),) = limits.items()
    return Wish(limited=Limited(limited), limit=limit, prefer=prefer)


def power_w(level_mps, up_mps):
    return 400.0 + 10.0 * level_mps + 60.0 * np.maximum(up_mps, 0.0)


def is_better(one, other):
    """True where no sum is greater, and one is less by more than rounding."""
    return all(a <= b + 1e-9 for a, b in zip(one, other, strict=True))


def plain_front(problem, maps, goal, sums):
    """All undominated pairs of sums at the goal: each path compared with all to the same state.

    sums: from the terms of a step to its two costs.
    """
    start = oracle.cell_of(problem.site.workspace, problem.start_m)
    needs_rest = problem.mission is Mission.INSPECTION
    known = {(start, None): [(0.0, 0.0)]}
    waiting = [((0.0, 0.0), 0, (start, None))]
    pushed, ends = 0, []
    while waiting:
        costs, _, state = heapq.heappop(waiting)
        if costs not in known[state]:
            continue
        cell, heading = state
        if cell in goal and (not needs_rest or heading == 0):
            ends.append(costs)
            continue
        velocity = (
            problem.velocity_mps
            if heading is None
            else oracle.velocity_in(maps, problem.vehicle, cell, heading)
        )
        actions = [*oracle.moves_from(maps, cell)]
        if cell in goal:
            actions.append((0, cell))
        for action, there in actions:
            terms, _ = oracle.step_terms(problem, maps, velocity, there, action)
            longer = tuple(a + b for a, b in zip(costs, sums(terms), strict=True))
            after = (there, action)
            others = known.setdefault(after, [])
            if any(is_better(other, longer) for other in others):
                continue
            known[after] = [other for other in others if not is_better(longer, other)] + [longer]
            pushed += 1
            heapq.heappush(waiting, (longer, pushed, after))
    front = []
    for costs in sorted(set(ends)):
        if not any(is_better(other, costs) for other in front):
            front = [other for other in front if not is_better(costs, other)] + [costs]
    return sorted(front)


def small_problem(rng):
    return random_problem(rng, columns=(4, 7), rows=(4, 6))


def solved(problem):
    """A planner and the plan of a problem; None unless there is a path."""
    planner = Planner(problem.site, problem.vehicle)
    try:
        plan = problem.ask(planner)
    except InputError:
        return None
    return (planner, plan) if plan.status is PlanStatus.FOUND else None


@pytest.mark.parametrize(
    "batch", [0, *(pytest.param(batch, marks=pytest.mark.slow) for batch in (1, 2))]
)
def test_the_front_is_that_of_a_plain_search_which_compares_all_paths(batch):
    rng = random.Random(f"whole front {batch}")
    points = 0
    for _ in range(25):
        problem = small_problem(rng)
        found = solved(problem)
        if found is None or len(found[1].states) == 1:
            continue
        planner, plan = found
        weights = problem.weights
        share = (
            weights.time / (weights.time + weights.energy) if weights.safety < 1.0 - 1e-12 else 0.5
        )
        maps = oracle.build_maps(problem.site, problem.vehicle)
        goal = oracle.goal_of(problem, maps)
        if oracle.cell_of(problem.site.workspace, problem.start_m) in goal:
            continue

        def sums(terms, share=share):
            return terms[0], share * terms[1] + (1 - share) * terms[2]

        expected = plain_front(problem, maps, goal, sums)
        front = whole_front(planner, plan.request)
        assert front.closeness == 0.0
        assert np.column_stack([front.first, front.second]) == pytest.approx(
            np.array(expected), abs=1e-7
        )
        for index in range(len(front)):
            path = front.plan(index)
            terms = oracle.cost_terms(problem, maps, path.states)
            assert oracle.ends_as_it_must(problem, goal, path.states)
            assert sums(terms) == pytest.approx((front.first[index], front.second[index]), abs=1e-9)
        points += len(front)
    assert points > 15


def test_the_front_has_the_optimum_of_all_weights_and_trade_offs_of_no_weights_between_them():
    planner = Planner(SITE, make_vehicle())
    request = planner.plan(mission="inspection", weights=Weights(0.5, 0.5, 0.0)).request
    front = whole_front(planner, request)
    sums = np.column_stack([front.first, front.second])
    reached = set()
    for safety in np.linspace(0.0, 1.0, 101):
        weights = Weights(safety, 1.0 - safety, 0.0)
        totals = sums @ [weights.safety, weights.time]
        plan = planner.plan(mission="inspection", weights=weights)
        assert totals.min() == pytest.approx(plan.cost.total, abs=1e-8)
        reached.add(int(totals.argmin()))
    assert reached <= set(np.flatnonzero(front.supported).tolist())
    assert front.supported.sum() < len(front)
    assert (np.diff(front.first) > 0.0).all()
    assert (np.diff(front.second) < 0.0).all()


def check_wish(planner, request, wished, value_of, front):
    """The choice is the best of a front: (preferred, limited) of each point."""
    choice = choose(planner, request, wished, power_w)
    allowed = [point for point in front if point[1] <= wished.limit + 1e-9]
    assert choice.fulfilled == bool(allowed)
    assert choice.value == pytest.approx(value_of(choice.plan), rel=1e-9)
    best = min(allowed) if allowed else min(front, key=lambda point: point[1])
    preferred = (
        choice.plan.cost.safety if wished.prefer is SAFEST else choice.plan.metrics.duration_s
    )
    assert preferred == pytest.approx(best[0], abs=1e-8)


def flight_wh(plan):
    step_s = np.diff(plan.waypoints.time_s)
    velocity = np.diff(plan.waypoints.position_m, axis=0)[step_s > 0.0]
    step_s = step_s[step_s > 0.0]
    velocity = velocity / step_s[:, None]
    return float(power_w(np.abs(velocity[:, 0]), velocity[:, 1]) @ step_s) / 3600.0


def test_the_safest_path_within_a_time_is_the_best_of_all_paths_that_take_no_longer():
    for seed in range(12):
        problem = small_problem(random.Random(f"within {seed}"))
        found = solved(problem)
        if found is None or problem.mission is not Mission.INSPECTION:
            continue
        planner, plan = found
        maps = oracle.build_maps(problem.site, problem.vehicle)
        goal = oracle.goal_of(problem, maps)
        front = plain_front(problem, maps, goal, lambda terms: terms[:2])
        least_s, most_s = front[-1][1], front[0][1]
        for within_s in (0.9 * least_s, 0.5 * (least_s + most_s), most_s, 2.0 * most_s):
            wished = wish(SAFEST, duration_s=within_s)
            check_wish(planner, plan.request, wished, lambda it: it.metrics.duration_s, front)


def test_times_and_energies_of_a_wish_have_the_landing_leg():
    planner = Planner(SITE, make_vehicle())
    request = planner.plan(mission="exit").request
    fastest = choose(planner, request, wish(FASTEST, duration_s=1e3))
    assert fastest.value == pytest.approx(fastest.plan.metrics.duration_s, rel=1e-12)
    for share in (1.0, 1.05, 1.3):
        within_s = share * fastest.value
        choice = choose(planner, request, wish(SAFEST, duration_s=within_s))
        assert choice.plan.metrics.duration_s <= within_s + 1e-9
    frugal = choose(planner, request, wish(SAFEST, energy_wh=0.0), power_w)
    assert not frugal.fulfilled
    assert frugal.value == pytest.approx(flight_wh(frugal.plan), rel=1e-9)
    choice = choose(planner, request, wish(FASTEST, energy_wh=frugal.value), power_w)
    assert choice.fulfilled
    assert flight_wh(choice.plan) <= frugal.value + 1e-9


def test_an_end_farther_along_the_border_is_chosen_where_its_landing_leg_is_faster():
    planner = Planner(make_site(start=(5.5, 6.5), exits=[(20.0, 0.0)]), make_vehicle())
    request = planner.plan(mission="exit").request
    fastest = choose(planner, request, wish(FASTEST, duration_s=1e3))
    assert (
        fastest.plan.metrics.duration_s
        <= planner.plan(mission="exit", weights=Weights(0.0, 1.0, 0.0)).metrics.duration_s
    )


def test_the_fastest_path_with_a_clearance_is_the_fastest_that_passes_no_nearer():
    planner = Planner(SITE, make_vehicle())
    request = planner.plan(mission="inspection").request
    fastest = choose(planner, request, wish(FASTEST, clearance_m=0.0)).plan
    before_s = fastest.metrics.duration_s
    for clearance_m in (0.8, 1.2, 1.6, 1.9):
        choice = choose(planner, request, wish(FASTEST, clearance_m=clearance_m))
        assert choice.fulfilled
        assert choice.plan.metrics.min_clearance_m >= clearance_m
        assert choice.plan.metrics.duration_s >= before_s - 1e-9
        before_s = choice.plan.metrics.duration_s
    assert before_s > fastest.metrics.duration_s


def test_where_no_path_has_the_clearance_the_one_of_the_greatest_is_named():
    planner = Planner(SITE, make_vehicle())
    request = planner.plan(mission="inspection").request
    choice = choose(planner, request, wish(FASTEST, clearance_m=50.0))
    assert not choice.fulfilled
    assert choice.value == choice.plan.metrics.min_clearance_m
    wider = choose(planner, request, wish(FASTEST, clearance_m=np.nextafter(choice.value, 99.0)))
    assert not wider.fulfilled
    assert choose(planner, request, wish(SAFEST, clearance_m=choice.value)).fulfilled


def test_without_a_path_there_is_no_front_and_no_choice():
    planner = Planner(SITE, make_vehicle())
    request = planner.plan(mission="inspection", start=(5.0, 4.0)).request
    assert whole_front(planner, request) is None
    for wished in (wish(SAFEST, duration_s=9.0), wish(SAFEST, clearance_m=1.0)):
        choice = choose(planner, request, wished)
        assert choice.plan is None
        assert math.isnan(choice.value)


def test_at_the_goal_the_front_is_the_stop_alone():
    planner = Planner(SITE, make_vehicle())
    request = planner.plan(
        mission="inspection", start=(10.0, 8.5), velocity=(1.0, 0.0), weights=Weights(0, 0, 1.0)
    ).request
    front = whole_front(planner, request)
    assert len(front) == 1
    assert front.second[0] == pytest.approx(front.plan(0).cost.energy)

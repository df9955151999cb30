"""Two paths side by side."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from moar_companion import Planner
from moar_companion.planner.comparison import is_free, path_difference, rest_of
from moar_companion.types import RiskIndices, Weights

from .problems import conductor, make_site, make_vehicle

SAFE, FAST = Weights(0.9, 0.05, 0.05), Weights(0.0, 1.0, 0.0)


@pytest.fixture(scope="module")
def planner():
    site = make_site(
        conductor(5.0, 4.0),
        size=(10.0, 8.0),
        resolution=0.25,
        start=(1.0, 3.1),
        targets={"target": (9.0, 3.1)},
        exits=((12.0, 0.0),),
    )
    return Planner(site, make_vehicle(speeds=(2.0, 2.0, 2.0, 2.0, 2.0)))


def bent(plan, heights_m):
    """The plan with a path of its own: a metre along x at a time, at these heights."""
    states = [[4 * at + 2, 4 * height_m + 2, 3] for at, height_m in enumerate(heights_m)]
    return replace(plan, states=np.array(states))


def test_the_difference_of_two_paths_is_their_greatest_and_mean_distance(planner):
    plan = planner.plan(mission="inspection")
    before, after = bent(plan, [0, 0, 0, 0, 0]), bent(plan, [0, 1, 2, 1, 0])
    difference = path_difference(before, after)
    assert (difference.greatest_m, difference.mean_m) == pytest.approx((2.0, 0.8))
    assert difference.where_m == (2.625, 2.625)
    # From a slope to the line below it is not straight down.
    assert path_difference(after, before).greatest_m == pytest.approx(math.sqrt(2.0))


def test_a_path_of_one_point_is_compared_too(planner):
    plan = planner.plan(mission="inspection")
    assert path_difference(bent(plan, [0]), bent(plan, [3])).greatest_m == 3.0


def test_a_safer_path_is_reported_as_moved_outwards(planner):
    fast = planner.plan(mission="inspection", weights=FAST)
    safe = planner.plan(mission="inspection", weights=SAFE)
    away, back = path_difference(fast, safe), path_difference(safe, fast)
    assert away.mean_clearance_m == (fast.metrics.mean_clearance_m, safe.metrics.mean_clearance_m)
    assert away.gist() == f"path {away.greatest_m:.1f} m outward"
    assert back.gist() == f"path {back.greatest_m:.1f} m inward"
    assert away.words().startswith(f"{away.gist()}, {away.mean_m:.1f} m on average; clearance ")


def test_the_same_path_has_stayed(planner):
    plan = planner.plan(mission="inspection")
    assert path_difference(plan, plan).words() == "path stays"


def test_without_obstacles_no_clearance_is_reported():
    site = make_site(targets={"target": (8.5, 0.5), "other": (8.5, 6.5)})
    planner = Planner(site, make_vehicle())
    one, other = (planner.plan(mission="inspection", target=name) for name in ("target", "other"))
    difference = path_difference(one, other)
    assert "clearance" not in difference.words()
    assert json.loads(json.dumps(difference.to_dict(), allow_nan=False))["min_clearance_m"] == [
        None,
        None,
    ]


def test_a_plan_that_was_not_found_has_no_path_to_compare(planner):
    found, none = (
        planner.plan(mission="inspection"),
        planner.plan(mission="inspection", start=(-5, 0)),
    )
    assert path_difference(found, none) is None
    assert path_difference(none, found) is None


@pytest.mark.parametrize("mission", ["inspection", "exit"])
@pytest.mark.parametrize("first", [0, 1, 7])
def test_the_rest_of_an_optimal_plan_is_the_optimal_plan_from_there(planner, mission, first):
    # Bellman: under the same weights a new plan from a state of the path saves nothing.
    plan = planner.plan(mission=mission, weights=SAFE)
    cell, heading = plan.states[first, :-1], plan.states[first, -1]
    flat = planner.graph.grid.flat(tuple(cell))
    velocity = planner.graph.speed[flat, heading] * planner.graph.unit[heading]
    newer = planner.plan(
        mission=mission,
        start=tuple(plan.waypoints.position_m[first]),
        velocity=tuple(velocity),
        weights=SAFE,
    )
    rest = rest_of(plan, planner.maps, first, newer.request, newer.graph)
    assert rest.cost.total == pytest.approx(newer.cost.total, abs=1e-9)
    assert rest.metrics.duration_s == pytest.approx(newer.metrics.duration_s, rel=1e-6)
    assert rest.states.tolist() == plan.states[first:].tolist()


def test_under_other_weights_the_rest_costs_at_least_as_much_as_a_new_plan(planner):
    plan = planner.plan(mission="inspection", weights=FAST)
    risk = RiskIndices(wind=0.5)
    newer = planner.plan(mission="inspection", weights=SAFE, risk=risk)
    rest = rest_of(plan, planner.maps, 0, newer.request, newer.graph)
    assert rest.cost.total > newer.cost.total
    assert (rest.weights, rest.request.risk) == (SAFE.adjusted(risk), risk)


def test_a_path_on_which_there_is_an_obstacle_now_is_not_free(planner):
    plan = planner.plan(mission="inspection", weights=FAST)
    assert is_free(planner.graph, plan.states)
    middle = plan.waypoints.position_m[len(plan.states) // 2]
    blocked = replace(
        planner.site, obstacles=(*planner.site.obstacles, conductor(*middle, name="new"))
    )
    today = Planner(blocked, planner.vehicle)
    assert not is_free(today.graph, plan.states)
    assert rest_of(plan, today.maps, 0, plan.request, today.graph) is None
    beyond = len(plan.states) - 4
    assert rest_of(plan, today.maps, beyond, plan.request, today.graph) is not None

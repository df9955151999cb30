"""Tables: their bounds hold for all weights, and plans for any weights are found with them."""

from __future__ import annotations

import contextlib
import dataclasses
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moar_companion.errors import InputError
from moar_companion.planner import planner as planner_module
from moar_companion.planner.adaptation import Adaptation
from moar_companion.planner.cost_to_go_tables import TableBuilder
from moar_companion.planner.plan_values import PlanStatus
from moar_companion.planner.planner import Planner
from moar_companion.planner.search import locate
from moar_companion.planner.solver import Goal, Solver
from moar_companion.types import Mission, Weights

from .problems import CORNERS, conductor, make_site, make_vehicle, random_problem, random_weights

seeds = st.integers(min_value=0, max_value=10**6)
properties = settings(deadline=None, max_examples=40, derandomize=True, database=None)
SITE = make_site(conductor(5.0, 4.0), conductor(2.0, 6.0), size=(10.0, 8.0), resolution=0.5)


def graph_and_goal(problem):
    """The graph of a problem and its goal; None where it has none."""
    planner = Planner(problem.site, problem.vehicle)
    try:
        goal = planner._goal((problem.mission, problem.target)).goal
    except InputError:
        return None
    return (planner.graph, goal) if len(goal.cells) else None


def field_of(graph, goal, weights):
    cells, moves = len(graph.allowed), len(graph.offset) - 1
    label, policy = np.empty((cells, moves)), np.empty((cells, moves), dtype=np.uint8)
    Solver(graph).field(goal, weights, label, policy)
    return label, policy


def refined(builder, cuts):
    for _ in range(cuts):
        builder.refine()
    return builder.table()


@properties
@given(seeds)
def test_the_field_is_consistent_and_its_policy_has_the_cost_of_the_field(seed):
    # Bellman's equation in every state, written out over the moves of every cell.
    rng = random.Random(seed)
    found = graph_and_goal(random_problem(rng))
    if found is None:
        return
    graph, goal = found
    weights = random_weights(rng)
    label, policy = field_of(graph, goal, weights)
    energy = weights.energy / (2.0 * graph.v_max_mps)
    velocity = graph.speed[:, :, None] * graph.unit
    best = np.full_like(label, np.inf)
    for heading in range(1, len(graph.offset)):
        cells = np.flatnonzero((graph.allowed >> heading) & 1)
        there = cells + graph.offset[heading]
        change = np.linalg.norm(velocity[there, heading][:, None] - velocity[cells, 1:], axis=-1)
        step = (
            weights.safety * graph.safety[there] * graph.length_m[heading]
            + weights.time * graph.length_m[heading] / graph.speed[there, heading]
        )
        through = (step + label[there, heading - 1])[:, None] + energy * change
        taken = policy[cells] == heading
        np.testing.assert_allclose(label[cells][taken], through[taken], rtol=1e-9, atol=1e-8)
        best[cells] = np.minimum(best[cells], through)
    rest = energy * graph.speed[goal.cells, 1:] if goal.ends_at_rest else 0.0
    best[goal.cells] = rest
    assert (policy[goal.cells] == 0).all()
    # A cell that nothing leads to has no label; those that have one, have the least.
    reached = np.isfinite(label)
    assert not reached[np.isinf(best)].any()
    np.testing.assert_allclose(label[reached], best[reached], rtol=1e-9, atol=1e-8)


@properties
@given(seeds)
def test_interpolated_fields_bound_the_field_of_any_weights_from_below(seed):
    rng = random.Random(seed)
    found = graph_and_goal(random_problem(rng))
    if found is None:
        return
    graph, goal = found
    rule = Adaptation(base=random_weights(rng))
    table = refined(TableBuilder(graph, goal, rule), rng.randrange(20))
    for _ in range(5):
        weights = random_weights(rng)
        corners, shares = locate(
            table.roots, table.triangles, weights.safety, weights.time, weights.energy
        )
        exact, _ = field_of(graph, goal, weights)
        reached = np.isfinite(exact)
        bound = sum(
            share * table.costs_to_go[corner][reached]
            for corner, share in zip(corners, shares, strict=True)
        )
        assert (bound <= exact[reached] + 1e-9 * np.maximum(1.0, exact[reached])).all()


@properties
@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.integers(0, 60), seeds)
def test_any_weights_are_the_shares_of_the_corners_around_them(safety, time, energy, cuts, seed):
    if safety + time + energy <= 0.0:
        return
    weights = Weights.normalised(safety, time, energy)
    planner = Planner(SITE, make_vehicle())
    goal = planner._goal((Mission.INSPECTION, "target")).goal
    rule = Adaptation(base=random_weights(random.Random(seed)))
    builder = TableBuilder(planner.graph, goal, rule)
    table = refined(builder, cuts)
    corners, shares = locate(
        table.roots, table.triangles, weights.safety, weights.time, weights.energy
    )
    assert (shares > 0.0).all()
    assert shares @ table.weights[corners] == pytest.approx(
        [weights.safety, weights.time, weights.energy], abs=1e-12
    )


def test_at_a_corner_of_its_table_a_plan_needs_no_search():
    planner = Planner(SITE, make_vehicle())
    planner.prepare(mission="inspection")
    for weights in [Weights(*corner) for corner in CORNERS] + [planner.vehicle.weights["exit"]]:
        plan = planner.plan(mission="inspection", weights=weights, velocity=(1.0, -2.0))
        assert plan.status is PlanStatus.FOUND
        assert plan.compute.expanded == 0


def test_refining_closes_the_gap_and_leaves_earlier_tables_as_they_were():
    planner = Planner(SITE, make_vehicle())
    goal = planner._goal((Mission.INSPECTION, "target")).goal
    builder = TableBuilder(planner.graph, goal, Adaptation(base=Weights(0.5, 0.3, 0.2)))
    coarse = builder.table()
    kept = coarse.costs_to_go.copy(), coarse.triangles.copy()
    fine = refined(builder, 100)
    np.testing.assert_array_equal(coarse.costs_to_go, kept[0])
    np.testing.assert_array_equal(coarse.triangles, kept[1])
    assert len(fine.weights) > len(coarse.weights)
    weights = Weights(0.61, 0.17, 0.22)
    exact, _ = field_of(planner.graph, goal, weights)
    reached = np.isfinite(exact)

    def gap(table):
        corners, shares = locate(
            table.roots, table.triangles, weights.safety, weights.time, weights.energy
        )
        bound = np.tensordot(shares, table.costs_to_go[corners], axes=1)
        return (exact[reached] - bound[reached]).mean()

    assert gap(fine) < 0.5 * gap(coarse)


def test_a_table_ends_where_more_weights_would_help_little():
    planner = Planner(SITE, make_vehicle())
    goal = planner._goal((Mission.INSPECTION, "target")).goal
    builder = TableBuilder(planner.graph, goal, Adaptation(base=Weights(0.5, 0.3, 0.2)))
    while builder.refine():
        pass
    assert builder.corners == len(builder.table().weights) == 64
    assert not builder.refine()


def test_without_memory_for_a_table_plans_are_made_without_one(monkeypatch):
    monkeypatch.setattr(planner_module, "_TABLES_BYTES", corners_bytes(7))
    planner = Planner(SITE, make_vehicle())
    planner.prepare(mission="inspection")
    assert planner.most_prepared == 0
    assert not planner._tables
    assert planner.plan(mission="inspection").status is PlanStatus.FOUND


def corners_bytes(count):
    """The memory for so many corners on `SITE`: 22 x 18 padded cells, 8 moves, 9 bytes each."""
    return count * 22 * 18 * 8 * 9


def prepared(planner):
    return {key[1]: len(each.table.weights) for key, each in planner._tables.items() if each.ready}


TARGETS = {"one": (8.5, 6.5), "two": (8.5, 1.5), "three": (1.5, 6.5)}


def planner_of_three(most_corners, monkeypatch):
    monkeypatch.setattr(planner_module, "_TABLES_BYTES", corners_bytes(most_corners))
    planner = Planner(dataclasses.replace(SITE, targets=three_targets()), make_vehicle())
    for name in TARGETS:
        planner.prepare(mission="inspection", target=name)
    return planner


def three_targets():
    return make_site(targets=TARGETS).targets


def test_the_goals_of_a_site_share_the_memory_for_tables(monkeypatch):
    planner = planner_of_three(50, monkeypatch)
    assert prepared(planner) == dict.fromkeys(TARGETS, 16)
    assert planner.most_prepared == 3


def test_without_memory_for_all_tables_the_goal_prepared_first_loses_its_table(monkeypatch):
    planner = planner_of_three(2 * 8, monkeypatch)
    assert planner.most_prepared == 2
    assert prepared(planner) == {"two": 8, "three": 8}
    planner.prepare(mission="inspection", target="two")
    planner.prepare(mission="inspection", target="one")
    assert prepared(planner) == {"two": 8, "one": 8}
    for name in TARGETS:
        assert planner.plan(mission="inspection", target=name).status is PlanStatus.FOUND


def test_while_a_table_is_built_all_together_take_no_more_than_they_may(monkeypatch):
    # Room is made before, not after.
    taken = []
    planner = planner_of_three(2 * 8, monkeypatch)
    refine = TableBuilder.refine

    def watched(builder):
        taken.append(sum(each.table.costs_to_go.base.nbytes for each in planner._tables.values()))
        return refine(builder)

    monkeypatch.setattr(TableBuilder, "refine", watched)
    planner.prepare(mission="inspection", target="one")
    assert max(taken) * 9 / 8 == corners_bytes(2 * 8)


def test_a_million_states_have_a_table():
    planner = Planner(make_site(size=(30.0, 20.0), resolution=0.073), make_vehicle())
    assert planner.maps.occupied.size * len(planner.graph.offset) > 10**6
    assert planner.most_prepared >= 1


def test_a_goal_without_a_path_is_unreachable_with_a_table_too():
    graph_goal = Goal(cells=np.array([0]), leg_m=np.zeros(1), ends_at_rest=True)
    planner = Planner(SITE, make_vehicle())
    builder = TableBuilder(planner.graph, graph_goal, Adaptation(base=Weights(0.5, 0.3, 0.2)))
    start = planner.graph.grid.flat((4, 4))
    headings, _ = Solver(planner.graph).between(
        graph_goal, builder.table(), start, np.zeros(3), Weights(0.2, 0.2, 0.6)
    )
    assert headings is None


# Changed obstacles ------------------------------------------------------------------------------


@properties
@given(seeds)
def test_with_other_obstacles_a_planner_is_as_a_new_one(seed):
    rng = random.Random(seed)
    problem, other = random_problem(rng), random_problem(rng)
    planner = Planner(problem.site, problem.vehicle)
    with contextlib.suppress(InputError):
        planner.prepare(mission=problem.mission, target=problem.target)
    planner.set_obstacles(other.site.obstacles)
    new = Planner(planner.site, problem.vehicle)
    assert answer(problem, planner) == answer(problem, new)


def answer(problem, planner):
    try:
        plan = problem.ask(planner)
    except InputError:
        return "no landing point"
    return plan.status, plan.states.tolist()

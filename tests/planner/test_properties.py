"""Properties of every problem, whatever its numbers (hypothesis)."""

from __future__ import annotations

import random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moar_companion.errors import InputError
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Conductor, Polygon
from moar_companion.types import Mission, Weights

from .problems import Problem, make_site, random_problem

seeds = st.integers(min_value=0, max_value=10**6)
properties = settings(deadline=None, max_examples=60, derandomize=True, database=None)


def changed(problem, **changes):
    values = {name: getattr(problem, name) for name in problem.__dataclass_fields__}
    return Problem(**(values | changes))


def changed_site(site, obstacles, mirror=False):
    """A site with other obstacles, and mirrored about x = 0 where asked."""
    space = site.workspace
    sign = -1.0 if mirror else 1.0
    left, right = sorted((sign * space.lower_m[0], sign * space.upper_m[0]))
    if mirror:
        # The remainder changes sides with the rest.
        left = right - space.shape[0] * space.resolution_m

    def place(point):
        return (sign * point[0], point[1])

    return make_site(
        *obstacles,
        size=(right - left, space.upper_m[1] - space.lower_m[1]),
        lower=(left, space.lower_m[1]),
        resolution=space.resolution_m,
        min_altitude=space.min_altitude_m,
        start=place(site.start_m),
        targets={target.name: place(target.position_m) for target in site.targets},
        exits=[place(point) for point in site.landing_m[Mission.EXIT]],
        evacuations=[place(point) for point in site.landing_m[Mission.EVACUATION]],
    )


def mirrored(obstacle):
    if isinstance(obstacle, Conductor):
        x, z = obstacle.position_m
        return Conductor(
            name=obstacle.name,
            position_m=(-x, z),
            radius_m=obstacle.radius_m,
            keep_out_m=obstacle.keep_out_m,
        )
    return Polygon(
        name=obstacle.name,
        vertices_m=tuple((-x, z) for x, z in obstacle.vertices_m),
        keep_out_m=obstacle.keep_out_m,
    )


def optimum(problem, planner=None):
    """J of a problem, or why there is none."""
    try:
        plan = problem.ask(planner or Planner(problem.site, problem.vehicle))
    except InputError:
        return "no landing point"
    return plan.status.value if plan.cost is None else plan.cost.total


@properties
@given(seeds, st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_the_optimum_is_concave_in_the_weights(seed, safety, time, at, share):
    problem = random_problem(random.Random(seed))
    planner = Planner(problem.site, problem.vehicle)
    one = Weights.normalised(safety, time, 1.0)
    other = Weights.normalised(at, 1.0, safety)
    between = Weights.normalised(
        *(
            share * getattr(one, name) + (1.0 - share) * getattr(other, name)
            for name in ("safety", "time", "energy")
        )
    )
    costs = [
        optimum(changed(problem, weights=weights), planner) for weights in (one, other, between)
    ]
    if not isinstance(costs[0], str):
        bound = share * costs[0] + (1.0 - share) * costs[1]
        assert costs[2] >= bound - 1e-9 * max(1.0, bound)


@properties
@given(seeds)
def test_no_plan_is_better_than_the_optimum_for_its_own_weights(seed):
    rng = random.Random(seed)
    problem = random_problem(rng)
    planner = Planner(problem.site, problem.vehicle)
    other = changed(problem, weights=random_problem(rng).weights)
    best = optimum(problem, planner)
    if isinstance(best, str):
        return
    cost = other.ask(planner).cost
    weights = problem.weights
    j = weights.safety * cost.safety + weights.time * cost.time + weights.energy * cost.energy
    assert j >= best - 1e-9 * max(1.0, best)


@properties
@given(seeds)
def test_a_mirrored_problem_costs_the_same(seed):
    problem = random_problem(random.Random(seed))
    # Not on the border of a cell: the mirror swaps its sides.
    mirror = changed(
        problem,
        site=changed_site(
            problem.site, [mirrored(item) for item in problem.site.obstacles], mirror=True
        ),
        start_m=(-problem.start_m[0], problem.start_m[1]),
        velocity_mps=(-problem.velocity_mps[0], problem.velocity_mps[1]),
    )
    whole = changed_site(problem.site, problem.site.obstacles)
    space = whole.workspace
    kept = changed(problem, site=whole)
    width = space.shape[0] * space.resolution_m
    points = [problem.start_m, *(target.position_m for target in whole.targets)]
    if any(x > space.lower_m[0] + width for x, _ in points):
        return
    one, other = optimum(kept), optimum(mirror)
    assert one == other if isinstance(one, str) else other == pytest.approx(one, rel=1e-9, abs=1e-9)


@properties
@given(seeds)
def test_with_fewer_conductors_that_shape_no_hull_and_no_slope_the_optimum_is_no_greater(seed):
    # SC = C(d_obs) alone: without an obstacle no cell is nearer, slower or occupied that was not.
    # A slower cell also changes less in velocity, so the energy is left out.
    rng = random.Random(seed)
    problem = random_problem(rng)
    obstacles = problem.site.obstacles
    if problem.mission is not Mission.INSPECTION or not obstacles:
        return
    safety = problem.vehicle.safety
    collision_alone = type(safety)(
        d_min_m=safety.d_min_m, d_max_m=safety.d_max_m, collision=1.0, insertion=0.0, damage=0.0
    )
    members = {name: getattr(problem.vehicle, name) for name in problem.vehicle.__slots__}
    vehicle = type(problem.vehicle)(**members | {"safety": collision_alone})
    weights = Weights.normalised(rng.random(), rng.random() + 0.1, 0.0)
    full = changed(problem, vehicle=vehicle, weights=weights)
    fewer = changed(full, site=changed_site(problem.site, obstacles[1:]))
    cost = optimum(full)
    if not isinstance(cost, str):
        assert optimum(fewer) <= cost + 1e-9 * max(1.0, cost)


@properties
@given(seeds, st.floats(0.1, 50.0))
def test_a_site_elsewhere_costs_the_same(seed, shift):
    problem = random_problem(random.Random(seed))
    resolution = problem.site.workspace.resolution_m
    whole = round(shift) * resolution

    def moved(point):
        return (point[0] + whole, point[1])

    obstacles = [
        Conductor(
            name=item.name,
            position_m=moved(item.position_m),
            radius_m=item.radius_m,
            keep_out_m=item.keep_out_m,
        )
        if isinstance(item, Conductor)
        else Polygon(
            name=item.name,
            vertices_m=tuple(moved(vertex) for vertex in item.vertices_m),
            keep_out_m=item.keep_out_m,
        )
        for item in problem.site.obstacles
    ]
    site, space = problem.site, problem.site.workspace
    elsewhere = make_site(
        *obstacles,
        size=(space.upper_m[0] - space.lower_m[0], space.upper_m[1] - space.lower_m[1]),
        lower=moved(space.lower_m),
        resolution=resolution,
        min_altitude=space.min_altitude_m,
        start=moved(site.start_m),
        targets={target.name: moved(target.position_m) for target in site.targets},
        exits=[moved(point) for point in site.landing_m[Mission.EXIT]],
        evacuations=[moved(point) for point in site.landing_m[Mission.EVACUATION]],
    )
    one = optimum(problem)
    other = optimum(changed(problem, site=elsewhere, start_m=moved(problem.start_m)))
    assert one == other if isinstance(one, str) else other == pytest.approx(one, rel=1e-9, abs=1e-9)

"""Refined paths: J is not greater, they are as free as the plan by shapely, and they arrive."""

from __future__ import annotations

import itertools
import math
import random
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.geometry import LineString, MultiPoint, Point, Polygon, box
from shapely.ops import unary_union

from moar_companion.errors import InputError
from moar_companion.planner.plan_values import PlanStatus
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Conductor
from moar_companion.types import Mission, Weights
from tests.thorough import sampled

from .problems import conductor, make_site, make_vehicle, polygon, random_problem

seeds = st.integers(min_value=0, max_value=10**6)
properties = settings(deadline=None, max_examples=sampled(40, 80), derandomize=True, database=None)
NEAR_M = 1e-7
ALWAYS_3_MPS = {"speeds": (3.0,) * 5, "min_speed": 3.0}
"""Whatever the direction, and however near an obstacle is."""


def refined(problem):
    """The refinement of a problem; None where it has no path."""
    planner = Planner(problem.site, problem.vehicle)
    try:
        plan = problem.ask(planner)
    except InputError:
        return None
    return planner.refine(plan) if plan.status is PlanStatus.FOUND else None


def line(points_m):
    return LineString(points_m) if len(points_m) > 1 else Point(points_m[0])


def plan_line(plan):
    points = plan.waypoints.position_m[: len(plan.states)]
    return line(points[:1] if (points == points[0]).all() else points)


def occupied_cells(maps, less_m=0.0):
    """The union of the occupied cells of some maps."""
    half = 0.5 * maps.grid.resolution_m - less_m
    centres = np.stack(np.meshgrid(*maps.grid.axes_m, indexing="ij"), axis=-1)[maps.occupied]
    return unary_union([box(x - half, z - half, x + half, z + half) for x, z in centres])


def shape(obstacle):
    """An obstacle as the distance to it is measured from, and what that is reduced by."""
    if isinstance(obstacle, Conductor):
        return Point(obstacle.position_m), obstacle.radius_m
    filled = Polygon(obstacle.vertices_m) if len(obstacle.vertices_m) > 2 else None
    return filled or MultiPoint(obstacle.vertices_m).convex_hull, 0.0


@pytest.mark.uncounted
@properties
@given(seeds)
def test_a_refined_path_costs_no_more_and_is_as_free_as_the_plans_own(seed):
    problem = random_problem(random.Random(seed), columns=(6, 30), rows=(5, 20))
    found = refined(problem)
    if found is None:
        return
    plan, grid = found.plan, found.plan.graph.grid
    assert found.cost.total <= found.plan_cost.total
    path, own = line(found.points_m), plan_line(plan)
    space = box(*grid.lower_m, *grid.upper_m)
    assert space.buffer(NEAR_M).covers(path)
    assert not path.intersects(occupied_cells(plan.maps, NEAR_M))
    for obstacle in problem.site.obstacles:
        outline, radius_m = shape(obstacle)
        if outline.covers(own) or outline.intersects(own):
            continue  # nothing keeps a vehicle without a size from it
        kept_m = problem.vehicle.radius_m + obstacle.keep_out_m + radius_m
        assert path.distance(outline) >= min(kept_m, own.distance(outline)) - NEAR_M
    lowest_m = problem.site.workspace.min_altitude_m
    assert lowest_m is None or found.points_m[:, 1].min() >= lowest_m - NEAR_M


@properties
@given(seeds)
def test_a_refined_path_begins_and_ends_as_the_plan_does(seed):
    problem = random_problem(random.Random(seed))
    found = refined(problem)
    if found is None:
        return
    plan, grid, points = found.plan, found.plan.graph.grid, found.waypoints.position_m
    assert tuple(points[0]) == pytest.approx(grid.centre_m(tuple(plan.states[0, :-1].tolist())))
    if plan.mission is Mission.INSPECTION:
        target = next(t for t in problem.site.targets if t.name == plan.request.target)
        assert tuple(found.points_m[-1]) == pytest.approx(
            grid.centre_m(grid.cell_of(target.position_m))
        )
        assert found.landing_leg is None
        if len(plan.states) > 1:
            assert found.waypoints.speed_mps[-1] == 0.0
    else:
        leg, own = found.landing_leg, plan.landing_leg
        # The region's cells need not see the same landing point.
        x, z = problem.site.landing_m[plan.mission][leg.landing_index]
        above = (x, z + problem.vehicle.guidance.landing_height_m)
        assert tuple(points[-1]) == pytest.approx(above)
        if grid.cell_of(tuple(found.points_m[-1].tolist())) == tuple(plan.states[-1, :-1]):
            assert abs(leg.length_m - own.length_m) <= math.sqrt(2.0) * grid.resolution_m
    steps_m = np.hypot(*np.diff(points, axis=0).T)
    assert found.metrics.length_m == pytest.approx(steps_m.sum())
    assert found.metrics.duration_s == pytest.approx(found.waypoints.time_s[-1])
    assert (np.diff(found.waypoints.time_s) >= 0.0).all()
    count = len(points) - (0 if found.landing_leg is None else len(found.landing_leg.points_m))
    # Pieces are sampled more closely than the legs they are of, at most where cells are large.
    assert found.waypoints.time_s[count - 1] == pytest.approx(found.cost.time, rel=0.2, abs=1e-9)


def test_without_obstacles_the_straight_line_is_the_best():
    site = make_site(size=(10.0, 8.0), resolution=0.25, start=(0.6, 0.6), targets={"a": (9.1, 4.4)})
    planner = Planner(site, make_vehicle(**ALWAYS_3_MPS))
    plan = planner.plan(mission="inspection", weights=Weights(0.0, 0.8, 0.2))
    found = planner.refine(plan)
    length_m = math.hypot(8.5, 3.75)
    assert len(found.points_m) == 2
    assert found.cost.time == pytest.approx(length_m / 3.0)
    assert found.cost.energy == pytest.approx(0.5 * (3.0 + 3.0) / 3.0)
    assert found.cost.total == pytest.approx(0.8 * length_m / 3.0 + 0.2)
    assert found.cost.total < found.plan_cost.total
    assert found.metrics.length_m == pytest.approx(length_m)
    assert found.metrics.velocity_change_mps == pytest.approx(6.0)


def test_a_wall_is_passed_by_its_corner():
    wall = polygon((4.8, 0.0), (5.2, 0.0), (5.2, 5.0), (4.8, 5.0), name="wall")
    site = make_site(
        wall, size=(10.0, 8.0), resolution=0.25, start=(1.1, 1.1), targets={"a": (8.9, 1.1)}
    )
    vehicle = make_vehicle(**ALWAYS_3_MPS)
    planner = Planner(site, vehicle)
    plan = planner.plan(mission="inspection", weights=Weights(0.0, 1.0, 0.0))
    points = planner.refine(plan).points_m
    path = LineString(points)
    # The shortest detour is a string pulled tight about the occupied cells: it has more points.
    tight = (
        LineString(points[[0, -1]])
        .union(occupied_cells(plan.maps))
        .intersection(box(0.0, 1.125, 10.0, 8.0))
    )
    shortest_m = tight.convex_hull.length - math.dist(points[0], points[-1])
    assert path.distance(Polygon(wall.vertices_m)) >= vehicle.radius_m - NEAR_M
    assert shortest_m - NEAR_M <= path.length <= 1.03 * shortest_m
    assert path.length < plan_line(plan).length


def test_no_point_of_a_refined_path_is_better_a_little_elsewhere():
    site = make_site(
        conductor(4.0, 4.0), conductor(6.5, 3.0), resolution=0.25, start=(0.6, 3.1),
        targets={"a": (9.1, 4.9)},
    )  # fmt: skip
    planner = Planner(site, make_vehicle())
    gained = []
    for weights in (Weights(0.5, 0.4, 0.1), Weights(0.2, 0.6, 0.2), Weights(0.1, 0.2, 0.7)):
        plan = planner.plan(mission="inspection", velocity=(0.5, 0.5), weights=weights)
        found = planner.refine(plan)
        gained.append(found.cost.total / found.plan_cost.total)
        turns = [(math.cos(a), math.sin(a)) for a in np.arange(8) * math.pi / 4.0]
        for at, (dx, dz) in itertools.product(range(1, len(found.points_m) - 1), turns):
            moved = found.points_m.copy()
            moved[at] += 0.25 * np.array([dx, dz])
            cost = found.continuous.of_path(moved, (0.5, 0.5), weights, ends_at_rest=True)
            assert cost.total >= 0.995 * found.cost.total
    assert min(gained) < 0.95


def test_a_path_that_cannot_be_improved_is_the_plans_own():
    site = make_site(size=(10.0, 8.0), resolution=0.25, start=(0.6, 0.6), targets={"a": (9.1, 0.6)})
    planner = Planner(site, make_vehicle(**ALWAYS_3_MPS))
    plan = planner.plan(mission="inspection")
    found = planner.refine(plan)
    assert found.cost.total == found.plan_cost.total
    assert found.metrics.length_m == pytest.approx(plan.metrics.length_m)


def test_a_refined_plan_of_one_state_is_unchanged():
    site = make_site(start=(8.5, 6.5))
    planner = Planner(site, make_vehicle())
    for velocity in ((0.0, 0.0), (1.0, 0.0)):
        found = planner.refine(planner.plan(mission="inspection", velocity=velocity))
        assert found.points_m.tolist() == [[8.5, 6.5]]
        assert found.cost == found.plan_cost
        assert found.metrics.velocity_change_mps == pytest.approx(velocity[0])


def test_the_position_uncertainty_is_added_to_the_required_clearance():
    wall = polygon((4.8, 0.0), (5.2, 0.0), (5.2, 5.0), (4.8, 5.0))
    site = make_site(wall, resolution=0.25, start=(1.1, 1.1), targets={"a": (8.9, 1.1)})
    vehicle = make_vehicle(**ALWAYS_3_MPS)
    for uncertainty_m in (0.0, 0.5):
        planner = Planner(site, vehicle, position_uncertainty_m=uncertainty_m)
        plan = planner.plan(mission="inspection", weights=Weights(0.0, 1.0, 0.0))
        path = LineString(planner.refine(plan).points_m)
        kept_m = path.distance(Polygon(wall.vertices_m))
        assert vehicle.radius_m + uncertainty_m - NEAR_M <= kept_m
        assert kept_m < vehicle.radius_m + uncertainty_m + 0.25


def test_a_path_that_is_not_on_the_planners_maps_is_refused():
    site = make_site(conductor(5.0, 4.0))
    planner = Planner(site, make_vehicle())
    plan = planner.plan(mission="inspection")
    nowhere = planner.plan(mission="inspection", start=(-1.0, 0.0))
    with pytest.raises(ValueError, match="own maps"):
        planner.refine(nowhere)
    planner.refine(plan)
    planner.set_obstacles((replace(site.obstacles[0], position_m=(4.0, 4.0)),))
    with pytest.raises(ValueError, match="own maps"):
        planner.refine(plan)

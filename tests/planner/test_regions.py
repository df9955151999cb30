"""Goal regions and landing legs: by hand, and against brute force with shapely."""

from __future__ import annotations

import math
import random
from itertools import pairwise

import numpy as np
import pytest
from shapely.geometry import Point

from moar_companion.errors import InputError
from moar_companion.planner.grid import TOLERANCE
from moar_companion.planner.maps import build_maps
from moar_companion.planner.planner import Planner
from moar_companion.planner.regions import goal_region
from moar_companion.types import Mission

from . import oracle
from .problems import conductor, make_site, make_vehicle, polygon, random_problem

LEFT = {(0, row) for row in range(8)}
RIGHT = {(9, row) for row in range(8)}
BOTTOM = {(column, 0) for column in range(10)}
TOP = {(column, 7) for column in range(10)}


def region_of(site, landing=None, *, uncertainty=0.0, **vehicle):
    """The cells of a site's exit region."""
    vehicle = make_vehicle(**vehicle)
    maps = build_maps(site, vehicle, uncertainty)
    mask = goal_region(site, vehicle, maps, Mission.EXIT, landing).mask
    return {(int(x), int(z)) for x, z in np.argwhere(mask)}


@pytest.mark.parametrize("batch", [pytest.param(0, marks=pytest.mark.slow), 1])
def test_regions_agree_with_brute_force(batch):
    rng = random.Random(f"regions {batch}")
    seen = 0
    for _ in range(40):
        problem = random_problem(rng)
        site, vehicle = problem.site, problem.vehicle
        uncertainty_m = rng.choice([0.0, 0.3])
        maps = build_maps(site, vehicle, uncertainty_m)
        plain = oracle.build_maps(site, vehicle, uncertainty_m)
        for mission in (Mission.EXIT, Mission.EVACUATION):
            for landing in (None, *range(len(site.landing_m[mission]))):
                expected = oracle.goal_region(site, vehicle, plain, mission, landing, uncertainty_m)
                if not expected:
                    with pytest.raises(InputError, match=f"landing.{mission.value}"):
                        goal_region(site, vehicle, maps, mission, landing)
                    continue
                seen += 1
                region = goal_region(site, vehicle, maps, mission, landing)
                cells = {(int(x), int(z)) for x, z in np.argwhere(region.mask)}
                assert cells == expected
                assert set(region.corners) == expected
    assert seen > 80


# The workspace of the cases by hand is 10 by 8 cells of 1 m, from the origin.


@pytest.mark.parametrize(
    ("case", "landing", "region"),
    [
        ("to the right", (20.0, 4.0), RIGHT),
        ("to the right, on the level of the floor", (20.0, 0.0), RIGHT | BOTTOM),
        ("to the right and below", (20.0, -3.0), RIGHT | BOTTOM),
        ("above", (5.0, 20.0), TOP),
        ("below", (5.0, -1.0), BOTTOM),
        ("on the floor, whose edges lie along the leg", (4.0, 0.0), BOTTOM),
        ("at a corner", (10.0, 0.0), BOTTOM | RIGHT),
        ("at the midpoint of an edge", (10.0, 3.5), RIGHT),
        ("inside a cell", (4.2, 3.7), {(4, 3)}),
        ("inside, where four cells meet", (4.0, 3.0), {(4, 3)}),
    ],
)
def test_a_landing_point_in_the_open_sees_the_border_that_faces_it(case, landing, region):
    assert region_of(make_site(exits=[landing])) == region, case


def test_any_of_several_landing_points_may_serve():
    site = make_site(exits=[(20.0, 4.0), (-9.0, 4.0), (4.5, 4.5)])
    assert region_of(site) == LEFT | RIGHT | {(4, 4)}


def test_a_chosen_landing_point_serves_alone():
    site = make_site(exits=[(20.0, 4.0), (-9.0, 4.0)])
    assert region_of(site, 0) == RIGHT
    assert region_of(site, 1) == LEFT


@pytest.mark.parametrize("index", [2, -1, "exit"])
def test_a_landing_point_that_the_site_does_not_have_is_an_error(index):
    site = make_site(exits=[(20.0, 4.0), (-9.0, 4.0)])
    with pytest.raises(InputError, match=r"landing\.exit.*the site has 2"):
        region_of(site, index)


def test_a_mission_without_landing_points_is_an_error():
    with pytest.raises(InputError, match=r"landing\.exit.*no landing point"):
        region_of(make_site(evacuations=[(20.0, 4.0)]))


def test_the_border_is_that_of_the_rows_that_may_be_flown():
    site = make_site(min_altitude=2.0, exits=[(5.0, 0.0)])
    assert region_of(site) == {(column, 2) for column in range(10)}


def test_a_landing_point_below_the_minimum_altitude_but_on_the_grid_is_seen_from_above():
    site = make_site(min_altitude=2.0, exits=[(5.5, 1.5)])
    assert region_of(site) == {(column, 2) for column in range(10)}


def test_no_row_that_may_be_flown_means_no_region():
    with pytest.raises(InputError, match=r"\(5, 0\)"):
        region_of(make_site(min_altitude=50.0, exits=[(5.0, 0.0)]))


def test_occupied_border_cells_are_no_region():
    region = region_of(make_site(conductor(9.5, 3.5), exits=[(20.0, 4.0)]))
    assert (9, 3) not in region
    assert (9, 6) in region


def test_an_occupied_cell_does_not_serve_its_landing_point():
    site = make_site(conductor(4.5, 4.5), exits=[(4.2, 4.2)])
    with pytest.raises(InputError, match=r"\(4\.2, 4\.2\)"):
        region_of(site)


def test_an_obstacle_outside_the_workspace_blocks_the_legs_behind_it():
    wall = polygon((14.0, 3.0), (15.0, 3.0), (15.0, 30.0), (14.0, 30.0))
    region = region_of(make_site(wall, exits=[(20.0, 0.0)]))
    # The legs must pass 0.6 m below the corner (14, 3); those from high cells do not.
    assert region >= BOTTOM
    assert (9, 1) in region
    assert (9, 6) not in region


def test_an_obstacle_below_the_workspace_blocks_a_leg_to_the_ground():
    site = make_site(conductor(5.0, -2.0), min_altitude=None, exits=[(5.0, -6.0)])
    region = region_of(site)
    assert (4, 0) not in region
    assert (0, 0) in region
    assert (9, 0) in region


def test_a_keep_out_distance_blocks_a_leg_that_would_clear_the_conductor():
    landing, vehicle = (20.0, 4.5), {"landing_height": 0.0}
    near = make_site(conductor(15.0, 6.5), exits=[landing])
    wide = make_site(conductor(15.0, 6.5, keep_out=1.0), exits=[landing])
    assert (9, 4) in region_of(near, **vehicle)
    assert (9, 4) in region_of(wide, **vehicle)
    assert (9, 6) in region_of(near, **vehicle)
    assert (9, 6) not in region_of(wide, **vehicle)


def test_the_position_uncertainty_increases_the_required_clearance_of_a_leg():
    site = make_site(conductor(15.0, 6.5), exits=[(20.0, 4.5)])
    vehicle = {"landing_height": 0.0}
    assert (9, 6) in region_of(site, **vehicle)
    assert (9, 6) not in region_of(site, uncertainty=1.0, **vehicle)


def test_the_leg_as_flown_must_clear_obstacles_too():
    # From (10, 2.5) the straight leg to (20, 0.5) passes 1.5 m below the conductor.
    # The leg to 2 m above the landing point passes 0.5 m below the conductor.
    site = make_site(conductor(15.0, 3.0), exits=[(20.0, 0.5)])
    assert (9, 2) in region_of(site, landing_height=0.0)
    assert (9, 2) not in region_of(site, landing_height=2.0)
    assert (9, 0) in region_of(site, landing_height=2.0)


def test_the_descent_at_the_end_of_a_leg_must_clear_obstacles_too():
    site = make_site(conductor(20.5, 3.0), exits=[(20.0, 0.5)])
    assert region_of(site, landing_height=0.0)
    with pytest.raises(InputError, match=r"\(20, 0\.5\)"):
        region_of(site, landing_height=5.0)


def test_a_conductor_over_a_landing_point_inside_the_workspace_blocks_its_leg():
    site = make_site(conductor(5.5, 5.0), exits=[(5.5, 3.5)])
    assert region_of(site, landing_height=0.5) == {(5, 3)}
    with pytest.raises(InputError, match=r"\(5\.5, 3\.5\)"):
        region_of(site, landing_height=2.0)


def test_the_error_names_every_landing_point_that_is_not_seen():
    wall = polygon((10.5, -50.0), (11.0, -50.0), (11.0, 50.0), (10.5, 50.0))
    site = make_site(wall, exits=[(20.0, 0.0), (30.0, 1.5)])
    with pytest.raises(InputError) as error:
        Planner(site, make_vehicle()).plan(mission=Mission.EXIT)
    assert "test site" in str(error.value)
    assert "(20, 0), (30, 1.5)" in str(error.value)


# Landing legs -----------------------------------------------------------------------------------


def cruising_speed(speed, direction):
    """v_max of any direction, linear in the elevation between the headings."""
    elevation = math.degrees(math.atan2(direction[1], abs(direction[0])))
    known = [
        (-90.0, speed.down_mps),
        (-45.0, speed.diagonal_down_mps),
        (0.0, speed.horizontal_mps),
        (45.0, speed.diagonal_up_mps),
        (90.0, speed.up_mps),
    ]
    for (low, at_low), (high, at_high) in pairwise(known):
        if low - 1e-9 <= elevation <= high + 1e-9:
            return at_low + (at_high - at_low) * (elevation - low) / (high - low)
    raise AssertionError(elevation)


def random_exits(name, count):
    """Found exits and evacuations, each with its problem."""
    rng = random.Random(name)
    while count:
        problem = random_problem(rng)
        if problem.mission is Mission.INSPECTION:
            continue
        try:
            plan = problem.ask(Planner(problem.site, problem.vehicle))
        except InputError:
            continue
        if plan.cost is not None:
            count -= 1
            yield problem, plan


def test_a_landing_leg_ends_above_the_landing_point_at_the_landing_height():
    for problem, plan in random_exits("ends", 40):
        leg = plan.landing_leg
        x, z = problem.site.landing_m[problem.mission][leg.landing_index]
        end = (x, z + problem.vehicle.guidance.landing_height_m)
        assert leg.points_m[-1] == pytest.approx(end)
        assert plan.waypoints.position_m[-1] == pytest.approx(end)
        if problem.target is not None:
            assert leg.landing_index == problem.target


def test_a_landing_leg_is_never_faster_than_clearance_and_elevation_allow():
    for problem, plan in random_exits("speeds", 40):
        leg, site = plan.landing_leg, problem.site
        points = [oracle.centre_of(site.workspace, plan.states[-1][:2]), *leg.points_m]
        for (before, point), speed, clearance in zip(
            pairwise(points), leg.speed_mps, leg.clearance_m, strict=True
        ):
            distances = [oracle.clearance(item, Point(point)) for item in site.obstacles]
            d_obs = min(distances, default=math.inf)
            assert clearance == pytest.approx(d_obs)
            step = np.subtract(point, before)
            assert np.hypot(*step) <= site.workspace.resolution_m + TOLERANCE
            limit = oracle.speed_limit(d_obs, problem.vehicle)
            if np.hypot(*step) > TOLERANCE:
                limit = min(limit, cruising_speed(problem.vehicle.speed, step))
                assert speed == pytest.approx(limit)


def test_a_landing_leg_leaves_by_an_outer_edge_or_starts_over_the_landing_point():
    for problem, plan in random_exits("edges", 40):
        cell = tuple(int(value) for value in plan.states[-1][:2])
        leg, space = plan.landing_leg, problem.site.workspace
        landing = problem.site.landing_m[problem.mission][leg.landing_index]
        rectangle = oracle.flyable_rectangle(problem.site)
        if rectangle[0] < landing[0] < rectangle[2] and rectangle[1] < landing[1] < rectangle[3]:
            assert cell == oracle.cell_of(space, landing)
            continue
        edges = oracle.edge_midpoints(problem.site, cell)
        assert any(leg.points_m[0] == pytest.approx(edge) for edge in edges)
        for obstacle in problem.site.obstacles:
            for point in leg.points_m:
                required = problem.vehicle.radius_m + obstacle.keep_out_m
                assert oracle.clearance(obstacle, Point(point)) >= required - 1e-9


def test_a_landing_leg_counts_in_metrics_and_waypoints_and_not_in_cost():
    for problem, plan in random_exits("metrics", 40):
        maps = oracle.build_maps(problem.site, problem.vehicle)
        terms = oracle.cost_terms(problem, maps, plan.states)
        assert (plan.cost.safety, plan.cost.time, plan.cost.energy) == pytest.approx(terms)
        leg, points = plan.landing_leg, plan.waypoints.position_m
        assert len(points) == len(plan.states) + len(leg.points_m)
        pieces = np.hypot(*np.diff(points[len(plan.states) - 1 :], axis=0).T)
        assert leg.length_m == pytest.approx(pieces.sum())
        leg_s = (pieces / leg.speed_mps).sum()
        assert plan.metrics.duration_s == pytest.approx(terms[1] + leg_s)
        assert plan.metrics.min_clearance_m <= leg.clearance_m.min()
        assert plan.waypoints.time_s[-1] == pytest.approx(plan.metrics.duration_s)


def test_the_metrics_of_an_exit_by_hand():
    # From the centre of the last column 0.5 m to the edge, 3.5 m on, at 10 m/s; then at rest.
    site = make_site(start=(8.5, 4.5), exits=[(13.5, 2.5)])
    plan = Planner(site, make_vehicle(landing_height=2.0)).plan(mission="exit")
    assert plan.states.tolist() == [[8, 4, 0], [9, 4, 3]]
    assert plan.metrics.length_m == pytest.approx(5.0)
    assert plan.metrics.duration_s == pytest.approx(0.5)
    assert plan.metrics.velocity_change_mps == pytest.approx(20.0)
    assert plan.cost.time == pytest.approx(0.1)
    assert plan.cost.energy == pytest.approx(0.5)
    assert plan.waypoints.position_m[-1].tolist() == pytest.approx([13.5, 4.5])

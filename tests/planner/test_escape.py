"""The escape leg out of an occupied or outside cell."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest
import shapely
from shapely.geometry import Point

from moar_companion.planner.escape import (
    entry_corners,
    escape_leg,
    pocket,
    recovery_leg,
    refuge_leg,
)
from moar_companion.planner.maps import build_maps
from moar_companion.planner.plane_fence import Bound, PlaneFence

from . import oracle
from .problems import conductor, make_site, make_vehicle, polygon, random_problem


def clearance(site, point):
    here = Point(point)
    return min((oracle.clearance(item, here) for item in site.obstacles), default=math.inf)


def falls(site, start, end, samples, by):
    """True if clearance falls along the leg by more than `by` below its greatest value so far."""
    greatest = -math.inf
    for t in np.linspace(0.0, 1.0, samples):
        here = clearance(site, np.add(start, t * np.subtract(end, start)))
        if here < greatest - by:
            return True
        greatest = max(greatest, here)
    return False


def enters_keep_out(site, vehicle, start, end, by):
    """True if the leg comes nearer to an obstacle than its keep-out, or than the start."""
    leg, here = shapely.LineString([start, end]), Point(start)
    return any(
        oracle.clearance(item, leg)
        < min(item.keep_out_m + vehicle.radius_m, oracle.clearance(item, here)) - by
        for item in site.obstacles
    )


def escape(site, start, **vehicle):
    vehicle = make_vehicle(**vehicle)
    return escape_leg(site, vehicle, build_maps(site, vehicle), start)


def test_next_to_a_conductor_the_escape_route_is_away_from_it():
    site = make_site(conductor(5.5, 4.5, 0.1))
    assert escape(site, (6.0, 4.4), radius=1.2) == (6.5, 3.5)
    assert escape(site, (5.6, 4.1), radius=1.2) == (6.5, 3.5)


def test_below_the_minimum_altitude_the_escape_route_is_up():
    site = make_site(min_altitude=2.0)
    assert escape(site, (3.5, 0.2)) == (3.5, 2.5)


def test_outside_the_workspace_the_escape_route_is_the_nearest_free_cell():
    assert escape(make_site(), (-4.0, 2.5)) == (0.5, 2.5)
    assert escape(make_site(), (12.0, 9.0)) == (9.5, 7.5)


def test_a_conductor_in_between_is_flown_around_or_not_approached():
    # The nearest free cell is past the conductor; the leg goes in another direction.
    site = make_site(conductor(0.0, 2.5, 0.1))
    end = escape(site, (-1.2, 2.5), radius=0.6)
    assert end is None or not falls(site, (-1.2, 2.5), end, 200, 1e-6)


@pytest.mark.parametrize("start", [(4.0, 4.0), (6.05, 4.5)])
def test_inside_an_obstacle_there_is_no_escape_route(start):
    square = polygon((3.0, 3.0), (5.0, 3.0), (5.0, 5.0), (3.0, 5.0))
    site = make_site(square, conductor(6.0, 4.5, 0.2))
    assert escape(site, start) is None


def test_where_every_direction_is_closer_to_an_obstacle_there_is_no_escape_route():
    # In the middle of a gap between two walls, clearance falls on all routes but the gap's own,
    # along which it stays; and there nothing is free.
    walls = [
        polygon((x, -9.0), (x + 1.0, -9.0), (x + 1.0, 19.0), (x, 19.0), name=f"wall {x}")
        for x in (3.0, 5.0)
    ]
    assert escape(make_site(*walls), (4.5, 4.5)) is None


@pytest.mark.slow
def test_escape_legs_are_the_shortest_along_which_clearance_never_falls():
    rng = random.Random("escape")
    found = 0
    while found < 20:
        problem = random_problem(rng)
        site, space = problem.site, problem.site.workspace
        maps = oracle.build_maps(site, problem.vehicle)
        start = tuple(
            rng.uniform(low - 1.0, high + 1.0)
            for low, high in zip(space.lower_m, space.upper_m, strict=True)
        )
        cell = oracle.cell_of(space, start)
        if cell is not None and not maps.occupied[cell]:
            continue
        maps_of = build_maps(site, problem.vehicle)
        end = escape_leg(site, problem.vehicle, maps_of, start)
        if clearance(site, start) == 0.0:
            assert end is None
            continue
        length = math.inf
        if end is not None:
            found += 1
            length = math.dist(start, end)
            assert not maps.occupied[oracle.cell_of(space, end)]
            # Clearance is sampled ten times per cell: between two samples it may dip.
            assert not falls(site, start, end, 200, 0.05 * space.resolution_m)
            assert not enters_keep_out(site, problem.vehicle, start, end, 1e-6)
        for other, occupied in maps.occupied.items():
            centre = oracle.centre_of(space, other)
            if not occupied and math.dist(start, centre) < length - 1e-9:
                assert falls(site, start, centre, 200, 0.0) or enters_keep_out(
                    site, problem.vehicle, start, centre, 0.0
                )


@pytest.mark.parametrize(
    ("start", "keep_outs", "widened_m"),
    [
        ((3.18, 0.83), (2.0, 4.0, 3.0), 0.0),  # out of the third one's by the second one's
        ((3.18, 0.83), (1.0, 3.0, 2.0), 1.0),
    ],
)
def test_no_escape_leg_from_one_keep_out_crosses_another(start, keep_outs, widened_m):
    places = ((0.40, 1.60), (-0.86, 3.18), (3.97, 0.77))
    wires = [
        conductor(*place, 0.02, keep_out=m) for place, m in zip(places, keep_outs, strict=True)
    ]
    site, vehicle = make_site(*wires, size=(12.0, 10.0), min_altitude=2.0), make_vehicle(radius=0.6)
    maps = build_maps(site, vehicle, widened_m)
    assert escape_leg(site, vehicle, maps, start) is None
    assert entry_corners(site, vehicle, maps, start) == ()


@pytest.mark.parametrize(
    ("wires", "start", "end"),
    [
        # The cell (8.5, 2.5) is nearer, but the leg to it approaches the wire at (6, 1).
        ([(6.0, 1.0, 2.0), (5.5, 4.5, 1.0), (2.0, 7.0, 4.0)], (5.9, 2.9), (8.5, 3.5)),
        # (11.5, 7.5) is nearer, but the leg to it enters the keep-out of the wire at (7.5, 8.5).
        ([(7.5, 8.5, 3.0), (10.5, 4.0, 3.0), (0.0, 8.0, 1.0)], (9.5, 5.4), (6.5, 3.5)),
    ],
)
def test_if_the_nearest_escape_leg_crosses_a_keep_out_another_leg_is_flown(wires, start, end):
    wires = [conductor(x, z, 0.02, keep_out=keep_out) for x, z, keep_out in wires]
    site, vehicle = make_site(*wires, size=(12.0, 10.0)), make_vehicle(radius=0.6)
    assert escape_leg(site, vehicle, build_maps(site, vehicle), start) == end
    assert not enters_keep_out(site, vehicle, start, end, 1e-6)


def recovery(site, start, widened_m=0.0, **vehicle):
    vehicle = make_vehicle(**vehicle)
    return recovery_leg(site, vehicle, build_maps(site, vehicle), start, widened_m)


def test_recovery_from_outside_goes_to_the_nearest_free_cell_even_if_closer_to_obstacles():
    site = make_site(conductor(5.5, 4.5, 0.1))
    assert escape(site, (-25.0, 2.5), radius=0.6) is None
    assert recovery(site, (-25.0, 2.5), radius=0.6) == ((0.5, 2.5),)


def test_the_recovery_path_keeps_every_keep_out_and_its_inflation():
    start = (-9.0, 2.5)
    site = make_site(conductor(-4.0, 2.5, 0.1))
    for widened_m in (0.0, 1.0):
        corners = recovery(site, start, widened_m, radius=0.6)
        leg = shapely.LineString([start, *corners])
        assert oracle.clearance(site.obstacles[0], leg) >= 0.6 + widened_m - 1e-6


def test_there_is_no_recovery_path_from_too_far_or_from_within_a_keep_out():
    assert recovery(make_site(), (-60.5, 2.5)) == ()
    site = make_site(conductor(-4.0, 2.5, 0.1))
    assert recovery(site, (-4.3, 2.5), radius=0.6) == ()


def test_recovery_from_below_begins_straight_up():
    assert recovery(make_site(), (3.4, -1.0)) == ((3.5, 0.5),)
    site = make_site(min_altitude=2.0)
    assert recovery(site, (-4.0, 1.0)) == ((-4.0, 2.5), (0.5, 2.5))


def test_where_straight_up_is_not_free_recovery_from_below_slants():
    site = make_site(conductor(-4.0, 2.6, 0.1), min_altitude=2.0)
    assert recovery(site, (-4.0, 1.0), radius=0.6) == ((0.5, 2.5),)


def test_recovery_from_below_climbs_past_obstacles_that_come_nearer_but_not_too_near():
    site = make_site(conductor(1.5, 3.0, 0.1), conductor(5.5, 3.0, 0.1), min_altitude=2.0)
    start = (3.5, 0.5)
    assert escape(site, start, radius=0.6) is None
    maps = build_maps(site, make_vehicle(radius=0.6))
    assert entry_corners(site, make_vehicle(radius=0.6), maps, start) == ((3.5, 2.5),)


def test_a_pocket_is_the_cells_joined_by_edges_and_no_leg_ends_in_a_barred_pocket():
    wall = polygon((4.0, -9.0), (5.0, -9.0), (5.0, 8.0), (4.0, 8.0))
    site, vehicle = make_site(wall), make_vehicle(radius=0.1)
    maps = build_maps(site, vehicle)
    left = pocket(maps, (1.5, 1.5))
    assert left[1, 1]
    assert not left[8, 1]
    assert not pocket(maps, (-4.0, 1.0)).any()
    (end,) = entry_corners(site, vehicle, maps, (4.2, 10.0))
    assert end[0] < 4.0
    assert entry_corners(site, vehicle, maps, (4.2, 10.0), barred=left) == ((5.5, 7.5),)


def spare_of(maps, tolerated):
    """(nx, nz) by a function of the place."""
    x_m, z_m = maps.grid.axes_m
    return np.array([[tolerated((x, z)) for z in z_m] for x in x_m])


@pytest.mark.parametrize("seed", range(30))
def test_a_refuge_is_the_nearest_place_that_tolerates_enough(seed):
    """Against every free cell by itself, with exact distances."""
    generator = random.Random(seed)
    problem = random_problem(generator)
    site, vehicle = problem.site, problem.vehicle
    maps = build_maps(site, vehicle)
    (low_x, low_z), (high_x, high_z) = site.workspace.lower_m, site.workspace.upper_m
    start = generator.uniform(low_x, high_x), generator.uniform(low_z, high_z)
    needed_m = generator.uniform(0.0, 4.0)
    spare_m = spare_of(maps, lambda place: clearance(site, place) - needed_m)
    end = refuge_leg(site, vehicle, maps, start, spare_m)
    x_m, z_m = maps.grid.axes_m
    open_to = [
        (max(0.0, -spare_m[ix, iz]), math.dist(start, (x_m[ix], z_m[iz])), ix, iz)
        for ix, iz in np.argwhere(~maps.occupied)
        if not enters_keep_out(site, vehicle, start, (x_m[ix], z_m[iz]), -1e-9)
    ]
    if end is None:
        assert not open_to
        return
    assert not enters_keep_out(site, vehicle, start, end, 1e-6)
    ix, iz = maps.grid.cell_of(end)
    found = max(0.0, -spare_m[ix, iz]), math.dist(start, end)
    if open_to:
        assert found <= (min(open_to)[0] + 1e-6, min(open_to)[1] + 1e-6)


def test_a_refuge_leg_comes_no_nearer_to_the_obstacle_that_it_leaves():
    site = make_site(conductor(4.5, 4.5, 0.1))
    vehicle = make_vehicle(radius=0.5)
    maps = build_maps(site, vehicle)
    spare_m = spare_of(maps, lambda place: clearance(site, place) - 2.5)
    start = (5.3, 4.4)
    end = refuge_leg(site, vehicle, maps, start, spare_m, widened_m=2.0)
    assert clearance(site, end) >= 2.5
    assert not falls(site, start, end, 200, 1e-6)


def test_a_refuge_leg_stays_inside_the_fence():
    site, vehicle = make_site(conductor(4.5, 4.5, 0.1)), make_vehicle(radius=0.5)
    fence = PlaneFence(bounds=(Bound(name="west", x_m=((-1.0, 5.9),)),), margin_m=0.0)
    maps = build_maps(site, vehicle, fence=fence)
    spare_m = spare_of(maps, lambda place: clearance(site, place) - 2.5)
    end = refuge_leg(site, vehicle, maps, (5.4, 4.5), spare_m)
    assert end[0] < 5.9

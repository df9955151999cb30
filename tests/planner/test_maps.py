"""The maps of a site: by hand, at their limits, and cell by cell against the oracle."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from moar_companion.planner.geometry import hull_vertices_m, polygon_distance_m
from moar_companion.planner.grid import Grid
from moar_companion.planner.maps import build_maps, distance_cost, speed_limit_mps

from . import oracle
from .problems import conductor, make_site, make_vehicle, polygon, random_problem

PAIRS = [
    ("occupied", "occupied"),
    ("obstacle_distance_m", "d_obs"),
    ("hull_distance_m", "d_ch"),
    ("horizontal_distance_m", "d_hor"),
    ("collision_cost", "collision"),
    ("insertion_cost", "insertion"),
    ("damage_cost", "damage"),
    ("safety_cost", "safety"),
    ("speed_limit_mps", "v_sat"),
]


@pytest.mark.parametrize("batch", range(5))
def test_every_map_agrees_with_the_oracle_in_every_cell(batch):
    rng = random.Random(f"maps {batch}")
    for _ in range(30):
        problem = random_problem(rng)
        uncertainty_m = rng.choice([0.0, 0.4])
        maps = build_maps(problem.site, problem.vehicle, uncertainty_m)
        expected = oracle.build_maps(problem.site, problem.vehicle, uncertainty_m)
        assert maps.grid.shape == expected.shape
        for name, plain in PAIRS:
            array = np.empty(expected.shape)
            for cell, value in getattr(expected, plain).items():
                array[cell] = value
            np.testing.assert_allclose(getattr(maps, name), array, atol=1e-9, err_msg=name)


# Cells ------------------------------------------------------------------------------------------

GRID = Grid.over((-1.0, 2.0), (2.1, 3.5), 0.5)
"""6 by 3 cells; 0.1 m along x are left over."""


@pytest.mark.parametrize(
    ("case", "point", "cell"),
    [
        ("lower corner", (-1.0, 2.0), (0, 0)),
        ("inside a cell", (-0.6, 2.4), (0, 0)),
        ("on the border of two cells: the greater", (-0.5, 2.5), (1, 1)),
        ("just below a border, within the tolerance", (-0.5 - 4e-10, 2.2), (1, 0)),
        ("just below a border, beyond the tolerance", (-0.5 - 1e-8, 2.2), (0, 0)),
        ("the last cell's upper border", (2.0, 3.5), (5, 2)),
        ("in the remainder", (2.05, 3.0), None),
        ("on the far border of the remainder", (2.1, 3.0), None),
        ("left of the workspace", (-1.01, 2.5), None),
        ("below the workspace", (0.0, 1.99), None),
        ("above the workspace", (0.0, 3.51), None),
        ("on the lower border but for rounding", (-1.0 - 1e-12, 2.0 - 1e-12), (0, 0)),
        ("nowhere", (math.nan, 2.5), None),
        ("infinitely far", (math.inf, 2.5), None),
    ],
)
def test_a_point_belongs_to_the_cell_given_on_the_planner_page(case, point, cell):
    assert GRID.shape == (6, 3)
    assert GRID.cell_of(point) == cell, case


def test_thirty_metres_at_thirty_centimetres_are_a_hundred_cells():
    assert Grid.over((0.0, 0.0), (30.0, 20.0), 0.3).shape == (100, 66)


def test_a_workspace_smaller_than_a_cell_is_one_cell():
    assert Grid.over((0.0, 0.0), (0.2, 5.0), 1.0).shape == (1, 5)


def test_flat_indices_and_cells_are_inverse():
    cells = [(ix, iz) for ix in range(6) for iz in range(3)]
    flat = np.array([GRID.flat(cell) for cell in cells])
    assert len(set(flat.tolist())) == len(cells)
    np.testing.assert_array_equal(GRID.unflat(flat), cells)


# Occupied ---------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("min_altitude", "lowest_free_row"),
    [(None, 0), (2.5, 2), (2.5 + 5e-10, 2), (2.5 + 1e-8, 3), (2.5 - 1e-8, 2), (99.0, 8)],
)
def test_rows_whose_centre_is_below_the_minimum_altitude_are_occupied(
    min_altitude, lowest_free_row
):
    maps = build_maps(make_site(min_altitude=min_altitude), make_vehicle())
    assert maps.occupied[:, :lowest_free_row].all()
    assert not maps.occupied[:, lowest_free_row:].any()


def test_the_minimum_altitude_changes_no_other_map():
    low = build_maps(make_site(conductor(5.0, 5.0)), make_vehicle())
    high = build_maps(make_site(conductor(5.0, 5.0), min_altitude=3.0), make_vehicle())
    for name, _ in PAIRS[1:]:
        np.testing.assert_array_equal(getattr(low, name), getattr(high, name))


@pytest.mark.parametrize(
    ("radius", "keep_out", "uncertainty", "occupied"),
    [
        (1.9, 0.0, 0.0, False),
        (1.9 + 5e-10, 0.0, 0.0, False),
        (1.9 + 1e-8, 0.0, 0.0, True),
        (0.9, 1.0, 0.0, False),
        (0.9, 1.0 + 1e-8, 0.0, True),
        (0.9, 0.5, 0.5 + 1e-8, True),
    ],
)
def test_a_cell_is_occupied_if_its_clearance_is_less_than_required(
    radius, keep_out, uncertainty, occupied
):
    # The centre of cell (4, 4) is 2 m from that of the conductor, which has a radius of 0.1 m.
    site = make_site(conductor(6.5, 4.5, 0.1, keep_out=keep_out))
    maps = build_maps(site, make_vehicle(radius=radius), uncertainty)
    assert maps.occupied[4, 4] == occupied


def test_each_obstacle_keeps_out_by_its_own_distance():
    site = make_site(
        conductor(2.5, 4.5, 0.01, name="insulated"),
        conductor(7.5, 4.5, 0.01, name="live", keep_out=1.5),
    )
    maps = build_maps(site, make_vehicle(radius=0.6))
    assert maps.occupied[2, 4]
    assert not maps.occupied[3, 4]
    assert maps.occupied[6, 4]
    assert maps.occupied[7, 4]


@pytest.mark.parametrize("uncertainty_m", [0.1, 0.7, 2.0])
def test_the_distance_to_the_keep_outs_gives_the_occupied_cells_for_any_uncertainty(uncertainty_m):
    site = make_site(
        conductor(2.5, 4.5, 0.01, name="insulated"),
        conductor(7.5, 4.5, 0.01, name="live", keep_out=1.5),
        min_altitude=2.0,
    )
    exact = build_maps(site, make_vehicle(radius=0.6))
    wide = build_maps(site, make_vehicle(radius=0.6), uncertainty_m)
    low = np.broadcast_to(exact.grid.axes_m[1] < 2.0, exact.grid.shape)
    np.testing.assert_array_equal(wide.occupied, (exact.room_m < uncertainty_m - 1e-9) | low)
    np.testing.assert_allclose(wide.room_m, exact.room_m - uncertainty_m)


def test_an_obstacle_outside_the_workspace_counts():
    maps = build_maps(make_site(conductor(-0.5, 4.5, 0.01)), make_vehicle(radius=1.2))
    assert maps.occupied[0, 4]
    assert maps.obstacle_distance_m[0, 4] == pytest.approx(0.99)


# Distances --------------------------------------------------------------------------------------


def test_without_obstacles_all_distances_are_infinite_and_nothing_costs():
    maps = build_maps(make_site(), make_vehicle())
    for name in ("obstacle_distance_m", "hull_distance_m", "horizontal_distance_m"):
        assert np.isposinf(getattr(maps, name)).all()
    for name in ("collision_cost", "insertion_cost", "damage_cost", "safety_cost", "occupied"):
        assert not getattr(maps, name).any()
    assert (maps.speed_limit_mps == 10.0).all()


def test_inside_an_obstacle_the_distance_is_zero():
    square = polygon((2.0, 2.0), (4.0, 2.0), (4.0, 4.0), (2.0, 4.0))
    maps = build_maps(make_site(square, conductor(7.5, 4.5, 1.2)), make_vehicle())
    assert maps.obstacle_distance_m[2, 2] == 0.0
    assert maps.obstacle_distance_m[7, 4] == 0.0
    assert maps.obstacle_distance_m[7, 5] == 0.0
    assert maps.obstacle_distance_m[0, 3] == pytest.approx(1.5)


@pytest.mark.parametrize(
    ("hull", "points", "distances"),
    [
        ("a point", [(5.0, 4.0)], {(5.0, 4.0): 0.0, (8.0, 8.0): 5.0}),
        ("twice the same point", [(5.0, 4.0)] * 2, {(8.0, 8.0): 5.0}),
        ("two points", [(2.0, 4.0), (6.0, 4.0)], {(4.0, 6.0): 2.0, (9.0, 8.0): 5.0}),
        ("a flat circuit", [(2.0, 4.0), (6.0, 4.0), (4.0, 4.0)], {(3.0, 1.0): 3.0, (4, 4): 0.0}),
        ("a vertical circuit", [(2.0, 1.0), (2.0, 7.0), (2.0, 4.0)], {(5.0, 3.0): 3.0}),
        ("a slope", [(0.0, 0.0), (1.0, 1.0), (3.0, 3.0)], {(2.0, 0.0): math.sqrt(2.0)}),
        ("a triangle", [(0.0, 0.0), (4.0, 0.0), (0.0, 4.0)], {(1, 1): 0.0, (4, 4): math.sqrt(8)}),
    ],
)
def test_the_hull_of_few_points_is_a_point_a_segment_or_a_shape(hull, points, distances):
    vertices = hull_vertices_m(tuple(conductor(*point) for point in points))
    for point, distance in distances.items():
        measured = polygon_distance_m(vertices, np.array(point, dtype=float))
        assert measured == pytest.approx(distance, abs=1e-12), hull


@pytest.mark.parametrize("exponent", range(-16, -2))
@pytest.mark.parametrize("offset", [0.0, 1e3])
def test_the_hull_of_an_almost_flat_circuit_is_almost_its_segment(exponent, offset):
    bump = 10.0**exponent
    points = [(0.0, 0.0), (3.0, bump), (7.0, -bump), (10.0, bump)]
    vertices = hull_vertices_m(tuple(conductor(x + offset, z + offset) for x, z in points))
    here = np.array([(5.0, 2.0), (14.0, 3.0)]) + offset
    assert polygon_distance_m(vertices, here) == pytest.approx([2.0, 5.0], abs=2.0 * bump + 1e-9)


def test_conductors_enter_the_hull_by_their_centres_and_shapes_by_their_vertices():
    triangle = polygon((6.0, 1.0), (7.0, 1.0), (6.0, 3.0))
    maps = build_maps(make_site(conductor(2.5, 1.0, 0.5), triangle), make_vehicle())
    assert maps.hull_distance_m[2, 0] == pytest.approx(0.5)
    assert maps.hull_distance_m[0, 0] == pytest.approx(math.hypot(2.0, 0.5))


def test_the_damage_cost_ends_at_the_45_degree_slope_which_itself_counts_as_above():
    maps = build_maps(make_site(conductor(4.5, 2.5)), make_vehicle())
    distance = maps.horizontal_distance_m
    assert distance[4, 3] == 0.0
    assert distance[5, 3] == pytest.approx(1.0), "on the slope"
    assert distance[2, 4] == pytest.approx(2.0), "on the slope"
    assert np.isposinf(distance[6, 3]), "below the slope"
    assert np.isposinf(distance[4, 2]), "beside the conductor, not above it"
    assert np.isposinf(distance[4, 1]), "below the conductor"


def test_the_slope_starts_at_the_lowest_obstacle_of_the_site():
    site = make_site(conductor(7.5, 0.5, name="low"), conductor(2.5, 4.5, name="high"))
    distance = build_maps(site, make_vehicle()).horizontal_distance_m
    # One level above `high` and 3 m aside: below its own slope, above that of `low`.
    assert distance[5, 5] == pytest.approx(2.0), "nearest below is `low`"
    assert distance[0, 5] == pytest.approx(2.0)


def test_an_overhang_counts_only_where_a_part_of_the_obstacle_is_below():
    # A gallows: a post at x = 2 to 3, an arm at z = 5 to 6 that reaches to x = 8.
    gallows = polygon(
        (2.0, 0.0), (3.0, 0.0), (3.0, 5.0), (8.0, 5.0), (8.0, 6.0), (2.0, 6.0), name="gallows"
    )
    distance = build_maps(make_site(gallows), make_vehicle()).horizontal_distance_m
    assert distance[6, 4] == pytest.approx(3.5), "below the arm only the post counts"
    assert distance[6, 6] == 0.0, "above the arm"
    assert distance[9, 7] == pytest.approx(1.5)
    assert distance[2, 0] == 0.0, "inside"


# Costs and speed --------------------------------------------------------------------------------


def test_the_cost_of_a_distance_is_that_of_equation_3():
    # d_min 1.2 m and d_max 3 m give alpha = 2 / 3.
    distance = np.array([0.0, 1.2, 2.0, 2.4, 3.0, 3.1, math.inf])
    cost = distance_cost(distance, make_vehicle().safety)
    assert cost == pytest.approx([1.0, 1.0, 1.0 / 3.0, 1.0 / 6.0, 0.0, 0.0, 0.0])


def test_the_speed_limit_is_that_of_equation_5():
    # From 0.5 m/s at 1.2 m to 10 m/s at 3 m.
    distance = np.array([0.0, 1.2, 2.1, 3.0, 9.0, math.inf])
    vehicle = make_vehicle()
    limit = speed_limit_mps(distance, vehicle.safety, vehicle.speed)
    assert limit == pytest.approx([0.5, 0.5, 5.25, 10.0, 10.0, 10.0])


def test_the_safety_cost_is_within_zero_and_one_and_the_share_of_its_three_terms():
    site = make_site(conductor(3.0, 3.0), conductor(7.0, 5.0, name="other"))
    maps = build_maps(site, make_vehicle(shares=(0.3, 0.2, 0.5)))
    total = 0.3 * maps.collision_cost + 0.2 * maps.insertion_cost + 0.5 * maps.damage_cost
    np.testing.assert_allclose(maps.safety_cost, total, atol=1e-15)
    assert maps.safety_cost.min() >= 0.0
    assert maps.safety_cost.max() <= 1.0 + 1e-15


def test_maps_are_read_only():
    maps = build_maps(make_site(conductor(5.0, 5.0)), make_vehicle())
    for name, _ in PAIRS:
        with pytest.raises(ValueError, match="read-only"):
            getattr(maps, name)[0, 0] = 0

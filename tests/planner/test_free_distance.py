"""Free length of straight flights: by hand, and against small steps along the ray."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from moar_companion.planner.clearances import Clearances
from moar_companion.planner.free_distance import FreeDistance
from moar_companion.planner.grid import Grid

from .problems import conductor, make_site, polygon

RIGHT, UP = (1.0, 0.0), (0.0, 1.0)


def free_m(reach, place, direction, farthest_m=50.0):
    return float(reach.free_m(np.array([place]), np.array([direction]), farthest_m)[0])


def test_a_ray_ends_where_the_first_blocked_cell_begins():
    reach = FreeDistance.over(make_site(conductor(5.5, 0.5)), radius_m=0.1)
    assert free_m(reach, (0.25, 0.5), RIGHT) == pytest.approx(4.75)
    assert free_m(reach, (0.25, 0.5), RIGHT, farthest_m=2.0) == 2.0
    assert free_m(reach, (0.25, 1.5), RIGHT) == 50.0


def test_the_free_distance_of_a_slanted_direction_is_measured_along_it():
    reach = FreeDistance.over(make_site(conductor(5.5, 4.5)), radius_m=0.1)
    slant = (0.8, 0.6)
    # It enters the cell through its left side, at x = 5.
    assert free_m(reach, (1.5, 1.5), slant) == pytest.approx(3.5 / 0.8)


def test_keep_outs_of_the_site_and_the_position_uncertainty_count():
    site = make_site(conductor(5.5, 0.5, keep_out=1.5))
    assert free_m(FreeDistance.over(site, 0.1), (0.25, 0.5), RIGHT) == pytest.approx(3.75)
    assert free_m(FreeDistance.over(site, 0.1, 1.0), (0.25, 0.5), RIGHT) == pytest.approx(2.75)


def test_space_below_the_minimum_altitude_is_no_obstacle():
    reach = FreeDistance.over(make_site(min_altitude=3.0), radius_m=0.1)
    assert free_m(reach, (0.5, 6.5), (0.0, -1.0)) == 50.0


def test_obstacles_outside_the_workspace_count():
    reach = FreeDistance.over(
        make_site(conductor(5.5, 11.5), polygon((-4, 2), (-4, 3), (-5, 3))), 0.1
    )
    assert free_m(reach, (5.5, 0.5), UP) == pytest.approx(10.5)
    assert 4.0 <= free_m(reach, (0.5, 2.5), (-1.0, 0.0)) <= 5.0


def test_an_obstacle_a_kilometre_away_costs_no_memory():
    reach = FreeDistance.over(make_site(conductor(1000.0, 4.5)), radius_m=0.1)
    assert reach.blocked.size < 1000


def test_from_inside_a_keep_out_the_distance_counts_from_its_border():
    reach = FreeDistance.over(
        make_site(conductor(2.5, 0.5, keep_out=1.2), conductor(8.5, 0.5)), 0.1
    )
    assert free_m(reach, (2.5, 0.5), RIGHT) == pytest.approx(5.5)
    assert free_m(reach, (2.5, 0.5), UP) == 50.0


def test_without_motion_the_free_distance_is_not_limited():
    reach = FreeDistance.over(make_site(conductor(2.5, 0.5)), radius_m=0.1)
    assert free_m(reach, (5.5, 0.5), (0.0, 0.0)) == 50.0
    assert free_m(reach, (2.5, 0.5), (0.0, 0.0)) == 50.0


def test_the_obstacle_that_is_hit_has_a_name():
    wide = conductor(5.5, 0.5, name="wide", keep_out=2.0)
    reach = FreeDistance.over(make_site(conductor(2.5, 0.5, name="thin"), wide), radius_m=0.1)
    assert reach.nearest((3.9, 0.5)) == "wide"
    assert reach.nearest((2.6, 0.5)) == "thin"


@settings(deadline=None, max_examples=200)
@given(
    blocked=st.lists(st.booleans(), min_size=48, max_size=48),
    x=st.floats(-2.0, 10.0),
    z=st.floats(-2.0, 8.0),
    angle_rad=st.floats(-math.pi, math.pi),
    farthest_m=st.floats(0.1, 12.0),
)
def test_as_by_small_steps(blocked, x, z, angle_rad, farthest_m):
    cells = np.array(blocked, dtype=np.uint8).reshape(8, 6)
    grid = Grid(lower_m=(0.0, 0.0), resolution_m=1.0, shape=(8, 6))
    direction = (math.cos(angle_rad), math.sin(angle_rad))
    # Along a border of cells, rounding decides in which of them the small steps are.
    assume(min(map(abs, direction)) > 1e-6)
    reach = FreeDistance(grid=grid, blocked=cells, clearances=Clearances.over(grid, ()))
    free = free_m(reach, (x, z), direction, farthest_m)

    def solid(at_m):
        ix, iz = math.floor(x + at_m * direction[0]), math.floor(z + at_m * direction[1])
        return 0 <= ix < 8 and 0 <= iz < 6 and bool(cells[ix, iz])

    step_m = 0.01
    steps = [solid(step_m * index) for index in range(math.ceil(16.0 / step_m))]
    left = steps.index(False)
    again = next((i for i, hit in enumerate(steps[left:], left) if hit), len(steps))
    found_m = min(farthest_m, step_m * again)
    # A ray may touch a corner between two steps, and never goes through a cell that a step is in.
    assert free <= found_m + 1e-9
    touched = free + 1e-6
    near = [solid(touched + shift) for shift in (-2e-6, 0.0, 2e-6)]
    assert free >= found_m - step_m - 1e-9 or any(near) or _grazes(cells, x, z, direction, free)


def _grazes(cells, x, z, direction, at_m):
    """True if a blocked cell is within a hair of a place on a ray."""
    for dx in (-1e-6, 1e-6):
        for dz in (-1e-6, 1e-6):
            ix = math.floor(x + at_m * direction[0] + dx)
            iz = math.floor(z + at_m * direction[1] + dz)
            if 0 <= ix < 8 and 0 <= iz < 6 and cells[ix, iz]:
                return True
    return False

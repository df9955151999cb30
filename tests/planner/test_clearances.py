"""Clearances: maps repaired after a change equal new maps, bit by bit."""

from __future__ import annotations

import dataclasses
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moar_companion.planner.clearances import Clearances
from moar_companion.planner.geometry import obstacle_distance_m
from moar_companion.planner.grid import Grid
from moar_companion.planner.maps import build_maps

from .problems import conductor, make_site, make_vehicle, random_obstacles, random_problem

seeds = st.integers(min_value=0, max_value=10**6)
properties = settings(deadline=None, max_examples=60, derandomize=True, database=None)
GRID = Grid.over((0.0, 0.0), (10.0, 8.0), 0.5)


def changed(rng, site):
    """A site's obstacles with some gone, some new, in another order."""
    space = site.workspace
    new = random_obstacles(rng, space.lower_m, space.upper_m)
    kept = [item for item in site.obstacles if rng.random() < 0.7]
    obstacles = [*kept, *new[: rng.randint(0, 2)]]
    rng.shuffle(obstacles)
    return dataclasses.replace(site, obstacles=tuple(obstacles))


@properties
@given(seeds)
def test_repaired_maps_are_those_built_anew(seed):
    rng = random.Random(seed)
    problem = random_problem(rng)
    site, vehicle = problem.site, problem.vehicle
    maps = build_maps(site, vehicle, 0.1)
    for _ in range(4):
        site = changed(rng, site)
        maps = build_maps(site, vehicle, 0.1, before=maps)
        anew = build_maps(site, vehicle, 0.1)
        for name, array in vars(anew).items():
            if isinstance(array, np.ndarray):
                np.testing.assert_array_equal(getattr(maps, name), array, err_msg=name)
        assert maps.reach.grid == anew.reach.grid
        np.testing.assert_array_equal(maps.reach.blocked, anew.reach.blocked)


@properties
@given(seeds)
def test_each_cell_has_its_nearest_obstacle(seed):
    rng = random.Random(seed)
    site = random_problem(rng).site
    before = Clearances.over(GRID, site.obstacles)
    clearances = Clearances.over(GRID, changed(rng, site).obstacles, before)
    places = np.stack(np.meshgrid(*GRID.axes_m, indexing="ij"), axis=-1)
    for index, obstacle in enumerate(clearances.obstacles):
        distance = obstacle_distance_m(obstacle, places)
        nearest, closest = clearances.nearest == index, clearances.closest == index
        np.testing.assert_allclose(
            clearances.distance_m[nearest], distance[nearest], rtol=1e-12, atol=1e-9
        )
        room = distance - obstacle.keep_out_m
        np.testing.assert_allclose(clearances.room_m[closest], room[closest], rtol=1e-12, atol=1e-9)
        assert (clearances.distance_m <= distance + 1e-9).all()
        assert (clearances.room_m <= room + 1e-9).all()


def test_without_obstacles_nothing_is_near():
    known = Clearances.over(GRID, (conductor(5.0, 4.0),))
    clearances = Clearances.over(GRID, (), known)
    assert np.isposinf(clearances.distance_m).all()
    assert np.isposinf(clearances.room_m).all()
    assert (clearances.nearest == -1).all()


@pytest.mark.parametrize("known", [0, 1])
def test_clearances_of_the_same_obstacles_on_the_same_grid_are_reused(known):
    obstacles = (conductor(5.0, 4.0), conductor(2.0, 2.0, name="other"))
    own = Clearances.over(GRID, obstacles)
    elsewhere = Clearances.over(Grid.over((1.0, 0.0), (10.0, 8.0), 0.5), obstacles)
    order = (own, elsewhere) if known else (elsewhere, own)
    assert Clearances.over(GRID, obstacles, *order) is own


def test_the_reach_shares_the_clearances_of_maps_where_nothing_stands_outside():
    maps = build_maps(make_site(conductor(5.0, 4.0)), make_vehicle())
    assert maps.reach.clearances is maps.clearances
    maps = build_maps(make_site(conductor(-3.0, 4.0)), make_vehicle())
    assert maps.reach.grid.shape > maps.grid.shape

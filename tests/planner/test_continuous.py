"""J of continuous paths: the grid's own paths cost what they do on the grid, sampled finely."""

from __future__ import annotations

import numpy as np
import pytest

from moar_companion.planner.planner import Planner
from moar_companion.planner.refinement import ContinuousCost
from moar_companion.planner.solver import walked
from moar_companion.types import Weights

from .problems import CORNERS, conductor, make_site, make_vehicle

MIXED = Weights(0.5, 0.3, 0.2)
VELOCITY_MPS = (0.4, -0.3)
BENT_M = np.array([(1.1, 1.3), (4.0, 2.9), (6.2, 3.0), (8.7, 1.2)])


def planner_of(resolution=0.25):
    site = make_site(
        conductor(5.0, 4.5), conductor(2.0, 6.5), size=(10.0, 8.0), resolution=resolution
    )
    return Planner(site, make_vehicle())


def cost_on(planner, **details):
    """J of paths on a planner's maps."""
    cost = ContinuousCost.on(planner.maps, planner.vehicle.speed, **details)
    return lambda *path, **end: cost.of_path(*path, **end).total


@pytest.mark.parametrize("weights", [MIXED, *(Weights(*corner) for corner in CORNERS)])
@pytest.mark.parametrize("heading", range(1, 9))
def test_a_straight_path_costs_what_it_costs_on_the_graph(heading, weights):
    differences = []
    for resolution in (0.2, 0.1, 0.05):
        planner = planner_of(resolution)
        grid, direction = planner.maps.grid, planner.graph.moves.steps[heading]
        count = round(1.6 / resolution)
        first = grid.cell_of((3.05, 2.45 - 1.6 * (direction[1] > 0)))
        cells = np.array(first) + np.outer([0, count], direction)
        _, cost = walked(
            planner.graph,
            grid.flat(first),
            np.array([*VELOCITY_MPS, 0.0]),
            np.array([heading] * count + [0]),
            weights,
        )
        path_m = np.array(grid.lower_m) + (cells + 0.5) * resolution
        found = cost_on(planner)(path_m, VELOCITY_MPS, weights, ends_at_rest=True)
        differences.append(abs(found - cost.total))
    # The graph takes the cost of a step at its end: an error of half the change within the step.
    assert differences[-1] <= 0.02 * max(1.0, cost.total)
    assert differences[-1] <= 0.5 * differences[0] + 1e-9


def test_with_closer_samples_the_cost_settles_and_its_velocity_change_never_falls():
    planner = planner_of()
    settled = cost_on(planner, samples_per_cell=1024)
    for weights in (MIXED, Weights(0.0, 0.0, 1.0)):
        best = settled(BENT_M, VELOCITY_MPS, weights, ends_at_rest=True)
        costs = [
            cost_on(planner, samples_per_cell=2**power)(
                BENT_M, VELOCITY_MPS, weights, ends_at_rest=True
            )
            for power in range(8)
        ]
        errors = np.abs(np.array(costs) - best)
        assert errors[0] > 1e-6
        assert errors[-1] < 1e-4 * best
        assert errors[-1] < 0.1 * errors[0]
    assert (np.diff(costs) >= -1e-12).all()


def test_cutting_a_leg_in_two_does_not_change_the_cost():
    cost = cost_on(planner_of(), samples_per_cell=256)
    whole = cost(BENT_M, VELOCITY_MPS, MIXED, ends_at_rest=False)
    middle = BENT_M[:2].mean(axis=0)
    twice = np.insert(BENT_M, [1, 1, 1], [middle, middle, middle], axis=0)
    assert cost(twice, VELOCITY_MPS, MIXED, ends_at_rest=False) == pytest.approx(whole, rel=1e-5)


def test_a_turn_and_the_stop_at_the_end_cost_their_velocity_change():
    planner = planner_of()
    cost = cost_on(planner)
    energy = Weights(0.0, 0.0, 1.0)
    corner_m = np.array([(0.8, 0.8), (1.6, 0.8), (1.6, 1.4)])
    speed = planner.vehicle.speed
    moving = (speed.horizontal_mps, 0.0)
    turn = np.hypot(speed.horizontal_mps, speed.up_mps)
    expected = [turn, turn + speed.up_mps]
    for ends_at_rest, change in zip((False, True), expected, strict=True):
        found = cost(corner_m, moving, energy, ends_at_rest=ends_at_rest)
        assert found == pytest.approx(0.5 * change / speed.max_mps)


@pytest.mark.parametrize("end_m", [(5.0, 4.5), (5.0, 6.0), (11.0, 1.0), (1.0, -0.5)])
def test_a_path_through_an_obstacle_or_out_of_the_workspace_costs_more_than_any(end_m):
    cost = cost_on(planner_of())
    path_m = np.array([(5.0, 1.0), end_m])
    for weights in (MIXED, *(Weights(*corner) for corner in CORNERS)):
        assert cost(path_m, VELOCITY_MPS, weights, ends_at_rest=True) == np.inf


@pytest.mark.parametrize("step_m", [0.0, 1e-300, 1e-12, 1e-9])
def test_points_in_one_place_do_not_add_cost(step_m):
    cost = cost_on(planner_of())
    path_m = BENT_M.copy()
    twice = np.insert(path_m, 1, path_m[1] - step_m * np.array([1.0, 0.5]), axis=0)
    whole = cost(path_m, VELOCITY_MPS, Weights(0.5, 0.5, 0.0), ends_at_rest=True)
    assert cost(twice, VELOCITY_MPS, Weights(0.5, 0.5, 0.0), ends_at_rest=True) == pytest.approx(
        whole
    )

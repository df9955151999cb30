"""The gate: what may not leave, and the corridors in which more may."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moar_companion.mission.gate import distance_m, refusal

FREE, OCCUPIED = (0, 0), (0, 1)
OCCUPANCY = np.array([[False, True]])
LEG = ((0.0, 0.0, 5.0), (10.0, 0.0, 5.0), (10.0, 0.0, 0.0))


def reason(
    position=(1.0, 0.0, 1.0), velocity=(0.0, 0.0, 0.0), cell=FREE, corridors=(), lowest_m=None
):
    return refusal(
        position,
        velocity,
        cell=cell,
        occupied=OCCUPANCY,
        min_altitude_m=lowest_m,
        corridors_m=corridors,
        corridor_width_m=0.3,
        plane_tolerance_m=2.0,
    )


def test_a_setpoint_in_a_free_cell_may_leave():
    assert reason() is None
    assert reason(position=(1.0, 2.0, 1.0)) is None


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_what_is_not_finite_is_refused_wherever_it_stands(bad, axis):
    values = [1.0, 0.0, 1.0]
    values[axis] = bad
    assert reason(position=tuple(values), corridors=(LEG,)) == "the setpoint is not finite"
    assert reason(velocity=tuple(values), corridors=(LEG,)) == "the setpoint is not finite"
    assert reason(position=tuple(values), cell=None) == "the setpoint is not finite"


@pytest.mark.parametrize("y_m", [2.01, -2.01, 50.0])
def test_off_the_plane_is_refused_even_in_a_corridor(y_m):
    corridor = ((1.0, y_m, 1.0), (2.0, y_m, 1.0))
    assert "from the plane" in reason(position=(1.0, y_m, 1.0), corridors=(corridor,))


def test_outside_the_workspace_is_refused():
    assert reason(cell=None) == "the setpoint is outside the workspace"


def test_an_occupied_cell_is_refused():
    assert reason(cell=OCCUPIED) == "the setpoint is too close to an obstacle or too low"


@pytest.mark.parametrize(("z_m", "allowed"), [(2.0, True), (2.0 - 1e-12, True), (1.99, False)])
def test_below_the_least_altitude_is_refused_though_its_cell_is_free(z_m, allowed):
    low = reason(position=(1.0, 0.0, z_m), lowest_m=2.0)
    assert low == (None if allowed else "the setpoint is too close to an obstacle or too low")


def test_a_landing_leg_leads_below_the_least_altitude():
    assert reason(position=(10.0, 0.0, 0.5), lowest_m=2.0, corridors=(LEG,)) is None


@pytest.mark.parametrize("cell", [None, OCCUPIED])
@pytest.mark.parametrize(
    ("position", "allowed"),
    [
        ((5.0, 0.0, 5.0), True),
        ((5.0, 0.0, 5.29), True),
        ((5.0, 0.29, 5.0), True),
        ((5.0, 0.0, 5.31), False),
        ((-0.29, 0.0, 5.0), True),
        ((-0.31, 0.0, 5.0), False),
        ((10.2, 0.0, 5.2), True),
        ((10.0, 0.0, -0.31), False),
        ((5.0, 0.0, 2.5), False),
    ],
)
def test_in_a_corridor_and_nowhere_beside_it_more_is_allowed(cell, position, allowed):
    assert (reason(position=position, cell=cell, corridors=(LEG,)) is None) is allowed


def test_any_of_several_corridors_will_do():
    other = ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    assert reason(position=(5.0, 0.0, 5.0), cell=None, corridors=(other, LEG)) is None


@pytest.mark.parametrize(
    ("point", "corridor", "distance"),
    [
        ((3.0, 0.0, 4.0), ((0.0, 0.0, 0.0),), 5.0),
        ((3.0, 0.0, 4.0), ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)), 5.0),
        ((1.0, 2.0, 0.0), ((0.0, 0.0, 0.0), (2.0, 0.0, 0.0)), 2.0),
        ((-3.0, 0.0, 4.0), ((0.0, 0.0, 0.0), (2.0, 0.0, 0.0)), 5.0),
        ((5.0, 0.0, 4.0), ((0.0, 0.0, 0.0), (2.0, 0.0, 0.0)), 5.0),
    ],
)
def test_the_distance_from_a_corridor_by_hand(point, corridor, distance):
    assert distance_m(point, corridor) == pytest.approx(distance)


coordinates = st.tuples(*[st.floats(-20.0, 20.0)] * 3)


@settings(deadline=None, max_examples=60, derandomize=True, database=None)
@given(point=coordinates, corridor=st.lists(coordinates, min_size=1, max_size=5))
def test_the_distance_from_a_corridor_is_the_least_to_its_points(point, corridor):
    """Against many points on it: never more than to any, and at most their spacing less."""
    line = np.array(corridor)
    sampled = [line[:1]]
    spacing = 0.0
    for start, end in itertools.pairwise(line):
        sampled.append(start + np.linspace(0.0, 1.0, 200)[:, None] * (end - start))
        spacing = max(spacing, math.dist(start, end) / 199.0)
    least = float(np.linalg.norm(np.concatenate(sampled) - np.array(point), axis=1).min())
    assert least - spacing - 1e-9 <= distance_m(point, tuple(corridor)) <= least + 1e-9

"""The setpoint gate: refused setpoints, and the corridors that allow more."""

from __future__ import annotations

import ast
import inspect
import itertools
import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moar_companion.companion.safety import setpoint_gate
from moar_companion.companion.safety.conditions import CONDITIONS
from moar_companion.companion.safety.setpoint_gate import (
    distance_m,
    distances_m,
    motion_refusal,
    refusal,
)

FREE, OCCUPIED = (0, 0), (0, 1)
OCCUPANCY = np.array([[False, True]])
ROOM_M = np.array([[0.5, -0.1]])
LEG = ((0.0, 0.0, 5.0), (10.0, 0.0, 5.0), (10.0, 0.0, 0.0))


def reason(
    position=(1.0, 0.0, 1.0),
    velocity=(0.0, 0.0, 0.0),
    yaw_rad=0.0,
    cell=FREE,
    corridors=(),
    entry_legs=(),
    lowest_m=None,
    widened_m=0.0,
    margin_m=0.0,
):
    refused = refusal(
        position,
        velocity,
        yaw_rad,
        cell=cell,
        occupied=OCCUPANCY,
        room_m=ROOM_M,
        widened_m=widened_m,
        margin_m=margin_m,
        min_altitude_m=lowest_m,
        corridors_m=corridors,
        legs_from_beside_m=entry_legs,
        corridor_width_m=0.3,
        plane_tolerance_m=2.0,
    )
    return None if refused is None else refused.reason


def test_a_setpoint_in_a_free_cell_is_sent():
    assert reason() is None
    assert reason(position=(1.0, 2.0, 1.0)) is None


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_setpoint_that_is_not_finite_is_refused_everywhere(bad, axis):
    values = [1.0, 0.0, 1.0]
    values[axis] = bad
    assert reason(position=tuple(values), corridors=(LEG,)) == "setpoint not finite"
    assert reason(velocity=tuple(values), corridors=(LEG,)) == "setpoint not finite"
    assert reason(position=tuple(values), cell=None) == "setpoint not finite"
    assert reason(yaw_rad=bad, corridors=(LEG,)) == "setpoint not finite"


@pytest.mark.parametrize("y_m", [2.01, -2.01, 50.0])
def test_a_setpoint_off_the_plane_is_refused_even_in_a_corridor(y_m):
    corridor = ((1.0, y_m, 1.0), (2.0, y_m, 1.0))
    assert "from the plane" in reason(position=(1.0, y_m, 1.0), corridors=(corridor,))


def test_beside_the_plane_only_an_entry_leg_is_allowed():
    leg = ((1.0, 20.0, 1.0), (1.0, 0.0, 1.0))
    assert reason(position=(1.0, 12.0, 1.0), corridors=(leg,), entry_legs=(leg,)) is None
    beside = reason(position=(4.0, 12.0, 1.0), corridors=(leg,), entry_legs=(leg,))
    assert "from the plane" in beside


def test_a_setpoint_outside_the_workspace_is_refused():
    assert reason(cell=None) == "setpoint outside the workspace"


def test_a_setpoint_in_an_occupied_cell_is_refused():
    assert reason(cell=OCCUPIED) == "setpoint near an obstacle, or low"


@pytest.mark.parametrize(("z_m", "allowed"), [(2.0, True), (2.0 - 1e-12, True), (1.99, False)])
def test_a_setpoint_below_the_least_altitude_is_refused_even_in_a_free_cell(z_m, allowed):
    low = reason(position=(1.0, 0.0, z_m), lowest_m=2.0)
    assert low == (None if allowed else "setpoint near an obstacle, or low")


def test_a_worse_position_accuracy_widens_the_keep_outs_of_moving_setpoints():
    moving = (0.5, 0.0, 0.0)
    assert reason(velocity=moving, widened_m=0.5) is None
    assert "widened by 0.6 m" in reason(velocity=moving, widened_m=0.6)
    assert reason(velocity=(0.0, 0.0, 0.0), widened_m=5.0) is None  # the aircraft may stay
    # The legs that were checked lead away from obstacles.
    assert reason(position=(5.0, 0.0, 5.0), cell=None, corridors=(LEG,), widened_m=5.0) is None


def test_within_the_margin_only_a_setpoint_at_rest_is_allowed():
    assert reason(cell=OCCUPIED, margin_m=0.1) is None
    assert (
        reason(cell=OCCUPIED, margin_m=0.05) is not None
    )  # the cell is in the obstacle's own keep-out
    assert reason(cell=OCCUPIED, margin_m=0.1, velocity=(0.1, 0.0, 0.0)) is not None
    low = reason(position=(1.0, 0.0, 1.9), cell=OCCUPIED, margin_m=0.1, lowest_m=2.0)
    assert low == "setpoint near an obstacle, or low"


LIMITS = {"greatest_mps": 2.0, "least_mps": 0.5, "acceleration_mps2": 1.0}
REST = ((0.0, 0.0, 5.0), (0.0, 0.0, 0.0))


def motion(position=(0.0, 0.0, 5.0), velocity=(0.0, 0.0, 0.0), before=REST, elapsed_s=0.02):
    refused = motion_refusal(before, (position, velocity), elapsed_s, **LIMITS)
    return None if refused is None else refused.reason


@pytest.mark.parametrize(("speed_mps", "allowed"), [(2.5, True), (2.54, True), (2.6, False)])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_no_setpoint_moves_faster_than_the_vehicle_may(axis, speed_mps, allowed):
    velocity = [0.0, 0.0, 0.0]
    velocity[axis] = speed_mps
    refused = motion(velocity=tuple(velocity), before=None)
    assert refused is None if allowed else refused.startswith("setpoint at 2.6")


@pytest.mark.parametrize(("step_m", "allowed"), [(0.05, True), (0.06, False), (3.0, False)])
def test_no_setpoint_lies_farther_from_the_last_one_than_its_speed_allows(step_m, allowed):
    refused = motion(position=(0.0, 0.0, 5.0 + step_m))
    assert refused is None if allowed else refused.startswith("setpoint jumps by")
    assert motion(position=(0.0, 0.0, 5.0 + step_m), before=None) is None


@pytest.mark.parametrize(("change_mps", "allowed"), [(0.6, True), (0.65, False), (1.9, False)])
def test_no_setpoint_changes_its_speed_at_once(change_mps, allowed):
    refused = motion(velocity=(0.0, 0.0, change_mps))
    assert refused is None if allowed else refused.startswith("setpoint speed jump")


def test_a_landing_leg_may_go_below_the_least_altitude():
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
def test_an_occupied_cell_is_allowed_inside_a_corridor_alone(cell, position, allowed):
    assert (reason(position=position, cell=cell, corridors=(LEG,)) is None) is allowed


def test_any_one_of_several_corridors_is_enough():
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
def test_the_distance_from_a_corridor_agrees_with_a_calculation_by_hand(point, corridor, distance):
    assert distance_m(point, corridor) == pytest.approx(distance)


coordinates = st.tuples(*[st.floats(-20.0, 20.0)] * 3)


@settings(deadline=None, max_examples=60, derandomize=True, database=None)
@given(point=coordinates, corridor=st.lists(coordinates, min_size=1, max_size=5))
def test_the_distance_from_a_corridor_is_the_least_to_its_points(point, corridor):
    """Against many points on the corridor: their least distance, or less by at most the spacing."""
    line = np.array(corridor)
    sampled = [line[:1]]
    spacing = 0.0
    for start, end in itertools.pairwise(line):
        sampled.append(start + np.linspace(0.0, 1.0, 200)[:, None] * (end - start))
        spacing = max(spacing, math.dist(start, end) / 199.0)
    least = float(np.linalg.norm(np.concatenate(sampled) - np.array(point), axis=1).min())
    assert least - spacing - 1e-9 <= distance_m(point, tuple(corridor)) <= least + 1e-9


def test_the_memory_for_distances_does_not_grow_with_the_corridor():
    points = np.random.default_rng(1).uniform(0.0, 100.0, (5_000, 3))
    corridor = tuple(map(tuple, np.linspace((0.0, 0.0, 0.0), (0.0, 0.0, 90.0), 200)))
    tracemalloc.start()
    found = distances_m(points, corridor)
    _, most_bytes = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most_bytes < 100 * points.nbytes
    assert found == pytest.approx(distances_m(points, corridor[:: len(corridor) - 1]))


def test_a_setpoint_may_jump_only_at_rest_and_towards_a_displaced_aircraft():
    def moved(position, velocity=(0.0, 0.0, 0.0)):
        after = (position, velocity)
        return motion_refusal(REST, after, 0.02, **LIMITS, drifting_at_m=(9.0, 0.0, 5.0))

    assert moved((6.0, 0.0, 5.0)) is None
    assert moved((6.0, 0.0, 5.0), (0.5, 0.0, 0.0)).reason.startswith("setpoint jumps")
    assert "leaves" in moved((-1.0, 0.0, 5.0)).reason


@pytest.mark.parametrize(
    ("position", "velocity", "measured"),
    [
        ((0.0, 0.0, 5.0), (3.0, 0.0, 0.0), (3.0, 2.5, "m/s")),
        ((0.0, 0.0, 5.3), (0.0, 0.0, 0.0), (0.3, 0.02 * 2.55, "m")),
        ((0.0, 0.0, 5.0), (0.0, 0.0, 1.9), (1.9, 0.02 * 4.0 + 0.55, "m/s")),
    ],
)
def test_a_refused_motion_has_its_value_and_limit(position, velocity, measured):
    *numbers, unit = motion_refusal(REST, (position, velocity), 0.02, **LIMITS)[1:]
    assert (numbers, unit) == (pytest.approx(measured[:2]), measured[2])


@given(
    points=st.lists(st.tuples(*[st.floats(-20.0, 20.0)] * 3), min_size=1, max_size=5),
    corridor=st.lists(st.tuples(*[st.floats(-20.0, 20.0)] * 3), min_size=1, max_size=4),
)
def test_distances_of_many_points_equal_single_distances(points, corridor):
    found = distances_m(np.array(points), tuple(corridor))
    for point, distance in zip(points, found, strict=True):
        assert distance == distance_m(point, tuple(corridor))
        line = np.array([*corridor, corridor[-1]])
        parts = np.linspace(0.0, 1.0, 11)[:, None, None]
        samples = line[:-1] + parts * np.diff(line, axis=0)
        assert distance <= np.sqrt(((samples - point) ** 2).sum(axis=2)).min() + 1e-6


def test_every_reason_of_the_gate_is_in_the_table_of_texts():
    """The first words of each text; fields and units follow."""
    words = {
        item.value
        for item in ast.walk(ast.parse(inspect.getsource(setpoint_gate)))
        if isinstance(item, ast.Constant) and str(item.value).startswith("setpoint")
    }
    assert len(words) == 9
    (texts,) = (row.texts for row in CONDITIONS if row.name == "setpoint_held")
    for beginning in words:
        assert any(text.startswith(beginning.partition(" (")[0]) for text in texts), beginning

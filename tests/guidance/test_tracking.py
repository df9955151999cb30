"""Tracking: the setpoint never jumps, waits for the aircraft, and arrives."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moar_companion.companion.guidance.tracking import Reference, advanced
from moar_companion.companion.guidance.trajectory import make_trajectory
from moar_companion.settings.vehicle import Guidance

from .paths import ROUNDING_M, grid_walks, trajectory

properties = settings(deadline=None, max_examples=60, derandomize=True, database=None)
STEP_S = 0.02
FADE_MPS = 0.4
GUIDANCE = Guidance()  # 1 m/s^2; slows from 0.5 m behind, stands at 1.5 m


def vector(values):
    return tuple(float(value) for value in values)


def stepped(reference, aircraft_m=None, guidance=GUIDANCE):
    """One step; the aircraft is at its setpoint unless its position is given."""
    place = vector(reference.position_m) if aircraft_m is None else aircraft_m
    return advanced(reference, place, guidance, FADE_MPS, STEP_S)


def begun(path_trajectory, setpoint_m=None):
    start = path_trajectory.position_m[0] if setpoint_m is None else setpoint_m
    return Reference.start(path_trajectory, vector(start))


def test_the_setpoint_accelerates_within_the_limit_and_arrives_at_rest():
    reference = begun(trajectory((0.0, 0.0), (5.0, 0.0), speed=0.7))
    seconds = 0.0
    while not reference.arrived:
        before = reference.speed_mps
        reference = stepped(reference)
        seconds += STEP_S
        assert reference.speed_mps <= before + GUIDANCE.acceleration_mps2 * STEP_S + 1e-12
        assert seconds < 60.0
    # A trapezoid: 5 m at 0.7 m/s, and 0.7 s more for accelerating and braking.
    assert seconds == pytest.approx(5.0 / 0.7 + 0.7, abs=0.2)
    for _ in range(50):
        reference = stepped(reference)
    assert reference.speed_mps == 0.0
    assert vector(reference.position_m) == pytest.approx((5.0, 0.0, 0.0), abs=0.006)


def test_the_setpoint_waits_for_an_aircraft_in_a_gust_and_continues_after_it():
    reference = begun(trajectory((0.0, 0.0), (10.0, 0.0), speed=0.7))
    for _ in range(150):
        reference = stepped(reference)
    held_m = vector(reference.position_m)
    speeds = []
    for _ in range(1000):  # twenty seconds of gust: the aircraft does not move
        reference = stepped(reference, held_m)
        speeds.append(reference.speed_mps)
    ahead_m = math.dist(reference.position_m, held_m)
    assert ahead_m <= GUIDANCE.tracking_hold_m
    assert speeds == sorted(speeds, reverse=True)
    assert speeds[-1] < 0.01
    for _ in range(2000):  # the gust is over
        reference = stepped(reference)
    assert reference.arrived


def test_the_setpoint_stands_while_the_aircraft_is_beyond_the_hold_distance():
    reference = begun(trajectory((0.0, 0.0), (10.0, 0.0), speed=0.7))
    for _ in range(300):
        reference = stepped(reference, (0.0, 5.0, 0.0))
    assert reference.distance_m == 0.0


def test_a_sudden_large_tracking_error_brakes_the_setpoint_without_a_jump():
    reference = begun(trajectory((0.0, 0.0), (20.0, 0.0), speed=3.0))
    for _ in range(250):
        reference = stepped(reference)
    assert reference.speed_mps == pytest.approx(3.0)
    count = 0
    while reference.speed_mps > 0.0:
        before = reference.speed_mps
        reference = stepped(reference, (-9.0, 0.0, 0.0))
        assert before - reference.speed_mps <= 2.0 * GUIDANCE.acceleration_mps2 * STEP_S + 1e-12
        count += 1
    assert count == pytest.approx(75, abs=1)  # 3 m/s at 2 m/s^2


def test_the_stopping_distance_is_where_braking_ends():
    reference = begun(trajectory((0.0, 0.0), (20.0, 0.0), speed=2.0))
    for _ in range(250):
        reference = stepped(reference)
    assert reference.stopping_m(1.0) == pytest.approx(reference.distance_m + 2.0)


def test_a_setpoint_beside_its_trajectory_first_moves_to_the_trajectory():
    reference = begun(trajectory((0.0, 0.0), (5.0, 0.0)), (0.0, 1.0, 0.0))
    assert vector(reference.position_m) == (0.0, 1.0, 0.0)
    seconds = 0.0
    while reference.offset_m.any():
        before = reference
        reference = stepped(reference)
        seconds += STEP_S
        moved_m = math.dist(before.position_m, reference.position_m)
        if reference.offset_m.any():
            assert moved_m <= FADE_MPS * STEP_S + 1e-12
            assert reference.distance_m == 0.0
            assert vector(reference.velocity_mps) == pytest.approx((0.0, -FADE_MPS, 0.0))
    assert seconds == pytest.approx(1.0 / FADE_MPS, abs=2 * STEP_S)
    assert not reference.offset_rate_mps.any()
    for _ in range(600):
        reference = stepped(reference)
    assert reference.arrived


@pytest.mark.slow
@properties
@given(
    walk=grid_walks(1),
    acceleration=st.sampled_from([0.5, 1.0, 2.0]),
    beside=st.sampled_from([(0.0, 0.0, 0.0), (0.2, 0.1, -0.3)]),
    lags=st.lists(st.floats(0.0, 3.0), min_size=1, max_size=8),
)
def test_the_setpoint_keeps_its_speed_limits_for_any_tracking_error(
    walk, acceleration, beside, lags
):
    """The aircraft lags behind its setpoint by the listed distances in turn."""
    guidance = Guidance(acceleration_mps2=acceleration)
    plan = make_trajectory(walk, acceleration_mps2=acceleration, rounding_m=ROUNDING_M)
    reference = begun(plan, plan.position_m[0] + np.array(beside))
    margin_mps = 2.0 * acceleration * STEP_S
    for number in range(400):
        lag_m = lags[number // 25 % len(lags)]
        aircraft_m = vector(reference.position_m + np.array([0.0, lag_m, 0.0]))
        after = advanced(reference, aircraft_m, guidance, FADE_MPS, STEP_S)
        step_m = math.dist(after.position_m, reference.position_m)
        faded = reference.offset_m.any()
        assert step_m <= max(after.speed_mps, FADE_MPS if faded else 0.0) * STEP_S + 1e-9
        assert -margin_mps - 1e-9 <= after.speed_mps - reference.speed_mps
        assert after.speed_mps - reference.speed_mps <= 0.5 * margin_mps + 1e-9
        assert 0.0 <= after.speed_mps <= max(walk.speed_mps) + 1e-9
        # At most the speed limit of the place, plus one step of braking.
        assert after.speed_mps <= plan.at(reference.distance_m)[2] + margin_mps
        assert reference.distance_m <= after.distance_m <= plan.length_m
        reference = after


@properties
@given(walk=grid_walks(1), acceleration=st.sampled_from([0.5, 1.0, 2.0]))
def test_an_aircraft_that_follows_arrives_on_any_path(walk, acceleration):
    guidance = Guidance(acceleration_mps2=acceleration)
    plan = make_trajectory(walk, acceleration_mps2=acceleration, rounding_m=ROUNDING_M)
    reference = begun(plan)
    # Upper bound: each move starts and ends at rest, at the slowest speed.
    steps = int((5.0 + 12.0 * len(walk.speed_mps)) / STEP_S)
    for _ in range(steps):
        if reference.arrived:
            break
        reference = stepped(reference, guidance=guidance)
    assert reference.arrived

"""The shaping of targets: limits are kept, goals are reached, whatever is asked for."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sitl.ardupilot.shaper import Limits, Shaper

DT = 0.01
LIMITS = Limits(speed_mps=10.0, back_mps=10.0, acceleration_mps2=2.5, jerk_mps3=5.0)
METRES = st.floats(-60.0, 60.0)
SPEEDS = st.floats(-15.0, 15.0)


def _run(shaper, seconds, goal, velocity=0j, limits=LIMITS):
    """Move towards a goal with a vehicle that follows at once; returns the path's steps."""
    steps = []
    for _ in range(round(seconds / DT)):
        shaper.step(DT, limits, shaper.position, goal, velocity)
        steps.append((shaper.velocity, shaper.acceleration))
    return steps


@given(METRES, METRES, SPEEDS, SPEEDS)
def test_speed_acceleration_and_jerk_stay_within_their_limits(north_m, east_m, vn, ve):
    shaper = Shaper()
    before = 0j
    for velocity, acceleration in _run(shaper, 6.0, complex(north_m, east_m), complex(vn, ve)):
        assert abs(velocity) <= LIMITS.speed_mps * 1.05
        assert abs(acceleration) <= LIMITS.acceleration_mps2 + 1e-9
        assert abs(acceleration - before) <= LIMITS.jerk_mps3 * DT + 1e-9
        before = acceleration


@given(METRES, METRES)
def test_a_goal_that_stands_still_is_reached(north_m, east_m):
    shaper = Shaper()
    _run(shaper, 30.0, complex(north_m, east_m))
    assert abs(shaper.position - complex(north_m, east_m)) < 0.02
    assert abs(shaper.velocity) < 0.02


def test_a_constant_position_with_a_velocity_settles_one_second_beyond():
    shaper = Shaper()
    _run(shaper, 20.0, 5 + 0j, 0.8 + 0j)
    assert shaper.position.real == pytest.approx(5.8, abs=0.01)


def test_up_and_down_may_differ_in_speed():
    limits = Limits(speed_mps=1.5, back_mps=2.5, acceleration_mps2=1.0, jerk_mps3=5.0)
    up, down = Shaper(), Shaper()
    assert min(v.real for v, _ in _run(up, 8.0, -40 + 0j, limits=limits)) == pytest.approx(
        -2.5, abs=0.05
    )
    assert max(v.real for v, _ in _run(down, 8.0, 40 + 0j, limits=limits)) == pytest.approx(
        1.5, abs=0.05
    )


def test_the_target_does_not_run_away_from_a_vehicle_that_cannot_follow():
    shaper = Shaper()
    for _ in range(3000):
        shaper.step(DT, LIMITS, 0j, 500 + 0j, 0j)
    assert abs(shaper.position) <= LIMITS.leash_m + 1e-9

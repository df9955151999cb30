from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from moar_companion.mavlink.telemetry import (
    Attitude,
    Estimator,
    Landed,
    LandedState,
    LocalPosition,
    Telemetry,
)
from moar_companion.risk.braking import (
    GRAVITY_MPS2,
    WINDOW_S,
    braking,
    extended,
    lean_acceleration_mps2,
)

from .conftest import HEALTHY

headings = st.floats(-math.pi, math.pi)


def telemetry(time_s, lean=(0.0, 0.0), velocity=(0.0, 0.0, 0.0), *, landed=LandedState.IN_AIR):
    """Telemetry of an aircraft heading north, with this lean acceleration and velocity."""
    north, east = (part / GRAVITY_MPS2 for part in lean)
    roll = math.asin(east / math.sqrt(1.0 + north * north + east * east))
    return Telemetry(
        autopilot=HEALTHY["autopilot"](0.0),
        landed=Landed(received_s=time_s, state=landed),
        attitude=Attitude(
            received_s=time_s, roll_rad=roll, pitch_rad=math.atan(-north), yaw_rad=0.0
        ),
        local_position=LocalPosition(
            received_s=time_s, boot_s=time_s, position_ned_m=(0, 0, 0), velocity_ned_mps=velocity
        ),
    )


def flown(states):
    samples = ()
    for state in states:
        samples = extended(samples, state)
    return samples


def every_tenth(lean, velocity, *, count=40, **options):
    """Telemetry ten times a second; lean and velocity are functions of time."""
    return [
        telemetry(0.1 * step, lean(0.1 * step), velocity(0.1 * step), **options)
        for step in range(count)
    ]


def middle_s(samples):
    return 0.5 * (samples[0].attitude_s + samples[-1].attitude_s)


@given(roll=st.floats(-0.5, 0.5), pitch=st.floats(-0.5, 0.5), yaw=headings)
def test_lean_acceleration_is_the_rotated_thrust_that_carries_the_weight(roll, pitch, yaw):
    rotate_x = np.array(
        [
            [1, 0, 0],
            [0, math.cos(roll), -math.sin(roll)],
            [0, math.sin(roll), math.cos(roll)],
        ]
    )
    rotate_y = np.array(
        [
            [math.cos(pitch), 0, math.sin(pitch)],
            [0, 1, 0],
            [-math.sin(pitch), 0, math.cos(pitch)],
        ]
    )
    rotate_z = np.array(
        [[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]]
    )
    thrust = rotate_z @ rotate_y @ rotate_x @ np.array([0.0, 0.0, -1.0])
    thrust *= GRAVITY_MPS2 / -thrust[2]
    assert lean_acceleration_mps2(roll, pitch, yaw) == pytest.approx(tuple(thrust[:2]), abs=1e-9)


@pytest.mark.parametrize(
    ("roll_deg", "pitch_deg", "yaw_deg", "north", "east"),
    [
        pytest.param(0, -10, 0, 1, 0, id="nose down towards north"),
        pytest.param(0, -10, 90, 0, 1, id="nose down towards east"),
        pytest.param(10, 0, 0, 0, 1, id="right side down, nose north: east"),
        pytest.param(10, 0, 180, 0, -1, id="right side down, nose south: west"),
        pytest.param(0, 10, 0, -1, 0, id="nose up: backwards"),
    ],
)
def test_lean_acceleration_has_the_direction_of_the_lean(roll_deg, pitch_deg, yaw_deg, north, east):
    lean = lean_acceleration_mps2(*map(math.radians, (roll_deg, pitch_deg, yaw_deg)))
    expected = GRAVITY_MPS2 * math.tan(math.radians(10))
    assert lean == pytest.approx((north * expected, east * expected), abs=1e-9)


@given(roll=st.floats(-math.pi, math.pi), pitch=st.floats(-math.pi, math.pi), yaw=headings)
def test_lean_stays_bounded_when_the_aircraft_tumbles(roll, pitch, yaw):
    assert math.hypot(*lean_acceleration_mps2(roll, pitch, yaw)) <= 2.0 * GRAVITY_MPS2 + 1e-9


@given(
    drag=st.tuples(st.floats(-4, 4), st.floats(-4, 4)),
    start=st.tuples(st.floats(-10, 10), st.floats(-10, 10)),
    acceleration=st.tuples(st.floats(-2, 2), st.floats(-2, 2)),
)
def test_lean_beyond_the_acceleration_balances_the_drag(drag, start, acceleration):
    lean = tuple(a + d for a, d in zip(acceleration, drag, strict=True))

    def velocity(t):
        return *(v + a * t for v, a in zip(start, acceleration, strict=True)), 0.0

    samples = flown(every_tenth(lambda _: lean, velocity))
    found = braking(samples, 0.3)
    assert found is not None
    assert found.deceleration_ne_mps2 == pytest.approx(drag, abs=1e-6)
    assert found.velocity_ne_mps == pytest.approx(velocity(middle_s(samples))[:2], abs=1e-6)


def test_an_accelerated_climb_scales_the_lean_acceleration():
    # 1 m/s2 upwards, against a drag of 0.3 per second.
    samples = flown(every_tenth(lambda _: (1.0, 0.0), lambda t: (0.0, 0.0, -t)))
    found = braking(samples, 0.3)
    assert found is not None
    lift = 1.0 + (1.0 + 0.3 * middle_s(samples)) / GRAVITY_MPS2
    assert found.deceleration_ne_mps2 == pytest.approx((lift, 0.0), abs=1e-6)


def test_the_window_contains_at_most_its_duration():
    samples = flown(every_tenth(lambda _: (1.0, 0.0), lambda _: (0.0, 0.0, 0.0), count=200))
    assert samples[-1].attitude_s - samples[0].attitude_s <= WINDOW_S
    assert len(samples) == round(WINDOW_S / 0.1) + 1


def test_the_first_seconds_give_no_deceleration():
    still = every_tenth(lambda _: (1.0, 0.0), lambda _: (0.0, 0.0, 0.0))
    assert braking(flown(still[:30]), 0.3) is None
    assert braking(flown(still[:32]), 0.3) is not None


def test_a_window_of_few_samples_gives_no_deceleration():
    still = every_tenth(lambda _: (1.0, 0.0), lambda _: (0.0, 0.0, 0.0))
    assert braking(flown(still)[-9:], 0.3) is None


def test_a_velocity_without_a_position_estimate_is_ignored():
    still = every_tenth(lambda _: (0.0, 0.0), lambda _: (0.0, 0.0, 0.0))
    samples = flown(still)
    lost = Estimator(
        received_s=4.0, flags=0, horizontal_position_ok=False, horizontal_accuracy_m=None
    )
    assert extended(samples, replace(telemetry(4.0), estimator=lost)) is samples


def test_a_velocity_that_is_not_updated_gives_no_deceleration():
    states = every_tenth(lambda _: (1.0, 0.0), lambda _: (0.0, 0.0, 0.0))
    first = states[0].local_position
    stale = [replace(state, local_position=first) for state in states]
    assert braking(flown(stale), 0.3) is None


@pytest.mark.parametrize(
    "state",
    [
        telemetry(6.0, velocity=(0.0, 0.0, 0.0)),
        telemetry(4.0, velocity=(5.0, 0.0, 0.0)),
    ],
    ids=["a gap", "a jump of the velocity"],
)
def test_the_window_restarts_after(state):
    samples = flown(every_tenth(lambda _: (0.0, 0.0), lambda _: (0.0, 0.0, 0.0)))
    assert len(extended(samples, state)) == 1


@pytest.mark.parametrize("landed", [LandedState.ON_GROUND, LandedState.TAKEOFF])
def test_on_the_ground_there_is_no_window(landed):
    samples = flown(every_tenth(lambda _: (0.0, 0.0), lambda _: (0.0, 0.0, 0.0)))
    assert extended(samples, telemetry(4.0, landed=landed)) == ()


@given(
    value=st.sampled_from((math.nan, math.inf, -math.inf)),
    where=st.sampled_from(("roll_rad", "pitch_rad", "yaw_rad", "velocity_ned_mps")),
)
def test_values_that_are_not_finite_are_ignored(value, where):
    samples = flown(every_tenth(lambda _: (0.0, 0.0), lambda _: (0.0, 0.0, 0.0)))
    state = telemetry(4.0)
    if where == "velocity_ned_mps":
        local = replace(state.local_position, velocity_ned_mps=(0.0, value, 0.0))
        state = replace(state, local_position=local)
    else:
        state = replace(state, attitude=replace(state.attitude, **{where: value}))
    assert extended(samples, state) is samples

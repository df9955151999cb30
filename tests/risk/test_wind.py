from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from moar_companion.risk.wind import (
    GRAVITY_MPS2,
    LeanSample,
    lean_acceleration_mps2,
    wind_from_lean,
)
from moar_companion.types import Attitude, Landed, LandedState, Wind
from moar_companion.vehicle import RiskModel

headings = st.floats(-math.pi, math.pi)


def sample(
    time_s: float,
    lean_ne_mps2: tuple[float, float],
    velocity_ne_mps: tuple[float, float] | None,
) -> LeanSample:
    return LeanSample(
        attitude_s=time_s,
        velocity_s=time_s,
        tilt_rad=math.atan(math.hypot(*lean_ne_mps2) / GRAVITY_MPS2),
        lean_ne_mps2=lean_ne_mps2,
        velocity_ne_mps=velocity_ne_mps,
    )


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
def test_directions_of_lean(roll_deg, pitch_deg, yaw_deg, north, east):
    lean = lean_acceleration_mps2(*map(math.radians, (roll_deg, pitch_deg, yaw_deg)))
    expected = GRAVITY_MPS2 * math.tan(math.radians(10))
    assert lean == pytest.approx((north * expected, east * expected), abs=1e-9)


@given(roll=st.floats(-math.pi, math.pi), pitch=st.floats(-math.pi, math.pi), yaw=headings)
def test_lean_stays_bounded_when_the_aircraft_tumbles(roll, pitch, yaw):
    assert math.hypot(*lean_acceleration_mps2(roll, pitch, yaw)) <= 2.0 * GRAVITY_MPS2 + 1e-9


@given(
    wind=st.tuples(st.floats(-20, 20), st.floats(-20, 20)),
    velocity=st.tuples(st.floats(-10, 10), st.floats(-10, 10)),
    acceleration=st.tuples(st.floats(-2, 2), st.floats(-2, 2)),
    drag_per_s=st.floats(0.1, 0.8),
)
def test_an_accelerating_aircraft_with_linear_drag_finds_the_wind(
    wind, velocity, acceleration, drag_per_s
):
    samples = []
    for step in range(26):
        time_s = 0.1 * step
        moving = tuple(v + a * time_s for v, a in zip(velocity, acceleration, strict=True))
        lean = tuple(
            a + drag_per_s * (v - w) for a, v, w in zip(acceleration, moving, wind, strict=True)
        )
        samples.append(sample(time_s, lean, moving))
    assert wind_from_lean(tuple(samples), drag_per_s) == pytest.approx(wind, abs=1e-6)


def test_hovering_against_a_north_wind():
    # 6.5 deg nose down towards north at rest: the air moves south.
    lean = lean_acceleration_mps2(0.0, math.radians(-6.5), 0.0)
    samples = tuple(sample(0.1 * step, lean, (0.0, 0.0)) for step in range(26))
    north, east = wind_from_lean(samples, 0.3)
    assert north == pytest.approx(-3.72, abs=0.01)
    assert east == pytest.approx(0.0, abs=1e-9)


def test_without_a_velocity_there_is_no_wind_from_lean():
    samples = (sample(0.0, (1.0, 0.0), None), sample(2.0, (1.0, 0.0), (0.0, 0.0)))
    assert wind_from_lean(samples, 0.3) is None


def test_calm_air_settles_to_no_risk(flight):
    assert flight.estimate.indices.wind == pytest.approx(0.0, abs=1e-4)


def test_a_wind_that_only_the_lean_shows_raises_the_risk(flight):
    flight.hear("attitude", roll_rad=math.radians(-15.3))
    flight.fly(5.0)
    from_lean = flight.input("wind", "wind from lean")
    assert from_lean.value == pytest.approx(8.94, abs=0.01)  # 9.81 tan(15.3 deg) / 0.3
    assert flight.estimate.report.wind.worst == "wind from lean"
    assert flight.estimate.indices.wind > 0.6


def test_braking_in_still_air_is_not_wind(flight):
    start_s = flight.now_s
    drag_per_s = flight.model.drag_per_s

    def speed(t):  # 4 m/s, from the fifth to the seventh second down to a hover
        return 4.0 - 2.0 * min(2.0, max(0.0, t - start_s - 5.0))

    def nose_up(t):
        braking = 2.0 if 0.0 < t - start_s - 5.0 <= 2.0 else 0.0
        return math.atan((braking - drag_per_s * speed(t)) / GRAVITY_MPS2)

    local, attitude = flight.sources["local_position"], flight.sources["attitude"]
    flight.sources["local_position"] = lambda t: replace(
        local(t), velocity_ned_mps=(speed(t), 0.0, 0.0)
    )
    flight.sources["attitude"] = lambda t: replace(attitude(t), pitch_rad=nose_up(t))
    flight.fly(2.6)
    for _ in range(100):
        flight.fly(0.1)
        assert flight.input("wind", "wind from lean").value < 0.5


def test_lean_on_the_ground_says_nothing(new_flight, healthy):
    healthy["landed"] = lambda t: Landed(received_s=t, state=LandedState.ON_GROUND)
    healthy["attitude"] = lambda t: Attitude(received_s=t, roll_rad=0.5, pitch_rad=0.0, yaw_rad=0.0)
    del healthy["wind"]
    parked = new_flight(**healthy)
    parked.fly(10.0)
    assert parked.estimate.report.wind.value is None
    assert not parked.estimate.report.wind.ever_known
    assert parked.estimate.indices.wind == RiskModel().unknown


def test_after_landing_the_risk_does_not_fall(flight):
    flight.sources["wind"] = lambda t: Wind(received_s=t, velocity_ned_mps=(0.0, -9.0, 0.0))
    before = flight.fly(10.0).indices.wind
    flight.silence("wind")
    flight.sources["landed"] = lambda t: Landed(received_s=t, state=LandedState.ON_GROUND)
    assert flight.fly(60.0).indices.wind >= before


def test_saturated_motors_raise_the_risk(flight):
    flight.hear("motors", pulse_us=(1500, 1960, 1490, 1500))
    assert flight.fly(3.0).indices.wind > 0.95
    assert flight.estimate.report.wind.worst == "motor output"


def test_low_motor_outputs_alone_do_not_mean_calm(new_flight, healthy):
    for name in ("wind", "attitude"):
        del healthy[name]
    blind = new_flight(**healthy)
    assert blind.fly(30.0).indices.wind == RiskModel().unknown


def test_the_vertical_wind_does_not_count(flight):
    flight.sources["wind"] = lambda t: Wind(received_s=t, velocity_ned_mps=(2.0, 0.0, 9.0))
    flight.fly(1.0)
    assert flight.input("wind", "wind reported").value == 2.0


def test_the_average_lean_looks_back_over_the_window_only(flight):
    flight.hear("attitude", roll_rad=0.4)
    flight.fly(10.0)
    flight.hear("attitude", roll_rad=0.0)
    flight.fly(3.0)
    assert flight.input("wind", "tilt").value == pytest.approx(0.0, abs=1e-9)

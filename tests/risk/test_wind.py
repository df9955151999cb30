from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moar_companion.mavlink.telemetry import (
    Attitude,
    Landed,
    LandedState,
    MotorOutputs,
    MotorSpeeds,
    Wind,
)
from moar_companion.risk import InputReport
from moar_companion.risk.braking import GRAVITY_MPS2
from moar_companion.risk.drag import deceleration_mps2
from moar_companion.risk.wind import Spread, WindMemory, remember, strongest
from moar_companion.settings.risk_model import Range, RiskModel

from .test_braking import every_tenth

NAMES = [
    "wind reported",
    "wind from tilt",
    "gusts",
    "tilt in hover",
    "motor output",
    "motor speed",
    "tracking error",
]


def lean_in(wind_mps: float, model: RiskModel | None = None) -> float:
    """The lean of a hover in a wind, radians."""
    drag = deceleration_mps2((wind_mps, 0.0), RiskModel() if model is None else model)[0]
    return math.atan(drag / GRAVITY_MPS2)


def test_the_wind_index_always_lists_all_inputs(flight):
    assert [item.name for item in flight.estimate.report.wind.inputs] == NAMES


def test_calm_air_settles_to_no_risk(flight):
    assert flight.estimate.indices.wind == pytest.approx(0.0, abs=1e-4)


def test_a_wind_seen_in_the_lean_alone_raises_the_risk_within_three_seconds(flight):
    flight.handle("attitude", roll_rad=lean_in(8.0))
    flight.fly(3.0)
    assert flight.input("wind", "wind from tilt").value == pytest.approx(8.0, abs=0.01)
    assert flight.estimate.report.wind.worst == "wind from tilt"
    assert flight.estimate.indices.wind > 0.9 * (8.0 - 3.0) / (12.0 - 3.0)


def test_a_hover_with_the_nose_down_to_the_north_is_a_wind_to_the_south(flight):
    flight.handle("attitude", pitch_rad=-lean_in(5.0))
    flight.fly(3.0)
    assert flight.estimate.wind.wind_ne_mps == pytest.approx((-5.0, 0.0), abs=0.01)


def test_braking_in_still_air_is_not_wind(flight):
    start_s = flight.now_s

    def speed(t):  # 4 m/s; from the fifth to the seventh second it slows down to a hover
        return 4.0 - 2.0 * min(2.0, max(0.0, t - start_s - 5.0))

    def nose_up(t):
        braking = 2.0 if 0.0 < t - start_s - 5.0 <= 2.0 else 0.0
        drag = deceleration_mps2((speed(t), 0.0), flight.model)[0]
        return math.atan((braking - drag) / GRAVITY_MPS2)

    local, attitude = flight.sources["local_position"], flight.sources["attitude"]
    flight.sources["local_position"] = lambda t: replace(
        local(t), velocity_ned_mps=(speed(t), 0.0, 0.0)
    )
    flight.sources["attitude"] = lambda t: replace(attitude(t), pitch_rad=nose_up(t))
    flight.fly(4.0)
    for _ in range(100):
        flight.fly(0.1)
        assert flight.input("wind", "wind from tilt").value < 0.7
        assert flight.estimate.indices.wind < 1e-3


def test_lean_on_the_ground_is_ignored(new_flight, healthy):
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


def test_the_vertical_wind_does_not_count(flight):
    flight.sources["wind"] = lambda t: Wind(received_s=t, velocity_ned_mps=(2.0, 0.0, 9.0))
    flight.fly(1.0)
    assert flight.input("wind", "wind reported").value == 2.0


def test_a_reported_calm_with_a_large_deviation_is_ignored(new_flight, healthy):
    del healthy["attitude"]
    flight = new_flight(**healthy)
    flight.handle("wind", velocity_ned_mps=(0.1, 0.0, 0.0), deviation_mps=4.0)
    assert flight.fly(30.0).indices.wind == RiskModel().unknown
    flight.handle("wind", velocity_ned_mps=(0.1, 0.0, 0.0), deviation_mps=0.3)
    assert flight.fly(30.0).indices.wind < 0.01


def test_the_wind_inputs_are_of_the_last_seconds_alone(flight):
    flight.handle("attitude", roll_rad=0.4)
    flight.fly(10.0)
    flight.handle("attitude", roll_rad=0.0)
    flight.fly(2.0)
    assert flight.input("wind", "tilt in hover").value == pytest.approx(0.0, abs=1e-9)
    assert flight.input("wind", "wind from tilt").value == pytest.approx(0.0, abs=1e-9)


def test_the_input_tilt_in_hover_is_the_lean_of_a_hover(new_flight, healthy):
    for drag_per_s in (0.1, 0.5):  # for any drag: a lean needs no model
        flight = new_flight(model=RiskModel(drag_per_s=drag_per_s), **healthy)
        flight.handle("attitude", roll_rad=0.35)
        flight.fly(5.0)
        assert flight.input("wind", "tilt in hover").value == pytest.approx(0.35, abs=1e-6)


def test_an_impossible_velocity_is_bounded_and_expires(flight):
    flight.handle("local_position", velocity_ned_mps=(1e200, -1e200, 0.0))
    flight.fly(10.0)
    assert flight.input("wind", "wind from tilt").value <= 100.0 + 1e-9
    flight.handle("local_position")
    flight.fly(90.0)
    assert flight.input("wind", "gusts").value < 5.0
    assert flight.input("wind", "wind from tilt").value == pytest.approx(0.0, abs=1e-6)


def test_a_velocity_whose_sum_is_no_number_gives_no_wind():
    known, unknown = WindMemory(), WindMemory()
    for state in every_tenth(lambda _: (1.0, 0.0), lambda _: (2.0, 0.0, 0.0)):
        known = remember(known, state, RiskModel())
    for state in every_tenth(lambda _: (1.0, 0.0), lambda _: (1e308, 0.0, 0.0)):
        unknown = remember(unknown, state, RiskModel())
    assert known.wind_ne_mps is not None
    assert unknown.wind_ne_mps is None


# Sources


def report(name: str, value: float | None, risk: float | None) -> InputReport:
    return InputReport(name=name, value=value, unit="m/s", age_s=0.1, risk=risk)


@pytest.mark.parametrize(
    ("reported", "from_tilt", "source"),
    [
        ((4.0, 0.1), (6.0, 0.3), "wind from tilt"),
        ((7.0, 0.4), (6.0, 0.3), "wind reported"),
        ((7.0, None), (6.0, 0.3), "wind from tilt"),
        ((7.0, None), (6.0, None), None),
    ],
)
def test_the_used_wind_is_the_stronger_known_one_with_its_source(reported, from_tilt, source):
    found = strongest(
        (
            report("wind reported", *reported),
            report("wind from tilt", *from_tilt),
            report("gusts", 9.0, 1.0),
        )
    )
    assert (None if found is None else found.name) == source


# Gusts


def test_gusts_raise_the_risk_and_their_end_lowers_it(flight):
    flight.sources["attitude"] = lambda t: Attitude(
        received_s=t,
        roll_rad=lean_in(5.0 + 5.0 * math.sin(0.5 * t)),
        pitch_rad=0.0,
        yaw_rad=0.0,
    )
    flight.fly(60.0)
    gusts = flight.input("wind", "gusts")
    assert gusts.value == pytest.approx(5.0 / math.sqrt(2.0), abs=0.6)
    assert gusts.risk > 0.3
    flight.handle("attitude", roll_rad=lean_in(5.0))
    flight.fly(60.0)
    assert flight.input("wind", "gusts").value < 0.6


@given(
    winds=st.lists(
        st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0)), min_size=2, max_size=100
    )
)
def test_the_spread_of_the_first_seconds_is_the_standard_deviation(winds):
    spread = Spread(time_s=0.0, mean_ne_mps=winds[0])
    for number, wind in enumerate(winds[1:], start=1):
        spread = spread.then(0.1 * number, wind)
    array = np.array(winds[1:])
    assert spread.mean_ne_mps == pytest.approx(tuple(array.mean(axis=0)), abs=1e-6)
    expected = math.sqrt(array.var(axis=0).sum())
    assert spread.deviation_mps == pytest.approx(expected, abs=1e-6)


def test_a_learnt_drag_converts_the_mean_wind_of_the_same_lean():
    before, after = RiskModel(drag_per_s=0.2), RiskModel(drag_per_s=1.0)
    spread = Spread(time_s=0.0, mean_ne_mps=(3.0, -6.0), variance_m2ps2=0.5)
    converted = spread.with_model(before, after)
    leans = [
        deceleration_mps2(spread.mean_ne_mps, before),
        deceleration_mps2(converted.mean_ne_mps, after),
    ]
    assert leans[1] == pytest.approx(leans[0])
    assert math.hypot(*converted.mean_ne_mps) < 0.5 * math.hypot(*spread.mean_ne_mps)


def test_the_spread_decays_within_half_a_minute():
    spread = Spread(time_s=0.0, mean_ne_mps=(0.0, 0.0))
    for step in range(1, 601):
        spread = spread.then(0.1 * step, (8.0 if step % 2 else 0.0, 0.0))
    assert spread.deviation_mps == pytest.approx(4.0, abs=0.1)
    for step in range(601, 901):
        spread = spread.then(0.1 * step, (4.0, 0.0))
    assert spread.deviation_mps**2 == pytest.approx(16.0 * math.exp(-2.0), rel=0.1)


# Motors


def test_saturated_motors_raise_the_risk(flight):
    flight.handle("motors", pulse_us=(1500, 1960, 1490, 1500))
    assert flight.fly(3.0).indices.wind > 0.95
    assert flight.estimate.report.wind.worst == "motor output"


@pytest.mark.parametrize("period_s", [0.1, 0.2])
def test_one_sample_of_saturated_motors_moves_the_index_little(new_flight, healthy, period_s):
    flight = new_flight(**healthy)
    rest = flight.fly(10.0).indices.wind

    def pulses(outputs_us):
        for output_us in outputs_us:
            flight.handle("motors", pulse_us=(1600, output_us, 1600, 1600))
            received = flight.sources["motors"](flight.now_s + 0.1)
            flight.sources["motors"] = lambda _, received=received: received
            flight.fly(period_s)
            yield flight.estimate.indices.wind

    assert max(pulses([2000, 1600, 1600, 1600, 1600])) < rest + 0.1
    assert max(pulses([2000] * round(2.0 / period_s))) > 0.85


def test_a_saturation_counts_within_a_second_even_where_samples_are_lost(flight):
    flight.handle("motors", pulse_us=(1600, 1600, 1600, 1600))
    flight.fly(10.0)
    flight.handle("motors", pulse_us=(1600, 2000, 1600, 1600))
    flight.fly(0.1)
    flight.silence("motors")
    flight.fly(0.9)
    assert flight.input("wind", "motor output").risk == 1.0
    flight.fly(10.0)
    assert flight.input("wind", "motor output").risk is None
    assert flight.estimate.indices.wind > 0.99


def test_low_motor_outputs_alone_do_not_mean_calm(new_flight, healthy):
    for name in ("wind", "attitude"):
        del healthy[name]
    blind = new_flight(**healthy)
    assert blind.fly(30.0).indices.wind == RiskModel().unknown


@pytest.mark.parametrize(
    ("model", "reported", "share"),
    [
        pytest.param(RiskModel(), (None, None), 0.8, id="as usual"),
        pytest.param(RiskModel(), (1100.0, 1900.0), 0.875, id="reported by parameters"),
        pytest.param(RiskModel(), (1100.0, None), 0.8, id="half reported"),
        pytest.param(RiskModel(), (1900.0, 1100.0), 0.8, id="reported the wrong way round"),
        pytest.param(
            RiskModel(motor_pulse_us=Range(low=0.0, high=2000.0)),
            (1100.0, 1900.0),
            0.9,
            id="configured",
        ),
    ],
)
def test_the_range_of_motor_outputs_is_configured_or_reported_or_the_usual_one(
    new_flight, healthy, model, reported, share
):
    flight = new_flight(model=model, **healthy)
    flight.telemetry = replace(flight.telemetry, motor_min_us=reported[0], motor_max_us=reported[1])
    flight.handle("motors", pulse_us=(1500, 1800))
    flight.fly(1.0)
    assert flight.input("wind", "motor output").value == pytest.approx(share)


@pytest.mark.parametrize(
    ("configured", "share"), [(None, None), (Range(low=1.0, high=1999.0), 0.875)]
)
def test_dshot_outputs_count_where_their_range_is_configured(
    new_flight, healthy, configured, share
):
    # A heavy aircraft: in flight the outputs look like pulses, lower only at the start.
    healthy["motors"] = lambda t: MotorOutputs(
        received_s=t, pulse_us=(1750, 1400, 1400, 1300), least_us=110
    )
    flight = new_flight(model=RiskModel(motor_pulse_us=configured), **healthy)
    flight.telemetry = replace(flight.telemetry, motor_min_us=1000.0, motor_max_us=2000.0)
    flight.fly(1.0)
    output = flight.input("wind", "motor output")
    assert output.value == (None if share is None else pytest.approx(share, abs=0.001))


def test_outputs_in_another_unit_than_the_range_are_ignored(flight):
    flight.handle("motors", pulse_us=(4000, 8191))
    assert flight.fly(10.0).indices.wind < 0.01
    assert flight.input("wind", "motor output").risk is None


def test_motor_speeds_count_where_their_range_is_configured(new_flight, healthy):
    healthy["motor_speeds"] = lambda t: MotorSpeeds(received_s=t, rpm=(7000, 7100, 7900, 7000))
    for rpm, known in ((None, False), (Range(low=0.0, high=8000.0), True)):
        flight = new_flight(model=RiskModel(motor_rpm=rpm), **healthy)
        flight.fly(10.0)
        assert (flight.input("wind", "motor speed").risk is not None) is known
        assert (flight.estimate.indices.wind > 0.9) is known


def test_motor_speeds_of_zero_in_the_air_are_ignored(new_flight, healthy):
    healthy["motor_speeds"] = lambda t: MotorSpeeds(received_s=t, rpm=(9000, 9000, 9000, 9000))
    flight = new_flight(model=RiskModel(motor_rpm=Range(low=1000.0, high=9000.0)), **healthy)
    assert flight.fly(10.0).indices.wind > 0.9
    flight.sources["motor_speeds"] = lambda t: MotorSpeeds(received_s=t, rpm=(0, 0, 0, 0))
    assert flight.fly(60.0).indices.wind > 0.9
    assert flight.input("wind", "motor speed").risk is None


# Tracking


def test_a_large_tracking_error_raises_the_wind_risk(flight):
    flight.tracking_error_m = 1.9
    assert flight.fly(3.0).indices.wind > 0.85
    assert flight.estimate.report.wind.worst == "tracking error"


def test_without_companion_control_the_tracking_error_is_neither_used_nor_held(flight):
    flight.tracking_error_m = 3.0
    flight.fly(3.0)
    flight.tracking_error_m = None
    assert flight.fly(60.0).indices.wind < 0.01


def test_an_unknown_tracking_error_is_held(flight):
    flight.tracking_error_m = 3.0
    before = flight.fly(3.0).indices.wind
    flight.tracking_error_m = math.inf
    assert flight.fly(60.0).indices.wind >= before


def test_good_tracking_alone_does_not_mean_calm(new_flight, healthy):
    for name in ("wind", "attitude", "motors"):
        del healthy[name]
    blind = new_flight(**healthy)
    blind.tracking_error_m = 0.1
    assert blind.fly(30.0).indices.wind == RiskModel().unknown


# Properties


@pytest.mark.uncounted
@settings(max_examples=30)
@given(
    lean_rad=st.floats(0.0, 0.9),
    more_rad=st.floats(0.0, 0.3),
    drag=st.tuples(st.floats(0.05, 1.0), st.floats(0.0, 0.1)),
)
def test_more_lean_in_hover_is_never_less_wind_and_never_less_risk(
    new_flight, lean_rad, more_rad, drag
):
    model = RiskModel(drag_per_s=drag[0], drag_per_m=drag[1])
    values = []
    for roll_rad in (lean_rad, lean_rad + more_rad):
        flight = new_flight.healthy(model=model)
        flight.handle("attitude", roll_rad=roll_rad)
        flight.fly(4.0)
        values.append(
            (
                flight.input("wind", "wind from tilt").value,
                flight.input("wind", "tilt in hover").value,
                flight.estimate.indices.wind,
            )
        )
    assert all(low <= high + 1e-9 for low, high in zip(*values, strict=True))


@pytest.mark.uncounted
@settings(max_examples=20)
@given(
    noise=st.lists(st.tuples(st.floats(-1.0, 1.0), st.floats(-1.0, 1.0)), min_size=40, max_size=40),
    size=st.sampled_from((1e-3, 1e-2)),
)
def test_a_small_noise_moves_the_wind_and_the_index_a_little(new_flight, noise, size):
    flight = new_flight.healthy()
    flight.handle("attitude", roll_rad=lean_in(7.0))
    flight.fly(10.0)
    wind, index = flight.input("wind", "wind from tilt").value, flight.estimate.indices.wind
    local, attitude = flight.sources["local_position"], flight.sources["attitude"]
    for angle, velocity in noise:
        flight.sources["attitude"] = lambda t, angle=angle: replace(
            attitude(t), roll_rad=lean_in(7.0) + size * angle
        )
        flight.sources["local_position"] = lambda t, velocity=velocity: replace(
            local(t), velocity_ned_mps=(0.0, size * velocity, 0.0)
        )
        flight.fly(0.1)
        # Gain of the lean: g / drag = 40; of the velocity: 2 / (window x drag) + 1 = 6.6.
        assert abs(flight.input("wind", "wind from tilt").value - wind) < 60.0 * size
        assert abs(flight.estimate.indices.wind - index) < 60.0 * size / 9.0 + 0.01


def test_the_motors_of_a_climb_are_no_wind_and_those_after_it_are(new_flight, healthy):
    flight = new_flight(**healthy)
    rest = flight.fly(10.0).indices.wind
    level = flight.sources["local_position"]
    flight.sources["local_position"] = lambda t: replace(
        level(t), velocity_ned_mps=(0.0, 0.0, -2.0)
    )
    flight.handle("motors", pulse_us=(1960, 1960, 1960, 1960))
    assert flight.fly(10.0).indices.wind < rest + 0.05
    assert not flight.input("wind", "motor output").applies
    flight.sources["local_position"] = level
    assert flight.fly(3.0).indices.wind > 0.9

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from moar_companion.mavlink.telemetry import LandedState
from moar_companion.risk.braking import Braking
from moar_companion.risk.drag import air_velocity_mps, deceleration_mps2
from moar_companion.risk.drag_fit import DragFit, DragFlight, fit_drag
from moar_companion.settings.risk_model import RiskModel

from .test_braking import every_tenth

models = st.builds(RiskModel, drag_per_s=st.floats(0.05, 2.0), drag_per_m=st.floats(0.0, 0.2))
level = st.tuples(st.floats(-40.0, 40.0), st.floats(-40.0, 40.0))


def test_the_drag_agrees_with_a_calculation_by_hand():
    model = RiskModel(drag_per_s=0.2, drag_per_m=0.01)  # (0.2 + 0.01 * 5) * (3, -4)
    assert deceleration_mps2((3.0, -4.0), model) == pytest.approx((0.75, -1.0))
    assert air_velocity_mps((0.75, -1.0), model) == pytest.approx((3.0, -4.0))


@given(model=models, air=level)
def test_the_airspeed_is_the_inverse_of_the_deceleration(model, air):
    assert air_velocity_mps(deceleration_mps2(air, model), model) == pytest.approx(air, abs=1e-6)


@given(model=models, pair=st.tuples(st.floats(0.0, 30.0), st.floats(0.0, 30.0)))
def test_a_greater_deceleration_gives_a_greater_airspeed(model, pair):
    low, high = (air_velocity_mps((0.0, value), model)[1] for value in sorted(pair))
    assert low <= high


def windows(legs, *, k, q, wind=(0.0, 0.0), noise=0.0):
    """Windows of an aircraft that flies these velocities in turn, ten windows of each."""
    model = RiskModel(drag_per_s=k, drag_per_m=q)
    made = []
    for velocity in legs:
        for number in range(10):
            air = (velocity[0] - wind[0], velocity[1] - wind[1])
            north, east = deceleration_mps2(air, model)
            error = noise * (-1) ** number
            made.append(
                Braking(
                    time_s=1.5 * len(made),
                    velocity_ne_mps=velocity,
                    deceleration_ne_mps2=(north + error, east - error),
                )
            )
    return made


THERE_AND_BACK = ((0.0, 0.0), (5.0, 0.0), (-5.0, 0.0), (0.0, 9.0), (0.0, -9.0))


@pytest.mark.parametrize(("k", "q"), [(0.3, 0.0), (0.265, 0.03), (0.2, 0.009)])
@pytest.mark.parametrize("noise", [0.0, 0.1])
def test_a_drag_and_a_steady_wind_are_found(k, q, noise):
    fit = fit_drag(windows(THERE_AND_BACK, k=k, q=q, wind=(1.0, -0.5), noise=noise))
    assert isinstance(fit, DragFit)
    assert fit.wind_ne_mps == pytest.approx((1.0, -0.5), abs=0.1)
    for speed in (5.0, 9.0):
        assert fit.drag_per_s + fit.drag_per_m * speed == pytest.approx(k + q * speed, rel=0.05)
    assert fit.residual_mps2 == pytest.approx(math.sqrt(2.0) * noise, abs=0.02)


def test_a_hover_and_one_leg_give_the_drag_at_the_speed_of_the_leg():
    fit = fit_drag(windows(((0.0, 0.0), (6.0, 0.0)), k=0.35, q=0.0))
    assert isinstance(fit, DragFit)
    assert fit.drag_per_s + fit.drag_per_m * 6.0 == pytest.approx(0.35, rel=0.05)


@pytest.mark.parametrize(
    ("made", "lack"),
    [
        pytest.param([], "0 s in the air", id="nothing"),
        pytest.param(
            windows(((0.0, 0.0), (6.0, 0.0)), k=0.3, q=0.0)[5:13], "12 s in the air", id="short"
        ),
        pytest.param(windows(((0.0, 0.0), (2.0, 0.0)), k=0.3, q=0.0), "within 2.0 m/s", id="slow"),
        pytest.param(
            windows(THERE_AND_BACK, k=0.3, q=0.0, wind=(6.0, 0.0)), "wind of 6.0 m/s", id="wind"
        ),
        pytest.param(
            windows(THERE_AND_BACK, k=0.3, q=0.0)
            + windows(THERE_AND_BACK, k=0.3, q=0.0, wind=(0.0, 9.0)),
            "unexplained",
            id="a wind that rises",
        ),
    ],
)
def test_the_lack_in_a_flight_is_named(made, lack):
    answer = fit_drag(made)
    assert isinstance(answer, str)
    assert lack in answer


def swung(**options):
    """Telemetry of 40 s to and fro at up to 6 m/s in calm air, with a drag of 0.3 per second."""
    turn = math.tau / 20.0

    def speed_mps(time_s):
        return 6.0 * math.sin(turn * time_s)

    return every_tenth(
        lambda t: (0.3 * speed_mps(t) + 6.0 * turn * math.cos(turn * t), 0.0),
        lambda t: (speed_mps(t), 0.0, 0.0),
        count=400,
        **options,
    )


def flight(states):
    flight = DragFlight()
    for state in states:
        flight.take(state)
    return flight


def test_the_drag_of_a_flight_follows_from_its_telemetry():
    fit = flight(swung()).fit()
    assert isinstance(fit, DragFit)
    assert fit.drag_per_s + fit.drag_per_m * 6.0 == pytest.approx(0.3, rel=0.1)
    assert fit.wind_ne_mps == pytest.approx((0.0, 0.0), abs=0.2)
    assert 30.0 < fit.seconds <= 40.0


def test_telemetry_that_repeats_adds_no_time_to_the_flight():
    states = swung()
    once, twice = flight(states).fit(), flight([item for item in states for _ in range(2)]).fit()
    assert once == twice


def test_motion_on_the_ground_measures_no_drag():
    answer = flight(swung(landed=LandedState.ON_GROUND)).fit()
    assert answer == "0 s in the air with attitude and velocity: too short to measure drag"

"""Wind from tilt in lockstep: own manoeuvres are no wind, and true wind is followed."""

from __future__ import annotations

import itertools

import pytest

from tests.thorough import sampled

from ..flights.airs import in_the_air
from ..flights.operator import Manner
from .marks import ARDUPILOT_FIRST

PX4, ARDUPILOT = Manner.PX4, Manner.ARDUPILOT


def short_manoeuvre(flight):
    flight.fly_to((15.0, 0.0), 5.0)
    flight.fly_to((15.0, 8.0), 2.0)
    flight.steer((0.0, 8.0))  # a jump of 15 m, flown as fast as the autopilot likes
    flight.run(6.0)


@pytest.mark.slow
@ARDUPILOT_FIRST
def test_in_calm_air_no_manoeuvre_is_reported_as_wind(manner):
    flight = in_the_air(manner)
    flight.run(8.0)
    rest = flight.reported[-1].risk
    flight.reported.clear()
    short_manoeuvre(flight)
    assert max(item.tilt_mps for item in flight.reported) < 1.2
    assert max(item.risk for item in flight.reported) < rest + 0.1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("manner", "drag"),
    sampled([(ARDUPILOT, 0.7)], list(itertools.product(Manner, (0.7, 1.3)))),
)
def test_in_calm_air_no_manoeuvre_is_reported_as_wind_with_a_drag_that_is_30_percent_off(
    manner, drag
):
    flight = in_the_air(manner, drag=drag)
    flight.run(15.0)
    rest = flight.reported[-1].risk
    flight.reported.clear()
    flight.manoeuvre()
    assert max(item.risk for item in flight.reported) < rest + 0.1


@pytest.mark.slow
@ARDUPILOT_FIRST
def test_a_wind_that_rises_and_falls_is_followed_within_three_seconds(manner):
    flight = in_the_air(manner)
    for wind_mps in (8.0, 0.0):
        flight.wind(wind_mps)
        flight.run(3.0)
        assert flight.reported[-1].tilt_mps == pytest.approx(wind_mps, abs=1.0)
        if wind_mps > 0.0:
            assert flight.reported[-1].risk > 0.9 * (8.0 - 3.0) / (12.0 - 3.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("manner", "drag"),
    sampled(
        [(ARDUPILOT, 0.7), (PX4, 1.0)],
        list(itertools.product(Manner, (0.7, 1.0, 1.3))),
    ),
)
def test_the_reported_wind_has_the_relative_error_of_the_drag(manner, drag):
    error = {0.7: 0.34, 1.0: 0.06, 1.3: 0.35}[drag]
    flight = in_the_air(manner, drag=drag)
    for wind_mps in (4.0, 8.0):
        flight.wind(wind_mps)
        flight.run(4.0)
        flight.reported.clear()
        flight.fly_to((8.0 if wind_mps < 5.0 else 0.0, 0.0), 2.0)
        reported = [item.tilt_mps for item in flight.reported]
        assert sum(reported) / len(reported) == pytest.approx(wind_mps, rel=error)

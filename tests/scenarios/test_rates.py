"""The smallest and the largest permitted rate of setpoints."""

from __future__ import annotations

import pytest

from moar_companion.companion import cycle_stages
from moar_companion.service import app
from moar_companion.settings.config import FASTEST_HZ, SLOWEST_HZ
from tests.thorough import sampled

from ..flights import aircraft
from ..flights.judging import clearances_m, true_places
from ..flights.lockstep import Lockstep
from ..flights.operator import INSPECTION, Manner

FLOWN = [(Manner.PX4, SLOWEST_HZ), (Manner.ARDUPILOT, FASTEST_HZ)]
MORE = [(Manner.ARDUPILOT, SLOWEST_HZ), (Manner.PX4, FASTEST_HZ)]


@pytest.mark.slow
@pytest.mark.parametrize(("manner", "rate_hz"), sampled(FLOWN, FLOWN + MORE))
def test_an_inspection_is_flown_at_the_smallest_and_at_the_largest_rate(
    manner, rate_hz, monkeypatch
):
    flight = Lockstep(manner=manner, vehicle="x500", setpoint_rate_hz=rate_hz)
    flight.start_in_the_air()
    monkeypatch.setattr(aircraft, "STEP_S", 1.0 / rate_hz)
    flight.begin(INSPECTION, 1)
    flight.run_until_state("at_target", 90.0)
    assert not flight.operator.has_received("stalled")
    assert min(clearances_m(flight.site, true_places(flight))) > flight.vehicle.radius_m
    spans_s = [
        after.time_s - before.time_s
        for before, after in zip(flight.setpoints, flight.setpoints[1:], strict=False)
    ]
    assert max(spans_s) < 1.01 / rate_hz


def test_a_cycle_may_be_a_period_late_at_the_smallest_rate():
    period_s = 1.0 / SLOWEST_HZ
    assert 2.0 * period_s <= cycle_stages._LONGEST_STEP_S
    assert 2.0 * period_s <= app._MAX_CYCLE_S

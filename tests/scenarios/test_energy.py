"""Energy in flight: accuracy of the forecast, and the exit on a draining battery."""

from __future__ import annotations

from dataclasses import replace

import pytest

from moar_companion.settings.config import Supervision, shipped_configs
from moar_companion.settings.vehicle import Power, Vehicle
from moar_companion.types import Mission
from tests.benchmarks.energy import cases, fly
from tests.thorough import sampled

from ..flights.judging import assert_nothing_was_touched
from ..flights.lockstep import Lockstep
from ..flights.operator import INSPECTION

CASES = cases(176)
EXITS = [case for case in CASES[:40] if case.mission is Mission.EXIT and case.vehicle == "x500"]
AGAINST_THE_WIND = [CASES[165], CASES[175]]
"""Landing legs against 8 and 7 m/s of wind, always at the limit of the lean."""
CAPACITY_WH = 90.0
"""Capacity of the fake PX4's pack."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "case", sampled([EXITS[1], AGAINST_THE_WIND[0]], [*EXITS, *AGAINST_THE_WIND])
)
def test_after_a_minute_the_energy_of_the_planned_flight_is_estimated(case):
    flown = fly(case)
    assert flown.error == pytest.approx(0.0, abs=0.1)
    assert flown.source in {"current", "charge"}


@pytest.mark.slow
def test_an_escape_route_begins_while_a_draining_battery_still_suffices():
    x500 = Vehicle.load(shipped_configs() / "vehicles" / "x500.yaml")
    # The battery drains four times as fast as in the file: 45 % last less than two minutes, of
    # which one is the reserve.
    vehicle = replace(x500, power=Power(hover_w=332.0, capacity_wh=CAPACITY_WH))
    flight = Lockstep(vehicle=vehicle, supervision=Supervision(battery_reserve=0.0))
    flight.autopilot.conditions.drain_factor = 4.0
    flight.begin(INSPECTION)
    flight.autopilot.conditions.battery_percent = 45.0
    flight.run_until(lambda: flight.companion.status.task.mission is not Mission.INSPECTION, 120.0)
    assert flight.operator.has_received("leaves ")
    flight.run_until_state("landing_leg", 60.0)
    flight.run_until_state("holding", 60.0)
    flight.land()
    assert_nothing_was_touched(flight)
    after = next(truth.battery_fraction for truth in reversed(flight.truths) if truth.armed)
    left_s = after * CAPACITY_WH * 3600.0 / (4.0 * 332.0)
    assert left_s == pytest.approx(vehicle.power.reserve_s, abs=20.0)

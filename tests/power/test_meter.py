"""The meter: power by measurement, and the remaining energy."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from moar_companion.mavlink.telemetry import Battery, LandedState
from moar_companion.risk.power import Meter, cell_v
from moar_companion.settings.vehicle import Power

from .aircraft import Aircraft, model_of


@pytest.mark.parametrize("takes", [0.7, 0.85, 1.0, 1.15, 1.4])
@pytest.mark.parametrize("tells", [("remaining",), ("remaining", "current_a"), ("current_a",)])
def test_a_minute_of_flight_measures_the_power_of_the_aircraft(takes, tells):
    aircraft = Aircraft(model_of(), takes=takes, tells=tells).fly(5.0)
    assert aircraft.meter.factor == pytest.approx(1.0, abs=0.15)  # mostly the vehicle file
    for velocity in ((5.0, 0.0, 0.0), (0.0, 0.0, -3.0), (0.0, 0.0, 0.0)):
        aircraft.velocity_ned_mps = velocity
        aircraft.fly(20.0)
    assert aircraft.meter.factor == pytest.approx(takes, rel=0.05)
    assert aircraft.meter.source == ("current" if "current_a" in tells else "charge")


def test_without_a_capacity_the_power_is_measured_by_the_charge():
    model = model_of(Power(hover_w=300.0), endurance_s=900.0)
    aircraft = Aircraft(model, takes=1.5).fly(90.0)
    assert aircraft.meter.source == "charge"
    assert aircraft.meter.factor == pytest.approx(1.5, rel=0.05)
    # 900 s of flight at the file's power are 600 s.
    assert aircraft.meter.flight_s(model) == pytest.approx(600.0 * 0.8, rel=0.05)


def test_the_measured_power_follows_the_wind():
    aircraft = Aircraft(model_of(), takes=1.0).fly(300.0)
    aircraft.takes = 1.3
    aircraft.fly(240.0)
    assert aircraft.meter.factor > 1.2


def test_no_power_is_measured_on_the_ground():
    aircraft = Aircraft(model_of())
    aircraft.landed = LandedState.ON_GROUND
    aircraft.fly(60.0)
    assert (aircraft.meter.factor, aircraft.meter.source) == (1.0, "vehicle file")
    assert aircraft.meter.left_wh == pytest.approx(95.0)


def test_a_failed_current_sensor_is_ignored():
    aircraft = Aircraft(model_of(), takes=1.2)
    aircraft.sensor = 0.0
    aircraft.fly(90.0)
    assert aircraft.meter.source == "charge"
    assert aircraft.meter.factor == pytest.approx(1.2, rel=0.05)


@pytest.mark.parametrize(("sensor", "factor"), [(6.0, 7.2), (1000.0, 20.0)])
def test_a_current_far_too_great_counts_up_to_a_limit(sensor, factor):
    aircraft = Aircraft(model_of(), takes=1.2)
    aircraft.sensor = sensor
    aircraft.fly(30.0)
    assert aircraft.meter.source == "current"
    assert aircraft.meter.factor == pytest.approx(factor, rel=0.05)


def test_one_wrong_current_does_not_empty_the_battery():
    aircraft = Aircraft(model_of()).fly(120.0)
    aircraft.sensor = 1000.0
    assert aircraft.fly(1.0).meter.factor < 1.5
    aircraft.sensor = 1.0
    assert aircraft.fly(60.0).meter.factor < 1.25


@pytest.mark.parametrize(
    ("tells", "sensor"),
    [
        pytest.param(("remaining",), 1.0, id="no current"),
        pytest.param(("remaining", "current_a"), 1.0, id="charge and current"),
        pytest.param(
            ("remaining", "current_a"), 1.0 / 6.7, id="a cell fails, the current is usual"
        ),
        pytest.param(("current_a",), 1.0, id="no charge"),
    ],
)
@pytest.mark.parametrize("sudden", [False, True])
def test_a_drain_of_seven_times_the_files_is_not_ignored(tells, sensor, sudden):
    aircraft = Aircraft(model_of(), tells=tells)
    if tells == ("current_a",):
        aircraft.landed, aircraft.voltage_v = LandedState.ON_GROUND, 4 * 4.05
        aircraft.fly(2.0)
        aircraft.charges, aircraft.landed = [1.0], LandedState.IN_AIR
    if sudden:
        aircraft.fly(60.0)
    aircraft.takes, aircraft.sensor = 6.7, sensor
    left_s = math.inf
    while left_s > 15.0:
        aircraft.fly(1.0)
        left_s = max(aircraft.charges) * 1200.0 / 6.7
    promised_s = aircraft.meter.flight_s(aircraft.model)
    # One percent of the charge is 1.8 s.
    assert promised_s <= left_s + (3.0 if not sudden else 10.0)


@pytest.mark.parametrize("takes", [2.0, 3.0, 4.0])
def test_a_drain_that_begins_late_shows_within_half_a_minute(takes):
    aircraft = Aircraft(model_of(), tells=("remaining",), charges=(1.0,)).fly(300.0)
    aircraft.takes = takes
    aircraft.fly(45.0)
    left_s = aircraft.charges[0] * 1200.0 / takes
    assert aircraft.meter.flight_s(aircraft.model) < 1.3 * left_s


def test_the_power_is_measured_by_the_battery_that_drains_fastest():
    aircraft = Aircraft(model_of(), tells=("remaining",), charges=(0.9, 0.9))
    for _ in range(20):
        aircraft.charges[1] -= 3.0 * 300.0 / 3600.0 / 100.0
        aircraft.fly(1.0)
    left_s = aircraft.charges[1] * 1200.0 / 4.0
    assert aircraft.meter.flight_s(aircraft.model) == pytest.approx(left_s, rel=0.2)


def test_a_corrected_charge_does_not_count_as_flown():
    aircraft = Aircraft(model_of(), tells=("remaining",)).fly(60.0)
    aircraft.charges = [0.4]
    aircraft.fly(3.0)
    assert aircraft.meter.left_wh == pytest.approx(40.0, abs=1.5)
    aircraft.fly(60.0)
    assert aircraft.meter.factor == pytest.approx(1.0, abs=0.1)


def test_of_several_batteries_the_lowest_charge_and_all_currents_count():
    aircraft = Aircraft(model_of(), takes=1.2, charges=(0.9, 0.5)).fly(60.0)
    assert aircraft.meter.left_wh == pytest.approx(100.0 * aircraft.charges[1], abs=1.5)
    assert aircraft.meter.factor == pytest.approx(1.2, rel=0.03)


def test_the_remaining_energy_of_a_silent_battery_falls_by_the_flown_energy():
    aircraft = Aircraft(model_of(), takes=1.2).fly(60.0)
    aircraft.silent = True
    before_wh = aircraft.meter.left_wh
    aircraft.fly(120.0)
    used_wh = 1.2 * 300.0 * 120.0 / 3600.0
    assert before_wh - aircraft.meter.left_wh == pytest.approx(used_wh, rel=0.1)


@pytest.mark.parametrize("voltage_v", [4.2, 5.25])
def test_on_usb_power_the_remaining_energy_is_unknown(voltage_v):
    aircraft = Aircraft(model_of())
    aircraft.voltage_v = voltage_v
    assert aircraft.fly(5.0).meter.left_wh is None
    assert aircraft.meter.flight_s(aircraft.model) is None
    assert aircraft.meter.left_after_s(aircraft.model, 1.0) is None


def test_a_critical_voltage_goes_before_the_reported_charge():
    aircraft = Aircraft(model_of(), charges=(0.85,)).fly(10.0)
    assert aircraft.meter.left_wh == pytest.approx(84.0, abs=1.5)
    aircraft.voltage_v = 4 * 3.40
    assert aircraft.fly(2.0).meter.left_wh == pytest.approx(0.0, abs=4.0)


def test_a_short_high_current_does_not_empty_the_battery():
    model = model_of()
    resting = Battery(received_s=0.0, remaining=0.8, voltage_v=15.2, current_a=20.0, charge_state=1)
    # 40 A more sag a cell by 0.2 V: the cell voltage is corrected to the mean load.
    pulled = replace(resting, voltage_v=15.2 - 4 * 40.0 * 0.005, current_a=60.0)
    assert cell_v(pulled, model, 20.0) == pytest.approx(cell_v(resting, model, 20.0))
    assert cell_v(pulled, model, None) == pytest.approx(3.6)
    assert cell_v(pulled, model_of(cells=None), 20.0) is None


def test_without_a_percentage_voltage_and_current_give_the_charge():
    aircraft = Aircraft(model_of(), tells=("current_a",))
    aircraft.landed, aircraft.voltage_v = LandedState.ON_GROUND, 4 * 4.05
    assert aircraft.fly(5.0).meter.left_wh == pytest.approx(100.0)
    aircraft.landed, aircraft.voltage_v = LandedState.IN_AIR, 4 * 3.8
    aircraft.fly(120.0)
    # 300 W for 120 s are 10 Wh; by the voltage alone it would be 62 %.
    assert aircraft.meter.left_wh == pytest.approx(90.0, abs=1.5)


def test_without_a_percentage_and_a_current_the_voltage_gives_the_charge():
    aircraft = Aircraft(model_of(), tells=())
    aircraft.voltage_v = 4 * 3.9
    assert aircraft.fly(5.0).meter.left_wh == pytest.approx(100.0 * 0.5 / 0.65, abs=1.0)


def test_without_a_percentage_and_cells_the_remaining_energy_is_unknown():
    aircraft = Aircraft(model_of(cells=None), tells=("current_a",))
    assert aircraft.fly(5.0).meter.left_wh is None


def test_the_time_until_a_charge_is_unknown_without_the_remaining_energy():
    model = model_of()
    assert Meter().until_s(model, 0.2) is None
    assert Meter(left_wh=50.0).until_s(model, 0.2) == pytest.approx(30.0 / 300.0 * 3600.0)
    assert Meter(left_wh=10.0).until_s(model, 0.2) == 0.0


def test_a_low_voltage_lessens_the_energy_left_but_not_the_time_until_a_reported_charge():
    model = model_of(cells=4)
    aircraft = Aircraft(model, charges=(0.5,), tells=("remaining",)).fly(30.0)
    before_s = aircraft.meter.until_reported_s(model, 0.3)
    aircraft.voltage_v = 13.7
    sagging = aircraft.fly(1.0).meter
    assert sagging.left_wh < 0.2 * model.capacity_wh
    assert sagging.until_s(model, 0.3) == 0.0
    assert sagging.until_reported_s(model, 0.3) == pytest.approx(before_s - 1.0, abs=10.0)


def test_without_a_reported_charge_the_time_until_a_charge_is_by_the_energy_left():
    model = model_of(cells=4)
    meter = Aircraft(model, tells=()).fly(5.0).meter
    assert meter.until_reported_s(model, 0.3) == meter.until_s(model, 0.3)


def test_a_charge_that_stands_after_a_fast_fall_is_no_fast_drain():
    """As of the simulator of PX4, or of a gauge that corrects itself in three steps."""
    aircraft = Aircraft(model_of(), tells=("remaining",)).fly(60.0)
    for charge in (0.41, 0.17, 0.14, 0.13):
        aircraft.charges = [charge]
        aircraft.fly(1.0)
    fallen = aircraft.meter.factor
    aircraft.takes = 0.0
    assert fallen > 5.0
    assert 0.9 < aircraft.fly(30.0).meter.factor < 2.0


@pytest.mark.parametrize("drain", [1.0, 6.0])
def test_a_battery_that_reports_no_more_is_no_charge_that_stands(drain):
    aircraft = Aircraft(model_of(), tells=("remaining",), takes=drain).fly(80.0)
    before = aircraft.meter.factor
    aircraft.silent = True
    assert aircraft.fly(80.0).meter.factor == pytest.approx(before, rel=0.05)


def test_a_gauge_that_stands_makes_no_power_less_than_before():
    aircraft = Aircraft(model_of(), tells=("remaining",)).fly(150.0)
    before, aircraft.takes = aircraft.meter.factor, 0.0
    assert aircraft.fly(250.0).meter.factor == pytest.approx(before, abs=0.05)

"""The meter with silent batteries, and with wrong or missing reports."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moar_companion.mavlink.telemetry import Battery, LandedState, Telemetry
from moar_companion.risk.power import Meter, metered

from .aircraft import POWER, Aircraft, change_first_battery, model_of

properties = settings(deadline=None, max_examples=60, derandomize=True, database=None)


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({"received_s": 100.0}, id="silent"),
        pytest.param({"remaining": None}, id="tells its charge no more"),
        pytest.param({"voltage_v": 4.1, "remaining": 1.0}, id="as if on USB"),
    ],
)
@pytest.mark.parametrize("cells", [4, None])
def test_the_emptiest_battery_keeps_counting_when_it_reports_no_charge(changes, cells):
    aircraft = Aircraft(model_of(cells=cells), tells=("remaining",), charges=(0.3, 0.8)).fly(30.0)
    before_wh = aircraft.meter.left_wh
    change_first_battery(aircraft, **changes)
    aircraft.fly(60.0)
    used_wh = aircraft.meter.factor * 300.0 * 60.0 / 3600.0
    assert before_wh - aircraft.meter.left_wh == pytest.approx(used_wh, abs=0.3)


def test_a_battery_removed_on_the_ground_is_dropped():
    aircraft = Aircraft(model_of(), charges=(0.3, 0.8)).fly(10.0)
    aircraft.landed, aircraft.charges = LandedState.ON_GROUND, [0.9]
    assert aircraft.fly(10.0).meter.left_wh == pytest.approx(90.0)


def test_the_remaining_energy_falls_while_the_landed_state_is_undefined():
    aircraft = Aircraft(model_of()).fly(60.0)
    before_wh, aircraft.silent, aircraft.landed = aircraft.meter.left_wh, True, None
    aircraft.fly(60.0)
    assert before_wh - aircraft.meter.left_wh == pytest.approx(5.0, rel=0.1)


@pytest.mark.parametrize(
    "changes",
    [
        pytest.param({"current_a": None}, id="no current"),
        pytest.param({"current_a": 0.0}, id="a dead sensor"),
        pytest.param({"received_s": 100.0}, id="one of two silent"),
    ],
)
def test_the_power_measured_by_current_is_kept_while_a_part_of_it_is_missing(changes):
    tells = ("current_a",)
    aircraft = Aircraft(model_of(), takes=1.5, tells=tells, charges=(0.9, 0.9)).fly(90.0)
    assert aircraft.meter.factor == pytest.approx(1.5, abs=0.05)
    change_first_battery(aircraft, **changes)
    for _ in range(12):
        assert aircraft.fly(10.0).meter.factor >= 1.45


def test_after_a_loss_of_the_current_the_power_is_measured_by_the_charge():
    aircraft = Aircraft(model_of(), takes=1.0).fly(90.0)
    aircraft.tells, aircraft.takes = ("remaining",), 1.5
    aircraft.fly(240.0)
    assert aircraft.meter.source == "charge"
    assert aircraft.meter.factor > 1.3


def test_a_charge_that_varies_by_a_percent_keeps_the_measured_power():
    aircraft = Aircraft(model_of(), takes=1.5, tells=("remaining",)).fly(120.0)
    assert aircraft.meter.factor == pytest.approx(1.5, abs=0.1)
    for _ in range(10):  # a gauge by voltage rises at each throttle-down
        aircraft.charges = [charge + 0.015 for charge in aircraft.charges]
        aircraft.fly(2.0)
        aircraft.charges = [charge - 0.015 for charge in aircraft.charges]
        assert aircraft.fly(10.0).meter.factor == pytest.approx(1.5, abs=0.15)


def test_two_batteries_that_drain_alike_measure_as_one_does():
    aircraft = Aircraft(model_of(), takes=1.5, tells=("remaining",), charges=(0.9, 0.895))
    assert aircraft.fly(120.0).meter.factor == pytest.approx(1.5, abs=0.1)


def test_a_new_battery_keeps_the_measured_power_of_the_one_before():
    aircraft = Aircraft(model_of(), takes=1.5, tells=("remaining",)).fly(120.0)
    aircraft.charges = [0.95]
    for _ in range(30):
        assert aircraft.fly(2.0).meter.factor == pytest.approx(1.5, abs=0.15)


def test_a_current_reported_late_starts_from_the_power_measured_by_charge():
    aircraft = Aircraft(model_of(), takes=1.5, tells=("remaining",)).fly(120.0)
    aircraft.tells = ("remaining", "current_a")
    for _ in range(40):
        assert aircraft.fly(1.0).meter.factor == pytest.approx(1.5, abs=0.1)
    assert aircraft.meter.source == "current"


def test_a_current_reported_no_more_does_not_measure_a_later_flight():
    aircraft = Aircraft(model_of(), takes=1.5).fly(90.0)
    aircraft.tells, aircraft.landed = ("remaining",), LandedState.ON_GROUND
    assert aircraft.fly(2.0).meter.factor == pytest.approx(1.5, abs=0.05)
    aircraft.takes, aircraft.landed, aircraft.charges = 1.0, LandedState.IN_AIR, [0.95]
    aircraft.fly(120.0)
    assert aircraft.meter.source == "charge"
    assert aircraft.meter.factor == pytest.approx(1.0, abs=0.1)


values = st.one_of(st.none(), st.floats(min_value=0.0, max_value=1.0))


@properties
@given(
    reports=st.lists(
        st.tuples(
            values,
            st.one_of(st.none(), st.floats(0.0, 60.0)),
            st.one_of(st.none(), st.floats(0.0, 400.0)),
            st.sampled_from(LandedState),
            st.tuples(*[st.floats(allow_nan=True, allow_infinity=True)] * 3),
        ),
        max_size=12,
    ),
    capacity_known=st.booleans(),
)
def test_the_meter_stays_within_bounds_for_any_reports(reports, capacity_known):
    power = POWER if capacity_known else replace(POWER, capacity_wh=None)
    aircraft = Aircraft(model_of(power))
    model = aircraft.model
    for remaining, voltage_v, current_a, landed, velocity in reports:
        aircraft.landed, aircraft.velocity_ned_mps = landed, (0.0, 0.0, 0.0)
        aircraft.fly(0.5)
        aircraft.report(remaining=remaining, voltage_v=voltage_v, current_a=current_a)
        aircraft.telemetry = replace(
            aircraft.telemetry,
            local_position=replace(aircraft.telemetry.local_position, velocity_ned_mps=velocity),
        )
        aircraft.meter = metered(aircraft.meter, aircraft.telemetry, aircraft.now_s + 0.1, model)
        meter = aircraft.meter
        assert 0.2 <= meter.factor <= 20.0
        assert meter.left_wh is None or 0.0 <= meter.left_wh <= model.capacity_wh
        assert math.isfinite(meter.flown_wh)


lost = st.fixed_dictionaries(
    {},
    optional={
        "received_s": st.just(100.0),
        "remaining": st.none(),
        "voltage_v": st.none() | st.just(4.1),
        "current_a": st.none() | st.just(0.0),
    },
)


@pytest.mark.uncounted
@settings(properties, max_examples=25)
@given(first=lost, undefined=st.booleans(), capacity_known=st.booleans())
def test_a_missing_report_never_raises_the_energy_nor_lowers_the_power(
    first, undefined, capacity_known
):
    power = POWER if capacity_known else replace(POWER, capacity_wh=None)
    aircraft = Aircraft(model_of(power), takes=1.4, charges=(0.7, 0.9)).fly(90.0)
    before = aircraft.meter
    change_first_battery(aircraft, **first)
    aircraft.landed = None if undefined else aircraft.landed
    for _ in range(4):
        left_wh = aircraft.meter.left_wh
        aircraft.fly(10.0)
        # A report is a whole percentage: the counted energy may be 1 % below the next report.
        assert aircraft.meter.left_wh <= left_wh + 0.01 * aircraft.model.capacity_wh
        assert aircraft.meter.factor >= before.factor - 0.1


@properties
@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.floats(12.0, 17.0), st.floats(12.0, 17.0))
def test_less_charge_or_voltage_never_leaves_more_energy(charge, other, volts, other_volts):
    left = []
    for remaining, voltage_v in (
        (min(charge, other), min(volts, other_volts)),
        (max(charge, other), max(volts, other_volts)),
    ):
        battery = Battery(
            received_s=1.0, remaining=remaining, voltage_v=voltage_v, current_a=None, charge_state=1
        )
        meter = metered(Meter(), Telemetry(batteries={0: battery}), 1.0, model_of())
        left.append(meter.left_wh)
    assert left[0] <= left[1]

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moar_companion.mavlink.telemetry import Battery, Landed, LandedState, Telemetry
from moar_companion.risk.battery import inputs, remember
from moar_companion.risk.power import Demands, Meter, PowerModel
from moar_companion.settings.risk_model import RiskModel
from moar_companion.settings.vehicle import Power

properties = settings(deadline=None, max_examples=100, derandomize=True, database=None)
MODEL = RiskModel(cells=4)
POWER = PowerModel.made(Power(hover_w=300.0, capacity_wh=100.0), MODEL, 5.0, 2.0, 1.5)
"""A full battery flies for 1,200 s."""


def battery(now_s: float, **changes: object) -> Battery:
    full = Battery(received_s=now_s, remaining=0.9, voltage_v=16.0, current_a=15.0, charge_state=1)
    return replace(full, **changes)


def test_a_full_battery_settles_to_no_risk(flight):
    assert flight.estimate.indices.battery == pytest.approx(0.0, abs=1e-4)


def test_a_lower_charge_raises_the_risk(flight):
    # In the air a drain this fast would itself raise the risk.
    flight.sources["landed"] = lambda t: Landed(received_s=t, state=LandedState.ON_GROUND)
    risks = []
    for percent in (80, 70, 60, 45, 30, 20, 5):
        flight.sources["batteries"] = lambda t, p=percent: {0: battery(t, remaining=p / 100)}
        flight.fly(3.0)
        risks.append(flight.estimate.report.battery.value)
    assert risks == pytest.approx([0.0, 0.0, 0.2, 0.5, 0.8, 1.0, 1.0])


@pytest.mark.parametrize(
    ("state", "risk"),
    [
        pytest.param(1, 0.0, id="ok"),
        pytest.param(2, 0.8, id="low"),
        pytest.param(3, 1.0, id="critical"),
        pytest.param(4, 1.0, id="emergency"),
        pytest.param(5, 1.0, id="failed"),
        pytest.param(6, 1.0, id="unhealthy"),
        pytest.param(0, None, id="undefined"),
        pytest.param(7, None, id="charging"),
    ],
)
def test_the_autopilots_charge_state_sets_the_risk(flight, state, risk):
    flight.sources["batteries"] = lambda t: {0: battery(t, charge_state=state)}
    flight.fly(3.0)
    assert flight.input("battery", "battery 0 charge state").risk == risk


def test_a_low_cell_voltage_raises_the_risk_despite_a_high_charge(new_flight, healthy):
    # ArduPilot: 85 % by consumed charge at a critical 10 V of three cells.
    healthy["batteries"] = lambda t: {0: battery(t, remaining=0.85, voltage_v=10.0)}
    flight = new_flight(model=RiskModel(cells=3), **healthy)
    assert flight.fly(5.0).indices.battery > 0.95
    assert flight.estimate.report.battery.worst == "battery 0 cell voltage"


def test_without_the_number_of_cells_the_voltage_is_ignored(flight):
    flight.sources["batteries"] = lambda t: {0: battery(t, voltage_v=10.0)}
    flight.fly(3.0)
    assert flight.input("battery", "battery 0 cell voltage").risk is None


def test_the_worst_battery_decides_even_when_it_falls_silent(flight):
    flight.sources["batteries"] = lambda t: {0: battery(t), 1: battery(t, remaining=0.3)}
    flight.fly(10.0)
    assert flight.estimate.report.battery.worst == "battery 1 remaining"
    before = flight.estimate.indices.battery
    silent_s = flight.now_s
    flight.sources["batteries"] = lambda t: {
        0: battery(t),
        1: battery(silent_s, remaining=0.3),
    }
    assert flight.fly(60.0).indices.battery >= before
    flight.sources["batteries"] = lambda t: {0: battery(t)}
    assert flight.fly(60.0).indices.battery >= before


def test_a_battery_removed_on_the_ground_is_no_risk_any_more(flight):
    flight.sources["batteries"] = lambda t: {0: battery(t), 1: battery(t, remaining=0.3)}
    flight.handle("landed", state=LandedState.ON_GROUND)
    flight.fly(5.0)
    flight.sources["batteries"] = lambda t: {0: battery(t)}
    assert flight.fly(30.0).indices.battery < 0.01
    assert not any(name.startswith("battery 1") for name in flight.estimate.last_known["battery"])


def test_the_flight_time_left_at_home_sets_the_risk(flight):
    # 60 % of 20 min is 720 s; 2700 m at 5 m/s take 540 s: 180 s are left at home.
    flight.handle("local_position", position_ned_m=(2700.0, 0.0, 0.0))
    flight.sources["batteries"] = lambda t: {0: battery(t, remaining=0.6)}
    flight.fly(5.0)
    left = flight.input("battery", "battery 0 flight time left at home")
    assert left.value == pytest.approx(180.0)
    assert left.risk == pytest.approx(0.5)
    assert flight.estimate.report.battery.worst == "battery 0 flight time left at home"


def test_a_home_out_of_reach_is_full_risk(flight):
    flight.handle("local_position", position_ned_m=(5200.0, 0.0, 0.0))
    assert flight.fly(5.0).indices.battery > 0.99


def test_without_a_home_the_other_inputs_count(new_flight, healthy):
    del healthy["home"]
    flight = new_flight(**healthy)
    assert flight.fly(60.0).indices.battery < 0.01
    assert flight.input("battery", "battery 0 flight time left at home").risk is None


def test_without_a_battery_monitor_the_risk_stays_unknown(new_flight, healthy):
    healthy["batteries"] = lambda t: {
        0: battery(t, remaining=None, voltage_v=None, current_a=None, charge_state=1)
    }
    flight = new_flight(**healthy)
    assert flight.fly(60.0).indices.battery == RiskModel().unknown
    assert not flight.estimate.report.battery.ever_known
    flight.sources["batteries"] = lambda _: {}
    assert flight.fly(60.0).indices.battery == RiskModel().unknown


def test_a_full_charge_on_usb_power_leaves_the_risk_unknown(new_flight, healthy):
    healthy["batteries"] = lambda t: {0: battery(t, remaining=1.0, voltage_v=4.2)}
    bench = new_flight(**healthy)
    assert bench.fly(60.0).indices.battery == RiskModel().unknown


def test_a_low_warning_without_a_fraction_counts(new_flight, healthy):
    healthy["batteries"] = lambda t: {0: battery(t, remaining=None, charge_state=2)}
    flight = new_flight(**healthy)
    assert flight.fly(5.0).indices.battery == pytest.approx(0.8, abs=0.01)


def test_a_battery_received_every_twelve_seconds_is_current(flight):
    for _ in range(5):
        flight.silence("batteries")
        flight.fly(12.0)
        assert flight.estimate.report.battery.value == 0.0
        flight.sources["batteries"] = lambda t: {0: battery(t)}
        flight.fly(0.1)


# Against the routes still to be flown ---------------------------------------------------------


def flown(new_flight, healthy, demands, remaining=0.9):
    """A settled flight with a known battery and the energy of the routes still to be flown."""
    healthy["batteries"] = lambda t: {0: battery(t, remaining=remaining)}
    flight = new_flight(model=MODEL, **healthy)
    flight.power = POWER
    flight.fly(30.0)
    flight.demands = demands
    flight.fly(0.1)
    return flight


@pytest.mark.parametrize("way", ["mission", "exit", "evacuation"])
def test_the_flight_time_left_after_a_route_is_an_input(new_flight, healthy, way):
    # Within 30 s the measured 240 W (15 A at 16 V) replace the file's 300 W.
    need = {"mission": "finish_wh", "exit": "exit_wh", "evacuation": "evacuation_wh"}[way]
    flight = flown(new_flight, healthy, Demands(flown=True, **{need: 70.0}))
    left = flight.input("battery", f"flight time left after {way}")
    flight_s = flight.estimate.meter.flight_s(POWER)
    assert flight_s == pytest.approx(0.9 * 100.0 / 240.0 * 3600.0, rel=0.05)
    assert left.value == pytest.approx(flight_s - 70.0 / 300.0 * 3600.0)
    assert left.risk == MODEL.home_margin_s.fraction(left.value)
    for other in {"mission", "exit", "evacuation"} - {way}:
        assert flight.input("battery", f"flight time left after {other}").risk is None


def test_a_long_route_raises_the_risk_despite_a_high_charge(new_flight, healthy):
    flight = flown(new_flight, healthy, Demands(exit_wh=105.0, evacuation_wh=110.0))
    flight.fly(3.0)
    assert flight.estimate.indices.battery > 0.9
    assert flight.input("battery", "battery 0 remaining").risk == 0.0
    assert flight.estimate.report.battery.worst == "flight time left after exit"


def test_a_drained_battery_raises_the_risk_within_three_seconds(new_flight, healthy):
    flight = flown(new_flight, healthy, Demands(flown=True, finish_wh=50.0, exit_wh=20.0))
    before = flight.estimate.indices.as_dict()
    assert before["battery"] < 0.1
    # 45 % of charge is half of the alarm; but the routes need nearly all of it.
    flight.sources["batteries"] = lambda t: {0: battery(t, remaining=0.45)}
    after = flight.fly(3.0).indices.as_dict()
    assert after["battery"] > 0.9
    assert [name for name in after if after[name] > before[name] + 0.1] == ["battery"]


def test_an_ended_mission_is_dropped_and_a_missing_plan_keeps_its_risk(new_flight, healthy):
    flight = flown(new_flight, healthy, Demands(flown=True, finish_wh=108.0, exit_wh=20.0))
    assert flight.fly(5.0).indices.battery > 0.9
    flight.demands = Demands(flown=True, exit_wh=20.0)
    assert flight.fly(30.0).indices.battery > 0.9
    flight.demands = Demands(exit_wh=20.0)
    assert flight.fly(60.0).indices.battery < 0.05


def test_with_a_silent_battery_the_flight_time_left_is_unknown_and_stays_a_risk(
    new_flight, healthy
):
    flight = flown(new_flight, healthy, Demands(exit_wh=90.0))
    before = flight.fly(10.0).indices.battery
    flight.silence("batteries")
    assert flight.fly(60.0).indices.battery >= before
    assert flight.input("battery", "flight time left after exit").risk is None


def risk_of(remaining=0.8, voltage_v=15.6, current_a=15.0, state=1, needs=(10.0, 5.0, 5.0)):
    """Worst known risk of a battery's first report; None where no risk is known."""
    report = battery(1.0, remaining=remaining, voltage_v=voltage_v, current_a=current_a)
    telemetry = Telemetry(batteries={0: replace(report, charge_state=state)})
    meter = remember(Meter(), telemetry, 1.0, POWER)
    finish_wh, exit_wh, evacuation_wh = needs
    demands = Demands(flown=True, finish_wh=finish_wh, exit_wh=exit_wh, evacuation_wh=evacuation_wh)
    reports = inputs(telemetry, 1.0, MODEL, meter, POWER, 5.0, demands)
    risks = [report.risk for report in reports if report.risk is not None]
    assert all(0.0 <= risk <= 1.0 for risk in risks)
    return max(risks, default=None)


maybe = st.one_of(st.none(), st.floats(allow_nan=True, allow_infinity=True))
need = st.floats(min_value=0.0, max_value=200.0)


@properties
@given(st.floats(0.0, 1.0), st.floats(12.0, 17.0), st.tuples(need, need, need))
def test_less_charge_less_voltage_and_longer_routes_never_lower_the_risk(charge, volts, needs):
    risk = risk_of(charge, volts, needs=needs)
    assert risk_of(0.9 * charge, volts, needs=needs) >= risk
    assert risk_of(charge, volts - 0.3, needs=needs) >= risk
    for index in range(3):
        more = tuple(n + 3.0 * (index == i) for i, n in enumerate(needs))
        assert risk_of(charge, volts, needs=more) >= risk


@properties
@given(st.floats(0.0, 1.0), st.floats(12.0, 17.0), st.tuples(need, need, need))
def test_a_little_noise_changes_the_risk_a_little(charge, volts, needs):
    risk = risk_of(charge, volts, needs=needs)
    assert abs(risk_of(min(1.0, charge + 1e-4), volts, needs=needs) - risk) < 0.01
    assert abs(risk_of(charge, volts + 1e-3, needs=needs) - risk) < 0.01


@properties
@given(maybe, maybe, maybe, st.integers(0, 10), st.tuples(maybe, maybe, maybe))
def test_a_value_that_is_not_finite_counts_as_missing(remaining, volts, current, state, needs):
    finite = [
        value if value is not None and math.isfinite(value) and abs(value) <= 1e6 else None
        for value in (remaining, volts, current)
    ]
    risk_of(*finite, state, needs=needs)

from __future__ import annotations

from dataclasses import replace

import pytest

from moar_companion.types import Battery
from moar_companion.vehicle import RiskModel


def battery(now_s: float, **changes: object) -> Battery:
    full = Battery(received_s=now_s, remaining=0.9, voltage_v=16.0, current_a=15.0, charge_state=1)
    return replace(full, **changes)


def test_a_full_battery_settles_to_no_risk(flight):
    assert flight.estimate.indices.battery == pytest.approx(0.0, abs=1e-4)


def test_the_battery_drains(flight):
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
def test_the_autopilot_warns(flight, state, risk):
    flight.sources["batteries"] = lambda t: {0: battery(t, charge_state=state)}
    flight.fly(3.0)
    assert flight.input("battery", "battery 0 charge state").risk == risk


def test_the_voltage_tells_what_the_fraction_hides(new_flight, healthy):
    # ArduPilot: 85 % by consumed charge at a critical 10 V of three cells.
    healthy["batteries"] = lambda t: {0: battery(t, remaining=0.85, voltage_v=10.0)}
    flight = new_flight(model=RiskModel(cells=3), **healthy)
    assert flight.fly(5.0).indices.battery > 0.95
    assert flight.estimate.report.battery.worst == "battery 0 cell voltage"


def test_without_the_number_of_cells_voltage_says_nothing(flight):
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


def test_far_from_home(flight):
    # 60 % of 20 minutes is 720 s; 2700 m at 5 m/s take 540 s: 180 s are left on arrival.
    flight.hear("local_position", position_ned_m=(2700.0, 0.0, 0.0))
    flight.sources["batteries"] = lambda t: {0: battery(t, remaining=0.6)}
    flight.fly(5.0)
    left = flight.input("battery", "battery 0 left at home")
    assert left.value == pytest.approx(180.0)
    assert left.risk == pytest.approx(0.5)
    assert flight.estimate.report.battery.worst == "battery 0 left at home"


def test_too_far_from_home(flight):
    flight.hear("local_position", position_ned_m=(5200.0, 0.0, 0.0))
    assert flight.fly(5.0).indices.battery > 0.99


def test_without_home_the_rest_is_judged(new_flight, healthy):
    del healthy["home"]
    flight = new_flight(**healthy)
    assert flight.fly(60.0).indices.battery < 0.01
    assert flight.input("battery", "battery 0 left at home").risk is None


def test_no_battery_monitor_stays_unknown(new_flight, healthy):
    healthy["batteries"] = lambda t: {
        0: battery(t, remaining=None, voltage_v=None, current_a=None, charge_state=1)
    }
    flight = new_flight(**healthy)
    assert flight.fly(60.0).indices.battery == RiskModel().unknown
    assert not flight.estimate.report.battery.ever_known
    flight.sources["batteries"] = lambda _: {}
    assert flight.fly(60.0).indices.battery == RiskModel().unknown


def test_power_from_usb_claims_a_full_battery(new_flight, healthy):
    healthy["batteries"] = lambda t: {0: battery(t, remaining=1.0, voltage_v=4.2)}
    bench = new_flight(**healthy)
    assert bench.fly(60.0).indices.battery == RiskModel().unknown


def test_a_low_warning_without_a_fraction_counts(new_flight, healthy):
    healthy["batteries"] = lambda t: {0: battery(t, remaining=None, charge_state=2)}
    flight = new_flight(**healthy)
    assert flight.fly(5.0).indices.battery == pytest.approx(0.8, abs=0.01)


def test_a_battery_that_is_heard_every_twelve_seconds_is_known(flight):
    for _ in range(5):
        flight.silence("batteries")
        flight.fly(12.0)
        assert flight.estimate.report.battery.value == 0.0
        flight.sources["batteries"] = lambda t: {0: battery(t)}
        flight.fly(0.1)

"""The time until a battery's action, where the charge falls faster than by the power."""

from __future__ import annotations

import pytest

from moar_companion.mavlink.telemetry import Battery, Telemetry

from .test_failsafe_exposure import ABOVE, LANDS, REACH, meter, watching


def charged(remaining, now_s):
    battery = Battery(
        received_s=now_s,
        remaining=remaining,
        voltage_v=16.0,
        current_a=None,
        charge_state=1,
        summary=False,
    )
    return Telemetry(batteries={0: battery})


def left_s(charges):
    """Time until the landing, after (time, charge) reports."""
    watch = watching(**LANDS)
    for now_s, charge in charges:
        watch.update(ABOVE, REACH, charged(charge, now_s), meter(charge), now_s)
    return watch.next_battery_action(charged(charge, now_s), meter(charge))[1]


def falling(from_charge, rate_per_s, seconds):
    return [(0.1 * n, from_charge - 0.1 * n * rate_per_s) for n in range(round(10 * seconds) + 1)]


def test_a_charge_that_falls_fast_is_forecast_by_its_fall():
    charges = falling(0.9, 0.05, 8.0)
    assert left_s(charges) == pytest.approx((0.5 - 0.3) / 0.05, rel=0.05)


def test_a_usual_discharge_is_forecast_by_the_power():
    by_power_s = left_s([(0.0, 0.5)])
    rounded = [(now_s, round(charge, 2)) for now_s, charge in falling(0.53, 0.003, 10.0)]
    assert left_s([*rounded, (10.1, 0.5)]) == by_power_s


def test_a_charge_that_jumped_below_the_threshold_leaves_no_time():
    assert left_s([(0.0, 0.9), (0.1, 0.25)]) == 0.0


def test_a_fall_is_forgotten_when_the_charge_stays():
    by_power_s = left_s([(0.0, 0.5)])
    stays = [(0.1 * n, 0.5) for n in range(1, 60)]
    assert left_s([(0.0, 0.9), *stays]) == by_power_s


@pytest.mark.parametrize("dip", [0.03, 0.1])
def test_a_charge_that_dips_once_as_in_a_climb_is_forecast_by_the_power(dip):
    by_power_s = left_s([(0.0, 0.6 - dip)])
    steady = [(0.1 * n, 0.6) for n in range(30)]
    dipped = [(3.0 + 0.1 * n, 0.6 - dip) for n in range(30)]
    for count in range(1, 31):
        assert left_s([*steady, *dipped[:count]]) == by_power_s


def test_the_first_reports_after_control_begins_forecast_no_fall():
    by_power_s = left_s([(0.0, 0.55)])
    assert left_s([(0.0, 0.6), (0.02, 0.58), (0.04, 0.55)]) == by_power_s

"""Batteries and satellite receivers that report little, late or in their own way."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import ardupilotmega as m

from .flown import ARDUPILOT, boot_ms, gps, hover, sys_status

_NONE = 65535


def _battery(number, percent, *, first_mv, rest_mv=(_NONE,) * 9, more_mv=(0,) * 4, state=0):
    return m.MAVLink_battery_status_message(
        number,
        0,
        0,
        32767,
        [first_mv, *rest_mv],
        -1,
        -1,
        -1,
        percent,
        0,
        state,
        list(more_mv),
        0,
        0,
    )


def test_a_battery_that_is_not_connected_hides_no_charge():
    """PX4 sends one of id 255 with -1 %, and the charge in SYS_STATUS."""
    packets = hover(
        duration_s=8.0,
        first=lambda t: (gps(t), _battery(255, -1, first_mv=15600), sys_status(80)),
    )
    replay, listener = packets.played()
    assert {n: b.remaining for n, b in listener.telemetry.batteries.items()} == {0: 0.8}
    assert replay.samples[-1].risk["battery"] < 0.2


def test_fourteen_cells_in_two_fields_are_added():
    cells_mv = (4230, 4230, 4238, 4242, 4234, 4226, 4226, 4234, 4226, 4226)
    more_mv = (4230, 4234, 4226, 4234)
    status = _battery(0, 97, first_mv=cells_mv[0], rest_mv=cells_mv[1:], more_mv=more_mv, state=1)
    _, listener = hover(duration_s=2.0, first=lambda t: (gps(t), status)).played()
    battery = listener.telemetry.batteries[0]
    assert battery.voltage_v == pytest.approx(59.2, abs=0.05)
    assert battery.cells == 14
    assert battery.remaining == 0.97


@pytest.mark.parametrize("lower", [0, 1])
def test_the_lower_of_two_batteries_counts(lower):
    percents = (20, 95) if lower == 0 else (95, 20)
    replay, _ = hover(
        duration_s=8.0,
        first=lambda t: (
            gps(t),
            sys_status(95),
            *(_battery(n, percent, first_mv=15600) for n, percent in enumerate(percents)),
        ),
    ).played()
    assert replay.samples[-1].risk["battery"] > 0.9
    assert replay.samples[-1].why["battery"] == f"battery {lower} remaining"


def _second_receiver(time_s):
    return m.MAVLink_gps2_raw_message(
        boot_ms(time_s) * 1000, 6, 453781000, -719295000, 220000, 70, 110, 0, 0, 18, *(0,) * 8
    )


def _no_receiver():
    return m.MAVLink_gps_raw_int_message(0, 0, 0, 0, 0, *(_NONE,) * 4, 255, *(0,) * 6)


def test_a_second_receiver_alone_is_the_one_that_counts():
    replay, _ = hover(
        duration_s=8.0,
        autopilot=ARDUPILOT,
        first=lambda t: (_no_receiver(), _second_receiver(t)),
    ).played()
    measures = replay.measures["localization"]
    assert measures["satellites"].greatest_risk == 0.0
    assert measures["receivers lost"].greatest_risk is None
    assert replay.samples[-1].risk["localization"] < 0.2


def test_a_first_receiver_that_fails_in_flight_is_a_lost_one():
    replay, _ = hover(
        duration_s=16.0,
        autopilot=ARDUPILOT,
        first=lambda t: (gps(t) if t < 4.0 else _no_receiver(), _second_receiver(t)),
    ).played()
    assert replay.samples[-1].risk["localization"] > 0.9
    assert replay.samples[-1].why["localization"] == "fix type"


def test_each_fix_type_below_3_is_a_risk_of_1():
    for fix_type in range(9):
        replay, _ = hover(
            duration_s=8.0, autopilot=ARDUPILOT, first=lambda t, n=fix_type: (gps(t, n),)
        ).played()
        risk = replay.samples[-1].risk["localization"]
        assert risk > 0.9 if fix_type < 3 else risk < 0.2

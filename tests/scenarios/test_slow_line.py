"""Flights over a UART of 57600 baud: 5,760 bytes a second in each direction."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import all as mavlink

from ..flights.operator import INSPECTION
from ..flights.slow_line import BYTES_PER_S, SlowLine
from .marks import BOTH

BATTERY, GPS = mavlink.MAVLINK_MSG_ID_BATTERY_STATUS, mavlink.MAVLINK_MSG_ID_GPS_RAW_INT
POSITION = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED
SETPOINT = mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
FLOWN_S = 12.0


@pytest.mark.slow
@BOTH
def test_battery_gps_and_position_come_in_time_and_no_setpoint_waits(manner):
    """With PX4's own rates the battery came every 7 s, and the position at 12 Hz."""
    flight = SlowLine(manner=manner, vehicle="x500")
    flight.start_in_the_air()
    flight.run(4.0)
    flight.begin(INSPECTION)
    flight.down.clear()
    flight.up.clear()
    flight.run(FLOWN_S)

    assert flight.state in {"flying", "at_target"}
    down, up = flight.down, flight.up
    assert down.lost == 0
    assert down.longest_gap_s(BATTERY) < 2.1
    assert down.longest_gap_s(GPS) < 1.1
    assert down.longest_gap_s(POSITION) < 0.1
    assert up.longest_gap_s(SETPOINT) < 0.03
    assert max(up.waits_s[SETPOINT]) < 0.012
    assert len(up.arrivals_s[SETPOINT]) == pytest.approx(50 * FLOWN_S, abs=2)
    assert sum(down.bytes.values()) < 0.75 * BYTES_PER_S * FLOWN_S
    assert sum(up.bytes.values()) < 0.85 * BYTES_PER_S * FLOWN_S

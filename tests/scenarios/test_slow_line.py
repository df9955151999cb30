"""Flights over a UART of 57600 baud: 5,760 bytes a second in each direction."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import all as mavlink

from ..flights.operator import INSPECTION, Manner
from ..flights.slow_line import BYTES_PER_S, SlowLine
from .marks import BOTH

BATTERY, GPS = mavlink.MAVLINK_MSG_ID_BATTERY_STATUS, mavlink.MAVLINK_MSG_ID_GPS_RAW_INT
POSITION = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED
SETPOINT = mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
FLOWN_S = 12


def ask_for_everything(operator, number):
    codec, version, protocol = operator._codec, 148, 300
    for message_id in (version, protocol):
        operator.command(mavlink.MAV_CMD_REQUEST_MESSAGE, message_id, component=195)
    operator.send(codec.mission_request_list_encode(1, 195))
    open_root = [number, 0, 0, 3, *[0] * 8, ord("/"), *[0] * 238]
    operator.send(codec.file_transfer_protocol_encode(0, 1, 195, open_root))


@pytest.mark.slow
@BOTH
def test_battery_gps_and_position_come_in_time_and_no_setpoint_waits(manner):
    """With PX4's own rates the battery came every 7 s, and the position at 12 Hz.

    Meanwhile an operator behind the autopilot asks the companion for its path, files and versions.
    """
    flight = SlowLine(manner=manner, vehicle="x500")
    flight.start_in_the_air()
    flight.run(4.0)
    flight.begin(INSPECTION)
    flight.down.clear()
    flight.up.clear()
    for second in range(FLOWN_S):
        ask_for_everything(flight.operator, second)
        flight.run(1.0)

    assert flight.state in {"flying", "at_target"}
    down, up = flight.down, flight.up
    assert down.lost == 0
    assert down.longest_gap_s(BATTERY) < 2.1
    assert down.longest_gap_s(GPS) < 1.1
    assert down.longest_gap_s(POSITION) < 0.1
    assert max(up.waits_s[SETPOINT]) < 0.012
    assert up.longest_gap_s(SETPOINT) < 0.02 + 0.012
    assert len(up.arrivals_s[SETPOINT]) == pytest.approx(50 * FLOWN_S, abs=2)
    assert sum(down.bytes.values()) < 0.75 * BYTES_PER_S * FLOWN_S
    assert sum(up.bytes.values()) < 0.9 * BYTES_PER_S * FLOWN_S


@pytest.mark.slow
def test_a_ground_station_that_asks_for_everything_delays_no_setpoint_by_a_cycle():
    flight = SlowLine(manner=Manner.PX4, vehicle="x500")
    flight.start_in_the_air()
    flight.run(4.0)
    flight.begin(INSPECTION)
    flight.up.clear()
    requests = [mavlink.MAVLink_mission_request_list_message(1, 195)]
    requests += [mavlink.MAVLink_mission_request_int_message(1, 195, seq) for seq in range(5)]
    requests += [
        mavlink.MAVLink_command_long_message(1, 195, 512, 0, number, *[0] * 6)
        for number in (0, 148, 251, 300, 332, 390, 397)
    ]
    requests.append(mavlink.MAVLink_file_transfer_protocol_message(0, 1, 195, opening()))
    for _ in range(5):
        for request in requests:
            flight.operator.send(request)
        flight.run(1.0)
    up, seconds = flight.up, 5.0
    assert up.longest_gap_s(SETPOINT) < 0.035
    assert max(up.waits_s[SETPOINT]) < 0.015
    assert len(up.arrivals_s[SETPOINT]) == pytest.approx(50 * seconds, abs=2)
    assert len(up.arrivals_s[mavlink.MAVLINK_MSG_ID_MISSION_ITEM_INT]) > 5
    assert sum(up.bytes.values()) < 0.95 * BYTES_PER_S * seconds


def opening():
    """Payload of an FTP request that opens the general file."""
    name = b"/general.json.xz"
    header = [0, 0, 0, 4, len(name), 0, 0, 0, 0, 0, 0, 0]  # session 0, OpenFileRO
    return (bytes(header) + name).ljust(251, b"\0")

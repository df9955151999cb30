"""Rates of unread streams: reduced where no other system reads them."""

from __future__ import annotations

from collections import Counter

import pytest
from pymavlink.dialects.v20 import all as mavlink

from sitl.wire import packet_header, packets
from tests.thorough import sampled

from ..flights.lockstep import Lockstep
from ..flights.operator import Manner
from .marks import BOTH

USED = {
    mavlink.MAVLINK_MSG_ID_ATTITUDE,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT,
    mavlink.MAVLINK_MSG_ID_GPS_RAW_INT,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED,
    mavlink.MAVLINK_MSG_ID_SERVO_OUTPUT_RAW,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS,
}
UNREAD = {
    Manner.PX4: {
        mavlink.MAVLINK_MSG_ID_ALTITUDE,
        mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION,
        mavlink.MAVLINK_MSG_ID_VFR_HUD,
    },
    Manner.ARDUPILOT: {
        mavlink.MAVLINK_MSG_ID_AHRS2,
        mavlink.MAVLINK_MSG_ID_NAV_CONTROLLER_OUTPUT,
        mavlink.MAVLINK_MSG_ID_VFR_HUD,
    },
}
STREAMED_HZ = 50


class Wire(Lockstep):
    """Counts packets on the companion's link, with or without a ground station there."""

    def __init__(self, manner):
        super().__init__(manner=manner)
        self.operator.silent = True
        self.come = Counter()

    def handle(self, data):
        self.come.update(packet_header(packet)[0] for packet in packets(data))
        super().handle(data)

    def rates_hz(self, seconds=10.0):
        """Rates by message id, over the next seconds."""
        self.come.clear()
        self.run(seconds)
        return {message_id: count / seconds for message_id, count in self.come.items()}

    def stream_everything(self):
        """As ArduPilot's SR2 parameters; with the companion's ids, the only ones on this link."""
        packer = mavlink.MAVLink(None, srcSystem=1, srcComponent=195)
        request = packer.request_data_stream_encode(1, 1, 0, STREAMED_HZ, 1)
        self.autopilot.receive("companion", request.pack(packer))


@pytest.mark.slow
@BOTH
def test_unread_messages_come_once_a_second_until_a_ground_station_shares_the_link(manner):
    flight = Wire(manner)
    flight.run(3.0)
    if manner is Manner.ARDUPILOT:
        flight.run(45.0)  # until the autopilot reports a position
        flight.stream_everything()
    flight.run(1.0)
    before = flight.rates_hz(5.0)
    assert all(before[message_id] > 5.0 for message_id in UNREAD[manner])

    flight.run(10.0)
    after = flight.rates_hz()
    assert all(after[message_id] == pytest.approx(1.0, abs=0.11) for message_id in UNREAD[manner])
    assert all(after[message_id] >= 0.95 * before[message_id] for message_id in USED)
    assert sum(after.values()) < sum(before.values()) - 80.0

    flight.operator.silent = False
    flight.run(3.0)
    shared = flight.rates_hz()
    assert all(
        shared[message_id] == pytest.approx(before[message_id], rel=0.1)
        for message_id in UNREAD[manner]
    )


@pytest.mark.slow
@pytest.mark.parametrize("manner", sampled([Manner.PX4], list(Manner)))
def test_on_a_link_with_a_ground_station_no_stream_rate_is_reduced(manner):
    flight = Wire(manner)
    flight.operator.silent = False
    flight.run(3.0)
    if manner is Manner.ARDUPILOT:
        flight.stream_everything()
    flight.run(12.0)
    rates_hz = flight.rates_hz()
    assert all(rates_hz[message_id] > 5.0 for message_id in UNREAD[manner])


class SerialWire(Wire):
    link_url = "serial:/dev/ttyTHS1:921600"


@pytest.mark.slow
@pytest.mark.parametrize("manner", sampled([Manner.ARDUPILOT], list(Manner)))
def test_on_a_serial_port_stream_rates_are_reduced_despite_a_forwarded_ground_station(manner):
    flight = SerialWire(manner)
    flight.operator.silent = False
    flight.run(3.0)
    if manner is Manner.ARDUPILOT:
        flight.run(45.0)  # until the autopilot reports a position
        flight.stream_everything()
    flight.run(11.0)
    rates_hz = flight.rates_hz()
    unread_hz = [rates_hz[message_id] for message_id in UNREAD[manner]]
    assert unread_hz == [pytest.approx(1.0, abs=0.11)] * len(unread_hz)

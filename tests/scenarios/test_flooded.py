"""A ground station that asks for everything at once, in flight."""

from __future__ import annotations

import pytest

from moar_companion.mavlink.dialect import id_of
from sitl.wire import packet_header
from tests.flights.lockstep import Lockstep
from tests.flights.operator import INSPECTION
from tests.mavlink.component.ftp_client import BURST, LIST, OPEN, READ, request

CYCLES, PER_CYCLE = 100, 20
FILE_TRANSFER = id_of("FILE_TRANSFER_PROTOCOL")


def flown(requests):
    """Times, states and setpoints of a flight beside a ground station, and the count of answers."""
    flight = Lockstep(vehicle="x500")
    flight.begin(INSPECTION)
    for _ in range(CYCLES):
        for message in requests:
            flight.operator.send(message)
        flight.run(0.02)
    answers = sum(packet_header(item)[0] == FILE_TRANSFER for _, item in flight.to_autopilot)
    # Without sequence number and checksum: the answers have taken numbers.
    return [(item.time_s, item.state, item.packet[5:-2]) for item in flight.setpoints], answers


@pytest.mark.slow
def test_a_thousand_requests_for_files_a_second_change_no_setpoint():
    flood = [
        request(number, opcode, data=data, size=size, session=number % 5)
        for number in range(PER_CYCLE // 4)
        for opcode, data, size in (
            (OPEN, b"/parameter.json.xz", None),
            (BURST, b"", 239),
            (READ, b"", 239),
            (LIST, b"/", None),
        )
    ]
    calm, _ = flown([])
    flooded, answers = flown(flood)
    assert answers > 100
    assert len({packet for _, _, packet in calm}) > 100
    assert flooded == calm

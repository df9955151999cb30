"""One UART for companion and ground station: an order, a flight and a takeover through a router."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import all as mavlink

from ..flights.operator import ACCEPTED, INSPECTION
from ..flights.routed_uart import COMPANION, GROUND, UART, RoutedUart
from .marks import BOTH

HEARTBEAT = mavlink.MAVLINK_MSG_ID_HEARTBEAT
SETPOINT = mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED
OURS, STATION = (1, 195), (255, 190)
FLOWN_S = 8.0


@pytest.mark.slow
@BOTH
def test_an_inspection_is_ordered_flown_and_taken_over_through_a_router(manner):
    flight = RoutedUart(manner=manner, vehicle="x500")
    flight.start_in_the_air()
    flight.begin(INSPECTION)
    results = [m.result for m in flight.operator.received if m.get_type() == "COMMAND_ACK"]
    assert ACCEPTED in results
    flight.router.delivered.clear()
    flight.run(FLOWN_S)
    assert flight.state in {"flying", "at_target"}

    delivered = flight.router.delivered
    assert delivered[UART, SETPOINT, OURS] == pytest.approx(50 * FLOWN_S, abs=2)
    assert delivered[GROUND, SETPOINT, OURS] == 0
    for name in (UART, GROUND):
        assert delivered[name, HEARTBEAT, OURS] == pytest.approx(FLOWN_S, abs=1)
    for name in (UART, COMPANION):
        assert delivered[name, HEARTBEAT, STATION] == pytest.approx(FLOWN_S, abs=1)

    flight.operator.mode("hold")
    took_s = flight.now_s
    flight.run(1.0)
    assert flight.operator.in_mode("hold")
    assert flight.state == "overridden"
    assert flight.last_setpoint_s <= took_s + 0.2

"""The same inputs at the same times give the same outputs, byte for byte."""

from __future__ import annotations

import pytest

from moar_companion.service.recording.calls import START
from tests.flights.lockstep import Lockstep
from tests.flights.operator import EVACUATION, INSPECTION


def replayed(flight, companion, *, pieces):
    """Sent packets of a fresh companion that is fed a recorded flight's inputs."""
    sent = []
    for call in flight.calls:
        if call.method == "receive":
            link, data, time_s = call.arguments
            for begin in range(0, len(data), pieces):
                companion.receive(link, data[begin : begin + pieces], time_s)
        elif call.method == "data_to_send":
            sent += [data for _, data in companion.data_to_send()]
        elif call.method != START:
            getattr(companion, call.method)(*call.arguments)
    return sent


@pytest.mark.slow
def test_a_recorded_flight_is_sent_again_byte_for_byte_with_any_split_of_its_bytes():
    flight = Lockstep(vehicle="x500")
    flight.begin(INSPECTION)
    flight.autopilot.conditions.wind_mps = 6.0
    flight.run(4.0)
    flight.operator.mission(EVACUATION)
    flight.run(2.0)
    flight.operator.pause()
    flight.run(1.0)
    assert len(flight.setpoints) > 300
    sent = [data for _, data in flight.to_autopilot]
    assert replayed(flight, flight.new_companion(), pieces=7) == sent


@pytest.mark.slow
def test_the_same_flight_twice_is_the_same_flight():
    def flown():
        flight = Lockstep(vehicle="x500", options={"seed": 7})
        flight.begin(INSPECTION)
        flight.run(1.0)
        return flight

    one, two = flown(), flown()
    assert one.to_autopilot == two.to_autopilot
    assert one.truths == two.truths

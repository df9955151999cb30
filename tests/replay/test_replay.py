"""The same inputs at the same times give the same outputs, byte for byte."""

from __future__ import annotations

from tests.flights.lockstep import COMPANION_LINK, Lockstep
from tests.flights.operator import EVACUATION, INSPECTION


def replayed(flight, companion, *, pieces=None):
    """What a fresh companion sends when it is fed a recorded flight's inputs."""
    sent = []
    for kind, time_s, what in flight.inputs:
        if kind == "bytes":
            size = pieces or len(what)
            for begin in range(0, len(what), size):
                companion.receive(COMPANION_LINK, what[begin : begin + size], time_s)
        elif kind == "contingency":
            companion.contingency_answered(what)
        elif kind == "answer":
            companion.plan_answered(what)
        else:
            companion.tick(time_s)
            sent += [(time_s, data) for _, data in companion.data_to_send()]
    return sent


def test_a_recorded_flight_is_sent_again_byte_for_byte_however_its_bytes_are_split():
    flight = Lockstep(vehicle="x500")
    flight.begin(INSPECTION)
    flight.autopilot.conditions.wind_mps = 6.0
    flight.run(8.0)
    flight.operator.mission(EVACUATION)
    flight.run(4.0)
    flight.operator.pause()
    flight.run(2.0)
    assert len(flight.setpoints) > 500
    assert replayed(flight, flight.new_companion()) == flight.to_autopilot
    assert replayed(flight, flight.new_companion(), pieces=7) == flight.to_autopilot


def test_the_same_flight_twice_is_the_same_flight():
    def flown():
        flight = Lockstep(vehicle="x500", options={"seed": 7})
        flight.begin(INSPECTION)
        flight.run(5.0)
        return flight

    one, two = flown(), flown()
    assert one.to_autopilot == two.to_autopilot
    assert one.truths == two.truths

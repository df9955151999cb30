"""The mission machine: a task without a path is held, and planned again when there is room."""

from __future__ import annotations

import pytest

from moar_companion.companion.mission import state_machine
from moar_companion.companion.mission.values import FlightEffect, Order
from moar_companion.companion.mission_states import MissionState

from .stories import EVACUATION, EXIT, INSPECTION, story

S = MissionState
NARROW = {"no_clearance": "the target is too close, uncertainty 1.6 m"}


def no_room(flight):
    """Fails the awaited plan for lack of room, with its condition."""
    flight._took(
        state_machine.unplanned(flight.status, NARROW["no_clearance"], flight.now_s, waits=True)
    )
    flight.said_then = flight.said
    return flight.see(**NARROW)


def test_the_next_target_waits_until_there_is_room():
    flight = no_room(story(S.AT_TARGET).tick(6.0))
    rest = flight.status.task
    assert (flight.state, rest.stops) == ("holding", INSPECTION.stops[1:])
    assert FlightEffect.BRAKE not in flight.effects, "at a target the nose stays"
    assert flight.said_then[-1].endswith(", holding")
    flight.tick(60.0)
    assert (flight.state, flight.requested) == ("holding", [])
    flight.see(no_clearance=None).tick(0.9)
    assert flight.requested == []
    assert flight.tick(0.2).requested == [rest]
    assert flight.plan_found().state == "flying"


def test_an_inspection_that_flies_brakes_where_there_is_no_room_for_its_escape_route():
    """The answer comes after the battery's condition has cleared."""
    flight = story(S.FLYING).see(battery_reserve="battery 0 at 20% <= 20%").tick(3.1)
    assert flight.requested == [EXIT]
    flight.see(battery_reserve=None)
    flight._took(state_machine.unplanned(flight.status, "no room", flight.now_s, waits=True))
    assert flight.state == "holding"
    assert FlightEffect.BRAKE in flight.effects


@pytest.mark.parametrize("way", [EXIT, EVACUATION])
def test_a_held_escape_route_waits_until_there_is_room(way):
    flight = story(S.FLYING, way).see(**NARROW).see(no_clearance=None).tick(1.1)
    no_room(flight)
    assert flight.said_then[-1].endswith(", holding")
    assert (flight.state, flight.status.no_path) == ("holding", frozenset())
    flight.see(no_clearance=None).tick(1.1)
    assert flight.requested == [way]


def test_a_hold_ordered_during_the_wait_does_not_resume():
    flight = no_room(story(S.AT_TARGET).tick(6.0))
    flight.order(Order.HOLD).see(no_clearance=None).tick(60.0)
    assert (flight.state, flight.requested) == ("holding", [])


def test_an_order_without_room_is_denied_and_does_not_wait():
    flight = story(S.HOLDING)
    flight.order(EXIT)
    no_room(flight)
    flight.see(no_clearance=None).tick(60.0)
    assert (flight.state, flight.requested) == ("holding", [])


def test_without_a_reported_condition_the_target_is_planned_once_a_second():
    flight = story(S.AT_TARGET).tick(6.0)
    count = 0
    for _ in range(500):
        if flight.status.requested is not None:
            count += 1
            flight._took(
                state_machine.unplanned(flight.status, "no room", flight.now_s, waits=True)
            )
        flight.tick(0.02)
    assert 9 <= count <= 11

"""Stories of targets with views: when they are done, and what follows a failure."""

from __future__ import annotations

from dataclasses import replace

from moar_companion.companion.mission.values import LeaveOut, Order
from moar_companion.companion.mission_states import MissionState
from moar_companion.settings.config import OnFailure

from .stories import INSPECTION, story

VIEWS = replace(INSPECTION, stops=("first/1", "first/2", "second"))
FULL = "camera card full"


def at_view(on_failure=OnFailure.HOLD):
    flight = story(MissionState.AT_TARGET, VIEWS)
    flight.on_failure = on_failure
    return flight.see(arrived=True, view_pending=True, view_others=("first/1", "first/2"))


def stops(flight):
    return [task.stops for task in flight.requested]


def test_a_view_is_left_when_it_is_captured_and_its_dwell_is_over():
    flight = at_view()
    flight.tick(60.0)
    assert flight.requested == []
    flight.see(view_pending=False)
    assert stops(flight) == [("first/2", "second")]


def test_a_failed_view_holds_and_continue_begins_it_again():
    flight = at_view()
    flight.see(view_pending=False, view_failed=FULL)
    assert flight.state == "holding"
    assert flight.said[-1] == "MOAR: camera card full, holding"
    flight.tick(60.0)
    assert flight.state == "holding"
    flight.order(Order.CONTINUE)
    assert stops(flight) == [VIEWS.stops]


def test_a_failed_view_is_left_out_alone_or_with_its_target():
    for on_failure, left, action in (
        (OnFailure.CONTINUE, ("first/2", "second"), "view skipped"),
        (OnFailure.SKIP, ("second",), "target skipped"),
    ):
        flight = at_view(on_failure)
        flight.see(view_pending=False, view_failed=FULL)
        assert stops(flight) == [left]
        assert f"MOAR: camera card full, {action}" in flight.said


def test_the_other_views_of_a_skipped_target_are_missing_too():
    flight = story(MissionState.AT_TARGET, replace(VIEWS, stops=("first/1", "first/2", "first/3")))
    flight.on_failure = OnFailure.SKIP
    others = ("first/1", "first/2", "first/3")
    flight.see(arrived=True, view_failed=FULL, view_others=others, views_missing=1)
    assert LeaveOut(("first/2", "first/3"), FULL) in flight.effects
    assert "MOAR: stops not done: 3, holding" in flight.said


def test_an_inspection_with_missing_views_ends_with_their_number():
    flight = story(MissionState.AT_TARGET, replace(INSPECTION, stops=("first/1",)))
    flight.see(arrived=True, views_missing=2).tick(10.0)
    assert flight.state == "holding"
    assert "MOAR: stops not done: 2, holding" in flight.said

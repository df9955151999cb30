"""Missing measurements in texts; an order overrides only conditions reported before it."""

from __future__ import annotations

import pytest

from moar_companion.types import Mission

from .desk import (
    ACCEPTED,
    EVACUATION,
    INSPECTION,
    PAUSE_CONTINUE,
    STEP_S,
    TEMPORARILY_REJECTED,
    Desk,
)


def flown(desk):
    return desk.companion.status.task.mission


def act(desk, name, seconds=5.0):
    """Runs until a condition acts."""
    for _ in range(round(seconds / STEP_S)):
        if any(item.condition.name == name for item in desk.companion.ruling.conditions):
            return desk
        desk.step()
    raise AssertionError(f"{name} does not act")


@pytest.fixture
def desk():
    return Desk().set(accuracy_m=0.3, reset_counter=0).come_to("flying", then_s=3.0)


# Orders that cross with a condition -------------------------------------------------------------


@pytest.mark.parametrize("seconds", [STEP_S, 0.4])
def test_a_hold_that_crosses_a_critical_battery_holds_until_the_evacuation_begins(desk, seconds):
    act(desk.set(charge_state=3), "battery_critical").run(seconds).pause().step()
    assert (desk.state, desk.answers(PAUSE_CONTINUE)) == ("holding", [ACCEPTED])
    desk.run(2.0)
    assert (desk.state, flown(desk)) == ("flying", Mission.EVACUATION)
    desk.pause().run(4.0)  # the operator has received the text
    assert desk.state == "holding"


def test_a_hold_overrides_the_condition_that_was_reported_before_it(desk):
    act(desk.set(charge_state=3), "battery_critical").run(0.6).pause().run(4.0)
    assert desk.state == "holding"


@pytest.mark.parametrize("mission", [None, INSPECTION, EVACUATION])
def test_a_flight_ordered_just_as_the_position_jumps_is_rejected_with_the_reason(desk, mission):
    desk.pause().run(2.0).jump(0.0, -2.0, -4.0).set(reset_counter=1)
    act(desk, "position_jump").step()
    order = desk.order(mission) if mission else desk.go_on()
    order.run(2.1)
    answers = desk.answers() if mission else desk.answers(PAUSE_CONTINUE)
    assert (desk.state, answers[-1]) == ("holding", TEMPORARILY_REJECTED)
    assert desk.said("the position jumped 4.5 m > 0.9, rejected")
    desk.go_on().run(0.5)  # the operator has received the text
    assert (desk.state, desk.answers(PAUSE_CONTINUE)[-1]) == ("flying", ACCEPTED)


def test_the_escape_route_that_the_supervisor_has_just_begun_may_be_ordered_as_well(desk):
    act(desk.set(charge_state=3), "battery_critical").order(EVACUATION).run(0.5)
    assert (desk.answers()[-1], flown(desk)) == (ACCEPTED, Mission.EVACUATION)


# Texts ------------------------------------------------------------------------------------------


TROUBLE = {
    "a jump": ({}, "MOAR: the position jumped 4.5 m > 0.9, holding"),
    "no fix": ({"fix_type": 0}, "MOAR: GNSS receiver has no 3D fix, holding"),
    "wind": ({"wind_mps": 21.4}, "MOAR: wind reported 21.4 m/s > 15, holding"),
}


@pytest.mark.parametrize("trouble", TROUBLE)
def test_a_condition_that_begins_while_an_operator_holds_is_reported_once(desk, trouble):
    changes, words = TROUBLE[trouble]
    desk.pause().run(2.0).set(**changes)
    if trouble == "a jump":
        desk.jump(0.0, -2.0, -4.0).set(reset_counter=1)
    desk.run(8.0)
    assert desk.state == "holding"
    assert desk.texts().count(words) == 1


@pytest.mark.slow
def test_the_end_of_a_condition_while_an_operator_holds_is_reported(desk):
    desk.pause().run(2.0).set(wind_mps=21.4).run(5.0).set(wind_mps=2.0).run(8.0)
    assert desk.said("MOAR: wind reported 21.4 m/s > 15, over")


def test_a_condition_that_holds_the_mission_is_reported_once_with_its_action(desk):
    desk.set(wind_mps=21.4).run_until("holding").run(2.0).set(wind_mps=2.0).run_until("flying", 9.0)
    assert [text for text in desk.texts() if "wind" in text] == [
        "MOAR: wind reported 21.4 m/s > 15, holding"
    ]


def test_a_condition_that_an_escape_route_overrides_is_reported(desk):
    desk.set(battery_percent=15).run_until_requested("exit").run(1.0).set(wind_mps=21.4).run(5.0)
    assert (desk.state, flown(desk)) == ("landing_leg", Mission.EXIT)
    assert desk.said("MOAR: wind reported 21.4 m/s")


@pytest.mark.slow
def test_a_condition_that_still_holds_is_not_reported_as_over(desk):
    desk.plan_delay_s = None
    desk.run_until("holding", 20.0).run(5.0)
    assert desk.said("MOAR: no new plan for")
    assert desk.said("MOAR: no new plan for over 12 s, holding")
    assert not desk.said(", over")

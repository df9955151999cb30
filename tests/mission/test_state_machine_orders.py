"""The mission machine: orders of an operator and their answers."""

from __future__ import annotations

import pytest

from moar_companion.companion.mission.state_machine import restarted
from moar_companion.companion.mission.values import FlightEffect, Order
from moar_companion.companion.mission_states import IN_CONTROL, STREAMING, MissionState
from moar_companion.companion.safety.condition_types import Action
from moar_companion.companion.safety.conditions import CONDITIONS

from .stories import (
    EVACUATION,
    EXIT,
    FAILSAFE,
    IN_THE_AIR,
    INSPECTION,
    LANDED_STATE_UNKNOWN,
    LAST,
    ON_THE_GROUND,
    STALE,
    any_story,
    story,
)

S = MissionState
IN_FLIGHT = sorted(IN_CONTROL)

# Orders -----------------------------------------------------------------------------------------

ORDERS = {
    "mission": EXIT,
    "hold": Order.HOLD,
    "continue": Order.CONTINUE,
    "release": Order.RELEASE,
}
# state: (state after, answer at once; "" where the plan is awaited, last setpoint) of each order.
NO = "temporarily rejected"
OK = "accepted"
ANSWERS = {
    S.IDLE: {
        "mission": ("planning", "", False),
        "hold": ("idle", NO, False),
        "continue": ("idle", NO, False),
        "release": ("idle", OK, False),
    },
    S.PLANNING: {
        "mission": ("planning", "", False),
        "hold": ("idle", OK, False),
        "continue": ("planning", NO, False),
        "release": ("released", OK, False),
    },
    S.READY: {
        "mission": ("ready", "", False),
        "hold": ("ready", OK, False),
        "continue": ("ready", NO, False),
        "release": ("released", OK, True),
    },
    S.FLYING: {
        "mission": ("flying", "", False),
        "hold": ("holding", OK, False),
        "continue": ("flying", NO, False),
        "release": ("released", OK, True),
    },
    S.AT_TARGET: {
        "mission": ("at_target", "", False),
        "hold": ("holding", OK, False),
        "continue": ("at_target", NO, False),
        "release": ("released", OK, True),
    },
    S.LANDING_LEG: {
        "mission": ("landing_leg", "", False),
        "hold": ("holding", OK, False),
        "continue": ("landing_leg", NO, False),
        "release": ("released", OK, True),
    },
    S.HOLDING: {
        "mission": ("holding", "", False),
        "hold": ("holding", OK, False),
        "continue": ("holding", "", False),
        "release": ("released", OK, True),
    },
    S.OVERRIDDEN: {
        "mission": ("planning", "", False),
        "hold": ("overridden", OK, False),
        "continue": ("planning", "", False),
        "release": ("released", OK, False),
    },
    S.RELEASED: {
        "mission": ("planning", "", False),
        "hold": ("released", NO, False),
        "continue": ("planning", "", False),
        "release": ("released", OK, False),
    },
}


@pytest.mark.parametrize("word", ORDERS)
@pytest.mark.parametrize("state", list(S))
def test_every_order_has_its_answer_in_every_state(state, word):
    flight = any_story(state)
    flight.order(ORDERS[word])
    after, answer, last_setpoint = ANSWERS[state][word]
    assert flight.state == after
    ours = [verdict for number, verdict in flight.answers if number == flight.last_id]
    assert ours == ([answer] if answer else [])
    assert flight.last_setpoint is last_setpoint
    assert bool(flight.requested) is (not answer)
    # Where the stream ends, a last setpoint is sent.
    if state in STREAMING and not flight.streaming:
        assert flight.last_setpoint


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (ON_THE_GROUND, "not in the air"),
        (LANDED_STATE_UNKNOWN, "not in the air"),
        ({"position": "no local position is received"}, "no local position is received"),
        ({"off_plane": "3.0 m from the plane > 2"}, "3.0 m from the plane"),
    ],
)
def test_a_mission_is_rejected_while_a_condition_prevents_its_start(change, reason):
    flight = story(S.IDLE).see(**change)
    flight.order(INSPECTION)
    assert (flight.state, flight.requested) == ("idle", [])
    assert flight.answers == [(1, "temporarily rejected")]
    assert reason in flight.reasons[0]


@pytest.mark.parametrize(
    "change",
    [
        {"tracking_lost": True},
        {"not_hovering": "moving at 3.0 m/s > 1, hover"},
        LANDED_STATE_UNKNOWN,
    ],
)
def test_a_plan_is_rejected_when_the_aircraft_has_left_its_start(change):
    flight = story(S.PLANNING).see(**change)
    assert flight.state == "planning"
    flight.plan_found()
    assert flight.state == "idle"
    assert flight.answers == [(1, "temporarily rejected")]
    assert not flight.streaming


@pytest.mark.parametrize("state", [S.PLANNING, *IN_FLIGHT])
def test_a_second_order_while_a_plan_is_made_cancels_the_first(state):
    flight = any_story(state)
    if state is not S.PLANNING:
        flight.order(EXIT)
    first = flight.last_id
    flight.order(EVACUATION)
    assert flight.answers == [(first, "cancelled")]
    assert flight.requested == [EVACUATION]
    flight.plan_found()
    assert flight.answers == [(first + 1, "accepted")]
    assert flight.status.task == EVACUATION


@pytest.mark.parametrize("order", [Order.HOLD, Order.RELEASE])
def test_hold_and_release_end_the_wait_for_a_plan(order):
    flight = story(S.FLYING)
    flight.order(EXIT)
    flight.order(order)
    assert flight.answers == [(2, "cancelled"), (3, "accepted")]
    assert flight.plan_found().effects == []


@pytest.mark.parametrize("order", [Order.HOLD, Order.RELEASE])
@pytest.mark.parametrize("state", [S.PLANNING, S.READY])
def test_hold_and_release_cancel_an_order_before_the_flight_too(state, order):
    flight = story(state)
    if state is S.READY:
        flight.order(EXIT)
    replaced = flight.last_id
    flight.order(order)
    assert flight.answers == [(replaced, "cancelled"), (replaced + 1, "accepted")]
    assert flight.plan_found().effects == []


# Ready ------------------------------------------------------------------------------------------


def test_ready_expires_only_by_a_mode_received_after_the_deadline():
    flight = story(S.READY)
    flight.deaf = True
    flight.tick(29.5)
    flight.tick(2.0)  # the mode may have changed since: its heartbeat has not arrived
    assert flight.state == "ready"
    flight.deaf = False
    flight.see(mode_ours=True)
    assert flight.state == "flying"


def test_a_hold_while_ready_keeps_streaming_and_holds_when_the_mode_is_given():
    flight = story(S.READY).order(Order.HOLD)
    assert (flight.state, flight.answers) == ("ready", [(2, "accepted")])
    assert FlightEffect.BRAKE in flight.effects
    assert flight.said == ["MOAR: ready to hold"]
    flight.see(mode_ours=True)
    assert (flight.state, flight.requested) == ("holding", [])
    flight.tick(60.0)
    assert flight.state == "holding"
    flight.order(Order.CONTINUE)
    assert flight.requested == [INSPECTION]
    assert flight.plan_found().state == "flying"


def test_a_hold_while_ready_is_continued_before_the_mode_is_given():
    flight = story(S.READY).order(Order.HOLD).order(Order.CONTINUE)
    assert (flight.state, flight.requested, flight.answers) == ("ready", [INSPECTION], [])
    flight.plan_found()
    assert (flight.state, flight.answers) == ("ready", [(3, "accepted")])
    assert flight.see(mode_ours=True).state == "flying"


def test_a_hold_while_ready_expires_after_the_same_time():
    flight = story(S.READY).order(Order.HOLD).tick(30.1)
    assert (flight.state, flight.last_setpoint) == ("idle", True)
    flight.order(Order.CONTINUE)
    assert flight.reasons == ["nothing is held"]


def test_a_mission_ordered_while_ready_is_planned_while_the_stream_goes_on():
    flight = story(S.READY).tick(20.0)
    flight.order(EXIT)
    assert (flight.state, flight.requested) == ("ready", [EXIT])
    flight.plan_found()
    assert (flight.state, flight.status.task, flight.answers) == ("ready", EXIT, [(2, "accepted")])
    flight.tick(29.0)  # ready again
    assert flight.state == "ready"


def test_a_mission_not_found_while_ready_leaves_the_ready_mission():
    flight = story(S.READY).tick(20.0).order(EXIT)
    flight.plan_failed()
    assert (flight.state, flight.status.task, flight.answers) == (
        "ready",
        INSPECTION,
        [(2, "denied")],
    )
    assert flight.tick(10.1).state == "idle"


def test_a_mode_given_during_planning_flies_the_ready_mission_and_then_the_new_one():
    flight = story(S.READY).order(EXIT).see(mode_ours=True)
    assert (flight.state, flight.status.task) == ("flying", INSPECTION)
    flight.plan_found()
    assert (flight.state, flight.status.task, flight.answers) == ("flying", EXIT, [(2, "accepted")])


# Resumed ------------------------------------------------------------------------------------------


def no_plan(flight):
    flight.plan_failed()


def taken_back(flight):
    flight.take_back()


def moved_away(flight):
    flight.change(tracking_lost=True)
    flight.plan_found()
    flight.change(tracking_lost=False)


def position_uncertain(flight):
    flight.see(uncertainty="uncertainty 3.0 m > 2").tick(10.0)
    flight.see(uncertainty=None).tick(60.0)


def after_a_restart():
    flight = story(S.IDLE)
    flight.status = restarted(INSPECTION)
    return flight


def after_a_takeover():
    return story(S.OVERRIDDEN)


def after_a_passing_release():
    return story(S.RELEASED)


BEGUN = [after_a_restart, after_a_takeover, after_a_passing_release]


@pytest.mark.parametrize("begun", BEGUN)
@pytest.mark.parametrize("ends", [no_plan, taken_back, moved_away, position_uncertain])
@pytest.mark.parametrize("order", [Order.CONTINUE, EXIT])
def test_a_resumable_mission_outlives_an_order_that_is_not_flown(begun, ends, order):
    flight = begun().order(order)
    ends(flight)
    assert flight.state == "idle"
    flight.order(Order.CONTINUE)
    assert (flight.state, flight.requested) == ("planning", [INSPECTION])
    flight.plan_found()
    assert (flight.state, flight.status.task) == ("ready", INSPECTION)


@pytest.mark.parametrize("begun", BEGUN)
def test_a_resumable_mission_outlives_a_mode_that_is_not_given(begun):
    flight = begun().order(Order.CONTINUE).plan_found()
    assert flight.state == "ready"
    flight.tick(31.0)
    assert (flight.state, flight.status.task) == ("idle", INSPECTION)
    flight.order(Order.CONTINUE)
    assert (flight.state, flight.requested) == ("planning", [INSPECTION])


@pytest.mark.parametrize("begun", BEGUN)
def test_a_release_or_a_landing_drops_the_resumable_mission(begun):
    for forget, reason in (
        (lambda flight: flight.order(Order.RELEASE), "nothing is held"),
        (
            lambda flight: flight.see(**ON_THE_GROUND).see(**IN_THE_AIR),
            "the landing ended the mission",
        ),
    ):
        flight = begun().order(Order.CONTINUE).plan_failed()
        assert flight.status.task == INSPECTION
        forget(flight)
        flight.order(Order.CONTINUE)
        assert flight.reasons == [reason]


def test_a_mission_ended_on_the_ground_is_not_resumed_after_a_denied_order():
    flight = story(S.FLYING).see(**ON_THE_GROUND).see(**IN_THE_AIR).tick(1.0)
    flight.order(EXIT).plan_failed()
    flight.order(Order.CONTINUE)
    assert flight.reasons == ["the landing ended the mission"]


def test_a_landing_after_a_release_drops_the_rest():
    flight = story(S.RELEASED).see(**ON_THE_GROUND)
    assert (flight.state, flight.status.task) == ("released", None)
    flight.see(**IN_THE_AIR).order(Order.CONTINUE)
    assert flight.reasons == ["the landing ended the mission"]
    flight.order(INSPECTION).plan_found().order(Order.RELEASE)
    flight.order(Order.CONTINUE)
    assert flight.reasons == ["nothing is held"]


PASSING = [
    "loop_stall",
    "autopilot_link_lost",
    "mode_unconfirmed",
    "position",
    "origin",
    "attitude",
]
RELEASES = [
    row.name for row in CONDITIONS if row.action is Action.RELEASE and row.rest is S.RELEASED
]


@pytest.mark.parametrize("state", [*IN_FLIGHT, S.READY, S.OVERRIDDEN])
@pytest.mark.parametrize("name", RELEASES)
def test_late_or_missing_data_keep_the_rest_of_a_mission_and_no_other_release_does(name, state):
    flight = any_story(state)
    task = flight.status.task
    flight.see(**{name: "trouble"})
    assert flight.state == "released"
    if name in PASSING:
        assert flight.said[-1] == "MOAR: order continue to fly the rest"
    flight.see(**{name: None}).tick(1.0).order(Order.CONTINUE)
    assert flight.requested == ([task] if name in PASSING else [])
    assert flight.reasons == ([] if name in PASSING else ["nothing is held"])


@pytest.mark.parametrize("other", ["autopilot_reboot", "setpoint_rejected", "autopilot_identity"])
def test_a_fault_beside_a_stall_drops_the_rest(other):
    flight = story(S.FLYING).see(loop_stall="control loop stalled 3.0 s", **{other: "fault"})
    assert (flight.state, flight.status.task) == ("released", None)


def test_a_failsafe_that_a_stall_has_caused_keeps_the_rest():
    flight = story(S.FLYING)
    flight.see(loop_stall="control loop stalled 3.0 s", mode_ours=False, **FAILSAFE)
    assert (flight.state, flight.status.task) == ("released", INSPECTION)


def test_continue_is_rejected_while_the_passing_cause_lasts():
    flight = story(S.FLYING).see(**STALE).tick(1.0).order(Order.CONTINUE)
    assert flight.reasons == ["position age 0.6 s"]
    assert flight.status.task == INSPECTION


def test_the_rest_outlives_a_second_passing_release_while_it_is_planned():
    flight = story(S.RELEASED).order(Order.CONTINUE).see(loop_stall="control loop stalled 0.6 s")
    assert (flight.state, flight.answers) == ("released", [(2, "failed")])
    flight.see(loop_stall=None).tick(1.0).order(Order.CONTINUE)
    assert flight.requested == [INSPECTION]


def test_a_returned_mode_resumes_no_mission_that_a_passing_cause_has_released():
    flight = story(S.OVERRIDDEN, resume=True).see(**STALE).see(position=None)
    flight.see(mode_ours=True).tick(5.0)
    assert (flight.state, flight.status.task) == ("released", INSPECTION)


# In flight ----------------------------------------------------------------------------------------


def test_planning_is_reported_in_a_text():
    assert story(S.PLANNING).said == ["MOAR: planning inspection"]


def test_a_hold_brakes_and_a_continue_plans_the_rest_of_the_mission():
    flight = story(S.FLYING)
    flight.order(Order.HOLD)
    assert flight.state == "holding"
    assert FlightEffect.BRAKE in flight.effects
    flight.tick(600.0)
    assert flight.state == "holding"
    flight.order(Order.CONTINUE)
    assert (flight.state, flight.requested, flight.answers) == ("holding", [INSPECTION], [])
    flight.plan_found()
    assert (flight.state, flight.answers) == ("flying", [(3, "accepted")])


def test_a_hold_at_a_target_ends_its_dwell():
    flight = story(S.AT_TARGET)
    flight.order(Order.HOLD)
    flight.tick(60.0)
    assert flight.state == "holding"
    assert flight.status.task == INSPECTION


@pytest.mark.parametrize("state", IN_FLIGHT)
def test_in_flight_a_mission_without_a_plan_is_denied_and_the_flown_one_continues(state):
    flight = any_story(state)
    task = flight.status.task
    flight.order(EVACUATION)
    flight.plan_failed("no landing point can be seen")
    assert flight.answers == [(flight.last_id, "denied")]
    assert flight.reasons == ["no landing point can be seen"]
    assert flight.status.state is state
    assert flight.status.task == task
    assert flight.status.requested is None


def test_a_next_target_without_a_plan_is_a_hold_and_planned_again_on_continue():
    flight = story(S.AT_TARGET).tick(6.0)
    assert flight.requested == [LAST]
    flight.plan_failed()
    assert (flight.state, flight.answers) == ("holding", [])
    flight.order(Order.CONTINUE)
    assert flight.requested == [LAST]
    flight.plan_found()
    assert flight.state == "flying"


def test_an_order_denied_during_the_dwell_keeps_the_next_target():
    flight = story(S.AT_TARGET)
    flight.order(EVACUATION)
    flight.plan_failed()
    flight.tick(6.0)
    assert (flight.state, flight.requested) == ("at_target", [LAST])


@pytest.mark.parametrize("state", [S.FLYING, S.LANDING_LEG, S.HOLDING])
def test_a_mission_switched_in_flight_is_flown_without_a_new_mode(state):
    flight = any_story(state).order(EVACUATION)
    assert flight.status.state is state
    flight.plan_found()
    assert (flight.state, flight.status.task) == ("flying", EVACUATION)


def test_a_mission_ordered_in_flight_is_still_awaited_at_the_target():
    flight = story(S.FLYING)
    flight.order(EXIT)
    flight.see(arrived=True)
    assert flight.state == "at_target"
    flight.plan_found()
    assert (flight.state, flight.status.task, flight.answers) == ("flying", EXIT, [(2, "accepted")])


# Cancelled --------------------------------------------------------------------------------------


def test_an_order_cancelled_while_planned_is_idle():
    flight = story(S.PLANNING).take_back()
    assert flight.state == "idle"
    assert flight.plan_found().state == "idle"


def test_an_order_cancelled_in_flight_changes_nothing():
    flight = story(S.FLYING)
    flight.order(EXIT)
    flight.take_back()
    assert (flight.state, flight.status.task, flight.status.requested) == (
        "flying",
        INSPECTION,
        None,
    )
    assert flight.plan_found().status.task == INSPECTION


def test_only_the_awaited_order_can_be_cancelled():
    flight = story(S.FLYING)
    flight.order(EXIT)
    flight.order(EVACUATION)
    flight.take_back(2)
    assert flight.status.requested == EVACUATION

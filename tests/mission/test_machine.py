"""The mission machine: the contract's table of states, told as stories."""

from __future__ import annotations

import pytest

from moar_companion.mission.machine import IN_CONTROL, STREAMING, Do, MissionState, Order

from .stories import (
    EVACUATION,
    EXIT,
    INSPECTION,
    LAST,
    NOBODY_KNOWS,
    ON_THE_GROUND,
    any_story,
    story,
)

S = MissionState
IN_FLIGHT = sorted(IN_CONTROL)
STREAMED = sorted(STREAMING)
SILENT = [S.IDLE, S.PLANNING, S.OVERRIDDEN, S.RELEASED]

# The whole way ----------------------------------------------------------------------------------


def test_an_inspection_of_two_targets_from_the_order_to_the_hold_at_its_end():
    flight = story(S.IDLE)
    flight.order(INSPECTION)
    assert (flight.state, flight.sought) == ("planning", [INSPECTION])
    flight.plan_found()
    assert (flight.state, flight.answers) == ("ready", [(1, "accepted")])
    flight.see(mode_ours=True)  # the pilot gives OFFBOARD
    assert flight.state == "flying"
    flight.see(arrived=True, dwell_s=5.0)
    assert flight.state == "at_target"
    flight.tick(4.9)
    assert (flight.state, flight.sought) == ("at_target", [])
    flight.tick(0.2)  # the dwell is over: the next target's plan is made while it holds
    assert (flight.state, flight.sought) == ("at_target", [LAST])
    flight.plan_found()
    assert (flight.state, flight.answers) == ("flying", [])
    assert flight.status.task == LAST
    flight.see(arrived=False)
    flight.see(arrived=True)
    assert flight.state == "at_target"
    flight.tick(5.1)
    assert flight.state == "holding"
    assert "every target is done" in flight.said
    flight.order(Order.CONTINUE)
    assert flight.answers == [(2, "temporarily rejected")]
    assert flight.reasons == ["nothing is left to fly"]


@pytest.mark.parametrize("task", [EXIT, EVACUATION])
def test_a_way_out_ends_above_its_landing_point_and_asks_for_the_landing(task):
    flight = story(S.FLYING, task)
    flight.see(on_leg=True)
    assert flight.state == "landing_leg"
    flight.see(arrived=True)
    assert flight.state == "holding"
    assert Do.LAND in flight.effects
    assert flight.streaming
    flight.tick(60.0)
    assert flight.state == "holding"
    assert Do.LAND not in flight.effects


def test_a_way_out_without_a_leg_of_any_length_arrives_too():
    flight = story(S.FLYING, EXIT).see(arrived=True)
    assert flight.state == "holding"
    assert Do.LAND in flight.effects


# Left by ----------------------------------------------------------------------------------------


def test_idle_and_released_do_nothing_whatever_the_world_does():
    for state in (S.IDLE, S.RELEASED):
        flight = any_story(state)
        for change in (
            {"mode_ours": True},
            {"arrived": True, "on_leg": True},
            {"autopilot_failsafe": True},
            {"autopilot_failsafe": False},
            ON_THE_GROUND,
            {"airborne": True, "grounded": False},
        ):
            flight.see(**change)
            assert (flight.status.state, flight.effects) == (state, [])


def test_a_first_plan_that_is_not_found_ends_idle_and_denied_with_the_reason():
    flight = story(S.PLANNING).plan_failed("the goal cannot be reached")
    assert flight.state == "idle"
    assert flight.answers == [(1, "denied")]
    assert flight.reasons == ["the goal cannot be reached"]
    assert not any("the goal" in text for text in flight.said)  # once: with the answer


def test_ready_expires_after_its_time_with_a_last_setpoint_at_rest():
    flight = story(S.READY)
    flight.tick(29.9)
    assert flight.state == "ready"
    flight.tick(0.2)
    assert flight.state == "idle"
    assert flight.farewell


def test_planning_for_ever_is_no_state_to_expire():
    flight = story(S.PLANNING).tick(300.0)
    assert flight.state == "planning"
    flight.plan_found()
    assert flight.state == "ready"
    flight.tick(29.0)
    assert flight.state == "ready"


@pytest.mark.parametrize("state", IN_FLIGHT)
def test_the_pilot_takes_the_mode_silent_at_once_and_without_a_farewell(state):
    flight = any_story(state).see(mode_ours=False)
    assert flight.state == "overridden"
    assert not flight.farewell
    assert not flight.streaming


def test_a_mode_given_back_is_not_flown_without_a_new_command():
    flight = story(S.OVERRIDDEN).see(mode_ours=True)
    for _ in range(100):
        flight.tick(1.0)
        assert (flight.state, flight.effects) == ("overridden", [])
    flight.order(INSPECTION)
    assert (flight.state, flight.sought) == ("planning", [INSPECTION])


def test_with_resume_a_mode_given_back_is_flown_again():
    flight = story(S.OVERRIDDEN, resume=True).tick(10.0)
    assert flight.state == "overridden"
    flight.see(mode_ours=True)
    assert (flight.state, flight.sought) == ("planning", [INSPECTION])
    flight.plan_found()
    flight.tick()
    assert flight.state == "flying"


def test_not_even_resume_comes_back_while_something_stands_against_it():
    flight = story(S.OVERRIDDEN, resume=True)
    flight.see(mode_ours=True, obstruction="the position is 0.7 s old")
    assert flight.state == "overridden"
    flight.see(obstruction=None)
    assert flight.state == "planning"


def test_not_even_resume_comes_back_from_an_autopilot_failsafe():
    flight = story(S.OVERRIDDEN, resume=True)
    flight.see(autopilot_failsafe=True)  # the battery, while the pilot flies
    flight.see(mode_ours=True)
    assert not flight.streaming
    assert flight.sought == []
    flight.see(autopilot_failsafe=False)  # PX4 goes back to its mode by itself
    for _ in range(5):
        flight.tick(1.0)
        assert flight.sought == []
    flight.order(INSPECTION)
    assert flight.state == "planning"


@pytest.mark.parametrize("state", [*STREAMED, S.PLANNING])
def test_an_autopilot_failsafe_releases(state):
    flight = any_story(state).see(autopilot_failsafe=True, mode_ours=False)
    assert flight.state == "released"
    assert not flight.farewell
    flight.see(autopilot_failsafe=False, mode_ours=True)  # PX4 resumes OFFBOARD by itself
    for _ in range(10):
        flight.tick(1.0)
        assert (flight.state, flight.effects) == ("released", [])


@pytest.mark.parametrize("parting", [True, False])
@pytest.mark.parametrize("state", [*STREAMED, S.PLANNING])
def test_stale_data_or_a_fault_releases_and_its_end_brings_nothing_back(state, parting):
    flight = any_story(state)
    flight.see(obstruction="no heartbeat of the autopilot for 3.1 s", parting=parting)
    assert flight.state == "released"
    assert flight.farewell is (parting and state in STREAMING)
    flight.see(obstruction=None)
    for _ in range(10):
        flight.tick(1.0)
        assert (flight.state, flight.effects) == ("released", [])


@pytest.mark.parametrize("state", [*STREAMED, S.PLANNING])
def test_on_the_ground_is_idle(state):
    flight = any_story(state).see(**ON_THE_GROUND)
    assert flight.state == "idle"
    assert not flight.farewell


@pytest.mark.parametrize("state", [*STREAMED, S.PLANNING])
def test_while_nobody_knows_whether_it_flies_what_is_flown_goes_on_and_nothing_is_begun(state):
    flight = any_story(state).see(**NOBODY_KNOWS)
    assert flight.status.state is state
    task = flight.status.task
    flight.order(EVACUATION)
    assert flight.answers == [(flight.last_id, "temporarily rejected")]
    assert flight.reasons == ["not in the air"]
    assert (flight.status.state, flight.status.task) == (state, task)


@pytest.mark.parametrize("state", [S.READY, S.FLYING])
def test_a_failsafe_that_the_operator_knew_of_does_not_release_but_the_next_one_does(state):
    flight = story(S.IDLE).see(autopilot_failsafe=True)  # low battery: the autopilot holds
    flight.order(EXIT)
    flight.plan_found()
    flight.tick()
    assert flight.state == "ready"
    flight.see(mode_ours=True, autopilot_failsafe=state is S.FLYING)
    assert flight.state == "flying"
    flight.see(autopilot_failsafe=False)
    flight.see(autopilot_failsafe=True)
    assert flight.state == "released"


def test_a_failsafe_between_the_order_and_its_plan_is_not_one_that_the_operator_knew_of():
    flight = story(S.PLANNING)
    # The plan comes before the next look at the world.
    flight.world = any_story(S.IDLE).see(autopilot_failsafe=True).world
    flight.plan_found()
    flight.tick()
    assert flight.state == "released"


def test_a_failsafe_while_the_next_target_is_planned_is_not_known_either():
    flight = story(S.AT_TARGET).tick(6.0)
    assert flight.sought == [LAST]
    flight.world = any_story(S.FLYING).see(autopilot_failsafe=True).world
    flight.plan_found()
    flight.tick()
    assert flight.state == "released"


def test_every_trouble_at_once_is_the_gravest():
    flight = story(S.FLYING)
    flight.see(obstruction="stale", autopilot_failsafe=True, mode_ours=False, **ON_THE_GROUND)
    assert flight.state == "released"
    assert any("stale" in text for text in flight.said)
    flight = story(S.FLYING).see(autopilot_failsafe=True, mode_ours=False)
    assert flight.state == "released"


def test_an_open_order_fails_when_the_flight_is_let_go():
    flight = story(S.FLYING)
    flight.order(EXIT)
    flight.see(mode_ours=False)
    assert flight.answers == [(2, "failed")]
    assert flight.plan_found().state == "overridden"


# Orders -----------------------------------------------------------------------------------------

ORDERS = {
    "mission": EXIT,
    "hold": Order.HOLD,
    "continue": Order.CONTINUE,
    "release": Order.RELEASE,
}
# state: (state after, answer at once; "" where the plan is awaited, farewell) of each order.
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
        "hold": ("overridden", NO, False),
        "continue": ("overridden", NO, False),
        "release": ("overridden", OK, False),
    },
    S.RELEASED: {
        "mission": ("planning", "", False),
        "hold": ("released", NO, False),
        "continue": ("released", NO, False),
        "release": ("released", OK, False),
    },
}


@pytest.mark.parametrize("word", ORDERS)
@pytest.mark.parametrize("state", list(S))
def test_every_order_has_its_answer_in_every_state(state, word):
    flight = any_story(state)
    flight.order(ORDERS[word])
    after, answer, farewell = ANSWERS[state][word]
    assert flight.state == after
    ours = [verdict for number, verdict in flight.answers if number == flight.last_id]
    assert ours == ([answer] if answer else [])
    assert flight.farewell is farewell
    assert bool(flight.sought) is (not answer)
    # Where the stream goes on or ends, the last setpoint is at rest or the path's.
    if state in STREAMING and not flight.streaming:
        assert flight.farewell


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (ON_THE_GROUND, "not in the air"),
        (NOBODY_KNOWS, "not in the air"),
        ({"obstruction": "no local position is heard"}, "no local position is heard"),
        ({"reluctance": "3.0 m from the plane, more than 2 m"}, "3.0 m from the plane"),
    ],
)
def test_a_mission_is_not_begun_when_something_stands_against_it(change, reason):
    flight = story(S.IDLE).see(**change)
    flight.order(INSPECTION)
    assert (flight.state, flight.sought) == ("idle", [])
    assert flight.answers == [(1, "temporarily rejected")]
    assert reason in flight.reasons[0]


def test_far_from_the_plane_what_is_flown_goes_on_and_a_new_mission_is_not_begun():
    flight = story(S.FLYING).see(reluctance="2.1 m from the plane, more than 2 m")
    assert flight.state == "flying"
    flight.order(EXIT)
    assert flight.answers == [(2, "temporarily rejected")]
    assert (flight.state, flight.status.task) == ("flying", INSPECTION)


@pytest.mark.parametrize("state", [S.PLANNING, *IN_FLIGHT])
def test_a_second_order_while_a_plan_is_made_cancels_the_first(state):
    flight = any_story(state)
    if state is not S.PLANNING:
        flight.order(EXIT)
    first = flight.last_id
    flight.order(EVACUATION)
    assert flight.answers == [(first, "cancelled")]
    assert flight.sought == [EVACUATION]
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
def test_hold_and_release_cancel_the_order_before_the_flight_too(state, order):
    flight = story(state)
    if state is S.READY:
        flight.order(EXIT)
    overtaken = flight.last_id
    flight.order(order)
    assert flight.answers == [(overtaken, "cancelled"), (overtaken + 1, "accepted")]
    assert flight.plan_found().effects == []


# Ready ------------------------------------------------------------------------------------------


def test_ready_expires_only_by_a_mode_heard_after_the_deadline():
    flight = story(S.READY)
    flight.deaf = True
    flight.tick(29.5)
    flight.tick(2.0)  # the mode may have been given since: its heartbeat is on the way
    assert flight.state == "ready"
    flight.deaf = False
    flight.see(mode_ours=True)
    assert flight.state == "flying"


def test_a_hold_while_ready_streams_on_and_holds_when_the_mode_is_given():
    flight = story(S.READY).order(Order.HOLD)
    assert (flight.state, flight.answers) == ("ready", [(2, "accepted")])
    assert Do.BRAKE in flight.effects
    assert flight.said == ["MOAR ready to hold"]
    flight.see(mode_ours=True)
    assert (flight.state, flight.sought) == ("holding", [])
    flight.tick(60.0)
    assert flight.state == "holding"
    flight.order(Order.CONTINUE)
    assert flight.sought == [INSPECTION]
    assert flight.plan_found().state == "flying"


def test_a_hold_while_ready_is_continued_before_the_mode_is_given():
    flight = story(S.READY).order(Order.HOLD).order(Order.CONTINUE)
    assert (flight.state, flight.sought, flight.answers) == ("ready", [INSPECTION], [])
    flight.plan_found()
    assert (flight.state, flight.answers) == ("ready", [(3, "accepted")])
    assert flight.see(mode_ours=True).state == "flying"


def test_a_hold_while_ready_expires_as_ready_does():
    flight = story(S.READY).order(Order.HOLD).tick(30.1)
    assert (flight.state, flight.farewell) == ("idle", True)
    flight.order(Order.CONTINUE)
    assert flight.reasons == ["nothing is held"]


def test_a_mission_ordered_while_ready_is_planned_while_the_stream_goes_on():
    flight = story(S.READY).tick(20.0)
    flight.order(EXIT)
    assert (flight.state, flight.sought) == ("ready", [EXIT])
    flight.plan_found()
    assert (flight.state, flight.status.task, flight.answers) == ("ready", EXIT, [(2, "accepted")])
    flight.tick(29.0)  # offered anew
    assert flight.state == "ready"


def test_a_mission_not_found_while_ready_leaves_it_as_it_was():
    flight = story(S.READY).tick(20.0).order(EXIT)
    flight.plan_failed()
    assert (flight.state, flight.status.task, flight.answers) == (
        "ready",
        INSPECTION,
        [(2, "denied")],
    )
    assert flight.tick(10.1).state == "idle"


def test_a_mode_given_while_another_mission_is_planned_flies_and_then_turns_to_it():
    flight = story(S.READY).order(EXIT).see(mode_ours=True)
    assert (flight.state, flight.status.task) == ("flying", INSPECTION)
    flight.plan_found()
    assert (flight.state, flight.status.task, flight.answers) == ("flying", EXIT, [(2, "accepted")])


# Let go -----------------------------------------------------------------------------------------


def test_an_order_that_crosses_the_letting_go_is_rejected_and_the_next_one_is_not():
    flight = story(S.FLYING).see(obstruction="the position is 0.6 s old").see(obstruction=None)
    flight.order(EXIT)
    assert flight.answers == [(2, "temporarily rejected")]
    assert flight.reasons == ["just let go"]
    assert flight.state == "released"
    flight.tick(0.5)
    assert flight.order(EXIT).state == "planning"


def test_a_pilot_who_lands_ends_the_overriding():
    flight = story(S.OVERRIDDEN, resume=True).see(**ON_THE_GROUND)
    assert flight.state == "idle"
    flight.see(airborne=True, grounded=False, mode_ours=True)  # the next flight, days later
    assert (flight.state, flight.sought) == ("idle", [])


@pytest.mark.parametrize("resume", [True, False])
def test_a_failsafe_while_the_pilot_flies_releases(resume):
    flight = story(S.OVERRIDDEN, resume=resume).see(autopilot_failsafe=True)
    assert flight.state == "released"
    assert not flight.farewell


def test_what_an_operator_held_is_not_resumed():
    flight = story(S.HOLDING, resume=True).see(mode_ours=False).see(mode_ours=True)
    assert (flight.state, flight.sought) == ("overridden", [])


def test_what_is_done_is_not_resumed():
    flight = story(S.AT_TARGET, LAST, resume=True).tick(6.0)
    assert (flight.state, flight.status.task.done) == ("holding", True)
    flight.see(mode_ours=False).see(mode_ours=True)
    assert (flight.state, flight.sought) == ("overridden", [])


@pytest.mark.parametrize("task", [EXIT, EVACUATION])
def test_above_the_landing_point_nothing_is_left_to_fly(task):
    flight = story(S.LANDING_LEG, task).see(arrived=True)
    assert (flight.state, flight.status.task.done) == ("holding", True)
    flight.order(Order.CONTINUE)
    assert (flight.answers, flight.reasons) == (
        [(2, "temporarily rejected")],
        ["nothing is left to fly"],
    )
    flight.order(task)  # but it may be ordered anew
    assert flight.plan_found().state == "flying"
    assert not flight.status.task.done


def test_the_landing_that_we_asked_for_is_no_pilots():
    flight = story(S.LANDING_LEG, EXIT).see(arrived=True)
    flight.see(mode_ours=False, landing_requested=True)
    assert flight.state == "idle"
    assert not flight.farewell
    assert flight.said == ["MOAR idle: the autopilot has left our mode"]


def test_planning_is_said():
    assert story(S.PLANNING).said == ["MOAR planning inspection"]


def test_hold_brakes_and_continue_plans_what_is_left_from_there():
    flight = story(S.FLYING)
    flight.order(Order.HOLD)
    assert flight.state == "holding"
    assert Do.BRAKE in flight.effects
    flight.tick(600.0)
    assert flight.state == "holding"
    flight.order(Order.CONTINUE)
    assert (flight.state, flight.sought, flight.answers) == ("holding", [INSPECTION], [])
    flight.plan_found()
    assert (flight.state, flight.answers) == ("flying", [(3, "accepted")])


def test_a_hold_at_a_target_ends_its_dwell():
    flight = story(S.AT_TARGET)
    flight.order(Order.HOLD)
    flight.tick(60.0)
    assert flight.state == "holding"
    assert flight.status.task == INSPECTION


@pytest.mark.parametrize("state", IN_FLIGHT)
def test_in_flight_a_mission_without_a_plan_is_denied_and_what_is_flown_goes_on(state):
    flight = any_story(state)
    task = flight.status.task
    flight.order(EVACUATION)
    flight.plan_failed("no landing point can be seen")
    assert flight.answers == [(flight.last_id, "denied")]
    assert flight.reasons == ["no landing point can be seen"]
    assert flight.status.state is state
    assert flight.status.task == task
    assert flight.status.sought is None


def test_a_next_target_without_a_plan_is_held_for_and_tried_again_on_continue():
    flight = story(S.AT_TARGET).tick(6.0)
    assert flight.sought == [LAST]
    flight.plan_failed()
    assert (flight.state, flight.answers) == ("holding", [])
    flight.order(Order.CONTINUE)
    assert flight.sought == [LAST]
    flight.plan_found()
    assert flight.state == "flying"


def test_an_order_denied_during_the_dwell_leaves_the_next_target_to_come():
    flight = story(S.AT_TARGET)
    flight.order(EVACUATION)
    flight.plan_failed()
    flight.tick(6.0)
    assert (flight.state, flight.sought) == ("at_target", [LAST])


@pytest.mark.parametrize("state", [S.FLYING, S.LANDING_LEG, S.HOLDING])
def test_a_mission_switched_in_flight_is_flown_without_a_new_mode(state):
    flight = any_story(state).order(EVACUATION)
    assert flight.status.state is state
    flight.plan_found()
    assert (flight.state, flight.status.task) == ("flying", EVACUATION)


def test_a_mission_ordered_on_the_way_is_still_awaited_on_arrival():
    flight = story(S.FLYING)
    flight.order(EXIT)
    flight.see(arrived=True)
    assert flight.state == "at_target"
    flight.plan_found()
    assert (flight.state, flight.status.task, flight.answers) == ("flying", EXIT, [(2, "accepted")])


# Taken back -------------------------------------------------------------------------------------


def test_an_order_taken_back_while_planned_is_idle():
    flight = story(S.PLANNING).take_back()
    assert flight.state == "idle"
    assert flight.plan_found().state == "idle"


def test_an_order_taken_back_in_flight_changes_nothing():
    flight = story(S.FLYING)
    flight.order(EXIT)
    flight.take_back()
    assert (flight.state, flight.status.task, flight.status.sought) == ("flying", INSPECTION, None)
    assert flight.plan_found().status.task == INSPECTION


def test_another_order_than_the_awaited_one_cannot_be_taken_back():
    flight = story(S.FLYING)
    flight.order(EXIT)
    flight.order(EVACUATION)
    flight.take_back(2)
    assert flight.status.sought == EVACUATION


# Plans that nobody awaits -----------------------------------------------------------------------


@pytest.mark.parametrize("state", [S.IDLE, S.READY, *IN_FLIGHT, S.OVERRIDDEN, S.RELEASED])
def test_a_plan_that_nobody_awaits_changes_nothing(state):
    flight = any_story(state)
    before = flight.status
    assert flight.plan_found().status == before
    assert flight.effects == []
    assert flight.plan_failed().status == before
    assert flight.effects == []


def test_silent_and_streaming_states_are_all_there_are():
    assert set(SILENT) | STREAMING == set(S)
    assert {state.value for state in S} == {
        "idle",
        "planning",
        "ready",
        "flying",
        "at_target",
        "landing_leg",
        "holding",
        "overridden",
        "released",
    }

"""The mission machine: the contract's table of states, told as stories."""

from __future__ import annotations

import pytest

from moar_companion.mission.values import Do, Order
from moar_companion.mission_states import IN_CONTROL, STREAMING, MissionState
from moar_companion.safety.condition_types import Action, Override
from moar_companion.safety.conditions import CONDITIONS

from .stories import (
    EVACUATION,
    EXIT,
    FAILSAFE,
    IN_THE_AIR,
    INSPECTION,
    LAST,
    NO_FAILSAFE,
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
    assert "MOAR: every target is done, holding" in flight.said
    flight.order(Order.CONTINUE)
    assert flight.answers == [(2, "temporarily rejected")]
    assert flight.reasons == ["nothing is left to fly"]


@pytest.mark.parametrize("task", [EXIT, EVACUATION])
def test_an_escape_route_ends_above_its_landing_point_and_asks_for_the_landing(task):
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


def test_an_escape_route_without_a_leg_of_any_length_arrives_too():
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
            FAILSAFE,
            NO_FAILSAFE,
            ON_THE_GROUND,
            IN_THE_AIR,
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
    assert flight.last_setpoint


def test_planning_for_ever_is_no_state_to_expire():
    flight = story(S.PLANNING).tick(300.0)
    assert flight.state == "planning"
    flight.plan_found()
    assert flight.state == "ready"
    flight.tick(29.0)
    assert flight.state == "ready"


@pytest.mark.parametrize("state", IN_FLIGHT)
def test_the_pilot_takes_the_mode_silent_at_once_and_without_a_last_setpoint(state):
    flight = any_story(state).see(mode_ours=False)
    assert flight.state == "overridden"
    assert not flight.last_setpoint
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
    flight.see(mode_ours=True, off_plane="3.0 m from the plane")
    assert flight.state == "overridden"
    flight.see(off_plane=None)
    assert flight.state == "planning"


@pytest.mark.parametrize("row", [row for row in CONDITIONS if row.override is Override.NOBODY])
def test_not_even_resume_comes_back_after_what_would_have_ended_our_control(row):
    flight = story(S.OVERRIDDEN, resume=True)
    flight.see(**{row.name: "trouble"}).see(**{row.name: None}).tick(row.over_s)
    assert flight.state == ("released" if row.action is Action.RELEASE else "overridden")
    flight.see(mode_ours=True).tick()
    assert flight.streaming is False
    assert flight.state == ("released" if row.action is Action.RELEASE else "planning")


def test_not_even_resume_comes_back_from_an_autopilot_failsafe():
    flight = story(S.OVERRIDDEN, resume=True)
    flight.see(**FAILSAFE)  # the battery, while the pilot flies
    flight.see(mode_ours=True)
    assert not flight.streaming
    assert flight.sought == []
    flight.see(**NO_FAILSAFE)  # PX4 goes back to its mode by itself
    for _ in range(5):
        flight.tick(1.0)
        assert flight.sought == []
    flight.order(INSPECTION)
    assert flight.state == "planning"


@pytest.mark.parametrize("state", [*STREAMED, S.PLANNING])
def test_an_autopilot_failsafe_releases(state):
    flight = any_story(state).see(**FAILSAFE, mode_ours=False)
    assert flight.state == "released"
    assert not flight.last_setpoint
    flight.see(**NO_FAILSAFE, mode_ours=True)  # PX4 resumes OFFBOARD by itself
    for _ in range(10):
        flight.tick(1.0)
        assert (flight.state, flight.effects) == ("released", [])


@pytest.mark.parametrize("parting", [True, False])
@pytest.mark.parametrize("state", [*STREAMED, S.PLANNING])
def test_stale_data_or_a_fault_releases_and_its_end_brings_nothing_back(state, parting):
    flight = any_story(state)
    cause = "autopilot_link_lost" if parting else "loop_stall"
    flight.see(**{cause: "for 3.1 s"})
    assert flight.state == "released"
    # Where the mode is not ours nobody follows.
    assert flight.last_setpoint is (parting and state in IN_CONTROL)
    flight.see(**{cause: None})
    for _ in range(10):
        flight.tick(1.0)
        assert (flight.state, flight.effects) == ("released", [])


@pytest.mark.parametrize("state", [*STREAMED, S.PLANNING])
def test_on_the_ground_is_idle(state):
    flight = any_story(state).see(**ON_THE_GROUND)
    assert flight.state == "idle"
    assert not flight.last_setpoint


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
    flight = story(S.IDLE).see(**FAILSAFE).tick(1.0)  # low battery: the autopilot holds
    flight.order(EXIT)
    flight.plan_found()
    flight.tick()
    assert flight.state == "ready"
    flight.see(mode_ours=True, **(FAILSAFE if state is S.FLYING else NO_FAILSAFE))
    assert flight.state == "flying"
    flight.see(**NO_FAILSAFE)
    flight.see(**FAILSAFE)
    assert flight.state == "released"


def test_a_failsafe_between_the_order_and_its_plan_is_not_one_that_the_operator_knew_of():
    flight = story(S.PLANNING)
    # The plan comes before the next look at the world.
    flight.change(**FAILSAFE)
    flight.plan_found()
    flight.tick()
    assert flight.state == "released"


def test_a_failsafe_while_the_next_target_is_planned_is_not_known_either():
    flight = story(S.AT_TARGET).tick(6.0)
    assert flight.sought == [LAST]
    flight.change(**FAILSAFE)
    flight.plan_found()
    flight.tick()
    assert flight.state == "released"


def test_every_trouble_at_once_is_the_gravest():
    flight = story(S.FLYING)
    flight.see(position="stale", **FAILSAFE, mode_ours=False, **ON_THE_GROUND)
    assert flight.state == "released"
    assert any("stale" in text for text in flight.said)
    flight = story(S.FLYING).see(**FAILSAFE, mode_ours=False)
    assert flight.state == "released"


def test_an_open_order_fails_when_the_flight_is_let_go():
    flight = story(S.FLYING)
    flight.order(EXIT)
    flight.see(mode_ours=False)
    assert flight.answers == [(2, "failed")]
    assert flight.plan_found().state == "overridden"


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

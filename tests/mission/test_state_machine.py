"""The mission machine: the contract's table of states, as stories."""

from __future__ import annotations

from dataclasses import replace

import pytest

from moar_companion.companion.mission.values import FlightEffect, LeaveOut, Order
from moar_companion.companion.mission_states import IN_CONTROL, STREAMING, MissionState
from moar_companion.companion.safety.condition_types import Action, Override
from moar_companion.companion.safety.conditions import CONDITIONS

from .stories import (
    EVACUATION,
    EXIT,
    FAILSAFE,
    IN_THE_AIR,
    INSPECTION,
    LANDED_STATE_UNKNOWN,
    LAST,
    NO_FAILSAFE,
    ON_THE_GROUND,
    any_story,
    story,
)

S = MissionState
IN_FLIGHT = sorted(IN_CONTROL)
STREAMED = sorted(STREAMING)
SILENT = [S.IDLE, S.PLANNING, S.OVERRIDDEN, S.RELEASED]

# Whole missions ---------------------------------------------------------------------------------


def test_an_inspection_of_two_targets_from_the_order_to_the_hold_at_its_end():
    flight = story(S.IDLE)
    flight.order(INSPECTION)
    assert (flight.state, flight.requested) == ("planning", [INSPECTION])
    flight.plan_found()
    assert (flight.state, flight.answers) == ("ready", [(1, "accepted")])
    flight.see(mode_ours=True)  # the pilot gives OFFBOARD
    assert flight.state == "flying"
    flight.see(arrived=True, dwell_s=5.0)
    assert flight.state == "at_target"
    flight.tick(4.9)
    assert (flight.state, flight.requested) == ("at_target", [])
    flight.tick(0.2)  # the dwell is over: the next target is planned while the aircraft holds
    assert (flight.state, flight.requested) == ("at_target", [LAST])
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
def test_an_escape_route_ends_above_its_landing_point_and_requests_the_landing(task):
    flight = story(S.FLYING, task)
    flight.see(on_leg=True)
    assert flight.state == "landing_leg"
    flight.see(arrived=True)
    assert flight.state == "holding"
    assert FlightEffect.LAND in flight.effects
    assert flight.streaming
    flight.tick(60.0)
    assert flight.state == "holding"
    assert FlightEffect.LAND not in flight.effects


def test_an_escape_route_without_a_landing_leg_arrives_too():
    flight = story(S.FLYING, EXIT).see(arrived=True)
    assert flight.state == "holding"
    assert FlightEffect.LAND in flight.effects


# Leaving a state --------------------------------------------------------------------------------


def test_idle_and_released_take_no_action_for_any_change():
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
    assert not any("the goal" in text for text in flight.said)  # the answer alone has the reason


def test_ready_expires_after_its_time_with_a_last_setpoint_at_rest():
    flight = story(S.READY)
    flight.tick(29.9)
    assert flight.state == "ready"
    flight.tick(0.2)
    assert flight.state == "idle"
    assert flight.last_setpoint


def test_planning_never_expires():
    flight = story(S.PLANNING).tick(300.0)
    assert flight.state == "planning"
    flight.plan_found()
    assert flight.state == "ready"
    flight.tick(29.0)
    assert flight.state == "ready"


@pytest.mark.parametrize("state", IN_FLIGHT)
def test_a_takeover_by_the_pilot_ends_the_stream_without_a_last_setpoint(state):
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
    assert (flight.state, flight.requested) == ("planning", [INSPECTION])


def test_with_resume_a_mode_given_back_is_flown_again():
    flight = story(S.OVERRIDDEN, resume=True).tick(10.0)
    assert flight.state == "overridden"
    flight.see(mode_ours=True)
    assert (flight.state, flight.requested) == ("planning", [INSPECTION])
    flight.plan_found()
    flight.tick()
    assert flight.state == "flying"


def test_a_resume_waits_until_no_condition_is_active():
    flight = story(S.OVERRIDDEN, resume=True)
    flight.see(mode_ours=True, off_plane="3.0 m from the plane")
    assert flight.state == "overridden"
    flight.see(off_plane=None)
    assert flight.state == "planning"


@pytest.mark.parametrize("row", [row for row in CONDITIONS if row.override is Override.NONE])
def test_during_a_takeover_a_release_condition_ends_the_resume_and_others_do_not(row):
    flight = story(S.OVERRIDDEN, resume=True)
    flight.see(**{row.name: "trouble"}).see(**{row.name: None}).tick(row.over_s)
    assert flight.state == ("released" if row.action is Action.RELEASE else "overridden")
    flight.see(mode_ours=True).tick()
    assert flight.streaming is False
    assert flight.state == ("released" if row.action is Action.RELEASE else "planning")


def test_a_resume_is_denied_after_an_autopilot_failsafe():
    flight = story(S.OVERRIDDEN, resume=True)
    flight.see(**FAILSAFE)  # the battery, while the pilot flies
    flight.see(mode_ours=True)
    assert not flight.streaming
    assert flight.requested == []
    flight.see(**NO_FAILSAFE)  # PX4 returns to its former mode by itself
    for _ in range(5):
        flight.tick(1.0)
        assert flight.requested == []
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
def test_stale_data_or_a_fault_releases_and_its_end_does_not_resume(state, parting):
    flight = any_story(state)
    cause = "autopilot_link_lost" if parting else "loop_stall"
    flight.see(**{cause: "for 3.1 s"})
    assert flight.state == "released"
    # Outside OFFBOARD or GUIDED the autopilot does not follow setpoints.
    assert flight.last_setpoint is (parting and state in IN_CONTROL)
    flight.see(**{cause: None})
    for _ in range(10):
        flight.tick(1.0)
        assert (flight.state, flight.effects) == ("released", [])


@pytest.mark.parametrize("state", [*STREAMED, S.PLANNING])
def test_a_landed_aircraft_is_idle(state):
    flight = any_story(state).see(**ON_THE_GROUND)
    assert flight.state == "idle"
    assert not flight.last_setpoint


@pytest.mark.parametrize("state", [*STREAMED, S.PLANNING])
def test_with_an_unknown_landed_state_the_mission_continues_and_no_order_is_taken(state):
    flight = any_story(state).see(**LANDED_STATE_UNKNOWN)
    assert flight.status.state is state
    task = flight.status.task
    flight.order(EVACUATION)
    assert flight.answers == [(flight.last_id, "temporarily rejected")]
    assert flight.reasons == ["not in the air"]
    assert (flight.status.state, flight.status.task) == (state, task)


@pytest.mark.parametrize("state", [S.READY, S.FLYING])
def test_a_failsafe_known_to_the_operator_does_not_release_but_the_next_one_does(state):
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


def test_a_failsafe_between_an_order_and_its_plan_releases():
    flight = story(S.PLANNING)
    # The plan comes before the next cycle.
    flight.change(**FAILSAFE)
    flight.plan_found()
    flight.tick()
    assert flight.state == "released"


def test_a_failsafe_while_the_next_target_is_planned_releases():
    flight = story(S.AT_TARGET).tick(6.0)
    assert flight.requested == [LAST]
    flight.change(**FAILSAFE)
    flight.plan_found()
    flight.tick()
    assert flight.state == "released"


def test_of_several_conditions_at_once_the_gravest_acts():
    flight = story(S.FLYING)
    flight.see(position="stale", **FAILSAFE, mode_ours=False, **ON_THE_GROUND)
    assert flight.state == "released"
    assert any("stale" in text for text in flight.said)
    flight = story(S.FLYING).see(**FAILSAFE, mode_ours=False)
    assert flight.state == "released"


def test_an_open_order_fails_when_control_ends():
    flight = story(S.FLYING)
    flight.order(EXIT)
    flight.see(mode_ours=False)
    assert flight.answers == [(2, "failed")]
    assert flight.plan_found().state == "overridden"


# Plans that are not awaited ---------------------------------------------------------------------


@pytest.mark.parametrize("state", [S.IDLE, S.READY, *IN_FLIGHT, S.OVERRIDDEN, S.RELEASED])
def test_a_plan_that_is_not_awaited_changes_nothing(state):
    flight = any_story(state)
    before = flight.status
    assert flight.plan_found().status == before
    assert flight.effects == []
    assert flight.plan_failed().status == before
    assert flight.effects == []


def test_every_state_is_either_silent_or_streaming():
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


# Order and number of the stops


def test_the_stops_are_visited_in_the_order_of_the_plan():
    flight = story(S.IDLE).order(INSPECTION).plan_found(("second", "first"))
    assert flight.status.task.stops == ("second", "first")
    flight.see(mode_ours=True).see(arrived=True, dwell_s=0.0).tick()
    assert flight.requested == [replace(INSPECTION, stops=("first",))]


@pytest.mark.parametrize("state", [S.FLYING, S.AT_TARGET])
def test_stops_that_the_energy_does_not_suffice_for_are_left_out_and_told(state):
    flight = story(state, replace(INSPECTION, stops=("first", "second", "third", "fourth")))
    flight.shorten(2)
    assert flight.status.task == INSPECTION
    assert flight.said[-1] == "MOAR: no energy for third, 1 more, left out"
    assert LeaveOut(("third", "fourth"), "energy") in flight.effects
    flight.shorten(1)
    assert flight.status.task.stops == ("first",)
    assert flight.said[-1] == "MOAR: no energy for second, left out"
    assert flight.state == state.value


@pytest.mark.parametrize(
    ("state", "task", "fitting"),
    [(S.FLYING, INSPECTION, None), (S.FLYING, INSPECTION, 2), (S.HOLDING, INSPECTION, 1)],
)
def test_no_stop_is_left_out_otherwise(state, task, fitting):
    flight = story(state, task)
    before = flight.status
    assert flight.shorten(fitting).status == before


def test_no_stop_is_left_out_while_another_task_is_requested():
    flight = story(S.FLYING, INSPECTION).order(EXIT)
    assert flight.shorten(1).status.task == INSPECTION

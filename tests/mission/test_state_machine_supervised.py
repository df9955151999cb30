"""The mission machine: release, holds and escape routes of the supervisor, and resuming."""

from __future__ import annotations

import pytest

from moar_companion.companion.mission.values import FlightEffect, Order, Task
from moar_companion.companion.mission_states import MissionState
from moar_companion.types import Mission

from .stories import (
    EVACUATION,
    EXIT,
    FAILSAFE,
    IN_THE_AIR,
    INSPECTION,
    LAST,
    ON_THE_GROUND,
    STALE,
    any_story,
    story,
)

S = MissionState

# Release ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("state", "change"), [("released", STALE), ("overridden", {"mode_ours": False})]
)
def test_an_order_just_after_the_release_is_rejected_and_the_next_one_is_planned(state, change):
    flight = story(S.FLYING).see(**change).see(position=None)
    flight.order(EXIT)
    assert flight.answers == [(2, "temporarily rejected")]
    assert flight.reasons == ["control has just ended"]
    assert flight.state == state
    flight.tick(0.5)
    assert flight.order(EXIT).state == "planning"


@pytest.mark.parametrize("state", [S.PLANNING, S.FLYING])
@pytest.mark.parametrize("change", [FAILSAFE, STALE])
def test_a_plan_that_is_found_when_control_has_just_ended_is_not_accepted(state, change):
    """Otherwise *ready* and ACCEPTED would be sent in the instant of *released*."""
    flight = story(state)
    if state is S.FLYING:
        flight.order(EXIT)
    flight.change(**change)
    flight.rule()
    flight.plan_found()
    assert flight.state == "released"
    assert flight.answers == [(flight.last_id, "failed")]
    assert flight.reasons == list(change.values())
    assert not any("ready" in text for text in flight.said)


@pytest.mark.parametrize("task", [INSPECTION, EXIT])
def test_a_place_that_must_be_left_is_a_hold_and_the_flight_resumes_behind_it(task):
    flight = story(S.FLYING, task).see(error_reach="3.3 m error would hit wire").tick(0.6)
    assert flight.state == "holding"
    assert FlightEffect.BRAKE in flight.effects
    assert any("3.3 m error would hit wire, leaving" in text for text in flight.said)
    flight.see(error_reach=None).tick(4.9)
    assert flight.state == "holding"
    flight.tick(0.2)
    assert flight.status.requested == flight.status.task


def test_a_place_is_left_before_an_escape_goes_on():
    flight = story(S.FLYING, EXIT).see(battery_critical="battery 0 is critical").tick(1.1)
    flight.plan_found()
    assert flight.state == "flying"
    flight.see(battery_landing="landing 27 s < 41 to leave").tick(1.1)
    assert flight.state == "holding"
    flight.see(battery_landing=None).tick(10.1)
    assert flight.status.requested.mission is Mission.EVACUATION


def test_an_order_replaced_by_a_newer_one_is_cancelled_with_a_reason():
    flight = story(S.FLYING).order(EXIT).order(EVACUATION)
    assert flight.answers == [(2, "cancelled")]
    assert flight.reasons == ["replaced by a newer order"]


def test_a_landing_by_the_pilot_ends_overridden():
    flight = story(S.OVERRIDDEN, resume=True).see(**ON_THE_GROUND)
    assert flight.state == "idle"
    flight.see(**IN_THE_AIR, mode_ours=True)  # the next flight, days later
    assert (flight.state, flight.requested) == ("idle", [])


@pytest.mark.parametrize("resume", [True, False])
def test_a_failsafe_while_the_pilot_flies_releases(resume):
    flight = story(S.OVERRIDDEN, resume=resume).see(**FAILSAFE)
    assert flight.state == "released"
    assert not flight.last_setpoint


def test_a_failsafe_overridden_by_an_order_ends_the_resume_when_the_mode_is_lost():
    """ArduPilot reports a failsafe until its end; the failsafe may take the mode again."""
    flight = story(S.FLYING, resume=True).see(**FAILSAFE, mode_ours=False).tick(1.0)
    assert flight.order(INSPECTION).plan_found().see(mode_ours=True).state == "flying"
    flight.see(mode_ours=False).tick()
    assert flight.state == "released"
    flight.see(mode_ours=True).tick(1.0)
    assert (flight.state, flight.requested) == ("released", [])


def test_a_mission_held_by_an_operator_is_not_resumed():
    flight = story(S.HOLDING, resume=True).see(mode_ours=False).see(mode_ours=True)
    assert (flight.state, flight.requested) == ("overridden", [])


def test_a_finished_mission_is_not_resumed():
    flight = story(S.AT_TARGET, LAST, resume=True).tick(6.0)
    assert (flight.state, flight.status.task.done) == ("holding", True)
    flight.see(mode_ours=False).see(mode_ours=True)
    assert (flight.state, flight.requested) == ("overridden", [])


@pytest.mark.parametrize("task", [EXIT, EVACUATION])
def test_above_the_landing_point_a_continue_is_rejected(task):
    flight = story(S.LANDING_LEG, task).see(arrived=True)
    assert (flight.state, flight.status.task.done) == ("holding", True)
    flight.order(Order.CONTINUE)
    assert (flight.answers, flight.reasons) == (
        [(2, "temporarily rejected")],
        ["nothing is left to fly"],
    )
    flight.order(task)  # but an operator may order the escape route again
    assert flight.plan_found().state == "flying"
    assert not flight.status.task.done


def test_a_landing_requested_by_the_companion_is_no_takeover():
    flight = story(S.LANDING_LEG, EXIT).see(arrived=True)
    flight.landing_requested = True
    flight.see(mode_ours=False)
    assert flight.state == "idle"
    assert not flight.last_setpoint
    assert flight.said == ["MOAR: the autopilot has left our mode, idle"]


# Supervised -------------------------------------------------------------------------------------

WIND = {"wind": "wind 13.2 m/s > 12"}
RESERVE = {"battery_reserve": "battery 0 at 19% <= 20%"}
CRITICAL = {"battery_critical": "battery 0 is critical"}
KNOWN_S = 0.6
"""Time after which an active condition counts as known to the operator."""


@pytest.mark.parametrize("state", [S.FLYING, S.AT_TARGET, S.LANDING_LEG])
def test_a_hold_of_the_supervisor_brakes_and_resumes_by_itself(state):
    flight = any_story(state)
    task = flight.status.task
    flight.see(**WIND)
    assert flight.status.state is state  # a gust
    flight.tick(3.1)
    assert (flight.state, flight.said) == (
        "holding",
        ["MOAR: wind 13.2 m/s > 12, holding"],
    )
    assert FlightEffect.BRAKE in flight.effects
    flight.tick(60.0)
    assert (flight.state, flight.effects) == ("holding", [])
    flight.see(wind=None).tick(4.9)
    assert (flight.state, flight.requested) == ("holding", [])
    flight.tick(0.2)
    assert (flight.state, flight.requested) == ("holding", [task])
    flight.plan_found()
    assert (flight.state, flight.status.task) == ("flying", task)


def test_a_hold_of_the_supervisor_without_a_path_to_resume_waits_for_an_operator():
    flight = story(S.FLYING).see(**WIND).tick(3.1).see(wind=None).tick(5.1)
    assert flight.requested == [INSPECTION]
    flight.plan_failed()
    assert flight.said[-1] == "MOAR: no free path leads there, holding"
    for _ in range(20):
        flight.tick(1.0)
        assert (flight.state, flight.requested) == ("holding", [])


def test_an_escape_route_that_cannot_resume_is_planned_again():
    task = Task(mission=Mission.EXIT)
    flight = any_story(S.FLYING, task).see(**WIND).tick(3.1).see(wind=None).tick(5.1)
    for _ in range(5):
        assert flight.requested == [task]
        assert flight.plan_failed(failed=True).tick(1.0).requested == []
        flight.tick(1.1)
    assert flight.plan_found().state == "flying"
    assert not flight.status.resumes


def test_wind_that_returns_during_the_resume_holds_again_and_then_resumes():
    flight = story(S.FLYING).see(**WIND).tick(3.1).see(wind=None).tick(5.1)
    flight.see(**WIND).tick(3.1)
    assert (flight.state, flight.status.requested) == ("holding", None)
    assert flight.plan_found().state == "holding"
    flight.see(wind=None).tick(5.1)
    assert flight.requested == [INSPECTION]


def test_an_operators_hold_outlasts_an_escape_that_was_searched_in_vain_and_a_later_hold():
    flight = story(S.FLYING).order(Order.HOLD).see(**RESERVE).tick(3.1)
    assert [task.mission for task in flight.requested] == [Mission.EXIT]
    flight.see(battery_reserve=None).tick(10.1).see(**WIND).tick(3.1)
    flight.see(wind=None).tick(60.0)
    assert (flight.state, flight.status.requested) == ("holding", None)


def test_a_hold_from_which_no_escape_was_found_waits_for_an_operator():
    flight = story(S.FLYING).see(**WIND).tick(3.1).see(**RESERVE).tick(3.1)
    for mission in (Mission.EXIT, Mission.EVACUATION):
        assert [task.mission for task in flight.requested] == [mission]
        flight.plan_failed().tick()
    flight.see(wind=None, battery_reserve=None).tick(10.1).tick(60.0)
    assert (flight.state, flight.status.requested) == ("holding", None)


def test_an_operators_hold_outlasts_the_supervisors():
    flight = story(S.FLYING).see(**WIND).tick(3.1).order(Order.HOLD)
    flight.see(wind=None).tick(60.0)
    assert (flight.state, flight.requested) == ("holding", [])
    assert flight.order(Order.CONTINUE).requested == [INSPECTION]


def test_a_finished_mission_does_not_resume_after_a_hold():
    flight = story(S.AT_TARGET, LAST).tick(6.0)
    flight.see(**WIND).tick(3.1).see(wind=None).tick(60.0)
    assert (flight.state, flight.requested) == ("holding", [])


def test_an_order_being_planned_fails_with_the_reason_of_the_hold():
    flight = story(S.FLYING).see(**WIND)
    flight.order(EXIT).tick(3.1)
    assert (flight.state, flight.answers) == ("holding", [(2, "failed")])
    assert "wind 13.2 m/s" in flight.reasons[0]


@pytest.mark.parametrize("end", ["denied", "taken back", "replaced by that of the next gust"])
def test_an_order_that_is_not_flown_keeps_the_held_mission_resumable(end):
    flight = story(S.FLYING).see(**WIND).tick(3.1).tick(KNOWN_S).order(EXIT)
    if end == "denied":
        flight.plan_failed()
    elif end == "taken back":
        flight.take_back()
    else:
        flight.see(wind=None).tick(5.1).see(**WIND).tick(3.1)
        assert flight.answers == [(2, "failed")]
    assert flight.state == "holding"
    assert flight.see(wind=None).tick(5.1).requested == [INSPECTION]
    assert flight.plan_found().state == "flying"


def test_a_hold_ordered_while_ready_outlasts_the_supervisors_hold_at_the_mode():
    flight = story(S.READY).order(Order.HOLD).see(no_clearance="no room here", mode_ours=True)
    assert flight.state == "holding"
    flight.see(no_clearance=None).tick(60.0)
    assert (flight.state, flight.requested) == ("holding", [])
    assert flight.order(Order.CONTINUE).requested == [INSPECTION]


def test_a_mode_given_under_a_hold_condition_is_a_hold():
    flight = story(S.READY).see(**WIND).tick(2.9)
    flight.see(mode_ours=True).tick(0.2)
    assert flight.state == "holding"
    flight.see(wind=None).tick(5.1)
    assert flight.requested == [INSPECTION]


@pytest.mark.parametrize("state", [S.PLANNING, S.READY])
@pytest.mark.parametrize("cause", [WIND, RESERVE, CRITICAL])
def test_a_mission_not_yet_flown_is_dropped_with_the_reason_of_the_condition(state, cause):
    flight = any_story(state).see(**cause).tick(3.1)
    assert flight.state == "idle"
    assert flight.last_setpoint is (state is S.READY)
    assert flight.said == [f"MOAR: {next(iter(cause.values()))}, idle"]


@pytest.mark.parametrize("state", [S.PLANNING, S.READY])
def test_an_escape_route_that_the_supervisor_requests_stays_ready(state):
    assert any_story(state, task=EXIT).see(**RESERVE).tick(3.1).status.state is state


@pytest.mark.parametrize("state", [S.FLYING, S.AT_TARGET, S.HOLDING])
def test_a_low_battery_starts_an_exit_and_a_critical_one_an_evacuation(state):
    flight = any_story(state).see(**RESERVE).tick(3.1)
    assert [task.mission for task in flight.requested] == [Mission.EXIT]
    flight.tick(5.0)
    assert flight.requested == []  # once
    flight.plan_found().see(arrived=False)
    assert (flight.state, flight.status.task.mission) == ("flying", Mission.EXIT)
    flight.see(**CRITICAL).tick(1.1)
    assert [task.mission for task in flight.requested] == [Mission.EVACUATION]
    flight.plan_found().see(battery_reserve=None, battery_critical=None).tick(60.0)
    assert (flight.state, flight.status.task.mission) == ("flying", Mission.EVACUATION)


def test_without_an_escape_route_the_machine_holds_and_replans_every_two_seconds():
    flight = story(S.FLYING).see(**RESERVE).tick(3.1)
    for _ in range(5):
        assert [task.mission for task in flight.requested] == [Mission.EXIT]
        flight.plan_failed().tick()
        assert [task.mission for task in flight.requested] == [Mission.EVACUATION]
        flight.plan_failed().tick()
        assert flight.state == "holding"
        flight.tick(1.9)
        assert flight.effects == []
        flight.tick(0.1)
    assert flight.plan_found().state == "flying"


def test_after_a_planner_failure_the_same_escape_route_is_planned_again():
    flight = story(S.FLYING).see(**RESERVE).tick(3.1)
    flight.plan_failed("no plan in 5 s", failed=True)
    assert flight.said == ["MOAR: no plan in 5 s, no exit"]
    flight.tick(1.9)
    assert (flight.state, flight.requested) == ("holding", [])
    flight.tick(0.1)
    assert [task.mission for task in flight.requested] == [Mission.EXIT]
    assert flight.plan_found().state == "flying"


@pytest.mark.parametrize("failed", [False, True])
def test_a_flown_exit_continues_where_no_evacuation_is_found(failed):
    flight = story(S.FLYING, EXIT).see(**CRITICAL).tick(1.1)
    for _ in range(3):
        assert [task.mission for task in flight.requested] == [Mission.EVACUATION]
        flight.plan_failed(failed=failed)
        for _ in range(19):
            flight.tick(0.1)
            assert (flight.state, flight.status.task, flight.effects) == ("flying", EXIT, [])
        flight.tick(0.2)


@pytest.mark.parametrize("state", [S.FLYING, S.AT_TARGET, S.HOLDING])
def test_without_an_evacuation_an_exit_is_flown(state):
    flight = any_story(state).see(**CRITICAL).tick(1.1)
    assert flight.requested == [Task(mission=Mission.EVACUATION)]
    flight.plan_failed().tick()
    assert (flight.requested, flight.said) == ([EXIT], ["MOAR: battery 0 is critical, exiting"])
    for _ in range(30):
        assert flight.tick(0.1).effects == []  # the plan is awaited
    assert flight.plan_found().state == "flying"
    assert flight.status.task == EXIT
    assert flight.tick().requested == [
        Task(mission=Mission.EVACUATION)
    ]  # an evacuation may be possible now


def an_exit_held(state, held):
    flight = any_story(state, Task(mission=Mission.EXIT, landing=1))
    flight = flight.see(**WIND).tick(3.1) if held == "by wind" else flight.order(Order.HOLD)
    assert flight.state == "holding"
    return flight.see(**CRITICAL).tick(1.1)


@pytest.mark.parametrize("failed", [False, True])
@pytest.mark.parametrize("held", ["by wind", "by an operator"])
def test_a_held_exit_resumes_where_no_evacuation_is_found(held, failed):
    flight = an_exit_held(S.FLYING, held)
    task = flight.status.task
    assert flight.requested == [Task(mission=Mission.EVACUATION)]
    assert flight.plan_failed(failed=failed).tick().requested == [task]
    flight.plan_found().tick()
    assert (flight.status.state, flight.status.task) == (S.FLYING, task)


@pytest.mark.parametrize("held", ["by wind", "by an operator"])
def test_a_held_landing_leg_resumes_before_an_evacuation_is_planned(held):
    flight = an_exit_held(S.LANDING_LEG, held)
    task = flight.status.task
    assert flight.requested == [task]
    flight.plan_found().see(on_leg=True).tick()
    assert (flight.status.state, flight.status.task) == (S.LANDING_LEG, task)


def test_a_landing_leg_that_is_flown_is_not_left_for_an_evacuation():
    flight = story(S.LANDING_LEG, EXIT).see(**CRITICAL).tick(1.1)
    for _ in range(30):
        assert (flight.state, flight.effects) == ("landing_leg", [])
        flight.tick(0.1)


@pytest.mark.parametrize("state", [S.FLYING, S.LANDING_LEG])
def test_an_escape_route_without_a_path_is_replaced_by_the_next_one(state):
    flight = any_story(state, EVACUATION).see(**CRITICAL).tick(1.1)
    assert flight.effects == []
    flight.strand()
    for task in (Task(mission=Mission.EVACUATION), EXIT):  # any landing point first
        assert flight.tick().requested == [task]
        flight.plan_failed()
    for _ in range(19):
        flight.tick(0.1).strand()  # the flight itself tries to resume
        assert (flight.status.state, flight.effects) == (state, [])
    assert flight.tick(0.2).effects == []
    assert flight.strand().tick().requested == [Task(mission=Mission.EVACUATION)]
    flight.plan_found().tick()
    assert (flight.status.task.landing, flight.requested) == (None, [])


def test_an_escape_route_no_longer_needed_is_no_longer_planned():
    flight = story(S.FLYING).see(**RESERVE).tick(3.1).plan_failed().tick().plan_failed().tick()
    flight.see(battery_reserve=None).tick(10.0).tick(60.0)
    assert (flight.state, flight.requested) == ("holding", [])


@pytest.mark.parametrize("order", [EXIT, Order.HOLD])
def test_an_operator_informed_of_the_condition_overrides_the_escape_route(order):
    flight = story(S.FLYING).see(**CRITICAL).tick(1.1).plan_found().tick(KNOWN_S)
    flight.order(order)
    if order is EXIT:
        assert flight.plan_found().answers == [(2, "accepted")]
    for _ in range(20):
        flight.tick(1.0)
        assert flight.requested == []
    assert flight.state == ("flying" if order is EXIT else "holding")
    flight.order(INSPECTION)
    assert flight.reasons == ["battery 0 is critical"]


@pytest.mark.parametrize("end", ["denied", "taken back"])
def test_an_order_that_is_not_flown_overrides_no_condition(end):
    flight = story(S.FLYING).see(**CRITICAL).tick(1.1).tick(KNOWN_S).order(EXIT)
    for _ in range(5):
        assert flight.tick().requested == []  # the operator is informed of the battery
    flight = flight.plan_failed() if end == "denied" else flight.take_back()
    assert [task.mission for task in flight.tick().requested] == [Mission.EVACUATION]


def test_a_hold_just_as_the_escape_route_begins_does_not_override_it():
    flight = story(S.FLYING).see(**CRITICAL).tick(1.1).plan_found().order(Order.HOLD)
    assert (flight.state, flight.answers) == ("holding", [(2, "accepted")])
    assert [task.mission for task in flight.tick().requested] == [Mission.EVACUATION]


@pytest.mark.parametrize("order", [EXIT, INSPECTION, Order.CONTINUE])
def test_an_order_to_fly_just_as_a_hold_begins_is_rejected_with_the_reason(order):
    flight = story(S.FLYING).see(position_jump="the position jumped 4.5 m").order(order)
    assert (flight.state, flight.answers) == ("holding", [(2, "temporarily rejected")])
    assert flight.reasons == ["the position jumped 4.5 m (just begun)"]
    flight.tick(KNOWN_S).order(order)
    assert flight.plan_found().answers == [(3, "accepted")]
    assert flight.tick().state == "flying"


def test_a_condition_that_begins_during_planning_is_not_overridden_by_the_order():
    flight = story(S.FLYING).see(**CRITICAL).tick(1.1).plan_found().tick(KNOWN_S)
    flight.order(EXIT)
    flight.see(battery_critical=None).tick(10.1)
    assert flight.see(**CRITICAL).answers == []
    flight.tick(1.1)  # active again
    assert flight.answers == [(2, "failed")]
    assert [task.mission for task in flight.requested] == [Mission.EVACUATION]


def test_above_the_landing_point_no_escape_route_is_planned():
    flight = story(S.LANDING_LEG, EXIT).see(arrived=True)
    flight.see(**CRITICAL).tick(2.0)
    assert (flight.state, flight.requested) == ("holding", [])

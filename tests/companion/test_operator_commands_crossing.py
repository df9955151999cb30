"""Orders that cross with other events, or come before the mode, a plan or the end."""

from __future__ import annotations

import math

import pytest

from moar_companion.settings.config import Authority

from ..mavlink.peer import Peer
from .desk import (
    ACCEPTED,
    CANCELLED,
    DENIED,
    EVACUATION,
    EXIT,
    HOLD,
    IN_PROGRESS,
    INSPECTION,
    PAUSE_CONTINUE,
    RELEASE,
    TEMPORARILY_REJECTED,
    USER_1,
    Desk,
)
from .scripted_autopilot import AUTO_HOLD, CRITICAL, OFFBOARD

# Orders that cross with other events ------------------------------------------------------------


def test_an_order_cancelled_in_the_cycle_of_its_plan_is_not_flown():
    desk = Desk(plan_delay_s=None).run(1.2).order(INSPECTION).step()
    desk.take_back().answer_plan().run(1.0)
    assert (desk.state, desk.answers()) == ("idle", [CANCELLED])
    assert not desk.setpoints()


def test_in_flight_an_order_cancelled_in_the_cycle_of_its_plan_is_not_flown():
    desk = Desk().come_to("flying")
    desk.plan_delay_s = None
    desk.run(0.5).order(EVACUATION).step()
    desk.take_back().answer_plan().run(0.5)
    assert (desk.state, desk.answers()[-1]) == ("flying", CANCELLED)
    assert desk.companion.status.task.mission.value == "inspection"


@pytest.mark.parametrize(("order", "state"), [(HOLD, "holding"), (RELEASE, "released")])
def test_a_hold_or_release_cancels_the_order_whose_plan_is_awaited(order, state):
    desk = Desk().come_to("flying")
    desk.plan_delay_s = None
    desk.order(EVACUATION).step()
    desk.order(order, peer=Peer(254, 190)).step()
    answered = [(m.target_system, m.result) for m in desk.messages("COMMAND_ACK")[-2:]]
    assert (desk.state, answered) == (state, [(255, CANCELLED), (254, ACCEPTED)])


def test_a_pause_cancels_the_order_whose_plan_is_awaited():
    desk = Desk().come_to("flying")
    desk.plan_delay_s = None
    desk.order(EVACUATION).step()
    desk.pause().step()
    assert (desk.state, desk.answers()[-1]) == ("holding", CANCELLED)
    assert desk.answers(PAUSE_CONTINUE) == [ACCEPTED]


def test_of_orders_received_at_once_a_hold_repeated_after_a_continue_holds():
    """As after a gap of the link: the operator has held, continued, and held again."""
    desk = Desk().come_to("flying", then_s=1.0)
    desk.order(HOLD).go_on().order(HOLD).run(2.0)
    assert desk.state == "holding"
    assert not any((m.vx, m.vy, m.vz) != (0.0, 0.0, 0.0) for m in desk.setpoints(desk.now_s - 0.5))


def test_of_orders_received_at_once_a_pause_repeated_after_another_operators_mission_holds():
    desk = Desk().come_to("flying", then_s=1.0)
    desk.pause().order(INSPECTION, 1.0, peer=Peer(254, 190)).pause().run(2.0)
    assert desk.state == "holding"


def test_a_failsafe_received_with_a_release_gets_no_last_setpoint():
    desk = Desk().come_to("flying", then_s=3.0)
    began = desk.now_s
    desk.send_heartbeat(AUTO_HOLD, CRITICAL).order(RELEASE).run(1.0)
    assert desk.state == "released"
    assert not desk.setpoints(began)


@pytest.mark.parametrize("failsafe_first", [True, False])
def test_an_order_that_crosses_with_a_failsafe_is_rejected(failsafe_first):
    desk = Desk().come_to("ready", then_s=1.0)
    began = desk.now_s
    if failsafe_first:
        desk.send_heartbeat(AUTO_HOLD, CRITICAL).order(EXIT)
    else:
        desk.order(EXIT).send_heartbeat(AUTO_HOLD, CRITICAL)
    desk.run(2.0)
    assert (desk.state, desk.answers()[-1]) == ("released", TEMPORARILY_REJECTED)
    assert desk.said("control has just ended")
    assert not desk.setpoints(began)
    desk.order(EXIT).run(0.5)  # the operator has received the text
    assert (desk.state, desk.answers()[-1]) == ("ready", ACCEPTED)


def test_an_order_in_the_cycle_of_a_plan_is_judged_after_the_events_that_end_control():
    desk = Desk().come_to("ready", then_s=1.0)
    desk.plan_delay_s = None
    desk.order(EVACUATION).step()
    began = desk.now_s
    desk.send_heartbeat(AUTO_HOLD, CRITICAL).order(EXIT).answer_plan().run(2.0)
    assert desk.state == "released"
    assert not desk.setpoints(began)


def test_with_a_plan_in_the_cycle_a_failsafe_received_with_a_release_gets_no_last_setpoint():
    desk = Desk().come_to("flying", then_s=3.0)
    desk.plan_delay_s = None
    desk.order(EXIT).step()
    began = desk.now_s
    desk.send_heartbeat(AUTO_HOLD, CRITICAL).order(RELEASE).answer_plan().run(1.0)
    assert desk.state == "released"
    assert not desk.setpoints(began)


# While ready ------------------------------------------------------------------------------------


def test_a_mission_ordered_while_ready_interrupts_no_stream():
    desk = Desk(plan_delay_s=0.5).come_to("ready", then_s=1.0)
    began = desk.now_s
    desk.order(EXIT).run(0.4)
    assert desk.state == "ready"
    desk.run(0.6)
    assert (desk.state, desk.answers()[-1]) == ("ready", ACCEPTED)
    assert desk.companion.status.task.mission.value == "exit"
    assert len(desk.setpoints(began)) == 50
    assert {(m.vx, m.vy, m.vz) for m in desk.setpoints(began)} == {(0.0, 0.0, 0.0)}


def test_a_mission_that_cannot_be_planned_while_ready_keeps_the_offered_hold():
    desk = Desk().come_to("ready")
    desk.plan_delay_s = None
    desk.order(EXIT).step().answer_plan(plan=None, reason="no escape route").run(0.5)
    assert (desk.state, desk.answers()[-1]) == ("ready", DENIED)
    desk.plan_delay_s = 0.04
    desk.run(1.0).send_heartbeat(OFFBOARD).run_until("flying", 0.1)
    assert desk.companion.status.task.mission.value == "inspection"


@pytest.mark.parametrize("held_by", ["pause", "order"])
def test_a_hold_given_with_the_mode_holds_and_can_be_continued(held_by):
    """The pilot gives OFFBOARD; the companion receives it within a second."""
    desk = Desk().come_to("ready", then_s=1.2).run_to_heartbeat()
    desk.mode = OFFBOARD
    began = desk.now_s
    if held_by == "pause":
        desk.pause()
    else:
        desk.order(HOLD)
    desk.step()
    assert desk.state == "ready"
    assert desk.answers(PAUSE_CONTINUE if held_by == "pause" else USER_1)[-1] == ACCEPTED
    desk.run(5.0)
    assert desk.state == "holding"
    assert len(desk.setpoints(began)) == 251
    place = desk.setpoints(began)[0]
    last = desk.setpoints()[-1]
    assert math.dist((last.x, last.y, last.z), (place.x, place.y, place.z)) < 1e-6
    desk.go_on().run(0.5)
    assert desk.state == "flying"


def test_a_hold_while_ready_can_be_continued_while_ready():
    desk = Desk().come_to("ready").pause().run(0.5)
    desk.go_on().run(0.5)
    assert (desk.state, desk.answers(PAUSE_CONTINUE)) == ("ready", [ACCEPTED, ACCEPTED])
    desk.run(1.0).send_heartbeat(OFFBOARD).run_until("flying", 0.1)


# Planners that are slow or silent ---------------------------------------------------------------


def test_an_order_is_denied_when_the_planner_never_answers():
    desk = Desk(plan_delay_s=None).run(1.2).order(INSPECTION).run(4.9)
    assert desk.state == "planning"
    desk.run(0.3)
    assert (desk.state, desk.answers()) == ("idle", [IN_PROGRESS] * 5 + [DENIED])
    assert desk.said("no plan in 5 s")
    desk.answer_plan().run(1.0)  # too late
    assert desk.state == "idle"
    assert not desk.setpoints()


def test_a_replan_without_an_answer_is_dropped_and_the_next_one_requested():
    desk = Desk().come_to("flying")
    desk.plan_delay_s = None
    began = desk.now_s
    desk.run(6.0)
    asked = len(desk.jobs)
    desk.plan_delay_s = 0.04
    desk.run(6.0)
    assert len(desk.jobs) > asked
    assert desk.state == "flying"
    assert len(desk.setpoints(began)) == 600


@pytest.mark.parametrize("delay_s", [0.4, 0.8, 1.5])
def test_a_plan_that_comes_too_late_to_be_joined_is_made_again_from_rest(delay_s):
    desk = Desk().come_to("flying", then_s=4.0)
    desk.plan_delay_s = delay_s
    desk.order(EVACUATION).run(4.0)
    assert desk.answers()[-1] == ACCEPTED
    assert desk.companion.status.task.mission.value == "evacuation"
    assert "at_target" not in [change["state"] for change in desk.decided("state")]


@pytest.mark.slow
@pytest.mark.parametrize("mission", [EXIT, EVACUATION])
def test_an_escape_route_that_brakes_for_a_slow_planner_has_not_reached_its_end(mission):
    desk = Desk(authority=Authority.ENGAGE).come_to("at_target").order(mission).run(4.0)
    assert desk.state == "flying"
    began = desk.now_s
    desk.plan_delay_s = 1.5
    desk.order(INSPECTION).run(6.0)
    assert not desk.mode_requests(began)  # for the landing
    assert (desk.state, desk.answers()[-1]) == ("flying", ACCEPTED)


# The end of the mission -------------------------------------------------------------------------


@pytest.mark.slow
def test_above_the_landing_point_continue_is_rejected():
    desk = Desk().come_to("holding", EXIT, then_s=2.0).go_on().run(0.5)
    assert (desk.state, desk.answers(PAUSE_CONTINUE)) == ("holding", [TEMPORARILY_REJECTED])
    assert desk.said("nothing is left to fly")


@pytest.mark.parametrize("early_s", [0.0, 0.1, 0.3, 0.6])
def test_a_hold_that_ends_beyond_the_gate_can_be_continued(early_s):
    flown_s = Desk().come_to("landing_leg", EXIT).now_s - Desk().come_to("flying", EXIT).now_s
    desk = Desk().come_to("flying", EXIT, then_s=flown_s - 0.62).run(0.6 - early_s)
    assert desk.state == "flying"
    desk.pause().run(3.0)
    assert desk.state == "holding"
    desk.go_on().run(1.0)
    assert desk.answers(PAUSE_CONTINUE) == [ACCEPTED, ACCEPTED]
    desk.run_until("landing_leg", 5.0).run(0.5)
    assert desk.state == "landing_leg"


@pytest.mark.parametrize("plan_delay_s", [0.0, 0.04])
def test_an_order_during_braking_is_joined_at_the_rest_point(plan_delay_s):
    desk = Desk(plan_delay_s=plan_delay_s).come_to("flying", then_s=4.0)
    planned = len(desk.jobs)
    desk.pause().run(0.1).order(EVACUATION).run(0.2)
    assert (desk.state, desk.answers()[-1]) == ("flying", ACCEPTED)
    assert len(desk.jobs) == planned + 1

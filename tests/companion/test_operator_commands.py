"""Answers to operators, and their times."""

from __future__ import annotations

import math

import pytest

from moar_companion.companion.flight_limits import FlightLimits
from moar_companion.settings.config import Authority

from ..mavlink.peer import Peer
from .commands import OPERATOR_LINK, hovering
from .desk import (
    ACCEPTED,
    CANCELLED,
    DENIED,
    EVACUATION,
    EXIT,
    FAILED,
    HOLD,
    IN_PROGRESS,
    INSPECTION,
    LINK,
    PAUSE_CONTINUE,
    RELEASE,
    TEMPORARILY_REJECTED,
    USER_1,
    Desk,
)
from .scripted_autopilot import OFFBOARD, POSCTL


def test_a_mission_ordered_in_the_air_is_accepted_when_its_plan_is_ready():
    desk = Desk().run(1.2).order(INSPECTION)
    desk.step()
    assert (desk.state, desk.answers()) == ("planning", [])
    assert desk.texts() == ["MOAR: planning inspection"]
    desk.run(0.1)
    assert (desk.state, desk.answers()) == ("ready", [ACCEPTED])
    acknowledged = desk.messages("COMMAND_ACK")[0]
    assert (acknowledged.target_system, acknowledged.target_component) == (255, 190)
    assert (acknowledged.get_srcSystem(), acknowledged.get_srcComponent()) == (1, 195)
    assert desk.said("MOAR: ready for inspection")


def test_an_order_whose_plan_cannot_be_requested_is_denied(monkeypatch):
    desk = Desk().run(1.2)
    monkeypatch.setattr(FlightLimits, "volume", None)
    desk.order(INSPECTION).run(0.1)
    assert (desk.state, desk.answers()) == ("idle", [DENIED])
    assert desk.said("MOAR: no site is loaded, denied")


@pytest.mark.parametrize(
    ("case", "armed", "landed_state", "reason"),
    [
        ("armed on the ground", True, 1, "not in the air"),
        ("disarmed on the ground", False, 1, "not in the air"),
        ("disarmed, though it says in the air", False, 2, "not in the air"),
        ("still taking off", True, 3, "taking off"),
        ("landed state unknown", True, 0, "not in the air"),
    ],
)
def test_a_mission_is_temporarily_rejected_unless_in_the_air(case, armed, landed_state, reason):
    desk = Desk()
    desk.armed, desk.landed_state = armed, landed_state
    desk.run(1.2).order(INSPECTION).run(1.0)
    assert (desk.state, desk.answers()) == ("idle", [TEMPORARILY_REJECTED])
    assert desk.said(f"MOAR: {reason}, rejected")
    assert not desk.setpoints()


@pytest.mark.parametrize("mission", [INSPECTION, EXIT, EVACUATION])
def test_an_index_out_of_range_is_denied_with_the_number_of_targets(mission):
    desk = Desk().run(1.2).order(mission, 7.0).run(0.2)
    assert (desk.state, desk.answers()) == ("idle", [DENIED])
    assert desk.said(" 7 of ")


@pytest.mark.parametrize("index", [-1.0, math.nan])
def test_without_an_index_all_targets_are_visited_in_turn(index):
    desk = Desk().run(1.2).order(INSPECTION, index).run(0.2)
    assert desk.companion.status.task.stops == ("splice-outer", "splice-inner")


def test_with_an_index_one_target_is_visited():
    desk = Desk().run(1.2).order(INSPECTION, 1.0).run(0.2)
    assert desk.companion.status.task.stops == ("splice-inner",)


def test_while_planning_takes_long_the_order_is_in_progress_and_then_accepted():
    desk = Desk(plan_delay_s=None).run(1.2).order(INSPECTION)
    desk.run(0.2)
    assert desk.answers() == []
    desk.run(0.04)
    assert desk.answers() == [IN_PROGRESS]
    desk.run(3.0)
    assert desk.answers() == [IN_PROGRESS] * 4
    assert {m.progress for m in desk.messages("COMMAND_ACK") if m.command == USER_1} == {50}
    desk.answer_plan().step()
    assert desk.answers() == [IN_PROGRESS] * 4 + [ACCEPTED]
    assert desk.state == "ready"


def test_an_order_that_waits_for_the_planner_is_in_progress_at_0_percent():
    desk = Desk().run(1.2)
    desk.companion.await_planner()
    desk.order(INSPECTION).run(2.5)
    assert desk.answers() == [IN_PROGRESS] * 3
    assert {m.progress for m in desk.messages("COMMAND_ACK") if m.command == USER_1} == {0}


def test_a_mission_that_cannot_be_planned_is_denied_with_a_text():
    desk = Desk(plan_delay_s=None).run(1.2).order(INSPECTION).step()
    desk.answer_plan(plan=None, reason="no free path leads there")
    desk.run(0.1)
    assert (desk.state, desk.answers()) == ("idle", [DENIED])
    texts = [text for text in desk.texts() if "no free path" in text]
    assert texts == ["MOAR: no free path leads there, denied"]
    assert not desk.setpoints()


@pytest.mark.uncounted
def test_in_flight_a_mission_that_cannot_be_planned_is_denied_and_the_flight_goes_on():
    desk = Desk().come_to("flying")
    desk.plan_delay_s = None
    desk.run(3.0)  # later replans have no answer
    desk.order(EVACUATION).step().answer_plan(plan=None, reason="no landing point can be seen")
    before = desk.now_s
    desk.plan_delay_s = 0.04
    desk.run(1.0)
    assert desk.answers()[-1] == DENIED
    assert desk.said("no landing point can be seen")
    assert desk.state == "flying"
    assert len(desk.setpoints(before)) == 50
    assert desk.run_until("at_target", 60.0).state == "at_target"


def test_a_second_order_from_another_operator_cancels_the_first():
    desk = Desk(plan_delay_s=None).run(1.2).order(INSPECTION).step()
    tablet = Peer(254, 190)
    desk.order(EXIT, peer=tablet).step()
    answered = [(message.target_system, message.result) for message in desk.messages("COMMAND_ACK")]
    assert answered == [(255, CANCELLED)]
    desk.answer_plan(0).step()  # the first plan is late
    assert desk.state == "planning"
    desk.answer_plan(1).step()
    assert desk.companion.status.task.mission.value == "exit"
    answered = [(message.target_system, message.result) for message in desk.messages("COMMAND_ACK")]
    assert answered == [(255, CANCELLED), (254, ACCEPTED)]


def test_an_order_cancelled_during_planning_is_not_flown_and_its_plan_is_dropped():
    desk = Desk(plan_delay_s=None).run(1.2).order(INSPECTION).step()
    desk.take_back().step()
    assert (desk.state, desk.answers()) == ("idle", [CANCELLED])
    desk.answer_plan().run(1.0)
    assert desk.state == "idle"
    assert not desk.setpoints()


@pytest.mark.uncounted
def test_an_order_cancelled_in_flight_is_not_flown_when_its_plan_comes():
    desk = Desk().come_to("flying")
    desk.plan_delay_s = None
    desk.run(0.2).order(EVACUATION).step()
    evacuation = len(desk.jobs) - 1
    desk.take_back().step()
    adopted = len(desk.decided("plan"))
    desk.answer_plan(evacuation).step()
    assert len(desk.decided("plan")) == adopted
    assert desk.companion.status.task.mission.value == "inspection"
    desk.plan_delay_s = 0.04
    assert desk.run_until("at_target", 60.0).state == "at_target"


@pytest.mark.uncounted
def test_pause_holds_and_continue_resumes_the_mission():
    desk = Desk().come_to("flying", then_s=5.0)
    desk.order(0.0, command=PAUSE_CONTINUE).run(2.0)
    assert (desk.state, desk.answers(PAUSE_CONTINUE)) == ("holding", [ACCEPTED])
    place = desk.position_ned_m
    last = desk.run(5.0).setpoints()[-1]
    assert (last.vx, last.vy, last.vz) == (0.0, 0.0, 0.0)
    assert math.dist(desk.position_ned_m, place) < 1e-3
    desk.order(1.0, command=PAUSE_CONTINUE).run(0.2)
    assert (desk.state, desk.answers(PAUSE_CONTINUE)) == ("flying", [ACCEPTED, ACCEPTED])
    assert desk.run_until("at_target", 60.0).state == "at_target"


def test_continue_without_a_held_mission_is_rejected():
    desk = Desk().come_to("flying").order(1.0, command=PAUSE_CONTINUE).run(0.1)
    assert desk.answers(PAUSE_CONTINUE) == [TEMPORARILY_REJECTED]
    assert desk.state == "flying"


def test_an_order_in_the_cycle_of_the_mode_change_is_judged_as_under_control():
    desk = Desk().come_to("ready", then_s=1.1)
    desk.velocity_ned_mps = (0.0, 1.2, 0.0)
    desk.run(0.1).run_to_position().send_heartbeat(OFFBOARD).order(EXIT).step()
    assert desk.state == "flying"
    desk.run(0.2)
    assert desk.answers() == [ACCEPTED, ACCEPTED]
    assert desk.companion.status.task.mission.value == "exit"


@pytest.mark.parametrize("state", ["ready", "flying", "at_target"])
def test_release_ends_the_stream_with_one_last_setpoint_at_rest(state):
    desk = Desk().come_to(state)
    desk.order(RELEASE).step()
    assert desk.state == "released"
    assert desk.answers()[-1] == ACCEPTED
    before = desk.now_s
    last = desk.setpoints()[-1]
    assert (last.vx, last.vy, last.vz) == (0.0, 0.0, 0.0)
    desk.run(6.0)
    assert desk.setpoints(before) == []


def test_hold_without_a_mission_is_rejected():
    desk = Desk().run(1.2).order(HOLD).run(0.1)
    assert (desk.state, desk.answers()) == ("idle", [TEMPORARILY_REJECTED])


def test_an_open_order_fails_when_the_pilot_takes_over():
    desk = Desk().come_to("flying")
    desk.plan_delay_s = None
    desk.order(EXIT).step().send_heartbeat(POSCTL).step()
    assert desk.state == "overridden"
    assert desk.answers()[-1] == FAILED


def test_an_operators_own_link_is_answered_there():
    desk = hovering()
    desk.handle(desk.operator.command(USER_1, INSPECTION, -1.0), OPERATOR_LINK).run(0.2)
    acknowledged = [link for _, link, m in desk.sent if m.get_type() == "COMMAND_ACK"]
    assert acknowledged == [OPERATOR_LINK]
    texts = {link for _, link, m in desk.sent if m.get_type() == "STATUSTEXT"}
    assert texts == {LINK, OPERATOR_LINK}
    streams = {link for _, link, m in desk.sent if m.get_type() == "SET_POSITION_TARGET_LOCAL_NED"}
    assert streams == {LINK}


# Authority and site -----------------------------------------------------------------------------


@pytest.mark.parametrize("mission", [INSPECTION, EXIT, EVACUATION])
def test_an_observer_denies_missions_with_a_text_and_never_streams(mission):
    desk = Desk(authority=Authority.OBSERVE).run(1.2)
    desk.order(mission).send_heartbeat(OFFBOARD).run(8.0)
    assert (desk.state, desk.answers()) == ("idle", [DENIED])
    assert desk.said("the authority is observe")
    assert not desk.setpoints()
    assert not desk.mode_requests()


def test_without_a_site_missions_are_denied_and_risks_are_still_reported():
    desk = Desk(with_site=False).run(1.2).order(INSPECTION).run(2.0)
    assert desk.answers() == [DENIED]
    assert desk.said("no site is loaded")
    names = {message.name for message in desk.messages("NAMED_VALUE_FLOAT")}
    assert names == {
        "RISK_WIND",
        "RISK_COMM",
        "RISK_LOC",
        "RISK_BATT",
        "K_SAFETY",
        "K_TIME",
        "K_ENERGY",
    }

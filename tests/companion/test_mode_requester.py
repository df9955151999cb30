"""Requests of the companion's mode and of the landing under `engage`: times and repeats."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from unittest import mock

import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.companion.mission.values import MissionStatus
from moar_companion.companion.mission_states import MissionState
from moar_companion.companion.mode_requester import ModeRequester
from moar_companion.planner.planner import Planner
from moar_companion.settings.config import Authority
from moar_companion.types import Mission

from .desk import (
    ACCEPTED,
    DENIED,
    DO_SET_MODE,
    EVACUATION,
    EXIT,
    HOLD,
    INSPECTION,
    RELEASE,
    STEP_S,
    TEMPORARILY_REJECTED,
    Desk,
    usual_planner,
)
from .scripted_autopilot import ACTIVE, AUTO_HOLD, BRAKE, CRITICAL, GUIDED, LOITER, POSCTL, RTL

PX4, ARDUPILOT = mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA
TAKEOFF, LANDING = 0x02040000, 0x06040000
LONG_S = 3.5
"""Longer than the time from an order or an arrival to the mode request."""


@pytest.mark.parametrize("authority", [Authority.STREAM, Authority.ENGAGE])
def test_only_engage_requests_the_mode_after_the_stream_has_run_and_only_once(authority):
    desk = Desk(authority=authority).come_to("ready")
    assert not desk.mode_requests()
    desk.run(1.0)
    assert not desk.mode_requests()
    desk.run(6.0)
    requests = desk.mode_requests()
    if authority is Authority.STREAM:
        assert not requests
    else:
        assert [(m.target_system, m.target_component, m.param2) for m in requests] == [(1, 1, 6)]


def test_a_pilot_who_changes_the_mode_after_the_order_keeps_control():
    desk = Desk(authority=Authority.ENGAGE).come_to("ready", then_s=0.5)
    desk.send_heartbeat(POSCTL).run(LONG_S)
    assert not desk.mode_requests()
    desk.send_heartbeat(AUTO_HOLD).run(LONG_S)  # no later request
    assert not desk.mode_requests()


def test_no_mode_is_requested_from_a_pilot_who_has_overridden():
    desk = Desk(authority=Authority.ENGAGE).come_to("flying", then_s=0.5)
    desk.send_heartbeat(POSCTL).run(2.0)
    asked = desk.now_s
    desk.order(EXIT).run(LONG_S)
    assert desk.state == "ready"
    assert not desk.mode_requests(asked)


@pytest.mark.parametrize("later_s", [0.02, 0.5])
def test_a_second_order_while_the_pilot_still_flies_requests_no_mode(later_s):
    desk = Desk(authority=Authority.ENGAGE).come_to("flying", then_s=0.5)
    desk.send_heartbeat(POSCTL).run(2.0)
    asked = desk.now_s
    desk.order(EXIT).run(later_s).order(INSPECTION).run(LONG_S)
    assert desk.state == "ready"
    assert not desk.mode_requests(asked)


@pytest.mark.parametrize(
    ("autopilot", "pilots"), [(PX4, POSCTL), (ARDUPILOT, LOITER)], ids=["px4", "ardupilot"]
)
@pytest.mark.parametrize("steps", [0, 1, 30])
def test_an_order_that_crosses_a_pilots_takeover_requests_no_mode(autopilot, pilots, steps):
    desk = Desk(autopilot=autopilot, authority=Authority.ENGAGE).come_to("flying", then_s=1.0)
    desk.run_to_heartbeat()
    asked = desk.now_s
    desk.send_heartbeat(pilots)
    for _ in range(steps):
        desk.step()
    desk.order(INSPECTION).run(LONG_S)
    assert desk.state == ("overridden" if steps < 25 else "ready")
    assert not desk.mode_requests(asked)


def test_a_mission_ordered_while_overridden_requests_no_mode():
    desk = Desk(authority=Authority.ENGAGE).come_to("idle").run_to_heartbeat()
    status, session = MissionStatus(state=MissionState.READY), mock.Mock()
    telemetry = desk.companion.telemetry
    autopilot = telemetry.autopilot
    for before, asked in ((MissionState.OVERRIDDEN, 0), (MissionState.IDLE, 1)):
        mode_requester = ModeRequester(Authority.ENGAGE, session, mock.Mock(), pilot_flies=False)
        mode_requester.note_order(autopilot, before, autopilot.received_s)
        mode_requester.act(status, telemetry, at_end=False, now_s=autopilot.received_s)
        assert session.request_own_mode.call_count == asked


def test_no_mode_is_requested_in_a_failsafe():
    desk = Desk(authority=Authority.ENGAGE).run(1.2)
    desk.send_heartbeat(AUTO_HOLD, CRITICAL).run(1.0)
    desk.order(EXIT).run(LONG_S)
    assert desk.state == "ready"
    assert not desk.mode_requests()


@pytest.mark.parametrize(
    ("autopilot", "mode"), [(PX4, 0x05040000), (PX4, LANDING), (ARDUPILOT, RTL), (ARDUPILOT, BRAKE)]
)
@pytest.mark.parametrize("status", [CRITICAL, ACTIVE])
def test_no_return_or_landing_is_ended_whatever_reason_the_autopilot_reports(
    autopilot, mode, status
):
    """ArduPilot's fence acts with status ACTIVE; a failsafe that has cleared still lands."""
    desk = Desk(autopilot=autopilot, authority=Authority.ENGAGE).run(1.2)
    desk.send_heartbeat(mode, CRITICAL).run(2.0)
    desk.send_heartbeat(mode, status).run(1.0)
    desk.order(EXIT).run(LONG_S)
    assert desk.state == "ready"
    assert not desk.mode_requests()


def test_ardupilots_guided_is_requested_once():
    desk = Desk(autopilot=ARDUPILOT, authority=Authority.ENGAGE).come_to("ready", then_s=6.0)
    requests = [
        (m.target_system, m.target_component, m.param1, m.param2, m.param3)
        for m in desk.mode_requests()
    ]
    assert requests == [(1, 1, 1, 4, 0)]


@pytest.mark.slow
def test_ardupilots_landing_is_requested_above_the_landing_point():
    desk = Desk(autopilot=ARDUPILOT, authority=Authority.ENGAGE).come_to(
        "holding", EXIT, then_s=2.0
    )
    assert [(m.param1, m.param2) for m in desk.mode_requests()] == [(1, 9)]


@pytest.mark.uncounted
@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_an_unanswered_mode_request_is_repeated_twice_and_then_left_to_the_pilot(autopilot):
    desk = Desk(autopilot=autopilot, authority=Authority.ENGAGE)
    desk.mute = {"COMMAND_ACK"}
    desk.come_to("ready", then_s=8.0)
    asked = [time_s for time_s, _, message in desk.sent if message in desk.mode_requests()]
    assert len(asked) == 3
    assert min(later - before for before, later in pairwise(asked)) >= 1.0
    assert desk.said(" kept, waiting for ")


@pytest.mark.parametrize("status", [ACTIVE, CRITICAL])
def test_a_mode_request_is_not_repeated_after_another_mode_or_a_failsafe(status):
    desk = Desk(authority=Authority.ENGAGE)
    desk.mute = {"COMMAND_ACK"}
    desk.come_to("ready")
    while not desk.mode_requests():
        desk.step()
    desk.send_heartbeat(POSCTL if status == ACTIVE else AUTO_HOLD, status).run(0.5)
    desk.send_heartbeat(AUTO_HOLD).run(5.0)
    assert len(desk.mode_requests()) == 1


@pytest.mark.parametrize(
    ("result", "words"), [(DENIED, "denied"), (1, "temporarily rejected"), (9, "result 9")]
)
def test_a_refused_mode_is_reported_with_the_autopilots_result(result, words):
    desk = Desk(authority=Authority.ENGAGE).come_to("ready", then_s=2.5)
    assert len(desk.mode_requests()) == 1
    refusal = mavlink.MAVLink_command_ack_message(DO_SET_MODE, result, 0, 0, 1, 195)
    desk.handle(desk.autopilot.pack(refusal)).run(5.0)
    assert [t for t in desk.texts() if "refused" in t] == [f"MOAR: mode request refused: {words}"]
    assert desk.state == "ready"
    assert len(desk.mode_requests()) == 1


def test_a_mode_that_is_refused_repeatedly_is_reported_once():
    """PX4 sends more than one answer for a refused mode."""
    desk = Desk(authority=Authority.ENGAGE).come_to("ready", then_s=2.5)
    for _ in range(3):
        refusal = mavlink.MAVLink_command_ack_message(DO_SET_MODE, DENIED, 0, 0, 1, 195)
        desk.handle(desk.autopilot.pack(refusal)).run(0.1)
    assert len([text for text in desk.texts() if "refused" in text]) == 1


@pytest.mark.slow
@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
@pytest.mark.parametrize("hold", ["in the instant of the arrival", "before the next heartbeat"])
def test_after_an_ordered_hold_no_landing_is_requested(autopilot, hold):
    desk = Desk(autopilot=autopilot, authority=Authority.ENGAGE).come_to("holding", EXIT)
    arrived = desk.now_s
    if hold == "in the instant of the arrival":
        desk = Desk(autopilot=autopilot, authority=Authority.ENGAGE).come_to("landing_leg", EXIT)
        desk.run(arrived - desk.now_s - STEP_S)
    assert not desk.mode_requests()
    desk.order(HOLD).run(LONG_S)
    assert (desk.state, desk.answers()[-1]) == ("holding", ACCEPTED)
    assert desk.said("MOAR: landing leg of the exit")
    assert not desk.mode_requests()


@pytest.mark.slow
def test_a_mission_ordered_above_the_landing_point_is_not_ended_by_the_landing():
    usual = usual_planner()
    inside = dict.fromkeys((Mission.EXIT, Mission.EVACUATION), ((27.0, 2.5),))
    planner = Planner(replace(usual.site, landing_m=inside), usual.vehicle)
    desk = Desk(planner=planner, authority=Authority.ENGAGE, height_m=9.0, east_m=-4.0)
    desk.come_to("holding", EXIT)
    desk.plan_delay_s = 2.5
    desk.order(INSPECTION).run_until("flying", 3.0).run(5.0)
    assert desk.answers()[-1] == ACCEPTED
    assert not desk.mode_requests()


@pytest.mark.slow
def test_a_mission_that_is_denied_above_the_landing_point_leaves_the_landing_request_on():
    desk = Desk(authority=Authority.ENGAGE).come_to("holding", EXIT)
    desk.plan_delay_s = 2.5
    desk.set_parameters(COM_OBL_RC_ACT=7.0).order(INSPECTION).run(2.4)
    assert not desk.mode_requests()
    desk.run(1.2)
    assert desk.answers()[-1] == DENIED
    assert len(desk.mode_requests()) == 1


@pytest.mark.parametrize("autopilot", [pytest.param(PX4, marks=pytest.mark.slow), ARDUPILOT])
def test_a_landing_that_does_not_begin_is_requested_twice_more_and_then_left_to_the_pilot(
    autopilot,
):
    desk = Desk(autopilot=autopilot, authority=Authority.ENGAGE).come_to("holding", EXIT)
    for requests, seconds in ((1, 1.5), (1, 1.5), (2, 2.0), (3, 3.0)):
        desk.run(seconds)
        assert len(desk.mode_requests()) == requests
    assert not desk.said("the landing has not begun")
    desk.run(6.0)
    assert len(desk.mode_requests()) == 3
    reported = [text for text in desk.texts() if "landing has" in text]
    assert reported == ["MOAR: the landing has not begun, choose LAND"]


@pytest.mark.uncounted
def test_a_hold_ordered_between_two_landing_requests_ends_the_requests():
    desk = Desk(authority=Authority.ENGAGE).come_to("holding", EXIT, then_s=2.0)
    assert len(desk.mode_requests()) == 1
    desk.order(HOLD).run(6.0)
    assert len(desk.mode_requests()) == 1
    assert not desk.said("the landing has not begun")


def test_a_landing_that_the_companion_requested_is_no_takeover():
    desk = Desk(authority=Authority.ENGAGE).come_to("holding", EXIT, then_s=2.0)
    assert [(m.param2, m.param3) for m in desk.mode_requests()] == [(4, 6)]
    desk.send_heartbeat(LANDING).run(1.0)
    assert desk.state == "idle"
    assert desk.said("MOAR: autopilot in LAND")


@pytest.mark.slow
@pytest.mark.parametrize("after_s", [4.0, 60.0])
def test_a_landing_after_a_lost_request_and_a_hold_is_a_takeover(after_s):
    desk = Desk(authority=Authority.ENGAGE).come_to("holding", EXIT, then_s=2.0).order(HOLD)
    desk.run(after_s).send_heartbeat(LANDING).run(1.0)
    assert desk.state == "overridden"


def test_a_pilot_who_ends_the_requested_landing_keeps_control():
    desk = Desk(authority=Authority.ENGAGE).come_to("holding", EXIT, then_s=2.0)
    desk.send_heartbeat(LANDING).run(1.0)
    desk.send_heartbeat(POSCTL).run(1.0)
    requests = len(desk.mode_requests())
    desk.order(EXIT).run(LONG_S)
    assert len(desk.mode_requests()) == requests


@pytest.mark.uncounted
def test_no_landing_is_requested_beside_the_landing_point():
    desk = Desk(authority=Authority.ENGAGE).come_to("holding", EXIT, then_s=1.1)
    assert len(desk.mode_requests()) == 1
    desk.fall_behind(1.8, 0.0, 0.0, seconds=1.0).run(5.0)
    assert len(desk.mode_requests()) == 1
    desk.fall_behind(0.0, 0.0, 0.0, seconds=1.0).run(5.0)
    assert len(desk.mode_requests()) > 1


@pytest.mark.slow
def test_without_engage_the_pilot_lands():
    desk = Desk().come_to("holding", EXIT, then_s=5.0)
    assert not desk.mode_requests()
    desk.send_heartbeat(LANDING).run(1.0)
    assert desk.state == "overridden"


@pytest.mark.parametrize("held_by", ["pause", "order"])
def test_a_hold_while_ready_requests_no_mode(held_by):
    desk = Desk(authority=Authority.ENGAGE).come_to("ready", then_s=0.5)
    if held_by == "pause":
        desk.pause()
    else:
        desk.order(HOLD)
    desk.run(LONG_S)
    assert desk.state == "ready"
    assert not desk.mode_requests()


def test_a_rejected_order_requests_no_mode():
    """The pilot takes over; an operator orders again while no mission can start."""
    desk = Desk(authority=Authority.ENGAGE).come_to("ready", then_s=0.5)
    desk.landed_state = 0
    desk.run(0.3).send_heartbeat(POSCTL).order(EXIT).run(LONG_S)
    assert desk.answers()[-1] == TEMPORARILY_REJECTED
    assert not desk.mode_requests()


def test_the_hold_after_a_take_off_is_no_takeover():
    desk = Desk(authority=Authority.ENGAGE)
    desk.mode = TAKEOFF
    desk.come_to("ready").send_heartbeat(AUTO_HOLD).run(LONG_S)
    assert [m.param2 for m in desk.mode_requests()] == [6]


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
def test_a_mode_is_requested_only_just_after_a_mode_report(autopilot):
    """PX4 reports its mode once a second: the pilot may have chosen a return meanwhile."""
    desk = Desk(autopilot=autopilot, authority=Authority.ENGAGE).come_to("ready").run_to_heartbeat()
    desk.run(
        0.9
    )  # a request is permitted from now on, but the last mode report is almost a second old
    while not desk.mode_requests():
        asked = desk.now_s
        desk.step()
    assert asked - desk.companion.telemetry.autopilot.received_s <= 0.1


@pytest.mark.parametrize(
    ("autopilot", "pilots"), [(PX4, POSCTL), (ARDUPILOT, LOITER)], ids=["px4", "ardupilot"]
)
def test_a_pilot_who_takes_over_instead_of_the_landing_keeps_control(autopilot, pilots):
    desk = Desk(autopilot=autopilot, authority=Authority.ENGAGE).come_to(
        "holding", EXIT, then_s=2.5
    )
    requests = len(desk.mode_requests())
    desk.send_heartbeat(pilots).run(1.0)
    assert desk.state == "overridden"
    desk.order(EXIT).run(LONG_S)
    assert len(desk.mode_requests()) == requests


@pytest.mark.parametrize(
    ("autopilot", "pilots"), [(PX4, POSCTL), (ARDUPILOT, LOITER)], ids=["px4", "ardupilot"]
)
def test_a_pilot_who_takes_over_from_a_failsafe_keeps_control(autopilot, pilots):
    desk = Desk(autopilot=autopilot, authority=Authority.ENGAGE).come_to("flying", then_s=1.0)
    desk.send_heartbeat(RTL if autopilot == ARDUPILOT else 0x05040000, CRITICAL).run(2.0)
    desk.send_heartbeat(pilots).run(2.0)
    asked = desk.now_s
    desk.order(EXIT).run(LONG_S)
    assert desk.state == "ready"
    assert not desk.mode_requests(asked)


@pytest.mark.parametrize(
    ("autopilot", "pilots"), [(PX4, POSCTL), (ARDUPILOT, LOITER)], ids=["px4", "ardupilot"]
)
def test_a_pilot_who_takes_over_from_a_failsafe_before_the_first_flight_keeps_control(
    autopilot, pilots
):
    desk = Desk(autopilot=autopilot, authority=Authority.ENGAGE).come_to("ready", then_s=0.5)
    desk.send_heartbeat(RTL if autopilot == ARDUPILOT else LANDING, CRITICAL).run(1.0)
    desk.send_heartbeat(pilots).run(LONG_S)
    desk.order(EVACUATION).run(LONG_S)
    assert desk.state == "ready"
    assert not desk.mode_requests()


def test_a_failsafe_that_returns_to_the_mode_of_the_order_leaves_control_to_the_pilot():
    """HOLD, LAND, HOLD before the mode may be requested."""
    desk = Desk(authority=Authority.ENGAGE).come_to("idle").run_to_heartbeat()
    session, telemetry = mock.Mock(), desk.companion.telemetry
    autopilot = telemetry.autopilot
    mode_requester = ModeRequester(Authority.ENGAGE, session, mock.Mock(), pilot_flies=False)
    mode_requester.note_order(autopilot, MissionState.IDLE, autopilot.received_s)
    lands = replace(autopilot, mode="LAND", homeward=True, failsafe=True)
    for since_s, reported in ((0.0, lands), (-2.0, autopilot)):
        status = MissionStatus(state=MissionState.READY, since_s=autopilot.received_s + since_s)
        seen = replace(telemetry, autopilot=reported)
        mode_requester.act(status, seen, at_end=False, now_s=autopilot.received_s)
    assert not session.request_own_mode.called


def test_a_resumed_flight_requests_no_mode_from_a_pilot_who_has_overridden():
    """The pilot gave GUIDED, so the first order requested no mode."""
    desk = Desk(autopilot=ARDUPILOT, authority=Authority.ENGAGE, resume=True)
    desk.come_to("ready", then_s=0.5).send_heartbeat(GUIDED).run_until("flying").run(1.0)
    desk.send_heartbeat(LOITER).run(2.0)
    desk.plan_delay_s = 0.6
    desk.send_heartbeat(GUIDED).run(0.2)
    assert desk.state == "planning"
    desk.send_heartbeat(LOITER).run(LONG_S)
    assert desk.state == "ready"
    assert not desk.mode_requests()


def test_after_a_release_while_ready_the_next_order_requests_the_mode_again():
    """The pilot's HOLD is no takeover: the next order requests the companion's mode again."""
    desk = Desk(authority=Authority.ENGAGE).come_to("ready", then_s=0.5)
    desk.order(RELEASE).run(1.0)
    assert (desk.state, desk.mode) == ("released", AUTO_HOLD)
    asked = len(desk.mode_requests())
    desk.order(EVACUATION).run(LONG_S)
    assert desk.answers()[-1] == ACCEPTED
    assert len(desk.mode_requests()) == asked + 1


def test_an_order_that_requests_no_mode_reports_the_mode_that_is_kept():
    desk = Desk(authority=Authority.ENGAGE).come_to("flying", then_s=1.0)
    desk.send_heartbeat(POSCTL).run(3.0)
    desk.order(EXIT).run(3.0)
    assert desk.state == "ready"
    assert desk.said("MOAR: POSCTL kept, waiting for OFFBOARD")

"""Under `engage` the companion may ask for its mode and for the landing: when, and how often."""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.config import Authority

from .desk import (
    AUTO_HOLD,
    CRITICAL,
    DENIED,
    DO_SET_MODE,
    EXIT,
    HOLD,
    INSPECTION,
    POSCTL,
    TEMPORARILY_REJECTED,
    Desk,
)

TAKEOFF, LANDING = 0x02040000, 0x06040000


@pytest.mark.parametrize("authority", [Authority.STREAM, Authority.ENGAGE])
def test_only_engage_asks_for_the_mode_once_the_stream_has_run_and_never_twice(authority):
    desk = Desk(authority=authority).come_to("ready")
    assert not desk.mode_requests()
    desk.run(1.0)
    assert not desk.mode_requests()
    desk.run(20.0)
    requests = desk.mode_requests()
    if authority is Authority.STREAM:
        assert not requests
    else:
        assert [(m.target_system, m.target_component, m.param2) for m in requests] == [(1, 1, 6)]


def test_a_pilot_who_changes_the_mode_after_the_order_keeps_it():
    desk = Desk(authority=Authority.ENGAGE).come_to("ready").run(0.5)
    desk.say_heartbeat(POSCTL).run(20.0)
    assert not desk.mode_requests()
    desk.say_heartbeat(AUTO_HOLD).run(5.0)  # nor is it asked for later
    assert not desk.mode_requests()


def test_no_mode_is_taken_from_a_pilot_who_has_overridden():
    desk = Desk(authority=Authority.ENGAGE).come_to("flying").run(0.5)
    desk.say_heartbeat(POSCTL).run(2.0)
    asked = desk.now_s
    desk.order(EXIT).run(5.0)
    assert desk.state == "ready"
    assert not desk.mode_requests(asked)


@pytest.mark.parametrize("later_s", [0.02, 0.5])
def test_nor_by_a_second_order_while_he_still_flies(later_s):
    desk = Desk(authority=Authority.ENGAGE).come_to("flying").run(0.5)
    desk.say_heartbeat(POSCTL).run(2.0)
    asked = desk.now_s
    desk.order(EXIT).run(later_s).order(INSPECTION).run(5.0)
    assert desk.state == "ready"
    assert not desk.mode_requests(asked)


def test_no_mode_is_asked_for_in_a_failsafe():
    desk = Desk(authority=Authority.ENGAGE).run(1.2)
    desk.say_heartbeat(AUTO_HOLD, CRITICAL).run(1.0)
    desk.order(EXIT).run(5.0)
    assert desk.state == "ready"
    assert not desk.mode_requests()


def test_a_mode_that_is_refused_is_told():
    desk = Desk(authority=Authority.ENGAGE).come_to("ready").run(1.5)
    assert len(desk.mode_requests()) == 1
    refusal = mavlink.MAVLink_command_ack_message(DO_SET_MODE, DENIED, 0, 0, 1, 195)
    desk.hear(desk.autopilot.pack(refusal)).run(5.0)
    assert [t for t in desk.texts() if "refused" in t] == ["MOAR: the autopilot refused the mode"]
    assert desk.state == "ready"
    assert len(desk.mode_requests()) == 1


def test_a_mode_refused_over_and_over_is_told_once():
    """PX4 answers a mode it will not give more than once."""
    desk = Desk(authority=Authority.ENGAGE).come_to("ready").run(1.5)
    for _ in range(3):
        refusal = mavlink.MAVLink_command_ack_message(DO_SET_MODE, DENIED, 0, 0, 1, 195)
        desk.hear(desk.autopilot.pack(refusal)).run(0.1)
    assert len([text for text in desk.texts() if "refused" in text]) == 1


def test_the_landing_is_asked_for_once_and_is_then_no_pilots():
    desk = Desk(authority=Authority.ENGAGE).come_to("holding", EXIT).run(10.0)
    assert [(m.param2, m.param3) for m in desk.mode_requests()] == [(4, 6)]
    desk.say_heartbeat(LANDING).run(1.0)
    assert desk.state == "idle"
    assert desk.said("MOAR idle: the autopilot has left our mode")
    assert not desk.said("the pilot has control")


def test_without_engage_the_pilot_lands():
    desk = Desk().come_to("holding", EXIT).run(10.0)
    assert not desk.mode_requests()
    desk.say_heartbeat(LANDING).run(1.0)
    assert desk.state == "overridden"


@pytest.mark.parametrize("held_by", ["pause", "order"])
def test_a_hold_while_ready_asks_for_no_mode(held_by):
    desk = Desk(authority=Authority.ENGAGE).come_to("ready").run(0.5)
    if held_by == "pause":
        desk.pause()
    else:
        desk.order(HOLD)
    desk.run(5.0)
    assert desk.state == "ready"
    assert not desk.mode_requests()


def test_an_order_that_was_rejected_takes_no_mode():
    """The pilot takes over, and somebody orders again while nothing may be begun."""
    desk = Desk(authority=Authority.ENGAGE).come_to("ready").run(0.5)
    desk.landed_state = 0
    desk.run(0.3).say_heartbeat(POSCTL).order(EXIT).run(5.0)
    assert desk.answers()[-1] == TEMPORARILY_REJECTED
    assert not desk.mode_requests()


def test_the_hold_after_a_take_off_is_no_pilots_mode():
    desk = Desk(authority=Authority.ENGAGE)
    desk.mode = TAKEOFF
    desk.come_to("ready").say_heartbeat(AUTO_HOLD).run(5.0)
    assert [m.param2 for m in desk.mode_requests()] == [6]

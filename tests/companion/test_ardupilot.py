"""An ArduPilot on the desk: GUIDED, which it lets a companion take back at any time.

At the end an autopilot of an unknown kind, which is not flown.
"""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.config import Authority

from .desk import (
    ACCEPTED,
    CRITICAL,
    EXIT,
    GUIDED,
    HOLD,
    INSPECTION,
    LOITER,
    RELEASE,
    RTL,
    TEMPORARILY_REJECTED,
    Desk,
)

LAND = 9


def ardupilot(**options):
    return Desk(autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, **options)


def test_guided_that_is_already_given_is_flown_from_as_soon_as_the_plan_is_there():
    """A take-off in GUIDED stays in GUIDED; nothing needs a stream before."""
    desk = ardupilot()
    desk.mode = GUIDED
    desk.run(1.2)
    assert not desk.setpoints()
    desk.order(INSPECTION).run(0.2)
    assert (desk.state, desk.answers()) == ("flying", [ACCEPTED])
    assert not desk.mode_requests()


def test_an_aircraft_that_flies_elsewhere_in_guided_is_asked_to_hover_first():
    desk = ardupilot()
    desk.mode = GUIDED
    desk.velocity_ned_mps = (0.0, 3.0, 0.0)
    desk.position_ned_m = (0.0, 0.0, -2.6)
    desk.run(0.1).order(INSPECTION).run(0.2)
    assert (desk.state, desk.answers()) == ("idle", [TEMPORARILY_REJECTED])
    assert desk.said("moving at 3.0 m/s > 1, hover")
    assert not desk.setpoints()


@pytest.mark.parametrize("landed_state", [0, 1, 3])
def test_nothing_is_streamed_before_it_is_in_the_air(landed_state):
    """Setpoints between the acknowledgement of a take-off and lift-off cancel the take-off."""
    desk = ardupilot()
    desk.mode, desk.landed_state = GUIDED, landed_state
    desk.run(1.2).order(INSPECTION).run(3.0)
    assert desk.answers() == [TEMPORARILY_REJECTED]
    desk.landed_state = 2
    desk.run(3.0)
    assert not desk.setpoints()


@pytest.mark.parametrize("authority", [Authority.STREAM, Authority.ENGAGE])
@pytest.mark.parametrize(
    ("failsafe", "state"), [(RTL, "released"), (LAND, "released"), (LOITER, "overridden")]
)
def test_a_failsafe_is_never_flown_out_of_though_guided_would_be_given(failsafe, state, authority):
    """LOITER no failsafe chooses: that is a pilot, while one is told."""
    desk = ardupilot(authority=authority).come_to("flying", then_s=2.0)
    desk.say_heartbeat(failsafe, CRITICAL)
    acted = desk.now_s
    asked = len(desk.mode_requests())
    desk.run(6.0)
    assert desk.state == state
    desk.say_heartbeat(failsafe).run(6.0)  # the cause is over
    assert desk.state == state
    assert not desk.setpoints(acted)
    assert len(desk.mode_requests()) == asked


@pytest.mark.parametrize("authority", [Authority.STREAM, Authority.ENGAGE])
def test_a_fence_that_acts_without_a_failsafe_status_is_not_fought(authority):
    desk = ardupilot(authority=authority).come_to("flying", then_s=2.0)
    asked = len(desk.mode_requests())
    desk.say_heartbeat(RTL)
    acted = desk.now_s
    desk.run(5.0).order(EXIT).run(5.0)
    assert desk.state == "ready"  # a hold is offered, for the pilot to take
    assert len(desk.mode_requests()) == asked
    assert desk.setpoints(acted)


def test_a_pilot_who_gives_guided_back_is_not_flown_for_until_ordered():
    desk = ardupilot().come_to("flying", then_s=2.0)
    desk.say_heartbeat(LOITER)
    took = desk.now_s
    desk.run(3.0).say_heartbeat(GUIDED).run(6.0)
    assert desk.state == "overridden"
    assert not desk.setpoints(took)
    desk.order(EXIT).run(0.3)
    assert desk.state == "flying"


def test_with_resume_the_mode_given_back_goes_on_with_what_was_interrupted():
    desk = ardupilot(resume=True).come_to("flying", then_s=2.0)
    desk.say_heartbeat(LOITER).run(3.0)
    assert desk.state == "overridden"
    desk.say_heartbeat(GUIDED).run(0.3)
    assert desk.state == "flying"


@pytest.mark.parametrize("order", [RELEASE, HOLD])
def test_what_an_operator_ends_while_a_pilot_flies_is_not_resumed(order):
    desk = ardupilot(resume=True).come_to("flying", then_s=2.0)
    desk.say_heartbeat(LOITER).run(1.0)
    desk.order(order).run(1.0)
    assert desk.answers()[-1] == ACCEPTED
    took = desk.now_s
    desk.say_heartbeat(GUIDED).run(5.0)
    assert not desk.setpoints(took)


def test_a_plan_that_comes_when_the_aircraft_has_left_its_place_is_not_flown():
    """In GUIDED a ground station may have sent it elsewhere meanwhile."""
    desk = ardupilot(plan_delay_s=2.0)
    desk.mode = GUIDED
    desk.run(1.2).order(INSPECTION).drift(0.0, 0.0, -2.0).run(1.0)
    assert (desk.state, desk.answers()[-1]) == ("idle", TEMPORARILY_REJECTED)
    assert desk.said("the aircraft has left its place")
    assert not desk.setpoints()


def test_a_release_before_the_first_setpoint_sends_none_of_an_earlier_flight():
    desk = ardupilot().come_to("flying", then_s=2.0)
    desk.order(RELEASE).run(1.0)
    desk.say_heartbeat(LOITER).drift(0.0, -4.0, -2.0).say_heartbeat(GUIDED).run(1.2)
    moved = desk.now_s
    desk.plan_delay_s = None
    desk.order(INSPECTION).step()
    desk.order(RELEASE).answer_plan().run(1.0)
    assert desk.state == "released"
    assert not desk.setpoints(moved)


def test_a_mode_of_the_autopilots_own_is_not_called_the_pilots():
    desk = ardupilot().come_to("flying", then_s=2.0)
    desk.say_heartbeat(RTL).run(0.1)
    assert desk.said("MOAR: autopilot in RTL")


def test_an_order_while_it_lands_is_for_later():
    """Setpoints belong in the air: PX4 resumes OFFBOARD during a landing as soon as they come."""
    desk = ardupilot()
    desk.mode, desk.landed_state = LAND, 4
    desk.run(1.2).order(INSPECTION).run(2.0)
    assert desk.answers() == [TEMPORARILY_REJECTED]
    assert not desk.setpoints()


def test_an_autopilot_of_an_unknown_kind_is_heard_and_not_flown():
    desk = Desk(autopilot=mavlink.MAV_AUTOPILOT_GENERIC).run(8.0).order(INSPECTION).run(1.0)
    assert desk.state == "idle"
    assert desk.answers() == [TEMPORARILY_REJECTED]
    assert not desk.setpoints()

"""An ArduPilot on the desk: a companion may take GUIDED back at any time.

At the end an autopilot of an unknown kind, which is not flown.
"""

from __future__ import annotations

import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.settings.config import Authority

from .desk import ACCEPTED, EXIT, HOLD, INSPECTION, RELEASE, TEMPORARILY_REJECTED, Desk
from .scripted_autopilot import CRITICAL, GUIDED, LOITER, RTL

LAND = 9


def ardupilot(**options):
    return Desk(autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, **options)


def test_an_aircraft_already_in_guided_flies_as_soon_as_the_plan_is_ready():
    """After a take-off in GUIDED the mode stays GUIDED and needs no stream before."""
    desk = ardupilot()
    desk.mode = GUIDED
    desk.run(1.2)
    assert not desk.setpoints()
    desk.order(INSPECTION).run(0.2)
    assert (desk.state, desk.answers()) == ("flying", [ACCEPTED])
    assert not desk.mode_requests()


def test_a_mission_for_an_aircraft_that_moves_in_guided_is_rejected_until_the_aircraft_hovers():
    desk = ardupilot()
    desk.mode = GUIDED
    desk.velocity_ned_mps = (0.0, 3.0, 0.0)
    desk.position_ned_m = (0.0, 0.0, -2.6)
    desk.run(0.1).order(INSPECTION).run(0.2)
    assert (desk.state, desk.answers()) == ("idle", [TEMPORARILY_REJECTED])
    assert desk.said("moving at 3.0 m/s > 1, hover")
    assert not desk.setpoints()


@pytest.mark.parametrize("landed_state", [0, 1, 3])
def test_nothing_is_streamed_before_the_aircraft_is_in_the_air(landed_state):
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
def test_a_failsafe_is_never_left_even_if_the_autopilot_would_accept_guided(
    failsafe, state, authority
):
    """No failsafe chooses LOITER: during a reported failsafe LOITER is a takeover."""
    desk = ardupilot(authority=authority).come_to("flying", then_s=2.0)
    desk.send_heartbeat(failsafe, CRITICAL)
    acted = desk.now_s
    asked = len(desk.mode_requests())
    desk.run(6.0)
    assert desk.state == state
    desk.send_heartbeat(failsafe).run(6.0)  # the cause is over
    assert desk.state == state
    assert not desk.setpoints(acted)
    assert len(desk.mode_requests()) == asked


@pytest.mark.parametrize("authority", [Authority.STREAM, Authority.ENGAGE])
def test_a_fence_action_without_a_failsafe_status_is_not_overridden(authority):
    desk = ardupilot(authority=authority).come_to("flying", then_s=2.0)
    asked = len(desk.mode_requests())
    desk.send_heartbeat(RTL)
    acted = desk.now_s
    desk.run(5.0).order(EXIT).run(5.0)
    assert desk.state == "ready"  # the companion offers a hold to the pilot
    assert len(desk.mode_requests()) == asked
    assert desk.setpoints(acted)


def test_guided_given_back_by_a_pilot_starts_nothing_until_a_new_order():
    desk = ardupilot().come_to("flying", then_s=2.0)
    desk.send_heartbeat(LOITER)
    took = desk.now_s
    desk.run(3.0).send_heartbeat(GUIDED).run(6.0)
    assert desk.state == "overridden"
    assert not desk.setpoints(took)
    desk.order(EXIT).run(0.3)
    assert desk.state == "flying"


def test_with_resume_the_mode_given_back_resumes_the_interrupted_mission():
    desk = ardupilot(resume=True).come_to("flying", then_s=2.0)
    desk.send_heartbeat(LOITER).run(3.0)
    assert desk.state == "overridden"
    desk.send_heartbeat(GUIDED).run(0.3)
    assert desk.state == "flying"


@pytest.mark.parametrize("order", [RELEASE, HOLD])
def test_a_mission_that_an_operator_ends_while_a_pilot_flies_is_not_resumed(order):
    desk = ardupilot(resume=True).come_to("flying", then_s=2.0)
    desk.send_heartbeat(LOITER).run(1.0)
    desk.order(order).run(1.0)
    assert desk.answers()[-1] == ACCEPTED
    took = desk.now_s
    desk.send_heartbeat(GUIDED).run(5.0)
    assert not desk.setpoints(took)


def test_a_plan_is_not_flown_when_the_aircraft_has_left_its_start():
    """In GUIDED a ground station may have moved the aircraft meanwhile."""
    desk = ardupilot(plan_delay_s=2.0)
    desk.mode = GUIDED
    desk.run(1.2).order(INSPECTION).drift(0.0, 0.0, -2.0).run(1.0)
    assert (desk.state, desk.answers()[-1]) == ("idle", TEMPORARILY_REJECTED)
    assert desk.said("the aircraft has left its place")
    assert not desk.setpoints()


def test_a_release_before_the_first_setpoint_sends_no_setpoint_of_an_earlier_flight():
    desk = ardupilot().come_to("flying", then_s=2.0)
    desk.order(RELEASE).run(1.0)
    desk.send_heartbeat(LOITER).drift(0.0, -4.0, -2.0).send_heartbeat(GUIDED).run(1.2)
    moved = desk.now_s
    desk.plan_delay_s = None
    desk.order(INSPECTION).step()
    desk.order(RELEASE).answer_plan().run(1.0)
    assert desk.state == "released"
    assert not desk.setpoints(moved)


def test_a_mode_that_the_autopilot_chose_is_not_reported_as_a_takeover():
    desk = ardupilot().come_to("flying", then_s=2.0)
    desk.send_heartbeat(RTL).run(0.1)
    assert desk.said("MOAR: autopilot in RTL")


def test_an_order_during_a_landing_is_temporarily_rejected():
    """Setpoints belong in the air: PX4 resumes OFFBOARD during a landing as soon as they come."""
    desk = ardupilot()
    desk.mode, desk.landed_state = LAND, 4
    desk.run(1.2).order(INSPECTION).run(2.0)
    assert desk.answers() == [TEMPORARILY_REJECTED]
    assert not desk.setpoints()


def test_an_autopilot_of_an_unknown_kind_is_received_and_not_flown():
    desk = Desk(autopilot=mavlink.MAV_AUTOPILOT_GENERIC).run(8.0).order(INSPECTION).run(1.0)
    assert desk.state == "idle"
    assert desk.answers() == [TEMPORARILY_REJECTED]
    assert not desk.setpoints()

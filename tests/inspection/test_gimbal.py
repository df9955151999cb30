"""The gimbal's protocol: control is taken from nobody, and given back."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import all as mavlink

from moar_companion.mavlink.gimbal import Control

from .on_board import OURS, OnBoard

CONFIGURE = mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE
POINT = mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW


def control(rig):
    return rig.gimbal.control(OURS, rig.now_s)


def found(**options):
    rig = OnBoard(**options)
    rig.want()
    rig.run(2.0)
    return rig


def test_a_free_gimbal_is_taken_pointed_and_given_back():
    rig = found()
    assert control(rig) is Control.FREE
    rig.gimbal.take()
    rig.gimbal.point(math.radians(-40.0), math.radians(15.0))
    rig.run(2.0)
    assert (control(rig), rig.payload.holder) == (Control.OURS, OURS)
    attitude = rig.gimbal.attitude(rig.now_s)
    assert math.degrees(attitude.pitch_rad) == -40.0 or abs(attitude.pitch_rad + 0.698) < 0.01
    assert abs(attitude.heading_rad(1.5) - 1.5 - math.radians(15.0)) < 0.01
    rig.gimbal.give_back()
    rig.run(1.0)
    assert (control(rig), rig.payload.holder) == (Control.FREE, (0, 0))


def test_a_gimbal_that_another_holds_is_neither_taken_nor_pointed():
    rig = found(holder=(255, 190))
    rig.gimbal.take()
    rig.gimbal.point(-1.0, 0.0)
    rig.run(5.0)
    assert control(rig) is Control.OTHERS
    assert not rig.commands(CONFIGURE)
    assert not rig.commands(POINT)
    assert rig.payload.holder == (255, 190)


def test_a_gimbal_that_is_taken_over_gets_no_more_angles():
    rig = found()
    rig.gimbal.take()
    rig.gimbal.point(-0.5, 0.0)
    rig.run(2.0)
    rig.payload.holder = (255, 190)
    rig.run(1.0)
    pointed = len(rig.commands(POINT))
    rig.gimbal.point(-1.0, 0.0)
    rig.run(3.0)
    assert len(rig.commands(POINT)) == pointed
    rig.gimbal.give_back()
    rig.run(1.0)
    assert rig.payload.holder == (255, 190)


def test_lost_answers_do_not_keep_control():
    rig = found()
    rig.gimbal.take()
    rig.run(1.0)
    rig.payload.faults.answers_lost = 1.0
    rig.gimbal.give_back()
    rig.run(4.0)
    assert rig.payload.holder == (0, 0)


def test_control_is_given_back_after_a_lost_link():
    rig = found()
    rig.gimbal.take()
    rig.run(1.0)
    rig.gimbal.give_back()
    receive, rig.payload.receive = rig.payload.receive, bytearray  # nothing arrives
    rig.run(5.0)
    rig.payload.receive = receive
    rig.run(2.0)
    assert rig.payload.holder == (0, 0)


def test_control_of_before_a_restart_is_given_back():
    rig = OnBoard(holder=OURS)
    rig.run(5.0)
    assert rig.payload.holder == OURS
    rig.want()
    rig.run(3.0)
    assert rig.payload.holder == (0, 0)


def test_a_silent_gimbal_is_unknown_and_an_aircraft_without_one_has_none():
    rig = found()
    rig.payload.faults.gimbal_silent = True
    rig.run(6.0)
    assert control(rig) is Control.UNKNOWN
    assert rig.gimbal.attitude(rig.now_s) is None
    none = found(gimbal=False)
    none.run(8.0)
    assert control(none) is Control.NO_GIMBAL


def on_autopilot():
    """ArduPilot's mount: the manager is the autopilot."""
    rig = OnBoard(gimbal=False)
    manager = mavlink.MAVLink_gimbal_manager_information_message(0, 0, 1, *[0.0] * 6)
    status = mavlink.MAVLink_gimbal_manager_status_message(0, 0, 1, 0, 0, 0, 0)
    rig.autopilot_answers = {mavlink.MAV_CMD_REQUEST_MESSAGE: (0, manager, status)}
    rig.want()
    rig.run(5.0)
    assert rig.gimbal.manager == ("udp:x", (1, 1))
    return rig


def test_an_answer_to_another_request_hides_no_gimbal():
    """The autopilot answers alike to requests of any message: here the camera's is refused."""
    rig = OnBoard(gimbal=False)
    rig.payload.faults.camera_silent = True
    manager = mavlink.MAVLink_gimbal_manager_information_message(0, 0, 1, *[0.0] * 6)
    request = mavlink.MAV_CMD_REQUEST_MESSAGE
    rig.autopilot_answers = {
        (request, mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION): (3,),
        (request, mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION): (0, manager),
    }
    rig.follows_s = 0.3
    rig.want()
    rig.run(6.0)
    assert rig.gimbal.manager == ("udp:x", (1, 1))


def test_the_frame_of_the_yaw_is_that_of_the_flags_else_that_of_the_lock():
    rig = on_autopilot()
    q = [math.cos(0.5), 0.0, 0.0, math.sin(0.5)]
    for flags, heading in ((32, 1.2), (64, 1.0), (16, 1.0), (0, 1.2)):
        rig.from_autopilot(
            mavlink.MAVLink_gimbal_device_attitude_status_message(
                0, 0, 0, flags, q, 0.0, 0.0, 0.0, 0
            )
        )
        known = rig.gimbal.attitude(rig.now_s)
        assert abs(known.heading_rad(0.2) - heading) < 1e-6


def test_an_attitude_that_is_no_rotation_is_not_read():
    rig = on_autopilot()
    for part in (math.nan, 0.0, math.inf, 3e38):
        rig.from_autopilot(
            mavlink.MAVLink_gimbal_device_attitude_status_message(
                0, 0, 0, 0, [part] * 4, 0.0, 0.0, 0.0, 0
            )
        )
        assert rig.gimbal.attitude(rig.now_s) is None


def test_the_attitude_of_another_component_is_not_read():
    rig = found()
    reported = rig.gimbal.attitude(rig.now_s)
    q = [math.cos(0.5), 0.0, 0.0, math.sin(0.5)]
    other = mavlink.MAVLink_gimbal_device_attitude_status_message(0, 0, 0, 0, q, 0.0, 0.0, 0.0, 0)
    other.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=171))
    rig.hear(other)
    assert rig.gimbal.attitude(rig.now_s) == reported

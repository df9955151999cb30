"""The camera's protocol: found, pictures confirmed once, lost packets, refusals."""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import all as mavlink

from moar_companion.mavlink.camera import Capture

from .on_board import OURS, OnBoard

START, DIGICAM = mavlink.MAV_CMD_IMAGE_START_CAPTURE, mavlink.MAV_CMD_DO_DIGICAM_CONTROL


def found(**options):
    rig = OnBoard(**options)
    rig.want()
    rig.run(1.0)
    assert rig.camera.camera is not None
    return rig


def take(rig, seconds=5.0):
    rig.camera.take_picture()
    rig.run(seconds)
    return rig.camera.picture


def test_nothing_is_sent_before_a_camera_is_wanted():
    rig = OnBoard()
    rig.run(5.0)
    assert not rig.sent


def test_a_camera_is_found_by_its_heartbeat_and_tells_its_lens():
    camera = found().camera.camera
    assert camera.ids == (1, 100)
    assert camera.name == "MOAR simulated camera"
    assert math.isclose(math.degrees(camera.field_of_view_rad[0]), 70.0, abs_tol=0.1)


def test_a_picture_counts_once_it_is_confirmed():
    rig = found()
    assert take(rig) is Capture.DONE
    assert [(image.number, image.file) for image in rig.images] == [(0, "IMG_0000.JPG")]
    assert len(rig.commands(START)) == 1
    assert take(rig) is Capture.DONE
    assert [image.number for image in rig.images] == [0, 1]
    assert len(rig.payload.pictures) == 2


def test_a_lost_answer_takes_no_second_picture():
    rig = found()
    rig.payload.faults.answers_lost = 1.0
    rig.camera.take_picture()
    rig.run(0.3)
    rig.payload.faults.answers_lost = 0.0
    rig.run(5.0)
    assert rig.camera.picture is Capture.DONE
    assert len(rig.payload.pictures) == 1


def test_a_lost_confirmation_is_requested_again_and_no_second_picture_taken():
    rig = found()
    assert take(rig) is Capture.DONE
    rig.payload.faults.confirmations_lost = 1.0
    rig.camera.take_picture()
    rig.run(1.5)
    assert rig.camera.picture is Capture.PENDING
    rig.run(2.0)
    assert rig.camera.picture is Capture.DONE
    assert [image.number for image in rig.images] == [0, 1]
    assert len(rig.payload.pictures) == 2


def test_a_count_that_has_the_picture_already_hides_no_confirmation():
    rig = found()
    rig.camera.take_picture()
    rig.run(0.1)
    status = mavlink.MAVLink_camera_capture_status_message(0, 0, 0, 0.0, 0, 9.0, 1)
    status.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=100))
    rig.hear(status)
    rig.run(8.0)
    assert rig.camera.picture is Capture.DONE
    assert len(rig.payload.pictures) == 1


def test_a_confirmation_is_requested_behind_the_pictures_on_the_card():
    rig = OnBoard()
    rig.run(0.1)
    for number in range(3):
        rig.payload.receive(shutter(number))
        rig.run(1.0)
    rig.want()
    rig.run(1.0)
    rig.payload.faults.confirmations_lost = 1.0
    rig.camera.take_picture()
    rig.run(4.0)
    assert [image.number for image in rig.images] == [3]
    assert len(rig.payload.pictures) == 4


def test_an_older_picture_confirms_no_new_one():
    rig = OnBoard()
    messages = rig.payload._camera_message
    rig.payload._camera_message = lambda message_id, number: (
        None if message_id == mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS
        else messages(message_id, number)
    )  # fmt: skip
    rig.run(0.1)
    rig.payload.receive(shutter(1))
    rig.run(1.0)
    rig.want()
    rig.run(4.0)
    rig.payload.faults.confirmations_lost = 1.0
    assert take(rig, 15.0) is Capture.FAILED
    assert rig.images == []


def test_a_busy_camera_is_waited_for_and_then_refused():
    rig = found()
    rig.payload.faults.busy = True
    rig.camera.take_picture()
    rig.run(4.0)
    assert rig.camera.picture is Capture.PENDING
    rig.payload.faults.busy = False
    rig.run(2.5)
    assert rig.camera.picture is Capture.DONE
    rig.payload.faults.busy = True
    assert take(rig, 25.0) is Capture.FAILED
    assert rig.camera.failure == "picture temporarily rejected"


def test_a_full_card_is_named():
    rig = found()
    rig.payload.faults.card_full = True
    assert take(rig) is Capture.FAILED
    assert rig.camera.failure == "camera card full"


def test_a_camera_that_falls_silent_is_named():
    rig = found()
    rig.payload.faults.camera_silent = True
    assert take(rig) is Capture.FAILED
    assert rig.camera.failure == "camera does not answer"


def shutter(number):
    """A ground station's order of a picture."""
    command = mavlink.MAVLink_command_long_message(1, 100, START, 0, 0, 0, 1, number, 0, 0, 0)
    return command.pack(mavlink.MAVLink(None, srcSystem=255, srcComponent=190))


def test_a_picture_that_others_take_is_read_too():
    rig = found()
    rig.payload.receive(shutter(77))
    rig.run(1.0)
    assert rig.camera.picture is Capture.NONE
    assert [image.number for image in rig.images] == [0]


def test_a_video_runs_and_ends():
    rig = found()
    rig.camera.start_video()
    rig.run(0.5)
    assert rig.camera.video is Capture.DONE
    rig.run(2.0)
    rig.camera.stop_video()
    rig.run(0.5)
    [(start_s, end_s)] = rig.payload.videos_s
    assert 2.0 < end_s - start_s < 3.0
    rig.payload.faults.card_full = True
    rig.camera.start_video()
    rig.run(0.5)
    assert (rig.camera.video, rig.camera.failure) == (Capture.FAILED, "video failed")


def test_the_zoom_is_a_part_of_the_cameras_range():
    rig = found()
    rig.camera.set_zoom(40.0)
    rig.run(0.3)
    assert rig.payload.zoom_percent == 40.0


def without_component():
    """An aircraft whose autopilot alone may have a camera."""
    rig = OnBoard(gimbal=False)
    rig.payload.faults.camera_silent = True
    return rig


def feedback(number):
    zero = (0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    return mavlink.MAVLink_camera_feedback_message(0, 0, 0, number, *zero, 0)


def information():
    name = [0] * 32
    nan = math.nan
    return mavlink.MAVLink_camera_information_message(
        0, name, name, 0, nan, nan, nan, 0, 0, 0, 2, 0, b""
    )


def test_ardupilots_camera_is_the_autopilots_and_confirms_by_camera_feedback():
    rig = without_component()
    rig.autopilot_answers = {
        mavlink.MAV_CMD_REQUEST_MESSAGE: (0, information()),
        START: (0, feedback(7)),
    }
    rig.want()
    rig.run(4.0)
    assert rig.camera.camera.ids == (1, 1)
    assert rig.camera.camera.field_of_view_rad is None
    assert take(rig, 1.0) is Capture.DONE
    assert [image.number for image in rig.images] == [7]


def test_an_answer_to_another_request_hides_no_camera():
    """The autopilot answers alike to requests of any message: here the gimbal's is refused."""
    rig = without_component()
    request = mavlink.MAV_CMD_REQUEST_MESSAGE
    rig.want()
    rig.run(2.6)
    rig.from_autopilot(mavlink.MAVLink_command_ack_message(request, 3, 0, 0, *OURS))
    rig.run(0.3)
    rig.from_autopilot(information())
    rig.run(1.0)
    assert not rig.camera.camera.by_digicam


def test_a_video_that_never_begins_fails():
    rig = found()
    rig.payload.receive = bytearray  # nothing arrives
    rig.camera.start_video()
    start = mavlink.MAV_CMD_VIDEO_START_CAPTURE
    for _ in range(20):
        rig.run(1.0)
        progress = mavlink.MAVLink_command_ack_message(start, 5, 0, 0, *OURS)
        progress.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=100))
        rig.hear(progress)
    assert (rig.camera.video, rig.camera.failure) == (Capture.FAILED, "camera does not answer")


def test_px4s_camera_trigger_answers_do_digicam_control_alone():
    rig = without_component()
    captured = mavlink.MAVLink_camera_image_captured_message(
        0, 0, 1, 0, 0, 0, 0, [1.0, 0.0, 0.0, 0.0], 3, 1, b""
    )
    rig.autopilot_answers = {
        mavlink.MAV_CMD_REQUEST_MESSAGE: (3,),
        START: (3,),
        DIGICAM: (0, captured),
    }
    rig.want()
    rig.run(4.0)
    assert rig.camera.camera.by_digicam
    assert take(rig, 1.0) is Capture.DONE
    assert [image.number for image in rig.images] == [3]
    assert [message.param5 for message in rig.commands(DIGICAM)] == [1.0]


def test_an_autopilot_that_answers_nothing_fails_the_picture():
    rig = without_component()
    rig.want()
    rig.run(8.0)
    assert take(rig, 4.0) is Capture.FAILED
    assert rig.camera.failure == "camera does not answer"


def test_a_component_that_is_received_late_replaces_the_guess():
    rig = without_component()
    rig.want()
    rig.run(8.0)
    assert rig.camera.camera.by_digicam
    rig.payload.faults.camera_silent = False
    rig.run(1.5)
    rig.want()
    rig.run(1.0)
    assert rig.camera.camera.ids == (1, 100)


def test_a_camera_that_is_received_late_does_not_end_a_video():
    rig = without_component()
    rig.autopilot_answers = {
        mavlink.MAV_CMD_REQUEST_MESSAGE: (3,),
        mavlink.MAV_CMD_VIDEO_START_CAPTURE: (0,),
    }
    rig.want()
    rig.run(4.0)
    rig.camera.start_video()
    rig.run(0.5)
    rig.payload.faults.camera_silent = False
    rig.run(1.5)
    rig.want()
    rig.camera.stop_video()
    rig.run(0.1)
    assert [
        message.target_component for message in rig.commands(mavlink.MAV_CMD_VIDEO_STOP_CAPTURE)
    ] == [1]


def test_a_camera_that_does_not_tell_what_it_is_is_used():
    rig = OnBoard()
    rig.payload.receive = bytearray  # nothing arrives
    rig.want()
    for _ in range(8):
        rig.run(0.5)
        rig.want()
    assert rig.camera.camera.ids == (1, 100)


def captured(rig, number, result=1, utc_us=0):
    """The camera's CAMERA_IMAGE_CAPTURED."""
    message = mavlink.MAVLink_camera_image_captured_message(
        0, utc_us, 1, 0, 0, 0, 0, [1.0, 0.0, 0.0, 0.0], number, result, b""
    )
    message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=100))
    rig.hear(message)


def test_a_time_that_is_no_date_is_unknown():
    rig = found()
    for number, utc_us in enumerate(
        (0, 1_764_343_509_250_000, 1_764_343_509_250_000_000, 2**64 - 1)
    ):
        captured(rig, number, utc_us=utc_us)
    known = [image.utc_s for image in rig.camera.take_images()]
    assert known == [None, 1_764_343_509.25, None, None]


def test_a_failed_exposure_is_taken_again():
    rig = found()
    rig.camera.take_picture()
    rig.run(0.1)
    captured(rig, 9, result=0)
    rig.run(4.0)
    assert rig.camera.picture is Capture.DONE
    assert len({message.param4 for message in rig.commands(START)}) == 2

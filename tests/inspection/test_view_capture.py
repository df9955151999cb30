"""Stories of a view: aimed, steady, captured; what ends it."""

from __future__ import annotations

import math
from dataclasses import replace

from moar_companion.companion.inspection.view_capture import (
    Ask,
    Observed,
    Phase,
    ViewCapture,
    step,
)
from moar_companion.mavlink.camera import Capture
from moar_companion.mavlink.gimbal import Control
from moar_companion.settings.config import Inspection

LIMITS = Inspection()
STEADY = Observed(
    gimbal=Control.OURS,
    holder=(1, 195),
    camera_known=True,
    aim_error_rad=math.radians(0.5),
    position_error_m=0.1,
    speed_mps=0.05,
    turn_rate_radps=0.01,
    yaw_rate_radps=0.01,
)


class Story:
    """A view at steps of 0.1 s; asks: what the camera was asked for."""

    def __init__(self, pictures=1, video_s=0.0):
        self.capture = ViewCapture(left=pictures, video_s=video_s, since_s=0.0)
        self.asks = []
        self.now_s = 0.0

    def run(self, seen, seconds=0.1):
        for _ in range(round(seconds / 0.1)):
            self.now_s += 0.1
            if not self.capture.ended:
                self.capture, asks = step(self.capture, seen, LIMITS, self.now_s)
                self.asks += asks
        return self.capture.phase


def test_a_camera_that_is_lost_before_the_picture_is_waited_for():
    story = Story()
    story.run(STEADY, 0.5)
    lost = replace(STEADY, camera_known=False)
    assert story.run(lost, 5.0) is Phase.SETTLING
    assert story.asks == []
    assert story.run(lost, 20.0) is Phase.FAILED
    assert story.capture.reason == "camera does not answer"


def confirmed(seen=STEADY):
    return replace(seen, picture=Capture.DONE)


def test_a_view_is_done_when_each_picture_is_confirmed():
    story = Story(pictures=2)
    assert story.run(STEADY, 0.9) is Phase.SETTLING
    assert story.run(STEADY, 0.5) is Phase.CAPTURING
    assert story.asks == [Ask.PICTURE]
    story.run(confirmed())
    assert story.capture.left == 1
    story.run(STEADY, 0.8)
    assert story.asks == [Ask.PICTURE]
    story.run(STEADY, 0.4)
    assert story.asks == [Ask.PICTURE] * 2
    assert story.run(confirmed()) is Phase.DONE


def test_no_picture_is_taken_before_all_limits_hold_for_the_settling_time():
    for unsteady in (
        replace(STEADY, aim_error_rad=math.radians(2.1)),
        replace(STEADY, position_error_m=0.8),
        replace(STEADY, speed_mps=0.5),
        replace(STEADY, turn_rate_radps=0.4),
        replace(STEADY, gimbal=Control.NO_GIMBAL, turn_rate_radps=0.1),
        replace(STEADY, turn_rate_radps=None),
        replace(STEADY, yaw_rate_radps=-0.1),
        replace(STEADY, aim_error_rad=None),
    ):
        story = Story()
        story.run(STEADY, 0.8)
        story.run(unsteady)
        story.run(STEADY, 0.9)
        assert not story.asks
        story.run(STEADY, 0.5)
        assert story.asks == [Ask.PICTURE]


def test_what_is_never_steady_fails_with_its_limit():
    story = Story()
    story.run(STEADY, 0.3)
    assert story.run(replace(STEADY, speed_mps=0.5), 25.0) is Phase.FAILED
    assert story.capture.reason == "unsteady: 0.5 m/s > 0.3"


def test_a_picture_during_which_the_aircraft_moved_is_taken_again_and_the_third_counts():
    story = Story()
    for taken in (1, 2, 3):
        story.run(STEADY, 2.0)
        assert len(story.asks) == taken
        story.run(replace(STEADY, speed_mps=0.5))
        story.run(confirmed())
    assert story.capture.phase is Phase.DONE
    assert "m/s" in story.capture.moved


def test_a_gimbal_that_another_takes_ends_the_view_at_once():
    story = Story(pictures=0, video_s=5.0)
    story.run(STEADY, 1.5)
    story.run(replace(STEADY, video=Capture.DONE))
    assert story.capture.phase is Phase.RECORDING
    story.run(replace(STEADY, gimbal=Control.OTHERS, holder=(255, 190), video=Capture.DONE))
    assert story.capture.phase is Phase.FAILED
    assert story.capture.reason == "gimbal held by 255/190"
    assert story.asks == [Ask.START_VIDEO, Ask.STOP_VIDEO]


def test_a_video_has_its_length_from_its_confirmed_start():
    story = Story(pictures=0, video_s=3.0)
    story.run(STEADY, 4.0)
    assert story.asks == [Ask.START_VIDEO]
    assert story.run(replace(STEADY, video=Capture.DONE), 2.8) is Phase.RECORDING
    assert story.run(replace(STEADY, video=Capture.DONE), 0.4) is Phase.DONE
    assert story.asks == [Ask.START_VIDEO, Ask.STOP_VIDEO]


def test_what_the_camera_refuses_fails_with_its_reason():
    story = Story()
    story.run(STEADY, 1.5)
    story.run(replace(STEADY, picture=Capture.FAILED, failure="camera card full"))
    assert (story.capture.phase, story.capture.reason) == (Phase.FAILED, "camera card full")
    video = Story(pictures=0, video_s=1.0)
    video.run(STEADY, 1.5)
    video.run(replace(STEADY, video=Capture.FAILED, failure="video denied"))
    assert video.capture.reason == "video denied"


def test_what_is_missing_after_the_time_out_is_named():
    silent = Story()
    silent.run(replace(STEADY, gimbal=Control.UNKNOWN), 25.0)
    assert silent.capture.reason == "gimbal does not answer"
    blind = Story()
    blind.run(replace(STEADY, camera_known=False), 25.0)
    assert blind.capture.reason == "camera does not answer"
    stuck = Story()
    stuck.run(replace(STEADY, aim_error_rad=math.radians(30.0)), 25.0)
    assert stuck.capture.reason == "aim 30.0 deg off > 2"

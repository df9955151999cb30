"""ArduPilot's texts that name a failsafe, as recorded and as in its source."""

from __future__ import annotations

import pytest

from moar_companion.mavlink import translate
from moar_companion.mavlink.dialect import mavlink
from moar_companion.types import Failsafe, Telemetry


def told(*texts, telemetry=None):
    telemetry = telemetry or Telemetry()
    for text in texts:
        message = mavlink.MAVLink_statustext_message(4, text.encode())
        telemetry = translate.update(telemetry, message, 1.0)
    return telemetry.failsafes_told


@pytest.mark.parametrize(
    ("text", "failsafe"),
    [
        ("Battery 1 is low 10.30V used 355 mAh", Failsafe.BATTERY),
        ("Battery 1 is critical 9.60V used 474 mAh", Failsafe.BATTERY),
        ("Battery Failsafe", Failsafe.BATTERY),
        ("Radio Failsafe", Failsafe.REMOTE_CONTROL),
        ("Radio Failsafe - Continuing Guided Mode", Failsafe.REMOTE_CONTROL),
        ("GCS Failsafe", Failsafe.GROUND_STATION),
        ("EKF variance", Failsafe.ESTIMATOR),
        ("EKF Failsafe: changed to Land Mode", Failsafe.ESTIMATOR),
        ("Dead Reckoning started", Failsafe.DEAD_RECKONING),
        ("Max Alt fence breached", Failsafe.FENCE),
    ],
)
def test_these_texts_name_a_failsafe(text, failsafe):
    assert told(text) == {failsafe}


@pytest.mark.parametrize(
    "text", ["", "Battery 1 is healthy", "EKF3 IMU0 is using GPS", "Arming motors"]
)
def test_others_name_none(text):
    assert told(text) == frozenset()


def test_what_is_cleared_is_told_no_more():
    assert told("Radio Failsafe", "GCS Failsafe", "Radio Failsafe Cleared") == {
        Failsafe.GROUND_STATION
    }
    assert told("EKF variance", "EKF Failsafe Cleared") == frozenset()
    assert told("Dead Reckoning started", "Dead Reckoning stopped") == frozenset()


def test_a_status_that_is_no_failsafe_again_ends_them_all():
    telemetry = Telemetry()
    for status in (5, 4):
        for message in (
            mavlink.MAVLink_statustext_message(4, b"Battery Failsafe"),
            mavlink.MAVLink_heartbeat_message(2, 3, 217, 4, status, 3),
        ):
            telemetry = translate.update(telemetry, message, 1.0)
        assert bool(telemetry.failsafes_told) is (status == 5)

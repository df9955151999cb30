"""ArduPilot's texts that name a failsafe, as recorded and as in its source."""

from __future__ import annotations

import pytest

from moar_companion.mavlink import translate
from moar_companion.mavlink.dialect import mavlink
from moar_companion.mavlink.telemetry import Failsafe, Telemetry

GOOD, CONST_POSITION = 0x33F, 0x0A7


def reported(*texts, autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA):
    heartbeat = mavlink.MAVLink_heartbeat_message(2, autopilot, 217, 4, 5, 3)
    telemetry = translate.update(Telemetry(), heartbeat, 0.5)
    for text in texts:
        message = mavlink.MAVLink_statustext_message(4, text.encode())
        telemetry = translate.update(telemetry, message, 1.0)
    return set(telemetry.failsafes_reported)


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
def test_failsafe_texts_of_ardupilot_name_the_failsafe(text, failsafe):
    assert reported(text) == {failsafe}


@pytest.mark.parametrize(
    "text", ["", "Battery 1 is healthy", "EKF3 IMU0 is using GPS", "Arming motors"]
)
def test_other_texts_name_no_failsafe(text):
    assert reported(text) == frozenset()


@pytest.mark.parametrize(
    "autopilot", [mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_AUTOPILOT_GENERIC], ids=["PX4", "unknown"]
)
def test_the_same_text_of_another_autopilot_names_no_failsafe(autopilot):
    """The failsafe then has an unknown cause, which holds the flight as well."""
    assert reported("GCS Failsafe", autopilot=autopilot) == frozenset()


def test_a_cleared_failsafe_is_reported_no_more():
    assert reported("Radio Failsafe", "GCS Failsafe", "Radio Failsafe Cleared") == {
        Failsafe.GROUND_STATION
    }
    assert reported("EKF variance", "EKF Failsafe Cleared") == frozenset()
    assert reported("Dead Reckoning started", "Dead Reckoning stopped") == frozenset()


def test_a_status_without_a_failsafe_ends_all_reported_failsafes():
    telemetry = Telemetry()
    for status in (5, 5, 4):
        heartbeat = mavlink.MAVLink_heartbeat_message(2, 3, 217, 4, status, 3)
        telemetry = translate.update(telemetry, heartbeat, 1.0)
        assert telemetry.failsafes_reported == {} or status == 5
        text = mavlink.MAVLink_statustext_message(4, b"Battery Failsafe")
        telemetry = translate.update(telemetry, text, 1.0)
        assert set(telemetry.failsafes_reported) == {Failsafe.BATTERY}


def after(text, seconds, *, flags=GOOD, compass=0.1, fix_type=3, heartbeats_s=1.0, reports=True):
    """Failsafes reported a time after a text, with heartbeats of status 5 and other reports."""
    message = mavlink.MAVLink_heartbeat_message(2, 3, 217, 4, 5, 3)
    telemetry = translate.update(Telemetry(), message, 0.0)
    statustext = mavlink.MAVLink_statustext_message(2, text.encode())
    telemetry, now_s = translate.update(telemetry, statustext, 0.0), 0.0
    while now_s < seconds:
        now_s += heartbeats_s
        if reports:
            report = mavlink.MAVLink_ekf_status_report_message(flags, 0.1, 0.1, 0.1, compass, 0.0)
            telemetry = translate.update(telemetry, report, now_s)
        gnss = mavlink.MAVLink_gps_raw_int_message(0, fix_type, 0, 0, 0, 90, 90, 0, 0, 12)
        for received in (gnss, message):
            telemetry = translate.update(telemetry, received, now_s)
    return set(telemetry.failsafes_reported)


def test_an_estimator_failsafe_ends_after_seconds_of_a_good_position():
    """The text of its end may be lost, and a battery failsafe keeps the status."""
    estimator = {Failsafe.ESTIMATOR}
    assert after("EKF variance: compass", 4.0) == estimator
    assert after("EKF variance: compass", 7.0) == set()
    assert after("EKF variance: compass", 60.0, flags=CONST_POSITION) == estimator
    assert after("EKF variance: compass", 60.0, compass=0.9) == estimator
    assert after("EKF variance: compass", 60.0, reports=False) == estimator
    assert after("EKF variance: compass", 10.0, heartbeats_s=10.0) == estimator


def test_a_dead_reckoning_failsafe_lasts_until_a_fix():
    assert after("Dead Reckoning started", 60.0, fix_type=1) == {Failsafe.DEAD_RECKONING}
    assert after("Dead Reckoning started", 7.0) == set()


@pytest.mark.parametrize("text", ["Radio Failsafe", "GCS Failsafe", "Max Alt fence breached"])
def test_a_failsafe_reported_by_text_alone_expires(text):
    assert after(text, 59.0)
    assert not after(text, 62.0)


def test_a_battery_failsafe_does_not_expire():
    assert after("Battery Failsafe", 600.0) == {Failsafe.BATTERY}

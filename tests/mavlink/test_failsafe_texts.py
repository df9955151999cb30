"""ArduPilot's texts that name a failsafe, as recorded and as in its source."""

from __future__ import annotations

import pytest

from moar_companion.mavlink import translate
from moar_companion.mavlink.dialect import mavlink
from moar_companion.telemetry import Failsafe, Telemetry

GOOD, CONST_POSITION = 0x33F, 0x0A7


def told(*texts, autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA):
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
def test_these_texts_name_a_failsafe(text, failsafe):
    assert told(text) == {failsafe}


@pytest.mark.parametrize(
    "text", ["", "Battery 1 is healthy", "EKF3 IMU0 is using GPS", "Arming motors"]
)
def test_others_name_none(text):
    assert told(text) == frozenset()


@pytest.mark.parametrize(
    "autopilot", [mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_AUTOPILOT_GENERIC], ids=["PX4", "unknown"]
)
def test_the_same_text_of_another_autopilot_names_none(autopilot):
    """Its failsafe then has an unknown cause, which holds the flight as well."""
    assert told("GCS Failsafe", autopilot=autopilot) == frozenset()


def test_what_is_cleared_is_told_no_more():
    assert told("Radio Failsafe", "GCS Failsafe", "Radio Failsafe Cleared") == {
        Failsafe.GROUND_STATION
    }
    assert told("EKF variance", "EKF Failsafe Cleared") == frozenset()
    assert told("Dead Reckoning started", "Dead Reckoning stopped") == frozenset()


def test_a_status_that_is_no_failsafe_again_ends_them_all():
    telemetry = Telemetry()
    for status in (5, 5, 4):
        heartbeat = mavlink.MAVLink_heartbeat_message(2, 3, 217, 4, status, 3)
        telemetry = translate.update(telemetry, heartbeat, 1.0)
        assert telemetry.failsafes_reported == {} or status == 5
        text = mavlink.MAVLink_statustext_message(4, b"Battery Failsafe")
        telemetry = translate.update(telemetry, text, 1.0)
        assert set(telemetry.failsafes_reported) == {Failsafe.BATTERY}


def after(text, seconds, *, flags=GOOD, compass=0.1, fix_type=3, heartbeats_s=1.0, reports=True):
    """The failsafes told so long after a text, with heartbeats of status 5 and other witnesses."""
    message = mavlink.MAVLink_heartbeat_message(2, 3, 217, 4, 5, 3)
    telemetry = translate.update(Telemetry(), message, 0.0)
    words = mavlink.MAVLink_statustext_message(2, text.encode())
    telemetry, now_s = translate.update(telemetry, words, 0.0), 0.0
    while now_s < seconds:
        now_s += heartbeats_s
        if reports:
            report = mavlink.MAVLink_ekf_status_report_message(flags, 0.1, 0.1, 0.1, compass, 0.0)
            telemetry = translate.update(telemetry, report, now_s)
        gnss = mavlink.MAVLink_gps_raw_int_message(0, fix_type, 0, 0, 0, 90, 90, 0, 0, 12)
        for received in (gnss, message):
            telemetry = translate.update(telemetry, received, now_s)
    return set(telemetry.failsafes_reported)


def test_one_of_the_estimator_ends_by_a_position_that_is_sure_for_some_seconds():
    """Its own text may be lost, and a battery's failsafe keeps the status."""
    told = {Failsafe.ESTIMATOR}
    assert after("EKF variance: compass", 4.0) == told
    assert after("EKF variance: compass", 7.0) == set()
    assert after("EKF variance: compass", 60.0, flags=CONST_POSITION) == told
    assert after("EKF variance: compass", 60.0, compass=0.9) == told
    assert after("EKF variance: compass", 60.0, reports=False) == told
    assert after("EKF variance: compass", 10.0, heartbeats_s=10.0) == told


def test_dead_reckoning_lasts_until_there_is_a_fix():
    assert after("Dead Reckoning started", 60.0, fix_type=1) == {Failsafe.DEAD_RECKONING}
    assert after("Dead Reckoning started", 7.0) == set()


@pytest.mark.parametrize("text", ["Radio Failsafe", "GCS Failsafe", "Max Alt fence breached"])
def test_one_that_only_a_text_names_has_an_age(text):
    assert after(text, 59.0)
    assert not after(text, 62.0)


def test_that_of_a_battery_stays():
    assert after("Battery Failsafe", 600.0) == {Failsafe.BATTERY}

"""Comparison with recordings of ArduCopter 4.6.3, field by field.

The packets of the recorded peers are sent to the fake at the same times after its start. Its
packets have to equal the recorded ones: messages, rates and sizes, every constant field, and the
courses of modes, flags and sensors.
"""

import re
from functools import cache
from statistics import median

import pytest
from pymavlink.dialects.v20 import all as mavlink

from sitl.conditions import GPS_NO_FIX, GPS_NORMAL

from .replay import (
    PEERS,
    RECORDINGS,
    Situation,
    check_constants,
    check_counts,
    check_course,
    check_sensors,
    in_one_process,
    name,
    parameter,
    recorded,
    replay,
    sizes,
    world,
)

pytestmark = [*recorded, pytest.mark.slow]
GUIDED, ARMED = 4, 1
RATES_HZ = {
    "ATTITUDE": 20, "LOCAL_POSITION_NED": 20, "GLOBAL_POSITION_INT": 5,
    "POSITION_TARGET_LOCAL_NED": 10, "SYS_STATUS": 2, "BATTERY_STATUS": 2, "GPS_RAW_INT": 5,
    "EKF_STATUS_REPORT": 5, "RC_CHANNELS": 5, "SERVO_OUTPUT_RAW": 5, "VFR_HUD": 2, "WIND": 2,
    "EXTENDED_SYS_STATE": 2, "SYSTEM_TIME": 1, "VIBRATION": 1,
}  # fmt: skip


def _command(number, *params):
    return lambda _, peers: peers["companion"].command(number, *params)


def _asked(**rates_hz):
    """Requests of the companion before the recording begins."""
    return tuple(
        (5.0, _command(511, getattr(mavlink, f"MAVLINK_MSG_ID_{kind}"), 1e6 / hz))
        for kind, hz in {**RATES_HZ, **rates_hz}.items()
    )


def _sticks(**positions):
    return lambda vehicle, _: vehicle.move_sticks(**positions)


def _situation(*recordings, actions, parameters=None, **options):
    place = {"latitude_deg": 45.378, "longitude_deg": -71.929, "altitude_amsl_m": 200.1}
    return Situation(
        recordings=recordings,
        options={"autopilot": "ardupilot", "parameters": parameters or {}, **place},
        actions=actions,
        **options,
    )


LANDS = {"base_mode": 1.1, "landed_state": 1.1, "enabled": 1.1, "health": 1.1}
"""Slack where a landing comes before: it takes a second more or less."""
GUIDED_ON_THE_GROUND = ((41.8, _command(176, 1, GUIDED)),)
TAKE_OFF = (
    *GUIDED_ON_THE_GROUND,
    (41.93, _command(400, ARMED)),
    (41.94, _command(22, 0, 0, 0, 0, 0, 0, 10)),
)
SITUATIONS = {
    "start, square and landing": _situation(
        "a1_boot", "a2_square", "a3_land", actions=(), slack_s=LANDS
    ),
    "low and critical battery": _situation(
        "b_batt",
        parameters={
            "BATT_LOW_VOLT": 10.8, "BATT_CRT_VOLT": 10.2, "BATT_LOW_TIMER": 5,
            "BATT_FS_LOW_ACT": 2, "BATT_FS_CRT_ACT": 1,
        },
        actions=(
            *_asked(SYS_STATUS=5, BATTERY_STATUS=5),
            (41.8, lambda _, peers: peers["gcs"].send(
                mavlink.MAVLink_request_data_stream_message(1, 1, 0, 4, 1)
            )),
            *GUIDED_ON_THE_GROUND,
            (75.64, world(battery_voltage_v=11.4)),
            (80.64, world(battery_voltage_v=10.6)),
            (93.81, world(battery_voltage_v=10.0)),
            (130.22, world(battery_voltage_v=12.6)),
        ),
        slack_s=LANDS | {"mode": 2.0, "base_mode": 2.0, "health": 2.0},
    ),
    "no battery monitor": _situation(
        "b2_nobatt", parameters={"BATT_MONITOR": 0}, actions=_asked()
    ),
    "wind without an estimate": _situation(
        "c1_wind",
        actions=(
            *_asked(AHRS2=1, ATTITUDE_TARGET=5, WIND=5, HIGH_LATENCY2=0.5),
            *TAKE_OFF,
            (59.7, world(wind_mps=2.5, wind_from_deg=270.0)),
            (77.7, world(wind_mps=4.9)),
        ),
    ),
    "wind with drag fusion": _situation(
        "c3_wind_const",
        parameters={"EK3_DRAG_BCOEF_X": 20.0, "EK3_DRAG_BCOEF_Y": 20.0},
        actions=(
            *_asked(AHRS2=1, ATTITUDE_TARGET=5, WIND=5, HIGH_LATENCY2=0.5),
            *TAKE_OFF,
            (59.7, world(wind_mps=6.0, wind_from_deg=270.0)),
            (77.7, world(wind_mps=12.0)),
        ),
    ),
    "GPS off in flight": _situation(
        "d2_gps_loss",
        actions=(
            *_asked(),
            *TAKE_OFF,
            (51.0, _sticks()),
            (51.64, world(gps_mode=GPS_NO_FIX)),
            (97.67, world(gps_mode=GPS_NORMAL)),
        ),
        slack_s=LANDS,
    ),
    "the pilot overrides": _situation(
        "e1_override",
        until_s=96.3,  # then ACRO, which the fake has not
        actions=(
            *_asked(ATTITUDE_TARGET=5),
            *TAKE_OFF,
            (51.0, _sticks()),
            (69.66, lambda vehicle, _: vehicle.flip_switch(5)),
            (76.89, _sticks(pitch=0.4)),
            (79.89, _sticks()),
            (83.9, _sticks(roll=0.6)),
            (85.9, _sticks(yaw=0.4)),
            (88.9, _sticks()),
            (91.9, _sticks(throttle=-1.0)),
            (93.9, _sticks()),
        ),
    ),
    "ground station and remote control lost": _situation(
        "j1_failsafe",
        parameters={"FS_GCS_ENABLE": 5},
        actions=(
            *_asked(),
            *TAKE_OFF,
            (51.0, _sticks()),
            (88.73, parameter("SIM_RC_FAIL", 1)),
            (101.76, parameter("SIM_RC_FAIL", 0)),
        ),
    ),
    "setpoints before take-off": _situation(
        "k1a_takeoff_rates", actions=_asked()
    ),
    "reboot": _situation("k2_reboot", shift_s=16.2, actions=((0.1, _sticks()),)),
}  # fmt: skip
PACED_BY_EVENTS = {"STATUSTEXT", "COMMAND_ACK", "PARAM_VALUE"}
NOT_SAID = ("SIM ", "SmartRTL ", "EKF3 IMU1 origin set")
"""By the simulator; by the recorder of the way back; 0.2 s after the other estimator's."""
NOT_MADE = {"TERRAIN_REQUEST"}
"""Messages of the terrain database, which the fake has not."""
OTHER_MODEL = {
    "BATTERY_STATUS": {"voltages"},  # that simulator's voltage does not sag
    "GLOBAL_POSITION_INT": {"lat", "lon", "alt", "vx", "vy"},  # nor does its receiver err
    "GPS_GLOBAL_ORIGIN": {"latitude", "longitude", "altitude", "time_usec"},
    "GPS_RAW_INT": {"lat", "lon", "alt", "alt_ellipsoid", "vel", "cog"},
    "HIGH_LATENCY2": {"latitude", "longitude", "altitude", "target_altitude"},
    "HOME_POSITION": {"latitude", "longitude", "altitude", "x", "y", "z", "time_usec"},
    "NAV_CONTROLLER_OUTPUT": {"wp_dist"},
    "POSITION_TARGET_GLOBAL_INT": {"lat_int", "lon_int", "alt"},
    "POSITION_TARGET_LOCAL_NED": {"y"},
    "SYS_STATUS": {"voltage_battery"},
    "TIMESYNC": {"ts1"},
    "VFR_HUD": {"alt"},
}
ENDS_IN_A_HEADING = {"GLOBAL_POSITION_INT", "VFR_HUD"}
"""Exactly 0 on the fake's ground, so that the packet is cut there."""
LOGGING = 0x1000000
"""Bit of SYS_STATUS: a refused attempt to arm starts a log in ArduPilot."""
SENSORS_SLACK_S = 0.6
COURSES = {
    "mode": ("HEARTBEAT", lambda m: (m.base_mode & 128, m.custom_mode, m.system_status), 0.45, 1.1),
    "base_mode": ("HEARTBEAT", lambda m: m.base_mode, 1.05, 0.2),
    "landed_state": ("EXTENDED_SYS_STATE", lambda m: m.landed_state, 1.2, 0.2),
    "estimator": ("EKF_STATUS_REPORT", lambda m: m.flags, 0.45, 0.9),
    "receiver": (
        "GPS_RAW_INT",
        lambda m: (m.fix_type, m.eph, m.epv, m.satellites_visible, m.h_acc, m.v_acc),
        0.45,
        0.3,
    ),
    "battery": ("BATTERY_STATUS", lambda m: m.charge_state, 0.45, 0.2),
    "target": ("POSITION_TARGET_LOCAL_NED", lambda m: m.type_mask, 0.25, 0.2),
}
"""Courses that are compared through a recording.

A message, its value, how long that has to last, and how far apart in time the two may be: a
disarming shows in the next heartbeat, and the real estimator gives up a moment earlier. The
heartbeat that announces a mode carries a bit of the former one until the next.
"""


@cache
def compare(title):
    return replay(RECORDINGS / "ardupilot", SITUATIONS[title])


@pytest.fixture(params=in_one_process(SITUATIONS))
def both(request):
    return compare(request.param)


def test_the_messages_and_their_rates_are_ardupilots(both):
    for link in PEERS:
        check_counts(
            both,
            link,
            but=NOT_MADE | PACED_BY_EVENTS,
            rel=0.02,
            may_stop={"LOCAL_POSITION_NED", "WIND", "POSITION_TARGET_LOCAL_NED"},
        )


def test_fields_that_never_change_are_ardupilots(both):
    for link in PEERS:
        check_constants(both, link, but=PACED_BY_EVENTS, of_another_model=OTHER_MODEL)


def test_packets_are_cut_and_sized_as_ardupilots(both):
    fake = sizes(both.fake["companion"])
    for kind, lengths in sizes(both.real["companion"]).items():
        if kind in PACED_BY_EVENTS | ENDS_IN_A_HEADING or len(lengths) > 1 or kind not in fake:
            continue
        assert max(fake[kind]) == max(lengths), kind


@pytest.mark.parametrize("course", COURSES)
def test_modes_and_flags_change_as_those_of_ardupilot(both, course):
    kind, value, shortest_s, slack_s = COURSES[course]
    check_course(both, kind, value, shortest_s=shortest_s, slack_s=both.slack_s(course, slack_s))


def test_commands_are_answered_as_by_ardupilot(both):
    real, fake = (
        [(m.command, m.result) for _, m, _ in side["companion"] if name(m) == "COMMAND_ACK"]
        for side in (both.real, both.fake)
    )
    assert fake == real


@pytest.mark.parametrize("field", ["present", "enabled", "health"])
def test_the_sensors_bits_change_as_those_of_ardupilot(both, field):
    check_sensors(both, field, but=LOGGING, slack_s=both.slack_s(field, SENSORS_SLACK_S))


def _texts(rows):
    """Texts with their severity, without those of the simulator and without numbers."""
    return sorted(
        (m.severity, re.sub(r"[0-9.]+V used .*", "", m.text))
        for _, m, _ in rows
        if name(m) == "STATUSTEXT" and not m.text.startswith(NOT_SAID)
    )


def test_all_texts_are_those_of_ardupilot(both):
    for link in PEERS:
        assert _texts(both.fake[link]) == _texts(both.real[link]), link


@pytest.mark.parametrize(
    ("title", "start_s"), in_one_process([("start, square and landing", 0.0), ("reboot", 16.2)])
)
def test_the_texts_of_a_start_are_those_of_ardupilot(title, start_s):
    real, fake = (
        [
            (t, m.text)
            for t, m, _ in side["companion"]
            if name(m) == "STATUSTEXT" and t < start_s + 12
        ]
        for side in (compare(title).real, compare(title).fake)
    )
    assert sorted(text for _, text in fake) == sorted(text for _, text in real)
    assert [t for t, _ in fake] == pytest.approx([t for t, _ in real], abs=0.1)


HOVER, WINDY = "wind without an estimate", "wind with drag fusion"
START = "start, square and landing"


@pytest.mark.parametrize(
    ("title", "kind", "field", "since_s", "until_s", "tolerance"),
    in_one_process(
        [
            (HOVER, "SERVO_OUTPUT_RAW", "servo1_raw", 55, 59, 12),
            (HOVER, "VFR_HUD", "throttle", 55, 59, 2),
            (HOVER, "ATTITUDE_TARGET", "thrust", 55, 59, 0.02),
            (HOVER, "BATTERY_STATUS", "current_battery", 55, 59, 250),
            (HOVER, "VIBRATION", "vibration_z", 55, 59, 0.02),
            (HOVER, "WIND", "direction", 55, 140, 0),
            (WINDY, "WIND", "speed", 72, 77, 0.5),
            (WINDY, "WIND", "direction", 72, 77, 5),
            (WINDY, "SERVO_OUTPUT_RAW", "servo1_raw", 72, 77, 15),
            (WINDY, "VFR_HUD", "airspeed", 72, 77, 0.7),
            (START, "SCALED_PRESSURE", "temperature", 13, 40, 40),
            (START, "SCALED_PRESSURE", "press_abs", 13, 40, 0.5),
            (START, "SERVO_OUTPUT_RAW", "servo4_raw", 20, 43, 0),
            (START, "EKF_STATUS_REPORT", "velocity_variance", 60, 140, 0.01),
            (START, "NAV_CONTROLLER_OUTPUT", "xtrack_error", 60, 140, 0.2),
            ("low and critical battery", "BATTERY_STATUS", "battery_remaining", 120, 125, 4),
            ("low and critical battery", "BATTERY_STATUS", "energy_consumed", 120, 125, 40),
        ]
    ),
)
def test_figures_are_near_ardupilots(title, kind, field, since_s, until_s, tolerance):
    both = compare(title)
    real, fake = (
        median(
            getattr(message, field)
            for t, message, _ in side["companion"]
            if name(message) == kind and since_s <= t <= until_s
        )
        for side in (both.real, both.fake)
    )
    assert fake == pytest.approx(real, abs=tolerance)

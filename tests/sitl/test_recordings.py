"""Comparison with recordings of PX4 v1.17.0: message sets, rates, lengths, sentinels."""

import math
from collections import defaultdict
from functools import cache

import pytest

from sitl.conditions import GPS_NORMAL, GPS_SILENT

from ..thorough import sampled
from .replay import (
    NAMES,
    RECORDINGS,
    Situation,
    check_constants,
    check_counts,
    check_course,
    check_sensors,
    in_one_process,
    name,
    own,
    packets,
    parameter,
    recorded,
    replay,
    world,
)

pytestmark = recorded
PACED_BY_EVENTS = {"EVENT", "PARAM_VALUE", "GPS_GLOBAL_ORIGIN", "COMMAND_ACK", "STATUSTEXT"}
RECORDED_CLOCK = 0.981
"""Simulated seconds per recorded second in these recordings."""


def _read(recording):
    """Yield (seconds, message, packet) of the autopilot's own packets."""
    path = RECORDINGS / "px4" / recording
    start_s = next(packets(path))[0]
    for t, message, raw in own(path):
        yield t - start_s, message, raw


def _rates(rows):
    times = defaultdict(list)
    for t, message, _ in rows:
        times[name(message)].append(t)
    return {
        kind: (len(seen) - 1) / (seen[-1] - seen[0])
        for kind, seen in times.items()
        if len(seen) > 2
    }


def _own(peer, since=0.0):
    return [
        (t, m, m.get_msgbuf())
        for t, m in peer.received
        if (t >= since and (m.get_srcSystem(), m.get_srcComponent()) == (1, 1))
        or (m.get_type().startswith("UNKNOWN_") and t >= since)
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("recording", "end"),
    [
        ("h0_boot_rates.companion.tlog", "companion"),
        ("a1_boot_offboard_takeoff.gcs.tlog", "gcs"),
    ],
)
def test_the_set_of_messages_and_their_rates_are_px4s(make_flight, recording, end):
    flight = make_flight()
    flight.take_off()
    flight.run(30.0)
    rows = list(_read(recording))
    real = _rates(rows)
    fake = _rates(_own(getattr(flight, end)))
    for kind in set(real) - PACED_BY_EVENTS:
        assert kind in fake, kind
        hz = real[kind] / RECORDED_CLOCK
        slack = 0.04 if hz < 1.0 else 0.0
        assert fake[kind] == pytest.approx(hz, rel=0.12, abs=slack), kind
    assert not set(fake) - {name(message) for _, message, _ in rows} - PACED_BY_EVENTS


def _airborne_values(rows, since, until):
    last = {}
    for t, message, _ in rows:
        if since <= t <= until:
            last[name(message)] = message
    return last


SENTINELS = {
    "BATTERY_STATUS": ("id", "battery_function", "type", "temperature", "current_battery",
                       "energy_consumed", "time_remaining", "charge_state", "voltages_ext",
                       "mode", "fault_bitmask"),
    "SYS_STATUS": ("onboard_control_sensors_present", "onboard_control_sensors_enabled",
                   "onboard_control_sensors_health", "current_battery",
                   "onboard_control_sensors_health_extended"),
    "GPS_RAW_INT": ("fix_type", "eph", "epv", "satellites_visible", "h_acc", "v_acc", "vel_acc",
                    "hdg_acc", "yaw"),
    "HEARTBEAT": ("type", "autopilot", "base_mode", "custom_mode", "system_status",
                  "mavlink_version"),
    "ESTIMATOR_STATUS": ("flags",),
    "EXTENDED_SYS_STATE": ("vtol_state", "landed_state"),
    "CURRENT_MODE": ("standard_mode", "custom_mode", "intended_custom_mode"),
    "MISSION_CURRENT": ("seq", "total", "mission_state", "mission_mode"),
    "DISTANCE_SENSOR": ("min_distance", "max_distance", "type", "id", "orientation"),
    "ODOMETRY": ("frame_id", "child_frame_id", "estimator_type", "quality", "reset_counter"),
    "POSITION_TARGET_LOCAL_NED": ("coordinate_frame", "type_mask", "x", "y", "z", "yaw"),
    "SERVO_OUTPUT_RAW": ("port", "servo5_raw", "servo16_raw"),
    "GNSS_INTEGRITY": ("id", "raim_hfom", "corrections_quality"),
    "HIGHRES_IMU": ("diff_pressure", "temperature", "id"),
    "TIMESYNC": ("tc1",),
}  # fmt: skip


@pytest.fixture(scope="module")
def pair(make_flight):
    flight = make_flight()
    flight.take_off()
    flight.run(6.0)
    real = _airborne_values(_read("a1_boot_offboard_takeoff.companion.tlog"), 24.0, 31.0)
    fake = _airborne_values(_own(flight.companion), flight.now_s - 6.0, flight.now_s)
    return real, fake


@pytest.mark.parametrize("kind", sorted(SENTINELS))
def test_constant_fields_and_sentinels_are_px4s_in_offboard_flight(pair, kind):
    real, fake = pair
    for field in SENTINELS[kind]:
        assert getattr(fake[kind], field) == getattr(real[kind], field), field


def test_nan_stands_where_px4_puts_it(pair):
    real, fake = pair
    for kind, message in real.items():
        if kind in NAMES.values():
            continue
        for field, value in message.to_dict().items():
            other = getattr(fake[kind], field, None)
            if isinstance(value, float):
                assert math.isnan(value) == math.isnan(other), (kind, field)
            elif isinstance(value, list):
                nans = [isinstance(v, float) and math.isnan(v) for v in value]
                assert nans == [isinstance(v, float) and math.isnan(v) for v in other], kind


def test_payloads_are_cut_and_sized_as_px4s(pair):
    real, fake = pair
    for kind in ("SYS_STATUS", "BATTERY_STATUS", "HEARTBEAT", "ODOMETRY", "GPS_RAW_INT",
                 "SERVO_OUTPUT_RAW", "EXTENDED_SYS_STATE", "WIND_COV"):  # fmt: skip
        if kind in real:
            assert len(fake[kind].get_msgbuf()) == len(real[kind].get_msgbuf()), kind


def test_the_climb_to_ten_metres_follows_px4s(make_flight):
    arm_ms = 17_372
    real = {
        round((m.time_boot_ms - arm_ms) / 1000.0, 1): m.z
        for _, m, _ in _read("a1_boot_offboard_takeoff.companion.tlog")
        if m.get_type() == "LOCAL_POSITION_NED" and m.time_boot_ms >= arm_ms
    }
    flight = make_flight()
    flight.run(6.0)
    flight.hold_at()
    flight.run(1.5)
    flight.mode(flight.companion, (6, 0))
    start_s = flight.now_s
    flight.ask(flight.companion, 400, 1)
    flight.run(11.0)
    fake = {
        round(t - start_s, 1): m.z
        for t, m in flight.companion.received
        if m.get_type() == "LOCAL_POSITION_NED" and t >= start_s
    }
    for at_s in (2.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0):
        assert fake[at_s] == pytest.approx(real[at_s], abs=0.8), at_s


def test_wind_cov_has_px4s_accuracies_and_no_vertical_wind(airborne):
    fields = next(
        m for _, m, _ in _read("c1_wind_v118.companion.tlog") if m.get_type() == "WIND_COV"
    ).to_dict()
    airborne.vehicle.set_parameter("EKF2_DRAG_CTRL", 1)
    airborne.run(1.0)
    ours = airborne.companion.last("WIND_COV").to_dict()
    for field in ("wind_z", "var_vert", "horiz_accuracy", "vert_accuracy"):
        assert ours[field] == fields[field], field


def _events(packets):
    """Return {event number: (log levels, arguments)} of EVENT packets."""
    found = {}
    for raw in packets:
        if raw[7] | raw[8] << 8 == 410:
            payload = (raw[10 : 10 + raw[1]] + bytes(53))[:53]
            number = int.from_bytes(payload[:4], "little")
            found.setdefault(number, (payload[12], payload[13:].rstrip(b"\0")))
    return found


@pytest.mark.slow
def test_events_have_px4s_numbers_levels_and_arguments(make_flight):
    flight = make_flight()
    flight.take_off()
    flight.vehicle.conditions.battery_percent = 14.0
    flight.run(1.0)
    flight.vehicle.conditions.battery_percent = 6.5
    flight.run(3.0)
    flight.vehicle.conditions.battery_percent = 4.0
    assert flight.run(60.0, until=lambda f: not f.truth.armed)
    fake = _events(bytes(m.get_msgbuf()) for _, m in flight.companion.received)
    real = _events(raw for _, _, raw in _read("b1_battery_drain.companion.tlog"))
    named_by_time = {17980399}
    shared = (set(fake) & set(real)) - named_by_time
    assert {26266355, 21054825, 21826980, 19404811, 28121863, 30481910, 26528394} <= shared
    for number in shared:
        assert fake[number] == real[number], number


COMPANION_ONLY = {"links": ("companion",)}
SITUATIONS = {
    "start, modes and take-off": Situation(recordings=("a1_boot_offboard_takeoff",)),
    "a battery that drains": Situation(
        recordings=("b1_battery_drain",),
        actions=(
            (76.2, world(battery_percent=14.9)),
            (82.0, world(battery_percent=6.9)),
            (84.5, world(battery_percent=4.9)),
        ),
        **COMPANION_ONLY,
    ),
    "fewer satellites": Situation(
        recordings=("d1_gps_degradation",),
        actions=(
            (16.08, world(satellites=8)),
            (20.04, world(satellites=6)),
            (23.99, world(satellites=4)),
            (27.97, world(satellites=3)),
        ),
        until_s=47.0,
        **COMPANION_ONLY,
    ),
    "a silent receiver": Situation(
        recordings=("d3_gps_silent_v117",),
        actions=(
            (19.16, parameter("EKF2_DRAG_CTRL", 1)),
            (27.1, world(gps_mode=GPS_SILENT)),
            (42.0, world(gps_mode=GPS_NORMAL)),
        ),
        # A silent receiver is reported once a second. Readiness and health come later than usual.
        slack_s={"receiver": 1.0, "health": 2.4},
        **COMPANION_ONLY,
    ),
    "the pilot overrides": Situation(
        recordings=("e1_pilot_override",),
        actions=((51.87, parameter("COM_RC_OVERRIDE", 3)),),
    ),
    "a radio at the ground station": Situation(recordings=("f1_radio_rc",), until_s=39.7),
    "messages between the links": Situation(recordings=("g1_routing",), until_s=33.0),
    "no ground station": Situation(
        recordings=("k1_nogcs_autopilot_restart",), until_s=15.6, **COMPANION_ONLY
    ),
}
PASSED_ON = {"COMMAND_LONG", "DEBUG_FLOAT_ARRAY", "DEBUG_VECT", "NAMED_VALUE_FLOAT"}
"""Packets of the recorded autopilot's own shell, or passed on under its ids."""
OTHER_MODEL = {
    "POSITION_TARGET_GLOBAL_INT": {"lat_int", "lon_int", "alt"},
    "SCALED_PRESSURE": {"temperature"},
}
MAGNETOMETER_AND_LOGGING = 0x1200800
"""Bits of SYS_STATUS that the recorded simulator dropped for seconds."""
COURSES = {
    "mode": ("HEARTBEAT", lambda m: (m.base_mode, m.custom_mode, m.system_status), 0.8),
    "landed_state": ("EXTENDED_SYS_STATE", lambda m: m.landed_state, 0.8),
    "receiver": (
        "GPS_RAW_INT",
        lambda m: (m.fix_type, m.satellites_visible, m.eph, m.h_acc),
        0.3,
    ),
    "battery": ("BATTERY_STATUS", lambda m: m.charge_state, 2.1),
}
"""Compared courses: a message, its value, and how far apart in time the two may be.

Heartbeats come once a second, BATTERY_STATUS every other.
"""
SENSORS_SLACK_S = 0.6


@cache
def compare(title):
    return replay(RECORDINGS / "px4", SITUATIONS[title])


@pytest.fixture(params=in_one_process(sampled(list(SITUATIONS)[::2], SITUATIONS), pytest.mark.slow))
def both(request):
    return compare(request.param)


def test_the_messages_in_a_situation_are_px4s(both):
    for link in both.real:
        check_counts(both, link, but=PACED_BY_EVENTS | PASSED_ON, rel=0.12)


def test_fields_that_never_change_in_a_situation_are_px4s(both):
    for link in both.real:
        check_constants(both, link, but=PACED_BY_EVENTS, of_another_model=OTHER_MODEL)


@pytest.mark.parametrize("course", COURSES)
def test_modes_and_states_change_as_those_of_px4(both, course):
    kind, value, slack_s = COURSES[course]
    check_course(both, kind, value, shortest_s=1.05, slack_s=both.slack_s(course, slack_s))


@pytest.mark.parametrize("field", ["present", "enabled", "health"])
def test_the_sensors_bits_change_as_those_of_px4(both, field):
    slack_s = both.slack_s(field, SENSORS_SLACK_S)
    check_sensors(both, field, but=MAGNETOMETER_AND_LOGGING, slack_s=slack_s)

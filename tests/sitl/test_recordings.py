"""Comparison with recordings of PX4 v1.17.0: message sets, rates, lengths, sentinels."""

import math
import struct
from collections import defaultdict
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import all as mavlink

RECORDINGS = Path(__file__).parents[3] / "shared" / "traces" / "px4"
pytestmark = [
    pytest.mark.recordings,
    pytest.mark.skipif(not RECORDINGS.is_dir(), reason="no recordings beside the checkout"),
]
PACED_BY_EVENTS = {"EVENT", "PARAM_VALUE", "GPS_GLOBAL_ORIGIN", "COMMAND_ACK", "STATUSTEXT"}
NAMES = {8: "LINK_NODE_STATUS", 380: "TIME_ESTIMATE_TO_TARGET", 410: "EVENT",
         411: "CURRENT_EVENT_SEQUENCE"}  # fmt: skip
RECORDED_CLOCK = 0.981
"""Simulated seconds per recorded second in these recordings."""


def _read(name):
    """Yield (seconds, message, packet) of the autopilot's own packets."""
    data = (RECORDINGS / name).read_bytes()
    mav = mavlink.MAVLink(None)
    at, start_s = 0, None
    while at + 8 < len(data):
        time_s = struct.unpack(">Q", data[at : at + 8])[0] / 1e6
        at += 8
        size = data[at + 1] + 12 + (13 if data[at + 2] & 1 else 0)
        raw = data[at : at + size]
        at += size
        start_s = time_s if start_s is None else start_s
        if raw[5:7] == b"\x01\x01":
            yield time_s - start_s, mav.decode(bytearray(raw)), raw


def _name(message):
    kind = message.get_type()
    return NAMES[int(kind[8:])] if kind.startswith("UNKNOWN_") else kind


def _rates(rows):
    times = defaultdict(list)
    for t, message, _ in rows:
        times[_name(message)].append(t)
    return {
        kind: (len(seen) - 1) / (seen[-1] - seen[0])
        for kind, seen in times.items()
        if len(seen) > 2
    }


def _own(peer, since=0.0):
    return [
        (t, m, m.get_msgbuf())
        for t, m in peer.heard
        if (t >= since and (m.get_srcSystem(), m.get_srcComponent()) == (1, 1))
        or (m.get_type().startswith("UNKNOWN_") and t >= since)
    ]


@pytest.mark.parametrize(
    ("recording", "end"),
    [("h0_boot_rates.companion.tlog", "companion"), ("a1_boot_offboard_takeoff.gcs.tlog", "gcs")],
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
    assert not set(fake) - {_name(message) for _, message, _ in rows} - PACED_BY_EVENTS


def _airborne_values(rows, since, until):
    last = {}
    for t, message, _ in rows:
        if since <= t <= until:
            last[_name(message)] = message
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
        for t, m in flight.companion.heard
        if m.get_type() == "LOCAL_POSITION_NED" and t >= start_s
    }
    for at_s in (2.0, 4.0, 5.0, 6.0, 7.0, 8.0, 10.0):
        assert fake[at_s] == pytest.approx(real[at_s], abs=0.8), at_s


def test_wind_cov_settles_as_slowly_as_px4s(airborne):
    fields = next(
        m for _, m, _ in _read("c1_wind_v118.companion.tlog") if m.get_type() == "WIND_COV"
    ).to_dict()
    airborne.vehicle.set_parameter("EKF2_DRAG_CTRL", 1)
    airborne.run(1.0)
    ours = airborne.companion.last("WIND_COV").to_dict()
    for name in ("wind_z", "var_vert", "horiz_accuracy", "vert_accuracy"):
        assert ours[name] == fields[name], name


def _events(packets):
    """Return {event number: (log levels, arguments)} of EVENT packets."""
    found = {}
    for raw in packets:
        if raw[7] | raw[8] << 8 == 410:
            payload = (raw[10 : 10 + raw[1]] + bytes(53))[:53]
            number = int.from_bytes(payload[:4], "little")
            found.setdefault(number, (payload[12], payload[13:].rstrip(b"\0")))
    return found


def test_events_have_px4s_numbers_levels_and_arguments(make_flight):
    flight = make_flight()
    flight.take_off()
    flight.vehicle.conditions.battery_percent = 14.0
    flight.run(1.0)
    flight.vehicle.conditions.battery_percent = 6.5
    flight.run(3.0)
    flight.vehicle.conditions.battery_percent = 4.0
    assert flight.run(60.0, until=lambda f: not f.truth.armed)
    fake = _events(bytes(m.get_msgbuf()) for _, m in flight.companion.heard)
    real = _events(raw for _, _, raw in _read("b1_battery_drain.companion.tlog"))
    named_by_time = {17980399}
    shared = (set(fake) & set(real)) - named_by_time
    assert {26266355, 21054825, 21826980, 19404811, 28121863, 30481910, 26528394} <= shared
    for number in shared:
        assert fake[number] == real[number], number

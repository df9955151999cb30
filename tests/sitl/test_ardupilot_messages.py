"""ArduPilot's streams, messages and texts: requested messages are sent, unknown values marked."""

import math
from dataclasses import dataclass, replace

import pytest
from pymavlink.dialects.v20 import all as mavlink

from sitl.ardupilot.modes import Mode
from sitl.ardupilot.parameters import parameters
from sitl.ardupilot.state import GuidedTarget
from sitl.ardupilot.streams import ACCEPTED, DENIED, STREAMS, Schedule
from sitl.ardupilot.telemetry import Telemetry
from sitl.ardupilot.texts import TextSender
from sitl.conditions import GPS_JAMMED, GPS_NO_FIX, GPS_NORMAL, GPS_SILENT
from sitl.links import Link, LinkOptions, Router
from sitl.wire import frame, layout
from sitl.world import TICK_S, TICK_US, World, WorldOptions

ORIGIN = (47.397742, 8.545594, 489.4)
WITHOUT_GPS, WITH_GPS, GPS_LOST = 0xA7, 0x33F, 0x25


@dataclass(frozen=True, kw_only=True)
class Belief:
    """A vehicle that stands on the ground, ready, in GUIDED."""

    armed: bool = False
    custom_mode: int = Mode.GUIDED.number
    system_status: int = 3
    landed_state: int = 1
    guided_target: GuidedTarget | None = None
    desired_attitude_rad: tuple = (0.0, 0.0, 0.0)
    ekf_flags: int = WITH_GPS
    position_known: bool = True
    position_ned_m: tuple = (0.0, 0.0, 0.0)
    origin: tuple | None = ORIGIN
    home: tuple | None = ORIGIN
    wind_from: tuple | None = None
    battery_charge_state: int = 1
    battery_consumed_mah: float = 0.0
    battery_consumed_wh: float = 0.0
    ready_to_arm: bool = True
    fence_enabled: bool = False
    fence_breached: bool = False
    channels_us: tuple = (1500, 1500, 1000, 1500, 1800, 1500, 1500, 1500)
    remote_control_lost: bool = False
    rssi: int = 255
    return_place: tuple | None = None


class Changing:
    """The belief that the telemetry reads; `set` replaces parts of it."""

    def __init__(self):
        self._now = Belief()

    def __getattr__(self, name):
        return getattr(self._now, name)

    def set(self, **changes):
        self._now = replace(self._now, **changes)


class Bench:
    """World, belief and telemetry without links."""

    def __init__(self, **values):
        self.world = World(WorldOptions())
        self.state = Changing()
        self.telemetry = Telemetry(self.world, self.state, parameters(values), 0)
        self._mav = mavlink.MAVLink(None)

    def run(self, seconds):
        for _ in range(round(seconds / TICK_S)):
            self.world.tick(armed=self.state.armed)
            self.telemetry.step(TICK_S)
        return self

    def message(self, name):
        payload = self.telemetry.build(name)
        if payload is None:
            return None
        return self._mav.decode(
            bytearray(frame(layout(name), payload, seq=0, system=1, component=1))
        )


@pytest.fixture
def bench():
    return Bench().run(15.0)


# Messages that are sent


def _names(schedule, since_us, until_us):
    """Return {name: times} of what is due from one time to another."""
    found = {}
    for now_us in range(since_us + TICK_US, until_us + TICK_US, TICK_US):
        for name in schedule.due(now_us):
            found.setdefault(name, []).append(now_us)
    return found


def test_nothing_but_heartbeats_and_timesync_is_sent_without_a_request():
    found = _names(Schedule(0), 0, 31_000_000)
    assert set(found) == {"HEARTBEAT", "TIMESYNC"}
    assert len(found["HEARTBEAT"]) == 30
    assert found["TIMESYNC"] == [10_000_000, 20_000_000, 30_000_000]


@pytest.mark.parametrize(("hz", "sent"), [(0.5, 5), (3, 30), (20, 200), (30, 300), (100, 1000)])
def test_a_requested_rate_is_exact(hz, sent):
    schedule = Schedule(0)
    assert schedule.set(30, round(1e6 / hz), 0) == ACCEPTED
    assert len(_names(schedule, 0, 10_000_000)["ATTITUDE"]) == pytest.approx(sent, abs=1)


def test_no_message_goes_out_more_often_than_the_clock_ticks():
    schedule = Schedule(0)
    schedule.set(30, 5_000, 0)
    assert len(_names(schedule, 0, 1_000_000)["ATTITUDE"]) == 100


@pytest.mark.parametrize("msgid", [64, 109, 111, 230, 231, 253, 331, 340, 370, 11039, 999_999])
def test_messages_that_ardupilot_cannot_stream_are_denied(msgid):
    schedule = Schedule(0)
    assert schedule.set(msgid, 100_000, 0) == DENIED
    assert schedule.interval_us(msgid) == 0


@pytest.mark.parametrize("msgid", [0, 34, 49, 87, 124, 148, 162, 168, 235, 373, 11030])
def test_messages_without_data_now_are_accepted_all_the_same(msgid):
    assert Schedule(0).set(msgid, 100_000, 0) == ACCEPTED


def test_intervals_read_back_and_are_taken_away():
    schedule = Schedule(0)
    assert schedule.interval_us(30) == -1
    schedule.set(30, 50_000, 0)
    assert schedule.interval_us(30) == 50_000
    schedule.set(30, -1, 0)
    assert schedule.interval_us(30) == -1
    assert "ATTITUDE" not in _names(schedule, 0, 1_000_000)
    schedule.set(0, 200_000, 0)
    schedule.set(0, 0, 0)
    assert schedule.interval_us(0) == 1_000_000


def test_a_data_stream_is_a_group_of_messages():
    schedule = Schedule(0)
    schedule.set_stream(10, 4, 0)
    schedule.set_stream(77, 4, 0)
    found = _names(schedule, 0, 1_000_000)
    assert set(found) == set(STREAMS[10])
    assert len(found["ATTITUDE"]) == 4
    schedule.set_stream(0, 0, 1_000_000)
    assert set(_names(schedule, 1_000_000, 12_000_000)) == {"HEARTBEAT", "TIMESYNC"}


def test_every_message_that_is_streamed_can_be_built_or_has_no_data(bench):
    known = {"FENCE_STATUS", "GENERATOR_STATUS", "GPS2_RAW", "POSITION_TARGET_GLOBAL_INT"}
    for name in {name for names in STREAMS.values() for name in names}:
        assert (bench.message(name) is None) == (name in known), name


# Unknown values are marked


def test_there_is_no_local_position_and_no_wind_before_the_estimator_uses_gps(bench):
    bench.state.set(position_known=False, ekf_flags=WITHOUT_GPS)
    assert bench.message("LOCAL_POSITION_NED") is None
    assert bench.message("WIND") is None
    assert bench.message("GLOBAL_POSITION_INT").lat == pytest.approx(473977420, abs=60)


def test_an_unknown_wind_is_speed_0_from_minus_180(bench):
    wind = bench.message("WIND")
    assert (wind.speed, wind.direction, wind.speed_z) == (0.0, -180.0, 0.0)


@pytest.mark.parametrize(("from_deg", "shown"), [(90.0, 90.0), (269.0, -91.0), (350.0, -10.0)])
def test_the_wind_direction_is_that_of_its_origin_within_180_degrees(bench, from_deg, shown):
    bench.state.set(wind_from=(4.9, from_deg))
    wind = bench.message("WIND")
    assert wind.speed == pytest.approx(4.9)
    assert wind.direction == pytest.approx(shown)


def test_airspeed_is_the_speed_relative_to_the_estimated_wind(bench):
    assert bench.message("VFR_HUD").airspeed < 0.5
    bench.state.set(wind_from=(6.0, 123.0))
    assert bench.message("VFR_HUD").airspeed == pytest.approx(6.0, abs=0.5)


def test_there_is_no_home_and_no_origin_until_they_are_set(bench):
    assert bench.message("HOME_POSITION").altitude == 489400
    assert all(math.isnan(q) for q in bench.message("HOME_POSITION").q)
    bench.state.set(origin=None, home=None)
    assert bench.message("HOME_POSITION") is None
    assert bench.message("GPS_GLOBAL_ORIGIN") is None
    assert bench.message("GLOBAL_POSITION_INT").relative_alt == 0


def test_home_is_metres_from_the_origin(bench):
    bench.state.set(home=(ORIGIN[0] + 1e-4, ORIGIN[1], ORIGIN[2] - 2.0))
    home = bench.message("HOME_POSITION")
    assert (home.x, home.y, home.z) == pytest.approx((11.13, 0.0, 2.0), abs=0.01)


def test_without_a_monitor_there_is_no_battery():
    bench = Bench(BATT_MONITOR=0).run(1.0)
    status = bench.message("SYS_STATUS")
    assert bench.message("BATTERY_STATUS") is None
    assert (status.voltage_battery, status.current_battery, status.battery_remaining) == (0, -1, -1)


def test_the_battery_reports_the_consumed_charge(bench):
    bench.state.set(battery_consumed_mah=1000.0, battery_consumed_wh=12.0)
    battery = bench.message("BATTERY_STATUS")
    assert battery.battery_remaining == 69  # of 3300 mAh, cut off
    assert battery.current_consumed == 1000
    assert battery.energy_consumed == 432  # hectojoules
    assert battery.voltages[0] == pytest.approx(bench.world.battery.voltage_v * 1000.0, abs=1)
    assert battery.voltages[1:] == [65535] * 9
    assert (battery.time_remaining, battery.temperature) == (0, 32767)


# GPS


def test_the_receiver_is_found_after_ten_seconds():
    bench = Bench().run(9.0)
    gps = bench.message("GPS_RAW_INT")
    assert (gps.fix_type, gps.eph, gps.satellites_visible, gps.time_usec) == (0, 65535, 0, 0)
    assert bench.message("SYSTEM_TIME").time_unix_usec == 0
    gps = bench.run(0.9).message("GPS_RAW_INT")
    assert (gps.fix_type, gps.eph) == (1, 65535)
    gps = bench.run(0.3).message("GPS_RAW_INT")
    assert (gps.fix_type, gps.eph, gps.epv, gps.h_acc) == (6, 121, 200, 300)


def test_worse_gps_conditions_are_shown(bench):
    bench.world.conditions.hdop, bench.world.conditions.satellites = 2.5, 5
    gps = bench.run(0.5).message("GPS_RAW_INT")
    assert (gps.fix_type, gps.eph, gps.satellites_visible) == (6, 250, 5)
    assert gps.h_acc == pytest.approx(620, abs=1)


def test_without_a_fix_accuracy_and_time_stay_good_and_the_position_goes_on(bench):
    before = bench.message("GPS_RAW_INT")
    bench.world.conditions.gps_mode = GPS_NO_FIX
    after = bench.run(20.0).message("GPS_RAW_INT")
    assert (after.fix_type, after.satellites_visible) == (1, 3)
    for field in ("eph", "epv", "h_acc", "v_acc"):
        assert getattr(after, field) == getattr(before, field), field
    assert after.time_usec - before.time_usec <= 200_000
    assert after.lat != before.lat
    assert bench.message("SYS_STATUS").onboard_control_sensors_health & 0x20
    bench.world.conditions.gps_mode = GPS_NORMAL
    assert bench.run(0.5).message("GPS_RAW_INT").fix_type == 6


def test_a_silent_receiver_repeats_itself_for_four_seconds(bench):
    bench.world.conditions.gps_mode = GPS_SILENT
    first = bench.run(0.5).message("GPS_RAW_INT")
    repeated = bench.run(3.0).message("GPS_RAW_INT")
    assert repeated.to_dict() == first.to_dict()
    gone = bench.run(1.0).message("GPS_RAW_INT")
    assert (gone.fix_type, gone.eph, gone.lat, gone.h_acc) == (1, 65535, 0, 0)
    assert gone.time_usec == first.time_usec
    assert bench.message("SYS_STATUS").onboard_control_sensors_health & 0x20
    bench.run(4.0)
    assert not bench.message("SYS_STATUS").onboard_control_sensors_health & 0x20


def test_under_jamming_satellites_and_accuracy_jump_and_the_dilution_stays(bench):
    bench.world.conditions.gps_mode = GPS_JAMMED
    seen = [bench.run(0.2).message("GPS_RAW_INT") for _ in range(30)]
    assert len({gps.satellites_visible for gps in seen}) > 3
    assert len({gps.h_acc for gps in seen}) > 10
    assert {gps.eph for gps in seen} == {121}


def test_once_the_position_is_lost_its_coordinates_freeze_and_the_height_goes_on(bench):
    bench.state.set(position_known=False, ekf_flags=WITHOUT_GPS)
    frozen = bench.message("GLOBAL_POSITION_INT")
    bench.world.quad.d = -3.0
    bench.world.estimator.altitude_m += 3.0
    after = bench.message("GLOBAL_POSITION_INT")
    assert (after.lat, after.lon, after.alt) == (frozen.lat, frozen.lon, frozen.alt)
    assert after.relative_alt == pytest.approx(frozen.relative_alt + 3000, abs=1)


# Modes and targets


@pytest.mark.parametrize(
    ("mode", "state", "shown"),
    [
        (Mode.STABILIZE, {}, 81),
        (Mode.GUIDED, {}, 89),
        (Mode.GUIDED, {"armed": True}, 217),
        (Mode.ALT_HOLD, {"armed": True}, 209),
        (Mode.POSHOLD, {"armed": True}, 209),
        (Mode.LAND, {"armed": True, "landed_state": 4}, 217),
        (Mode.LAND, {"armed": True, "landed_state": 4, "ekf_flags": GPS_LOST}, 209),
        (Mode.LAND, {"ekf_flags": WITHOUT_GPS}, 89),
    ],
    ids=str,
)
def test_base_mode_is_ardupilots(bench, mode, state, shown):
    bench.state.set(custom_mode=mode.number, **state)
    assert bench.run(0.01).message("HEARTBEAT").base_mode == shown


def test_the_heartbeat_at_a_mode_change_still_has_the_former_guided_bit(bench):
    bench.state.set(custom_mode=Mode.ALT_HOLD.number, armed=True)
    beat = bench.message("HEARTBEAT")
    assert (beat.custom_mode, beat.base_mode) == (2, 217)
    assert bench.run(0.01).message("HEARTBEAT").base_mode == 209


@pytest.mark.parametrize(
    ("position", "velocity", "mask"),
    [
        ((1.0, 2.0, -10.0), (0.5, 0.0, 0.0), 0xC00),
        ((1.0, 2.0, -10.0), None, 0xDF8),
        (None, (0.5, 0.0, 0.0), 0xC07),
        (None, None, 0xC07),
    ],
)
def test_the_target_in_use_is_shown_with_its_mask(bench, position, velocity, mask):
    bench.state.set(
        guided_target=GuidedTarget(position_ned_m=position, velocity_ned_mps=velocity, yaw_rad=None)
    )
    shown = bench.message("POSITION_TARGET_LOCAL_NED")
    assert shown.type_mask == mask
    assert (shown.x, shown.y, shown.z) == (position or (0.0, 0.0, 0.0))
    assert (shown.vx, shown.vy, shown.vz) == (velocity or (0.0, 0.0, 0.0))


def test_there_is_no_target_outside_guided(bench):
    assert bench.message("POSITION_TARGET_LOCAL_NED") is None


def test_the_navigation_errors_are_those_to_the_target(bench):
    target = GuidedTarget(
        position_ned_m=(3.0, 4.0, -10.0), velocity_ned_mps=(1.0, 0.0, 0.0), yaw_rad=None
    )
    bench.state.set(guided_target=target, position_ned_m=(0.0, 0.0, -8.0))
    shown = bench.message("NAV_CONTROLLER_OUTPUT")
    assert (shown.wp_dist, shown.target_bearing) == (5, 53)
    assert shown.alt_error == pytest.approx(2.0)
    assert shown.xtrack_error == pytest.approx(4.0)


def test_rtl_shows_its_target(bench):
    bench.state.set(custom_mode=Mode.RTL.number, return_place=ORIGIN)
    shown = bench.message("POSITION_TARGET_GLOBAL_INT")
    assert (shown.lat_int, shown.type_mask) == (473977420, 0xFDF8)


# Texts


def test_texts_go_to_every_link_in_chunks_of_50_without_a_closing_tab():
    world = World(WorldOptions())
    links = [Link(LinkOptions(name=name)) for name in ("companion", "gcs")]
    sender = TextSender(world, Router(links), 0)
    sender.send(2, "Arm: " + "x" * 60)
    for link in links:
        chunks = [m for packet in link.out for m in _decoded(packet)]
        assert [len(m.text) for m in chunks] == [50, 15]
        assert chunks[0].id == chunks[1].id != 0


def test_the_texts_of_a_start_come_in_their_time_and_once():
    world = World(WorldOptions())
    link = Link(LinkOptions(name="companion"))
    sender = TextSender(world, Router([link]), 0)
    sent_texts = []
    for _ in range(1200):
        world.tick(armed=False)
        sender.step()
        sent_texts += [(world.now_s, m.text) for packet in link.out for m in _decoded(packet)]
        link.out.clear()
    assert (2.45, "ArduPilot Ready") in sent_texts
    assert len(sent_texts) == len(set(sent_texts)) == 14


def _decoded(packet):
    return mavlink.MAVLink(None).parse_buffer(packet) or []

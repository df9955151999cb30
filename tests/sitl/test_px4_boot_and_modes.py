"""Boot, modes and arming as measured on PX4 v1.17.0."""

import math
from itertools import pairwise

import pytest
from pymavlink.dialects.v20 import all as mavlink

HOLD, OFFBOARD, POSCTL, LAND, RTL, TAKEOFF = (
    0x03040000, 0x00060000, 0x00030000, 0x06040000, 0x05040000, 0x02040000,
)  # fmt: skip
PREARM = 1 << 28


def test_first_packets_come_a_third_of_a_second_after_power_on(flight):
    flight.run(1.0)
    assert 0.25 <= flight.companion.received[0][0] <= 0.4


def test_px4_boots_into_hold_disarmed_and_is_armable_after_four_to_five_seconds(flight):
    flight.run(8.0)
    first = flight.companion.of("HEARTBEAT")[0]
    assert (first.custom_mode, first.base_mode, first.system_status) == (HOLD, 29, 0)
    assert (first.type, first.autopilot, first.mavlink_version) == (2, 12, 3)
    ready = [
        t
        for t, m in flight.companion.received
        if m.get_type() == "SYS_STATUS" and m.onboard_control_sensors_health & PREARM
    ]
    assert 4.0 <= ready[0] <= 5.0
    assert flight.heartbeat().system_status == 3


def test_heartbeats_come_once_a_second_so_that_mode_changes_show_late(flight):
    flight.run(10.0)
    times = [t for t, m in flight.gcs.received if m.get_type() == "HEARTBEAT"]
    own = [
        t for t, m in flight.gcs.received
        if m.get_type() == "HEARTBEAT" and m.get_srcComponent() == 1
    ]  # fmt: skip
    assert len(times) > len(own)
    assert all(b - a == pytest.approx(1.0, abs=0.03) for a, b in pairwise(own))


def test_offboard_while_disarmed_is_accepted_without_a_stream(flight):
    flight.run(6.0)
    assert flight.mode(flight.companion, (6, 0)) == [0, 0]
    heartbeat = flight.heartbeat()
    assert (heartbeat.custom_mode, heartbeat.base_mode) == (OFFBOARD, 1)
    assert heartbeat.system_status == 0


def test_offboard_while_armed_without_a_stream_is_acked_twice_and_refused(flight):
    flight.run(6.0)
    assert flight.ask(flight.companion, 400, 1) == [0]
    assert flight.mode(flight.companion, (6, 0)) == [0, 1]
    assert flight.heartbeat().custom_mode == HOLD


def test_arming_in_offboard_without_a_stream_is_refused_even_by_force(flight):
    flight.run(6.0)
    flight.mode(flight.companion, (6, 0))
    assert flight.ask(flight.companion, 400, 1) == [1]
    assert flight.ask(flight.companion, 400, 1, 21196) == [1]
    texts = "".join(flight.gcs.texts())
    assert "Arming denied: Resolve system health failures first\t" in texts
    assert not flight.truth.armed


def test_arming_before_the_health_checks_are_done_is_refused(flight):
    flight.run(2.0)
    assert flight.ask(flight.gcs, 400, 1) == [1]


def test_armed_on_the_ground_px4_disarms_by_itself_after_eleven_seconds(flight):
    flight.run(6.0)
    flight.ask(flight.gcs, 400, 1)
    armed_s = flight.now_s - 0.3
    assert flight.run(15.0, until=lambda f: not f.truth.armed)
    assert flight.now_s - armed_s == pytest.approx(11.1, abs=0.3)
    assert "Disarmed by auto preflight disarming\t" in flight.gcs.texts()


def test_disarming_in_the_air_is_refused_unless_forced(airborne):
    assert airborne.ask(airborne.gcs, 400, 0) == [1]
    assert airborne.truth.armed
    assert airborne.ask(airborne.gcs, 400, 0, 21196) == [0]
    assert not airborne.truth.armed


def test_take_off_is_detected_1_6_s_after_arming_and_10_m_are_reached_in_8_to_9_s(flight):
    flight.take_off()
    text_s = {m.text: t for t, m in flight.gcs.received if m.get_type() == "STATUSTEXT"}
    armed_s = text_s["Armed by external command\t"]
    assert text_s["Takeoff detected\t"] - armed_s == pytest.approx(1.6, abs=0.25)
    reached = [
        t for t, m in flight.companion.received
        if m.get_type() == "LOCAL_POSITION_NED" and m.z < -9.5
    ]  # fmt: skip
    assert reached[0] - armed_s == pytest.approx(7.6, abs=1.2)


def test_nav_takeoff_then_arm_climbs_to_mis_takeoff_alt_and_holds(flight):
    flight.run(6.0)
    assert flight.ask(flight.gcs, 22, 0, 0, 0, math.nan, math.nan, math.nan, math.nan) == [0]
    assert flight.heartbeat().custom_mode == TAKEOFF
    assert flight.ask(flight.gcs, 400, 1) == [0]
    flight.run(3.0)
    assert flight.truth.landed_state == 3
    assert flight.run(10.0, until=lambda f: f.truth.mode == "AUTO.LOITER")
    flight.run(5.0)
    assert flight.truth.position_ned_m[2] == pytest.approx(-2.5, abs=0.6)
    assert flight.truth.landed_state == 2


def test_nav_land_lands_and_disarms_two_seconds_after_landing_detected(airborne):
    start_s = airborne.now_s
    assert airborne.ask(airborne.companion, 21, 0, 0, 0, math.nan) == [0]
    assert "Landing at current position\t" in airborne.gcs.texts(start_s)
    heartbeat = airborne.heartbeat()
    assert (heartbeat.custom_mode, heartbeat.system_status) == (LAND, 4)
    assert airborne.truth.landed_state == 4
    assert airborne.run(40.0, until=lambda f: not f.truth.armed)
    text_s = {m.text: t for t, m in airborne.gcs.received if m.get_type() == "STATUSTEXT"}
    gap_s = text_s["Disarmed by landing\t"] - text_s["Landing detected\t"]
    assert gap_s == pytest.approx(2.0, abs=0.15)


def test_nav_takeoff_with_a_height_climbs_to_the_height_after_arming(flight):
    flight.run(6.0)
    above_m = flight.gcs.last("HOME_POSITION").altitude / 1e3 + 5.0
    assert flight.ask(flight.gcs, 22, 0, 0, 0, math.nan, math.nan, math.nan, above_m) == [0]
    assert flight.ask(flight.gcs, 400, 1) == [0]
    flight.run(15.0)
    assert flight.heartbeat().custom_mode == HOLD
    assert flight.truth.position_ned_m[2] == pytest.approx(-5.0, abs=0.6)


def test_after_landing_the_mode_at_arming_is_back_so_that_a_later_arm_takes_off_again(airborne):
    airborne.ask(airborne.companion, 21)
    assert airborne.run(40.0, until=lambda f: not f.truth.armed)
    assert airborne.heartbeat().custom_mode == OFFBOARD
    assert airborne.ask(airborne.gcs, 400, 1) == [0]
    assert airborne.run(6.0, until=lambda f: f.truth.position_ned_m[2] < -1.0)


def test_hold_stops_within_two_metres_and_stays(airborne):
    airborne.stream = lambda f: f.companion.setpoint(
        0, 0.85 * (f.now_s - 10.0), -10.0, v=(0, 0.85, 0)
    )
    airborne.run(8.0)
    assert airborne.mode(airborne.gcs, (4, 3)) == [0, 0]
    y_m = airborne.truth.position_ned_m[1]
    airborne.run(8.0)
    assert airborne.truth.mode == "AUTO.LOITER"
    assert airborne.truth.position_ned_m[1] == pytest.approx(y_m, abs=2.0)


@pytest.mark.slow
def test_return_climbs_flies_home_and_lands_there(airborne):
    airborne.hold_at(0, 30, -12)
    airborne.run(15.0)
    start_s = airborne.now_s
    assert airborne.mode(airborne.gcs, (4, 5)) == [0, 0]
    assert any("RTL: start return at" in text for text in airborne.gcs.texts(start_s))
    assert airborne.run(20.0, until=lambda f: f.truth.position_ned_m[2] < -28.0)
    assert airborne.run(90.0, until=lambda f: not f.truth.armed)
    north_m, east_m, _ = airborne.truth.position_ned_m
    assert math.hypot(north_m, east_m) < 1.5


def test_a_mission_cannot_be_flown_without_one(airborne):
    assert airborne.mode(airborne.gcs, (4, 4)) == [0, 1]
    assert airborne.heartbeat().custom_mode == OFFBOARD


def test_unknown_commands_are_unsupported_and_those_to_other_systems_are_not_answered(flight):
    flight.run(6.0)
    assert flight.ask(flight.gcs, 31010, 1) == [3]
    assert flight.ask(flight.gcs, 31010, 1, component=0) == [3]
    assert flight.ask(flight.gcs, 31010, 1, component=195) == []
    assert flight.ask(flight.gcs, 31010, 1, component=0, system=0) == []


def test_acks_are_addressed_to_the_sender(flight):
    flight.run(6.0)
    flight.ask(flight.companion, 400, 0)
    ack = flight.companion.last("COMMAND_ACK")
    assert (ack.target_system, ack.target_component) == (1, 195)
    assert not flight.gcs.of("COMMAND_ACK")


def test_command_int_is_answered_like_command_long(flight):
    flight.run(6.0)
    flight.gcs.send(mavlink.MAVLink_command_int_message(1, 1, 0, 400, 0, 0, 1, 0, 0, 0, 0, 0, 0))
    flight.run(0.2)
    assert flight.gcs.last("COMMAND_ACK").result == 0
    assert flight.truth.armed


def test_a_reboot_sets_time_boot_ms_back_and_disarms(flight):
    flight.run(6.0)
    flight.mode(flight.companion, (6, 0))
    before_ms = flight.companion.last("SYSTEM_TIME").time_boot_ms
    assert flight.ask(flight.gcs, 246, 1) == [0]
    flight.run(2.0)
    after = flight.companion.last("SYSTEM_TIME")
    assert after.time_boot_ms < before_ms
    assert flight.heartbeat().custom_mode == HOLD
    assert after.time_unix_usec > 1_700_000_000_000_000


def test_a_reboot_while_armed_is_denied_but_a_crash_of_the_software_drops_the_vehicle(airborne):
    assert airborne.ask(airborne.gcs, 246, 1) == [2]
    airborne.vehicle.reboot()
    assert airborne.run(5.0, until=lambda f: f.truth.on_ground)
    assert not airborne.truth.armed


def test_reposition_in_hold_flies_to_a_place_in_degrees(airborne):
    airborne.mode(airborne.gcs, (4, 3))
    goal = airborne.vehicle._world.frame.geodetic(20.0, 0.0, -12.0)
    nan = math.nan
    assert airborne.ask(
        airborne.gcs, 192, -1, 1, 0, nan,
        goal.latitude_deg, goal.longitude_deg, goal.altitude_amsl_m,
    ) == [0]  # fmt: skip
    airborne.run(15.0)
    assert airborne.truth.position_ned_m[0] == pytest.approx(20.0, abs=1.5)


def test_after_landing_from_offboard_the_mode_is_offboard_and_px4_is_not_ready(flight):
    """Taken off in HOLD, flown in OFFBOARD, landed by LAND: so it is in a recording of PX4."""
    flight.run(6.0)
    flight.ask(flight.gcs, 22, math.nan, 0, 0, math.nan, math.nan, math.nan, 494.4)
    assert flight.ask(flight.gcs, 400, 1) == [0]
    assert flight.run(20.0, until=lambda f: f.truth.mode == "AUTO.LOITER")
    flight.hold_at(z=-4.0)
    flight.run(1.5)
    flight.mode(flight.gcs, (6, 0))
    flight.stream = None
    flight.mode(flight.gcs, (4, 6))
    assert flight.run(40.0, until=lambda f: not f.truth.armed)
    flight.run(1.0)
    last = flight.heartbeat()
    assert (last.custom_mode, last.system_status) == (OFFBOARD, 0)


def test_current_mode_comes_twice_a_second_and_at_a_change_whatever_is_requested(flight):
    flight.run(5.0)
    assert flight.ask(flight.companion, 511, 436, 20_000) == [0]
    assert flight.ask(flight.companion, 511, 0, 200_000) == [4]
    since = flight.now_s
    flight.run(5.0)
    assert 9 <= len(flight.companion.of("CURRENT_MODE", since=since)) <= 11
    beats = [m for m in flight.companion.of("HEARTBEAT", since=since) if m.get_srcComponent() == 1]
    assert 4 <= len(beats) <= 6
    since = flight.now_s
    flight.mode(flight.gcs, (2, 0))
    flight.run(0.1)
    reported = flight.companion.of("CURRENT_MODE", since=since)
    assert {m.custom_mode for m in reported} == {2 << 16}
    assert len(reported) > (flight.now_s - since) / 0.5


def test_the_heartbeats_of_two_links_are_out_of_phase(flight):
    flight.run(5.0)
    first = [
        next(t for t, m in peer.received if m.get_type() == "HEARTBEAT" and m.autopilot == 12)
        for peer in (flight.companion, flight.gcs)
    ]
    assert 0.2 <= (first[1] - first[0]) % 1.0 <= 0.8


def test_lost_and_regained_links_are_reported(flight):
    flight.run(4.0)
    flight.companion_alive = flight.ground_station_alive = False
    flight.run(12.0)
    flight.companion_alive = flight.ground_station_alive = True
    flight.run(2.0)
    texts = [text.strip() for text in flight.gcs.texts()]
    texts = [text for text in texts if "onnect" in text or "controller" in text]
    assert texts[:2] == ["Connection to mission computer lost", "Connection to ground station lost"]
    assert sorted(texts[2:]) == ["GCS connection regained", "Onboard controller regained"]

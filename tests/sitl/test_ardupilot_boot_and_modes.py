"""ArduPilot's start, arming, take-off, landing and modes, as measured on ArduCopter 4.6.3."""

import itertools

import pytest
from pymavlink.dialects.v20 import all as mavlink

STABILIZE, ALT_HOLD, AUTO, GUIDED, LOITER, RTL, LAND, POSHOLD, BRAKE, SMART_RTL = (
    0, 2, 3, 4, 5, 6, 9, 16, 17, 21,
)  # fmt: skip
ACCEPTED, DENIED, UNSUPPORTED, FAILED = 0, 2, 3, 4
ARM, TAKEOFF, SET_MODE = 400, 22, 176
GROUND, AIR, RISING, LANDING = 1, 2, 3, 4


def _when(flight, text):
    return next(
        t for t, m in flight.gcs.received if m.get_type() == "STATUSTEXT" and m.text == text
    )


def _own(flight, kind, since=0.0):
    return [
        (t, m)
        for t, m in flight.companion.received
        if m.get_type() == kind and m.get_srcComponent() == 1 and t >= since
    ]


def test_the_start_takes_as_long_as_the_real_one(make_ardupilot):
    flight = make_ardupilot(boot_s=41.6)
    flight.run(2.0)
    for msgid in (32, 168, 242):
        assert flight.ask(flight.companion, 511, msgid, 100_000) == [ACCEPTED]
    flight.run(43.0)
    assert _own(flight, "HEARTBEAT")[0][0] == pytest.approx(1.1, abs=0.15)
    assert _when(flight, "EKF3 IMU0 origin set") == pytest.approx(20.0, abs=0.5)
    assert _when(flight, "EKF3 IMU0 is using GPS") == pytest.approx(41.6, abs=0.5)
    for kind, first_s in (("HOME_POSITION", 20.0), ("LOCAL_POSITION_NED", 41.7), ("WIND", 41.7)):
        assert _own(flight, kind)[0][0] == pytest.approx(first_s, abs=0.2), kind


def test_ardupilot_boots_in_the_mode_of_the_switch_and_is_in_standby_after_two_seconds(ardupilot):
    ardupilot.run(5.0)
    beats = [(m.custom_mode, m.system_status) for _, m in _own(ardupilot, "HEARTBEAT")]
    assert beats[0] == (STABILIZE, 1)
    assert beats[-1] == (STABILIZE, 3)


def test_arming_before_ardupilot_is_ready_fails_with_the_reason(ardupilot):
    ardupilot.run(3.0)
    assert ardupilot.ask(ardupilot.companion, ARM, 1) == [FAILED]
    assert "Arm: Accels inconsistent" in ardupilot.companion.texts()
    assert ardupilot.mode(ardupilot.companion, GUIDED) == [ACCEPTED]
    ardupilot.run(4.0)
    assert ardupilot.ask(ardupilot.companion, ARM, 1) == [FAILED]
    assert "Arm: Need Position Estimate" in ardupilot.companion.texts()


def test_poor_gps_forbids_arming_in_guided(ardupilot):
    ardupilot.ready()
    ardupilot.mode(ardupilot.companion, GUIDED)
    ardupilot.vehicle.conditions.hdop = 1.6
    assert ardupilot.ask(ardupilot.companion, ARM, 1) == [FAILED]
    assert "Arm: High GPS HDOP" in ardupilot.companion.texts()


def test_a_climb_to_ten_metres_takes_9_7_seconds_and_landed_state_follows(ardupilot):
    ardupilot.ready()
    ardupilot.companion.command(511, 245, 50_000)
    ardupilot.mode(ardupilot.companion, GUIDED)
    start_s = ardupilot.now_s
    ardupilot.companion.command(ARM, 1)
    ardupilot.companion.command(TAKEOFF, 0, 0, 0, 0, 0, 0, 10)
    assert ardupilot.run(15.0, until=lambda f: f.truth.position_ned_m[2] < -9.7)
    assert ardupilot.now_s - start_s == pytest.approx(9.7, abs=0.3)
    ardupilot.run(3.0)
    start_s = ardupilot.now_s
    assert ardupilot.mode(ardupilot.companion, LAND) == [ACCEPTED]
    assert ardupilot.run(40.0, until=lambda f: not f.truth.armed)
    assert ardupilot.now_s - start_s == pytest.approx(22.7, abs=0.6)
    ardupilot.run(0.2)
    states = [m.landed_state for _, m in _own(ardupilot, "EXTENDED_SYS_STATE")]
    changes = [b for a, b in zip([0, *states], states, strict=False) if a != b]
    assert changes == [GROUND, RISING, AIR, LANDING, GROUND]
    texts = ardupilot.companion.texts()
    assert texts.index("Arming motors") < texts.index("Disarming motors")


def test_the_height_of_a_take_off_is_above_home_not_above_the_sea(ardupilot):
    ardupilot.take_off(height_m=6.0)
    assert ardupilot.truth.position_ned_m[2] == pytest.approx(-6.0, abs=0.4)


def test_take_off_needs_guided_armed_on_the_ground_and_a_positive_height(ardupilot):
    ardupilot.ready()
    assert ardupilot.ask(ardupilot.companion, TAKEOFF, 0, 0, 0, 0, 0, 0, 5) == [FAILED]
    ardupilot.ask(ardupilot.companion, ARM, 1)
    assert ardupilot.ask(ardupilot.companion, TAKEOFF, 0, 0, 0, 0, 0, 0, 5) == [FAILED]
    ardupilot.mode(ardupilot.companion, GUIDED)
    assert ardupilot.ask(ardupilot.companion, TAKEOFF, 0, 0, 0, 0, 0, 0, -5) == [FAILED]
    assert ardupilot.ask(ardupilot.companion, TAKEOFF, 0, 0, 0, 0, 0, 0, 5) == [ACCEPTED]
    ardupilot.run(15.0)
    assert ardupilot.ask(ardupilot.companion, TAKEOFF, 0, 0, 0, 0, 0, 0, 12) == [FAILED]


def test_armed_on_the_ground_ardupilot_is_in_standby_and_disarms_after_ten_seconds(ardupilot):
    ardupilot.ready()
    ardupilot.mode(ardupilot.companion, GUIDED)
    ardupilot.companion.command(ARM, 1)
    start_s = ardupilot.now_s
    assert ardupilot.heartbeat().system_status == 3
    assert ardupilot.run(15.0, until=lambda f: not f.truth.armed)
    assert ardupilot.now_s - start_s == pytest.approx(10.0, abs=0.2)


def test_in_the_air_ardupilot_is_active_and_disarms_only_by_force(hovering):
    assert hovering.heartbeat().system_status == 4
    assert hovering.ask(hovering.companion, ARM, 0) == [FAILED]
    assert hovering.truth.armed
    assert hovering.ask(hovering.companion, ARM, 0, 21196) == [ACCEPTED]
    assert not hovering.truth.armed


@pytest.mark.parametrize(
    "mode", [STABILIZE, ALT_HOLD, LOITER, RTL, LAND, POSHOLD, BRAKE, SMART_RTL]
)
def test_a_mode_change_is_immediate_acknowledged_and_shown_by_an_extra_heartbeat(hovering, mode):
    start_s = hovering.now_s
    assert hovering.mode(hovering.gcs, mode) == [ACCEPTED]
    at_s, beat = _own(hovering, "HEARTBEAT", since=start_s + 1e-9)[0]
    assert beat.custom_mode == mode
    assert at_s - start_s <= 0.04
    assert not hovering.companion.of("COMMAND_ACK", since=start_s + 1e-9)


def test_modes_that_cannot_be_entered_are_refused_with_a_text(hovering):
    assert hovering.mode(hovering.companion, 99) == [FAILED]
    assert hovering.mode(hovering.companion, AUTO) == [FAILED]
    assert hovering.ask(hovering.companion, SET_MODE, 0, GUIDED) == [DENIED]
    assert hovering.truth.mode == "GUIDED"
    texts = hovering.companion.texts()
    assert "No such mode 99" in texts
    assert "Mode change to AUTO failed: init failed" in texts


def test_set_mode_works_too_and_is_never_acknowledged(hovering):
    start_s = hovering.now_s
    hovering.gcs.send(mavlink.MAVLink_set_mode_message(1, 1, POSHOLD))
    hovering.run(0.3)
    assert hovering.truth.mode == "POSHOLD"
    assert not hovering.gcs.of("COMMAND_ACK", since=start_s + 1e-9)


def test_loiter_stops_within_a_metre_and_stays_until_the_sticks_move(hovering):
    hovering.along(0.5)
    hovering.run(6.0)
    hovering.mode(hovering.gcs, LOITER)
    north_m = hovering.truth.position_ned_m[0]
    hovering.run(6.0)
    assert hovering.truth.position_ned_m[0] == pytest.approx(north_m, abs=1.0)
    hovering.vehicle.move_sticks(pitch=0.5)
    hovering.run(4.0)
    assert hovering.truth.position_ned_m[0] > north_m + 5.0
    hovering.vehicle.move_sticks(throttle=-1.0)
    assert hovering.run(20.0, until=lambda f: f.truth.on_ground)


def test_alt_hold_keeps_the_height_and_leans_as_the_stick_does(hovering):
    hovering.mode(hovering.gcs, ALT_HOLD)
    hovering.vehicle.move_sticks(pitch=0.3)
    hovering.run(3.0)
    assert hovering.truth.position_ned_m[0] > 1.5
    assert hovering.truth.position_ned_m[2] == pytest.approx(-10.0, abs=0.6)


def test_a_pilot_takes_off_with_the_throttle(ardupilot):
    ardupilot.ready()
    ardupilot.mode(ardupilot.gcs, LOITER)
    assert ardupilot.ask(ardupilot.gcs, ARM, 1) == [ACCEPTED]
    ardupilot.run(5.0)
    assert ardupilot.truth.on_ground
    ardupilot.vehicle.move_sticks(throttle=0.5)
    assert ardupilot.run(10.0, until=lambda f: f.truth.position_ned_m[2] < -2.0)


def test_return_climbs_to_15_metres_flies_home_waits_and_lands(hovering):
    hovering.stream = lambda f: f.companion.setpoint(25.0, 0.0, -10.0)
    hovering.run(15.0)
    hovering.stream = None
    assert hovering.mode(hovering.gcs, RTL) == [ACCEPTED]
    heights = hovering.watch(6.0, lambda f: -f.truth.position_ned_m[2])
    assert max(heights) == pytest.approx(15.0, abs=0.5)
    assert hovering.truth.position_ned_m[0] > 20.0
    assert hovering.run(90.0, until=lambda f: not f.truth.armed)
    north_m, east_m, _ = hovering.truth.position_ned_m
    assert abs(north_m) + abs(east_m) < 1.5


def test_a_reboot_is_1_2_seconds_of_silence_and_the_streams_are_gone(ardupilot):
    ardupilot.ready()
    ardupilot.companion.command(511, 30, 50_000)
    ardupilot.run(1.0)
    assert ardupilot.companion.of("ATTITUDE")
    start_s = ardupilot.now_s
    assert ardupilot.ask(ardupilot.companion, 246, 1) == [ACCEPTED]
    ardupilot.run(5.0)
    first_s, beat = _own(ardupilot, "HEARTBEAT", since=start_s + 0.02)[0]
    assert first_s - start_s == pytest.approx(1.2, abs=0.1)
    assert (beat.custom_mode, beat.system_status) == (STABILIZE, 1)
    assert not ardupilot.companion.of("ATTITUDE", since=start_s + 0.05)


def test_a_reboot_in_the_air_is_refused_but_a_crash_of_the_software_drops_the_vehicle(hovering):
    assert hovering.ask(hovering.gcs, 246, 1) == [FAILED]
    hovering.vehicle.reboot()
    assert hovering.run(5.0, until=lambda f: f.truth.on_ground)


def test_unknown_commands_are_unsupported(ardupilot):
    ardupilot.run(3.0)
    assert ardupilot.ask(ardupilot.gcs, 31010, 1) == [UNSUPPORTED]


def test_parameters_are_numbers_answered_without_an_index_and_sets_are_sent_on_all_links(ardupilot):
    ardupilot.run(2.0)
    read = mavlink.MAVLink_param_request_read_message(1, 1, b"GUID_TIMEOUT", -1)
    ardupilot.companion.send(read)
    ardupilot.run(0.1)
    value = ardupilot.companion.last("PARAM_VALUE")
    assert (value.param_value, value.param_type, value.param_index) == (3.0, 9, 65535)
    ardupilot.gcs.send(mavlink.MAVLink_param_set_message(1, 1, b"BATT_LOW_TIMER", 5.0, 9))
    ardupilot.run(0.1)
    assert ardupilot.vehicle.parameter("BATT_LOW_TIMER") == 5
    for peer in (ardupilot.companion, ardupilot.gcs):
        value = peer.last("PARAM_VALUE")
        assert (value.param_id, value.param_value, value.param_type) == ("BATT_LOW_TIMER", 5.0, 2)


def test_the_list_of_parameters_is_whole_and_numbered(ardupilot):
    ardupilot.run(2.0)
    ardupilot.gcs.send(mavlink.MAVLink_param_request_list_message(1, 1))
    ardupilot.run(2.0)
    values = ardupilot.gcs.of("PARAM_VALUE")
    assert [m.param_index for m in values] == list(range(values[0].param_count))


def test_local_position_is_in_ardupilots_own_projection(hovering):
    hovering.stream = lambda f: f.companion.setpoint(100.0, 0.0, -10.0)
    hovering.run(40.0)
    latitude_deg, _, _ = hovering.vehicle.manner.origin
    expected_m = (hovering.truth.latitude_deg - latitude_deg) * 6_378_100.0 * 3.14159265 / 180.0
    assert hovering.local_m[0] == pytest.approx(expected_m, abs=0.15)
    assert hovering.local_m[0] - hovering.truth.position_ned_m[0] > 0.05


def test_guided_without_gps_holds_its_height_and_drifts_level(hovering):
    assert hovering.mode(hovering.gcs, 20) == [ACCEPTED]
    hovering.run(8.0)
    assert hovering.tilt_deg < 3.0
    assert hovering.truth.position_ned_m[2] == pytest.approx(-10.0, abs=0.6)


def test_the_same_seed_and_input_give_the_same_bytes(make_ardupilot):
    def bytes_of_a_flight(**options):
        flight = make_ardupilot(**options)
        flight.take_off()
        flight.companion.command(511, 32, 50_000)
        flight.run(3.0)
        return [m.get_msgbuf() for _, m in flight.companion.received]

    assert bytes_of_a_flight() == bytes_of_a_flight()
    assert bytes_of_a_flight() != bytes_of_a_flight(seed=2)


def test_origin_and_home_are_sent_on_all_links_when_they_are_set_and_at_arming(ardupilot):
    ardupilot.ready()
    ardupilot.mode(ardupilot.companion, GUIDED)
    for expected in (1, 2):
        for peer in (ardupilot.companion, ardupilot.gcs):
            assert len(peer.of("GPS_GLOBAL_ORIGIN")) == expected
            assert len(peer.of("HOME_POSITION")) == expected
        ardupilot.ask(ardupilot.gcs, ARM, 1)


def test_during_boot_every_heartbeat_is_sent_twice(ardupilot):
    ardupilot.run(6.0)
    statuses = [m.system_status for _, m in _own(ardupilot, "HEARTBEAT")]
    assert statuses == [1, 1, 1, 1, 3, 3, 3]


def test_the_estimators_flags_show_missing_initialisation_and_alignment(ardupilot):
    manner = ardupilot.vehicle.manner
    seen = [
        flags for flags, _ in itertools.groupby(ardupilot.watch(8.0, lambda _: manner.ekf_flags))
    ]
    assert seen == [0x400, 0, 0xA7]


def test_the_compass_is_aligned_once_in_each_flight(hovering):
    text = "EKF3 IMU1 MAG0 in-flight yaw alignment complete"
    assert hovering.gcs.texts().count(text) == 1
    hovering.mode(hovering.gcs, LAND)
    assert hovering.run(40.0, until=lambda f: not f.truth.armed)
    assert hovering.gcs.texts().count(text) == 1


def test_the_throttle_stick_is_down_until_the_pilot_moves_it(ardupilot):
    ardupilot.run(3.0)
    ardupilot.companion.command(512, 65)
    ardupilot.run(0.2)
    assert ardupilot.companion.last("RC_CHANNELS").chan3_raw == 1000


def test_a_landing_is_still_reported_for_a_moment_after_guided_has_ended_it(make_ardupilot):
    flight = make_ardupilot()
    flight.take_off()
    assert flight.ask(flight.companion, 511, 245, 10_000) == [ACCEPTED]
    flight.mode(flight.gcs, LAND)
    flight.run(1.0)
    flight.gcs.command(SET_MODE, 1, GUIDED)
    assert flight.run(0.2, until=lambda f: f.truth.mode == "GUIDED")
    ended_s = flight.now_s
    flight.run(0.5)
    landed_states = [
        (t, m.landed_state) for t, m in _own(flight, "EXTENDED_SYS_STATE", since=ended_s - 0.01)
    ]
    assert 0.04 <= max(t for t, state in landed_states if state == LANDING) - ended_s <= 0.11
    assert landed_states[-1][1] == AIR


def test_heartbeats_come_as_often_as_they_are_asked_for(make_ardupilot):
    flight = make_ardupilot()
    flight.run(3.0)
    assert flight.ask(flight.companion, 511, 0, 200_000) == [ACCEPTED]
    since = flight.now_s
    flight.run(4.0)
    assert 19 <= len(_own(flight, "HEARTBEAT", since=since)) <= 21

"""Message sets, intervals, requests, parameters and wind as measured on PX4 v1.17.0."""

import math
import struct

import pytest
from pymavlink.dialects.v20 import all as mavlink

RATES_ONBOARD = {
    "ATTITUDE": 100, "ATTITUDE_QUATERNION": 50, "GLOBAL_POSITION_INT": 50, "HIGHRES_IMU": 50,
    "LOCAL_POSITION_NED": 30, "ODOMETRY": 30, "VFR_HUD": 10, "SERVO_OUTPUT_RAW": 10,
    "TIMESYNC": 10, "POSITION_TARGET_LOCAL_NED": 10, "ATTITUDE_TARGET": 10, "GPS_RAW_INT": 8,
    "SYS_STATUS": 5, "EXTENDED_SYS_STATE": 5, "ESTIMATOR_STATUS": 1, "SYSTEM_TIME": 1,
    "BATTERY_STATUS": 0.5, "CURRENT_MODE": 0.5, "HOME_POSITION": 0.5,
}  # fmt: skip


def _rates(flight, peer, seconds=10.0):
    start_s = flight.now_s
    flight.run(seconds)
    return {kind: n / seconds for kind, n in flight.count(peer, start_s + 1e-9).items()}


def test_the_rates_on_an_onboard_link(flight):
    flight.run(5.0)
    rates = _rates(flight, flight.companion, 20.0)
    for kind, hz in RATES_ONBOARD.items():
        assert rates[kind] == pytest.approx(hz, rel=0.06), kind
        assert flight.companion.last(kind).get_msgId() > 0, kind


def test_an_interval_is_set_per_link_and_0_restores_the_default_and_minus_1_stops(flight):
    flight.run(5.0)
    assert flight.ask(flight.companion, 511, 30, 200_000) == [0]
    assert _rates(flight, flight.companion)["ATTITUDE"] == pytest.approx(5, abs=0.3)
    assert _rates(flight, flight.gcs)["ATTITUDE"] == pytest.approx(50, abs=1)
    assert flight.ask(flight.companion, 510, 30) == [0]
    answer = flight.companion.last("MESSAGE_INTERVAL")
    assert (answer.message_id, answer.interval_us) == (30, 200_000)
    flight.ask(flight.companion, 511, 30, -1)
    assert "ATTITUDE" not in _rates(flight, flight.companion, 3.0)
    flight.ask(flight.companion, 511, 30, 0)
    assert _rates(flight, flight.companion)["ATTITUDE"] == pytest.approx(100, abs=2)


@pytest.mark.parametrize(
    ("msgid", "result"),
    [(147, 0), (231, 0), (291, 0), (65, 0), (375, 0), (148, 0), (26, 0), (253, 0), (8, 0),
     (0, 4), (109, 4), (340, 4), (9999, 4), (64, 4)],
)  # fmt: skip
def test_set_message_interval_is_accepted_or_failed_as_measured(flight, msgid, result):
    flight.run(5.0)
    assert flight.ask(flight.companion, 511, msgid, 200_000) == [result]


@pytest.mark.parametrize(("msgid", "interval_us"), [(231, 100_000), (24, -1), (9999, -1)])
def test_get_message_interval_reads_as_measured(flight, msgid, interval_us):
    flight.run(5.0)
    flight.ask(flight.companion, 510, msgid)
    assert flight.companion.last("MESSAGE_INTERVAL").interval_us == interval_us


def test_the_rate_of_gps_raw_int_can_be_reduced_and_restored(flight):
    flight.run(5.0)
    flight.ask(flight.companion, 511, 24, 500_000)
    assert _rates(flight, flight.companion)["GPS_RAW_INT"] == pytest.approx(2, abs=0.2)
    flight.ask(flight.companion, 511, 24, 0)
    assert _rates(flight, flight.companion)["GPS_RAW_INT"] == pytest.approx(8, abs=0.3)


@pytest.mark.parametrize(
    ("msgid", "kind"),
    [(148, "AUTOPILOT_VERSION"), (147, "BATTERY_STATUS"), (242, "HOME_POSITION"),
     (49, "GPS_GLOBAL_ORIGIN")],
)  # fmt: skip
def test_a_message_is_sent_on_request(flight, msgid, kind):
    flight.run(5.0)
    start_s = flight.now_s
    assert flight.ask(flight.companion, 512, msgid) == [0]
    assert flight.companion.of(kind, since=start_s + 1e-9)


def test_actuator_outputs_come_when_asked_for_and_esc_status_never(flight):
    flight.run(5.0)
    for msgid in (375, 291):
        assert flight.ask(flight.companion, 511, msgid, 100_000) == [0]
    rates = _rates(flight, flight.companion)
    assert rates["ACTUATOR_OUTPUT_STATUS"] == pytest.approx(10, abs=0.3)
    assert "ESC_STATUS" not in rates


@pytest.mark.parametrize("msgid", [231, 65, 291, 9999])
def test_a_request_for_a_message_without_data_is_denied(flight, msgid):
    flight.run(5.0)
    assert flight.ask(flight.companion, 512, msgid) == [2]


def test_a_request_for_available_modes_brings_all_26(flight):
    flight.run(5.0)
    before = flight.companion.raw_bytes
    assert flight.ask(flight.companion, 512, 435) == [0]
    modes = flight.companion.of("AVAILABLE_MODES")
    assert [m.mode_index for m in modes] == list(range(1, 27))
    assert flight.companion.raw_bytes > before


def test_texts_go_to_the_ground_station_only_events_to_both(airborne):
    assert airborne.gcs.texts()
    assert not airborne.companion.texts()
    # Known by name where the companion's own dialect was loaded by another test.
    assert airborne.companion.of("UNKNOWN_410") or airborne.companion.of("EVENT")
    assert all(text.endswith("\t") for text in airborne.gcs.texts() if len(text) < 50)


def test_texts_reach_the_companions_link_if_a_ground_station_is_received_there(flight):
    flight.run(2.0)
    flight.companion.heartbeat(mavlink.MAV_TYPE_GCS)
    flight.run(4.0)
    flight.ask(flight.gcs, 400, 1)
    assert "Armed by external command\t" in flight.companion.texts()


def test_long_texts_come_in_chunks_of_50_characters_with_one_id(flight):
    flight.run(2.0)
    flight.ask(flight.gcs, 400, 1)
    chunks = flight.gcs.of("STATUSTEXT")
    assert [len(m.text) for m in chunks] == [50, 2]
    assert chunks[0].id == chunks[1].id != 0
    assert [m.chunk_seq for m in chunks] == [0, 1]


def test_nan_fields_are_nan_as_in_px4(airborne):
    airborne.run(1.1)
    assert math.isnan(airborne.companion.last("VFR_HUD").airspeed)
    assert math.isnan(airborne.companion.last("ESTIMATOR_STATUS").tas_ratio)
    assert math.isnan(airborne.companion.last("ODOMETRY").pose_covariance[1])


def test_timesync_requests_are_answered_with_its_own_clock(flight):
    flight.run(3.0)
    flight.companion.send(mavlink.MAVLink_timesync_message(0, 123_456_789))
    flight.run(0.1)
    answer = next(m for m in flight.companion.of("TIMESYNC") if m.ts1 == 123_456_789)
    assert answer.tc1 == pytest.approx(3.0e9, abs=5e7)


def test_a_ping_is_answered_to_its_sender(flight):
    flight.run(3.0)
    flight.gcs.send(mavlink.MAVLink_ping_message(77, 5, 0, 0))
    flight.run(0.1)
    answer = next(m for m in flight.gcs.of("PING") if m.target_system == 255)
    assert (answer.time_usec, answer.seq, answer.target_component) == (77, 5, 190)


def test_there_is_no_wind_message_until_drag_fusion_is_on(airborne):
    airborne.vehicle.conditions.wind_mps = 5.0
    airborne.vehicle.conditions.wind_from_deg = 270.0
    airborne.run(3.0)
    assert not airborne.companion.of("WIND_COV")
    airborne.vehicle.set_parameter("EKF2_DRAG_CTRL", 1)
    start_s = airborne.now_s
    airborne.run(2.0)
    early = airborne.companion.last("WIND_COV")
    assert early.wind_y / 5.0 == pytest.approx(4.9 / 7.0, abs=0.05)
    airborne.run(31.0)
    wind = airborne.companion.last("WIND_COV")
    assert wind.wind_y == pytest.approx(5.0, abs=0.3)  # it goes to the east
    assert wind.wind_x == pytest.approx(0.0, abs=0.2)
    assert wind.horiz_accuracy == 0.0
    assert len(airborne.companion.of("WIND_COV", since=start_s)) == pytest.approx(330, rel=0.03)
    airborne.vehicle.conditions.wind_mps = 0.0
    airborne.run(11.0)
    after = airborne.companion.last("WIND_COV")
    assert after.wind_y == pytest.approx(3.0, abs=0.6)
    assert after.wind_y / wind.wind_y == pytest.approx(3.9 / 7.4, abs=0.04)


@pytest.mark.parametrize(("wind_mps", "tilt_deg"), [(0, 0.0), (5, 7.0), (15, 24.4), (25, 37.2)])
def test_the_tilt_in_wind_is_that_of_px4s_simulation(airborne, wind_mps, tilt_deg):
    airborne.vehicle.conditions.wind_mps = float(wind_mps)
    airborne.run(15.0)
    tilts = []
    for _ in range(20):
        airborne.run(0.25)
        roll, pitch, _ = airborne.truth.attitude_rad
        tilts.append(math.degrees(math.acos(math.cos(roll) * math.cos(pitch))))
    assert sum(tilts) / len(tilts) == pytest.approx(tilt_deg, abs=2.0)
    assert math.dist(airborne.truth.position_ned_m, (0.0, 0.0, -10.0)) < 2.0


def test_an_integer_parameter_travels_bytewise(flight):
    flight.run(5.0)
    flight.gcs.send(mavlink.MAVLink_param_request_read_message(1, 1, b"COM_OBL_RC_ACT", -1))
    flight.run(0.1)
    value = flight.gcs.last("PARAM_VALUE")
    assert (value.param_id, value.param_type) == ("COM_OBL_RC_ACT", 6)
    bits = struct.unpack("<f", struct.pack("<i", 5))[0]
    flight.gcs.send(mavlink.MAVLink_param_set_message(1, 1, b"COM_OBL_RC_ACT", bits, 6))
    flight.run(0.1)
    assert flight.vehicle.parameter("COM_OBL_RC_ACT") == 5
    back = flight.gcs.last("PARAM_VALUE").param_value
    assert struct.unpack("<i", struct.pack("<f", back))[0] == 5


def test_a_refused_set_is_answered_with_the_old_value(flight):
    flight.run(5.0)
    flight.gcs.send(mavlink.MAVLink_param_set_message(1, 1, b"COM_OF_LOSS_T", 1000.0, 9))
    flight.run(0.1)
    assert flight.gcs.last("PARAM_VALUE").param_value == 1.0
    flight.gcs.send(mavlink.MAVLink_param_set_message(1, 1, b"COM_OBL_RC_ACT", 3.0, 9))
    flight.run(0.1)
    assert flight.vehicle.parameter("COM_OBL_RC_ACT") == 0


def test_the_whole_list_arrives_paced_with_indices_and_count(flight):
    flight.run(5.0)
    start_s = flight.now_s
    flight.gcs.send(mavlink.MAVLink_param_request_list_message(1, 1))
    flight.run(3.0)
    values = flight.gcs.of("PARAM_VALUE", since=start_s + 1e-9)
    assert [m.param_index for m in values] == list(range(values[0].param_count))
    names = [m.param_id for m in values]
    assert names == sorted(names)
    assert {"COM_OF_LOSS_T", "COM_OBL_RC_ACT", "EKF2_DRAG_CTRL", "SIM_WIND_SPD"} <= set(names)
    assert not flight.companion.of("PARAM_VALUE")


def test_a_ground_station_changes_the_world_through_sim_parameters(airborne):
    for name, value, kind in (
        (b"SIM_WIND_SPD", 6.0, 9),
        (b"SIM_WIND_DIR", 180.0, 9),
        (b"SIM_BATT_PCT", 42.0, 9),
        (b"SIM_LINK_RSSI", 120.0, 9),
        (b"SIM_GPS_SATS", struct.unpack("<f", struct.pack("<i", 7))[0], 6),
    ):
        airborne.gcs.send(mavlink.MAVLink_param_set_message(1, 1, name, value, kind))
    airborne.run(2.5)
    assert airborne.truth.wind_ned_mps[0] == pytest.approx(6.0, abs=0.01)
    assert airborne.truth.battery_fraction == pytest.approx(0.42, abs=0.01)
    assert airborne.companion.last("GPS_RAW_INT").satellites_visible == 7
    radio = airborne.companion.last("RADIO_STATUS")
    assert (radio.rssi, radio.get_srcSystem(), radio.get_srcComponent()) == (120, 51, 68)


def test_there_is_no_radio_status_on_an_ip_link(flight):
    flight.run(6.0)
    assert not flight.companion.of("RADIO_STATUS")


def test_rc_channels_come_only_with_rc_and_stop_on_its_loss(flight):
    flight.run(5.0)
    assert not flight.companion.of("RC_CHANNELS")
    flight.vehicle.move_sticks(throttle=0.2)
    flight.run(2.0)
    channels = flight.companion.last("RC_CHANNELS")
    assert (channels.chancount, channels.chan3_raw, channels.chan9_raw) == (8, 1600, 65535)
    flight.vehicle.no_sticks()
    start_s = flight.now_s
    flight.run(2.0)
    assert len(flight.companion.of("RC_CHANNELS", since=start_s + 0.1)) == 0


def test_the_first_stick_input_on_the_ground_chooses_position_mode(flight):
    flight.run(6.0)
    flight.gcs.send(mavlink.MAVLink_manual_control_message(1, 0, 0, 500, 0, 0))
    flight.run(0.3)
    assert flight.truth.mode == "POSCTL"
    assert flight.heartbeat().system_status == 0  # the sticks are gone again


def test_home_is_the_place_of_arming_and_the_origin_the_place_of_booting(airborne):
    airborne.run(2.5)
    home = airborne.companion.last("HOME_POSITION")
    assert home.latitude == pytest.approx(473977420, abs=60)
    assert airborne.ask(airborne.companion, 512, 49) == [0]
    origin = airborne.companion.last("GPS_GLOBAL_ORIGIN")
    assert origin.longitude == pytest.approx(85455940, abs=60)
    assert airborne.ask(airborne.gcs, 410) == [0]


@pytest.mark.parametrize(("rate", "attitude_hz", "battery_s"), [(5760, 22, 9), (2880, 11, 18)])
def test_a_slow_link_lowers_all_rates_but_those_of_heartbeat_and_gps(
    flight, rate, attitude_hz, battery_s
):
    """The recorded autopilot sent BATTERY_STATUS every 12 and 25 s there, ATTITUDE at 10 Hz."""
    flight.run(5.0)
    flight.vehicle.conditions.link_rate_bytes_per_s = rate
    flight.run(20.0)
    before, start_s = flight.companion.raw_bytes, flight.now_s
    rates = _rates(flight, flight.companion, 40.0)
    beats = flight.companion.of("HEARTBEAT", since=start_s + 1e-9)
    assert sum(m.get_srcComponent() == 1 for m in beats) == pytest.approx(40, abs=1)
    assert rates["GPS_RAW_INT"] == pytest.approx(8.0, rel=0.1)
    assert rates["ATTITUDE"] == pytest.approx(attitude_hz, rel=0.15)
    assert 1.0 / rates["BATTERY_STATUS"] == pytest.approx(battery_s, rel=0.3)
    assert (flight.companion.raw_bytes - before) / (flight.now_s - start_s) < 1.15 * rate
    assert flight.count(flight.gcs, start_s)["ATTITUDE"] > 40.0 * 45.0


def test_at_rest_the_estimator_reports_a_constant_position(flight):
    flight.run(6.0)
    assert flight.companion.last("ESTIMATOR_STATUS").flags == 0x3FF
    flight.ask(flight.companion, 400, 1)
    flight.run(1.5)
    assert flight.companion.last("ESTIMATOR_STATUS").flags == 0x37F


@pytest.mark.parametrize("name", ["COM_RCL_EXCEPT", "COM_DLL_EXCEPT"])
def test_the_exceptions_of_the_failsafes_are_integers_and_0(flight, name):
    assert flight.vehicle.parameter(name) == 0
    flight.run(1.0)
    flight.companion.send(mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), -1))
    flight.run(0.3)
    assert flight.companion.last("PARAM_VALUE").param_type == mavlink.MAV_PARAM_TYPE_INT32

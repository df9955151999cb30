"""Failsafes of battery, GPS, ground station and remote control; wind: ArduCopter 4.6.3."""

import math

import pytest
from pymavlink.dialects.v20 import all as mavlink

from sitl.ardupilot.failsafe import (
    TERMINATE,
    on_battery,
    on_dead_reckoning,
    on_estimator,
    on_ground_station,
    on_radio,
)
from sitl.ardupilot.fence import Fence
from sitl.ardupilot.modes import Mode
from sitl.ardupilot.parameters import parameters
from sitl.conditions import GPS_JAMMED, GPS_NO_FIX, GPS_NORMAL, GPS_SILENT

GUIDED, RTL, LAND, LOITER = 4, 6, 9, 5
ACCEPTED, FAILED = 0, 4
LOW_V, CRITICAL_V = 10.5, 10.1
BATTERY = {
    "BATT_LOW_TIMER": 5,
    "BATT_FS_LOW_ACT": 2,
    "BATT_FS_CRT_ACT": 1,
    "BATT_CRT_VOLT": CRITICAL_V,
}
DRAG = {"EK3_DRAG_BCOEF_X": 18.0, "EK3_DRAG_BCOEF_Y": 18.0, "EK3_DRAG_MCOEF": 0.2}


def _hovering(make_ardupilot, **parameters):
    flight = make_ardupilot(parameters=parameters)
    flight.take_off()
    return flight


def _drop_to(flight, volts):
    flight.vehicle.conditions.battery_voltage_v = volts


def _until_mode(flight, mode, seconds):
    start_s = flight.now_s
    assert flight.run(seconds, until=lambda f: f.truth.mode == mode)
    return flight.now_s - start_s


@pytest.mark.parametrize(
    ("title", "chosen", "mode"),
    [
        ("radio: return", on_radio(1, 0, Mode.GUIDED), Mode.RTL),
        ("radio: land", on_radio(3, 0, Mode.GUIDED), Mode.LAND),
        ("radio, but GUIDED goes on", on_radio(1, 4, Mode.GUIDED), None),
        ("radio, but LAND goes on", on_radio(1, 8, Mode.LAND), None),
        ("radio: brake", on_radio(7, 0, Mode.GUIDED), Mode.BRAKE),
        ("ground station: brake", on_ground_station(7, 0, Mode.GUIDED), Mode.BRAKE),
        ("battery: brake", on_battery(7, 0, Mode.GUIDED), Mode.BRAKE),
        ("dead reckoning: return", on_dead_reckoning(2, Mode.GUIDED), Mode.RTL),
        ("dead reckoning: nothing", on_dead_reckoning(0, Mode.GUIDED), None),
        ("ground station: return", on_ground_station(1, 16, Mode.GUIDED), Mode.RTL),
        ("ground station, but a pilot flies", on_ground_station(1, 16, Mode.LOITER), None),
        ("battery: nothing", on_battery(0, 0, Mode.GUIDED), None),
        ("battery: land", on_battery(1, 0, Mode.GUIDED), Mode.LAND),
        ("battery: terminate", on_battery(5, 0, Mode.GUIDED), TERMINATE),
        ("battery, but LAND goes on", on_battery(5, 8, Mode.LAND), None),
        ("dead reckoning: terminate", on_dead_reckoning(5, Mode.GUIDED), TERMINATE),
        ("dead reckoning: a mode without position", on_dead_reckoning(5, Mode.STABILIZE), None),
        ("estimator: land", on_estimator(1, Mode.GUIDED), Mode.LAND),
        ("estimator: any other value lands", on_estimator(0, Mode.GUIDED), Mode.LAND),
        ("estimator: hold the height", on_estimator(2, Mode.GUIDED), Mode.ALT_HOLD),
        ("estimator: a mode without position goes on", on_estimator(1, Mode.STABILIZE), None),
        ("estimator: land from any mode", on_estimator(3, Mode.STABILIZE), Mode.LAND),
    ],
)
def test_each_failsafe_chooses_its_mode(title, chosen, mode):
    assert chosen is mode, title


# Battery


def test_a_low_battery_returns_5_2_seconds_after_the_threshold(make_ardupilot):
    flight = _hovering(make_ardupilot, **BATTERY)
    _drop_to(flight, 10.4)
    assert _until_mode(flight, "RTL", 8.0) == pytest.approx(5.2, abs=0.2)
    flight.run(0.2)
    texts = flight.companion.texts()
    assert any(text.startswith("Battery 1 is low 10.40V") for text in texts)
    assert "Battery Failsafe" in texts
    assert flight.heartbeat().system_status == 5
    assert flight.vehicle.manner.battery_charge_state == 2


def test_a_critical_battery_lands_and_guided_can_be_entered_again(make_ardupilot):
    flight = _hovering(make_ardupilot, **BATTERY)
    _drop_to(flight, 10.4)
    _until_mode(flight, "RTL", 8.0)
    assert flight.mode(flight.companion, GUIDED) == [ACCEPTED]
    _drop_to(flight, 10.0)
    assert _until_mode(flight, "LAND", 8.0) == pytest.approx(5.2, abs=0.2)
    assert flight.mode(flight.companion, GUIDED) == [ACCEPTED]
    flight.run(5.0)
    assert flight.truth.mode == "GUIDED"
    assert flight.heartbeat().system_status == 5


def test_a_failsafes_landing_waits_four_seconds_before_the_descent(make_ardupilot):
    flight = _hovering(make_ardupilot, **BATTERY | {"BATT_LOW_TIMER": 1})
    _drop_to(flight, 10.0)
    _until_mode(flight, "LAND", 4.0)
    height_m = -flight.truth.position_ned_m[2]
    flight.run(3.8)
    assert -flight.truth.position_ned_m[2] == pytest.approx(height_m, abs=0.3)
    flight.run(4.0)
    assert -flight.truth.position_ned_m[2] < height_m - 1.0


def test_a_dip_shorter_than_the_timer_is_ignored_but_a_failsafe_stays_until_its_reset(
    make_ardupilot,
):
    flight = _hovering(make_ardupilot, **BATTERY)
    _drop_to(flight, 10.4)
    flight.run(4.0)
    _drop_to(flight, 12.0)
    flight.run(8.0)
    assert flight.vehicle.manner.battery_charge_state == 1
    _drop_to(flight, 10.4)
    flight.run(6.0)
    _drop_to(flight, 12.5)
    flight.mode(flight.gcs, LAND)
    assert flight.run(60.0, until=lambda f: not f.truth.armed)
    assert flight.vehicle.manner.battery_charge_state == 2
    flight.mode(flight.gcs, GUIDED)
    assert flight.ask(flight.gcs, 400, 1) == [FAILED]
    assert "Arm: Battery failsafe" in flight.gcs.texts()
    _drop_to(flight, 10.4)
    flight.run(0.1)
    refused_s = flight.now_s
    assert flight.ask(flight.gcs, 400, 1) == [FAILED]
    assert flight.gcs.texts(since=refused_s + 1e-9) == [
        "Arm: Battery 1 low voltage failsafe",
        "Arm: Battery failsafe",
    ]
    _drop_to(flight, 12.5)
    assert flight.ask(flight.gcs, 42651, 1, 100) == [ACCEPTED]
    assert flight.ask(flight.gcs, 400, 1) == [ACCEPTED]


def test_by_default_a_low_battery_is_reported_without_an_action(hovering):
    _drop_to(hovering, 10.4)
    hovering.run(12.0)
    assert hovering.truth.mode == "GUIDED"
    assert any(text.startswith("Battery 1 is low") for text in hovering.companion.texts())
    assert "Battery Failsafe" in hovering.companion.texts()
    assert hovering.heartbeat().system_status == mavlink.MAV_STATE_CRITICAL
    assert hovering.vehicle.manner.battery_charge_state == 2


def test_the_remaining_charge_is_counted_and_does_not_depend_on_the_voltage(hovering):
    _drop_to(hovering, 10.0)
    hovering.run(2.0)
    used_mah = hovering.vehicle.manner.battery_consumed_mah
    assert 0 < used_mah < 400
    assert _remaining(hovering) == pytest.approx(100 - used_mah / 33.0, abs=1)
    assert hovering.companion.last("BATTERY_STATUS").voltages[0] < 10_100
    assert hovering.vehicle.manner.battery_charge_state == 1


def _remaining(flight):
    flight.companion.command(512, 147)
    flight.run(0.1)
    return flight.companion.last("BATTERY_STATUS").battery_remaining


def test_a_replaced_charge_is_measured_by_the_monitor(hovering):
    hovering.vehicle.conditions.battery_percent = 40.0
    hovering.run(0.2)
    assert _remaining(hovering) == pytest.approx(39, abs=1)


def test_a_battery_that_drains_faster_gives_that_current(hovering):
    before = _remaining(hovering)
    usual_ca = hovering.companion.last("BATTERY_STATUS").current_battery
    hovering.vehicle.conditions.drain_factor = 8.0
    hovering.run(10.0)
    after = _remaining(hovering)
    assert hovering.companion.last("BATTERY_STATUS").current_battery == pytest.approx(
        8 * usual_ca, rel=0.1
    )
    assert before - after == pytest.approx(8 * 10.0 * usual_ca / 100 / 3.6 / 33.0, abs=3)


def test_without_a_monitor_nothing_is_judged_nor_sent(make_ardupilot):
    flight = _hovering(make_ardupilot, BATT_MONITOR=0, **BATTERY)
    assert flight.ask(flight.companion, 511, 147, 500_000) == [ACCEPTED]
    _drop_to(flight, 10.0)
    flight.run(8.0)
    assert not flight.companion.of("BATTERY_STATUS")
    assert flight.truth.mode == "GUIDED"
    assert flight.vehicle.manner.battery_charge_state == 1


# GPS


@pytest.mark.parametrize("gps_mode", [GPS_NO_FIX, GPS_SILENT])
def test_without_gps_ardupilot_lands_after_eight_seconds(hovering, gps_mode):
    manner = hovering.vehicle.manner
    hovering.vehicle.conditions.gps_mode = gps_mode
    start_s = hovering.now_s
    hovering.run(7.0)
    assert (manner.ekf_flags, hovering.truth.mode) == (0x33F, "GUIDED")
    _until_mode(hovering, "LAND", 3.0)
    assert hovering.now_s - start_s == pytest.approx(8.0, abs=0.3)
    assert manner.ekf_flags == 0x25
    assert manner.position_known
    hovering.run(0.2)
    assert "EKF variance" in hovering.companion.texts()
    assert "EKF Failsafe: changed to LAND Mode" in hovering.companion.texts()
    assert hovering.heartbeat().system_status == 5


def test_with_drag_fusion_dead_reckoning_acts_before_the_estimator_does(make_ardupilot):
    flight = _hovering(make_ardupilot, EK3_DRAG_MCOEF=0.2, FS_DR_TIMEOUT=5)
    flight.vehicle.conditions.gps_mode = GPS_NO_FIX
    assert _until_mode(flight, "RTL", 11.0) == pytest.approx(10.0, abs=0.2)
    began_s = flight.now_s
    flight.run(0.2)
    assert "Dead Reckoning started" in flight.companion.texts()
    assert flight.heartbeat().system_status == 5
    assert flight.vehicle.manner.ekf_flags == 0x12F
    _until_mode(flight, "LAND", 8.0)
    assert flight.now_s - began_s == pytest.approx(5.0, abs=0.2)


@pytest.mark.parametrize(
    ("parameters", "conditions", "text"),
    [
        (
            {"EK3_DRAG_MCOEF": 0.2, "FS_DR_ENABLE": 5},
            {"gps_mode": GPS_NO_FIX},
            "Dead Reckoning started",
        ),
        (
            {"BATT_FS_LOW_ACT": 5, "BATT_LOW_TIMER": 5},
            {"battery_voltage_v": LOW_V - 0.3},
            "Battery Failsafe",
        ),
    ],
)
def test_a_terminating_failsafe_stops_the_motors_in_the_air(
    make_ardupilot, parameters, conditions, text
):
    """ArduPilot executes 5 of FS_DR_ENABLE, too, which its list of values lacks."""
    flight = _hovering(make_ardupilot, **parameters)
    height_m = -flight.truth.position_ned_m[2]
    for name, value in conditions.items():
        setattr(flight.vehicle.conditions, name, value)
    assert flight.run(12.0, until=lambda f: not f.truth.armed)
    assert flight.truth.mode == "GUIDED"
    assert -flight.truth.position_ned_m[2] > height_m - 1.0
    flight.run(0.2)
    assert {text, "Disarming motors"} <= set(flight.companion.texts())


def test_after_fifteen_seconds_without_gps_the_position_is_lost_and_frozen(hovering):
    manner = hovering.vehicle.manner
    hovering.vehicle.conditions.gps_mode = GPS_NO_FIX
    start_s = hovering.now_s
    assert hovering.run(20.0, until=lambda _: not manner.position_known)
    assert hovering.now_s - start_s == pytest.approx(15.1, abs=0.4)
    assert manner.ekf_flags == 0xA7
    last = manner.position_ned_m[:2]
    hovering.run(3.0)
    assert manner.position_ned_m[:2] == last
    assert hovering.run(40.0, until=lambda f: not f.truth.armed)


def test_when_gps_is_back_the_failsafe_clears_and_guided_works_again(hovering):
    hovering.vehicle.conditions.gps_mode = GPS_NO_FIX
    _until_mode(hovering, "LAND", 10.0)
    assert hovering.mode(hovering.companion, GUIDED) == [FAILED]
    assert "Mode change to GUIDED failed: requires position" in hovering.companion.texts()
    hovering.vehicle.conditions.gps_mode = GPS_NORMAL
    hovering.run(4.0)
    assert "EKF Failsafe Cleared" in hovering.companion.texts()
    assert hovering.truth.mode == "LAND"
    assert hovering.mode(hovering.companion, GUIDED) == [ACCEPTED]


def test_four_satellites_and_a_bad_dilution_cause_no_failsafe(hovering):
    hovering.vehicle.conditions.satellites = 4
    hovering.vehicle.conditions.hdop = 20.0
    hovering.run(10.0)
    assert hovering.truth.mode == "GUIDED"
    assert hovering.vehicle.manner.ekf_flags == 0x33F


def test_jamming_causes_a_landing_after_six_seconds_and_the_position_drifts(hovering):
    hovering.vehicle.conditions.gps_mode = GPS_JAMMED
    assert _until_mode(hovering, "LAND", 8.0) == pytest.approx(6.0, abs=0.3)
    hovering.run(18.0)
    manner = hovering.vehicle.manner
    assert manner.ekf_flags == 0x8027
    assert manner.position_known
    away_m = math.dist(manner.position_ned_m[:2], hovering.truth.position_ned_m[:2])
    assert away_m > 50.0


# Ground station and remote control


def test_by_default_a_silent_ground_station_causes_no_failsafe(hovering):
    hovering.ground_station_alive = False
    hovering.run(12.0)
    assert hovering.truth.mode == "GUIDED"


def test_the_ground_stations_failsafe_is_not_fooled_by_the_companions_heartbeats(make_ardupilot):
    flight = _hovering(make_ardupilot, FS_GCS_ENABLE=5)
    flight.ground_station_alive = False
    assert _until_mode(flight, "LAND", 8.0) == pytest.approx(5.0, abs=1.1)
    assert flight.companion_alive
    assert "GCS Failsafe" in flight.companion.texts()
    assert flight.heartbeat().system_status == 5
    assert flight.mode(flight.companion, GUIDED) == [ACCEPTED]
    flight.run(6.0)
    assert flight.truth.mode == "GUIDED"
    flight.ground_station_alive = True
    flight.run(2.0)
    assert "GCS Failsafe Cleared" in flight.companion.texts()
    assert flight.heartbeat().system_status == 4


def test_a_companion_of_type_gcs_defeats_the_failsafe_only_by_its_id(
    make_ardupilot,
):
    flight = _hovering(make_ardupilot, FS_GCS_ENABLE=5)
    flight.ground_station_alive = False
    flight.companion_alive = False
    flight.stream = lambda f: f.companion.heartbeat(mavlink.MAV_TYPE_GCS)
    _until_mode(flight, "LAND", 8.0)


def test_a_lost_remote_control_returns_after_a_second_and_clears_by_itself(hovering):
    hovering.vehicle.no_sticks()
    assert _until_mode(hovering, "RTL", 3.0) == pytest.approx(1.0, abs=0.1)
    hovering.run(0.2)
    assert "Radio Failsafe" in hovering.companion.texts()
    assert hovering.heartbeat().system_status == 5
    assert hovering.mode(hovering.companion, GUIDED) == [ACCEPTED]
    hovering.vehicle.move_sticks()
    hovering.run(0.2)
    assert "Radio Failsafe Cleared" in hovering.companion.texts()
    assert hovering.truth.mode == "GUIDED"


def test_sim_rc_fail_from_the_ground_station_stops_the_remote_control(hovering):
    hovering.gcs.send(mavlink.MAVLink_param_set_message(1, 1, b"SIM_RC_FAIL", 1.0, 9))
    _until_mode(hovering, "RTL", 3.0)
    hovering.gcs.send(mavlink.MAVLink_param_set_message(1, 1, b"SIM_RC_FAIL", 0.0, 9))
    hovering.run(0.5)
    assert hovering.heartbeat().system_status == 4


def test_a_lost_remote_control_forbids_arming(ardupilot):
    ardupilot.ready()
    ardupilot.vehicle.no_sticks()
    ardupilot.run(2.0)
    assert ardupilot.ask(ardupilot.gcs, 400, 1) == [FAILED]
    assert "Arm: Radio failsafe on" in ardupilot.gcs.texts()


# Wind


@pytest.mark.parametrize(("wind_mps", "tilt_deg"), [(0.0, 0.3), (4.9, 11.6), (6.0, 15.3)])
def test_ardupilot_leans_against_the_wind_as_the_real_one_does(hovering, wind_mps, tilt_deg):
    hovering.stream = lambda f: f.companion.setpoint(0.0, 0.0, -10.0)
    hovering.vehicle.conditions.wind_mps = wind_mps
    hovering.run(15.0)
    tilts = hovering.watch(5.0, lambda f: f.tilt_deg)
    assert sum(tilts) / len(tilts) == pytest.approx(tilt_deg, abs=0.6)
    assert math.dist(hovering.local_m, (0.0, 0.0, -10.0)) < 0.3


def test_in_a_crosswind_of_4_9_metres_a_second_ardupilot_strays_seven_centimetres(hovering):
    hovering.vehicle.conditions.wind_mps = 4.9
    hovering.vehicle.conditions.wind_from_deg = 270.0
    hovering.stream = lambda f: f.companion.setpoint(0.0, 0.0, -10.0)
    hovering.run(15.0)
    hovering.along(0.7)
    start_s = hovering.now_s
    errors = hovering.watch(
        15.0, lambda f: math.dist(f.local_m, (0.7 * (f.now_s - start_s), 0.0, -10.0))
    )
    assert sum(errors) / len(errors) == pytest.approx(0.07, abs=0.01)
    assert max(errors) == pytest.approx(0.41, abs=0.04)


def test_at_12_metres_a_second_ardupilot_is_blown_away_at_its_tilt_limit(hovering):
    hovering.stream = lambda f: f.companion.setpoint(0.0, 0.0, -10.0)
    hovering.vehicle.conditions.wind_mps = 12.0
    start_s = hovering.now_s
    hovering.run(15.0)
    assert hovering.tilt_deg == pytest.approx(30.0, abs=0.5)
    speed_mps = math.hypot(*hovering.truth.velocity_ned_mps[:2])
    assert speed_mps == pytest.approx(2.0, abs=0.3)
    assert hovering.truth.mode == "GUIDED"
    assert not hovering.companion.texts(since=start_s + 1e-9)


def test_without_drag_fusion_any_wind_is_unknown(hovering):
    hovering.vehicle.conditions.wind_mps = 6.0
    hovering.run(20.0)
    assert hovering.vehicle.manner.wind_from is None


def test_with_drag_fusion_the_wind_is_estimated_after_twenty_seconds(make_ardupilot):
    flight = _hovering(make_ardupilot, **DRAG)
    flight.vehicle.conditions.wind_mps = 6.0
    flight.vehicle.conditions.wind_from_deg = 270.0
    flight.run(1.0)
    assert flight.vehicle.manner.wind_from[0] < 3.0
    flight.run(19.0)
    speed_mps, from_deg = flight.vehicle.manner.wind_from
    assert speed_mps == pytest.approx(6.0, abs=0.4)
    assert from_deg == pytest.approx(-90.0, abs=5.0)


def test_with_the_tilt_at_its_limit_the_wind_estimate_comes_late(make_ardupilot):
    flight = _hovering(make_ardupilot, **DRAG)
    flight.stream = lambda f: f.companion.setpoint(0.0, 0.0, -10.0)
    flight.vehicle.conditions.wind_mps = 12.0
    flight.run(15.0)
    assert flight.vehicle.manner.wind_from[0] < 7.0
    flight.run(20.0)
    assert flight.vehicle.manner.wind_from[0] == pytest.approx(12.0, abs=1.0)


def test_in_calm_an_estimated_wind_is_not_reported_as_unknown(make_ardupilot):
    flight = _hovering(make_ardupilot, **DRAG)
    flight.run(15.0)
    speed_mps, from_deg = flight.vehicle.manner.wind_from
    assert speed_mps == pytest.approx(0.13, abs=0.05)
    assert from_deg == pytest.approx(130.0, abs=15.0)


# Fence

FENCE = {"FENCE_ENABLE": 1}
NOTICE = 5


@pytest.mark.parametrize(
    ("action", "mode"), [(1, "RTL"), (2, "LAND"), (3, "SMART_RTL"), (4, "BRAKE")]
)
def test_a_breach_causes_the_action_and_a_text_and_leaves_the_status_unchanged(
    make_ardupilot, action, mode
):
    flight = _hovering(make_ardupilot, **FENCE, FENCE_ACTION=action)
    flight.vehicle.set_parameter("FENCE_ALT_MAX", 8.0)
    assert _until_mode(flight, mode, 1.0) < 0.4
    assert flight.heartbeat().system_status == 4
    reported = [(m.severity, m.text) for m in flight.gcs.of("STATUSTEXT")]
    assert reported.count((NOTICE, "Max Alt fence breached")) == 1
    assert flight.mode(flight.companion, GUIDED) == [ACCEPTED]
    flight.run(2.0)
    assert flight.truth.mode == "GUIDED"
    flight.vehicle.set_parameter("FENCE_ALT_MAX", 100.0)
    flight.run(0.5)
    assert flight.gcs.texts()[-1] == "Fence breach cleared"


def test_a_breach_without_an_action_is_reported_and_shows_in_the_sensors_health(make_ardupilot):
    flight = _hovering(make_ardupilot, **FENCE, FENCE_ACTION=0)
    flight.vehicle.set_parameter("FENCE_ALT_MAX", 8.0)
    flight.run(1.0)
    assert flight.truth.mode == "GUIDED"
    assert "Max Alt fence breached" in flight.gcs.texts()
    flight.companion.command(512, 1)
    flight.run(0.2)
    status = flight.companion.last("SYS_STATUS")
    assert status.onboard_control_sensors_enabled & 0x100000
    assert not status.onboard_control_sensors_health & 0x100000


def test_a_disabled_fence_and_a_deselected_one_have_no_effect(make_ardupilot):
    flight = _hovering(make_ardupilot, FENCE_ENABLE=0, FENCE_ALT_MAX=8.0)
    assert flight.truth.mode == "GUIDED"
    flight.vehicle.set_parameter("FENCE_TYPE", 2)
    flight.vehicle.set_parameter("FENCE_ENABLE", 1)
    flight.run(1.0)
    assert flight.truth.mode == "GUIDED"


def test_the_circle_is_reported_again_after_20_metres_and_lands_after_100_metres():
    fence = Fence(parameters(FENCE | {"FENCE_RADIUS": 30.0}))
    news = {m: fence.step(1.0, 5.0, float(m)) for m in (29, 30, 40, 49, 50, 60, 131)}
    modes = {at_m: reported.mode for at_m, reported in news.items() if reported is not None}
    assert modes == {30: Mode.RTL, 50: Mode.RTL, 131: Mode.LAND}
    assert news[30].text == "Circle fence breached"
    assert fence.step(1.0, 200.0, 180.0).text == "Max Alt and Circle fences breached"


def test_targets_outside_the_fence_are_rejected(make_ardupilot):
    flight = _hovering(make_ardupilot, **FENCE, FENCE_RADIUS=30.0)
    flight.hold_at(x=40.0)
    flight.run(6.0)
    assert flight.truth.position_ned_m[0] < 1.0
    flight.hold_at(x=5.0)
    flight.run(8.0)
    assert flight.truth.position_ned_m[0] == pytest.approx(5.0, abs=0.5)

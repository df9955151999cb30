"""Battery and GPS failsafes as measured on PX4 v1.17.0."""

import math

import pytest

from sitl.conditions import GPS_SILENT
from sitl.px4.failsafe import Charge, Flags, due
from sitl.px4.modes import Mode

BATTERY_BIT, GPS_BIT, PREARM = 1 << 25, 1 << 5, 1 << 28


def _drop(flight, percent):
    flight.vehicle.conditions.battery_percent = percent
    flight.run(0.3)


def test_the_battery_drains_only_while_armed_and_is_full_again_after_disarming(flight):
    flight.run(20.0)
    assert flight.truth.battery_fraction == 1.0
    flight.take_off()
    flight.run(5.0)
    assert flight.truth.battery_fraction < 1.0
    flight.ask(flight.gcs, 400, 0, 21196)
    assert flight.truth.battery_fraction == 1.0


def test_low_battery_warns_and_takes_the_battery_bit(airborne):
    _drop(airborne, 14.5)
    assert airborne.truth.mode == "OFFBOARD"
    assert "Low battery\t" in airborne.gcs.texts()
    airborne.run(2.5)
    assert airborne.companion.last("BATTERY_STATUS").charge_state == 2
    health = airborne.companion.last("SYS_STATUS").onboard_control_sensors_health
    assert not health & BATTERY_BIT


def test_critical_battery_holds_five_seconds_and_then_returns(airborne):
    _drop(airborne, 6.5)
    start_s = airborne.now_s
    assert airborne.truth.mode == "AUTO.LOITER"
    assert airborne.heartbeat().system_status == 5
    assert "Critical battery\t" in airborne.gcs.texts()
    assert "Failsafe activated: entering Hold for 5 seconds\t" in airborne.gcs.texts()
    assert airborne.run(8.0, until=lambda f: f.truth.mode == "AUTO.RTL")
    assert airborne.now_s - start_s == pytest.approx(5.0, abs=0.3)
    airborne.run(2.0)
    assert airborne.companion.last("BATTERY_STATUS").charge_state == 3


def test_emergency_battery_lands_after_the_hold(airborne):
    _drop(airborne, 4.0)
    assert airborne.truth.mode == "AUTO.LOITER"
    assert airborne.run(6.0, until=lambda f: f.truth.mode == "AUTO.LAND")
    assert airborne.heartbeat().system_status == 5
    assert "Emergency battery level\t" in airborne.gcs.texts()


def test_emergency_during_the_return_lands_at_once(airborne):
    _drop(airborne, 6.5)
    assert airborne.run(8.0, until=lambda f: f.truth.mode == "AUTO.RTL")
    _drop(airborne, 4.0)
    assert airborne.truth.mode == "AUTO.LAND"


def test_an_offboard_request_cancels_the_battery_failsafe_at_every_stage(airborne):
    _drop(airborne, 6.5)
    airborne.run(7.0)
    assert airborne.truth.mode == "AUTO.RTL"
    assert airborne.mode(airborne.companion, (6, 0)) == [0, 0]
    airborne.run(3.0)
    assert airborne.truth.mode == "OFFBOARD"
    _drop(airborne, 4.0)
    assert airborne.truth.mode == "AUTO.LOITER"
    airborne.run(6.0)
    assert airborne.truth.mode == "AUTO.LAND"
    assert airborne.mode(airborne.companion, (6, 0)) == [0, 0]
    airborne.run(8.0)
    assert airborne.truth.mode == "OFFBOARD"


def test_com_low_bat_act_zero_only_warns(airborne):
    airborne.vehicle.set_parameter("COM_LOW_BAT_ACT", 0)
    _drop(airborne, 3.0)
    airborne.run(8.0)
    assert airborne.truth.mode == "OFFBOARD"


def test_a_critical_battery_forbids_arming(flight):
    flight.run(6.0)
    _drop(flight, 6.0)
    assert flight.ask(flight.gcs, 400, 1) == [1]


def test_voltage_sags_under_load_and_the_sentinels_are_px4s(airborne):
    airborne.run(2.5)
    battery = airborne.companion.last("BATTERY_STATUS")
    assert 15000 < battery.voltages[0] < 16200
    assert battery.voltages[1:] == [65535] * 9
    assert (battery.current_battery, battery.energy_consumed) == (-100, -1)
    assert (battery.temperature, battery.time_remaining) == (32767, 0)
    assert battery.current_consumed < 0


def test_three_satellites_are_no_fix_and_offboard_holds_for_five_seconds(airborne):
    airborne.vehicle.conditions.satellites = 4
    airborne.run(2.0)
    assert airborne.companion.last("GPS_RAW_INT").fix_type == 3
    airborne.vehicle.conditions.satellites = 3
    start_s = airborne.now_s
    airborne.run(0.5)
    gps = airborne.companion.last("GPS_RAW_INT")
    assert (gps.fix_type, gps.satellites_visible) == (0, 3)
    assert (gps.eph, gps.epv, gps.h_acc) == (10000, 10000, 100000)
    assert airborne.run(8.0, until=lambda f: f.truth.mode == "ALTCTL")
    assert airborne.now_s - start_s == pytest.approx(5.1, abs=0.4)
    assert airborne.heartbeat().system_status == 5
    start_m = airborne.truth.position_ned_m
    airborne.run(9.0)
    assert airborne.truth.position_ned_m[2] > start_m[2] + 4.0  # it sinks
    status = airborne.companion.last("SYS_STATUS")
    bits = [
        bool(word & GPS_BIT)
        for word in (
            status.onboard_control_sensors_present,
            status.onboard_control_sensors_enabled,
            status.onboard_control_sensors_health,
        )
    ]
    assert bits == [False, False, True]  # health alone misleads
    assert airborne.companion.last("ESTIMATOR_STATUS").flags == 0x0065


@pytest.mark.parametrize(("action", "mode"), [(0, "ALTCTL"), (4, "AUTO.LAND"), (5, "AUTO.LAND")])
def test_without_gps_offboard_ends_by_com_obl_rc_act(airborne, action, mode):
    airborne.vehicle.set_parameter("COM_OBL_RC_ACT", action)
    airborne.vehicle.conditions.satellites = 3
    assert airborne.run(8.0, until=lambda f: f.truth.mode != "OFFBOARD")
    assert airborne.truth.mode == mode
    airborne.run(1.2)
    assert airborne.heartbeat().system_status == 5


def test_when_gps_recovers_offboard_resumes_by_itself_and_px4_flies_back(airborne):
    airborne.vehicle.conditions.satellites = 3
    airborne.run(9.0)
    assert airborne.truth.mode == "ALTCTL"
    resets = airborne.companion.last("ODOMETRY").reset_counter
    airborne.vehicle.conditions.satellites = 10
    start_s = airborne.now_s
    assert airborne.run(5.0, until=lambda f: f.truth.mode == "OFFBOARD")
    assert airborne.now_s - start_s == pytest.approx(2.2, abs=0.6)
    airborne.run(10.0)
    assert airborne.companion.last("ODOMETRY").reset_counter != resets
    assert math.dist(airborne.truth.position_ned_m, (0.0, 0.0, -10.0)) < 1.5


def test_the_estimators_flags_and_accuracy_degrade_in_px4s_steps(airborne):
    airborne.run(1.0)
    assert airborne.companion.last("ESTIMATOR_STATUS").flags == 0x037F
    airborne.vehicle.conditions.satellites = 0
    start_s = airborne.now_s
    airborne.run(20.0)
    flags = []
    for t, m in airborne.companion.received:
        if t > start_s and m.get_type() == "ESTIMATOR_STATUS" and m.flags not in flags:
            flags.append(m.flags)
    assert flags == [0x037F, 0x0365, 0x0065]
    accuracy_m = {
        round(t - start_s): m.pos_horiz_accuracy
        for t, m in airborne.companion.received
        if t > start_s and m.get_type() == "ESTIMATOR_STATUS"
    }
    assert accuracy_m[4] == pytest.approx(0.84, abs=0.4)
    assert accuracy_m[20] == pytest.approx(15.0, abs=3.0)


def test_a_silent_receiver_is_reported_once_a_second_with_everything_unknown(airborne):
    airborne.vehicle.conditions.gps_mode = GPS_SILENT
    airborne.run(1.5)
    start_s = airborne.now_s
    airborne.run(5.0)
    fixes = airborne.companion.of("GPS_RAW_INT", since=start_s)
    assert 4 <= len(fixes) <= 6
    gps = fixes[-1]
    assert (gps.fix_type, gps.satellites_visible, gps.time_usec) == (0, 255, 0)
    assert (gps.eph, gps.epv, gps.h_acc) == (65535, 65535, 0)


def test_losing_gps_in_hold_descends(airborne):
    airborne.mode(airborne.gcs, (4, 3))
    airborne.vehicle.conditions.satellites = 2
    airborne.run(7.0)
    heartbeat = airborne.heartbeat()
    assert (heartbeat.custom_mode, heartbeat.system_status) == (0x06040000, 5)


def test_losing_the_sticks_in_position_mode_returns(airborne):
    airborne.vehicle.move_sticks()
    airborne.run(0.2)
    assert airborne.mode(airborne.gcs, (3, 0)) == [0, 0]
    airborne.vehicle.no_sticks()
    airborne.run(8.0)
    assert airborne.truth.mode == "AUTO.RTL"


def _flags(**changes):
    healthy = {
        "mode": Mode.OFFBOARD,
        "stream_alive": True,
        "position_valid": True,
        "sticks": False,
        "charge": Charge.OK,
        "overridden_charge": Charge.OK,
        "offboard_action": 0,
        "battery_action": 3,
        "sticks_action": 2,
    }
    return Flags(**(healthy | changes))


@pytest.mark.parametrize(
    ("title", "changes", "mode"),
    [
        ("all is well", {}, None),
        ("stream lost", {"stream_alive": False}, Mode.RTL),
        ("stream lost, sticks", {"stream_alive": False, "sticks": True}, Mode.POSCTL),
        ("stream lost, hold wanted", {"stream_alive": False, "offboard_action": 5}, Mode.HOLD),
        (
            "stream lost and emergency battery: the more severe wins",
            {"stream_alive": False, "offboard_action": 5, "charge": Charge.EMERGENCY},
            Mode.LAND,
        ),
        ("critical, overridden", {"charge": 3, "overridden_charge": Charge.CRITICAL}, None),
        ("already landing", {"mode": Mode.LAND, "charge": Charge.EMERGENCY}, None),
        (
            "critical without a position descends",
            {"charge": Charge.CRITICAL, "position_valid": False},
            Mode.DESCEND,
        ),
    ],
)
def test_each_failsafe_follows_the_table(title, changes, mode):
    action = due(_flags(**changes))
    assert (action.mode if action else None) is mode, title

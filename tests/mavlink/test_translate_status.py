from __future__ import annotations

import math

import pytest

from .messages import updated


def battery(**fields):
    fields = {
        "voltages": [14400] + [65535] * 9,
        "current_battery": 2812,
        "battery_remaining": 72,
        "charge_state": 1,
        **fields,
    }
    return updated("BATTERY_STATUS", **fields).batteries[fields.get("id", 0)]


def test_a_battery_tells_charge_voltage_and_current():
    told = battery()
    assert told.remaining == pytest.approx(0.72)
    assert told.voltage_v == pytest.approx(14.4)
    assert told.current_a == pytest.approx(28.12)
    assert (told.charge_state, told.summary) == (1, False)


@pytest.mark.parametrize(
    ("fields", "name"),
    [
        ({"battery_remaining": -1}, "remaining"),
        ({"battery_remaining": 127}, "remaining"),
        ({"voltages": [65535] * 10}, "voltage_v"),
        ({"voltages": [0] + [65535] * 9}, "voltage_v"),
        ({"current_battery": -1}, "current_a"),
        ({"current_battery": -100}, "current_a"),
        ({"charge_state": 0}, "charge_state"),
    ],
)
def test_what_a_battery_does_not_know_is_none(fields, name):
    assert getattr(battery(**fields), name) is None


def test_cells_add_up_to_the_packs_voltage():
    told = battery(voltages=[3600] * 10, voltages_ext=[3600, 3600, 0, 0])
    assert told.voltage_v == pytest.approx(43.2)


def test_a_second_battery_does_not_displace_the_first():
    first = updated("BATTERY_STATUS", id=0, voltages=[12000] + [65535] * 9)
    both = updated("BATTERY_STATUS", first, id=1, voltages=[11000] + [65535] * 9)
    assert {number: b.voltage_v for number, b in both.batteries.items()} == {0: 12.0, 1: 11.0}
    assert list(first.batteries) == [0]


def sys_status(telemetry=None, now_s=10.0, **fields):
    fields = {
        "voltage_battery": 11000,
        "current_battery": 500,
        "battery_remaining": 40,
        **fields,
    }
    return updated("SYS_STATUS", telemetry, now_s, **fields)


def test_sys_status_speaks_for_a_battery_that_does_not_speak():
    told = sys_status().batteries[0]
    assert (told.voltage_v, told.current_a, told.remaining) == (11.0, 5.0, 0.4)
    assert (told.charge_state, told.summary) == (None, True)
    later = sys_status(sys_status(), now_s=10.2, voltage_battery=10900)
    assert later.batteries[0].voltage_v == pytest.approx(10.9)


def test_sys_status_is_silent_while_battery_status_is_heard():
    telemetry = updated("BATTERY_STATUS", voltages=[14400] + [65535] * 9, battery_remaining=72)
    assert sys_status(telemetry, now_s=14.9) is telemetry
    assert sys_status(telemetry, now_s=15.1).batteries[0].summary
    telemetry = updated("BATTERY_STATUS", sys_status(), voltages=[14400] + [65535] * 9)
    assert not telemetry.batteries[0].summary


def test_an_aircraft_without_a_battery_monitor_has_no_battery():
    telemetry = sys_status(voltage_battery=0, current_battery=-1, battery_remaining=-1)
    assert telemetry.batteries == {}
    assert sys_status(voltage_battery=65535).batteries[0].voltage_v is None


def gnss(**fields):
    fields = {
        "time_usec": 5_000_000,
        "fix_type": 3,
        "satellites_visible": 10,
        "eph": 70,
        "epv": 110,
        "h_acc": 900,
        "v_acc": 1780,
        **fields,
    }
    return updated("GPS_RAW_INT", **fields).gnss


def test_a_receiver_tells_dilution_and_accuracy():
    told = gnss()
    assert (told.receiver_s, told.fix_type, told.satellites) == (5.0, 3, 10)
    assert told.hdop == pytest.approx(0.7)
    assert told.vdop == pytest.approx(1.1)
    assert told.horizontal_accuracy_m == pytest.approx(0.9)
    assert told.vertical_accuracy_m == pytest.approx(1.78)


@pytest.mark.parametrize(
    ("fields", "name"),
    [
        ({"satellites_visible": 255}, "satellites"),
        ({"eph": 65535}, "hdop"),
        ({"eph": 9999}, "hdop"),
        ({"eph": 10000}, "hdop"),
        ({"eph": 0}, "hdop"),
        ({"epv": 65535}, "vdop"),
        ({"epv": 9999}, "vdop"),
        ({"h_acc": 0}, "horizontal_accuracy_m"),
        ({"v_acc": 4294967295}, "vertical_accuracy_m"),
        ({"time_usec": 0}, "receiver_s"),
    ],
)
def test_what_a_receiver_does_not_know_is_none(fields, name):
    assert getattr(gnss(**fields), name) is None


@pytest.mark.parametrize(
    ("name", "flags", "good"),
    [
        ("ESTIMATOR_STATUS", 0x037F, True),
        ("ESTIMATOR_STATUS", 0x03FF, True),
        ("ESTIMATOR_STATUS", 0x0365, False),
        ("ESTIMATOR_STATUS", 0x0065, False),
        ("ESTIMATOR_STATUS", 0x077F, False),
        ("EKF_STATUS_REPORT", 0x00A7, False),
        ("EKF_STATUS_REPORT", 0x033F, True),
        ("EKF_STATUS_REPORT", 0x0025, False),
        ("EKF_STATUS_REPORT", 0x8027, False),
        ("EKF_STATUS_REPORT", 0x833F, False),
    ],
)
def test_the_estimators_flags_tell_whether_there_is_a_position(name, flags, good):
    estimator = updated(name, flags=flags).estimator
    assert estimator.horizontal_position_ok is good
    assert estimator.flags == flags


def test_only_px4_knows_its_accuracy_in_metres():
    told = updated("ESTIMATOR_STATUS", pos_horiz_accuracy=0.5).estimator
    assert told.horizontal_accuracy_m == 0.5
    told = updated("ESTIMATOR_STATUS", pos_horiz_accuracy=math.nan).estimator
    assert told.horizontal_accuracy_m is None
    told = updated("EKF_STATUS_REPORT", pos_horiz_variance=0.5).estimator
    assert told.horizontal_accuracy_m is None


def test_a_radio_tells_what_it_knows():
    radio = updated(
        "RADIO_STATUS", rssi=200, remrssi=255, noise=50, remnoise=255, rxerrors=7, txbuf=90
    ).radio
    assert (radio.rssi, radio.remote_rssi, radio.noise, radio.remote_noise) == (200, None, 50, None)
    assert (radio.receive_errors, radio.transmit_buffer_percent) == (7, 90)
    assert updated("RADIO_STATUS", txbuf=255).radio.transmit_buffer_percent is None


def test_the_pilots_signal_is_a_fraction():
    assert updated("RC_CHANNELS", rssi=127).remote_control.rssi == pytest.approx(0.5)
    assert updated("RC_CHANNELS", rssi=255).remote_control.rssi is None
    assert updated("RC_CHANNELS", rssi=0).remote_control.rssi == 0.0


def test_outputs_without_a_motor_are_left_out():
    motors = updated(
        "SERVO_OUTPUT_RAW",
        servo1_raw=1500,
        servo2_raw=1400,
        servo3_raw=900,
        servo4_raw=65535,
        servo16_raw=1600,
    ).motors
    assert motors.pulse_us == (1500, 1400, 1600)
    assert updated("SERVO_OUTPUT_RAW", port=1, servo1_raw=1500).motors is None

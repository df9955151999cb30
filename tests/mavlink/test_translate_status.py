from __future__ import annotations

import math

import pytest

from moar_companion.mavlink.dialect import mavlink
from moar_companion.mavlink.passive_listener import PassiveListener
from moar_companion.mavlink.telemetry import Telemetry

from .messages import updated

PX4, ARDUPILOT = mavlink.MAV_AUTOPILOT_PX4, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA


def received(autopilot):
    """Telemetry after a heartbeat of this autopilot."""
    return updated("HEARTBEAT", type=mavlink.MAV_TYPE_QUADROTOR, autopilot=autopilot)


def battery(**fields):
    fields = {
        "voltages": [14400] + [65535] * 9,
        "current_battery": 2812,
        "battery_remaining": 72,
        "charge_state": 1,
        **fields,
    }
    return updated("BATTERY_STATUS", **fields).batteries[fields.get("id", 0)]


def test_battery_status_gives_charge_voltage_and_current():
    reported = battery()
    assert reported.remaining == pytest.approx(0.72)
    assert reported.voltage_v == pytest.approx(14.4)
    assert reported.current_a == pytest.approx(28.12)
    assert (reported.charge_state, reported.summary) == (1, False)


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
def test_invalid_battery_fields_are_none(fields, name):
    assert getattr(battery(**fields), name) is None


def test_cells_add_up_to_the_packs_voltage():
    reported = battery(voltages=[3600] * 10, voltages_ext=[3600, 3600, 0, 0])
    assert reported.voltage_v == pytest.approx(43.2)


@pytest.mark.parametrize(
    ("voltages", "beyond", "cells"),
    [
        ([4100, 4090, 4110, 4100] + [65535] * 6, [0] * 4, 4),
        ([3600] * 10, [3600, 3600, 0, 0], 12),
        ([14400] + [65535] * 9, [0] * 4, None),  # the whole pack
        ([65534, 1200] + [65535] * 8, [0] * 4, None),  # a pack of 66.7 V
        ([65535] * 10, [0] * 4, None),
    ],
)
def test_cells_are_counted_where_each_voltage_is_reported(voltages, beyond, cells):
    assert battery(voltages=voltages, voltages_ext=beyond).cells == cells


def test_a_second_battery_does_not_displace_the_first():
    first = updated("BATTERY_STATUS", id=0, voltages=[12000] + [65535] * 9)
    both = updated("BATTERY_STATUS", first, id=1, voltages=[11000] + [65535] * 9)
    assert {number: b.voltage_v for number, b in both.batteries.items()} == {0: 12.0, 1: 11.0}
    assert list(first.batteries) == [0]


@pytest.mark.parametrize(("function", "flown_with"), [(0, 1), (1, 1), (2, 1), (3, 0), (4, 0)])
def test_batteries_of_avionics_and_payload_are_ignored(function, flown_with):
    reported = updated("BATTERY_STATUS", battery_function=function, battery_remaining=40)
    assert len(reported.batteries) == flown_with


def sys_status(telemetry=None, now_s=10.0, **fields):
    fields = {
        "voltage_battery": 11000,
        "current_battery": 500,
        "battery_remaining": 40,
        **fields,
    }
    return updated("SYS_STATUS", telemetry, now_s, **fields)


def test_sys_status_replaces_a_missing_battery_status():
    reported = sys_status().batteries[0]
    assert (reported.voltage_v, reported.current_a, reported.remaining) == (11.0, 5.0, 0.4)
    assert (reported.charge_state, reported.summary) == (None, True)
    later = sys_status(sys_status(), now_s=10.2, voltage_battery=10900)
    assert later.batteries[0].voltage_v == pytest.approx(10.9)


def test_sys_status_is_ignored_while_battery_status_is_received():
    telemetry = updated("BATTERY_STATUS", voltages=[14400] + [65535] * 9, battery_remaining=72)
    assert sys_status(telemetry, now_s=14.9).batteries == telemetry.batteries
    assert sys_status(telemetry, now_s=15.1).batteries[0].summary
    telemetry = updated("BATTERY_STATUS", sys_status(), voltages=[14400] + [65535] * 9)
    assert not telemetry.batteries[0].summary


def test_a_critical_charge_state_stays_until_battery_status_reports_another():
    reported = {"voltages": [14400] + [65535] * 9, "battery_remaining": 72}
    critical = updated("BATTERY_STATUS", charge_state=3, **reported)
    for now_s in (15.1, 15.3, 60.0):
        critical = sys_status(critical, now_s=now_s)
        assert critical.batteries[0].summary
        assert critical.batteries[0].charge_state == 3
    well = updated("BATTERY_STATUS", critical, charge_state=1, **reported)
    assert well.batteries[0].charge_state == 1


PACK = {"voltages": [16000] + [65535] * 9, "battery_remaining": 80, "charge_state": 1}


def test_px4s_sys_status_does_not_update_a_disconnected_battery():
    # SYS_STATUS reports the emptiest connected battery: without the first one, the other.
    both = updated("BATTERY_STATUS", received(PX4), **{**PACK, "battery_remaining": 15})
    both = updated("BATTERY_STATUS", both, id=1, **PACK)
    later = sys_status(both, now_s=22.0, voltage_battery=16000, battery_remaining=80)
    assert later.batteries == both.batteries


@pytest.mark.parametrize("autopilot", [PX4, mavlink.MAV_AUTOPILOT_GENERIC])
def test_the_battery_of_sys_status_is_replaced_by_that_of_battery_status(autopilot):
    summed_up = sys_status(received(autopilot))
    assert list(summed_up.batteries) == [0]
    alone = updated("BATTERY_STATUS", summed_up, id=1, **PACK)
    assert list(alone.batteries) == [1]
    assert list(sys_status(alone, now_s=60.0).batteries) == [1]


def test_a_battery_with_its_own_battery_status_is_kept_when_another_reports():
    critical = updated("BATTERY_STATUS", received(PX4), **{**PACK, "charge_state": 3})
    later = updated("BATTERY_STATUS", sys_status(critical, now_s=16.0), id=1, **PACK)
    assert later.batteries[0].charge_state == 3


def test_ardupilots_sys_status_is_always_of_battery_0():
    second = updated("BATTERY_STATUS", received(ARDUPILOT), id=1, **PACK)
    first = sys_status(second)
    assert first.batteries[0].remaining == 0.4
    assert updated("BATTERY_STATUS", first, id=1, **PACK).batteries[0].summary


def test_an_aircraft_without_a_battery_monitor_has_no_battery():
    telemetry = sys_status(voltage_battery=0, current_battery=-1, battery_remaining=-1)
    assert telemetry.batteries == {}
    assert sys_status(voltage_battery=65535).batteries[0].voltage_v is None


GNSS = {
    "time_usec": 5_000_000,
    "fix_type": 3,
    "satellites_visible": 10,
    "eph": 70,
    "epv": 110,
    "h_acc": 900,
    "v_acc": 1780,
}


def gnss(**fields):
    return updated("GPS_RAW_INT", **{**GNSS, **fields}).gnss


def test_a_receiver_gives_dilution_and_accuracy():
    reported = gnss()
    assert (reported.receiver_s, reported.fix_type, reported.satellites) == (5.0, 3, 10)
    assert reported.hdop == pytest.approx(0.7)
    assert reported.vdop == pytest.approx(1.1)
    assert reported.horizontal_accuracy_m == pytest.approx(0.9)
    assert reported.vertical_accuracy_m == pytest.approx(1.78)


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
def test_invalid_receiver_fields_are_none(fields, name):
    assert getattr(gnss(**fields), name) is None


def test_a_second_receiver_is_read_as_the_first():
    both = updated("GPS2_RAW", updated("GPS_RAW_INT", **GNSS), **{**GNSS, "satellites_visible": 7})
    assert (both.gnss.satellites, both.second_gnss.satellites) == (10, 7)
    alone = updated("GPS2_RAW", **GNSS)
    assert alone.gnss is None
    assert alone.second_gnss == gnss()


def test_px4_navigates_by_the_better_receiver_and_ardupilot_by_its_parameter():
    assert updated("GPS2_RAW", received(PX4), **GNSS).better_gnss_taken
    assert not updated("GPS2_RAW", received(ARDUPILOT), **GNSS).better_gnss_taken


@pytest.mark.parametrize(
    ("value", "better"),
    [
        pytest.param(0.0, False, id="primary"),
        pytest.param(1.0, True, id="best"),
        pytest.param(2.0, True, id="blend"),
        pytest.param(4.0, False, id="primary while it has a fix"),
        pytest.param(math.nan, False, id="not a number"),
    ],
)
def test_gps_auto_switch_decides_whether_ardupilot_takes_the_better_receiver(value, better):
    reported = updated(
        "PARAM_VALUE", received(ARDUPILOT), param_id=b"GPS_AUTO_SWITCH", param_value=value
    )
    assert reported.better_gnss_taken is better
    assert updated("GPS2_RAW", reported, **GNSS).better_gnss_taken is better


def test_gps_primary_decides_which_receiver_ardupilot_takes_first():
    second = updated("PARAM_VALUE", received(ARDUPILOT), param_id=b"GPS_PRIMARY", param_value=1.0)
    assert second.second_gnss_first
    again = updated("PARAM_VALUE", second, param_id=b"GPS_PRIMARY", param_value=0.0)
    assert not again.second_gnss_first
    assert updated("PARAM_VALUE", second, param_id=b"GPS_TYPE", param_value=0.0) is second


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
def test_the_estimators_flags_show_whether_its_position_is_valid(name, flags, good):
    estimator = updated(name, flags=flags).estimator
    assert estimator.horizontal_position_ok is good
    assert estimator.flags == flags


def test_only_px4_reports_its_accuracy_in_metres():
    reported = updated("ESTIMATOR_STATUS", pos_horiz_accuracy=0.5, pos_vert_accuracy=0.25).estimator
    assert (reported.horizontal_accuracy_m, reported.vertical_accuracy_m) == (0.5, 0.25)
    unknown = {"pos_horiz_accuracy": math.nan, "pos_vert_accuracy": math.nan}
    reported = updated("ESTIMATOR_STATUS", **unknown).estimator
    assert (reported.horizontal_accuracy_m, reported.vertical_accuracy_m) == (None, None)
    reported = updated("EKF_STATUS_REPORT", pos_horiz_variance=0.5, pos_vert_variance=0.5).estimator
    assert (reported.horizontal_accuracy_m, reported.vertical_accuracy_m) == (None, None)


INNOVATIONS = {
    "ESTIMATOR_STATUS": ("vel_ratio", "pos_horiz_ratio", "pos_vert_ratio", "mag_ratio"),
    "EKF_STATUS_REPORT": (
        "velocity_variance",
        "pos_horiz_variance",
        "pos_vert_variance",
        "compass_variance",
    ),
}


@pytest.mark.parametrize("name", INNOVATIONS)
def test_the_estimator_reports_its_innovations(name):
    given = dict(zip(INNOVATIONS[name], (0.1, 0.2, 0.3, 0.4), strict=True))
    reported = updated(name, **given).estimator
    assert (
        reported.velocity_innovation,
        reported.position_innovation,
        reported.height_innovation,
        reported.compass_innovation,
    ) == (0.1, 0.2, 0.3, 0.4)


@pytest.mark.parametrize("nothing", [0.0, math.nan, math.inf, -1.0])
@pytest.mark.parametrize("name", INNOVATIONS)
def test_a_measurement_that_the_estimator_does_not_use_has_no_innovation(name, nothing):
    reported = updated(name, **dict.fromkeys(INNOVATIONS[name], nothing)).estimator
    assert reported.velocity_innovation is None
    assert reported.position_innovation is None
    assert reported.height_innovation is None
    assert reported.compass_innovation is None


def test_the_strength_of_the_magnetic_field_is_read():
    field = {"xmag": 0.3, "ymag": 0.0, "zmag": -0.4, "fields_updated": 0x1C0}
    assert updated("HIGHRES_IMU", **field).magnetic_field.strength_gauss == pytest.approx(0.5)
    reported = updated("RAW_IMU", xmag=300, ymag=0, zmag=-400)
    assert reported.magnetic_field.strength_gauss == pytest.approx(0.5)


@pytest.mark.parametrize(
    "field",
    [
        pytest.param({"fields_updated": 0x03F}, id="repeated"),
        pytest.param({"xmag": 0.0}, id="nothing measured"),
        pytest.param({"xmag": math.nan}, id="not a number"),
        pytest.param({"xmag": math.inf}, id="infinite"),
    ],
)
def test_an_invalid_magnetic_field_is_ignored(field):
    field = {"xmag": 0.5, "fields_updated": 0x1FF, **field}
    assert updated("HIGHRES_IMU", **field).magnetic_field is None


def test_px4_reports_the_packets_received_and_lost_at_its_end_of_the_link():
    node = updated("LINK_NODE_STATUS", messages_received=900, messages_lost=3).link_node
    assert (node.packets_received, node.packets_lost) == (900, 3)


def test_a_radio_that_never_received_its_peer_has_no_remote_values():
    never = updated("RADIO_STATUS", rssi=60, noise=50)
    assert (never.radio.remote_rssi, never.radio.remote_noise) == (None, None)
    lost = updated("RADIO_STATUS", updated("RADIO_STATUS", never, rssi=90, remrssi=80, remnoise=40))
    assert (lost.radio.remote_rssi, lost.radio.remote_noise) == (0, 0)


RC = 0x10000


@pytest.mark.parametrize(
    ("bits", "ok"),
    [
        pytest.param([(0, RC, 0)], None, id="PX4 without a transmitter"),
        pytest.param([(0, 0, RC)], None, id="PX4 as it starts"),
        pytest.param([(RC, RC, 0)], None, id="ArduPilot as it starts"),
        pytest.param([(RC, RC, RC)], True, id="received"),
        pytest.param([(RC, RC, RC), (0, RC, 0)], False, id="lost, as PX4 says it"),
        pytest.param([(RC, RC, RC), (RC, RC, 0)], False, id="lost, as ArduPilot says it"),
        pytest.param([(RC, RC, RC), (RC, RC, 0), (RC, RC, RC)], True, id="received again"),
    ],
)
def test_the_state_of_the_transmitter_is_unknown_until_first_received(bits, ok):
    telemetry = None
    for present, enabled, health in bits:
        telemetry = sys_status(
            telemetry,
            onboard_control_sensors_present=present,
            onboard_control_sensors_enabled=enabled,
            onboard_control_sensors_health=health,
        )
    assert telemetry.readiness.remote_control_ok is ok


def test_invalid_radio_fields_are_none():
    radio = updated(
        "RADIO_STATUS", rssi=200, remrssi=255, noise=50, remnoise=255, rxerrors=7, txbuf=90
    ).radio
    assert (radio.rssi, radio.remote_rssi, radio.noise, radio.remote_noise) == (200, None, 50, None)
    assert (radio.receive_errors, radio.transmit_buffer_percent) == (7, 90)
    assert updated("RADIO_STATUS", txbuf=255).radio.transmit_buffer_percent is None


def test_the_older_radio_message_is_read_as_radio_status():
    fields = {"rssi": 200, "remrssi": 190, "noise": 50, "remnoise": 60, "txbuf": 90}
    assert updated("RADIO", **fields) == updated("RADIO_STATUS", **fields)


@pytest.mark.parametrize(
    ("autopilot", "rssi", "fraction"),
    [
        (mavlink.MAV_AUTOPILOT_PX4, 100, 1.0),  # full reception, as recorded
        (mavlink.MAV_AUTOPILOT_PX4, 50, 0.5),
        (mavlink.MAV_AUTOPILOT_PX4, 101, None),
        (mavlink.MAV_AUTOPILOT_PX4, 254, None),
        (mavlink.MAV_AUTOPILOT_PX4, 255, None),
        (mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 204, 0.8),
        (mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 51, 0.2),
        (mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 254, 254 / 255),
        (mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 255, None),
        (mavlink.MAV_AUTOPILOT_GENERIC, 127, 0.5),
        (mavlink.MAV_AUTOPILOT_GENERIC, 255, None),
    ],
)
def test_the_pilots_signal_is_a_fraction_of_the_autopilots_own_scale(autopilot, rssi, fraction):
    assert updated("RC_CHANNELS", received(autopilot), rssi=rssi).remote_control.rssi == fraction


@pytest.mark.uncounted
@pytest.mark.recordings
@pytest.mark.parametrize(
    ("name", "best"),
    [("px4/f1_radio_rc.companion.tlog", 1.0), ("ardupilot/f1_rssi.companion.tlog", 1.0)],
)
def test_full_reception_in_recordings_is_a_full_signal(recording, name, best):
    listener = PassiveListener()
    signals = set()
    for time_s, packet in recording(name):
        listener.handle(packet, time_s)
        remote = listener.telemetry.remote_control
        signals.add(None if remote is None else remote.rssi)
    assert max(signals - {None}) == best


def test_a_signal_of_0_is_a_loss_only_after_a_signal_was_received():
    never = updated("RC_CHANNELS", rssi=0)
    assert never.remote_control.rssi is None
    assert updated("RC_CHANNELS", never, rssi=0).remote_control.rssi is None
    lost = updated("RC_CHANNELS", updated("RC_CHANNELS", rssi=127), rssi=0)
    assert lost.remote_control.rssi == 0.0
    assert updated("RC_CHANNELS", lost, rssi=0).remote_control.rssi == 0.0
    px4 = updated("RC_CHANNELS", received(mavlink.MAV_AUTOPILOT_PX4), rssi=80)
    unknown = updated("RC_CHANNELS", px4, rssi=200)
    assert unknown.remote_control.rssi is None
    assert updated("RC_CHANNELS", unknown, rssi=0).remote_control.rssi == 0.0


@pytest.mark.parametrize(
    ("autopilot", "signal"), [(ARDUPILOT, 1.0), (PX4, None), (mavlink.MAV_AUTOPILOT_GENERIC, None)]
)
def test_a_signal_of_255_from_ardupilot_is_full_after_another_value(autopilot, signal):
    reported = received(autopilot)
    for rssi in (255, 80, 40, 255):
        reported = updated("RC_CHANNELS", reported, rssi=rssi)
    assert reported.remote_control.rssi == signal


@pytest.mark.parametrize(
    ("flight_sw_version", "shown"),
    [
        (17891583, "1.17.0"),  # PX4 v1.17.0, as recorded
        (67503103, "4.6.3"),  # ArduCopter 4.6.3, as recorded
        (0x01120080, "1.18.0-beta"),
        (0x011000C0, "1.16.0-rc"),
        (0x04070040, "4.7.0-alpha"),
        (0x04070000, "4.7.0-dev"),
    ],
)
def test_the_firmware_version_shows_its_kind_of_release(flight_sw_version, shown):
    firmware = updated("AUTOPILOT_VERSION", flight_sw_version=flight_sw_version).firmware
    assert str(firmware) == shown


def test_a_version_of_0_is_unknown():
    assert updated("AUTOPILOT_VERSION", flight_sw_version=0).firmware is None


def test_sys_status_gives_readiness_to_arm_and_unhealthy_sensors():
    prearm, gps, gyro = 1 << 28, 1 << 5, 1
    fit = sys_status(
        onboard_control_sensors_enabled=gps | gyro,
        onboard_control_sensors_health=prearm | gps | gyro,
    ).readiness
    assert (fit.ready, fit.unhealthy) == (True, ())
    unfit = sys_status(
        onboard_control_sensors_enabled=gps | gyro, onboard_control_sensors_health=gyro
    ).readiness
    assert (unfit.ready, unfit.unhealthy) == (False, ("gps",))


def test_a_mode_without_any_heartbeat_changes_nothing():
    assert updated("CURRENT_MODE", custom_mode=0x00060000) == Telemetry()


def test_a_mode_after_a_heartbeat_is_the_autopilots_mode():
    status = updated("CURRENT_MODE", received(PX4), custom_mode=0x00060000).autopilot
    assert (status.mode, status.ours) == ("OFFBOARD", True)

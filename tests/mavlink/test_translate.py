from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from moar_companion.mavlink import translate
from moar_companion.mavlink.codec import Codec, checksum
from moar_companion.mavlink.dialect import create, mavlink
from moar_companion.types import AutopilotKind, LandedState, Telemetry

NAN = math.nan


def message_of(name, **fields):
    """A message with these fields and zeros elsewhere."""
    message_class = next(c for c in mavlink.mavlink_map.values() if c.msgname == name)
    given_fields = {}
    for field, type_name in zip(message_class.fieldnames, message_class.fieldtypes, strict=True):
        order = message_class.ordered_fieldnames.index(field)
        length = message_class.array_lengths[order]
        zero = 0.0 if type_name in ("float", "double") else 0
        given_fields[field] = [zero] * length if length else zero
    return create(name, **{**given_fields, **fields})


def updated(name, telemetry=None, now_s=10.0, **fields):
    return translate.update(telemetry or Telemetry(), message_of(name, **fields), now_s)


def heartbeat(**fields):
    return {"type": 2, "autopilot": 12, "base_mode": 0, "custom_mode": 0, **fields}


def test_a_heartbeat_tells_mode_arming_and_failsafe():
    telemetry = updated(
        "HEARTBEAT", **heartbeat(base_mode=129, custom_mode=0x00060000, system_status=5)
    )
    status = telemetry.autopilot
    assert status.kind is AutopilotKind.PX4
    assert (status.mode, status.ours, status.armed, status.failsafe) == (
        "OFFBOARD",
        True,
        True,
        True,
    )
    assert status.received_s == 10.0


def test_a_heartbeat_of_a_ground_station_is_not_an_autopilots():
    telemetry = updated("HEARTBEAT", **heartbeat(type=6, autopilot=8))
    assert telemetry.autopilot is None
    assert telemetry.ground_station.received_s == 10.0


@pytest.mark.parametrize(
    ("vehicle", "autopilot", "kind"),
    [
        (2, 12, AutopilotKind.PX4),
        (13, 3, AutopilotKind.ARDUPILOT),
        (2, 4, AutopilotKind.UNKNOWN),
        (2, 8, None),
        (18, 12, None),
        (26, 0, None),
        (6, 3, None),
    ],
)
def test_only_an_aircrafts_heartbeat_is_an_autopilots(vehicle, autopilot, kind):
    message = message_of("HEARTBEAT", **heartbeat(type=vehicle, autopilot=autopilot))
    assert translate.autopilot_kind(message) is kind
    if kind is None:
        assert translate.update(Telemetry(), message, 1.0).autopilot is None


def test_a_local_position_has_the_autopilots_clock():
    telemetry = updated(
        "LOCAL_POSITION_NED", time_boot_ms=2500, x=1.0, y=2.0, z=-3.0, vx=4.0, vy=5.0, vz=6.0
    )
    position = telemetry.local_position
    assert position.boot_s == 2.5
    assert position.position_ned_m == (1.0, 2.0, -3.0)
    assert position.velocity_ned_mps == (4.0, 5.0, 6.0)


@pytest.mark.parametrize("field", ["x", "y", "z", "vx", "vy", "vz"])
@pytest.mark.parametrize("value", [NAN, math.inf, -math.inf])
def test_a_position_that_is_not_finite_is_dropped(field, value):
    before = updated("LOCAL_POSITION_NED", x=1.0)
    after = updated("LOCAL_POSITION_NED", before, now_s=11.0, **{field: value})
    assert after is before


def test_an_attitude_that_is_not_finite_is_dropped():
    assert updated("ATTITUDE", yaw=NAN).attitude is None
    assert updated("ATTITUDE", roll=0.5).attitude.roll_rad == 0.5


def test_points_become_degrees_and_metres():
    telemetry = updated(
        "GPS_GLOBAL_ORIGIN", latitude=453780000, longitude=-719290000, altitude=200100
    )
    point = telemetry.local_origin.point
    assert point.latitude_deg == pytest.approx(45.378)
    assert point.longitude_deg == pytest.approx(-71.929)
    assert point.altitude_amsl_m == pytest.approx(200.1)
    telemetry = updated("GLOBAL_POSITION_INT", lat=453780000, lon=-719290000, alt=210000)
    assert telemetry.global_position.point.altitude_amsl_m == pytest.approx(210.0)
    telemetry = updated("HOME_POSITION", latitude=1, longitude=2, altitude=3, x=1.0, y=2.0, z=3.0)
    assert telemetry.home.position_ned_m == (1.0, 2.0, 3.0)


def test_ardupilots_zero_coordinates_are_no_point():
    assert updated("GLOBAL_POSITION_INT", alt=1).global_position is None
    assert updated("GPS_GLOBAL_ORIGIN").local_origin is None
    assert updated("HOME_POSITION").home is None
    assert updated("HOME_POSITION", latitude=1, longitude=1, x=NAN).home is None


def test_the_landed_state_may_be_unknown():
    telemetry = updated("EXTENDED_SYS_STATE", landed_state=2)
    assert telemetry.landed_state is LandedState.IN_AIR
    assert updated("EXTENDED_SYS_STATE", telemetry, landed_state=0).landed_state is None
    assert updated("EXTENDED_SYS_STATE", telemetry, landed_state=77).landed_state is None
    assert updated("EXTENDED_SYS_STATE", telemetry, landed_state=2) is telemetry


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
    told = updated("ESTIMATOR_STATUS", pos_horiz_accuracy=NAN).estimator
    assert told.horizontal_accuracy_m is None
    told = updated("EKF_STATUS_REPORT", pos_horiz_variance=0.5).estimator
    assert told.horizontal_accuracy_m is None


def test_px4s_wind_points_where_the_air_goes():
    wind = updated("WIND_COV", wind_x=-5.0, wind_y=1.0, wind_z=NAN).wind
    assert wind.velocity_ned_mps == (-5.0, 1.0, 0.0)


def test_ardupilots_wind_comes_from_its_direction():
    wind = updated("WIND", direction=90.0, speed=5.0, speed_z=0.5).wind
    assert wind.velocity_ned_mps == pytest.approx((0.0, -5.0, 0.5))


def test_ardupilots_wind_of_0_from_minus_180_is_unknown():
    known = updated("WIND", direction=90.0, speed=5.0)
    assert updated("WIND", known, direction=-180.0, speed=0.0).wind is None
    assert updated("WIND", direction=20.0, speed=0.0).wind.velocity_ned_mps == (0.0, 0.0, 0.0)


def test_a_wind_that_is_not_a_number_is_unknown():
    known = updated("WIND_COV", wind_x=1.0)
    assert updated("WIND_COV", known, wind_x=NAN).wind is None
    assert updated("WIND", known, speed=NAN).wind is None


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


def test_a_message_of_no_interest_changes_nothing():
    telemetry = Telemetry()
    assert updated("HIGHRES_IMU", telemetry) is telemetry


@given(st.sampled_from(sorted(translate.MESSAGE_IDS)), st.binary(max_size=120))
def test_no_payload_raises_and_nothing_in_telemetry_is_nan(message_id, payload):
    header = bytes([len(payload), 0, 0, 5, 1, 1]) + message_id.to_bytes(3, "little")
    value = checksum(header + payload + bytes([mavlink.mavlink_map[message_id].crc_extra]))
    (message,) = Codec(system_id=9, component_id=9).receive(
        b"\xfd" + header + payload + value.to_bytes(2, "little")
    )
    telemetry = translate.update(Telemetry(), message, 1.0)
    text = str(telemetry)
    assert "nan" not in text
    assert "inf" not in text


def setpoint(**fields):
    return translate.setpoint_message(
        **{
            "target_system": 1,
            "target_component": 1,
            "position_ned_m": (1.0, 2.0, -3.0),
            "velocity_ned_mps": (0.1, 0.2, 0.3),
            "yaw_rad": 0.5,
            "now_s": 12.5,
            **fields,
        }
    )


def test_a_setpoint_is_position_velocity_and_yaw_in_local_ned():
    message = setpoint()
    assert message.get_type() == "SET_POSITION_TARGET_LOCAL_NED"
    assert (message.coordinate_frame, message.type_mask) == (1, 0x9C0)
    assert (message.x, message.y, message.z, message.vx, message.vy, message.vz) == (
        1.0,
        2.0,
        -3.0,
        0.1,
        0.2,
        0.3,
    )
    assert (message.yaw, message.time_boot_ms) == (0.5, 12500)


@pytest.mark.parametrize("bad", [NAN, math.inf, -math.inf, 1e39])
@pytest.mark.parametrize(
    "place",
    [
        lambda bad: {"position_ned_m": (0.0, bad, 0.0)},
        lambda bad: {"velocity_ned_mps": (0.0, 0.0, bad)},
        lambda bad: {"yaw_rad": bad},
    ],
)
def test_a_setpoint_that_is_not_finite_is_refused(bad, place):
    with pytest.raises(ValueError, match="must be finite"):
        setpoint(**place(bad))


def replay(packets, *, source=(1, 1)):
    codec = Codec(system_id=9, component_id=9, wanted=translate.MESSAGE_IDS)
    telemetry = Telemetry()
    for time_s, packet in packets:
        for message in codec.receive(packet):
            if (message.get_srcSystem(), message.get_srcComponent()) == source:
                telemetry = translate.update(telemetry, message, time_s)
                yield telemetry


@pytest.mark.recordings
def test_ardupilots_flight_with_drag_fusion_has_a_wind_and_without_it_none(recording):
    with_fusion = [
        t.wind for t in replay(recording("ardupilot/c3_wind_const.companion.tlog")) if t.wind
    ]
    assert max(math.hypot(*w.velocity_ned_mps) for w in with_fusion) == pytest.approx(12.6, abs=1)
    without = list(replay(recording("ardupilot/c1_wind.companion.tlog")))
    assert {t.wind for t in without} == {None}


@pytest.mark.recordings
def test_px4s_silent_receiver_knows_nothing(recording):
    last = None
    silent = []
    lost = False
    for telemetry in replay(recording("px4/d3_gps_silent_v117.companion.tlog")):
        if telemetry.gnss is not last:
            last = telemetry.gnss
            if last.satellites is None:
                silent.append(last)
        if telemetry.estimator is not None and silent:
            lost |= not telemetry.estimator.horizontal_position_ok
    assert len(silent) == 14
    assert {(g.hdop, g.horizontal_accuracy_m, g.fix_type) for g in silent} == {(None, None, 0)}
    assert lost


@pytest.mark.recordings
def test_px4s_failing_battery_is_followed_to_the_emergency(recording):
    charge = []
    for telemetry in replay(recording("px4/b1_battery_drain.companion.tlog")):
        known = telemetry.batteries.get(0)
        if known is not None and known.charge_state not in charge:
            charge.append(known.charge_state)
    # SYS_STATUS is heard first, which knows no charge state.
    assert charge == [None, 1, 2, 3, 4]
    assert telemetry.autopilot.failsafe
    assert telemetry.autopilot.mode == "LAND"


@pytest.mark.recordings
def test_ardupilot_without_a_monitor_has_no_battery(recording):
    for telemetry in replay(recording("ardupilot/b2_nobatt.companion.tlog")):
        assert telemetry.batteries == {}

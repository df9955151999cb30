"""ArduPilot's onboard logs, read as the telemetry that the companion receives."""

from __future__ import annotations

import contextlib
import math
import struct

import pytest

from moar_companion.analysis.replay.dataflash_listener import DataflashListener
from moar_companion.commands.replay import played
from moar_companion.errors import InputError
from moar_companion.mavlink.telemetry import LandedState
from moar_companion.settings.config import shipped_configs
from moar_companion.settings.vehicle import Vehicle

GUIDED = ("MODE", {"ModeNum": 4})
HEALTH = {"C": 0, "PI": 0, "SS": 0x1F, "SV": 0.1, "SP": 0.2, "SH": 0.0, "SM": 0.3}
ESTIMATE = {"PN": 1.0, "PE": 2.0, "PD": -3.0, "VN": 0.1, "VE": 0.2, "VD": 0.3}
PLACE = {"Lat": 45.0, "Lng": -71.0, "Alt": 210.0}


def received(*rows):
    """The listener after messages, a second apart, and its texts."""
    listener, events = DataflashListener(), []
    for second, (name, fields) in enumerate(rows, start=1):
        events += listener.handle((name, {"TimeUS": second * 10**6} | fields), float(second))
    return listener, events


def telemetry(*rows):
    return received(*rows)[0].telemetry


def test_the_mode_is_the_heartbeat_of_the_same_mode_and_finds_the_autopilot_once():
    listener, events = received(GUIDED, ("EV", {"Id": 10}), ("MODE", {"ModeNum": 9}))
    status = listener.telemetry.autopilot
    assert (status.mode, status.armed, status.ours, status.homeward) == ("LAND", True, False, True)
    assert (listener.vehicle_type, listener.leans, status.motors) == ("quadrotor", True, 4)
    assert [type(item).__name__ for item in events] == ["AutopilotFound"]


def test_the_frame_decides_how_many_motors_there_are():
    assert telemetry(("PARM", {"Name": "FRAME_CLASS", "Value": 2.0}), GUIDED).autopilot.motors == 6
    plane, _ = received(("MSG", {"Message": "ArduPlane V4.5.0"}), GUIDED)
    assert not plane.leans


def test_the_autopilot_counts_as_connected_while_it_logs():
    attitude = ("ATT", {"Roll": 0.0, "Pitch": 0.0, "Yaw": 0.0})
    assert telemetry(GUIDED, attitude, attitude).autopilot.received_s == 3.0


def test_errors_of_failsafes_are_a_failsafe_until_they_clear():
    begun, cleared = {"Subsys": 6, "ECode": 1}, {"Subsys": 6, "ECode": 0}
    assert telemetry(GUIDED, ("ERR", begun)).autopilot.failsafe
    assert not telemetry(GUIDED, ("ERR", begun), ("ERR", cleared)).autopilot.failsafe
    assert not telemetry(GUIDED, ("ERR", {"Subsys": 2, "ECode": 1})).autopilot.failsafe
    _, events = received(GUIDED, ("ERR", begun))
    assert events[-1].text.text == "ERR subsystem 6, code 1"


def test_landing_and_taking_off_are_events():
    assert telemetry(("EV", {"Id": 18})).landed.state is LandedState.ON_GROUND
    assert telemetry(("EV", {"Id": 28})).landed.state is LandedState.IN_AIR


def test_the_position_is_of_the_estimator_in_use():
    second = {**HEALTH, "C": 0, "PI": 1}
    rows = [("XKF1", {"C": core, **ESTIMATE, "PN": float(core)}) for core in (0, 1)]
    assert telemetry(*rows).local_position.position_ned_m[0] == 0.0
    assert telemetry(("XKF4", second), *rows).local_position.position_ned_m[0] == 1.0
    assert telemetry(("NKF1", ESTIMATE)).local_position.velocity_ned_mps == (0.1, 0.2, 0.3)


def test_attitude_is_in_radians_with_the_heading_from_north():
    found = telemetry(("ATT", {"Roll": 90.0, "Pitch": -45.0, "Yaw": 350.0})).attitude
    assert (found.roll_rad, found.pitch_rad) == pytest.approx((math.pi / 2, -math.pi / 4))
    assert found.yaw_rad == pytest.approx(math.radians(-10.0))


def test_home_is_about_the_estimators_origin():
    home = telemetry(
        ("ORGN", {"Type": 0, **PLACE}), ("ORGN", {"Type": 1, **PLACE, "Alt": 205.0})
    ).home
    assert home.position_ned_m == pytest.approx((0.0, 0.0, 5.0))


def test_the_estimators_health_has_none_for_unused_sensors():
    found = telemetry(("XKF4", HEALTH)).estimator
    assert found.horizontal_position_ok
    assert (found.velocity_innovation, found.height_innovation) == (0.1, None)
    glitching = telemetry(("XKF4", {**HEALTH, "SS": 0x1F | 1 << 14})).estimator
    assert not glitching.horizontal_position_ok


def test_a_receiver_has_the_accuracy_that_came_before_it():
    fix = {"I": 0, "Status": 6, "GMS": 500, "GWk": 2, "NSats": 12, "HDop": 0.8}
    found = telemetry(("GPA", {"I": 0, "VDop": 1.5, "HAcc": 0.3, "VAcc": 0.0}), ("GPS", fix)).gnss
    assert (found.fix_type, found.satellites, found.hdop, found.vdop) == (6, 12, 0.8, 1.5)
    assert (found.horizontal_accuracy_m, found.vertical_accuracy_m) == (0.3, None)
    assert found.receiver_s == 2 * 604_800.5 - 0.5
    assert telemetry(("GPS", {**fix, "I": 1})).second_gnss.satellites == 12


def test_batteries_wind_field_motors_and_radios_are_as_their_messages():
    found = telemetry(
        GUIDED,
        ("BAT", {"Inst": 1, "Volt": 12.0, "Curr": -1.0, "RemPct": 40}),
        ("XKF2", {"VWN": 3.0, "VWE": -4.0}),
        ("MAG", {"I": 0, "MagX": 300, "MagY": 0, "MagZ": 400}),
        ("RCOU", {f"C{number}": 1500 if number < 6 else 0 for number in range(1, 15)}),
        ("RSSI", {"RXRSSI": 0.7}),
        ("PARM", {"Name": "MOT_PWM_MIN", "Value": 1000.0}),
    )
    battery = found.batteries[1]
    assert (battery.remaining, battery.voltage_v, battery.current_a) == (0.4, 12.0, None)
    assert found.wind.velocity_ned_mps == (3.0, -4.0, 0.0)
    assert found.magnetic_field.strength_gauss == pytest.approx(0.5)
    assert found.motors.pulse_us == (1500,) * 4
    assert (found.remote_control.rssi, found.motor_min_us) == (0.7, 1000.0)
    assert telemetry(("XKF2", {"VWN": 0.0, "VWE": 0.0})).wind is None


def test_before_4_a_second_sensor_or_core_has_messages_of_its_own():
    fix = {"Status": 3, "GMS": 500, "GWk": 2, "NSats": 12, "HDop": 0.8}
    found = telemetry(("GPA2", {"HAcc": 0.3}), ("GPS2", fix))
    assert (found.gnss, found.second_gnss.horizontal_accuracy_m) == (None, 0.3)
    second = {name: value for name, value in HEALTH.items() if name != "C"} | {"PI": 1}
    rows = [("NKF1", ESTIMATE), ("NKF6", {**ESTIMATE, "PN": 7.0})]
    assert telemetry(*rows).local_position.position_ned_m[0] == 1.0
    assert telemetry(("NKF4", second), *rows).local_position.position_ned_m[0] == 7.0


def test_of_two_estimators_the_one_that_is_flown_with_counts():
    rows = [("EKF1", {**ESTIMATE, "PN": 7.0}), ("NKF1", ESTIMATE)]
    for kind, north_m in ((1, 7.0), (2, 1.0), (0, 1.0)):
        chosen = ("PARM", {"Name": "AHRS_EKF_TYPE", "Value": float(kind)})
        assert telemetry(chosen, *rows).local_position.position_ned_m[0] == north_m


@pytest.mark.parametrize(
    ("text", "vehicle_type"),
    [
        ("APM:Copter V3.3.3 (acf1e10c)", "quadrotor"),
        ("ArduRover V4.6.3 (3fc7011a)", "ground rover"),
        ("APM:Rover V3.0.1", "ground rover"),
        ("ArduSub V4.1.0", "submarine"),
        ("Frame: OCTA_QUAD", "octorotor"),
        ("Frame: QUAD/X", "quadrotor"),
    ],
)
def test_texts_of_the_start_name_the_vehicle(text, vehicle_type):
    listener, _ = received(("MSG", {"Message": text}), GUIDED)
    assert listener.vehicle_type == vehicle_type


@pytest.mark.parametrize("nothing", [math.nan, math.inf, -math.inf])
def test_a_number_that_was_not_measured_is_unknown(nothing):
    whole = {"Volt": 15.2, "Curr": 11.0, "CurrTot": 500.0}
    for name in whole:
        capacity = ("PARM", {"Name": "BATT_CAPACITY", "Value": 5000.0})
        battery = telemetry(capacity, ("BAT", whole | {name: nothing})).batteries[0]
        found = {
            "Volt": battery.voltage_v, "Curr": battery.current_a, "CurrTot": battery.remaining,
        }  # fmt: skip
        assert found.pop(name) is None
        assert None not in found.values()
    no_capacity = ("PARM", {"Name": "BATT_CAPACITY", "Value": nothing})
    assert telemetry(no_capacity, ("BAT", whole)).batteries[0].remaining is None
    assert telemetry(("BAT", whole | {"RemPct": nothing})).batteries[0].remaining is None
    assert telemetry(("RSSI", {"RXRSSI": nothing})).remote_control.rssi is None
    gps = {"GMS": 1, "GWk": 1, "Status": 3, "NSats": 9, "HDop": nothing}
    accuracy = ("GPA", {"VDop": nothing, "HAcc": nothing, "VAcc": nothing})
    gnss = telemetry(accuracy, ("GPS", gps)).gnss
    assert (gnss.hdop, gnss.vdop, gnss.horizontal_accuracy_m) == (None, None, None)
    health = {"SV": nothing, "SP": 0.1, "SH": 0.1, "SM": nothing, "SS": 0x1F}
    estimator = telemetry(("XKF4", {"C": 0} | health)).estimator
    assert (estimator.velocity_innovation, estimator.compass_innovation) == (None, None)
    assert estimator.position_innovation == 0.1


@pytest.mark.parametrize("nothing", [math.nan, math.inf])
@pytest.mark.parametrize(
    ("name", "fields"),
    [
        ("ATT", {"Roll": 1.0, "Pitch": 2.0, "Yaw": 3.0}),
        ("XKF1", {"PN": 1.0, "PE": 2.0, "PD": 3.0, "VN": 1.0, "VE": 2.0, "VD": 3.0}),
        ("POS", {"Lat": 1.0, "Lng": 2.0, "Alt": 3.0}),
        ("XKF2", {"VWN": 1.0, "VWE": 2.0}),
        ("PARM", {"Value": 1.0, "Name": "FRAME_CLASS"}),
    ],
)
def test_a_message_without_a_measured_number_is_left_out(name, fields, nothing):
    for field, value in fields.items():
        if isinstance(value, float):
            with_nothing = {"C": 0} | fields | {field: nothing}
            assert telemetry((name, with_nothing)) == DataflashListener().telemetry


def test_messages_of_other_versions_are_left_out():
    assert telemetry(("BAT", {"Volts": 1}), ("GPS", {})) == DataflashListener().telemetry


# The file


def definition(number, name, layout, columns):
    """FMT, the message that defines a message; itself it has 89 bytes."""
    size = 89 if name == "FMT" else 3 + struct.calcsize("<" + layout.replace("Z", "64s"))
    texts = struct.pack("4s16s64s", name.encode(), layout.encode(), columns.encode())
    return struct.pack("<BBBBB", 0xA3, 0x95, 128, number, size) + texts


def entry(number, layout, *values):
    return struct.pack("<BBB" + layout.replace("Z", "64s"), 0xA3, 0x95, number, *values)


def log():
    attitudes = (40_000_000 + 100_000 * step for step in range(50))
    return b"".join(
        [
            definition(128, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"),
            definition(130, "MODE", "QBBB", "TimeUS,Mode,ModeNum,Rsn"),
            definition(131, "MSG", "QZ", "TimeUS,Message"),
            definition(132, "ATT", "Qfff", "TimeUS,Roll,Pitch,Yaw"),
            entry(130, "QBBB", 40_000_000, 4, 4, 0),
            entry(131, "QZ", 40_000_000, b"ArduCopter V4.6.3"),
            *(entry(132, "Qfff", stamp_us, 1.0, 2.0, 3.0) for stamp_us in attitudes),
            entry(130, "QBBB", 45_000_000, 9, 9, 0),
        ]
    )


@pytest.fixture
def vehicle():
    return Vehicle.load(shipped_configs() / "vehicles" / "x500.yaml")


def test_a_log_is_replayed_like_any_recording(tmp_path, vehicle):
    path = tmp_path / "00000001.BIN"
    path.write_bytes(log())
    replay = played(str(path), vehicle)
    assert replay.autopilot == "ardupilot"
    assert replay.duration_s == pytest.approx(5.0)
    reported = [(round(event.time_s, 1), event.kind, event.text) for event in replay.events]
    assert (0.0, "mode", "GUIDED") in reported
    assert (5.0, "mode", "LAND") in reported
    assert (0.0, "text", "autopilot info: ArduCopter V4.6.3") in reported


def test_a_log_that_is_cut_short_is_replayed_to_its_end(tmp_path, vehicle):
    path = tmp_path / "cut.bin"
    path.write_bytes(log()[:-30])
    assert played(str(path), vehicle).duration_s == pytest.approx(4.8)


@pytest.mark.parametrize("garbage", [b"", bytes(200), bytes(range(256))])
def test_a_log_of_random_bytes_gives_no_telemetry(tmp_path, vehicle, garbage):
    path = tmp_path / "broken.bin"
    path.write_bytes(log()[:89] + garbage)
    with contextlib.suppress(InputError):
        assert played(str(path), vehicle).autopilot == "unknown"

"""Parameters judged before a flight: by examples, one story each."""

import pytest

from moar_companion.companion.preflight.aircraft_check import parameter_findings
from moar_companion.companion.preflight.findings import Finding, Level, worst
from moar_companion.mavlink.autopilots import profile
from moar_companion.mavlink.autopilots.parameter_names import Parameters
from moar_companion.settings.config import LossCheck, shipped_configs
from moar_companion.settings.vehicle import Vehicle
from moar_companion.types import ARDUPILOT, PX4, UNKNOWN
from tests.vehicles import named_vehicle

VEHICLES = shipped_configs() / "vehicles"
X500 = Vehicle.load(VEHICLES / "x500.yaml")
"""5 m/s, four cells."""
OK, NOTE, WARNING, NO_GO = Level

PX4_AS_ASKED = {
    "COM_OF_LOSS_T": 0.5,
    "COM_OBL_RC_ACT": 5.0,
    "MAN_OVERRIDE_SPD": 1.0,
    "COM_RCL_EXCEPT": 0.0,
    "NAV_RCL_ACT": 1.0,
    "COM_DLL_EXCEPT": 0.0,
    "NAV_DLL_ACT": 0.0,
    "GF_ACTION": 2.0,
    "COM_LOW_BAT_ACT": 2.0,
    "COM_FLTT_LOW_ACT": 0.0,
    "COM_FLT_TIME_MAX": -1.0,
    "COM_WIND_MAX_ACT": 0.0,
    "BAT_LOW_THR": 0.15,
    "BAT_CRIT_THR": 0.07,
    "RTL_RETURN_ALT": 30.0,
    "MPC_LAND_SPEED": 0.7,
    "MPC_XY_VEL_MAX": 12.0,
    "MPC_Z_VEL_MAX_UP": 3.0,
    "MPC_Z_VEL_MAX_DN": 1.5,
    "MAV_1_FORWARD": 1.0,
    "EKF2_DRAG_CTRL": 1.0,
}
ARDUPILOT_AS_ASKED = {
    "GUID_TIMEOUT": 0.5,
    "GUID_OPTIONS": 0.0,
    "FS_OPTIONS": 16.0,
    "FS_THR_ENABLE": 3.0,
    "FS_GCS_ENABLE": 0.0,
    "FS_EKF_ACTION": 1.0,
    "FS_EKF_THRESH": 0.8,
    "FS_DR_ENABLE": 1.0,
    "FENCE_ENABLE": 1.0,
    "FENCE_ACTION": 4.0,
    "BATT_MONITOR": 4.0,
    "BATT_FS_LOW_ACT": 1.0,
    "BATT_FS_CRT_ACT": 1.0,
    "BATT_LOW_VOLT": 14.0,
    "BATT_CRT_VOLT": 13.2,
    "BATT_LOW_MAH": 0.0,
    "BATT_CRT_MAH": 0.0,
    "RTL_ALT_M": 15.0,
    "LAND_SPD_MS": 0.5,
    "WP_SPD": 10.0,
    "WP_SPD_UP": 3.0,
    "WP_SPD_DN": 1.5,
    "WP_ACC": 2.5,
    "WP_ACC_Z": 1.0,
    "EK3_DRAG_BCOEF_X": 16.0,
    "EK3_DRAG_BCOEF_Y": 16.0,
    "EK3_DRAG_MCOEF": 0.2,
}


def findings(
    kind, parameters, *, ground_station_received=False, vehicle=X500, policy=LossCheck.REFUSE
):
    known = profile(kind)
    reported = Parameters({**known.parameters.defaults, **parameters})
    found = parameter_findings(
        known, reported, vehicle, policy, ground_station_received=ground_station_received
    )
    return {item.subject: item for item in found}


def unread(kind, parameters=None):
    """Findings on an autopilot that reports nothing, after all requests."""
    found = parameter_findings(
        profile(kind),
        Parameters(parameters or {}),
        X500,
        LossCheck.REFUSE,
        ground_station_received=False,
    )
    return {item.subject: item for item in found}


def of_px4(name, value, **more):
    return findings(PX4, {**PX4_AS_ASKED, name: value, **more})[name]


def of_ardupilot(name, value, **more):
    return findings(ARDUPILOT, {**ARDUPILOT_AS_ASKED, name: value, **more})[name]


@pytest.mark.parametrize(
    ("kind", "parameters"),
    [(PX4, PX4_AS_ASKED), (ARDUPILOT, ARDUPILOT_AS_ASKED)],
    ids=["PX4", "ArduPilot"],
)
def test_recommended_parameters_cause_only_notes_without_a_remedy(kind, parameters):
    found = findings(kind, parameters)
    assert list(found) == list(parameters)
    assert worst(found.values()) is NOTE
    assert {item.remedy for item in found.values()} == {""}


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_a_parameter_that_was_not_received_is_unknown_and_never_passes(kind):
    missing = unread(kind)
    assert missing == unread(kind, dict.fromkeys(PX4_AS_ASKED | ARDUPILOT_AS_ASKED))
    assert min(item.level for item in missing.values()) is NOTE
    assert max(item.level for item in missing.values()) is NO_GO
    assert all("unknown" in item.text for item in missing.values())


@pytest.mark.uncounted
@pytest.mark.parametrize(
    ("kind", "asked"),
    [(PX4, PX4_AS_ASKED), (ARDUPILOT, ARDUPILOT_AS_ASKED)],
)
def test_a_parameter_that_may_be_a_no_go_is_one_until_it_is_received(kind, asked):
    unknown = unread(kind)
    table = profile(kind).parameters
    denying = {key for key in profile(kind).flight_parameters if table.row(key).denies}
    values = [*map(float, range(-1, 65)), 0.25, 0.8, 1e4]
    for name in asked:
        may_be = {findings(kind, {**asked, name: value})[name].level for value in values}
        assert (unknown[name].level is NO_GO) is (NO_GO in may_be or name in denying), name


@pytest.mark.parametrize(
    ("title", "name", "value", "level", "words"),
    [
        ("half a second on the last setpoint", "COM_OF_LOSS_T", 0.5, OK, "8.8 m at 5 m/s"),
        ("PX4's default second", "COM_OF_LOSS_T", 1.0, WARNING, "8.8 m at 5 m/s"),
        ("two seconds are long", "COM_OF_LOSS_T", 2.0, WARNING, "companion failure; set 0.5"),
        ("more was never flown", "COM_OF_LOSS_T", 5.0, NO_GO, "companion failure; set 0.5"),
        ("a failed companion, as without sticks", "COM_OBL_RC_ACT", 0.0, OK, "by NAV_RCL_ACT"),
        ("a failed companion, return", "COM_OBL_RC_ACT", 3.0, WARNING, "climbs first"),
        ("a failed companion, land", "COM_OBL_RC_ACT", 4.0, OK, "4 (land)"),
        ("a failed companion, hold", "COM_OBL_RC_ACT", 5.0, OK, "5 (hold)"),
        ("a failed companion, terminate", "COM_OBL_RC_ACT", 6.0, NO_GO, "the aircraft falls"),
        ("a failed companion, disarm", "COM_OBL_RC_ACT", 7.0, NO_GO, "the aircraft falls"),
        ("a value of a later PX4", "COM_OBL_RC_ACT", 9.0, WARNING, "9 (unknown value, taken as"),
        ("sticks do nothing in OFFBOARD", "MAN_OVERRIDE_SPD", -1.0, WARNING, "set 1"),
        ("sticks take over in OFFBOARD", "MAN_OVERRIDE_SPD", 2.0, OK, "in OFFBOARD, too"),
        ("a lost transmitter, hold", "NAV_RCL_ACT", 1.0, OK, "hold"),
        ("a lost transmitter, return", "NAV_RCL_ACT", 2.0, WARNING, "climbs first"),
        ("a lost transmitter, below PX4's range", "NAV_RCL_ACT", 0.0, WARNING, "unknown value"),
        ("a lost ground station, nothing", "NAV_DLL_ACT", 0.0, OK, "nothing"),
        ("a lost transmitter, disarm", "NAV_RCL_ACT", 6.0, NO_GO, "the aircraft falls"),
        ("a lost transmitter does not count", "COM_RCL_EXCEPT", 4.0, NOTE, "ignored"),
        ("a lost ground station, return", "NAV_DLL_ACT", 2.0, WARNING, "climbs first"),
        ("the fence, return", "GF_ACTION", 3.0, WARNING, "climbs first"),
        ("the fence, terminate", "GF_ACTION", 4.0, NO_GO, "the aircraft falls"),
        ("an empty battery, nothing", "COM_LOW_BAT_ACT", 0.0, NOTE, "until it falls"),
        ("an empty battery, return", "COM_LOW_BAT_ACT", 1.0, NOTE, "climbs first"),
        ("little flight time, return", "COM_FLTT_LOW_ACT", 3.0, WARNING, "set 1 (a warning)"),
        ("little flight time, PX4's default", "COM_FLTT_LOW_ACT", 0.0, OK, "nothing"),
        ("a longest flight time", "COM_FLT_TIME_MAX", 600.0, WARNING, "600 s, then return"),
        ("no longest flight time", "COM_FLT_TIME_MAX", -1.0, OK, "off"),
        ("strong wind, return", "COM_WIND_MAX_ACT", 3.0, WARNING, "climbs first"),
        ("strong wind, terminate", "COM_WIND_MAX_ACT", 4.0, WARNING, "the aircraft falls"),
        ("an empty battery, PX4's default", "COM_LOW_BAT_ACT", 3.0, NOTE, "order the exit before"),
        ("critical before low", "BAT_LOW_THR", 0.05, WARNING, "5%"),
        ("PX4 acts before the companion", "BAT_CRIT_THR", 0.25, WARNING, "25%"),
        ("slower than the vehicle file", "MPC_Z_VEL_MAX_UP", 1.0, WARNING, "requires 3"),
        ("a mute TELEM2", "MAV_1_FORWARD", 0.0, WARNING, "set 1"),
        ("no drag fusion", "EKF2_DRAG_CTRL", 0.0, NOTE, "from the lean"),
    ],
)
def test_each_parameter_of_px4_has_its_level_and_text(title, name, value, level, words):
    finding = of_px4(name, value)
    assert (finding.level, words in str(finding)) == (level, True), str(finding)


@pytest.mark.parametrize(
    ("lost", "level", "words"),
    [
        (2.0, WARNING, "climbs first"),
        (3.0, OK, "0 (position mode"),
        (6.0, NO_GO, "the aircraft falls"),
    ],
)
def test_px4s_default_offboard_loss_action_is_that_of_a_lost_transmitter(lost, level, words):
    finding = of_px4("COM_OBL_RC_ACT", 0.0, NAV_RCL_ACT=lost)
    assert finding.level is level
    assert words in str(finding)


def test_px4s_action_on_a_lost_transmitter_is_ignored_where_it_has_no_effect():
    finding = of_px4("NAV_RCL_ACT", 2.0, COM_RCL_EXCEPT=4.0)
    assert (finding.level, "by COM_RCL_EXCEPT" in finding.text) == (OK, True)
    assert of_px4("NAV_RCL_ACT", 2.0, COM_RCL_EXCEPT=None).level is WARNING


@pytest.mark.parametrize("value", [0.0, 0.5, 0.798, 0.8, 2.5])
@pytest.mark.parametrize("name", ["WP_ACC", "WP_ACC_Z"])
def test_a_soft_ardupilot_is_judged_and_mended_as_the_service_does(name, value):
    asked = {**ARDUPILOT_AS_ASKED, name: value}
    ardupilot, acceleration_mps2 = profile(ARDUPILOT), X500.guidance.acceleration_mps2
    lag = ardupilot.offboard_loss(ardupilot.with_silence(Parameters(asked))).lag(acceleration_mps2)
    finding = of_ardupilot(name, value)
    assert (finding.level is NO_GO) is (lag is not None)
    assert finding.remedy.partition(", or")[0] in (lag or "")


def test_a_return_on_an_unknown_route_is_refused_by_the_check_as_by_the_service():
    finding = of_px4("COM_OBL_RC_ACT", 3.0, RTL_TYPE=1.0)
    assert (finding.level, finding.remedy) == (NO_GO, "set 5 (hold)")
    assert of_px4("COM_OBL_RC_ACT", 5.0, RTL_TYPE=1.0).level is OK


def test_an_objection_that_is_a_warning_in_the_service_is_a_warning_in_the_check():
    for kind, asked, name, value in (
        (PX4, PX4_AS_ASKED, "COM_OBL_RC_ACT", 7.0),
        (PX4, {**PX4_AS_ASKED, "RTL_TYPE": 1.0}, "COM_OBL_RC_ACT", 3.0),
        (ARDUPILOT, ARDUPILOT_AS_ASKED, "GUID_TIMEOUT", 60.0),
        (ARDUPILOT, ARDUPILOT_AS_ASKED, "WP_ACC_Z", 0.5),
    ):
        parameters = {**asked, name: value}
        found = findings(kind, parameters, policy=LossCheck.WARN)
        assert found[name].level is WARNING


def test_a_silent_telem2_is_accepted_where_a_ground_station_is_received():
    parameters = {**PX4_AS_ASKED, "MAV_1_FORWARD": 0.0}
    found = findings(PX4, parameters, ground_station_received=True)
    assert found["MAV_1_FORWARD"].level is OK


@pytest.mark.parametrize(
    ("title", "name", "value", "level", "words"),
    [
        ("ArduPilot's default of 3 s", "GUID_TIMEOUT", 3.0, WARNING, "29.5 m at 5 m/s"),
        ("a minute", "GUID_TIMEOUT", 60.0, NO_GO, "set 0.5"),
        ("half a second", "GUID_TIMEOUT", 0.5, OK, "17.0 m"),
        ("brakes too softly", "WP_ACC", 0.5, NO_GO, "0.5 m/s2, the vehicle file requires"),
        ("climbs too softly", "WP_ACC_Z", 0.5, NO_GO, "guidance.acceleration_mps2"),
        ("position is not held", "GUID_OPTIONS", 16.0, NO_GO, "clear bits 4 and 5"),
        ("velocity is not held", "GUID_OPTIONS", 32.0, NO_GO, "clear bits 4 and 5"),
        ("the pilot's yaw ignored", "GUID_OPTIONS", 4.0, OK, "both are held"),
        ("a lost transmitter, default", "FS_THR_ENABLE", 1.0, WARNING, "climbs first"),
        ("a lost transmitter, nothing", "FS_THR_ENABLE", 0.0, WARNING, "nothing"),
        ("a lost transmitter, land", "FS_THR_ENABLE", 3.0, OK, "land"),
        (
            "a lost transmitter, smart return",
            "FS_THR_ENABLE",
            5.0,
            OK,
            "on the flown path, or land",
        ),
        ("a lost transmitter, perhaps smart", "FS_THR_ENABLE", 4.0, WARNING, "climbs first"),
        ("a lost transmitter, brake", "FS_THR_ENABLE", 7.0, OK, "brake"),
        ("a lost transmitter does not count", "FS_OPTIONS", 20.0, NOTE, "ignored"),
        ("a lost ground station, return", "FS_GCS_ENABLE", 1.0, WARNING, "climbs first"),
        ("a lost ground station, land", "FS_GCS_ENABLE", 5.0, OK, "land"),
        ("a lost ground station, smart return", "FS_GCS_ENABLE", 4.0, OK, "on the flown path"),
        ("a lost ground station, perhaps smart", "FS_GCS_ENABLE", 3.0, WARNING, "climbs first"),
        ("a lost estimator, report", "FS_EKF_ACTION", 0.0, NO_GO, "a report only"),
        ("a lost estimator, altitude hold", "FS_EKF_ACTION", 2.0, WARNING, "drifts"),
        ("a lost estimator is not noticed", "FS_EKF_THRESH", 0.0, NO_GO, "off"),
        ("a lost estimator is noticed late", "FS_EKF_THRESH", 1.5, WARNING, "set 0.8"),
        ("dead reckoning, ArduPilot's default", "FS_DR_ENABLE", 2.0, WARNING, "climbs first"),
        ("dead reckoning, perhaps smart return", "FS_DR_ENABLE", 3.0, WARNING, "climbs first"),
        ("dead reckoning, smart return", "FS_DR_ENABLE", 4.0, OK, "or land"),
        ("dead reckoning, nothing", "FS_DR_ENABLE", 0.0, WARNING, "flies on"),
        ("dead reckoning, terminate", "FS_DR_ENABLE", 5.0, NO_GO, "the aircraft falls"),
        ("dead reckoning, brake", "FS_DR_ENABLE", 7.0, OK, "brake"),
        ("the fence, ArduPilot's default", "FENCE_ACTION", 1.0, WARNING, "climbs first"),
        ("the fence, perhaps smart return", "FENCE_ACTION", 3.0, WARNING, "climbs first"),
        ("the fence, land", "FENCE_ACTION", 2.0, OK, "2 (land)"),
        ("no fence", "FENCE_ENABLE", 0.0, OK, "0 (off)"),
        ("no battery monitor", "BATT_MONITOR", 0.0, NO_GO, "set up the battery monitor"),
        ("a low battery, nothing", "BATT_FS_LOW_ACT", 0.0, NOTE, "nothing"),
        ("a low battery, terminate", "BATT_FS_LOW_ACT", 5.0, NO_GO, "the aircraft falls"),
        ("a critical battery, default", "BATT_FS_CRT_ACT", 0.0, NOTE, "until it falls"),
        ("a critical battery, return", "BATT_FS_CRT_ACT", 2.0, NOTE, "climbs first"),
        ("a critical battery, perhaps smart", "BATT_FS_CRT_ACT", 3.0, NOTE, "climbs first"),
        ("a critical battery, smart return", "BATT_FS_CRT_ACT", 4.0, OK, "or land"),
        ("three cells' threshold for four", "BATT_LOW_VOLT", 10.5, WARNING, "2.62 V a cell"),
        ("no critical threshold", "BATT_CRT_VOLT", 0.0, NOTE, "0 (none)"),
        ("slower than the vehicle file", "WP_SPD", 3.0, WARNING, "3 m/s"),
        ("a slow landing takes more energy", "LAND_SPD_MS", 0.3, WARNING, "forecast with 0.5"),
        ("height of the return in metres", "RTL_ALT_M", 15.0, NOTE, "15 m"),
        ("no drag coefficient", "EK3_DRAG_MCOEF", 0.0, NOTE, "the companion estimates it"),
    ],
)
def test_each_parameter_of_ardupilot_has_its_level_and_text(title, name, value, level, words):
    finding = of_ardupilot(name, value)
    assert (finding.level, words in str(finding)) == (level, True), str(finding)


def test_ardupilots_action_on_a_lost_transmitter_is_ignored_where_it_has_no_effect():
    assert of_ardupilot("FS_THR_ENABLE", 1.0, FS_OPTIONS=4.0).level is OK


@pytest.mark.parametrize("stage", ["LOW", "CRT"])
def test_a_battery_action_without_a_threshold_is_ignored(stage):
    action, volts, charge = f"BATT_FS_{stage}_ACT", f"BATT_{stage}_VOLT", f"BATT_{stage}_MAH"
    finding = of_ardupilot(action, 1.0, **{volts: 0.0})
    assert finding.level is WARNING
    assert f"1 (land), without effect: {volts} and {charge} are 0" in finding.text
    assert f"{volts} or {charge}" in finding.remedy
    assert of_ardupilot(action, 5.0, **{volts: 0.0}).level is NO_GO
    for received in ({charge: 500.0}, {volts: 14.0, charge: 0.0}, {charge: None}):
        assert of_ardupilot(action, 1.0, **{volts: 0.0, **received}).level is OK


def test_ardupilots_action_at_a_disabled_fence_is_a_note():
    finding = of_ardupilot("FENCE_ACTION", 1.0, FENCE_ENABLE=0.0)
    assert (finding.level, finding.remedy) == (NOTE, "")
    assert "once the fence is on: FENCE_ENABLE is 0" in finding.text
    assert of_ardupilot("FENCE_ACTION", 1.0, FENCE_ENABLE=None).level is WARNING
    assert of_ardupilot("FENCE_ACTION", 2.0, FENCE_ENABLE=0.0).level is OK


def test_an_action_in_dead_reckoning_is_a_note_while_ardupilot_estimates_no_wind():
    drag = dict.fromkeys(("EK3_DRAG_BCOEF_X", "EK3_DRAG_BCOEF_Y", "EK3_DRAG_MCOEF"), 0.0)
    for value in (0.0, 2.0, 5.0):
        finding = of_ardupilot("FS_DR_ENABLE", value, **drag)
        assert finding.level is NOTE
        zero = "EK3_DRAG_BCOEF_X, EK3_DRAG_BCOEF_Y and EK3_DRAG_MCOEF are 0"
        assert f"without effect: {zero}" in finding.text
    for received in ({"EK3_DRAG_MCOEF": None}, {"EK3_DRAG_BCOEF_Y": 16.0}):
        assert of_ardupilot("FS_DR_ENABLE", 2.0, **drag | received).level is WARNING


def test_a_threshold_of_the_whole_pack_is_not_judged_without_the_number_of_cells():
    linedrone = named_vehicle("linedrone_uniform")
    found = findings(ARDUPILOT, ARDUPILOT_AS_ASKED, vehicle=linedrone)
    assert found["BATT_LOW_VOLT"].level is NOTE


@pytest.mark.parametrize(
    ("risk", "level"), [(0.0, OK), (0.1, NOTE), (0.5, WARNING), (0.99, WARNING), (1.0, NO_GO)]
)
def test_the_level_of_a_finding_follows_from_the_risk(risk, level):
    assert Level.of_risk(risk) is level


def test_a_finding_has_a_text_and_a_remedy():
    finding = Finding(level=NO_GO, subject="it", text="is wrong", remedy="mend it")
    assert (str(finding.level), str(finding)) == ("no-go", "it: is wrong; mend it")


def test_an_unknown_autopilot_has_no_parameter_findings():
    assert findings(UNKNOWN, PX4_AS_ASKED) == {}

"""What the autopilot would hit by itself: the check names trigger, place, obstacle and remedy."""

from __future__ import annotations

import re

import pytest

from moar_companion.autopilots import failsafe_parameters, failsafes_of
from moar_companion.config import LossCheck, Supervision, shipped_configs
from moar_companion.margin import flown_site
from moar_companion.planner.planner import Planner
from moar_companion.power import PowerModel
from moar_companion.preflight import ardupilot
from moar_companion.preflight.failsafes import SUBJECT, failsafe_findings
from moar_companion.preflight.findings import Level
from moar_companion.preflight.rules import Case, parameter_findings
from moar_companion.site import Site
from moar_companion.types import AutopilotKind
from moar_companion.vehicle import Vehicle

OK, NOTE, WARNING, NO_GO = Level
PX4, ARDUPILOT = AutopilotKind.PX4, AutopilotKind.ARDUPILOT
SITE = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
VEHICLE = Vehicle.load(shipped_configs() / "vehicles" / "linedrone_flight.yaml")
PLANNER = Planner(flown_site(SITE, VEHICLE, Supervision()), VEHICLE)
SAFE = {
    PX4: {"NAV_RCL_ACT": 1.0},
    ARDUPILOT: {"FS_THR_ENABLE": 7.0, "FS_EKF_ACTION": 2.0},
}


def found(kind, policy=LossCheck.WARN, **parameters):
    told = dict.fromkeys(failsafe_parameters(kind), 0.0)
    failsafes = failsafes_of(kind, {**told, **SAFE[kind], **parameters})
    findings = failsafe_findings(
        PLANNER, failsafes, Supervision(failsafe_action=policy), PowerModel.of(VEHICLE)
    )
    assert {item.subject for item in findings} == {SUBJECT}
    return findings


def test_what_a_landing_at_a_critical_battery_would_hit_is_named_with_what_mends_it():
    (finding,) = found(ARDUPILOT, BATT_FS_CRT_ACT=1.0, BATT_CRT_MAH=660.0, BATT_CAPACITY=3300.0)
    assert finding.level is WARNING
    assert finding.text.startswith("critical battery, BATT_FS_CRT_ACT 1 (land): it would hit ")
    assert "% of the plan to splice-inner" in finding.text
    assert "left-lower from 0% of the plan exit from splice-inner" in finding.text
    assert finding.text.endswith("; the companion leaves 30 s before")
    assert finding.remedy == "set BATT_FS_CRT_ACT 4 (smart return)"


@pytest.mark.parametrize(("stage", "values"), [("LOW", {4.0, 0.0}), ("CRT", {4.0})])
def test_what_mends_a_batterys_action_mends_it_by_the_rules_and_on_the_ways(stage, values):
    action, volts = f"BATT_FS_{stage}_ACT", f"BATT_{stage}_VOLT"
    rules = [rule for rule in ardupilot.RULES if rule.parameter == action]
    (on_ways,) = found(ARDUPILOT, **{action: 1.0, volts: 14.0})
    (by_rule,) = parameter_findings(rules, case(**{action: 5.0, volts: 14.0}))
    said = by_rule.remedy.removeprefix("set ").partition(",")[0]
    assert on_ways.remedy == f"set {action} {said}"
    assert {float(number) for number in re.findall(r"\d+", said)} == values
    for value in values:
        (by_rule,) = parameter_findings(rules, case(**{action: value, volts: 14.0}))
        assert by_rule.level in {OK, NOTE}
        (on_ways,) = found(ARDUPILOT, **{action: value, volts: 14.0})
        assert on_ways.level is OK


def case(**parameters):
    return Case(vehicle=VEHICLE, parameters=parameters, ground_station_heard=False)


def test_a_voltage_that_nobody_can_forecast_is_said():
    (finding,) = found(ARDUPILOT, BATT_FS_CRT_ACT=1.0, BATT_CRT_VOLT=10.2)
    assert finding.level is WARNING
    assert "when, nobody can forecast without risk.cells" in finding.text


@pytest.mark.parametrize(
    ("policy", "level"), [(LossCheck.WARN, WARNING), (LossCheck.REFUSE, NO_GO)]
)
def test_a_lost_remote_control_over_a_conductor_is_as_bad_as_configured(policy, level):
    (finding,) = found(ARDUPILOT, policy, FS_THR_ENABLE=3.0)
    assert finding.level is level
    assert finding.text.startswith("RC loss, FS_THR_ENABLE 3 (land): it would hit ")
    assert finding.remedy == "set FS_OPTIONS 4, or FS_THR_ENABLE 7 (brake)"


def test_motors_that_stop_are_a_no_go():
    stops = [item.text for item in found(PX4, NAV_RCL_ACT=5.0) if item.level is NO_GO]
    assert any(
        text.startswith("RC loss, NAV_RCL_ACT 5 (stop its motors): it would hit ") for text in stops
    )


def test_what_no_parameter_mends_is_a_note():
    (finding,) = found(PX4)
    assert finding.level is NOTE
    assert finding.text.startswith(
        "GPS loss, COM_OBL_RC_ACT 0 (descend without a position): drifting up to 4.5 m it would hit"
    )


def test_an_autopilot_that_stays_hits_nothing():
    (finding,) = found(ARDUPILOT)
    assert finding.level is OK


def test_without_a_home_a_return_is_not_taken_for_harmless():
    *_, finding = found(PX4, NAV_RCL_ACT=2.0)
    assert finding.level is WARNING
    assert finding.text.startswith("home is unknown")


def test_what_was_not_told_is_said():
    *_, finding = found(ARDUPILOT, RTL_ALT=None)
    assert (finding.level, finding.text) == (WARNING, "not told, taken as by default: RTL_ALT")

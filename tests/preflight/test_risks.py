"""Reasons of the service against an inspection: risks by their last values, and the limits."""

from dataclasses import replace

import pytest

from moar_companion.companion.preflight import risks
from moar_companion.companion.preflight.battery_check import CHARGE
from moar_companion.companion.preflight.findings import Finding, Level
from moar_companion.companion.preflight.risks import risk_findings
from moar_companion.companion.safety.conditions import CONDITIONS
from moar_companion.mavlink.telemetry import Battery, Estimator, Gnss, Telemetry
from moar_companion.risk import RiskEstimate, update
from moar_companion.settings.risk_model import RiskModel

OK, NOTE, WARNING, NO_GO = Level
NO_FIX = Gnss(
    received_s=0.0,
    receiver_s=None,
    fix_type=0,
    satellites=None,
    hdop=None,
    vdop=None,
    horizontal_accuracy_m=None,
    vertical_accuracy_m=None,
)
WELL = Estimator(
    received_s=0.0, flags=0x37F, horizontal_position_ok=True, horizontal_accuracy_m=0.3
)
EMPTY = Battery(received_s=0.0, remaining=0.03, voltage_v=None, current_a=None, charge_state=None)
MISREAD = Finding(level=WARNING, subject="battery 0", text="", remedy="correct risk.cells")
LOW = Finding(level=WARNING, subject="battery 1", text="", remedy=CHARGE)


def found(*looks, causes=None, batteries=()):
    """Findings after telemetry at some times, by subject."""
    model = RiskModel(unknown=0.5)
    risk = RiskEstimate.unknown(model)
    for now_s, telemetry in looks:
        risk = update(risk, telemetry, now_s, model=model, cruise_mps=5.0)
    findings = risk_findings(risk, causes or {}, batteries)
    return {item.subject: item for item in findings}


def test_a_risk_input_that_is_never_received_is_a_no_go_if_a_mission_needs_it():
    levels = {name: item.level for name, item in found((0.0, Telemetry())).items()}
    assert levels == {
        "wind risk": NOTE,
        "communication risk": WARNING,
        "localization risk": NO_GO,
        "battery risk": NO_GO,
    }


def test_a_bad_value_counts_until_the_next_value_as_in_the_service():
    lost = Telemetry(gnss=NO_FIX, estimator=WELL)
    silent = replace(lost, estimator=replace(WELL, received_s=10.0))
    finding = found((0.0, lost), (10.0, silent))["localization risk"]
    assert (finding.level, finding.text.startswith("1.00 (held at the last value: fix type 0")) == (
        NO_GO,
        True,
    )
    fixed = replace(NO_FIX, received_s=11.0, fix_type=3)
    mended = found((0.0, lost), (10.0, silent), (11.0, replace(silent, gnss=fixed)))
    assert mended["localization risk"].level is OK


def test_a_risk_input_that_is_received_no_more_is_a_no_go():
    received = Telemetry(batteries={0: replace(EMPTY, remaining=0.9)}, estimator=WELL)
    later = found((0.0, received), (60.0, received))
    for name in ("battery risk", "localization risk"):
        assert later[name].level is NO_GO
        assert later[name].text.startswith("no input is received any more, ")
        assert later[name].remedy.startswith("set up the autopilot to report it")


@pytest.mark.parametrize(
    ("cause", "subject", "remedy"),
    [
        ("battery_critical", "battery critical", "charge it"),
        ("battery_reserve", "battery reserve", "charge it"),
        ("uncertainty", "uncertainty", "wait for a better fix"),
        ("gnss", "gnss", "wait for a better fix"),
        ("localization", "localization", "wait for a better fix"),
        ("wind", "wind", "wait for calmer air"),
    ],
)
def test_a_limit_of_the_supervisor_that_is_passed_is_a_no_go(cause, subject, remedy):
    finding = found((0.0, Telemetry()), causes={cause: "14 m"})[subject]
    assert (finding.level, finding.text) == (NO_GO, "14 m: no inspection starts")
    assert finding.remedy.startswith(remedy)


def test_the_remedy_for_a_misread_battery_comes_before_charging():
    batteries = (MISREAD, LOW)
    received = Telemetry(batteries={0: EMPTY})
    assert found((0.0, received), batteries=batteries)["battery risk"].remedy == MISREAD.remedy
    assert found((0.0, received), batteries=(LOW,))["battery risk"].remedy == CHARGE
    unreported = found((0.0, Telemetry()), batteries=batteries)
    assert unreported["battery risk"].remedy == MISREAD.remedy


def test_each_cause_that_the_check_names_is_a_condition():
    named = {cause for *_, limits in risks._INDICES for cause in limits}
    assert named <= {row.name for row in CONDITIONS}

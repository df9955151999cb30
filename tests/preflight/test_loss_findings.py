"""Offboard loss: before the flight the check reports the same as the service in flight."""

from dataclasses import replace

import pytest

from moar_companion.companion.error_margin import flown_site
from moar_companion.companion.preflight.failsafes import LOSS_SUBJECT, loss_findings
from moar_companion.companion.preflight.findings import Level
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Site
from moar_companion.settings.config import LossCheck, Supervision, shipped_configs
from moar_companion.types import ARDUPILOT, PX4
from tests.vehicles import named_vehicle

from ..companion.desk import ACCEPTED, DENIED, INSPECTION, Desk, mavlink
from ..companion.scripted_autopilot import PARAMETERS
from ..losses import loss_of

OK, NOTE, WARNING, NO_GO = Level
KINDS = {
    PX4: mavlink.MAV_AUTOPILOT_PX4,
    ARDUPILOT: mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
}
SITE = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
VEHICLE = named_vehicle("linedrone_uniform")
PLANNER = Planner(flown_site(SITE, VEHICLE, Supervision()), VEHICLE)


def found(kind, policy=LossCheck.REFUSE, *, planner=PLANNER, **parameters):
    """Findings on an autopilot with recommended parameters but for these."""
    loss = loss_of(kind, **{**PARAMETERS, **parameters})
    findings = loss_findings(planner, loss, None, policy)
    assert {item.subject for item in findings} <= {LOSS_SUBJECT}
    return findings


@pytest.mark.parametrize("policy", LossCheck)
@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [
        (PX4, "COM_OBL_RC_ACT", 0.0),
        (PX4, "COM_OBL_RC_ACT", 4.0),
        (PX4, "COM_OBL_RC_ACT", 7.0),
        (ARDUPILOT, "GUID_TIMEOUT", 60.0),
        (ARDUPILOT, "WP_ACC", 0.5),
    ],
)
def test_the_check_reports_the_same_findings_as_the_service_in_flight(policy, kind, name, value):
    desk = Desk(autopilot=KINDS[kind], supervision=Supervision(loss_action=policy))
    desk.set_ours(name, value)
    desk.run(1.2).order(INSPECTION, 1.0).run(0.5)
    refused = policy is LossCheck.REFUSE
    assert desk.answers() == [DENIED if refused else ACCEPTED]
    (objection,) = {
        item.text.partition(" (")[0]
        for item in found(kind, policy, **{name: value})
        if "to splice-inner" in item.text and item.level is (NO_GO if refused else WARNING)
    }
    assert objection.startswith(
        ("PX4 would ", "ArduPilot would ", "GUID_TIMEOUT 60.0 s > 5", "ArduPilot brakes 0.5 < ")
    )
    assert desk.said(objection)


def test_an_escape_route_is_warned_about_and_never_a_no_go():
    findings = found(PX4, COM_OBL_RC_ACT=7.0)
    assert [(item.level, "exit from splice-outer" in item.text) for item in findings] == [
        (WARNING, True),
        (NO_GO, False),
    ]


@pytest.mark.parametrize("kind", KINDS)
def test_an_autopilot_that_holds_hits_no_obstacle(kind):
    (finding,) = found(kind)
    assert finding.level is OK
    assert finding.text == "the autopilot would hold, no collision on any route of this site"


def test_a_site_without_targets_has_no_route_findings():
    assert found(PX4, planner=Planner(replace(SITE, targets=()), VEHICLE)) == []

"""On offboard loss: the check says before the flight what the service says then."""

from dataclasses import replace

import pytest

from moar_companion.config import LossCheck, Supervision, shipped_configs
from moar_companion.margin import flown_site
from moar_companion.planner.planner import Planner
from moar_companion.preflight.findings import Level
from moar_companion.preflight.offboard_loss_ways import SUBJECT, loss_findings
from moar_companion.safety.offboard_loss import OffboardLoss
from moar_companion.site import Site
from moar_companion.types import AutopilotKind
from moar_companion.vehicle import Vehicle

from ..companion.desk import ACCEPTED, DENIED, INSPECTION, PARAMETERS, Desk, mavlink

OK, NOTE, WARNING, NO_GO = Level
KINDS = {
    AutopilotKind.PX4: mavlink.MAV_AUTOPILOT_PX4,
    AutopilotKind.ARDUPILOT: mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
}
SITE = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
VEHICLE = Vehicle.load(shipped_configs() / "vehicles" / "linedrone_flight.yaml")
PLANNER = Planner(flown_site(SITE, VEHICLE, Supervision()), VEHICLE)


def found(kind, policy=LossCheck.REFUSE, *, planner=PLANNER, **parameters):
    """What is found of an autopilot set as asked but for these."""
    told = OffboardLoss.of(kind, {**PARAMETERS, **parameters})
    findings = loss_findings(planner, told, None, policy)
    assert {item.subject for item in findings} <= {SUBJECT}
    return findings


@pytest.mark.parametrize("policy", LossCheck)
@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [
        (AutopilotKind.PX4, "COM_OBL_RC_ACT", 0.0),
        (AutopilotKind.PX4, "COM_OBL_RC_ACT", 4.0),
        (AutopilotKind.PX4, "COM_OBL_RC_ACT", 7.0),
        (AutopilotKind.ARDUPILOT, "GUID_TIMEOUT", 60.0),
        (AutopilotKind.ARDUPILOT, "WPNAV_ACCEL", 50.0),
    ],
)
def test_the_check_says_before_what_the_service_says_then(policy, kind, name, value):
    desk = Desk(autopilot=KINDS[kind], supervision=Supervision(loss_action=policy))
    desk.parameters[name] = value
    desk.run(1.2).order(INSPECTION, 1.0).run(0.5)
    refused = policy is LossCheck.REFUSE
    assert desk.answers() == [DENIED if refused else ACCEPTED]
    (objection,) = {
        item.text.partition(" (")[0]
        for item in found(kind, policy, **{name: value})
        if "to splice-inner" in item.text and item.level is (NO_GO if refused else WARNING)
    }
    assert objection.startswith(("PX4 would ", "it would ", "ArduPilot brakes at 0.5 < "))
    assert desk.said(objection)


def test_a_way_out_is_warned_about_and_never_a_no_go():
    findings = found(AutopilotKind.PX4, COM_OBL_RC_ACT=7.0)
    assert [(item.level, "exit from splice-outer" in item.text) for item in findings] == [
        (WARNING, True),
        (NO_GO, False),
    ]


@pytest.mark.parametrize("kind", KINDS)
def test_an_autopilot_that_holds_hits_nothing(kind):
    (finding,) = found(kind)
    assert finding.level is OK
    assert finding.text == "the autopilot would hold, and hit nothing on any way of this site"


def test_what_was_not_told_is_said_as_the_service_says_it():
    desk = Desk()
    del desk.parameters["RTL_MIN_DIST"]
    desk.run(5.0)
    *_, finding = found(AutopilotKind.PX4, RTL_MIN_DIST=None)
    assert (finding.level, finding.text) == (
        WARNING,
        "1 parameter not told (RTL_MIN_DIST), taken as default",
    )
    assert desk.said("MOAR: 1 parameter not told, taken as default")
    assert finding.text in {text["reason"] for text in desk.decided("text")}


def test_a_site_without_targets_has_no_ways_to_speak_of():
    assert found(AutopilotKind.PX4, planner=Planner(replace(SITE, targets=()), VEHICLE)) == []

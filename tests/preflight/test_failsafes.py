"""Collisions of the autopilot's failsafes: the check names trigger, place, obstacle and remedy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from moar_companion.companion.error_margin import flown_site
from moar_companion.companion.preflight.aircraft_check import parameter_findings
from moar_companion.companion.preflight.failsafes import SUBJECT, failsafe_findings
from moar_companion.companion.preflight.findings import Level
from moar_companion.companion.safety.failsafe_paths import exposed_places
from moar_companion.mavlink.autopilots import profile
from moar_companion.mavlink.autopilots.failsafe_actions import Trigger
from moar_companion.mavlink.autopilots.parameter_names import Parameters
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Site
from moar_companion.risk.power import PowerModel
from moar_companion.settings.config import LossCheck, Supervision, shipped_configs
from moar_companion.types import ARDUPILOT, PX4, Mission
from tests.vehicles import named_vehicle

OK, NOTE, WARNING, NO_GO = Level
SITE = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
VEHICLE = named_vehicle("linedrone_uniform")
PLANNER = Planner(flown_site(SITE, VEHICLE, Supervision()), VEHICLE)
ONLY_OUTER = replace(
    SITE,
    targets=SITE.targets[:1],
    landing_m={Mission.EXIT: SITE.landing_m[Mission.EXIT]},
)
OUTSIDE = Planner(flown_site(ONLY_OUTER, VEHICLE, Supervision()), VEHICLE)
"""Only the target outside the line."""
SAFE = {
    PX4: {"NAV_RCL_ACT": 1.0},
    ARDUPILOT: {"FS_THR_ENABLE": 7.0},
}


def found(kind, policy=LossCheck.WARN, **parameters):
    """All but what the loss of GPS comes to, which no parameter makes harmless here."""
    findings = all_found(kind, policy, **parameters)
    return [item for item in findings if not item.text.startswith("GPS loss")]


def of_gps(kind, policy=LossCheck.WARN, planner=PLANNER, **parameters):
    findings = all_found(kind, policy, planner, **parameters)
    return [item for item in findings if item.text.startswith("GPS loss")]


def all_found(kind, policy=LossCheck.WARN, planner=PLANNER, **parameters):
    values = dict.fromkeys(profile(kind).failsafe_parameters, 0.0)
    failsafes = profile(kind).failsafes(Parameters({**values, **SAFE[kind], **parameters}))
    findings = failsafe_findings(
        planner, failsafes, Supervision(failsafe_action=policy), PowerModel.of(VEHICLE)
    )
    assert {item.subject for item in findings} == {SUBJECT}
    return findings


def test_an_obstacle_below_a_critical_battery_landing_is_named_with_a_remedy():
    (finding,) = found(ARDUPILOT, BATT_FS_CRT_ACT=1.0, BATT_CRT_MAH=660.0, BATT_CAPACITY=3300.0)
    assert finding.level is WARNING
    assert finding.text.startswith("critical battery, BATT_FS_CRT_ACT 1 (land): it would hit ")
    assert "% of the plan to splice-inner" in finding.text
    assert "left-lower from 0% of the plan exit from splice-inner" in finding.text
    assert "; the companion flies the exit 30 s before, or to the nearest place" in finding.text
    assert finding.text.endswith("not where the charge falls below the threshold at once")
    assert finding.remedy == "set BATT_FS_CRT_ACT 0 (nothing)"


@pytest.mark.uncounted
@pytest.mark.parametrize(
    ("kind", "action", "threshold"),
    [
        (ARDUPILOT, "BATT_FS_LOW_ACT", {"BATT_LOW_VOLT": 14.0}),
        (ARDUPILOT, "BATT_FS_CRT_ACT", {"BATT_CRT_VOLT": 14.0}),
        (PX4, "COM_LOW_BAT_ACT", {}),
    ],
)
def test_the_rules_accept_the_remedy_for_a_battery_action_on_the_routes(kind, action, threshold):
    def of_battery(value):
        findings = found(kind, **{action: value, **threshold})
        return [item for item in findings if "battery" in item.text]

    assert {item.remedy.partition(" (")[0] for item in of_battery(2.0)} == {f"set {action} 0"}
    assert of_battery(0.0) == []
    objection = by_rule(kind, action, {action: 99.0, **threshold})
    assert " 0 (" in objection.remedy
    assert by_rule(kind, action, {action: 0.0, **threshold}).level is NOTE


@pytest.mark.parametrize("value", [3.0, 4.0])
def test_a_smart_return_is_judged_by_its_fallback(value):
    (finding,) = found(
        ARDUPILOT, BATT_FS_LOW_ACT=value, BATT_LOW_VOLT=14.0, RTL_ALT_M=15.0, RTL_CONE_SLOPE=3.0
    )[:1]
    assert finding.level is WARNING
    assert "it would hit" in finding.text


def test_an_altitude_hold_without_a_position_drifts_into_obstacles_beside():
    (finding,) = of_gps(ARDUPILOT, FS_EKF_ACTION=2.0)
    assert finding.level is WARNING
    assert finding.text.startswith(
        "GPS loss, FS_EKF_ACTION 2 (hold its height without a position): drifting up to 5.3 m it"
    )


def by_rule(kind, name, parameters):
    findings = parameter_findings(
        profile(kind),
        Parameters({**profile(kind).parameters.defaults, **parameters}),
        VEHICLE,
        LossCheck.WARN,
        ground_station_received=False,
    )
    return next(item for item in findings if item.subject == name)


def test_a_voltage_threshold_that_cannot_be_forecast_is_reported():
    (finding,) = found(ARDUPILOT, BATT_FS_CRT_ACT=1.0, BATT_CRT_VOLT=10.2)
    assert finding.level is WARNING
    assert "its time cannot be forecast without risk.cells" in finding.text


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


@pytest.mark.parametrize(
    ("policy", "level"), [(LossCheck.WARN, WARNING), (LossCheck.REFUSE, NO_GO)]
)
def test_a_blind_landing_on_a_conductor_is_named_in_the_last_line(policy, level):
    (finding,) = of_gps(PX4, policy=policy)
    assert finding.level is level
    assert finding.text.startswith(
        "GPS loss, COM_OBL_RC_ACT 0 (descend without a position): drifting up to 4.5 m it would hit"
    )
    assert finding.text.endswith("by 1.5 m before the landing: not enough everywhere")
    assert finding.closing == (
        "where GPS is lost (exit from splice-inner) the autopilot may hit left-lower"
    )


@pytest.mark.parametrize("policy", LossCheck)
def test_a_blind_landing_that_a_short_leg_prevents_is_a_warning_alone(policy):
    (finding,) = of_gps(PX4, policy=policy, planner=OUTSIDE)
    assert finding.level is WARNING
    assert finding.text.endswith("leaves at the loss of the fix, by 1.5 m before the landing")
    assert finding.closing == ""


def test_an_autopilot_that_stays_hits_no_obstacle():
    assert found(ARDUPILOT) == []
    open_site = replace(SITE, obstacles=())
    failsafes = profile(ARDUPILOT).failsafes(
        Parameters(dict.fromkeys(profile(ARDUPILOT).failsafe_parameters, 0.0))
    )
    (finding,) = failsafe_findings(
        Planner(open_site, VEHICLE), failsafes, Supervision(), PowerModel.of(VEHICLE)
    )
    assert finding.level is OK


def test_a_drift_is_checked_along_its_whole_path():
    """Beside a pole that is thinner than the drift, too."""
    failsafes = profile(PX4).failsafes(
        Parameters({**dict.fromkeys(profile(PX4).failsafe_parameters, 0.0), **SAFE[PX4]})
    )
    reach = PLANNER.maps.reach
    (of_gps,) = failsafes.of([Trigger.GPS_LOSS]).actions
    conductor = next(item for item in SITE.obstacles if item.name == "left-lower")
    x_m, z_m = conductor.position_m
    only = replace(failsafes, actions=(of_gps,))
    for aside_m in np.arange(0.0, of_gps.drift_m - 0.5, 0.5):
        place_m = np.array([(x_m + aside_m, z_m + 6.0)])
        assert exposed_places(only, reach, place_m, drifting=True)[0], aside_m


def test_without_a_home_a_return_is_not_taken_for_harmless():
    *_, finding = found(PX4, NAV_RCL_ACT=2.0)
    assert finding.level is WARNING
    assert finding.text.startswith("home is unknown")

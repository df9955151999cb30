"""Failsafe actions of PX4 and ArduPilot: by their parameters, and their collisions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from moar_companion.companion.safety.failsafe_paths import exposed_places, failsafe_hit
from moar_companion.mavlink.autopilots import profile
from moar_companion.mavlink.autopilots.ardupilot import ArduPilotReturn
from moar_companion.mavlink.autopilots.failsafe_actions import AutopilotAction, Trigger
from moar_companion.mavlink.autopilots.parameter_names import Parameters
from moar_companion.planner.free_distance import FreeDistance
from moar_companion.types import ARDUPILOT, PX4, UNKNOWN

from ..planner.problems import conductor, make_site

DEFAULTS = {kind: profile(kind).parameters.defaults for kind in (PX4, ARDUPILOT)}
REACH = FreeDistance.over(make_site(conductor(5.5, 4.5, name="wire")), 0.5)
ABOVE, BELOW, BESIDE = (5.5, 7.5), (5.5, 1.5), (9.5, 7.5)


def failsafes(kind, **parameters):
    found = profile(kind).failsafes(Parameters({**DEFAULTS[kind], **parameters}))
    assert found is not None
    return found


def actions(kind, trigger, **parameters):
    return [
        item.action for item in failsafes(kind, **parameters).actions if item.trigger is trigger
    ]


@pytest.mark.parametrize(
    ("trigger", "parameters", "action"),
    [
        (Trigger.CRITICAL_BATTERY, {}, AutopilotAction.NONE),
        (Trigger.CRITICAL_BATTERY, {"COM_LOW_BAT_ACT": 2.0}, AutopilotAction.LAND),
        (Trigger.CRITICAL_BATTERY, {"COM_LOW_BAT_ACT": 3.0}, AutopilotAction.RETURN),
        (Trigger.EMERGENCY_BATTERY, {"COM_LOW_BAT_ACT": 3.0}, AutopilotAction.LAND),
        (Trigger.RC_LOSS, {}, AutopilotAction.RETURN),
        (Trigger.RC_LOSS, {"NAV_RCL_ACT": 3.0}, AutopilotAction.LAND),
        (Trigger.RC_LOSS, {"NAV_RCL_ACT": 5.0}, AutopilotAction.FALL),
        (Trigger.RC_LOSS, {"COM_RCL_EXCEPT": 4.0}, None),
        (Trigger.GCS_LOSS, {}, AutopilotAction.NONE),
        (Trigger.GCS_LOSS, {"NAV_DLL_ACT": 3.0}, AutopilotAction.LAND),
        (Trigger.GCS_LOSS, {"NAV_DLL_ACT": 3.0, "COM_DLL_EXCEPT": 4.0}, None),
        (Trigger.GPS_LOSS, {"COM_OBL_RC_ACT": 5.0}, AutopilotAction.DESCEND),
        (Trigger.COMPANION_LOSS, {"COM_OBL_RC_ACT": 4.0}, AutopilotAction.LAND),
        (Trigger.COMPANION_LOSS, {}, AutopilotAction.RETURN),
        (Trigger.COMPANION_LOSS, {"NAV_RCL_ACT": 3.0}, AutopilotAction.LAND),
        (Trigger.COMPANION_LOSS, {"NAV_RCL_ACT": 5.0}, AutopilotAction.FALL),
        (Trigger.COMPANION_LOSS, {"NAV_RCL_ACT": 0.0}, AutopilotAction.RETURN),
    ],
)
def test_the_parameters_of_px4_set_its_failsafe_actions(trigger, parameters, action):
    assert actions(PX4, trigger, **parameters) == ([] if action is None else [action])


@pytest.mark.parametrize(
    ("trigger", "parameters", "action"),
    [
        (Trigger.LOW_BATTERY, {}, AutopilotAction.NONE),
        (Trigger.LOW_BATTERY, {"BATT_FS_LOW_ACT": 2.0}, AutopilotAction.RETURN),
        (Trigger.CRITICAL_BATTERY, {"BATT_FS_CRT_ACT": 1.0}, AutopilotAction.NONE),
        (
            Trigger.CRITICAL_BATTERY,
            {"BATT_FS_CRT_ACT": 1.0, "BATT_CRT_VOLT": 10.2},
            AutopilotAction.LAND,
        ),
        (Trigger.RC_LOSS, {}, AutopilotAction.RETURN),
        (Trigger.RC_LOSS, {"FS_THR_ENABLE": 3.0}, AutopilotAction.LAND),
        (Trigger.RC_LOSS, {"FS_THR_ENABLE": 7.0}, AutopilotAction.HOLD),
        (Trigger.RC_LOSS, {"FS_OPTIONS": 4.0}, None),
        (Trigger.GCS_LOSS, {}, AutopilotAction.NONE),
        (Trigger.GCS_LOSS, {"FS_GCS_ENABLE": 5.0, "FS_OPTIONS": 4.0}, AutopilotAction.LAND),
        (Trigger.GPS_LOSS, {}, AutopilotAction.DESCEND),
        (Trigger.GPS_LOSS, {"FS_EKF_ACTION": 2.0}, AutopilotAction.DRIFT),
        (Trigger.LOW_BATTERY, {"BATT_FS_LOW_ACT": 3.0}, AutopilotAction.RETURN),
        (Trigger.LOW_BATTERY, {"BATT_FS_LOW_ACT": 4.0}, AutopilotAction.LAND),
        (Trigger.RC_LOSS, {"FS_THR_ENABLE": 4.0}, AutopilotAction.RETURN),
        (Trigger.RC_LOSS, {"FS_THR_ENABLE": 5.0}, AutopilotAction.LAND),
        (Trigger.GCS_LOSS, {"FS_GCS_ENABLE": 3.0}, AutopilotAction.RETURN),
        (Trigger.GCS_LOSS, {"FS_GCS_ENABLE": 4.0}, AutopilotAction.LAND),
        (Trigger.COMPANION_LOSS, {}, AutopilotAction.HOLD),
    ],
)
def test_the_parameters_of_ardupilot_set_its_failsafe_actions(trigger, parameters, action):
    assert actions(ARDUPILOT, trigger, **parameters) == ([] if action is None else [action])


def test_dead_reckoning_counts_where_the_estimator_fuses_drag():
    for drag in ({"EK3_DRAG_MCOEF": 0.2}, {"EK3_DRAG_BCOEF_X": 16.0}):
        found = actions(ARDUPILOT, Trigger.GPS_LOSS, **drag)
        assert found == [AutopilotAction.RETURN, AutopilotAction.DESCEND]
    without = actions(ARDUPILOT, Trigger.GPS_LOSS, EK3_DRAG_MCOEF=0.001, EK3_DRAG_BCOEF_X=1.0)
    assert without == [AutopilotAction.DESCEND]


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_actions_are_unknown_before_all_parameters_are_received_or_given_up(kind):
    for name in profile(kind).failsafe_parameters:
        others = {key: value for key, value in DEFAULTS[kind].items() if key != name}
        assert profile(kind).failsafes(Parameters(others)) is None
        assert profile(kind).failsafes(Parameters({**others, name: None})) is not None
    assert profile(UNKNOWN).failsafes(Parameters({})) is None


def test_a_threshold_in_mah_is_converted_to_a_charge():
    found = failsafes(ARDUPILOT, BATT_FS_CRT_ACT=1.0, BATT_CRT_MAH=660.0, BATT_CAPACITY=3300.0).of(
        [Trigger.CRITICAL_BATTERY]
    )
    (item,) = found.actions
    assert (item.charge, item.voltage_v) == (pytest.approx(0.2), None)


def test_ardupilot_returns_at_its_altitude_below_a_cone():
    home = ArduPilotReturn(altitude_m=15.0, climb_m=0.0, slope=3.0)
    assert home.height_m(5.0, 100.0) == 15.0
    assert home.height_m(5.0, 2.0) == 6.0
    assert home.height_m(5.0, 1.0) == 5.0
    assert home.height_m(20.0, 1.0) == 20.0
    assert ArduPilotReturn(altitude_m=15.0, climb_m=2.0, slope=0.0).height_m(14.0, 1.0) == 16.0


@pytest.mark.parametrize(
    ("parameters", "expected"),
    [
        ({"NAV_RCL_ACT": 3.0}, [True, False, False]),
        ({"NAV_RCL_ACT": 2.0}, [False, True, False]),
        ({"NAV_RCL_ACT": 1.0}, [False, False, False]),
        ({"NAV_RCL_ACT": 5.0}, [True, False, False]),
    ],
)
def test_a_place_is_exposed_where_the_path_of_an_action_hits_a_wire(parameters, expected):
    found = failsafes(PX4, **parameters).of([Trigger.RC_LOSS])
    places = np.array([ABOVE, BELOW, BESIDE])
    assert exposed_places(found, REACH, places).tolist() == expected
    hit = failsafe_hit(found, REACH, places)
    if any(expected):
        assert hit is not None
        assert (hit[1].obstacle, hit[1].index) == ("wire", expected.index(True))
    else:
        assert hit is None


def test_a_return_is_checked_as_far_as_its_home():
    found = failsafes(PX4, NAV_RCL_ACT=2.0, RTL_RETURN_ALT=4.5, RTL_CONE_ANG=0.0)
    beside = np.array([(1.5, 2.5)])
    rc = found.of([Trigger.RC_LOSS])
    assert not exposed_places(rc, REACH, beside).any()
    assert exposed_places(replace(rc, home_m=(9.5, 0.0, 0.0)), REACH, beside).all()


def test_a_landing_from_within_a_keep_out_hits_the_obstacle_below():
    """The aircraft may descend into the obstacle; beside or below it the descent leaves it."""
    landing = failsafes(PX4, COM_LOW_BAT_ACT=2.0, COM_OBL_RC_ACT=5.0, NAV_RCL_ACT=1.0)
    reach = FreeDistance.over(make_site(conductor(5.5, 4.5, keep_out=0.9), resolution=0.1), 0.5)
    above_m = np.array([(5.5, 4.6 + 0.1 * n) for n in range(20)])
    beside_m = np.array([(5.5 + side_m, 4.2) for side_m in (-0.8, 0.8)])
    assert exposed_places(landing, reach, above_m).all()
    assert not exposed_places(landing, reach, beside_m).any()

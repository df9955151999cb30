"""The failsafe exposure: time to leave a place before a failsafe action hits an obstacle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from moar_companion.companion.safety.failsafe_exposure import FailsafeExposure
from moar_companion.companion.safety.failsafe_paths import STAYS, paths
from moar_companion.mavlink.autopilots import profile
from moar_companion.mavlink.autopilots.failsafe_actions import AutopilotAction, Trigger
from moar_companion.mavlink.autopilots.parameter_names import Parameters
from moar_companion.mavlink.telemetry import Battery, PeerHeartbeat, Telemetry
from moar_companion.planner.free_distance import FreeDistance
from moar_companion.risk.power import Meter, PowerModel
from moar_companion.settings.config import Supervision
from moar_companion.types import ARDUPILOT, PX4

from ..planner.problems import conductor, make_site, make_vehicle

REACH = FreeDistance.over(make_site(conductor(5.5, 4.5, name="wire")), 0.5)
ABOVE, BESIDE = (5.5, 0.0, 7.5), (9.5, 0.0, 7.5)
POWER = PowerModel.of(make_vehicle())
STATION = Telemetry(ground_station=PeerHeartbeat(system_id=255, received_s=0.0))
LANDS = {"COM_LOW_BAT_ACT": 2.0, "BAT_CRIT_THR": 0.3, "BAT_EMERGEN_THR": 0.1}


def watching(telemetry=STATION, kind=PX4, **parameters):
    watch = FailsafeExposure(Supervision(), POWER)
    parameters_read = Parameters({**profile(kind).parameters.defaults, **parameters})
    assert watch.learn(kind, parameters_read, None, telemetry)
    assert not watch.learn(kind, parameters_read, None, telemetry)
    return watch


def meter(charge):
    return Meter(left_wh=charge * POWER.capacity_wh)


def reason(watch, place_m, charge=1.0, *, leaving_s=0.0, now_s=0.0, limit_s=120.0, from_s=0.0):
    watch.update(place_m, REACH, STATION, meter(charge), now_s)
    return watch.reason(
        STATION, meter(charge), leaving_s=leaving_s, limit_s=limit_s, from_s=from_s, now_s=now_s
    )


def test_a_place_is_left_before_a_battery_action_by_reserve_and_exit_time():
    watch = watching(**LANDS)
    flight_s = POWER.capacity_wh / POWER.hover_w * 3600.0
    at = 0.3 + 50.0 / flight_s
    assert reason(watch, ABOVE, at) is None
    assert reason(watch, ABOVE, at, leaving_s=25.0) == "landing in 50 s hits wire"
    assert reason(watch, BESIDE, at, leaving_s=25.0) == "battery landing 50 s < 55"
    assert reason(watch, BESIDE, at) is None
    assert reason(watch, ABOVE, 0.2) == "landing in 0 s hits wire"


def test_an_unknown_escape_route_counts_as_a_long_one():
    assert reason(watching(**LANDS), ABOVE, 0.36, leaving_s=None) is not None


def test_a_place_exposed_to_a_link_loss_action_is_left_after_the_limit():
    watch = watching(NAV_DLL_ACT=3.0)
    assert reason(watch, ABOVE) is None
    assert watch.note(120.0, 0.0, 50.0) is None
    assert watch.note(120.0, 0.0, 61.0) == "GCS loss hits wire, exit in 59 s"
    assert watch.note(120.0, 0.0, 62.0) is None
    assert reason(watch, ABOVE, now_s=120.0) is None
    assert reason(watch, ABOVE, now_s=121.0) == "GCS loss hits wire: 121 s (120)"
    assert reason(watch, ABOVE, now_s=121.5, from_s=100.0) is None  # the next target


def test_only_a_longer_stay_at_a_safe_place_restarts_the_exposure_time():
    watch = watching(NAV_DLL_ACT=3.0)
    for now_s, place_m in ((0.0, ABOVE), (1.0, BESIDE), (2.0, ABOVE)):
        reason(watch, place_m, now_s=now_s)
    assert reason(watch, ABOVE, now_s=121.0) is not None
    reason(watch, BESIDE, now_s=124.0)
    assert reason(watch, ABOVE, now_s=130.0) is None


def test_a_remote_control_that_was_never_received_cannot_be_lost():
    watch = watching(Telemetry(), NAV_RCL_ACT=3.0)
    assert {item.trigger for item in watch.failsafes.actions} == {
        Trigger.GPS_LOSS,
        Trigger.COMPANION_LOSS,
    }


def test_a_ground_station_that_only_the_autopilot_receives_can_be_lost():
    """MAV_1_FORWARD 0: the ground station's heartbeats do not reach the companion."""
    watch = watching(Telemetry(), NAV_DLL_ACT=3.0)
    assert Trigger.GCS_LOSS in {item.trigger for item in watch.failsafes.actions}


@pytest.mark.parametrize("moved_m", [0.5, 2.0])
def test_a_moved_home_updates_the_failsafe_actions(moved_m):
    watch = watching(**LANDS)
    parameters_read = Parameters({**profile(PX4).parameters.defaults, **LANDS})
    assert watch.learn(PX4, parameters_read, (0.0, 0.0, 0.0), STATION)
    moved = watch.learn(PX4, parameters_read, (moved_m, 0.0, 0.0), STATION)
    assert moved is (moved_m > 1.0)
    assert replace(watch.failsafes).home_m == ((moved_m if moved else 0.0), 0.0, 0.0)


def test_a_predictable_battery_threshold_counts_beside_an_unpredictable_one():
    """ArduPilot's charge and voltage: without a number of cells only the charge has a time."""
    assert POWER.cells is None
    capacity = {"BATT_CAPACITY": 5000.0, "BATT_LOW_MAH": 1500.0, "BATT_LOW_VOLT": 19.8}
    watch = watching(kind=ARDUPILOT, BATT_FS_LOW_ACT=1.0, **capacity)
    at = 0.3 + 20.0 / (POWER.capacity_wh / POWER.hover_w * 3600.0)
    assert reason(watch, ABOVE, at) == "landing in 20 s hits wire"
    assert reason(watch, ABOVE, 1.0) is None
    assert reason(watch, ABOVE, 1.0, now_s=121.0) == "battery hits wire: 121 s (120)"


def test_a_hold_on_low_battery_counts_as_the_landing_on_critical_battery():
    """BRAKE on a low battery ends companion control; the critical battery then lands there."""
    watch = watching(
        kind=ARDUPILOT,
        BATT_CAPACITY=5000.0,
        BATT_LOW_MAH=3500.0,
        BATT_LOW_VOLT=0.0,
        BATT_FS_LOW_ACT=7.0,
        BATT_CRT_MAH=2000.0,
        BATT_FS_CRT_ACT=1.0,
    )
    flight_s = POWER.capacity_wh / POWER.hover_w * 3600.0
    assert reason(watch, ABOVE, 0.7 + 40.0 / flight_s) is None
    assert reason(watch, ABOVE, 0.7 + 20.0 / flight_s) == "landing in 20 s hits wire"
    assert reason(watch, BESIDE, 0.7 + 20.0 / flight_s) is None


def test_at_an_unknown_place_the_last_known_exposure_counts():
    watch = watching(NAV_DLL_ACT=3.0)
    assert reason(watch, ABOVE) is None
    assert reason(watch, None, now_s=121.0) == "GCS loss hits wire: 121 s (120)"


def test_in_the_first_seconds_beside_the_obstacle_the_reason_names_no_obstacle():
    watch = watching(NAV_DLL_ACT=3.0)
    assert reason(watch, ABOVE) is None
    assert reason(watch, ABOVE, now_s=120.0) is None
    assert reason(watch, BESIDE, now_s=121.0) == "failsafe hits obstacle: 121 s (120)"
    assert reason(watch, BESIDE, now_s=123.0) is None


# Voltage thresholds

FOUR_CELLS = PowerModel.of(replace(make_vehicle(), risk=replace(make_vehicle().risk, cells=4)))
LANDS_AT_14_V = {"BATT_FS_LOW_ACT": 1.0, "BATT_LOW_VOLT": 14.0, "BATT_LOW_MAH": 0.0}


def voltage_reason(power, voltage_v, charge, *, place_m=ABOVE, leaving_s=0.0):
    """The reason beside a battery that lands the aircraft at 14 V, without a charge threshold."""
    battery = Battery(
        received_s=0.0, remaining=None, voltage_v=voltage_v, current_a=None, charge_state=None
    )
    telemetry = Telemetry(ground_station=STATION.ground_station, batteries={0: battery})
    watch = FailsafeExposure(Supervision(), power)
    parameters = Parameters(profile(ARDUPILOT).parameters.defaults | LANDS_AT_14_V)
    assert watch.learn(ARDUPILOT, parameters, None, telemetry)
    left = Meter(left_wh=charge * power.capacity_wh)
    watch.update(place_m, REACH, telemetry, left, 0.0)
    return watch.reason(telemetry, left, leaving_s=leaving_s, limit_s=120.0, from_s=0.0, now_s=0.0)


def test_a_voltage_near_its_threshold_counts_as_reached():
    """A climb makes a cell sag by 3 %."""
    assert voltage_reason(POWER, 14.5, 1.0) is None
    assert voltage_reason(POWER, 14.4, 1.0) == "landing in 0 s hits wire"


def test_a_voltage_threshold_far_away_has_no_time_without_the_number_of_cells():
    assert voltage_reason(POWER, 16.0, 0.3) is None
    assert voltage_reason(POWER, 16.0, 0.3, place_m=BESIDE, leaving_s=60.0) is None


def test_a_voltage_threshold_has_a_time_with_the_number_of_cells():
    # 3.5 V a cell are 2/7 of the way from 3.4 V to 3.75 V.
    flight_s = FOUR_CELLS.capacity_wh / FOUR_CELLS.hover_w * 3600.0
    at = 2.0 / 7.0 + 20.0 / flight_s
    assert voltage_reason(FOUR_CELLS, 16.0, at) == "landing in 20 s hits wire"
    assert voltage_reason(FOUR_CELLS, 16.0, at + 20.0 / flight_s) is None


def test_the_voltage_of_a_port_without_a_battery_does_not_count():
    assert voltage_reason(POWER, 0.4, 1.0) is None


def test_an_action_without_a_path_of_its_own_counts_as_a_return():
    """As one that a new autopilot adds: without its home a return is a climb."""
    places_m = np.array([[5.5, 7.5], [9.5, 7.5]])
    added = object()
    (climb,) = paths(added, None, REACH, places_m, None)
    for starts_m, ends_m in (climb, *paths(AutopilotAction.RETURN, None, REACH, places_m, None)):
        assert starts_m.tolist() == places_m.tolist()
        assert ends_m[:, 1].tolist() == [REACH.grid.upper_m[1]] * 2
    assert [paths(action, None, REACH, places_m, None) for action in STAYS] == [[], []]

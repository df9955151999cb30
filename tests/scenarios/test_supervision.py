"""The supervisor in flight, with both autopilots: hold, resume, escape route in time."""

from __future__ import annotations

import pytest

from moar_companion.settings.config import LinkLoss, Supervision
from sitl.conditions import GPS_NO_FIX

from ..copies import flown_once
from ..flights.judging import (
    assert_nothing_was_touched,
    assert_setpoints_keep_to_free_space,
    assert_setpoints_never_jump,
)
from ..flights.lockstep import hovering
from ..flights.operator import INSPECTION, TEMPORARILY_REJECTED, Manner
from .marks import ARDUPILOT_FIRST, BOTH, PX4_FIRST

NO_FAILSAFE_OF_ITS_OWN = {
    Manner.PX4: {"COM_LOW_BAT_ACT": 0, "NAV_DLL_ACT": 0},
    Manner.ARDUPILOT: {"BATT_LOW_VOLT": 0.0, "BATT_FS_LOW_ACT": 0, "FS_GCS_ENABLE": 0},
}


@flown_once
def in_flight(manner, seconds=6.0, **options):
    flight = hovering(
        manner=manner, options={"parameters": NO_FAILSAFE_OF_ITS_OWN[manner]}, **options
    )
    flight.begin(INSPECTION, 0)
    flight.run(seconds)
    assert flight.state == "flying"
    return flight


def judge(flight):
    assert_nothing_was_touched(flight)
    assert_setpoints_never_jump(flight)
    assert_setpoints_keep_to_free_space(flight)


def flown(flight):
    return flight.companion.status.task.mission.value


@pytest.mark.slow
@PX4_FIRST
def test_wind_above_the_limit_holds_the_inspection_which_then_resumes(manner):
    flight = in_flight(manner, supervision=Supervision(wind_limit_mps=7.0))
    conditions = flight.autopilot.conditions
    conditions.wind_mps, conditions.wind_from_deg = 10.0, 270.0
    flight.run_until_state("holding", 20.0)
    flight.run(5.0)
    assert flight.operator.has_received("MOAR: wind")
    assert flight.state == "holding"
    conditions.wind_mps = 1.0
    flight.run_until_state("flying", 40.0)
    flight.run(5.0)
    assert flight.state == "flying"
    judge(flight)


@pytest.mark.slow
@ARDUPILOT_FIRST
def test_a_battery_at_its_reserve_makes_the_aircraft_exit_to_above_the_landing_point(manner):
    flight = in_flight(manner)
    flight.autopilot.conditions.battery_percent = 19.0
    flight.run_until(lambda: flown(flight) == "exit", 15.0)
    flight.run_until_state("holding", 180.0)
    assert flight.companion.status.task.done
    judge(flight)


@pytest.mark.slow
@BOTH
def test_a_battery_that_becomes_critical_on_the_exit_begins_an_evacuation(manner):
    """ArduPilot reports a failsafe even without an action."""
    flight = in_flight(manner)
    if manner is Manner.ARDUPILOT:
        flight.autopilot.set_parameter("BATT_FS_CRT_ACT", 0)
        flight.autopilot.set_parameter("BATT_CRT_MAH", 500)
    flight.autopilot.conditions.battery_percent = 19.0
    flight.run_until(lambda: flown(flight) == "exit", 15.0)
    flight.run(1.0)
    flight.autopilot.conditions.battery_percent = 6.0
    flight.run_until(lambda: flown(flight) == "evacuation", 15.0)
    assert flight.operator.has_received("MOAR: battery 0 is critical, evacuating")
    flight.run_until_state("landing_leg", 60.0)
    assert flown(flight) == "evacuation"
    # The aircraft turns round on the landing leg of the exit, a little outside the workspace.
    assert_nothing_was_touched(flight)
    assert_setpoints_never_jump(flight)


@pytest.mark.slow
@BOTH
def test_a_receiver_that_loses_its_fix_holds_the_mission_until_the_autopilot_acts(manner):
    flight = in_flight(manner)
    flight.autopilot.conditions.gps_mode = GPS_NO_FIX
    flight.run_until_state("holding", 4.0)
    flight.run(0.2)
    assert flight.operator.has_received("MOAR: GNSS receiver has no 3D fix")
    flight.run(0.6)
    held_s = flight.now_s
    flight.run_until_state("released", 20.0)
    flight.run(0.2)
    assert flight.operator.has_received("MOAR: failsafe chose")
    held = [item.message for item in flight.setpoints if item.time_s > held_s]
    assert all((m.vx, m.vy, m.vz) == (0.0, 0.0, 0.0) for m in held)
    assert_nothing_was_touched(flight)
    assert_setpoints_never_jump(flight)


@pytest.mark.slow
@PX4_FIRST
@pytest.mark.parametrize("action", [LinkLoss.HOLD, LinkLoss.EXIT])
def test_the_loss_of_the_ground_station_has_the_configured_action(manner, action):
    limits = Supervision(ground_link_lost_s=3.0, ground_link_action=action)
    flight = in_flight(manner, supervision=limits)
    flight.operator.silent = True
    flight.run(5.0)
    if action is LinkLoss.HOLD:
        assert flight.state == "holding"
        flight.operator.silent = False
        flight.run(4.0)
        assert (flight.state, flown(flight)) == ("flying", "inspection")
    else:
        assert (flight.state, flown(flight)) == ("flying", "exit")
        flight.run(3.0)
        assert flown(flight) == "exit"
    judge(flight)


@BOTH
def test_an_inspection_is_rejected_where_a_condition_would_hold_it_at_once(manner):
    flight = hovering(manner=manner, supervision=Supervision(battery_reserve=0.99))
    flight.run(5.0)
    flight.operator.mission(INSPECTION)
    flight.run(0.5)
    assert flight.operator.answers()[-1] == TEMPORARILY_REJECTED
    assert flight.operator.has_received("% <= 99%, rejected")
    assert not flight.setpoints

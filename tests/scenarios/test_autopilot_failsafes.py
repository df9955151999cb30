"""Failsafes that ArduPilot reports while GUIDED stays on; lost links that end GUIDED."""

from __future__ import annotations

import pytest

from moar_companion.settings.config import Authority

from ..copies import flown_once
from ..flights.judging import assert_nothing_was_touched, assert_setpoints_keep_to_free_space
from ..flights.lockstep import hovering
from ..flights.operator import (
    ACCEPTED,
    EVACUATION,
    EXIT,
    INSPECTION,
    RELEASE,
    TEMPORARILY_REJECTED,
    Manner,
)

WARNS = {"BATT_LOW_VOLT": 11.4, "BATT_FS_LOW_ACT": 0, "BATT_CRT_VOLT": 0.0, "BATT_LOW_TIMER": 1}
"""A low battery is reported without an action, as by default."""
GOES_ON = {"FS_THR_ENABLE": 1, "FS_OPTIONS": 4}
"""A lost remote control does not end GUIDED."""
LOW_V = 11.0


def guided(**options):
    return hovering(vehicle="x500", manner=Manner.ARDUPILOT, **options)


@flown_once
def in_flight(seconds=3.0, **options):
    flight = guided(**options)
    flight.begin(INSPECTION)
    flight.run(seconds)
    assert flight.state == "flying"
    return flight


def statuses(flight, since_s=0.0):
    return {
        message.system_status
        for message in flight.operator.received
        if message.get_type() == "HEARTBEAT" and message.get_srcComponent() == 1
    }


def states_since(flight, time_s):
    return {state for at_s, state in flight.states if at_s > time_s}


@pytest.mark.slow
def test_a_low_battery_without_an_action_does_not_end_the_escape_route():
    """From the inner position, flown to its end in system status 5."""
    flight = guided(options={"parameters": WARNS}, start_m=(15.0, 0.0))
    flight.begin(INSPECTION, 1)
    flight.run_until_state("at_target", 120.0)
    flight.operator.mission(EVACUATION)
    flight.run_until_state("flying", 2.0)
    ordered_s = flight.now_s
    flight.autopilot.conditions.battery_voltage_v = LOW_V
    flight.run_until_state("holding", 120.0)
    assert 5 in statuses(flight)
    assert states_since(flight, ordered_s) == {"flying", "landing_leg", "holding"}
    assert flight.operator.in_mode("ours")
    assert_nothing_was_touched(flight)
    assert_setpoints_keep_to_free_space(flight)


@pytest.mark.slow
def test_a_low_battery_without_an_action_ends_an_inspection_with_an_exit():
    flight = in_flight(options={"parameters": WARNS})
    low_s = flight.now_s
    flight.autopilot.conditions.battery_voltage_v = LOW_V
    flight.run_until(
        lambda: flight.operator.has_received("MOAR: autopilot battery failsafe, exiting"), 5.0
    )
    flight.run_until_state("landing_leg", 60.0)
    assert "released" not in states_since(flight, low_s)
    flight.operator.mission(INSPECTION)
    flight.run(0.5)
    assert flight.operator.answers()[-1] == TEMPORARILY_REJECTED
    assert flight.state == "landing_leg"


@pytest.mark.slow
def test_an_rc_loss_that_does_not_end_guided_holds_the_mission_which_then_resumes():
    flight = in_flight(options={"parameters": GOES_ON})
    lost_s = flight.now_s
    flight.autopilot.set_parameter("SIM_RC_FAIL", 1)
    flight.run_until_state("holding", 5.0)
    flight.run(3.0)
    assert flight.operator.has_received("MOAR: failsafe: RC, holding")
    assert flight.operator.in_mode("ours")
    flight.operator.mission(INSPECTION)
    flight.run(0.5)
    assert flight.operator.answers()[-1] == TEMPORARILY_REJECTED
    flight.autopilot.set_parameter("SIM_RC_FAIL", 0)
    flight.run_until_state("flying", 8.0)
    assert "released" not in states_since(flight, lost_s)


@pytest.mark.slow
def test_an_exit_goes_on_without_a_remote_control():
    flight = in_flight(options={"parameters": GOES_ON})
    flight.autopilot.set_parameter("SIM_RC_FAIL", 1)
    flight.run_until_state("holding", 5.0)
    flight.run(1.0)
    flight.operator.mission(EXIT)
    flight.run_until_state("flying", 2.0)
    ordered_s = flight.now_s
    flight.run_until_state("landing_leg", 60.0)
    assert flight.operator.answers()[-1] == ACCEPTED
    assert states_since(flight, ordered_s) <= {"flying", "landing_leg"}


def test_a_release_in_the_companions_mode_ends_with_a_setpoint_at_rest():
    flight = in_flight(options={"parameters": GOES_ON})
    flight.autopilot.set_parameter("SIM_RC_FAIL", 1)
    flight.run_until(lambda: 5 in statuses(flight), 3.0)
    flight.deaf = True
    flight.run_until_state("released", 3.0)
    assert flight.operator.in_mode("ours")
    last = flight.setpoints[-1].message
    assert (last.vx, last.vy, last.vz) == (0.0, 0.0, 0.0)


def test_a_pilot_who_takes_over_during_a_failsafe_has_overridden():
    flight = in_flight(options={"parameters": WARNS})
    flight.autopilot.conditions.battery_voltage_v = LOW_V
    flight.run_until(lambda: 5 in statuses(flight), 5.0)
    flight.run(2.0)
    took_s = flight.now_s
    flight.autopilot.move_sticks()
    flight.operator.mode("hold")
    flight.run(2.0)
    assert flight.state == "overridden"
    assert flight.last_setpoint_s <= took_s + 0.2


def test_a_landing_ordered_during_a_failsafe_is_not_reported_as_the_failsafes():
    flight = in_flight(options={"parameters": WARNS})
    flight.autopilot.conditions.battery_voltage_v = LOW_V
    flight.run_until(lambda: 5 in statuses(flight), 5.0)
    flight.run(3.0)
    flight.operator.mode("land")
    flight.run_until_state("released", 2.0)
    flight.run(0.1)
    assert flight.operator.has_received("MOAR: autopilot in LAND, released")
    assert not flight.operator.has_received("failsafe chose")


@pytest.mark.slow
def test_a_landing_that_a_second_failsafe_chooses_is_reported_as_the_failsafes():
    critical = WARNS | {"BATT_CRT_VOLT": LOW_V - 1.0, "BATT_FS_CRT_ACT": 1}
    flight = in_flight(options={"parameters": critical})
    flight.autopilot.conditions.battery_voltage_v = LOW_V
    flight.run_until(lambda: 5 in statuses(flight), 5.0)
    flight.run(3.0)
    flight.autopilot.conditions.battery_voltage_v = LOW_V - 2.0
    flight.run_until_state("released", 10.0)
    flight.run(0.1)
    assert flight.operator.has_received("MOAR: failsafe chose LAND, released")


# Lost links -------------------------------------------------------------------------------------

ACTS = {
    Manner.PX4: {"NAV_DLL_ACT": 1, "NAV_RCL_ACT": 1},
    Manner.ARDUPILOT: {"FS_GCS_ENABLE": 7, "FS_THR_ENABLE": 7},
}
"""A lost ground station or remote control holds or brakes."""
CHOSEN = {Manner.PX4: "HOLD", Manner.ARDUPILOT: "BRAKE"}


def lose_ground_station(flight):
    flight.operator.silent = True


def lose_sticks(flight):
    if flight.operator.manner is Manner.PX4:
        flight.autopilot.move_sticks()
        flight.run(1.0)
        flight.autopilot.no_sticks()
    else:
        flight.autopilot.set_parameter("SIM_RC_FAIL", 1)


@pytest.mark.slow
@pytest.mark.parametrize("manner", Manner)
@pytest.mark.parametrize(
    ("lose", "within_s"), [(lose_ground_station, 12.0), (lose_sticks, 3.0)], ids=["gcs", "rc"]
)
def test_a_lost_link_that_the_autopilot_acts_on_releases(manner, lose, within_s):
    flight = hovering(vehicle="x500", manner=manner, options={"parameters": ACTS[manner]})
    flight.begin(INSPECTION, 1)
    flight.run(3.0)
    lose(flight)
    flight.run_until_state("released", within_s)
    flight.run(0.1)
    assert flight.operator.has_received(f"MOAR: failsafe chose {CHOSEN[manner]}, released")
    assert not flight.operator.in_mode("ours")
    assert_nothing_was_touched(flight)


# Orders -----------------------------------------------------------------------------------------


@pytest.mark.slow
def test_guided_during_a_landing_counts_as_in_the_air_while_the_landing_is_still_reported():
    """EXTENDED_SYS_STATE reports a landing for 40 to 110 ms after its end."""
    flight = guided()
    flight.begin(INSPECTION)
    flight.run(4.0)
    flight.operator.mode("land")
    flight.run(1.5)
    flight.operator.mode("ours")
    flight.run(0.06)
    flight.operator.mission(EXIT)
    flight.run(1.0)
    assert flight.operator.answers()[-1] == ACCEPTED
    assert flight.state in {"flying", "landing_leg"}


def test_an_order_that_a_newer_order_overtakes_is_cancelled_with_a_text():
    flight = in_flight()
    flight.plan_delay_s = 1.0
    flight.operator.mission(INSPECTION, 0)
    flight.run(0.3)
    flight.operator.mission(EXIT)
    flight.run(3.0)
    assert flight.operator.has_received("MOAR: replaced by a newer order, cancelled")


@pytest.mark.parametrize("manner", Manner)
def test_an_offered_hold_that_is_released_leaves_later_orders_their_mode(manner):
    flight = hovering(vehicle="x500", manner=manner, authority=Authority.ENGAGE)
    flight.autopilot.move_sticks()
    flight.operator.mode("hold")
    flight.run(1.5)
    flight.operator.mission(INSPECTION)
    flight.run_until_state("ready", 2.0)
    flight.operator.mission(RELEASE)
    flight.run(1.0)
    assert flight.state == "released"
    flight.operator.mission(EVACUATION)
    flight.run_until_state("flying", 10.0)
    assert flight.operator.in_mode("ours")

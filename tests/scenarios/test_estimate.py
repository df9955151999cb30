"""Position jumps and resets, and late or missing plans, with both autopilots."""

from __future__ import annotations

import itertools
import math

import pytest

from sitl.conditions import GPS_SILENT

from ..copies import flown_once
from ..flights.judging import assert_nothing_was_touched, assert_setpoints_keep_to_free_space
from ..flights.lockstep import hovering
from ..flights.operator import INSPECTION, Manner
from .marks import ARDUPILOT_FIRST, PX4_FIRST


@flown_once
def in_flight(manner=Manner.PX4, seconds=4.0, target=0):
    flight = hovering(manner=manner)
    flight.begin(INSPECTION, target)
    flight.run(seconds)
    assert flight.state == "flying"
    return flight


def jumps_m(flight):
    """Jumps of the position as the companion has detected them, in metres."""
    return [
        math.hypot(*decision.data["jump_m"])
        for decision in flight.decisions
        if decision.kind == "jump"
    ]


def judge_what_was_flown(flight, began_s):
    """Asserts that after a jump the aircraft returns to its path slowly."""
    fastest_mps = max(
        math.hypot(*truth.velocity_ned_mps)
        for truth in flight.truths
        if began_s <= truth.time_s <= began_s + 1.2
    )
    speed = flight.vehicle.speed
    assert fastest_mps < speed.horizontal_mps + speed.min_mps + 0.6
    assert_nothing_was_touched(flight)


@pytest.mark.slow
@PX4_FIRST
def test_a_position_jump_moves_the_setpoint_and_the_inspection_continues(manner):
    flight, east_m = in_flight(manner), 1.2
    began_s = flight.now_s
    flight.autopilot.jump(0.0, east_m)
    flight.run(1.2)
    assert jumps_m(flight) == [pytest.approx(east_m, abs=0.1)]
    assert flight.state == "flying"
    judge_what_was_flown(flight, began_s)
    flight.run(6.0)
    assert flight.state == "flying"
    assert_setpoints_keep_to_free_space(flight)


@pytest.mark.slow
@ARDUPILOT_FIRST
def test_a_jump_beyond_the_limit_holds_until_an_operator_orders_again(manner):
    flight = in_flight(manner)
    began_s = flight.now_s
    flight.autopilot.jump(0.0, -3.4)
    flight.run(1.2)
    assert flight.state == "holding"
    limit_m = {Manner.PX4: "1.4", Manner.ARDUPILOT: "0.5"}[manner]
    assert flight.operator.has_received(f"MOAR: the position jumped 3.4 m > {limit_m}")
    judge_what_was_flown(flight, began_s)
    flight.run(11.0)
    assert flight.state == "holding"
    flight.operator.go_on()
    flight.run_until_state("flying", 1.0)
    flight.run(2.0)
    assert flight.state == "flying"


@pytest.mark.slow
def test_a_small_reset_is_detected_only_by_the_estimators_reset_counter():
    """PX4 counts resets in ODOMETRY; an ArduPilot flies the same step back."""
    flight = in_flight()
    flight.autopilot.jump(0.3, 0.0)
    flight.run(1.0)
    assert jumps_m(flight) == [pytest.approx(0.3, abs=0.1)]
    other = in_flight(Manner.ARDUPILOT)
    other.autopilot.jump(0.3, 0.0)
    other.run(1.0)
    assert jumps_m(other) == []
    assert (flight.state, other.state) == ("flying", "flying")


@pytest.mark.slow
def test_a_reset_that_moves_nothing_is_no_jump():
    flight = in_flight()
    flight.autopilot.jump(0.0, 0.0)
    flight.run(1.0)
    assert jumps_m(flight) == []


@pytest.mark.slow
def test_a_receiver_that_repeats_its_last_values_holds_until_the_autopilot_acts():
    """ArduPilot repeats the last good values of a failed receiver for 4 s."""
    flight = in_flight(Manner.ARDUPILOT)
    flight.autopilot.conditions.gps_mode = GPS_SILENT
    flight.run_until_state("holding", 4.0)
    flight.run(0.2)
    assert flight.operator.has_received("MOAR: GNSS receiver stopped")
    flight.run_until_state("released", 20.0)
    flight.run(0.2)
    assert flight.operator.has_received("MOAR: failsafe chose LAND, released")
    assert_nothing_was_touched(flight)


@pytest.mark.slow
def test_a_planner_that_falls_silent_slows_the_flight_and_then_holds_it():
    flight = in_flight(Manner.ARDUPILOT, 1.0, target=1)
    flight.planning = False
    flight.run_until(lambda: flight.operator.has_received("MOAR: no new plan"), 15.0)
    assert flight.state == "flying"
    flight.run_until_state("holding", 10.0)
    flight.run(2.0)
    assert flight.state == "holding"
    flight.planning = True
    flight.run(5.0)
    assert flight.state == "holding"
    flight.operator.go_on()
    flight.run_until_state("flying", 1.0)
    flight.run(2.0)
    assert flight.state == "flying"
    assert_nothing_was_touched(flight)


@pytest.mark.slow
def test_a_planner_that_is_late_leaves_no_gap_in_the_stream():
    flight = in_flight(Manner.PX4, 1.0)
    flight.plan_delay_s = 1.5
    flight.run(10.0)
    assert flight.state == "flying"
    times = [item.time_s for item in flight.setpoints]
    assert max(after - before for before, after in itertools.pairwise(times)) < 0.05
    assert_nothing_was_touched(flight)

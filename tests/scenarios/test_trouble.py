"""Trouble in flight: pilots, failsafes, links and gusts; released control stays released."""

from __future__ import annotations

import math

import pytest

from sitl.conditions import GPS_NO_FIX

from ..copies import copy_of, flown_once
from ..flights.judging import (
    assert_nothing_was_touched,
    assert_setpoints_keep_to_free_space,
    assert_setpoints_never_jump,
    least_true_clearance_m,
    true_places,
)
from ..flights.lockstep import Lockstep, hovering
from ..flights.operator import (
    ACCEPTED,
    EVACUATION,
    INSPECTION,
    RELEASE,
    TEMPORARILY_REJECTED,
    Manner,
)
from ..thorough import sampled
from .marks import ARDUPILOT_FIRST, BOTH, PX4_FIRST

LANDS_WHEN_LOW = {
    Manner.PX4: {},
    Manner.ARDUPILOT: {"BATT_LOW_VOLT": 11.4, "BATT_FS_LOW_ACT": 1},
}
"""PX4 acts on a low battery by default; for ArduPilot the parameters are set."""
LOW_PERCENT = {Manner.PX4: 6.0, Manner.ARDUPILOT: 40.0}

CLEARED_S = 12.0
"""Every condition has cleared by then: the slowest takes 10 s."""
MODE_LAG_S = 0.2
"""PX4 reports the mode twenty times a second, ArduPilot at once."""


@flown_once
def in_flight(seconds=3.0, **options):
    flight = hovering(vehicle="x500", **options)
    flight.begin(INSPECTION)
    flight.run(seconds)
    assert flight.state == "flying"
    return flight


def silent_since(flight, began_s, lag_s=MODE_LAG_S):
    return flight.last_setpoint_s <= began_s + lag_s


@pytest.mark.slow
@pytest.mark.parametrize(("mode", "manner"), [("position", Manner.PX4), ("hold", Manner.ARDUPILOT)])
def test_a_pilot_who_takes_over_keeps_control_even_after_giving_the_mode_back(mode, manner):
    flight = in_flight(manner=manner)
    flight.autopilot.move_sticks()
    flight.run(0.2)
    took = flight.now_s
    flight.operator.mode(mode)
    flight.run(2.0)
    assert flight.operator.in_mode(mode)
    for _ in range(3):
        flight.operator.mode("ours")
        flight.run(2.0)
        assert flight.state == "overridden"
    # PX4 gives OFFBOARD to a stream only; ArduPilot holds in GUIDED.
    assert flight.operator.in_mode(mode if manner is Manner.PX4 else "ours")
    assert silent_since(flight, took)
    flight.operator.mission(EVACUATION)
    flight.give_mode()
    flight.run(3.0)
    assert flight.state in {"flying", "landing_leg"}
    assert_nothing_was_touched(flight)
    assert_setpoints_never_jump(flight)


@pytest.mark.slow
def test_the_sticks_take_over_where_the_autopilot_is_configured_for_it():
    flight = in_flight(options={"parameters": {"COM_RC_OVERRIDE": 3}})
    flight.autopilot.move_sticks()
    flight.run(1.0)
    took = flight.now_s
    flight.autopilot.move_sticks(roll=0.8)
    flight.run(1.0)
    flight.autopilot.move_sticks()
    flight.run(2.0)
    assert (flight.truth.mode, flight.state) == ("POSCTL", "overridden")
    assert silent_since(flight, took, 1.2)


@ARDUPILOT_FIRST
def test_after_a_release_by_the_operator_no_setpoint_is_sent(manner):
    flight = in_flight(manner=manner)
    flight.operator.mission(RELEASE)
    flight.run(0.2)
    assert flight.state == "released"
    last = flight.setpoints[-1].message
    assert (last.vx, last.vy, last.vz) == (0.0, 0.0, 0.0)
    released = flight.now_s
    flight.run(6.0)
    assert silent_since(flight, released, 0.0)
    # PX4 leaves OFFBOARD without a stream; ArduPilot holds in GUIDED.
    assert flight.operator.in_mode("ours") is (manner is Manner.ARDUPILOT)


@pytest.mark.slow
@BOTH
def test_a_lost_position_releases_and_its_return_starts_no_stream(manner):
    flight = in_flight(manner=manner)
    flight.autopilot.conditions.gps_mode = GPS_NO_FIX
    flight.run_until_state("released", 20.0)
    released = flight.now_s
    flight.run(1.0)
    flight.autopilot.conditions.gps_mode = 0
    flight.run(CLEARED_S)
    assert flight.state == "released"
    assert silent_since(flight, released, 0.0)
    assert not flight.operator.in_mode("ours")


@pytest.mark.slow
@ARDUPILOT_FIRST
def test_on_a_critical_battery_the_autopilot_acts_and_only_a_new_order_starts_a_stream(manner):
    flight = in_flight(manner=manner, options={"parameters": LANDS_WHEN_LOW[manner]})
    flight.autopilot.conditions.battery_percent = LOW_PERCENT[manner]
    flight.run_until_state("released", 20.0)
    released = flight.now_s
    flight.run(4.0)
    assert silent_since(flight, released, 0.0)
    # The operator stops the landing and orders the planned evacuation.
    flight.operator.mode("hold")
    flight.run_until(lambda: flight.truth.landed_state == 2, 5.0)
    flight.run(2.0)
    flight.operator.mission(EVACUATION)
    flight.run_until_state("ready", 2.0)
    assert flight.operator.answers()[-1] == ACCEPTED
    flight.run(1.0)
    assert flight.last_setpoint_s == pytest.approx(flight.now_s)


@pytest.mark.slow
@PX4_FIRST
def test_a_critical_battery_stays_critical_when_the_charge_recovers(manner):
    flight = in_flight(manner=manner, options={"parameters": LANDS_WHEN_LOW[manner]})
    flight.autopilot.conditions.battery_percent = LOW_PERCENT[manner]
    flight.run_until_state("released", 20.0)
    released = flight.now_s
    flight.run(2.0)
    flight.autopilot.conditions.battery_percent = 60.0
    flight.run(CLEARED_S)
    assert flight.state in {"released", "idle"}
    assert silent_since(flight, released, 0.0)


@pytest.mark.slow
@PX4_FIRST
def test_a_link_cut_in_both_directions_ends_the_stream_even_after_the_link_returns(manner):
    flight = in_flight(manner=manner)
    cut = flight.now_s
    flight.cut = True
    flight.run(2.0)
    assert flight.state == "released"
    assert silent_since(flight, cut, 0.6)
    flight.cut = False
    flight.run(CLEARED_S)
    assert flight.state in {"released", "idle"}
    assert silent_since(flight, cut, 0.6)
    # PX4 leaves OFFBOARD without a stream; ArduPilot holds in GUIDED.
    assert flight.operator.in_mode("ours") is (manner is Manner.ARDUPILOT)


@ARDUPILOT_FIRST
def test_a_link_cut_towards_the_companion_alone_ends_the_stream(manner):
    flight = in_flight(manner=manner)
    cut = flight.now_s
    flight.deaf = True
    flight.run(2.0)
    assert flight.state == "released"
    assert silent_since(flight, cut, 0.6)
    flight.deaf = False
    flight.run(CLEARED_S)
    assert silent_since(flight, cut, 0.6)


@ARDUPILOT_FIRST
def test_an_autopilot_restart_in_flight_releases(manner):
    flight = in_flight(manner=manner)
    flight.autopilot.reboot()
    rebooted = flight.now_s
    flight.run(CLEARED_S)
    assert flight.state in {"released", "idle"}
    assert silent_since(flight, rebooted, 0.8)
    flight.operator.mission(INSPECTION)
    flight.run(1.0)
    assert flight.operator.answers()[-1] == TEMPORARILY_REJECTED


# Gusts ------------------------------------------------------------------------------------------


@flown_once
def under_way():
    flight = hovering()
    flight.begin(INSPECTION)
    flight.run(12.0)
    return flight


GUSTS = [
    ("120kv_single_circuit", 0.0),
    ("315kv_double_circuit", 0.0),  # across the plane
    ("horizontal_three_conductors", 270.0),
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("site", "from_deg"),
    sampled(GUSTS[:1], GUSTS),
)
def test_a_gust_delays_the_aircraft_and_does_not_end_the_mission(site, from_deg):
    calm = hovering(site=site)
    calm.begin(INSPECTION, 0)
    calm.run(8.0)
    flight = copy_of(calm)
    calm.run_until_state("at_target", 120.0)
    flight.run_in_wind(12.0, from_deg, 8.0)
    flight.run_until_state("at_target", 120.0)
    assert calm.now_s < flight.now_s < calm.now_s + 20.0
    assert_nothing_was_touched(flight)
    assert_setpoints_never_jump(flight)
    assert_setpoints_keep_to_free_space(flight)


@pytest.mark.slow
def test_while_a_gust_blows_the_aircraft_out_of_the_plane_the_setpoint_waits_in_the_plane():
    flight = under_way()
    flight.run_in_wind(16.0, 0.0, 8.0)
    assert max(abs(y) for _, y, _ in true_places(flight)) > 2.0
    flight.run_until_state("at_target", 60.0)
    assert_nothing_was_touched(flight)
    assert_setpoints_never_jump(flight)
    assert_setpoints_keep_to_free_space(flight)


@pytest.mark.slow
def test_a_gust_into_a_keep_out_moves_no_setpoint_into_the_keep_out():
    flight = under_way()
    flight.run_in_wind(16.0, 90.0, 8.0)  # from the outer side towards the conductors
    assert [d for d in flight.decisions if "off the path" in d.data.get("reason", "")]
    flight.run_until_state("at_target", 60.0)
    assert_setpoints_never_jump(flight)
    assert_setpoints_keep_to_free_space(flight)


@pytest.mark.slow
def test_blown_off_where_there_is_room_the_mission_is_planned_again_from_the_new_place():
    flight = under_way()
    flight.run_in_wind(16.0, 270.0, 8.0)  # away from the conductors
    assert [d for d in flight.decisions if "off the path" in d.data.get("reason", "")]
    flight.run_until_state("at_target", 60.0)
    assert_nothing_was_touched(flight)
    assert_setpoints_never_jump(flight)
    assert_setpoints_keep_to_free_space(flight)


# Before the mode is given -----------------------------------------------------------------------


@pytest.mark.slow
def test_the_aircraft_does_not_fly_back_to_a_hold_that_the_pilot_has_left():
    flight = hovering()
    flight.operator.mission(INSPECTION)
    flight.run_until_state("ready", 3.0)
    flight.autopilot.move_sticks()
    flight.operator.mode("position")
    flight.run(1.5)
    flight.autopilot.move_sticks(roll=0.5)
    flight.run(4.0)
    flight.autopilot.move_sticks()
    flight.run(3.0)
    place = flight.truth.position_ned_m
    flight.operator.mode("ours")
    flight.run(5.0)
    assert flight.state == "idle"
    assert math.dist(place, flight.truth.position_ned_m) < 1.0
    assert least_true_clearance_m(flight) > 0.0


def test_a_mission_ordered_on_the_ground_or_while_taking_off_is_temporarily_rejected():
    flight = Lockstep()
    flight.run(8.0)
    flight.operator.mission(INSPECTION)
    flight.run(0.5)
    assert flight.operator.answers() == [TEMPORARILY_REJECTED]
    flight.operator.take_off(3.0)
    flight.run(0.1)
    flight.operator.arm()
    flight.run(0.5)
    flight.operator.mission(INSPECTION)
    flight.run(0.5)
    assert flight.operator.answers()[-1] == TEMPORARILY_REJECTED
    assert not flight.setpoints

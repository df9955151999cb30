"""Whole missions in lockstep: take-off, inspection, escape route, landing; by the true position."""

from __future__ import annotations

import itertools
import math
from collections import Counter

import pytest

from moar_companion.companion import cycle_stages
from moar_companion.settings.config import Authority
from tests.thorough import sampled

from ..copies import flown_once
from ..flights.judging import (
    assert_nothing_was_touched,
    assert_setpoints_keep_to_free_space,
    assert_setpoints_never_jump,
    assert_the_stream_is_sound,
    setpoint_places,
    true_places,
)
from ..flights.lockstep import Lockstep, hovering
from ..flights.operator import ACCEPTED, EVACUATION, EXIT, INSPECTION, Manner
from .marks import ARDUPILOT_FIRST, PX4_FIRST

SITES = ["315kv_double_circuit", "120kv_single_circuit", "horizontal_three_conductors"]


def judged(flight, **options):
    """Asserts that no collision happened and every setpoint was permitted."""
    assert_nothing_was_touched(flight)
    assert_the_stream_is_sound(flight)
    assert_setpoints_never_jump(flight)
    assert_setpoints_keep_to_free_space(flight, **options)


def inspected(flight):
    """Asserts that all targets were visited, at rest at their places, with their dwell."""
    visited = [
        decision.time_s
        for decision in flight.decisions
        if decision.kind == "state" and decision.data["state"] == "at_target"
    ]
    assert len(visited) == len(flight.site.targets)
    for target, at_s in zip(flight.site.targets, visited, strict=True):
        resting = [
            setpoint
            for setpoint in flight.setpoints
            if at_s + 1.0 <= setpoint.time_s <= at_s + target.dwell_s - 0.1
        ]
        assert resting
        for x, _, z in setpoint_places(flight, resting[:: len(resting) // 5]):
            # Within its cell.
            assert abs(x - target.position_m[0]) <= flight.site.workspace.resolution_m
            assert abs(z - target.position_m[1]) <= flight.site.workspace.resolution_m
        if abs(target.look_at_m[0] - target.position_m[0]) > 1.0:
            looks_back = target.look_at_m[0] < target.position_m[0]
            azimuth = math.radians(flight.site.frame.azimuth_deg) + (math.pi if looks_back else 0)
            # At two metres, GNSS noise across the plane is some degrees.
            off = math.remainder(resting[-1].message.yaw - azimuth, math.tau)
            assert abs(off) < math.radians(30.0)


def left_above_a_landing_point(flight, mission):
    """Asserts that setpoint and aircraft hold above one of the mission's landing points."""
    x, _, z = setpoint_places(flight, flight.setpoints[-1:])[0]
    height = flight.vehicle.guidance.landing_height_m
    reached = [
        point
        for point in flight.site.landing_m[mission]
        if abs(point[0] - x) < 0.05 and abs(point[1] + height - z) < 0.05
    ]
    assert reached
    place_x, _, place_z = true_places(flight)[-1]
    assert math.hypot(place_x - x, place_z - z) < 3.0


def fly_all(site, vehicle, wind_mps, mission, **options):
    """Both splices, then an escape route, then the operator's LAND."""
    flight = hovering(site=site, vehicle=vehicle, **options)
    flight.autopilot.conditions.wind_mps = wind_mps
    flight.autopilot.conditions.wind_from_deg = 300.0
    flight.operator.mission(INSPECTION)
    flight.give_mode()
    flight.run_until_state("holding", 200.0)
    flight.run(2.0)
    assert flight.operator.has_received("every target is done")
    flight.operator.mission(EXIT if mission == "exit" else EVACUATION)
    flight.run_until_state("landing_leg", 120.0)
    flight.run_until_state("holding", 120.0)
    flight.run(3.0)
    left_above_a_landing_point(flight, mission)
    return flight


WIND_MPS = 6.0
"""The fake ArduPilot waits in winds above 8 m/s, 0.8 times what its lean holds."""


EACH_ONCE = [
    ("315kv_double_circuit", "linedrone", WIND_MPS, "evacuation", Manner.ARDUPILOT),
    ("120kv_single_circuit", "x500", 0.0, "evacuation", Manner.ARDUPILOT),
    ("horizontal_three_conductors", "x500", WIND_MPS, "exit", Manner.PX4),
]
"""Every site, vehicle, wind, mission and manner."""


def combinations():
    """Each vehicle on each site with both autopilots."""
    vehicles = ("x500", "linedrone_uniform", "linedrone")
    for number, (site, vehicle) in enumerate(itertools.product(SITES, vehicles)):
        winds_mps = (0.0, WIND_MPS) if number % 2 else (WIND_MPS, 0.0)
        missions = ("exit", "evacuation") if number // 2 % 2 else ("evacuation", "exit")
        yield from zip((site,) * 2, (vehicle,) * 2, winds_mps, missions, Manner, strict=True)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("site", "vehicle", "wind_mps", "mission", "manner"), sampled(EACH_ONCE, list(combinations()))
)
def test_both_splices_the_escape_route_and_the_landing(site, vehicle, wind_mps, mission, manner):
    flight = fly_all(site, vehicle, wind_mps, mission, manner=manner)
    inspected(flight)
    flight.land()
    assert flight.state == "idle"  # the operator's LAND took the mode, the ground ended the rest
    judged(flight)


@pytest.mark.slow
@pytest.mark.parametrize(("index", "x_m"), sampled([(1, 40.0)], [(0, -10.0), (1, 40.0)]))
def test_an_evacuation_to_a_landing_point_of_the_operators_choice(index, x_m):
    flight = hovering(vehicle="x500")
    flight.begin(EVACUATION, index)
    flight.run_until_state("holding", 120.0)
    assert setpoint_places(flight, flight.setpoints[-1:])[0][0] == pytest.approx(x_m, abs=0.05)
    judged(flight)


@ARDUPILOT_FIRST
def test_under_engage_one_command_flies_the_exit_and_lands(manner):
    flight = hovering(manner=manner, vehicle="x500", authority=Authority.ENGAGE)
    flight.operator.mission(EXIT)
    flight.run_until_state("flying", 6.0)  # the companion requested the mode
    flight.run_until(lambda: flight.truth.on_ground and not flight.truth.armed, 120.0)
    x_m, y_m, _ = true_places(flight)[-1]
    assert math.hypot(x_m - 40.0, y_m) < 3.0
    flight.run(6.0)
    assert flight.state in {"idle", "overridden"}
    # PX4 returns to the mode at arming, or stays in OFFBOARD; in both cases the stream has ended.
    assert flight.last_setpoint_s < flight.now_s - 5.0
    judged(flight)


@PX4_FIRST
def test_in_flight_from_inspection_to_evacuation(manner):
    flight = hovering(manner=manner, vehicle="x500")
    flight.begin(INSPECTION)
    flight.run(3.0)
    assert flight.state == "flying"
    flight.operator.mission(EVACUATION)
    flight.run_until_state("landing_leg", 60.0)
    flight.run_until_state("holding", 60.0)
    left_above_a_landing_point(flight, "evacuation")
    assert flight.operator.answers()[-1] == 0
    judged(flight)


@pytest.mark.slow
@ARDUPILOT_FIRST
def test_missions_switched_again_and_again_leave_no_jump(manner):
    flight = Lockstep(manner=manner, vehicle="x500")
    flight.begin(INSPECTION)
    for mission in (EVACUATION, INSPECTION, EXIT, INSPECTION, EVACUATION, INSPECTION) * 2:
        flight.run(1.3)
        assert flight.state in {"flying", "at_target"}
        flight.operator.mission(mission)
    flight.run(1.0)
    judged(flight)


@pytest.mark.slow
@ARDUPILOT_FIRST
def test_hold_and_continue_on_the_path_and_a_hold_at_a_target(manner):
    flight = hovering(manner=manner, vehicle="x500")
    flight.begin(INSPECTION, 0)
    flight.run(3.0)
    flight.operator.pause()
    flight.run(3.0)
    assert flight.state == "holding"
    place = setpoint_places(flight, flight.setpoints[-1:])[0]
    flight.run(5.0)
    assert math.dist(place, setpoint_places(flight, flight.setpoints[-1:])[0]) < 1e-3
    flight.operator.go_on()
    flight.run_until_state("at_target", 60.0)
    flight.operator.pause()
    flight.run(8.0)
    assert flight.state == "holding"
    flight.operator.mission(EXIT)
    flight.run_until_state("landing_leg", 60.0)
    judged(flight)


@flown_once
def held_on_the_landing_leg():
    flight = hovering(vehicle="x500")
    flight.begin(EXIT)
    flight.run_until_state("landing_leg", 60.0)
    flight.run(1.0)
    flight.operator.pause()
    flight.run(3.0)
    assert flight.state == "holding"
    assert setpoint_places(flight, flight.setpoints[-1:])[0][0] > 30.0  # outside the workspace
    return flight


@pytest.mark.slow
def test_from_a_hold_on_the_landing_leg_an_inspection_begins_with_a_checked_leg_back():
    flight = held_on_the_landing_leg()
    flight.operator.mission(INSPECTION)
    flight.run(1.0)
    assert (flight.state, flight.operator.answers()[-1]) == ("flying", ACCEPTED)
    assert flight.last_setpoint_s == flight.now_s

    def outside_m():
        (place_m,) = setpoint_places(flight, flight.setpoints[-1:])
        return flight.site.workspace.outside_m(place_m[::2])

    flight.run_until(lambda: outside_m() == 0.0, 10.0)
    flight.run(1.0)
    assert outside_m() == 0.0
    judged(flight)


@pytest.mark.slow
def test_a_hold_on_the_landing_leg_can_be_continued():
    flight = held_on_the_landing_leg()
    flight.operator.go_on()
    flight.run_until(lambda: flight.state != "holding", 1.0)
    flight.run_until_state("holding", 60.0)
    left_above_a_landing_point(flight, "exit")


@pytest.mark.slow
def test_after_a_low_take_off_the_flight_begins_with_an_escape_leg():
    flight = Lockstep(vehicle="linedrone_uniform", options={"parameters": {"MIS_TAKEOFF_ALT": 1.0}})
    flight.take_off(1.2)
    low_m = true_places(flight)[-1][2]
    assert low_m < flight.site.workspace.min_altitude_m
    flight.operator.mission(INSPECTION, 0)
    flight.give_mode()
    flight.run_until(lambda: -flight.truth.position_ned_m[2] > 4.0, 60.0)
    places = setpoint_places(flight)
    assert places[0][2] < flight.site.workspace.min_altitude_m
    # At v_MIN or below until the end of the escape leg.
    slow_mps = flight.vehicle.speed.min_mps
    for setpoint, (_, _, z) in zip(flight.setpoints, places, strict=True):
        if z < flight.site.workspace.min_altitude_m:
            message = setpoint.message
            assert math.hypot(message.vx, message.vy, message.vz) <= slow_mps + 0.01
    judged(flight, escape=True)


@pytest.mark.slow
def test_a_plan_that_takes_seconds_is_joined_without_a_jump():
    flight = hovering(vehicle="x500")
    flight.plan_delay_s = 1.5
    flight.begin(INSPECTION)
    flight.run_until_state("at_target", 90.0)
    flight.run_until_state("flying", 20.0)
    flight.operator.mission(EVACUATION)
    flight.run(5.0)
    assert flight.operator.answers()[-1] == ACCEPTED
    judged(flight)


@pytest.mark.slow
def test_when_the_planner_falls_silent_the_last_plan_is_flown_to_its_end():
    flight = hovering(vehicle="x500")
    flight.begin(INSPECTION)
    flight.planning = False
    flight.run_until_state("at_target", 90.0)
    flight.run_until_state("holding", 20.0)
    flight.run(2.0)
    assert flight.state == "holding"  # at the last target of the old plan
    judged(flight)


def test_the_path_ahead_is_measured_ten_times_a_second_and_the_risks_at_each_position(monkeypatch):
    """At each position the measurement took a third of a cycle's processor time."""
    counts = Counter()
    for name in ("look_ahead", "assess_risk"):
        stage = getattr(cycle_stages, f"_{name}")

        def counted(state, now_s, name=name, stage=stage):
            counts[name] += 1
            stage(state, now_s)

        monkeypatch.setattr(cycle_stages, f"_{name}", counted)
    flight = hovering()
    flight.begin(INSPECTION)
    counts.clear()
    flight.run(2.0)
    assert flight.state == "flying"
    assert 16 <= counts["look_ahead"] <= 21
    assert counts["assess_risk"] > 2 * counts["look_ahead"]

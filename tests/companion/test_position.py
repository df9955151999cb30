"""A position that is frozen, jumps, or changes its frame."""

from __future__ import annotations

import itertools
import math

import pytest

from ..copies import flown_once
from .desk import EXIT, INSPECTION, STEP_S, Desk


def moved_m(setpoints):
    """The greatest distance from one setpoint to the next."""
    places = [(m.x, m.y, m.z) for m in setpoints]
    return max(math.dist(*pair) for pair in itertools.pairwise(places))


@pytest.mark.slow
@pytest.mark.parametrize("state", ["ready", "flying", "holding"])
def test_a_position_whose_clock_stands_still_is_stale(state):
    desk = Desk().come_to(state)
    desk.position_boot_s = desk.boot_s
    desk.run(0.4)
    assert desk.state == state
    desk.run(0.3)
    assert desk.state == "released"
    assert desk.said("position age 0.5")


@pytest.mark.slow
def test_an_aircraft_that_stops_following_is_reported_and_so_is_its_recovery():
    desk = Desk(height_m=5.0).come_to("flying", EXIT, then_s=2.0)
    desk.fall_behind(0.0, 1.7, 0.0).run(5.0)
    assert not desk.said("no progress")
    desk.run(10.0)
    assert desk.state == "flying"
    assert desk.said("MOAR: no progress, 1.7 m from setpoint")
    desk.fall_behind(0.0, 0.0, 0.0).run(2.0)
    assert desk.said("MOAR: no progress")


def test_a_frozen_position_with_a_running_clock_is_reported():
    desk = Desk(height_m=5.0).come_to("flying", then_s=5.0)
    frozen = desk.position_ned_m
    for _ in range(750):
        desk.set(position_ned_m=frozen).step()
    assert desk.said("MOAR: no progress, 1.5 m from setpoint")


@pytest.mark.parametrize("growth", [0.3, 0.02])
def test_a_position_on_a_link_that_falls_behind_is_stale(growth):
    desk = Desk().come_to("flying", then_s=1.0).pause().run(1.0)
    while desk.state == "holding" and desk.late_s < 1.0:
        desk.set(late_s=desk.late_s + growth * STEP_S).step()
        if desk.late_s < 0.4:
            assert desk.state == "holding"
    assert desk.state == "released"
    assert desk.said("position age 0.5")


def test_a_position_is_stale_on_a_link_that_falls_behind_after_its_answers_have_ceased():
    desk = Desk().come_to("flying", then_s=1.0).pause().run(1.0).set(mute={"TIMESYNC"})
    while desk.late_s < 1.0:
        desk.set(late_s=desk.late_s + 0.3 * STEP_S).step()
    desk.run_until("released", 2.0)
    assert desk.said("position age 0.9") or desk.said("position age 1.0")


def test_answers_that_are_lost_for_some_time_are_no_late_link():
    desk = (
        Desk()
        .come_to("flying", then_s=1.0)
        .set(mute={"TIMESYNC"})
        .run(2.5)
        .set(mute=set())
        .run(4.0)
    )
    assert desk.state == "flying"


def test_a_clock_of_the_autopilot_that_runs_at_another_speed_is_no_late_link():
    """As in a simulator that runs too slowly, or after an hour of drift."""
    desk = Desk().come_to("flying", then_s=1.0)
    for _ in range(500):
        desk.boot_s -= 0.3 * STEP_S
        desk.step()
    assert desk.state == "flying"


@pytest.mark.parametrize("state", ["ready", "flying"])
def test_without_an_attitude_nothing_is_streamed(state):
    desk = Desk().come_to(state)
    desk.mute = {"ATTITUDE"}
    desk.run(0.9)
    assert desk.state == state
    desk.run(0.2)
    assert desk.state == "released"
    assert desk.said("the attitude is unknown")


def test_with_an_old_attitude_nothing_is_begun():
    desk = Desk().run(1.2)
    desk.mute = {"ATTITUDE"}
    desk.run(10.0).order(INSPECTION).run(1.0)
    assert desk.state == "idle"
    assert desk.said("the attitude is unknown")


@pytest.mark.parametrize("jump_ned_m", [(0.0, 1.4, 0.0), (0.0, -0.8, 0.6), (1.0, 0.0, 0.0)])
def test_a_jump_of_the_estimate_moves_the_setpoint_by_the_same_vector(jump_ned_m):
    desk = Desk().come_to("flying", then_s=8.0)
    desk.run_to_position()
    before, began = desk.setpoints()[-1], desk.now_s
    place = desk.position_ned_m
    desk.jump(*jump_ned_m).run(0.06)
    after = desk.setpoints(began)[-1]
    jumped = (after.x - before.x, after.y - before.y, after.z - before.z)
    assert jumped == pytest.approx(jump_ned_m, abs=0.1)
    assert math.dist(desk.position_ned_m, place) < 0.1  # the aircraft has not followed the jump
    (reported,) = desk.decided("jump")
    assert math.hypot(*reported["jump_m"]) == pytest.approx(math.hypot(*jump_ned_m), abs=0.05)
    desk.run(1.0)
    assert moved_m(desk.setpoints(began + 0.06)) < 0.05  # the setpoint returns to its path slowly


def test_a_jump_of_less_than_half_a_metre_moves_the_aircraft_not_the_setpoint():
    desk = Desk().come_to("flying", then_s=8.0)
    began = desk.now_s
    desk.jump(0.0, 0.4, 0.0).run(2.0)
    assert not desk.decided("jump")
    assert moved_m(desk.setpoints(began)) < 0.05


@pytest.mark.parametrize("reported", ["with it", "after it", "before it"])
def test_a_smaller_jump_is_detected_when_the_estimator_reports_its_reset(reported):
    desk = Desk().set(reset_counter=255).come_to("ready", then_s=2.0)
    desk.run_to_position()
    before = desk.setpoints()[-1]
    if reported == "before it":
        desk.set(reset_counter=0).run(0.2)
    desk.jump(0.0, 0.4, 0.0)
    if reported == "after it":
        desk.run(0.2)
    desk.set(reset_counter=0).run(1.0)
    (decided,) = desk.decided("jump")
    assert math.hypot(*decided["jump_m"]) == pytest.approx(0.4, abs=0.01)
    after = desk.setpoints()[-1]
    assert (after.x, after.y, after.z) == pytest.approx(
        (before.x, before.y + 0.4, before.z), abs=0.01
    )


def test_a_detected_smaller_jump_does_not_move_the_aircraft():
    desk = Desk().set(reset_counter=12).come_to("flying", then_s=8.0)
    desk.run_to_position()
    place = desk.position_ned_m
    desk.set(reset_counter=13).jump(0.0, 0.4, 0.0).run(0.06)
    assert math.dist(desk.position_ned_m, place) < 0.1
    assert len(desk.decided("jump")) == 1


@pytest.mark.parametrize(
    ("case", "off_m", "wait_s"),
    [
        ("the heading alone was reset", 0.02, 0.0),
        ("a reset that was long before", 0.4, 0.5),
    ],
)
def test_a_reset_of_the_estimator_is_no_jump_of_itself(case, off_m, wait_s):
    desk = Desk().set(reset_counter=3).come_to("flying", then_s=8.0)
    desk.set(reset_counter=4).run(wait_s).jump(0.0, off_m, 0.0).run(1.0)
    assert not desk.decided("jump"), case


def test_the_first_report_of_an_estimator_is_no_reset():
    desk = Desk().come_to("flying", then_s=8.0)
    desk.jump(0.0, 0.4, 0.0).set(reset_counter=7).run(1.0)
    assert not desk.decided("jump")


def test_a_jump_while_ready_moves_the_hold():
    desk = Desk().come_to("ready", then_s=2.0)
    before, began = desk.setpoints()[-1], desk.now_s
    desk.jump(0.0, -0.8, 0.0).run(2.0)
    assert desk.state == "ready"
    assert desk.setpoints(began)[-1].y == pytest.approx(before.y - 0.8, abs=0.01)


def test_a_jump_out_of_the_plane_ends_the_stream_where_the_aircraft_is():
    desk = Desk().come_to("flying", then_s=8.0)
    desk.run_to_position()
    place, began = desk.position_ned_m, desk.now_s
    desk.jump(5.0, 0.0, 0.0).run(1.0)
    assert desk.state == "released"
    assert desk.said("from the plane")
    # A last setpoint in the old frame would move the aircraft by five metres.
    assert math.dist(desk.position_ned_m, place) < 0.1
    assert len(desk.setpoints(began)) <= 1


def test_a_reset_below_the_least_altitude_is_a_hold():
    desk = Desk().come_to("flying")
    desk.run_to_position()
    assert desk.companion.pose.position_m[2] < 3.2  # the least altitude is 2 m
    desk.jump(0.0, 0.0, 1.2).run(2.0)
    assert desk.companion.pose.position_m[2] < 2.0
    assert desk.state == "holding"


def test_an_origin_that_moves_in_flight_moves_no_setpoint():
    """The site moves with the origin: the flight returns to its path."""
    desk = Desk().come_to("flying", then_s=8.0)
    began = desk.now_s
    latitude, longitude, altitude = desk.origin
    desk.origin = (latitude, longitude + 1.0 / 78000.0, altitude)
    desk.run(3.0)
    assert desk.state == "flying"
    assert desk.decided("jump")
    assert moved_m(desk.setpoints(began)) < 0.05


def test_an_aircraft_that_moves_fast_has_not_jumped():
    desk = Desk().come_to("ready", then_s=1.0)
    desk.drift(0.0, 1.2, 0.0, seconds=0.3)
    assert not desk.decided("jump")
    assert desk.state == "ready"


@flown_once
def at_the_last_target():
    desk = Desk().come_to("flying", then_s=4.0)
    return desk.order(INSPECTION, 0.0).run(0.3).run_until("holding", 60.0)


@pytest.mark.parametrize(
    ("jump_ned_m", "when"),
    [
        pytest.param((0.0, 0.0, -4.0), "it makes it hold", id="jump_ned_m0-it makes it hold"),
        pytest.param((0.0, 0.0, -4.0), "it holds already", id="jump_ned_m0-it holds already"),
        pytest.param(
            (0.0, 0.0, -4.0),
            "every target is done",
            id="jump_ned_m0-every target is done",
            marks=pytest.mark.slow,
        ),
        pytest.param((0.0, -3.5, 0.0), "it makes it hold", id="jump_ned_m1-it makes it hold"),
        pytest.param((0.0, -3.5, 0.0), "it holds already", id="jump_ned_m1-it holds already"),
        pytest.param(
            (0.0, -3.5, 0.0), "every target is done", id="jump_ned_m1-every target is done"
        ),
    ],
)
def test_a_hold_stays_at_the_aircraft_after_any_position_jump(when, jump_ned_m):
    if when == "every target is done":
        desk = at_the_last_target()
    else:
        desk = Desk().come_to("flying", then_s=4.0)
    if when == "it holds already":
        desk.pause().run(2.0)
    desk.run_to_position()
    place, began = desk.position_ned_m, desk.now_s
    desk.jump(*jump_ned_m).run(5.0)
    assert desk.state == "holding"
    assert math.dist(desk.position_ned_m, place) < 0.3  # the stopping distance
    assert moved_m(desk.setpoints(began + 0.06)) < 0.02
    last = desk.setpoints()[-1]
    assert (last.vx, last.vy, last.vz) == (0.0, 0.0, 0.0)


def test_after_a_jump_and_a_hold_the_flight_continues_from_the_aircrafts_position():
    desk = Desk().come_to("flying", then_s=4.0)
    desk.jump(0.0, 0.0, -4.0).run(4.0)
    job = len(desk.jobs)
    stood, began = desk.setpoints()[-1], desk.now_s
    desk.go_on().run(0.5)
    assert desk.state == "flying"
    assert desk.jobs[job].request.start_m[1] == pytest.approx(-stood.z, abs=0.05)
    assert moved_m(desk.setpoints(began)) < 0.05


# The heading ------------------------------------------------------------------------------------


def turns_rad(setpoints):
    """Differences between the headings of successive setpoints."""
    headings = [m.yaw for m in setpoints]
    return [math.remainder(b - a, math.tau) for a, b in itertools.pairwise(headings)]


@pytest.mark.parametrize("reset_rad", [0.43, -1.2, 3.0])
def test_a_reset_of_the_heading_does_not_turn_the_nose(reset_rad):
    """The difference between commanded and true heading stays the same."""
    desk = Desk().come_to("ready", then_s=1.0)
    before, began = desk.setpoints()[-1].yaw, desk.now_s
    desk.set(yaw_rad=desk.yaw_rad + reset_rad).run(1.0)
    after = desk.setpoints(began + 0.06)
    assert {round(math.remainder(m.yaw - before - reset_rad, math.tau), 5) for m in after} == {0.0}
    (reported,) = desk.decided("jump")
    assert (reported["jump_m"], reported["turn_rad"]) == ([0.0, 0.0, 0.0], pytest.approx(reset_rad))
    assert moved_m(desk.setpoints(began)) < 0.02


def test_after_a_heading_reset_the_nose_returns_to_its_direction_within_the_turn_rate_limit():
    desk = Desk().come_to("flying", then_s=4.0)
    wanted, began = desk.setpoints()[-1].yaw, desk.now_s
    desk.set(yaw_rad=desk.yaw_rad + 0.9).run(3.0)
    fastest_rad = desk.vehicle.guidance.yaw_rate_radps * STEP_S
    (reset, *others) = sorted(turns_rad(desk.setpoints(began - STEP_S)), key=abs, reverse=True)
    assert reset == pytest.approx(0.9, abs=2 * fastest_rad)
    assert abs(others[0]) <= fastest_rad + 1e-6
    # The direction to the target changes as the aircraft comes nearer.
    assert desk.setpoints()[-1].yaw == pytest.approx(wanted, abs=0.05)


@pytest.mark.parametrize("rate_radps", [0.8, -3.0])
def test_an_aircraft_that_turns_fast_was_not_reset(rate_radps):
    desk = Desk().come_to("ready", then_s=1.0).set(yaw_rate_radps=rate_radps)
    for _ in range(100):
        desk.set(yaw_rad=math.remainder(desk.yaw_rad + rate_radps * STEP_S, math.tau)).step()
    assert not desk.decided("jump")


def test_a_heading_that_is_received_again_after_a_gap_was_not_reset():
    desk = Desk().come_to("ready", then_s=1.0)
    desk.set(mute={"ATTITUDE"}).run(0.4)
    desk.set(mute=set(), yaw_rad=1.1).run(1.0)
    assert not desk.decided("jump")


def test_a_missing_turn_rate_makes_no_reset():
    desk = Desk().come_to("ready", then_s=1.0)
    desk.set(yaw_rate_radps=math.nan).run(0.1)
    desk.set(yaw_rad=1.1).run(1.0)
    assert not desk.decided("jump")

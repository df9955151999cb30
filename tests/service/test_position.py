"""A position that stands still, jumps, or is told in another frame than before."""

from __future__ import annotations

import itertools
import math

import pytest

from .desk import INSPECTION, Desk


def moved_m(setpoints):
    """The longest step from one setpoint to the next."""
    places = [(m.x, m.y, m.z) for m in setpoints]
    return max(math.dist(*pair) for pair in itertools.pairwise(places))


@pytest.mark.parametrize("state", ["ready", "flying", "holding"])
def test_a_position_whose_clock_stands_still_is_stale(state):
    desk = Desk().come_to(state)
    desk.position_boot_s = desk.boot_s
    desk.run(0.4)
    assert desk.state == state
    desk.run(0.3)
    assert desk.state == "released"
    assert desk.said("the position is 0.5")


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
def test_a_jump_of_the_estimate_takes_the_setpoint_along(jump_ned_m):
    desk = Desk().come_to("flying").run(8.0)
    desk.run_to_position()
    before, began = desk.setpoints()[-1], desk.now_s
    place = desk.position_ned_m
    desk.jump(*jump_ned_m).run(0.06)
    after = desk.setpoints(began)[-1]
    jumped = (after.x - before.x, after.y - before.y, after.z - before.z)
    assert jumped == pytest.approx(jump_ned_m, abs=0.1)
    assert math.dist(desk.position_ned_m, place) < 0.1  # the aircraft has not chased it
    (told,) = desk.decided("jump")
    assert math.hypot(*told["jump_m"]) == pytest.approx(math.hypot(*jump_ned_m), abs=0.05)
    desk.run(1.0)
    assert moved_m(desk.setpoints(began + 0.06)) < 0.05  # and it comes back to its path slowly


def test_a_jump_of_less_than_half_a_metre_is_flown_out():
    desk = Desk().come_to("flying").run(8.0)
    began = desk.now_s
    desk.jump(0.0, 0.4, 0.0).run(2.0)
    assert not desk.decided("jump")
    assert moved_m(desk.setpoints(began)) < 0.05


def test_a_jump_while_ready_takes_the_hold_along():
    desk = Desk().come_to("ready").run(2.0)
    before, began = desk.setpoints()[-1], desk.now_s
    desk.jump(0.0, -1.4, 0.0).run(2.0)
    assert desk.state == "ready"
    assert desk.setpoints(began)[-1].y == pytest.approx(before.y - 1.4, abs=0.01)


def test_a_jump_out_of_the_plane_ends_the_stream_where_the_aircraft_is():
    desk = Desk().come_to("flying").run(8.0)
    desk.run_to_position()
    place, began = desk.position_ned_m, desk.now_s
    desk.jump(5.0, 0.0, 0.0).run(1.0)
    assert desk.state == "released"
    assert desk.said("from the plane")
    # A farewell in the frame of before would draw the aircraft five metres away.
    assert math.dist(desk.position_ned_m, place) < 0.1
    assert len(desk.setpoints(began)) <= 1


def test_an_origin_that_moves_in_flight_moves_no_setpoint():
    """The site is nearer or farther by what the origin moved: the flight ends up on its path."""
    desk = Desk().come_to("flying").run(8.0)
    began = desk.now_s
    latitude, longitude, altitude = desk.origin
    desk.origin = (latitude, longitude + 1.0 / 78000.0, altitude)
    desk.run(3.0)
    assert desk.state == "flying"
    assert desk.decided("jump")
    assert moved_m(desk.setpoints(began)) < 0.05


def test_an_aircraft_that_moves_fast_has_not_jumped():
    desk = Desk().come_to("ready").run(1.0)
    desk.drift(0.0, 1.2, 0.0, seconds=0.3)
    assert not desk.decided("jump")
    assert desk.state == "ready"

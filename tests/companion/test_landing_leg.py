"""Holds on a landing leg, outside the workspace: the flight resumes as soon as possible.

A pole stands beside the leg of the exit, which leaves the workspace at x = 30 m; keep-outs
allow for 0.9 m of uncertainty.
"""

from __future__ import annotations

import functools
import math
from dataclasses import replace

import pytest

from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Conductor
from moar_companion.settings.config import Authority
from moar_companion.types import Mission

from ..copies import flown_once
from .desk import (
    ACCEPTED,
    CANCELLED,
    DENIED,
    EVACUATION,
    EXIT,
    INSPECTION,
    PAUSE_CONTINUE,
    STEP_S,
    Desk,
    usual_planner,
)
from .scripted_autopilot import AUTO_HOLD, OFFBOARD

WELL_M, TOO_NARROW_M = 0.3, 1.85
"""The position's uncertainty."""


@functools.cache
def planner():
    usual = usual_planner()
    pole = Conductor(name="pole", position_m=(35.0, 6.0), radius_m=0.0175, keep_out_m=0.9)
    site = replace(usual.site, obstacles=(*usual.site.obstacles, pole))
    return Planner(site, usual.vehicle)


def moving(desk, seconds):
    """Fraction of the setpoints in this time that move."""
    began = desk.now_s
    desk.run(seconds)
    setpoints = desk.setpoints(began)
    return sum(any((m.vx, m.vy, m.vz)) for m in setpoints) / len(setpoints)


def along_m(desk):
    """Distance of the aircraft from the start in the plane, which runs east."""
    return desk.position_ned_m[1]


def on_its_leg(**options):
    desk = Desk(planner=planner(), height_m=5.0, east_m=2.0, **options).set(accuracy_m=WELL_M)
    return desk.come_to("landing_leg", EXIT, then_s=2.0)


@pytest.fixture
def desk():
    return on_its_leg()


def room_m(desk):
    """Room of the landing leg that is flown."""
    (*_, answer) = (answer for _, answer in desk.answered if answer.plan is not None)
    return answer.plan.landing_leg.room_m


@pytest.mark.parametrize("battery_percent", [pytest.param(90, marks=pytest.mark.slow), 15])
def test_after_a_short_hold_for_room_the_flight_resumes_along_the_leg(desk, battery_percent):
    """Also where an escape route overrides the hold: an empty battery must not wait for ever."""
    assert WELL_M < room_m(desk) + 0.9 < TOO_NARROW_M
    desk.set(battery_percent=battery_percent, plan_delay_s=None).run(4.5)
    place_m = along_m(desk)
    desk.set(accuracy_m=TOO_NARROW_M).run_to_heartbeat().run(0.1)
    assert moving(desk, 0.5) == 0.0
    assert desk.said("no room here, uncertainty 1.9 m")
    desk.set(accuracy_m=WELL_M).run_until("landing_leg", 4.0).run(2.5)
    assert moving(desk, 1.0) == 1.0
    assert along_m(desk) > place_m


@pytest.mark.slow
@pytest.mark.parametrize(("battery_percent", "flown_to"), [(90, "landing_leg"), (15, "holding")])
def test_where_room_stays_too_small_the_aircraft_leaves_by_a_wider_route(
    desk, battery_percent, flown_to
):
    desk.set(battery_percent=battery_percent).run(4.5).set(accuracy_m=TOO_NARROW_M)
    desk.run_until("flying", 5.0)  # by an escape leg, away from the pole
    assert desk.jobs[-1].widening_m >= 0.95
    desk.run_until("landing_leg", 30.0)
    assert room_m(desk) >= 0.95
    desk.run_until(flown_to, 30.0)


@pytest.mark.parametrize("end", ["taken back", "denied"])
def test_an_order_that_stopped_the_aircraft_and_fails_lets_the_leg_resume(desk, end):
    desk.plan_delay_s = 1.0  # too late to be joined: the aircraft stops for the next plan
    desk.order(INSPECTION).run(1.8)
    assert moving(desk, 0.1) == 0.0
    if end == "taken back":
        desk.take_back()
    else:
        desk.plan_delay_s = None
        desk._answers.clear()
        desk.answer_plan(plan=None, reason="the planner failed", failed=True)
    desk.run(1.0)
    assert desk.answers()[-1] == (CANCELLED if end == "taken back" else DENIED)
    assert moving(desk, 1.0) == 1.0
    assert desk.state == "landing_leg"
    assert desk.companion.status.task.mission is Mission.EXIT


@pytest.mark.slow
def test_a_jump_beside_the_leg_is_faded_back_before_the_flight_resumes(desk):
    desk.jump(0.0, 0.0, 0.25).run(0.2)
    desk.pause().run(1.0)
    place = desk.setpoints()[-1]
    desk.go_on().run(STEP_S)
    first = desk.setpoints()[-1]
    assert math.dist((place.x, place.y, place.z), (first.x, first.y, first.z)) < 0.02
    assert desk.answers(PAUSE_CONTINUE) == [ACCEPTED, ACCEPTED]
    desk.run_until("holding", 60.0)
    assert desk.companion.status.task.done


@pytest.mark.parametrize("up_m", [0.4, -0.4])
def test_a_reset_out_of_the_legs_corridor_is_a_hold_from_which_an_exit_is_flown(desk, up_m):
    desk.set(reset_counter=1).run(0.5)
    desk.jump(0.0, 0.0, -up_m).set(reset_counter=2).run(2.0)
    assert desk.state == "holding"
    assert not desk.said("released")
    place_m = desk.position_ned_m
    desk.run(2.0)
    assert math.dist(desk.position_ned_m, place_m) < 0.3
    desk.order(EXIT).run(2.0)
    assert desk.answers()[-1] == ACCEPTED
    desk.run_until("landing_leg", 60.0)


@pytest.mark.uncounted
@pytest.mark.parametrize(
    ("order", "behind_m"),
    [
        (EXIT, 0.0),
        (EXIT, 0.5),
        pytest.param(INSPECTION, 0.5, marks=pytest.mark.slow),
        pytest.param(EVACUATION, 0.5, marks=pytest.mark.slow),
    ],
)
def test_an_order_after_a_jump_off_the_leg_is_flown(desk, order, behind_m):
    """The order is not first accepted and then held."""
    desk.fall_behind(behind_m, 0.0, 0.0).set(reset_counter=1).run(0.2)
    desk.jump(0.0, 0.0, -0.4).set(reset_counter=2).run(2.5)
    assert desk.state == "holding"
    began_s, texts = desk.now_s, len(desk.texts())
    desk.order(order).run(2.5)
    assert desk.answers()[-1] == ACCEPTED
    assert desk.state == "flying"
    assert not any("holding" in text for text in desk.texts()[texts:])
    assert any(any((m.vx, m.vy, m.vz)) for m in desk.setpoints(began_s))
    desk.run(3.0)
    assert desk.state != "holding"


@pytest.mark.parametrize("seconds", [0.3, 3.0])
def test_a_hold_on_the_leg_is_continued_along_it(desk, seconds):
    desk.pause().run(seconds)
    asked = len(desk.jobs)
    desk.go_on().run(0.5)
    assert (desk.state, len(desk.jobs)) == ("landing_leg", asked)
    assert moving(desk, 0.5) == 1.0


@flown_once
def taken_over(*moved_ned_m):
    """The pilot takes over 2 m past the border and moves the aircraft."""
    desk = on_its_leg()
    while along_m(desk) < 5.0:
        desk.step()
    desk.send_heartbeat(AUTO_HOLD).run(1.0).drift(*moved_ned_m).run(1.0)
    assert desk.state == "overridden"
    return desk


def mode_given(desk):
    desk.run_until("ready", 2.0).run(1.1).send_heartbeat(OFFBOARD)
    return desk.run_until("landing_leg", 60.0)


@pytest.mark.slow
@pytest.mark.parametrize(("order", "beside_m"), [("exit", 1.2), ("continue", 0.0)])
def test_a_leg_that_a_pilot_has_interrupted_is_continued_from_near_it(order, beside_m):
    desk = taken_over(0.0, 0.0, -beside_m)
    asked, place_m = len(desk.jobs), along_m(desk)
    if order == "exit":
        desk.order(EXIT)
    else:
        desk.go_on()
    mode_given(desk)
    assert len(desk.jobs) == asked
    assert along_m(desk) > place_m - 0.5
    desk.run_until("holding", 30.0)
    assert desk.companion.status.task.done


@pytest.mark.parametrize(
    ("battery_percent", "behind_m"),
    [
        pytest.param(90, 0.3, marks=pytest.mark.slow),
        pytest.param(90, 0.6, marks=pytest.mark.slow),
        (8, 0.6),
    ],
)
def test_a_resumed_leg_continues_with_an_aircraft_that_the_wind_holds_beside_its_setpoint(
    battery_percent, behind_m
):
    """Also by the escape route of a critical battery, which no operator orders."""
    desk = taken_over(0.0, 0.0, -0.9)
    desk.order(EXIT).run_until("ready", 2.0).run(1.1).send_heartbeat(OFFBOARD).run(0.5)
    desk.pause().run(1.0).fall_behind(behind_m, 0.0, 0.0).run(1.0)
    if battery_percent == 90:
        desk.go_on()
    else:
        desk.set(battery_percent=battery_percent, charge_state=3)
    desk.run(4.0)
    assert not desk.said("setpoint jumps")
    assert desk.state == "landing_leg"
    assert moving(desk, 1.0) == 1.0


def test_from_farther_off_the_leg_the_aircraft_returns_and_exits_again():
    desk = taken_over(0.0, 0.0, -3.0)
    asked = len(desk.jobs)
    desk.order(EXIT).run_until("ready", 2.0)
    assert len(desk.jobs) > asked
    assert desk.answered[-1][1].escape_m


def test_an_order_that_is_denied_while_overridden_keeps_the_leg():
    desk = taken_over(0.0, 0.0, 0.0)
    asked = len(desk.jobs)
    desk.plan_delay_s = None
    desk.order(INSPECTION).run(0.1)
    desk.answer_plan(plan=None, reason="no free path").run(1.0)
    assert desk.answers()[-1] == DENIED
    desk.order(EXIT).run_until("ready", 2.0)
    assert len(desk.jobs) == asked + 1


def test_a_continue_that_is_denied_can_be_given_again_from_nearer_the_leg():
    desk = taken_over(0.0, 0.0, -3.0)
    asked = len(desk.jobs)
    desk.plan_delay_s = None
    desk.go_on().run(0.1)
    desk.answer_plan(plan=None, reason="no free path").run(1.0)
    assert desk.answers(PAUSE_CONTINUE) == [DENIED]
    assert desk.state == "idle"
    desk.drift(0.0, 0.0, 3.0).run(1.0).go_on()
    mode_given(desk)
    assert desk.answers(PAUSE_CONTINUE)[-1] == ACCEPTED
    assert len(desk.jobs) == asked + 1


@pytest.mark.uncounted
def test_under_engage_an_order_for_the_rest_of_the_leg_waits_for_the_pilot_to_give_the_mode():
    desk = on_its_leg(authority=Authority.ENGAGE)
    desk.send_heartbeat(AUTO_HOLD).run(3.0)
    assert desk.state == "overridden"
    desk.order(EXIT).run(1.0)
    assert desk.answers()[-1] == ACCEPTED
    assert desk.said("HOLD kept, waiting for OFFBOARD")
    assert desk.state == "ready"

"""Escape routes of the supervisor: the preferred one, else the next one, without waiting.

Rows of poles close the workspace, or a part of it; keep-outs allow for 0.9 m of uncertainty.
"""

from __future__ import annotations

import functools
from dataclasses import replace

import pytest

from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Conductor
from moar_companion.types import Mission

from .desk import EVACUATION, EXIT, INSPECTION, Desk, usual_planner

CRITICAL = {"battery_percent": 60, "charge_state": 3}
RESERVE = {"battery_percent": 15}


def fenced(x_m, heights_m, evacuation_m=None):
    """The usual site with a row of poles; evacuation_m: its only evacuation landing point."""
    usual = usual_planner()
    poles = (
        Conductor(name=f"pole {z_m}", position_m=(x_m, z_m), radius_m=0.0175, keep_out_m=0.9)
        for z_m in heights_m
    )
    landing_m = dict(usual.site.landing_m)
    if evacuation_m is not None:
        landing_m[Mission.EVACUATION] = (evacuation_m,)
    site = replace(usual.site, obstacles=(*usual.site.obstacles, *poles), landing_m=landing_m)
    return Planner(site, usual.vehicle)


@functools.cache
def cut_off():
    """A site whose only evacuation is on the far side of a fence."""
    return fenced(4.0, range(0, 21, 2), evacuation_m=(-10.0, 2.5))


@functools.cache
def without_evacuation():
    usual = usual_planner()
    exits = {Mission.EXIT: usual.site.landing_m[Mission.EXIT]}
    return Planner(replace(usual.site, landing_m=exits), usual.vehicle)


@functools.cache
def gapped():
    """A row of poles before the exit, whose gaps close when obstacles grow."""
    return fenced(24.0, range(1, 22, 4))


def desk_on_site(planner, **config):
    return Desk(planner=planner, height_m=7.0, wind_mps=2.0, **config).set(accuracy_m=0.3)


def flown(desk):
    return desk.companion.status.task.mission


def moving(desk, seconds):
    """True if any setpoint in this time moves."""
    began = desk.now_s
    desk.run(seconds)
    return any(any((m.vx, m.vy, m.vz)) for m in desk.setpoints(began))


@pytest.mark.parametrize("planner", [cut_off, without_evacuation])
def test_an_inspection_without_an_evacuation_ends_with_the_exit(planner):
    desk = desk_on_site(planner(), east_m=-9.0).come_to("flying", INSPECTION, then_s=3.0)
    desk.set(**CRITICAL).run(4.0)
    assert flown(desk) is Mission.EXIT
    assert desk.said("MOAR: battery 0 is critical")
    assert moving(desk, 1.0)


def test_the_next_escape_route_is_searched_in_the_cycle_of_a_failed_search():
    desk = Desk(wind_mps=2.0).set(accuracy_m=0.3).come_to("flying", INSPECTION, then_s=3.0)
    desk.set(**CRITICAL, plan_delay_s=None).run_until_requested("evacuation")
    desk.answer_plan(plan=None, reason="no free way leads there").step()
    assert desk.jobs[-1].request.mission is Mission.EXIT


@pytest.mark.parametrize("held", ["by wind", "by an operator"])
def test_a_held_exit_resumes_when_there_is_no_evacuation(held):
    desk = desk_on_site(cut_off(), east_m=-9.0).come_to("flying", EXIT, then_s=2.0)
    desk = desk.set(wind_mps=18.0) if held == "by wind" else desk.pause()
    desk.run_until("holding").run(2.0)
    assert not moving(desk, 0.5)
    desk.set(**CRITICAL).run(4.0)
    assert (desk.state, flown(desk), moving(desk, 1.0)) == ("flying", Mission.EXIT, True)


@pytest.mark.parametrize("plan_delay_s", [0.04, None])
def test_an_exit_that_is_held_on_its_landing_leg_resumes_along_the_leg(plan_delay_s):
    """Outside no evacuation is planned; the leg needs no planner, even after a failure."""
    desk = Desk(height_m=5.0, east_m=2.0, wind_mps=2.0).set(accuracy_m=0.3)
    desk.come_to("landing_leg", EXIT, then_s=2.0).set(plan_delay_s=plan_delay_s)
    desk.set(wind_mps=18.0).run_until("holding").run(1.0)
    desk.set(**CRITICAL).run_until("landing_leg", 8.0).run(2.0)
    assert (desk.state, moving(desk, 1.0)) == ("landing_leg", True)


@pytest.mark.slow
def test_an_exit_without_room_is_replaced_by_an_evacuation():
    desk = desk_on_site(gapped(), east_m=-15.0).come_to("flying", EXIT, then_s=3.0)
    desk.set(**RESERVE).run(4.5)
    assert flown(desk) is Mission.EXIT
    desk.set(accuracy_m=1.7).run(15.0)
    assert flown(desk) is Mission.EVACUATION
    desk.run_until("holding", 90.0)
    assert desk.companion.status.task.flown


@pytest.mark.slow
def test_a_landing_point_without_room_is_replaced_by_another_one():
    desk = desk_on_site(gapped(), east_m=-15.0).come_to("ready")
    desk.order(EVACUATION, 1.0).run(0.5).send_heartbeat(desk.ours).run(3.0)
    assert desk.companion.status.task.landing == 1
    desk.set(**CRITICAL).run(3.0).set(accuracy_m=1.7).run(15.0)
    assert (flown(desk), desk.companion.status.task.landing) == (Mission.EVACUATION, None)
    assert moving(desk, 1.0)


@pytest.mark.slow
def test_an_ordered_exit_holds_until_there_is_room_for_it():
    desk = desk_on_site(gapped(), east_m=-15.0).come_to("flying", EXIT, then_s=3.0)
    desk.set(accuracy_m=1.7).run(15.0)
    assert (desk.state, flown(desk)) == ("holding", Mission.EXIT)
    desk.set(accuracy_m=0.3).run_until("landing_leg", 30.0)
    assert flown(desk) is Mission.EXIT


@pytest.mark.slow
def test_a_failed_planner_does_not_stop_an_exit():
    desk = Desk(height_m=5.0, east_m=-12.0).set(accuracy_m=0.3).come_to("flying", EXIT)
    desk.plan_delay_s = None
    desk._answers.clear()
    desk.run_until("landing_leg", 90.0).run_until("holding", 60.0)
    assert desk.companion.status.task.flown
    assert desk.said("no plan in 5 s, path kept")

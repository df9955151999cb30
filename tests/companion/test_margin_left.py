"""Escape routes that the margin blocks, and orders within the margin.

A wall with a window stands between the aircraft and the exit. The window needs 5.8 m and the
rounding to cells: 0.35 m of an X500 and PX4's margin, 1.4 m for the position, 1.15 m for tracking.
"""

from __future__ import annotations

import functools
from dataclasses import replace

import pytest
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.companion.error_margin import flown_site
from moar_companion.companion.planning.plan_jobs import PlanJob, answer_job
from moar_companion.companion.planning.planner_set import PlannerSet
from moar_companion.planner.plan_values import PlanRequest
from moar_companion.planner.plane_fence import Bound, PlaneFence
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Polygon, Site, Target
from moar_companion.settings.config import Supervision, shipped_configs
from moar_companion.settings.vehicle import Vehicle
from moar_companion.types import ARDUPILOT, PX4, Mission, RiskIndices

from .desk import DENIED, EXIT, TEMPORARILY_REJECTED, Desk, usual_planner

VEHICLE = Vehicle.load(shipped_configs() / "vehicles" / "x500.yaml")
MIDDLE_M = 10.05
START_M = (4.0, 5.0)


def walls(gap_m):
    """Two walls with a window between them."""
    below, above = MIDDLE_M - 0.5 * gap_m, MIDDLE_M + 0.5 * gap_m
    return tuple(
        Polygon(name=name, vertices_m=((14.0, low), (15.0, low), (15.0, high), (14.0, high)))
        for name, low, high in (("lower wall", -5.0, below), ("upper wall", above, 30.0))
    )


def behind_a_window(gap_m):
    site = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
    exits = {Mission.EXIT: site.landing_m[Mission.EXIT]}
    target = Target(name="beyond", position_m=(22.0, 10.0), dwell_s=5.0)
    return replace(
        site, obstacles=walls(gap_m), targets=(target,), landing_m=exits, start_m=START_M
    )


@functools.cache
def planner(gap_m):
    return Planner(flown_site(behind_a_window(gap_m), VEHICLE, Supervision()), VEHICLE)


def to_beyond(mission):
    return PlanRequest(
        mission=mission,
        target="beyond" if mission is Mission.INSPECTION else None,
        start_m=START_M,
        velocity_mps=(0.0, 0.0),
        weights=VEHICLE.weights[mission],
        risk=RiskIndices(),
    )


def answer(gap_m, mission, widening_m=0.0):
    job = PlanJob(job_id=1, request=to_beyond(mission), widening_m=widening_m)
    return answer_job(PlannerSet(planner(gap_m)), job)


def clearance_m(plan):
    return plan.metrics.min_clearance_m - VEHICLE.radius_m


@pytest.mark.parametrize(("gap_m", "narrowed_m"), [(6.6, 0.0), (5.6, 0.575), (4.2, 1.15)])
def test_an_escape_route_that_the_margin_blocks_is_planned_with_the_largest_margin_that_fits(
    gap_m, narrowed_m
):
    found = answer(gap_m, Mission.EXIT)
    assert found.plan is not None, found.reason
    assert found.narrowed_m == pytest.approx(narrowed_m)
    assert clearance_m(found.plan) >= 2.55 - narrowed_m - 1e-6


def test_an_escape_route_keeps_at_least_the_position_error():
    refused = answer(3.0, Mission.EXIT)
    assert refused.plan is None
    assert refused.reason.startswith("no free path")


def test_a_larger_position_error_counts_in_full():
    """Position error 0.6 m greater than that of the margin."""
    assert answer(4.2, Mission.EXIT, 0.6).plan is None
    found = answer(5.6, Mission.EXIT, 0.6)
    assert clearance_m(found.plan) >= 1.4 + 0.6 - 1e-6


def test_an_inspection_without_room_for_the_full_margin_has_no_path():
    refused = answer(5.6, Mission.INSPECTION)
    assert refused.plan is None
    assert refused.reason == "no path with margin 2.55 m"


CEILING = PlaneFence(bounds=(Bound(name="GF_MAX_VER_DIST 13 m", z_m=(-5.0, 13.0)),), margin_m=1.5)
"""Lower than walls 13.5 m high."""


@pytest.mark.parametrize(
    ("gap_m", "widening_m", "reason", "too_wide"),
    [
        (6.6, 0.6, "no free path to beyond", True),
        (5.6, 0.0, "no path with margin 2.55 m", False),
        (0.5, 0.0, "fence GF_MAX_VER_DIST 13 m", False),
    ],
)
def test_a_fence_is_named_as_reason_only_where_no_narrower_margin_opens_a_path(
    gap_m, widening_m, reason, too_wide
):
    """Without the fence there is always a path, over the walls."""
    site = behind_a_window(gap_m)
    obstacles = tuple(
        replace(wall, vertices_m=tuple((x, min(z, 13.5)) for x, z in wall.vertices_m))
        for wall in site.obstacles
    )
    known = PlannerSet(
        Planner(flown_site(replace(site, obstacles=obstacles), VEHICLE, Supervision()), VEHICLE)
    )
    free = PlanJob(job_id=1, request=to_beyond(Mission.INSPECTION), widening_m=widening_m)
    assert answer_job(known, free).plan is not None
    refused = answer_job(known, replace(free, fence=CEILING))
    assert (refused.plan, refused.too_wide) == (None, too_wide)
    assert refused.reason.startswith(reason)


def at_the_window(gap_m, **options):
    return Desk(planner=planner(gap_m), height_m=5.0, supervision=Supervision(), **options)


@pytest.mark.slow
def test_the_remaining_clearance_is_reported_and_the_gate_accepts_the_flight():
    desk = at_the_window(4.2).come_to("landing_leg", EXIT)
    assert any(text.startswith("MOAR: 1.7 m to ") for text in desk.texts()), desk.texts()
    assert desk.said(" wall < 2.55, exiting")
    assert not desk.said("no room here")
    assert not desk.said("too near")


@functools.cache
def beside_a_wall():
    """A target 3.1 m from a wall: hull and margin take 2.93 m, rounding the rest."""
    site = behind_a_window(4.2)
    wall = Polygon(name="wall", vertices_m=((10.0, 0.0), (16.0, 0.0), (16.0, 14.0), (10.0, 14.0)))
    target = Target(name="crack", position_m=(19.1, 8.0), dwell_s=60.0)
    site = replace(site, obstacles=(wall,), targets=(target,), start_m=(27.0, 2.5))
    return Planner(flown_site(site, VEHICLE, Supervision()), VEHICLE)


@pytest.mark.slow
def test_a_setpoint_that_a_small_jump_moves_into_the_margin_holds_and_resumes():
    desk = Desk(planner=beside_a_wall()).come_to("at_target")
    desk.jump(0.0, -0.7, 0.0)  # towards the wall
    desk.run_until("holding", 2.0)
    desk.run(0.1)
    assert desk.said("MOAR: no room here, margin 2.5 m, holding"), desk.texts()
    desk.run_until("at_target", 30.0)


@pytest.mark.parametrize(
    ("file", "received", "words"),
    [
        (PX4, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, "autopilot ardupilot, file px4"),
        (ARDUPILOT, mavlink.MAV_AUTOPILOT_PX4, "autopilot px4, file ardupilot"),
    ],
)
def test_an_autopilot_other_than_the_vehicle_files_is_reported_and_not_flown(file, received, words):
    """The margin of this autopilot differs from the planned one."""
    usual = usual_planner()
    other = Planner(usual.site, replace(usual.vehicle, autopilot=file))
    desk = Desk(planner=other, autopilot=received).run(1.2).order(EXIT).run(1.0)
    assert desk.answers()[-1] in {TEMPORARILY_REJECTED, DENIED}
    assert desk.said(f"MOAR: {words}, rejected"), desk.texts()
    assert not desk.setpoints()


def in_a_gust():
    """Flying to a target, 1 m off the setpoint: plans of the inspection keep more distance."""
    usual = usual_planner()
    guidance = replace(usual.vehicle.guidance, tracking_margin_m=0.2)
    desk = Desk(planner=Planner(usual.site, replace(usual.vehicle, guidance=guidance)))
    desk.set(contingencies=True)
    desk.come_to("flying").fall_behind(0.0, -1.0, 0.0, seconds=1.0).run(3.0)
    assert desk.jobs[-1].widening_m > 0.5
    return desk


def test_in_a_gust_an_ordered_exit_is_planned_without_the_momentary_tracking_error():
    desk = in_a_gust()
    desk.order(EXIT).run_until_requested("exit", 1.0)
    assert desk.jobs[-1].widening_m == 0.0


@pytest.mark.uncounted
def test_in_a_gust_contingencies_are_planned_without_the_momentary_tracking_error():
    desk = in_a_gust()
    begun = len(desk.contingency_jobs)
    desk.run(3.0)
    later = desk.contingency_jobs[begun:]
    assert {job.request.mission for job in later} == set(Mission)
    assert {job.widening_m for job in later} == {0.0}
    desk.set(accuracy_m=1.15).run(3.0)
    assert desk.contingency_jobs[-1].widening_m == pytest.approx(0.3)

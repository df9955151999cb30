"""Requests for routes and their answers, on a small site without an autopilot."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from moar_companion.companion.estimation.pose import Pose
from moar_companion.companion.guidance.splice import Adoption
from moar_companion.companion.mission.values import Task
from moar_companion.companion.planning.plan_jobs import answer_job
from moar_companion.companion.planning.planner_set import PlannerSet
from moar_companion.companion.planning.site_maps import SiteMaps
from moar_companion.companion.route_manager import RouteManager
from moar_companion.mavlink.autopilots import profile
from moar_companion.mavlink.autopilots.parameter_names import Parameters
from moar_companion.planner.plane_fence import Bound, PlaneFence
from moar_companion.planner.planner import Planner
from moar_companion.risk import RiskEstimate
from moar_companion.settings.config import CompanionConfig, shipped_configs
from moar_companion.types import PX4, Mission, RiskIndices

from ..losses import loss_of
from ..planner.problems import conductor, make_site, make_vehicle

INSPECTION = Task(mission=Mission.INSPECTION, stops=("target",))
EXIT = Task(mission=Mission.EXIT)
CALM = RiskIndices()
STEP_S = 0.1


def pose(x_m, z_m):
    return Pose(position_m=(x_m, 0.0, z_m), velocity_mps=(0.0, 0.0, 0.0), yaw_rad=0.0)


START = pose(0.5, 4.5)


class Routes:
    """A route manager beside a planner; the aircraft is wherever its setpoint is."""

    def __init__(self, *, known=True):
        self.planner = Planner(make_site(exits=[(-3.0, 4.5)]), make_vehicle())
        self.recorded = []
        reports = SimpleNamespace(record=self._record, send_text=lambda *_, **__: None)
        self.config = CompanionConfig(vehicle=shipped_configs())
        self.manager = RouteManager(
            self.planner.vehicle, self.config, reports, self.planner.site.margin
        )
        limits = self.manager.limits
        limits.take_ground(SiteMaps(site=self.planner.site, maps=self.planner.maps))
        limits.offboard_loss.loss = loss_of(PX4) if known else None
        unlimited = Parameters(dict.fromkeys(profile(PX4).fence_parameters, 0.0))
        limits._fences.learn(PX4, unlimited, (), None)
        self.now_s = 0.0

    def _record(self, kind, _now_s, **data):
        self.recorded.append((kind, data.get("reason")))

    def begin(self, task=INSPECTION):
        """Begins a task; returns its request with the answer."""
        assert self.manager.ask(task, START, CALM, self.now_s, first=True) is None
        (job,) = self.manager.plan_jobs()
        taken = self.answered(job)
        assert self.adopted(*taken) is Adoption.NEW_PATH
        return taken

    def answered(self, job):
        self.manager.plan_answered(answer_job(PlannerSet(self.planner), job))
        return self.manager.taken(self.now_s)

    def adopted(self, awaited, answer):
        estimate = RiskEstimate.unknown(self.planner.vehicle.risk)
        return self.manager.adopt(awaited, answer, estimate, self.now_s)

    def fly(self, *, until, most_s=60.0):
        here = START
        while not until(self.manager.flight) and self.now_s < most_s:
            self.manager.flight.advance(here, STEP_S)
            here = replace(here, position_m=self.manager.flight.progress(here).setpoint.position_m)
            self.now_s += STEP_S
        return here

    def asked(self, where, task=INSPECTION):
        """The jobs that a cycle with the aircraft at this place requests."""
        self.manager.replan(task, where, CALM, self.now_s)
        return self.manager.plan_jobs()


def test_no_plan_is_requested_before_the_position_is_known():
    routes = Routes()
    assert routes.manager.ask(INSPECTION, None, CALM, 0.0, first=True) is not None
    assert (routes.manager.plan_jobs(), routes.manager.flight) == ([], None)


def test_no_plan_is_requested_before_the_offboard_loss_action_is_known():
    routes = Routes(known=False)
    assert routes.manager.ask(INSPECTION, START, CALM, 0.0, first=True) is not None
    assert (routes.manager.plan_jobs(), routes.manager.flight) == ([], None)


def test_a_plan_that_comes_after_the_flights_end_is_not_flown():
    routes = Routes()
    routes.manager.ask(INSPECTION, START, CALM, 0.0, first=True)
    (job,) = routes.manager.plan_jobs()
    taken = routes.answered(job)
    routes.manager.end()
    assert routes.adopted(*taken) is Adoption.TOO_LATE
    assert routes.manager.flight is None


def test_an_aircraft_off_its_path_for_a_second_gets_a_plan_from_its_own_place():
    routes = Routes()
    routes.begin()
    beside = pose(0.5, 1.5)
    assert routes.asked(beside) == []
    routes.now_s += 0.9
    assert routes.asked(beside) == []
    routes.now_s += 0.2
    (job,) = routes.asked(beside)
    assert job.request.start_m == pytest.approx((0.5, 1.5))
    assert routes.recorded[-1] == ("replan", "3.0 m off the path")


def test_an_aircraft_that_returns_to_its_path_within_a_second_gets_no_new_plan():
    routes = Routes()
    routes.begin()
    for seconds, here in ((0.5, pose(0.5, 1.5)), (0.3, START), (0.9, pose(0.5, 1.5))):
        routes.now_s += seconds
        assert routes.asked(here) == []


def test_another_fence_of_the_autopilot_is_planned_for_at_once():
    routes = Routes()
    routes.begin()
    fence = PlaneFence(bounds=(Bound(name="polygon", x_m=((-5.0, 9.0),)),), margin_m=0.5)
    routes.manager.limits.fence = fence
    (job,) = routes.asked(START)
    assert job.fence == fence
    assert routes.recorded[-1] == ("replan", "the autopilot's fence is another")
    routes.adopted(*routes.answered(job))
    assert routes.asked(START) == []


def barred(routes, job):
    """The next job, where maps that bar the plan of this one come just before its answer."""
    answer = answer_job(PlannerSet(routes.planner), job)
    x_m, z_m = answer.plan.waypoints.position_m[len(answer.plan.states) // 2]
    site = make_site(conductor(x_m, z_m, 0.1, name="seen-1"), exits=[(-3.0, 4.5)])
    maps = Planner(site, routes.planner.vehicle).maps
    routes.manager.learn_maps(SiteMaps(site=site, maps=maps), routes.now_s)
    routes.manager.plan_answered(answer)
    assert routes.manager.taken(routes.now_s) is None
    (job,) = routes.manager.plan_jobs()
    return job


def test_a_landing_height_that_is_set_above_the_fence_limits_the_plans():
    routes = Routes()
    limits, vehicle = routes.manager.limits, routes.planner.vehicle
    ceiling = PlaneFence(bounds=(Bound(name="ceiling", z_m=(-5.0, 15.0)),), margin_m=0.5)
    limits._fences.plane = ceiling
    for height_m, fence in ((2.0, None), (20.0, ceiling), (2.0, None)):
        guidance = replace(vehicle.guidance, landing_height_m=height_m)
        limits.take_settings(replace(vehicle, guidance=guidance), routes.config)
        assert limits.fence == fence


@pytest.mark.parametrize("for_settings", [False, True])
def test_maps_for_settings_that_bar_the_place_are_not_taken_for_an_obstacle_seen_late(for_settings):
    routes = Routes()
    routes.begin()
    site = make_site(conductor(*START.position_m[::2], 0.1), exits=[(-3.0, 4.5)])
    site_maps = SiteMaps(site=site, maps=Planner(site, routes.planner.vehicle).maps)
    routes.manager.learn_maps(site_maps, routes.now_s, for_settings=for_settings)
    routes.asked(START)
    assert routes.manager.flight.barred_by is not None
    assert routes.manager.flight.seen_late is not for_settings


def test_the_wait_for_a_plan_is_not_ended_by_plans_that_newer_maps_bar():
    routes = Routes()
    routes.begin()
    routes.now_s = asked_s = 2.5
    (job,) = routes.asked(START)
    for _ in range(4):
        routes.now_s += 1.0
        job = barred(routes, job)
        assert routes.manager.awaited_for_s(routes.now_s) == pytest.approx(routes.now_s - asked_s)


def test_a_first_plan_that_newer_maps_bar_again_and_again_fails_after_five_seconds():
    routes = Routes()
    assert routes.manager.ask(INSPECTION, START, CALM, 0.0, first=True) is None
    (job,) = routes.manager.plan_jobs()
    for _ in range(4):
        routes.now_s += 1.2
        job = barred(routes, job)
    routes.now_s += 0.5
    _, answer = routes.manager.taken(routes.now_s)
    assert (answer.plan, answer.reason) == (None, "no plan in 5 s")


def test_a_landing_leg_that_a_pilot_interrupted_is_resumed_only_at_a_known_position():
    routes = Routes()
    routes.begin(EXIT)
    here = routes.fly(until=lambda flight: flight.on_leg and flight.progress(START).left_m < 1.0)
    routes.manager.end()
    assert not routes.manager.resume(EXIT, None)
    assert routes.manager.flight is None
    assert routes.manager.resume(EXIT, here)
    assert routes.manager.flight.on_leg


def test_an_interrupted_landing_leg_serves_no_other_task():
    routes = Routes()
    routes.begin(EXIT)
    here = routes.fly(until=lambda flight: flight.on_leg and flight.progress(START).left_m < 1.0)
    routes.manager.end()
    assert not routes.manager.resume(Task(mission=Mission.EVACUATION), here)

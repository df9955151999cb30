"""Escape routes that are always ready, the remaining flight, and the point of no return."""

from __future__ import annotations

import functools
import itertools
import math
from dataclasses import fields, replace

import pytest

from moar_companion.companion import cycle_inputs
from moar_companion.companion.planning.plan_jobs import PlanAnswer
from moar_companion.planner.planner import Planner
from moar_companion.risk.power import landing_s
from moar_companion.settings.config import Supervision
from moar_companion.types import PX4, Mission

from ..companion.desk import ACCEPTED, EXIT, INSPECTION, TEMPORARILY_REJECTED, Desk, usual_planner

UNRESERVED = Supervision(battery_reserve=0.0)


def desk_with_contingencies(**config):
    desk = Desk(wind_mps=2.0, **config)
    desk.contingencies = True
    return desk


def forecast(desk):
    return desk.companion.state.risk_monitor.energy_forecast


def test_in_the_air_both_escape_routes_are_ready_before_any_order():
    desk = desk_with_contingencies().run(2.0)
    routes, seen = forecast(desk), desk.companion
    assert (routes.finish, seen.plan_jobs(), desk.jobs) == (None, [], [])
    for mission, route in (("exit", routes.exit), ("evacuation", routes.evacuation)):
        x_m, _, z_m = seen.pose.position_m
        plan = desk.planner.plan(mission=mission, start=(x_m, z_m))
        # Slower than the plan's own times, which have no acceleration, and with the landing.
        assert plan.metrics.duration_s < route.duration_s < 1.5 * plan.metrics.duration_s + 15.0
        hovering_wh = 400.0 * route.duration_s / 3600.0
        assert route.energy_wh == pytest.approx(hovering_wh, rel=0.1)
        assert route.left_s == pytest.approx(routes.flight_s - route.duration_s, rel=0.05)
        planned_m = [tuple(point) for point in plan.waypoints.position_m.tolist()]
        corners_m = [(point.x_m, point.z_m) for point in route.path]
        assert corners_m[0] == pytest.approx((x_m, z_m), abs=0.2)
        assert corners_m[-1] == pytest.approx(planned_m[-1])
        assert len(corners_m) < 0.5 * len(planned_m)
        for corner_m in corners_m[1:]:
            assert min(math.dist(corner_m, point_m) for point_m in planned_m) < 0.3


def test_on_the_ground_no_escape_route_is_planned():
    desk = desk_with_contingencies()
    desk.landed_state = 1
    desk.run(3.0)
    assert desk.contingency_jobs == []
    assert forecast(desk).exit is None
    assert forecast(desk).better is None


def test_without_a_site_there_is_no_energy_forecast():
    assert Desk(with_site=False).run(1.0).companion.state.risk_monitor.energy_forecast is None


@pytest.mark.uncounted
def test_escape_routes_are_replanned_from_the_position_of_the_aircraft():
    desk = desk_with_contingencies().come_to("flying")
    for _ in range(5):
        desk.run(3.0)
        x_m, _, z_m = desk.companion.pose.position_m
        asked = [
            job.request for job in desk.contingency_jobs if job.request.mission.value == "exit"
        ]
        fresh_m = min(math.dist(request.start_m, (x_m, z_m)) for request in asked[-4:])
        assert fresh_m <= 0.7 * 2.5  # at most one round old, at 0.7 m/s


def test_one_route_is_requested_at_a_time_and_again_without_an_answer():
    desk = Desk().run(4.0)
    assert len(desk.contingency_jobs) == 1
    desk.run(4.0)
    assert len(desk.contingency_jobs) == 2
    first, second = desk.contingency_jobs
    late = PlanAnswer(job_id=first.job_id, plan=None)
    desk.companion.contingency_answered(late)
    desk.run(0.2)
    assert len(desk.contingency_jobs) == 2  # still awaited
    desk.companion.contingency_answered(PlanAnswer(job_id=second.job_id, plan=None))
    desk.run(0.2)
    assert len(desk.contingency_jobs) == 3
    assert desk.jobs == []


@functools.cache
def quick_planner():
    """Planner of an aircraft three times as fast as usual."""
    usual = usual_planner()
    speed = usual.vehicle.speed
    quick = {member.name: 3.0 * getattr(speed, member.name) for member in fields(speed)}
    return Planner(usual.site, replace(usual.vehicle, speed=replace(speed, **quick)))


@pytest.mark.slow
def test_the_mission_with_its_escape_route_becomes_shorter_in_flight():
    desk = desk_with_contingencies(planner=quick_planner()).come_to("flying", then_s=2.0)
    left = []
    while desk.state in {"flying", "at_target"}:
        left.append((desk.now_s, forecast(desk).finish.duration_s))
        desk.run(1.0)
    # The end predicted at the beginning is the end predicted at the end.
    ends = [at_s + rest_s for at_s, rest_s in left]
    assert max(ends) - min(ends) < 0.1 * left[0][1] + 5.0
    assert forecast(desk).finish is None
    desk.order(EXIT).run_until("flying", 2.0)
    desk.run(0.3)
    assert forecast(desk).finish == replace(forecast(desk).exit, path=())
    assert forecast(desk).better is Mission.EXIT
    desk.run_until("holding", 120.0)
    # The landing is left.
    landing = landing_s(desk.vehicle.guidance.landing_height_m, PX4)
    assert forecast(desk).finish.duration_s == pytest.approx(landing, abs=0.3)


@pytest.mark.slow
def test_the_companion_starts_an_exit_at_the_point_of_no_return():
    desk = desk_with_contingencies(supervision=UNRESERVED).set(battery_percent=60)
    desk.come_to("flying", then_s=4.0)
    # 17 % of 1,200 s are 204 s: after the escape route more than two minutes are left.
    desk.set(battery_percent=17).run(6.0)
    assert not desk.said("of flight left")
    desk.set(battery_percent=12).run(6.0)
    assert desk.companion.status.task.mission is Mission.INSPECTION
    soon = " s, due at 60"
    assert [text for text in desk.texts() if text.startswith("MOAR: exit leaves ") and soon in text]
    desk.set(battery_percent=6).run(6.0)
    assert desk.companion.status.task.mission is Mission.EXIT
    assert desk.said(" s <= 60, exiting")
    assert desk.companion.risk.indices.battery > 0.95
    desk.set(battery_percent=60).run(8.0)  # an escape route that has begun is flown
    assert desk.companion.status.task.mission is Mission.EXIT


def test_past_the_point_of_no_return_an_escape_route_alone_is_accepted():
    desk = desk_with_contingencies(supervision=UNRESERVED).set(battery_percent=6).run(6.0)
    desk.order(INSPECTION).run(0.5)
    assert desk.answers() == [TEMPORARILY_REJECTED]
    desk.order(EXIT).run(0.5)
    assert desk.answers()[-1] == ACCEPTED


@pytest.mark.slow
def test_a_silent_battery_does_not_delay_the_point_of_no_return():
    desk = desk_with_contingencies(supervision=UNRESERVED).set(battery_percent=13)
    desk.come_to("flying", then_s=4.0)
    desk.mute |= {"BATTERY_STATUS", "SYS_STATUS"}
    before_s = forecast(desk).flight_s
    desk.run(20.0)
    assert before_s - forecast(desk).flight_s == pytest.approx(20.0, rel=0.2)


def test_the_status_shows_the_remaining_energy_and_time():
    from moar_companion.companion.status import LatestDecisions

    desk = desk_with_contingencies().come_to("flying", then_s=3.0)
    status = LatestDecisions().status_of(
        desk.companion, desk.now_s, clock_offset_s=0.0, recorder=None
    )
    assert set(status["energy"]) == {
        "left_wh", "flight_s", "factor", "source", "finish", "exit", "evacuation", "better",
    }  # fmt: skip
    route = status["energy"]["exit"]
    assert set(route) == {"duration_s", "energy_wh", "left_s", "age_s", "path"}
    assert not status["energy"]["finish"]["path"]


def test_without_an_exit_the_evacuation_is_the_better_route():
    desk = desk_with_contingencies()
    answer = desk.companion.contingency_answered

    def without_exit(given):
        job = next(job for job in desk.contingency_jobs if job.job_id == given.job_id)
        gone = job.request.mission is Mission.EXIT
        answer(PlanAnswer(job_id=given.job_id, plan=None) if gone else given)

    desk.companion.contingency_answered = without_exit
    desk.run(3.0)
    assert forecast(desk).exit is None
    assert forecast(desk).better is Mission.EVACUATION


def test_requests_alternate_among_all_needed_routes():
    desk = desk_with_contingencies().come_to("flying")
    begun = len(desk.contingency_jobs)
    desk.run(4.0)
    asked = [
        (job.request.mission.value, job.request.target) for job in desk.contingency_jobs[begun:]
    ]
    # Escape from here, inspection of the second target, escape from there.
    kinds = {("exit", None), ("evacuation", None), ("inspection", "splice-inner")}
    assert set(asked) == kinds
    assert all(first != second for first, second in itertools.pairwise(asked))


@pytest.mark.parametrize("speed_mps", [60.0, 3e38])
def test_an_escape_route_is_planned_despite_an_impossible_velocity(speed_mps):
    desk = desk_with_contingencies()
    desk.velocity_ned_mps = (0.0, speed_mps, 0.0)
    desk.run(3.0)
    assert forecast(desk).exit.duration_s > 0.0


def test_beside_the_plane_without_control_no_route_is_requested():
    desk = desk_with_contingencies()
    desk.position_ned_m = (30.0, 0.0, -2.6)
    desk.run(3.0)
    assert desk.contingency_jobs == []


# Lost inputs ------------------------------------------------------------------------------------


@functools.cache
def far_exit_planner():
    """Planner with a far exit and a near evacuation."""
    usual = usual_planner()
    landing_m = {Mission.EXIT: ((400.0, 2.5),), Mission.EVACUATION: ((-10.0, 2.5),)}
    return Planner(replace(usual.site, landing_m=landing_m), usual.vehicle)


def left_after_exit(desk):
    reports = desk.companion.risk.report.battery.inputs
    return next(report for report in reports if report.name == "flight time left after exit")


@pytest.mark.slow
@pytest.mark.parametrize("landed", ["silent", "undefined"])
def test_a_landed_state_no_longer_reported_changes_nothing(landed):
    desk = desk_with_contingencies(supervision=UNRESERVED, planner=far_exit_planner())
    desk.set(battery_percent=25).run(10.0)
    before = desk.companion.risk.indices.battery
    assert before > 0.9
    if landed == "silent":
        desk.mute |= {"EXTENDED_SYS_STATE"}
    else:
        desk.set(landed_state=0)
    desk.run(20.0)
    assert left_after_exit(desk).applies
    assert left_after_exit(desk).known
    assert desk.companion.risk.indices.battery >= before - 0.01
    desk.set(landed_state=1).mute.clear()
    assert not left_after_exit(desk.run(1.0)).applies


@pytest.mark.uncounted
def test_without_the_landed_state_the_point_of_no_return_starts_an_exit():
    desk = desk_with_contingencies(supervision=UNRESERVED).set(battery_percent=60)
    desk.come_to("flying", then_s=2.0)
    desk.mute |= {"EXTENDED_SYS_STATE"}
    desk.run(8.0).set(battery_percent=6).run(6.0)
    assert desk.companion.status.task.mission is Mission.EXIT


@pytest.mark.uncounted
def test_beside_the_plane_the_escape_route_includes_the_return_to_the_plane():
    desk = desk_with_contingencies(supervision=UNRESERVED, planner=far_exit_planner())
    desk.set(battery_percent=25).run(10.0)
    before, stopping_s = desk.companion.risk.indices.battery, forecast(desk).exit.duration_s
    desk.drift(60.0, 0.0, 0.0, seconds=12.0).run(2.0)
    speed_mps = desk.vehicle.speed.horizontal_mps
    assert forecast(desk).exit.duration_s == pytest.approx(stopping_s + 60.0 / speed_mps, rel=0.1)
    assert desk.companion.risk.indices.battery >= before - 0.01


@pytest.mark.uncounted
@pytest.mark.parametrize(
    "planner", ["has no way", pytest.param("is silent", marks=pytest.mark.slow)]
)
def test_an_escape_route_no_longer_planned_keeps_counting(planner):
    desk = desk_with_contingencies(supervision=UNRESERVED).set(battery_percent=60)
    desk.come_to("flying", then_s=4.5)  # just after a round of requests, not just before one
    begins_m, stopping_s = desk.companion.pose.position_m, forecast(desk).exit.duration_s
    if planner == "is silent":
        desk.contingencies = False
    else:
        answer = desk.companion.contingency_answered
        desk.companion.contingency_answered = lambda given: answer(replace(given, plan=None))
    desk.run(15.0)
    away_m = math.dist(desk.companion.pose.position_m, begins_m)
    assert away_m > 2.0
    back_s = away_m / desk.vehicle.speed.horizontal_mps
    assert forecast(desk).exit.duration_s == pytest.approx(stopping_s + back_s, abs=2.5)
    assert forecast(desk).exit.age_s == pytest.approx(15.0, abs=3.0)
    assert left_after_exit(desk).known
    assert any("escape route" in item.reason for item in desk.companion.ruling.conditions)
    desk.set(battery_percent=6).run(6.0)
    assert desk.said(" s <= 60, exiting")


@pytest.mark.slow
def test_an_exit_beyond_the_battery_is_replaced_by_an_evacuation():
    desk = desk_with_contingencies(supervision=UNRESERVED, planner=far_exit_planner())
    desk.set(battery_percent=80).come_to("flying", then_s=4.0)
    desk.order(EXIT).run(1.0)
    assert forecast(desk).better is Mission.EXIT
    desk.set(battery_percent=25).run(5.0)
    assert forecast(desk).exit.left_s < 60.0 < forecast(desk).evacuation.left_s
    assert desk.companion.status.task.mission is Mission.EVACUATION
    assert desk.said("exit leaves no flight time, evacuating")
    desk.run(8.0)
    assert desk.companion.status.task.mission is Mission.EVACUATION


@pytest.mark.uncounted
def test_a_flown_escape_route_beyond_the_battery_is_reported():
    desk = desk_with_contingencies(supervision=UNRESERVED).set(battery_percent=80)
    desk.come_to("flying", then_s=2.0)
    desk.order(EXIT).run_until("flying", 5.0).run(2.0)
    desk.set(battery_percent=6).run(6.0)
    assert desk.companion.status.task.mission is Mission.EXIT
    assert desk.said(" s <= 60, exiting")


@pytest.mark.uncounted
def test_a_mission_flown_slowly_takes_longer():
    desk = desk_with_contingencies().come_to("flying", then_s=2.0)
    desk.plan_delay_s = None
    desk.run(5.0)
    before = forecast(desk).finish
    desk.run(3.0)
    assert forecast(desk).finish.duration_s > 1.2 * before.duration_s
    assert forecast(desk).finish.energy_wh > 1.2 * before.energy_wh


# An exit that is flown --------------------------------------------------------------------------


@functools.cache
def far_evacuation_planner():
    """Planner whose evacuation costs more than the exit, but less than twice as much."""
    usual = usual_planner()
    landing_m = {Mission.EXIT: ((60.0, 2.5),), Mission.EVACUATION: ((-20.0, 2.5),)}
    return Planner(replace(usual.site, landing_m=landing_m), usual.vehicle)


def exit_is_flown(planner=far_exit_planner):
    """Flies an exit for two seconds; returns the desk, its contingencies and the scene."""
    desk = desk_with_contingencies(supervision=UNRESERVED, planner=planner())
    desk.come_to("flying", then_s=0.5)
    desk.order(EXIT).run(2.0)
    assert desk.companion.status.task.mission is Mission.EXIT
    state = desk.companion.state
    return desk, state.risk_monitor.contingencies, cycle_inputs.scene(state)


def seen_with(routes, scene, left_s, now_s, pace=1.0):
    """Inputs of the supervisor with a given remaining flight time at this pace."""
    left_wh = left_s * 400.0 / 3600.0
    scene = replace(scene, pace=pace, meter=replace(scene.meter, left_wh=left_wh))
    routes.update(scene, now_s)
    return routes.escape_route(scene.meter)


def test_a_slow_exit_is_replaced_only_where_a_fast_one_would_be():
    desk, routes, scene = exit_is_flown()
    need_s = (
        routes.energy_forecast(scene.meter).flight_s
        - routes.energy_forecast(scene.meter).exit.left_s
    )
    slow = seen_with(routes, scene, need_s + 90.0, desk.now_s, pace=0.5)
    assert slow.left_s < 0.0
    assert (slow.mission, slow.flown_left_s) == (Mission.EXIT, None)
    slow = seen_with(routes, scene, need_s + 30.0, desk.now_s, pace=0.5)
    assert slow.mission is Mission.EVACUATION
    assert slow.flown_left_s < 0.0


def test_a_slow_exit_is_compared_with_an_evacuation_at_the_same_pace():
    desk, routes, scene = exit_is_flown(far_evacuation_planner)
    known = routes.energy_forecast(scene.meter)
    assert known.exit.energy_wh < known.evacuation.energy_wh < 1.6 * known.exit.energy_wh
    slow = seen_with(routes, scene, 30.0, desk.now_s, pace=0.5)
    assert (slow.mission, slow.flown_left_s) == (Mission.EXIT, None)


def test_an_exit_at_rest_after_braking_has_not_arrived():
    desk, routes, scene = exit_is_flown()
    before = forecast(desk).exit
    scene.flight.stop_at(scene.flight.progress(scene.pose).setpoint.position_m)
    routes.update(scene, desk.now_s)
    after = routes.energy_forecast(scene.meter)
    assert after.exit.duration_s == pytest.approx(before.duration_s, rel=0.1)
    assert after.finish == replace(after.exit, path=())


def test_without_control_an_earlier_exit_has_no_preference():
    desk, routes, scene = exit_is_flown()
    assert seen_with(routes, scene, 900.0, desk.now_s).mission is Mission.EXIT
    routes.wait(scene.pose.position_m, desk.now_s)
    escape_route = routes.escape_route(scene.meter)
    assert (escape_route.mission, escape_route.flown_left_s) == (Mission.EVACUATION, None)


# Against the wind -------------------------------------------------------------------------------


def exit_s(routes, scene, now_s, wind_mps):
    """Duration of the exit in a wind along the plane; None: wind unknown."""
    wind_mps = None if wind_mps is None else (wind_mps, 0.0, 0.0)
    routes.update(replace(scene, wind_mps=wind_mps), now_s)
    return routes.energy_forecast(scene.meter).exit.duration_s


def test_an_exit_against_the_wind_takes_the_time_the_wind_allows():
    desk, routes, scene = exit_is_flown()
    calm_s = exit_s(routes, scene, desk.now_s, 0.0)
    assert exit_s(routes, scene, desk.now_s, 18.0) == pytest.approx(calm_s)
    # Leaning by 0.52 rad, (0.2 + 0.005 u) u = 5.61 m/s^2 at u = 19.03 m/s: 0.53 are left of 0.7.
    assert desk.vehicle.speed.horizontal_mps == 0.7
    against_s = exit_s(routes, scene, desk.now_s, -18.5)
    assert against_s == pytest.approx(0.7 / 0.53 * calm_s, rel=0.02)
    assert against_s > exit_s(routes, scene, desk.now_s, -18.4) > calm_s


def test_the_headwind_is_applied_with_the_drag_it_was_estimated_with():
    """A lean nearly at its limit leaves little speed, for any drag that gives the wind."""
    desk, routes, scene = exit_is_flown()
    expected_s = exit_s(routes, scene, desk.now_s, -18.5)
    learnt = replace(scene, model=replace(scene.model, drag_per_s=1.0))
    # (1 + 0.005 u) u = 5.61 m/s^2 at u = 5.46 m/s.
    assert exit_s(routes, learnt, desk.now_s, -4.93) == pytest.approx(expected_s, rel=0.02)
    assert exit_s(routes, scene, desk.now_s, -4.93) < 0.8 * expected_s


def test_the_last_wind_counts_when_no_wind_is_reported():
    desk, routes, scene = exit_is_flown()
    against_s = exit_s(routes, scene, desk.now_s, -18.5)
    assert exit_s(routes, scene, desk.now_s, None) == against_s
    routes.end()
    assert exit_s(routes, scene, desk.now_s, None) < against_s

"""Position uncertainty beyond the keep-outs' allowance: plans keep farther away, or hold.

The site is the double circuit of 315 kV, the aircraft the LineDrone as flown. The cells of both
targets have 0.55 m to the nearest keep-out. Keep-outs allow for 0.9 m.
"""

from __future__ import annotations

import math

import pytest

from moar_companion.companion.estimation.pose import Setpoint
from moar_companion.companion.guidance.flight_volume import FlightVolume
from moar_companion.companion.guidance.plan_path import CheckedLeg
from moar_companion.companion.planning.plan_jobs import PlanJob, answer_job
from moar_companion.companion.planning.planner_set import PlannerSet
from moar_companion.planner.plan_values import PlanRequest
from moar_companion.types import ARDUPILOT, Mission, RiskIndices, Weights

from ..companion.desk import (
    ACCEPTED,
    DENIED,
    EVACUATION,
    EXIT,
    INSPECTION,
    TEMPORARILY_REJECTED,
    Desk,
    usual_planner,
)
from ..losses import loss_of

INNER = 1
"""The second target, which is sought first where only it is ordered."""
TOO_CLOSE = "target splice-inner at (9.3375, 10.99) is too close to an obstacle or too low"


@pytest.fixture(scope="module")
def planner():
    return usual_planner()


@pytest.fixture
def desk(planner):
    return Desk(planner=planner)


def rooms_m(desk, since_s):
    """Distances from the hull to the nearest keep-out at every moving setpoint, by cells."""
    plane, maps = desk.companion.state.pose_tracker.plane, desk.planner.maps
    rooms = []
    for message in desk.setpoints(since_s):
        if any((message.vx, message.vy, message.vz)):
            x_m, _, z_m = plane.position_from_ned((message.x, message.y, message.z))
            cell = maps.grid.cell_of((x_m, z_m))
            rooms.append(math.inf if cell is None else float(maps.room_m[cell]))
    return rooms


def widenings(desk):
    """Obstacle inflations of the jobs in order, without repeats."""
    widths = [round(job.widening_m, 6) for job in desk.jobs]
    return [width for n, width in enumerate(widths) if n == 0 or width != widths[n - 1]]


# Before the flight ------------------------------------------------------------------------------


def test_a_target_too_close_is_denied_with_the_uncertainty_until_it_improves(
    desk,
):
    desk.set(accuracy_m=1.6).run(1.2).order(INSPECTION, INNER).run(0.5)
    assert (desk.state, desk.answers()) == ("idle", [DENIED])
    assert desk.said("MOAR: no path, uncertainty 1.6 m")
    desk.set(accuracy_m=1.2).run(4.5).order(INSPECTION, INNER).run_until("ready", 1.0)
    assert desk.answers()[-1] == ACCEPTED


def test_above_the_uncertainty_limit_no_plan_is_requested(desk):
    desk.set(accuracy_m=2.4).run(3.0).order(INSPECTION).run(0.5)
    assert (desk.state, desk.answers(), desk.jobs) == ("idle", [TEMPORARILY_REJECTED], [])
    assert desk.said("uncertainty 2.4 m > 2")


def test_a_failure_not_caused_by_the_uncertainty_is_reported_without_it(desk):
    desk.set(accuracy_m=1.6).run(1.2).plan_delay_s = None
    desk.order(INSPECTION).step()
    desk.answer_plan(plan=None, reason="the goal cannot be reached").run(0.1)
    assert desk.said("MOAR: the goal cannot be reached")
    assert not desk.said("uncertainty")


# In flight --------------------------------------------------------------------------------------


def test_a_worse_position_accuracy_inflates_obstacles_and_the_mission_continues(desk):
    desk.come_to("flying", then_s=4.0)
    desk.set(accuracy_m=1.35).run(1.0)
    began = desk.now_s
    desk.run_until("at_target", 60.0)
    assert widenings(desk) == [0.0, 0.5]
    assert [item["reason"] for item in desk.decided("replan")].count(
        "obstacles wider by 0.0 -> 0.5 m"
    ) == 1
    assert min(rooms_m(desk, began)) >= 0.45
    assert not desk.said("holding")


@pytest.mark.slow
def test_a_worse_height_accuracy_holds_until_it_improves(desk):
    """A gust disturbs the barometer, while the receiver's accuracy is good."""
    desk.set(accuracy_m=0.3).come_to("flying", then_s=4.0)
    desk.set(height_accuracy_m=1.35).run(2.0)
    assert widenings(desk) == [0.0, 0.5]
    desk.set(height_accuracy_m=1.6).run_until("holding", 20.0)
    assert desk.said("no path, uncertainty 1.6 m")
    desk.set(height_accuracy_m=2.4).run(3.0).order(EXIT).run(0.5)
    assert desk.said("uncertainty 2.4 m > 2, rejected")
    # A height accuracy no longer reported is no better.
    desk.set(height_accuracy_m=math.nan).run(8.0)
    assert desk.state == "holding"
    desk.set(height_accuracy_m=0.3).run_until("flying", 8.0)


@pytest.mark.slow
def test_a_varying_accuracy_causes_one_new_plan(desk):
    desk.come_to("flying")
    for second in range(20):
        desk.set(accuracy_m=1.2 + 0.04 * (-1) ** second).run(1.0)
    assert widenings(desk) in ([0.0, 0.3, 0.4], [0.0, 0.4])


@pytest.mark.slow
def test_a_target_that_becomes_too_close_is_a_hold_until_the_accuracy_improves(
    desk,
):
    desk.come_to("at_target").run_until("flying", 10.0)
    desk.run(4.0).set(accuracy_m=1.6).run_until("holding", 2.0)
    assert desk.said("MOAR: no path, uncertainty 1.6 m")
    asked = len(desk.jobs)
    desk.run(15.0)
    assert (desk.state, len(desk.jobs)) == ("holding", asked)  # no needless planning
    assert rooms_m(desk, desk.now_s - 10.0) == []
    desk.set(accuracy_m=0.5).run_until("flying", 6.0)
    assert desk.said("MOAR: resuming")
    assert desk.companion.status.task.stops == ("splice-inner",)


def test_an_operators_hold_during_the_wait_does_not_resume(desk):
    desk.come_to("flying", then_s=4.0).set(accuracy_m=1.6).run_until("holding", 2.0)
    desk.pause().run(1.0).set(accuracy_m=0.5).run(15.0)
    assert desk.state == "holding"
    desk.go_on().run_until("flying", 1.0)


def test_a_continue_towards_a_target_too_close_is_denied_with_the_uncertainty(desk):
    desk.come_to("flying", then_s=4.0).set(accuracy_m=1.6).run_until("holding", 2.0)
    desk.run(3.0).go_on().run(1.0)
    assert desk.state == "holding"
    assert desk.said("MOAR: no path, uncertainty 1.6 m, denied")


@pytest.mark.slow
def test_above_the_limit_escape_routes_are_planned_as_at_the_limit(desk):
    """On a large site each step of the inflation takes seconds to build."""
    desk.set(contingencies=True).come_to("flying", then_s=2.0)
    for accuracy_m in (1.5, 2.4, 3.9, 7.2):
        desk.set(accuracy_m=accuracy_m).run(5.0)
    widths = {round(job.widening_m, 3) for job in desk.contingency_jobs}
    assert widths == {0.0, 0.6, 1.1}


def test_an_uncertainty_above_the_limit_is_reported_with_the_limit(desk):
    desk.come_to("flying", then_s=4.0).set(accuracy_m=2.4).run_until("holding", 2.0)
    assert desk.said("MOAR: uncertainty 2.4 m > 2")
    desk.set(accuracy_m=0.5).run_until("flying", 8.0)


# Too little clearance ---------------------------------------------------------------------------


def test_the_setpoint_gate_holds_while_the_planner_does_not_answer(desk):
    desk.come_to("at_target").order(EXIT).run_until("flying", 1.0)
    desk.plan_delay_s = None
    desk.set(accuracy_m=1.8).run_until("holding", 1.5)
    assert desk.said("MOAR: no room here, uncertainty 1.8 m")
    stopped = desk.now_s
    desk.run(0.5)
    assert rooms_m(desk, stopped) == []


@pytest.mark.parametrize("order", [EXIT, EVACUATION])
def test_an_escape_leg_leaves_a_place_with_too_little_clearance(desk, order):
    desk.come_to("at_target").set(accuracy_m=1.8).run(1.0).order(order).run_until("flying", 1.0)
    assert desk.answers()[-1] == ACCEPTED
    began = desk.now_s
    desk.run_until("landing_leg", 60.0)
    rooms = rooms_m(desk, began)
    out = next(n for n, room_m in enumerate(rooms) if room_m >= 0.9)
    assert rooms[0] < 0.9
    assert rooms[:out] == sorted(rooms[:out])  # away from the conductor
    assert min(rooms[out:]) >= 0.9
    assert not desk.said("holding")


def test_a_hold_with_too_little_clearance_resumes_by_an_escape_leg(desk):
    desk.come_to("at_target").order(EVACUATION).run_until("flying", 1.0).run(0.2)
    desk.set(accuracy_m=1.8).run_until("holding", 1.5)
    assert desk.said("no room here")
    desk.run_until("flying", 2.0).run(3.0)
    assert desk.state == "flying"
    assert any(answer.escape_m for _, answer in desk.answered)
    assert desk.companion.status.task.mission is Mission.EVACUATION


def test_an_escape_route_of_a_low_battery_continues_with_too_little_clearance(desk):
    desk.come_to("at_target").set(battery_percent=19).run_until_requested("exit")
    desk.run(0.3).set(accuracy_m=1.8)
    stopped = desk.now_s
    desk.run_until("landing_leg", 60.0)
    reasons = [item["reason"] for item in desk.decided("replan")]
    assert reasons.count("no progress") == 1
    # The setpoint stood for less than 2 s.
    still = [not any((m.vx, m.vy, m.vz)) for m in desk.setpoints(stopped)]
    assert 0 < sum(still) < 100


def test_an_escape_route_not_found_is_planned_again_when_the_accuracy_improves(desk):
    desk.come_to("flying", then_s=4.0)
    desk.plan_delay_s = None
    desk.set(battery_percent=19, accuracy_m=1.5)
    for mission in ("exit", "evacuation"):
        desk.run_until_requested(mission, 8.0)
        desk.answer_plan(plan=None, reason="no free border cell", too_wide=True)
    desk.run_until("holding", 1.0)
    assert desk.said("no path, uncertainty 1.5 m, no evacuation")
    asked = len(desk.jobs)
    desk.run(8.0)
    assert len(desk.jobs) - asked <= 4  # every two seconds
    desk.set(accuracy_m=0.5).plan_delay_s = 0.04
    desk.run_until("flying", 6.0)


# Legs -------------------------------------------------------------------------------------------


def setpoint(speed_mps):
    return Setpoint(position_m=(40.0, 0.0, 3.0), velocity_mps=(speed_mps, 0.0, 0.0), yaw_rad=0.0)


@pytest.mark.parametrize(
    ("room_m", "widened_m", "speed_mps", "passes"),
    [
        (0.5, 0.4, 1.0, True),
        (0.5, 0.5, 1.0, True),
        (0.5, 0.6, 1.0, False),
        (0.5, 0.6, 0.0, True),  # at rest any accuracy is enough
        (math.inf, 9.0, 1.0, True),
    ],
)
def test_a_checked_leg_allows_setpoints_within_its_clearance(
    planner, room_m, widened_m, speed_mps, passes
):
    volume = FlightVolume(
        site=planner.site,
        vehicle=planner.vehicle,
        maps=planner.maps,
        loss=loss_of(ARDUPILOT, GUID_TIMEOUT=0.5),
    )
    leg = CheckedLeg(points_m=((30.0, 0.0, 3.0), (45.0, 0.0, 3.0)), room_m=room_m)
    refused = volume.refusal(
        setpoint(speed_mps), (leg,), plane_tolerance_m=2.0, widened_m=widened_m
    )
    assert (refused is None) is passes


# Jobs -------------------------------------------------------------------------------------------


def job(mission, target=None, *, start_m=(27.0, 2.6), widening_m):
    return PlanJob(
        job_id=1,
        request=PlanRequest(
            mission=mission,
            target=target,
            start_m=start_m,
            velocity_mps=(0.0, 0.0),
            weights=Weights(safety=0.0, time=0.9, energy=0.1),
            risk=RiskIndices(),
        ),
        widening_m=widening_m,
    )


@pytest.mark.parametrize("widening_m", [0.0, 0.3, 0.5])
def test_a_plan_keeps_the_inflation_of_its_job(planner, widening_m):
    answer = answer_job(
        PlannerSet(planner), job(Mission.INSPECTION, "splice-inner", widening_m=widening_m)
    )
    cells = answer.plan.states[:, :2]
    rooms = planner.maps.room_m[cells[:, 0], cells[:, 1]]
    assert rooms.min() >= widening_m - 1e-9
    assert (answer.reach is None) is (widening_m == 0.0)


def test_the_inflation_reduces_the_free_distance_of_a_plan(planner):
    answer = answer_job(
        PlannerSet(planner), job(Mission.INSPECTION, "splice-inner", widening_m=0.5)
    )
    exact = planner.maps.reach
    assert answer.reach.blocked.sum() > exact.blocked.sum()


@pytest.mark.parametrize(
    ("case", "target", "start_m", "too_wide"),
    [
        ("the target is too near", "splice-inner", (27.0, 2.6), True),
        ("from within a conductor there is no way", "splice-inner", (9.17, 3.7), False),
        ("no such target", "splice-9", (27.0, 2.6), False),
    ],
)
def test_the_inflation_is_the_reason_only_where_a_plan_exists_without_it(
    planner, case, target, start_m, too_wide
):
    answer = answer_job(
        PlannerSet(planner), job(Mission.INSPECTION, target, start_m=start_m, widening_m=0.8)
    )
    assert (answer.plan, answer.too_wide) == (None, too_wide), case


def test_a_landing_leg_has_its_clearance(planner):
    plan = answer_job(PlannerSet(planner), job(Mission.EXIT, widening_m=0.0)).plan
    ends = plan.landing_leg.points_m[[0, -1]]
    nearest_m = min(
        math.dist(item.position_m, (x_m, z_m)) - item.radius_m - item.keep_out_m
        for item in planner.site.obstacles
        for x_m, z_m in ends
    )
    assert plan.landing_leg.room_m == pytest.approx(nearest_m - planner.vehicle.radius_m, abs=0.3)

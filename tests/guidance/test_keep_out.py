"""A position that is known worse than the keep-outs allow for: plans keep farther away, or hold.

The desk's site is the double circuit of 315 kV, its aircraft the LineDrone as flown; both targets'
cells have 0.55 m to the nearest keep-out. Keep-outs allow for 0.9 m.
"""

from __future__ import annotations

import math

import pytest

from moar_companion import autopilots
from moar_companion.estimation.pose import Setpoint
from moar_companion.guidance.flight_volume import FlightVolume
from moar_companion.guidance.plan_path import CheckedLeg
from moar_companion.planner.plan_values import PlanRequest
from moar_companion.planning.plan_jobs import PlanJob, answer_job
from moar_companion.planning.planner_set import PlannerSet
from moar_companion.types import Mission, RiskIndices, Weights

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
    """From the hull at every moving setpoint since then to the nearest keep-out, by cells."""
    plane, maps = desk.companion._pose_tracker.plane, desk.planner.maps
    rooms = []
    for message in desk.setpoints(since_s):
        if any((message.vx, message.vy, message.vz)):
            x_m, _, z_m = plane.position_from_ned((message.x, message.y, message.z))
            cell = maps.grid.cell_of((x_m, z_m))
            rooms.append(math.inf if cell is None else float(maps.room_m[cell]))
    return rooms


def widenings(desk):
    """Obstacle inflations of the jobs, one after another."""
    widths = [round(job.widening_m, 6) for job in desk.jobs]
    return [width for n, width in enumerate(widths) if n == 0 or width != widths[n - 1]]


# Before the flight ------------------------------------------------------------------------------


def test_a_target_that_is_too_near_is_denied_with_the_number_until_the_position_is_known_better(
    desk,
):
    desk.set(accuracy_m=1.6).run(1.2).order(INSPECTION, INNER).run(0.5)
    assert (desk.state, desk.answers()) == ("idle", [DENIED])
    assert desk.said("MOAR: no path, uncertainty 1.6 m")
    desk.set(accuracy_m=1.2).run(4.5).order(INSPECTION, INNER).run_until("ready", 1.0)
    assert desk.answers()[-1] == ACCEPTED


def test_above_the_limit_nothing_is_planned_at_all(desk):
    desk.set(accuracy_m=2.4).run(3.0).order(INSPECTION).run(0.5)
    assert (desk.state, desk.answers(), desk.jobs) == ("idle", [TEMPORARILY_REJECTED], [])
    assert desk.said("uncertainty 2.4 m > 2")


def test_what_no_uncertainty_is_to_blame_for_is_told_without_one(desk):
    desk.set(accuracy_m=1.6).run(1.2).plan_delay_s = None
    desk.order(INSPECTION).step()
    desk.answer_plan(plan=None, reason="the goal cannot be reached").run(0.1)
    assert desk.said("MOAR: the goal cannot be reached")
    assert not desk.said("uncertainty")


# In flight --------------------------------------------------------------------------------------


def test_when_the_position_is_known_worse_the_plan_takes_obstacles_wider_and_goes_on(desk):
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


def test_a_height_that_is_known_worse_is_kept_away_from_until_it_is_known_again(desk):
    """A barometer that a gust fools, while the receiver's sky is open."""
    desk.set(accuracy_m=0.3).come_to("flying", then_s=4.0)
    desk.set(height_accuracy_m=1.35).run(2.0)
    assert widenings(desk) == [0.0, 0.5]
    desk.set(height_accuracy_m=1.6).run_until("holding", 20.0)
    assert desk.said("no path, uncertainty 1.6 m")
    desk.set(height_accuracy_m=2.4).run(3.0).order(EXIT).run(0.5)
    assert desk.said("uncertainty 2.4 m > 2, rejected")
    # A height that is told no more is no better known.
    desk.set(height_accuracy_m=math.nan).run(8.0)
    assert desk.state == "holding"
    desk.set(height_accuracy_m=0.3).run_until("flying", 8.0)


def test_an_accuracy_that_wavers_makes_one_plan_anew(desk):
    desk.come_to("flying")
    for second in range(20):
        desk.set(accuracy_m=1.2 + 0.04 * (-1) ** second).run(1.0)
    assert widenings(desk) in ([0.0, 0.3, 0.4], [0.0, 0.4])


def test_it_holds_when_the_target_is_too_near_now_and_goes_on_when_the_position_is_known_better(
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


def test_what_an_operator_holds_meanwhile_waits_for_him(desk):
    desk.come_to("flying", then_s=4.0).set(accuracy_m=1.6).run_until("holding", 2.0)
    desk.pause().run(1.0).set(accuracy_m=0.5).run(15.0)
    assert desk.state == "holding"
    desk.go_on().run_until("flying", 1.0)


def test_a_continue_that_is_still_too_near_is_denied_with_the_number(desk):
    desk.come_to("flying", then_s=4.0).set(accuracy_m=1.6).run_until("holding", 2.0)
    desk.run(3.0).go_on().run(1.0)
    assert desk.state == "holding"
    assert desk.said("MOAR: no path, uncertainty 1.6 m, denied")


def test_above_the_limit_escape_routes_are_measured_as_at_the_limit(desk):
    """While it grows, each step of a great site's obstacles takes seconds to build."""
    desk.set(contingencies=True).come_to("flying", then_s=2.0)
    for accuracy_m in (1.5, 2.4, 3.9, 7.2):
        desk.set(accuracy_m=accuracy_m).run(5.0)
    widths = {round(job.widening_m, 3) for job in desk.contingency_jobs}
    assert widths == {0.0, 0.6, 1.1}


def test_a_limit_that_is_passed_is_told_as_such(desk):
    desk.come_to("flying", then_s=4.0).set(accuracy_m=2.4).run_until("holding", 2.0)
    assert desk.said("MOAR: uncertainty 2.4 m > 2")
    desk.set(accuracy_m=0.5).run_until("flying", 8.0)


# Where it has become too narrow -----------------------------------------------------------------


def test_the_gate_has_the_last_word_while_the_planner_says_nothing(desk):
    desk.come_to("at_target").order(EXIT).run_until("flying", 1.0)
    desk.plan_delay_s = None
    desk.set(accuracy_m=1.8).run_until("holding", 1.5)
    assert desk.said("MOAR: no room here, uncertainty 1.8 m")
    stopped = desk.now_s
    desk.run(0.5)
    assert rooms_m(desk, stopped) == []


@pytest.mark.parametrize("order", [EXIT, EVACUATION])
def test_out_of_where_it_is_too_narrow_leads_an_escape_leg(desk, order):
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


def test_what_is_stopped_where_it_is_too_narrow_goes_on_by_an_escape_leg(desk):
    desk.come_to("at_target").order(EVACUATION).run_until("flying", 1.0).run(0.2)
    desk.set(accuracy_m=1.8).run_until("holding", 1.5)
    assert desk.said("no room here")
    desk.run_until("flying", 2.0).run(3.0)
    assert desk.state == "flying"
    assert any(answer.escape_m for _, answer in desk.answered)
    assert desk.companion.status.task.mission is Mission.EVACUATION


def test_an_escape_route_of_an_empty_battery_is_not_held_up_where_it_is_too_narrow(desk):
    desk.come_to("at_target").set(battery_percent=19).run_until_sought("exit")
    desk.run(0.3).set(accuracy_m=1.8)
    stopped = desk.now_s
    desk.run_until("landing_leg", 60.0)
    reasons = [item["reason"] for item in desk.decided("replan")]
    assert reasons.count("no progress") == 1
    # For less than 2 s nothing moved.
    still = [not any((m.vx, m.vy, m.vz)) for m in desk.setpoints(stopped)]
    assert 0 < sum(still) < 100


def test_an_escape_route_that_was_not_found_is_sought_again_when_there_is_more_room(desk):
    desk.come_to("flying", then_s=4.0)
    desk.plan_delay_s = None
    desk.set(battery_percent=19, accuracy_m=1.5)
    for mission in ("exit", "evacuation"):
        desk.run_until_sought(mission, 8.0)
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
        (0.5, 0.6, 0.0, True),  # to stay, nobody has to know better
        (math.inf, 9.0, 1.0, True),
    ],
)
def test_a_checked_leg_is_open_as_far_as_it_has_room(planner, room_m, widened_m, speed_mps, passes):
    volume = FlightVolume(
        site=planner.site,
        vehicle=planner.vehicle,
        maps=planner.maps,
        loss=loss_of(autopilots.ARDUPILOT, GUID_TIMEOUT=0.5),
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
def test_a_plan_keeps_as_far_away_as_its_job_says(planner, widening_m):
    answer = answer_job(
        PlannerSet(planner), job(Mission.INSPECTION, "splice-inner", widening_m=widening_m)
    )
    cells = answer.plan.states[:, :2]
    rooms = planner.maps.room_m[cells[:, 0], cells[:, 1]]
    assert rooms.min() >= widening_m - 1e-9
    assert (answer.reach is None) is (widening_m == 0.0)


def test_the_way_ahead_is_shorter_by_as_much(planner):
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
def test_the_width_is_blamed_only_where_there_is_a_plan_without_it(
    planner, case, target, start_m, too_wide
):
    answer = answer_job(
        PlannerSet(planner), job(Mission.INSPECTION, target, start_m=start_m, widening_m=0.8)
    )
    assert (answer.plan, answer.too_wide) == (None, too_wide), case


def test_a_landing_leg_knows_how_much_room_it_has(planner):
    plan = answer_job(PlannerSet(planner), job(Mission.EXIT, widening_m=0.0)).plan
    ends = plan.landing_leg.points_m[[0, -1]]
    nearest_m = min(
        math.dist(item.position_m, (x_m, z_m)) - item.radius_m - item.keep_out_m
        for item in planner.site.obstacles
        for x_m, z_m in ends
    )
    assert plan.landing_leg.room_m == pytest.approx(nearest_m - planner.vehicle.radius_m, abs=0.3)

"""Path changes in flight and their texts."""

from __future__ import annotations

import json
from dataclasses import replace
from unittest import mock

import pytest

from moar_companion.companion.guidance.splice import Adoption
from moar_companion.companion.planning.plan_jobs import answer_job
from moar_companion.companion.status import LatestDecisions
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Conductor
from moar_companion.risk import RiskEstimate
from moar_companion.types import Mission, RiskIndices
from tests.companion.desk import EXIT, INSPECTION, USER_1, Desk, usual_planner
from tests.companion.scripted_autopilot import OFFBOARD
from tests.guidance.test_path_follower import Flown

INNER = 1


class Risks:
    """Replacement of `update`: fixed indices, whatever is measured."""

    def __init__(self):
        self.indices = RiskIndices()

    def __call__(self, estimate: RiskEstimate, *_, **__) -> RiskEstimate:
        return replace(estimate, indices=self.indices)


@pytest.fixture
def risks():
    judged = Risks()
    with mock.patch("moar_companion.companion.risk_monitor.update", judged):
        yield judged


@pytest.fixture
def desk(risks):
    """A companion that flies to the inner splice without risk, exposed to failsafes or not."""
    usual = usual_planner()
    safety = replace(usual.vehicle.safety, exposure=0.0)
    desk = Desk(planner=Planner(usual.site, replace(usual.vehicle, safety=safety)))
    desk.run(1.0)
    desk.handle(desk.operator.command(USER_1, INSPECTION, INNER))
    desk.run_until("ready")
    desk.set(mode=OFFBOARD)
    desk.run_until("flying")
    desk.run(1.0)
    return desk


def plans(desk):
    return [decision.data for decision in desk.decisions if decision.kind == "plan"]


@pytest.mark.uncounted
def test_a_small_risk_does_not_change_the_path(desk, risks):
    for step in range(20):
        risks.indices = RiskIndices(wind=0.15 * (step % 2), communication=0.2 * (step % 3))
        desk.run(0.4)
    assert sum(decision.kind == "replan" for decision in desk.decisions) > 10
    assert len(plans(desk)) == 1


def test_a_large_risk_moves_the_path_and_is_reported(desk, risks):
    risks.indices = RiskIndices(wind=0.9, communication=0.9, localization=0.9)
    desk.run(1.0)
    first, second = plans(desk)
    assert (first["first"], first["explanation"]["reason"]) == (True, "an order")
    assert first["explanation"]["path"] is None
    explanation = second["explanation"]
    assert explanation["reason"] == "wind risk 0.00 -> 0.90"
    assert explanation["weights"]["by_risk"]["wind"]["time"] < 0.0
    assert explanation["path"]["greatest_m"] > 0.3
    assert second["plan"]["risk"]["wind"] == 0.9
    json.dumps(explanation, allow_nan=False)
    texts = [decision.data["text"] for decision in desk.decisions if decision.kind == "text"]
    moved = f"path {explanation['path']['greatest_m']:.1f} m"
    assert any(text.startswith("MOAR: wind risk 0.90, ") and moved in text for text in texts)


def test_the_status_has_the_reason_of_the_path(desk, risks):
    risks.indices = RiskIndices(wind=0.9, communication=0.9, localization=0.9)
    desk.run(1.0)
    latest = LatestDecisions()
    latest.note(desk.decisions, desk.companion.telemetry.link)
    status = latest.status_of(desk.companion, desk.now_s, clock_offset_s=0.0, recorder=None)
    assert status["plan"]["reason"] == "wind risk 0.00 -> 0.90"
    assert status["plan"]["change"].startswith("path ")
    assert status["weights"]["words"].startswith("k_S 0.")
    assert status["risk"]["wind"]["words"].startswith("wind 0.90")


# Rest of the flown plan


@pytest.fixture
def flown():
    flown = Flown("linedrone_uniform")
    flown.order(Mission.INSPECTION)
    for _ in range(150):
        flown.advanced(flown.flight)
    return flown


def newer(flown, junction, planner=None, **changes):
    (x_m, _, z_m), (vx_mps, _, vz_mps) = junction.position_m, junction.velocity_mps
    request = {"mission": Mission.INSPECTION, "target": flown.site.targets[0].name} | changes
    return (planner or flown.planner).plan(start=(x_m, z_m), velocity=(vx_mps, vz_mps), **request)


def test_the_rest_of_the_plan_has_the_start_and_the_end_of_the_new_plan(flown):
    junction = flown.flight.path.junction()
    plan = newer(flown, junction)
    rest = flown.flight.rest_of_plan(plan, junction, None)
    assert rest.states[0, :2].tolist() == plan.states[0, :2].tolist()
    assert rest.states[-1, :2].tolist() == plan.states[-1, :2].tolist()
    assert rest.cost.total >= plan.cost.total - 1e-9
    assert rest.waypoints.position_m[1:] == pytest.approx(
        junction.trajectory.points_m[junction.corner + 1 :][:, ::2]
    )


def test_a_plan_to_another_goal_replaces_the_flown_path(flown):
    junction = flown.flight.path.junction()
    for changes in (
        {"mission": Mission.EXIT, "target": None},
        {"target": flown.site.targets[1].name},
    ):
        plan = newer(flown, junction, **changes)
        assert flown.flight.rest_of_plan(plan, junction, None) is None


def test_a_braked_flight_has_no_rest_of_a_plan_to_compare(flown):
    flown.flight.brake()
    junction = flown.flight.path.junction()
    assert flown.flight.rest_of_plan(newer(flown, junction), junction, None) is None


def test_braking_again_does_not_move_the_rest_point(flown):
    flown.flight.brake()
    stop_m = flown.flight.path.junction().position_m
    flown.advanced(flown.flight)
    flown.flight.brake()
    assert flown.flight.path.junction().position_m == stop_m


def test_a_leg_back_from_beside_the_path_is_not_compared(flown):
    junction = flown.flight.path.junction_at(flown.pose)
    assert flown.flight.rest_of_plan(newer(flown, junction), junction, None) is None


def test_a_path_that_a_new_obstacle_blocks_is_never_kept(flown):
    junction = flown.flight.path.junction()
    ahead = junction.trajectory.points_m[junction.corner + 8, ::2]
    new = Conductor(
        name="new", position_m=(float(ahead[0]), float(ahead[1])), radius_m=0.03, keep_out_m=0.0
    )
    site = replace(flown.site, obstacles=(*flown.site.obstacles, new))
    plan = newer(flown, junction, Planner(site, flown.vehicle))
    assert flown.flight.rest_of_plan(plan, junction, None) is None
    assert flown.flight.adopt(plan, junction, ()) is Adoption.NEW_PATH


def test_where_obstacles_have_become_wider_the_path_is_planned_again(flown):
    junction = flown.flight.path.junction()
    wider = Planner(flown.site, flown.vehicle, position_uncertainty_m=0.3)
    plan = newer(flown, junction, wider)
    assert flown.flight.rest_of_plan(plan, junction, wider.maps.reach) is None


def test_a_planner_that_was_rebuilt_for_the_same_width_keeps_the_path(flown):
    junction = flown.flight.path.junction()
    first, again = (
        Planner(flown.site, flown.vehicle, position_uncertainty_m=0.3) for _ in range(2)
    )
    plan = newer(flown, junction, first)
    assert flown.flight.adopt(plan, junction, (), first.maps.reach) is Adoption.NEW_PATH
    junction = flown.flight.path.junction()
    plan = newer(flown, junction, again)
    assert flown.flight.rest_of_plan(plan, junction, again.maps.reach) is not None
    assert flown.flight.adopt(plan, junction, (), again.maps.reach) is Adoption.SAME_PATH


@pytest.mark.parametrize("narrowed_m", [0.0, 0.9])
def test_a_plan_that_needs_more_of_the_margin_is_flown_though_its_path_is_flown_already(narrowed_m):
    """Uncertainty of the position, and the part of the margin that the plan omits, may be equal."""
    desk = Desk().come_to("flying", EXIT).set(plan_delay_s=None)
    desk.jobs.clear()
    while not desk.jobs:
        desk.step()
    (job,) = desk.jobs
    desk._give(job, replace(answer_job(desk.planners, job), narrowed_m=narrowed_m))
    desk.step()
    assert desk.companion.state.routes.flight.path.volume.narrowed_m == narrowed_m
    assert len(plans(desk.run(0.1))) == (2 if narrowed_m else 1)


@pytest.mark.slow
def test_a_plan_that_comes_in_the_cycle_in_which_its_wait_is_over_is_flown():
    late, steps = Desk().come_to("flying").set(plan_delay_s=None), 0
    while late.state == "flying":
        late.step()
        steps += 1
    assert late.said("no new plan for over 12 s, holding")
    desk = Desk().come_to("flying").set(plan_delay_s=None)
    for _ in range(steps - 1):
        desk.step()
    desk.answer_plan().run(1.0)
    assert desk.state == "flying"
    assert not desk.said("no new plan for over 12 s")

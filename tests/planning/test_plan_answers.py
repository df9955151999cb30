"""Answers to planning jobs: the plan, or the reason why there is none, as a text for a pilot."""

from __future__ import annotations

from unittest import mock

import pytest

from moar_companion.companion.planning.plan_jobs import PlanJob, answer_job
from moar_companion.companion.planning.planner_set import PlannerSet
from moar_companion.planner.plan_values import PlanRequest
from moar_companion.planner.plane_fence import Bound, PlaneFence
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Margin
from moar_companion.types import Mission, RiskIndices, Weights

from ..planner.problems import conductor, make_site, make_vehicle, polygon


def answered(site, start_m, mission=Mission.INSPECTION, *, radius=0.3, **changes):
    """The answer to a request from rest on this site, on its first target."""
    request = PlanRequest(
        mission=mission,
        target=site.targets[0].name if mission is Mission.INSPECTION else None,
        start_m=start_m,
        velocity_mps=(0.0, 0.0),
        weights=Weights(0.4, 0.3, 0.3),
        risk=RiskIndices(),
    )
    planners = PlannerSet(Planner(site, make_vehicle(radius=radius)))
    return answer_job(planners, PlanJob(job_id=7, request=request, **changes))


def text(answer):
    """The reason of an answer without a plan, as a pilot reads it."""
    assert answer.plan is None
    return answer.reason.partition(" (")[0]


def wall(*, left, right, bottom, top, name="wall"):
    return polygon((left, bottom), (right, bottom), (right, top), (left, top), name=name)


BESIDE_A_WIRE = make_site(conductor(5.5, 4.5, 0.1), exits=[(1.5, 0.0)]).flown_with(
    Margin(position_m=0.5, tracking_m=0.6)
)
"""Cells 1 m from the wire are in the margin, and are free without the tracking error."""
FENCE = PlaneFence(bounds=(Bound(name="GF_MAX_HOR_DIST 7 m", x_m=((-1.0, 7.0),)),), margin_m=0.5)
"""The target is outside."""


def test_an_escape_route_inside_the_margin_is_planned_on_from_its_place():
    answer = answered(BESIDE_A_WIRE, (6.5, 4.5), Mission.EXIT, narrowed_m=0.6)
    assert (answer.narrowed_m, answer.escape_m) == (0.6, ())
    assert answer.plan.waypoints.position_m[0] == pytest.approx((6.5, 4.5))


def test_an_escape_route_with_the_whole_margin_first_leaves_the_margin():
    answer = answered(BESIDE_A_WIRE, (6.5, 4.5), Mission.EXIT)
    assert (answer.narrowed_m, len(answer.escape_m)) == (0.0, 1)
    assert answer.plan.waypoints.position_m[0] == pytest.approx(answer.escape_m[0])


def test_an_escape_route_nearer_than_the_narrow_margin_leaves_the_whole_margin():
    answer = answered(BESIDE_A_WIRE, (6.1, 4.5), Mission.EXIT, narrowed_m=0.1)
    assert (answer.narrowed_m, len(answer.escape_m)) == (0.0, 1)


def test_a_fence_is_not_blamed_for_a_target_that_an_obstacle_blocks():
    site = make_site(conductor(8.5, 6.5))
    assert text(answered(site, (0.5, 0.5))) == "target too near obstacles"
    assert text(answered(site, (0.5, 0.5), fence=FENCE)) == "target too near obstacles"


def test_a_fence_that_alone_blocks_a_target_is_the_reason():
    answer = answered(make_site(), (0.5, 0.5), fence=FENCE)
    assert text(answer) == "target past GF_MAX_HOR_DIST 7 m"


def test_a_target_outside_the_workspace_is_named():
    site = make_site(targets={"tower top": (5.5, 20.0)})
    assert text(answered(site, (0.5, 0.5))) == "tower top outside the workspace"


def test_an_aircraft_too_low_under_an_obstacle_is_to_climb():
    roof = wall(left=-30.0, right=40.0, bottom=1.2, top=1.4)
    site = make_site(roof, min_altitude=3.0)
    assert text(answered(site, (3.5, 0.4))) == "height 0.4 m < 3: climb"


@pytest.fixture
def enclosed():
    """A site behind four walls, which no recovery leg passes; x leads east."""
    left, right = (
        wall(left=-0.7, right=-0.5, bottom=-1.0, top=9.0),
        wall(left=10.5, right=10.7, bottom=-1.0, top=9.0),
    )
    below, above = (
        wall(left=-1.0, right=11.0, bottom=-0.7, top=-0.5),
        wall(left=-1.0, right=11.0, bottom=8.5, top=8.7),
    )
    return make_site(left, right, below, above)


def test_an_aircraft_outside_without_a_recovery_leg_gets_the_compass_direction(enclosed):
    assert text(answered(enclosed, (-1.5, 4.5))) == "1.5 m off workspace: fly E"
    assert text(answered(enclosed, (12.5, 4.5))) == "2.5 m off workspace: fly W"


def test_an_aircraft_above_or_below_without_a_recovery_leg_is_to_descend_or_climb(enclosed):
    assert text(answered(enclosed, (5.5, 9.8))) == "1.8 m off workspace: descend"
    assert text(answered(enclosed, (5.5, -1.2))) == "1.2 m off workspace: climb"


def test_no_more_than_eight_cells_without_a_path_are_tried_from_outside():
    """Ten cells beside the border, each enclosed by wires above and below and by a wall."""
    wires = [conductor(0.5, 1.5 + 2.0 * row, 0.05, name=f"wire {row}") for row in range(10)]
    site = make_site(*wires, wall(left=1.1, right=1.9, bottom=-60.0, top=90.0), size=(10.0, 20.0))
    with mock.patch.object(Planner, "solve", autospec=True, side_effect=Planner.solve) as solve:
        answer = answered(site, (-1.5, 10.0), radius=0.15)
    assert text(answer) == "no free path to target"
    tried = [call.args[1].start_m for call in solve.call_args_list]
    assert len(set(tried)) == len(tried) == 8


STOPS = make_site(
    conductor(5.5, 4.5, 0.1), targets={"far": (8.5, 0.5), "near": (2.5, 0.5)}, exits=[(20.0, 0.0)]
)


def test_several_stops_are_answered_in_the_best_order_with_the_first_ones_plan():
    answer = answered(STOPS, (0.5, 0.5), stops=("far", "near"))
    assert answer.stops == ("near", "far")
    assert answer.plan.request.target == "near"
    assert answered(STOPS, (0.5, 0.5)).stops == ()


def test_the_best_order_counts_from_the_end_of_an_escape_leg():
    answer = answered(STOPS, (5.5, 4.0), stops=("far", "near"))
    assert answer.escape_m
    assert sorted(answer.stops) == ["far", "near"]
    assert answer.plan.request.target == answer.stops[0]

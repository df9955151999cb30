"""The margin: distance to obstacles beyond their keep-outs, and the source of its size."""

from __future__ import annotations

from dataclasses import replace

import pytest

from moar_companion.companion.error_margin import flown_site, margin_of, measured_margin
from moar_companion.companion.planning.plan_jobs import PlanJob, answer_job
from moar_companion.companion.planning.planner_set import PlannerSet
from moar_companion.planner.plan_values import PlanRequest
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Margin, Site
from moar_companion.settings.config import Supervision, shipped_configs
from moar_companion.settings.vehicle import Vehicle
from moar_companion.types import ARDUPILOT, PX4, UNKNOWN, Mission, RiskIndices, Weights

CONFIGS = shipped_configs()
SITE = Site.load(CONFIGS / "sites" / "315kv_double_circuit.yaml")
X500 = Vehicle.load(CONFIGS / "vehicles" / "x500.yaml")
KINDS = [PX4, ARDUPILOT]


def with_tracking(tracking_m):
    return replace(X500, guidance=replace(X500.guidance, tracking_margin_m=tracking_m))


@pytest.mark.parametrize("kind", KINDS)
def test_the_margin_is_the_measured_error_of_the_autopilot(kind):
    assert margin_of(replace(X500, autopilot=kind), Supervision()) == measured_margin(kind)


@pytest.mark.parametrize("kind", [None, UNKNOWN])
def test_the_margin_of_an_unknown_autopilot_is_the_greatest(kind):
    assert measured_margin(kind) == max(
        map(measured_margin, KINDS), key=lambda margin: margin.total_m
    )


def test_a_measured_error_replaces_the_default():
    limits = Supervision(position_uncertainty_m=0.1)
    assert margin_of(with_tracking(0.3), limits) == Margin(position_m=0.1, tracking_m=0.3)


def test_from_every_obstacle_the_margin_is_kept_beyond_its_own_keep_out():
    flown = flown_site(SITE, X500, Supervision())
    assert flown.margin.total_m == pytest.approx(2.55)
    for own, item in zip(SITE.obstacles, flown.obstacles, strict=True):
        assert item == replace(own, keep_out_m=own.keep_out_m + flown.margin.total_m)
    maps = Planner(flown, X500).maps
    least_m = maps.obstacle_distance_m[~maps.occupied].min()
    assert least_m >= X500.radius_m + 0.25 + 2.55 - 1e-6


def test_the_collision_cost_and_the_speed_limit_include_the_margin():
    flown, planned = (
        Planner(site, X500).maps for site in (flown_site(SITE, X500, Supervision()), SITE)
    )
    assert (flown.collision_cost >= planned.collision_cost).all()
    assert (flown.speed_limit_mps <= planned.speed_limit_mps).all()
    assert flown.collision_cost.sum() > planned.collision_cost.sum()
    assert (flown.obstacle_distance_m == planned.obstacle_distance_m).all()


def test_to_obstacles_that_come_later_the_margin_is_added_too():
    planner = Planner(flown_site(SITE, X500, Supervision()), X500)
    before = planner.maps
    planner.set_obstacles(SITE.obstacles[:1])
    planner.set_obstacles(SITE.obstacles)
    assert planner.site == flown_site(SITE, X500, Supervision())
    assert (planner.maps.occupied == before.occupied).all()


def inspection_of(target):
    site = flown_site(replace(SITE, targets=(target,)), X500, Supervision())
    request = PlanRequest(
        mission=Mission.INSPECTION,
        target=target.name,
        start_m=SITE.start_m,
        velocity_mps=(0.0, 0.0),
        weights=Weights(0.4, 0.3, 0.3),
        risk=RiskIndices(),
    )
    return answer_job(PlannerSet(Planner(site, X500)), PlanJob(job_id=1, request=request))


@pytest.mark.parametrize(
    ("standoff_m", "words"),
    [
        (3.0, "there is one without tracking error 1.15 m"),
        (1.0, "there is one without position error 1.4 m, tracking error 1.15 m"),
    ],
)
def test_a_denial_names_the_part_of_the_margin_that_causes_it(standoff_m, words):
    conductor = SITE.obstacles[3]
    x_m, z_m = conductor.position_m
    near = replace(SITE.targets[0], position_m=(x_m + conductor.radius_m + standoff_m, z_m))
    answer = inspection_of(near)
    assert answer.plan is None
    assert answer.reason == "no path with margin 2.55 m"
    assert answer.detail.endswith(words)


def test_a_denial_that_no_margin_causes_names_none():
    inside = replace(SITE.targets[0], position_m=SITE.obstacles[3].position_m)
    answer = inspection_of(inside)
    assert "margin" not in answer.reason

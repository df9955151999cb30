"""Maps of a site whose obstacles have changed, and targets that are moved out of keep-outs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from moar_companion.companion.planning.map_jobs import MapJob, SettingsJob, answer_map_job
from moar_companion.companion.planning.planner_set import PlannerSet
from moar_companion.mavlink.autopilots.failsafe_actions import (
    AutopilotAction,
    FailsafeAction,
    Failsafes,
    Trigger,
)
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Conductor, Margin, Polygon, Site
from moar_companion.settings.config import shipped_configs
from moar_companion.settings.vehicle import Vehicle

MARGIN = Margin(position_m=0.5, tracking_m=0.5)
LANDS = FailsafeAction(trigger=Trigger.GCS_LOSS, action=AutopilotAction.LAND, setting="")


@pytest.fixture
def planners():
    configs = shipped_configs()
    site = Site.load(configs / "sites/315kv_double_circuit.yaml").flown_with(MARGIN)
    return PlannerSet(Planner(site, Vehicle.load(configs / "vehicles/linedrone_flight.yaml")))


def wire(x_m, z_m):
    return Conductor(name="seen-1", position_m=(x_m, z_m), radius_m=0.02, keep_out_m=0.5)


def job(planners, *obstacles, slack_m=2.0):
    site = planners.exact.site.with_more_obstacles(obstacles)
    return MapJob(job_id=7, site=site, slack_m=slack_m)


def test_updated_maps_equal_those_of_a_new_planner(planners):
    answer = answer_map_job(planners, job(planners, wire(15.0, 14.0)))
    fresh = Planner(answer.site_maps.site, planners.exact.vehicle)
    assert answer.job_id == 7
    assert np.array_equal(answer.site_maps.maps.occupied, fresh.maps.occupied)
    assert answer.site_maps.maps.room_m == pytest.approx(fresh.maps.room_m)
    assert answer.site_maps.maps.safety_cost == pytest.approx(fresh.maps.safety_cost)


def test_seen_obstacles_have_the_margin_of_the_site(planners):
    answer = answer_map_job(planners, job(planners, wire(15.0, 14.0)))
    maps = answer.site_maps.maps
    kept_m = 0.02 + 0.5 + MARGIN.total_m + planners.exact.vehicle.radius_m
    assert maps.occupied[maps.grid.cell_of((15.0 + kept_m - 0.3, 14.0))]
    assert not maps.occupied[maps.grid.cell_of((15.0 + kept_m + 0.3, 14.0))]


def test_later_plans_avoid_seen_obstacles_also_in_inflated_planners(planners):
    planners.widened_by(0.3)
    answer_map_job(planners, job(planners, wire(15.0, 14.0)))
    for planner in (planners.exact, planners.widened_by(0.3)):
        plan = planner.plan(mission="inspection", target="splice-inner")
        assert np.hypot(*(plan.waypoints.position_m - (15.0, 14.0)).T).min() > 1.5


def test_a_free_target_is_not_moved(planners):
    answer = answer_map_job(planners, job(planners, wire(15.0, 14.0)))
    assert answer.site_maps.site.targets == planners.exact.site.targets


def test_a_target_in_a_keep_out_moves_to_the_nearest_free_place(planners):
    before = planners.exact.site.target("splice-outer")
    x_m, z_m = before.position_m
    answer = answer_map_job(planners, job(planners, wire(x_m - 1.0, z_m)))
    moved = answer.site_maps.site.target("splice-outer")
    maps = answer.site_maps.maps
    assert not maps.occupied[maps.grid.cell_of(moved.position_m)]
    distances = [
        math.dist((x, z), before.position_m)
        for x, column in zip(maps.grid.axes_m[0], maps.occupied, strict=True)
        for z, occupied in zip(maps.grid.axes_m[1], column, strict=True)
        if not occupied
    ]
    assert math.dist(moved.position_m, before.position_m) == pytest.approx(min(distances))
    assert moved.look_at_m == before.look_at_m
    assert planners.exact.plan(mission="inspection", target="splice-outer").status == "found"


def test_a_target_is_moved_no_farther_than_the_slack(planners):
    x_m, z_m = planners.exact.site.target("splice-outer").position_m
    answer = answer_map_job(planners, job(planners, wire(x_m - 1.0, z_m), slack_m=0.3))
    assert answer.site_maps.site.target("splice-outer").position_m == (x_m, z_m)


def test_a_target_is_not_moved_into_a_region_that_is_cut_off(planners):
    x_m, z_m = planners.exact.site.target("splice-outer").position_m
    # A shaft around the target: cells inside it are free beside the wire, but cut off.
    shaft = [
        Polygon(
            name=f"seen-solid-{number}",
            vertices_m=((left, -1.0), (left + 0.2, -1.0), (left + 0.2, 21.0), (left, 21.0)),
        )
        for number, left in enumerate((x_m - 3.2, x_m + 2.8))
    ]
    answer = answer_map_job(planners, job(planners, wire(x_m, z_m), *shaft, slack_m=4.0))
    moved = answer.site_maps.site.target("splice-outer")
    assert moved.position_m == (x_m, z_m) or abs(moved.position_m[0] - x_m) > 3.0


@pytest.mark.parametrize(
    "fails",
    [
        "planner.planner.build_maps",
        "planner.planner.build_graph",
        "companion.planning.map_jobs._moved",
        "planner.planner.with_exposed",
    ],
)
def test_settings_whose_maps_cannot_be_made_leave_the_planner_as_it_was(
    planners, fails, monkeypatch
):
    made = planners.exact
    planners.expose(Failsafes(actions=(LANDS,)))
    before = (made.site, made.vehicle, made.maps, made.graph)
    plan = made.plan(mission="exit").to_json()
    vehicle = replace(made.vehicle, radius_m=1.0)
    settings = SettingsJob(job_id=1, site=made.site.with_more_obstacles(()), vehicle=vehicle)

    def failing(*_, **__):
        raise MemoryError

    monkeypatch.setattr(f"moar_companion.{fails}", failing)
    with pytest.raises(MemoryError):
        answer_map_job(planners, settings)
    monkeypatch.undo()
    now = (made.site, made.vehicle, made.maps, made.graph)
    assert all(one is other for one, other in zip(now, before, strict=True))
    assert made.plan(mission="exit").to_json() == plan


def test_failsafes_whose_cells_cannot_be_marked_are_marked_by_the_next_job(planners, monkeypatch):
    failsafes, target = Failsafes(actions=(LANDS,)), "planner.planner.with_exposed"

    def failing(*_):
        raise MemoryError

    before = planners.exact.maps
    monkeypatch.setattr(f"moar_companion.{target}", failing)
    with pytest.raises(MemoryError):
        planners.expose(failsafes)
    monkeypatch.undo()
    planners.expose(failsafes)
    assert planners.exact.maps is not before

"""Scenes and sweeps: what is planned, and that a sweep's paths are the planner's own."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from moar_companion.analysis.evaluation import adaptability, missions, sensitivity
from moar_companion.analysis.evaluation.paths import METRICS
from moar_companion.analysis.evaluation.scenes import (
    BASES,
    DISPLACED_M,
    SCENES,
    SWEPT,
    environment_site,
    problem,
)
from moar_companion.planner.analysis.baselines import BaselineKind
from moar_companion.planner.plan_values import PlanStatus
from moar_companion.types import Mission, RiskIndices, Weights

EXIT = next(scene for scene in SWEPT if scene.mission is Mission.EXIT)


@pytest.fixture(scope="module")
def swept():
    return sensitivity.sweep(EXIT, levels=3)


def test_there_are_36_different_tests_and_nine_swept_scenes_and_all_can_be_planned():
    assert len({scene.name for scene in SCENES}) == 36
    assert len(SWEPT) == 9
    for scene in SCENES:
        posed = problem(scene)
        assert posed.planner.solve(posed.request).status is PlanStatus.FOUND


def test_displaced_conductors_take_their_targets_with_them():
    usual, displaced = environment_site(2), environment_site(2, displaced=True)
    for before, after in zip(
        (*usual.obstacles, *usual.targets), (*displaced.obstacles, *displaced.targets), strict=True
    ):
        moved = np.subtract(after.position_m, before.position_m)
        assert moved == pytest.approx(DISPLACED_M)
    assert usual.start_m == displaced.start_m


def test_the_papers_sweep_has_9260_combinations():
    assert sensitivity.combinations().shape == (9260, 3)


@pytest.mark.parametrize("scene", [EXIT, SWEPT[0]], ids=lambda scene: scene.name)
def test_every_combination_has_a_path_of_least_cost(scene):
    swept = sensitivity.sweep(scene, levels=6)
    posed = problem(scene)
    for combination, path in zip(swept.combinations.tolist(), swept.path, strict=True):
        weights = Weights.normalised(*combination)
        plan = posed.planner.solve(posed.with_weights(weights))
        sums = (plan.cost.safety, plan.cost.time, plan.cost.energy)
        # The same optimum, selected among those of equal J as in the planner.
        assert swept.paths.sums[path] == pytest.approx(sums, abs=1e-8)


def test_paths_and_metrics_are_without_the_landing_leg(swept):
    posed = problem(EXIT)
    plan = posed.planner.solve(posed.with_weights(Weights.normalised(1.0, 1.0, 1.0)))
    at = np.flatnonzero((swept.combinations == 1.0).all(axis=1))[0]
    points = swept.paths.points_m[swept.path[at]]
    assert points.shape == plan.waypoints.position_m[: len(plan.states)].shape
    length = np.hypot(*np.diff(points, axis=0).T).sum()
    assert swept.metric("length_m")[at] == pytest.approx(length)
    assert plan.metrics.length_m > length + 5.0


def test_no_path_comes_twice(swept):
    assert len({points.tobytes() for points in swept.paths.points_m}) == swept.path.max() + 1


def test_a_sweep_dominates_no_more_than_the_exact_front(swept):
    row = sensitivity.summary(swept)
    assert 0.5 < row["hypervolume_ratio"] <= 1.0 + 1e-9
    # No path of the sweep is better than one of the front in all three sums.
    better = (swept.paths.sums[:, None, :] < swept.front.sums[None, :, :] - 1e-9).all(axis=2)
    assert not better.any()


def test_the_shortest_baseline_is_no_longer_than_any_path(swept):
    shortest = swept.baselines.value(BaselineKind.SHORTEST, "length_m")
    assert shortest <= swept.paths.metric("length_m").min() + 1e-9
    clearest = swept.baselines.value(BaselineKind.SHORTEST, "length_mean_clearance_m")
    assert clearest > 0.0


def test_under_risks_every_path_is_that_of_a_plan_under_them():
    result = adaptability.sweep(EXIT, levels=2, fine_levels=3)
    posed = problem(EXIT)
    assert {way.base for way in adaptability.WAYS} == set(BASES)
    for way in adaptability.WAYS:
        response = result.responses[way]
        assert response.risks.shape == (8, 3)
        for (wind, battery, place), path in zip(
            response.risks.tolist(), response.path, strict=True
        ):
            risk = RiskIndices(wind=wind, battery=battery, localization=place)
            plan = posed.planner.plan(
                mission=EXIT.mission,
                start=posed.request.start_m,
                weights=BASES[way.base],
                risk=risk,
                adaptation=way.adaptation,
            )
            assert len(plan.states) == len(result.paths.points_m[path])
        # Wind alone is part of the combinations.
        assert response.wind_path[0] == response.path[0]
        row = adaptability.summary(result, way)
        assert row["length: coverage"] <= 1.0
        assert row["length: over wind"] <= row["length: coverage"] + 1e-12


def test_a_mission_test_reports_the_vehicles_own_plan_and_its_times():
    result = missions.run(EXIT, itertools.count().__next__, repeats=3)
    posed = problem(EXIT)
    plan = posed.planner.solve(posed.with_weights(posed.planner.vehicle.weights[Mission.EXIT]))
    metrics = dict(zip(METRICS, result.plan.metrics[0], strict=True))
    assert metrics["min_clearance_m"] == pytest.approx(plan.metrics.min_clearance_m)
    # A clock that moves by a second whenever it is read.
    assert missions.times(result)["cold, p50 (ms)"] == 1000.0
    assert missions.times(result)["with tables, p99 (ms)"] == 1000.0
    assert len(result.cold_ms) == len(result.prepared_ms) == 3

"""The paper's 36 tests: three environments, three missions, four variations (Section V-A).

Input: a scene. Output: the metrics of its plan with the vehicle's weights and of the baselines, and
the times of its plans, without tables and with them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...planner.analysis.baselines import BaselineKind
from ...planner.grid import FloatArray
from .paths import METRICS, Baselines, PathCollector, Paths, baselines
from .scenes import Problem, Scene, problem

REPEATS = 200
"""Number of timed plans, each with other weights about the vehicle's."""
_SPREAD = 0.1

Clock = Callable[[], float]


@dataclass(frozen=True, kw_only=True, eq=False)
class MissionTest:
    """One of the tests. plan: its one path; cold_ms, prepared_ms: (n,) times of whole plans."""

    scene: Scene
    cells: int
    states: int
    plan: Paths
    baselines: Baselines
    cold_ms: FloatArray
    prepared_ms: FloatArray


def run(scene: Scene, clock: Clock, repeats: int = REPEATS) -> MissionTest:
    """Runs a test; clock: seconds."""
    posed = problem(scene)
    planner = posed.planner
    planner.solve(posed.request)  # goal and kernels are found once, before the first time is taken
    cold_ms = _times_ms(posed, clock, repeats)
    planner.prepare(mission=scene.mission, target=posed.request.target)
    collector = PathCollector(posed)
    collector.solve(planner.vehicle.weights[scene.mission])
    free = int((~planner.maps.occupied).sum())
    return MissionTest(
        scene=scene,
        cells=free,
        states=free * len(planner.graph.offset),
        plan=collector.paths(),
        baselines=baselines(posed),
        cold_ms=cold_ms,
        prepared_ms=_times_ms(posed, clock, repeats),
    )


def _times_ms(posed: Problem, clock: Clock, repeats: int) -> FloatArray:
    """Times of plans whose weights are scattered about the vehicle's, the same each time."""
    planner = posed.planner
    base = planner.vehicle.weights[posed.scene.mission]
    random = np.random.default_rng(0)
    centre = np.array((base.safety, base.time, base.energy))
    times = []
    for shift in random.uniform(-_SPREAD, _SPREAD, (repeats, 3)):
        weights = type(base).normalised(*np.maximum(centre + shift, 0.0).tolist())
        request = posed.with_weights(weights)
        began = clock()
        planner.solve(request)
        times.append(1e3 * (clock() - began))
    return np.array(times)


def rows(result: MissionTest) -> dict[str, Any]:
    """The plan and each baseline in a row: columns of the Parquet file."""
    found = {"plan": result.plan.metrics[0]}
    found |= {kind.value: metrics for kind, metrics in result.baselines.metrics.items()}
    table = np.array(list(found.values()))
    return {
        **{name: [value] * len(found) for name, value in result.scene.key.items()},
        "path": list(found),
        **{name: table[:, at] for at, name in enumerate(METRICS)},
    }


def times(result: MissionTest) -> dict[str, Any]:
    """The times of one test, in a row."""
    row: dict[str, Any] = {"scene": result.scene.name, "states": result.states}
    for name, values in (("cold", result.cold_ms), ("with tables", result.prepared_ms)):
        row[f"{name}, p50 (ms)"], row[f"{name}, p99 (ms)"] = np.percentile(values, [50.0, 99.0])
    return row


def summary(result: MissionTest) -> dict[str, Any]:
    """The plan's metrics and the baselines' lengths and clearances, in a row."""
    row: dict[str, Any] = {"scene": result.scene.name}
    row |= {name: float(value) for name, value in zip(METRICS, result.plan.metrics[0], strict=True)}
    for kind in BaselineKind:
        for name in ("length_m", "mean_clearance_m"):
            row[f"{kind.value} {name}"] = result.baselines.value(kind, name)
    return row

"""Sensitivity to the coefficients of Eq. 1 (paper, Section V-A, Fig. 6 and 7).

Input: a scene. Output: the paths of all combinations of weights, the exact front, the baselines,
and the measures that compare them.

Most combinations need no search: their optimum is the point of the exact front with the least cost.
The planner searches where a weight is 0 or two points cost the same: more than these sums then
decides between equal costs.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...planner.analysis.pareto import pareto_front
from ...planner.grid import FloatArray, IntArray
from ...types import Weights
from . import measures
from .paths import METRICS, Baselines, PathCollector, Paths, baselines
from .scenes import Problem, Scene, problem

LEVELS = 21
"""Values of each coefficient, from 0 to 1."""
SHOWN = ("length_m", "duration_s", "mean_clearance_m", "velocity_change_mps")
"""The metrics of Fig. 7, in its order."""
_TOLERANCE = 1e-9
"""Costs closer than this, relative, are equal."""
_BEYOND = 0.1
"""Distance of the hypervolume's reference beyond the front, as part of its range."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Sensitivity:
    """The sweep of one scene.

    combinations: (n, 3)  coefficients as swept; path: (n,) number of the path of each
    front:                the paths of the exact front
    hypervolumes:         of the sweep and of the front
    """

    scene: Scene
    combinations: FloatArray
    path: IntArray
    paths: Paths
    front: Paths
    baselines: Baselines
    hypervolumes: tuple[float, float]

    def metric(self, name: str) -> FloatArray:
        """A metric of each combination, (n,)."""
        return self.paths.metric(name)[self.path]


def combinations(levels: int = LEVELS) -> FloatArray:
    """All combinations of three coefficients but (0, 0, 0), (n, 3)."""
    values = np.linspace(0.0, 1.0, levels).tolist()
    return np.array([each for each in itertools.product(values, repeat=3) if any(each)])


def sweep(scene: Scene, levels: int = LEVELS) -> Sensitivity:
    """The sweep of a scene."""
    posed = problem(scene)
    posed.planner.prepare(mission=scene.mission, target=posed.request.target)
    swept = combinations(levels)
    collector = PathCollector(posed)
    points = front_numbers(posed, collector)
    path = _paths_of(swept, collector, points)
    known = collector.paths()
    front = known.chosen(points)
    # New numbers: the sweep has only some paths of the front.
    flown, path = np.unique(path, return_inverse=True)
    paths = known.chosen(flown.tolist())
    low, high = front.sums.min(axis=0), front.sums.max(axis=0)
    reference = high + _BEYOND * (high - low)
    return Sensitivity(
        scene=scene,
        combinations=swept,
        path=path,
        paths=paths,
        front=front,
        baselines=baselines(posed),
        hypervolumes=(
            measures.hypervolume(paths.sums, reference),
            measures.hypervolume(front.sums, reference),
        ),
    )


def _paths_of(swept: FloatArray, collector: PathCollector, front: Sequence[int]) -> IntArray:
    """The number of each combination's path."""
    weights = swept / swept.sum(axis=1, keepdims=True)
    totals = weights @ collector.paths().chosen(front).sums.T
    path: IntArray = np.array(front)[totals.argmin(axis=1)]
    least = totals.min(axis=1, keepdims=True)
    equal = (totals <= least + _TOLERANCE * np.maximum(1.0, least)).sum(axis=1) > 1
    for at in np.flatnonzero(equal | (swept == 0.0).any(axis=1)):
        path[at] = collector.solve(Weights.normalised(*swept[at].tolist()))
    return path


def exact_front(posed: Problem) -> Paths:
    """The paths of a problem that are optimal for some weights."""
    collector = PathCollector(posed)
    front_numbers(posed, collector)
    return collector.paths()


def front_numbers(posed: Problem, collector: PathCollector) -> list[int]:
    """The numbers of the paths that are optimal for some weights."""
    front = pareto_front(posed.planner, posed.request)
    return [collector.number(point.plan) for point in front]


def summary(result: Sensitivity) -> dict[str, Any]:
    """The measures of one scene: a row of the report's table."""
    swept, exact = result.hypervolumes
    row: dict[str, Any] = {"scene": result.scene.name, "paths": len(result.paths.points_m)}
    for label, metric in (("length", "length_m"), ("clearance", "mean_clearance_m")):
        values, compared = result.paths.metric(metric), result.baselines.values(metric)
        low, high = float(compared.min()), float(compared.max())
        row[f"{label}_range_ratio"] = measures.range_ratio(values, compared)
        row[f"{label}_coverage"] = measures.coverage(values, low, high)
    row["front"] = len(result.front.points_m)
    # On a front of a single point both volumes are 0.
    row["hypervolume_ratio"] = swept / exact if exact > 0.0 else 1.0
    return row


def rows(result: Sensitivity) -> dict[str, Any]:
    """One row for each combination: columns of the Parquet file."""
    count = len(result.combinations)
    return {
        **{name: [value] * count for name, value in result.scene.key.items()},
        "k_safety": result.combinations[:, 0],
        "k_time": result.combinations[:, 1],
        "k_energy": result.combinations[:, 2],
        "path": result.path,
        **{name: result.metric(name) for name in METRICS},
    }

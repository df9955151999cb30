"""Distinct paths of a sweep, each with its metrics and sums, computed once.

Many weights have the same optimal path: a sweep keeps the number of a path for each of its plans.
Paths have no landing legs (environments/README).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields

import numpy as np

from ...planner.analysis.baselines import Baseline, BaselineKind, baseline
from ...planner.grid import FloatArray, IntArray
from ...planner.plan_values import Metrics, Plan, PlanStatus, trajectory
from ...types import Weights
from .scenes import Problem

METRICS = (*(field.name for field in fields(Metrics)), "length_mean_clearance_m")
"""Columns of all metrics: those of a plan, and the clearance averaged over the length. Unlike the
average over the time, it does not depend on the speed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Paths:
    """Distinct paths. points_m: one (k, 2) each; metrics: (n, 6), `METRICS`; sums: (n, 3)."""

    points_m: tuple[FloatArray, ...]
    metrics: FloatArray
    sums: FloatArray

    def metric(self, name: str) -> FloatArray:
        """One metric of every path, (n,)."""
        column: FloatArray = self.metrics[:, METRICS.index(name)]
        return column

    def chosen(self, numbers: Sequence[int]) -> Paths:
        """Some of the paths."""
        return Paths(
            points_m=tuple(self.points_m[number] for number in numbers),
            metrics=self.metrics[list(numbers)],
            sums=self.sums[list(numbers)],
        )


class PathCollector:
    """Plans of one problem, as numbers of distinct paths."""

    def __init__(self, problem: Problem) -> None:
        self._problem = problem
        self._numbers: dict[bytes, int] = {}
        self._plans: list[Plan] = []

    def solve(self, weights: Weights) -> int:
        """The number of the optimal path for final weights; ValueError where there is none."""
        plan = self._problem.planner.solve(self._problem.with_weights(weights))
        if plan.status is not PlanStatus.FOUND:
            raise ValueError(f"{self._problem.scene.name}: {plan.reason}")
        return self.number(plan)

    def number(self, plan: Plan) -> int:
        """The number of a found plan's path."""
        key = plan.states.tobytes()
        if key not in self._numbers:
            self._numbers[key] = len(self._plans)
            self._plans.append(plan)
        return self._numbers[key]

    def paths(self) -> Paths:
        """All paths so far, in order of their numbers."""
        flown = [_without_leg(self._problem, plan.states) for plan in self._plans]
        costs = [plan.cost for plan in self._plans]
        return Paths(
            points_m=tuple(points for points, _ in flown),
            metrics=np.array([metrics for _, metrics in flown]),
            sums=np.array([(cost.safety, cost.time, cost.energy) for cost in costs if cost]),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Baselines:
    """The paper's baselines on a problem. points_m, metrics: by kind, where a path was found.

    shortest_least_clearance_m: mean clearance of the shortest path that is nearest to obstacles.
    """

    points_m: dict[BaselineKind, FloatArray]
    metrics: dict[BaselineKind, FloatArray]
    shortest_least_clearance_m: float

    def value(self, kind: BaselineKind, metric: str) -> float:
        """A metric of a baseline; NaN where it has no path."""
        return float(self.metrics[kind][METRICS.index(metric)]) if kind in self.metrics else np.nan

    def values(self, metric: str) -> FloatArray:
        """A metric of all baselines that were found."""
        return np.array([self.value(kind, metric) for kind in self.metrics])


def baselines(problem: Problem) -> Baselines:
    """The baselines of a problem."""

    def answer(kind: BaselineKind, *, clearest: bool = True) -> Baseline:
        return baseline(problem.planner, kind, problem.request, clearest=clearest)

    found = {kind: answer(kind) for kind in BaselineKind}
    flown = {
        kind: _without_leg(problem, each.states)
        for kind, each in found.items()
        if each.status is PlanStatus.FOUND
    }
    nearest = answer(BaselineKind.SHORTEST, clearest=False)
    _, least = _without_leg(problem, nearest.states)
    return Baselines(
        points_m={kind: points for kind, (points, _) in flown.items()},
        metrics={kind: metrics for kind, (_, metrics) in flown.items()},
        shortest_least_clearance_m=float(least[METRICS.index("mean_clearance_m")]),
    )


def _without_leg(problem: Problem, states: IntArray) -> tuple[FloatArray, FloatArray]:
    """Points (k, 2) and metrics (6,) of a path of states."""
    planner = problem.planner
    velocity = problem.request.velocity_mps
    waypoints, metrics = trajectory(planner.graph, planner.maps, states, velocity, None)
    points = waypoints.position_m
    clearance = planner.maps.obstacle_distance_m[tuple(states[:, :-1].T)]
    length = np.hypot(*np.diff(points, axis=0).T)
    mean = clearance[1:] @ length / length.sum() if length.any() else clearance[0]
    return points, np.array([*astuple(metrics), mean])

"""Peers that sample the plane: OMPL's RRT*, Informed RRT* and BIT* with J as their objective.

J of a path is no sum over its legs, as each turn costs. The peers are called in two forms:
- 4-D: a state is a point and the velocity at its departure. A leg costs its own J, and the changes
  from and to the velocities of its ends. The optimum is that of J, because the best velocity of a
  state is that of one of its legs.
- 2-D: a state is a point, and turns cost nothing. The search space is smaller, but has another
  optimum.
The found path is judged by the whole of J in both forms. The loops over the samples of a leg are
compiled. A leg takes about 5 microseconds, most of them in Python.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from ompl import base, geometric, util

from moar_companion import Planner, Weights
from moar_companion.planner.arrays import Field
from moar_companion.planner.grid import FloatArray, Grid
from moar_companion.planner.polyline import leg_sums
from moar_companion.planner.refinement import ContinuousCost

KINDS = {
    "RRT*": (geometric.RRTstar, False),
    "Informed RRT*": (geometric.InformedRRTstar, True),
    "BIT*": (geometric.BITstar, False),
}
"""The planner's class; True if it is given a bound."""
DIMENSIONS = (2, 4)
SEED = 1


@dataclass(frozen=True, kw_only=True, eq=False)
class PlaneProblem:
    """A problem in the plane; it ends anywhere in a goal cell, or at rest in its centre."""

    planner: Planner
    cost: ContinuousCost
    start_m: tuple[float, float]
    velocity_mps: tuple[float, float]
    goal_cells: frozenset[tuple[int, ...]]
    ends_at_rest: bool
    weights: Weights

    def of_path(self, points_m: FloatArray) -> float:
        """J of a path."""
        return self.cost.of_path(
            points_m, self.velocity_mps, self.weights, ends_at_rest=self.ends_at_rest
        ).total


@dataclass(frozen=True, slots=True, kw_only=True)
class Milestone:
    """Checkpoint of a run: after a time, or after a number of computed leg costs."""

    name: str
    time_s: float = math.inf
    evaluations: float = math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class Reached:
    """Result of a run at a milestone.

    cost: J of its path, infinite without any. cut: its time was over before its evaluations were.
    """

    name: str
    processor_s: float
    wall_s: float
    cost: float
    cut: bool


class _Objective(base.OptimizationObjective):
    def __init__(self, information: base.SpaceInformation, problem: PlaneProblem) -> None:
        super().__init__(information)
        self.evaluations = 0
        self._turns_count = information.getStateDimension() == max(DIMENSIONS)
        self._field = problem.cost.field
        self._region = () if problem.ends_at_rest else problem.goal_cells
        self._grid = problem.planner.maps.grid
        self._safety, self._time = problem.weights.safety, problem.weights.time
        self._change = 0.5 * problem.weights.energy / problem.cost.v_max_mps

    def motionCost(self, start: base.State, end: base.State) -> base.Cost:  # noqa: N802
        self.evaluations += 1
        x, z = end[0], end[1]
        safety, seconds, change, first_x, first_z, last_x, last_z = leg_sums(
            start[0], start[1], x, z, self._field
        )
        if safety == math.inf:
            return base.Cost(math.inf)
        if self._turns_count:
            change += math.hypot(first_x - start[2], first_z - start[3])
            if not (self._region and self._grid.cell_of((x, z)) in self._region):
                change += math.hypot(end[2] - last_x, end[3] - last_z)
        return base.Cost(self._safety * safety + self._time * seconds + self._change * change)


class _GuidedObjective(_Objective):
    """The objective with Eq. 8 as a bound.

    Without a bound, Informed RRT* is RRT*; the other planners find better paths without one.
    OMPL's Python takes the bound from the start; only C++ takes the cost to the goal.
    """

    def __init__(self, information: base.SpaceInformation, problem: PlaneProblem) -> None:
        super().__init__(information, problem)
        self._pace = problem.weights.time / problem.cost.v_max_mps

    def motionCostHeuristic(self, start: base.State, end: base.State) -> base.Cost:  # noqa: N802
        bound = self._pace * math.hypot(end[0] - start[0], end[1] - start[1])
        if self._turns_count and not self._region:  # where none is counted to its own velocity
            bound += self._change * math.hypot(end[2] - start[2], end[3] - start[3])
        return base.Cost(bound)


class _MotionValidator(base.MotionValidator):
    def __init__(self, information: base.SpaceInformation, field: Field) -> None:
        super().__init__(information)
        self._field = field

    def checkMotion(self, start: base.State, end: base.State) -> bool:  # noqa: N802
        return leg_sums(start[0], start[1], end[0], end[1], self._field)[0] < math.inf


class _StateValidity(base.StateValidityChecker):
    def __init__(self, information: base.SpaceInformation, problem: PlaneProblem) -> None:
        super().__init__(information)
        self._grid = problem.planner.maps.grid
        self._occupied = problem.planner.maps.occupied

    def isValid(self, state: base.State) -> bool:  # noqa: N802
        cell = self._grid.cell_of((state[0], state[1]))
        return cell is not None and not self._occupied[cell]


class _Region(base.GoalSampleableRegion):
    """The goal cells of an exit or evacuation, entered at any velocity."""

    def __init__(self, information: base.SpaceInformation, problem: PlaneProblem) -> None:
        super().__init__(information)
        self.setThreshold(0.5)
        self._grid: Grid = problem.planner.maps.grid
        self._cells = problem.goal_cells
        self._centres_m = [self._grid.centre_m(cell) for cell in sorted(problem.goal_cells)]
        self._dimensions = information.getStateDimension()
        self._random = np.random.default_rng(SEED)

    def distanceGoal(self, state: base.State) -> float:  # noqa: N802
        return 0.0 if self._grid.cell_of((state[0], state[1])) in self._cells else 1.0

    def sampleGoal(self, state: base.State) -> None:  # noqa: N802
        centre_m = self._centres_m[self._random.integers(len(self._centres_m))]
        for axis in range(self._dimensions):
            state[axis] = (*centre_m, 0.0, 0.0)[axis]

    def maxSampleCount(self) -> int:  # noqa: N802
        return len(self._centres_m)


def run(
    kind: str, dimensions: int, problem: PlaneProblem, milestones: list[Milestone]
) -> list[Reached]:
    """One run of one of `KINDS`, looked at where it passes each milestone; setting up apart."""
    util.setLogLevel(util.LOG_NONE)
    util.RNG.setSeed(SEED)
    make, guided = KINDS[kind]
    definition, objective = _definition(
        problem, dimensions, _GuidedObjective if guided else _Objective
    )
    planner = make(definition.getSpaceInformation())
    planner.setProblemDefinition(definition)
    planner.setup()
    left = list(milestones)
    reached = []
    processor_s, wall_s = 0.0, 0.0
    while left:
        time_s = min(milestone.time_s for milestone in left) - processor_s
        evaluations = min(milestone.evaluations for milestone in left)
        began, began_wall = time.thread_time(), time.perf_counter()
        planner.solve(
            base.PlannerTerminationCondition(
                lambda end_s=began + time_s, most=evaluations: (
                    objective.evaluations >= most or time.thread_time() >= end_s
                )
            )
        )
        processor_s += time.thread_time() - began
        wall_s += time.perf_counter() - began_wall
        cost = math.inf
        if definition.hasExactSolution():
            states = definition.getSolutionPath().getStates()
            cost = problem.of_path(np.array([(state[0], state[1]) for state in states]))
        now = [
            milestone
            for milestone in left
            if processor_s >= milestone.time_s or objective.evaluations >= milestone.evaluations
        ]
        left = [milestone for milestone in left if milestone not in now]
        reached += [
            Reached(
                name=milestone.name,
                processor_s=processor_s,
                wall_s=wall_s,
                cost=cost,
                cut=objective.evaluations < milestone.evaluations < math.inf,
            )
            for milestone in now
        ]
    return reached


def _definition(
    problem: PlaneProblem, dimensions: int, kind: type[_Objective]
) -> tuple[base.ProblemDefinition, _Objective]:
    grid, field = problem.planner.maps.grid, problem.cost.field
    angles = np.radians([-90.0, -45.0, 0.0, 45.0, 90.0])
    across, up = field.elevation_mps * np.cos(angles), abs(field.elevation_mps * np.sin(angles))
    bounds = base.RealVectorBounds(dimensions)
    limits = [*zip(grid.lower_m, grid.upper_m, strict=True)]
    for speed, own in zip((across.max(), up.max()), problem.velocity_mps, strict=True):
        limit = max(float(speed), abs(own))
        limits.append((-limit, limit))
    for axis, (low, high) in enumerate(limits[:dimensions]):
        bounds.setLow(axis, low)
        bounds.setHigh(axis, high)
    space = base.RealVectorStateSpace(dimensions)
    space.setBounds(bounds)
    information = base.SpaceInformation(space)
    information.setStateValidityChecker(_StateValidity(information, problem))
    information.setMotionValidator(_MotionValidator(information, field))
    information.setup()
    definition = base.ProblemDefinition(information)
    definition.addStartState(_state(information, (*problem.start_m, *problem.velocity_mps)))
    goal: base.Goal = _Region(information, problem)
    if problem.ends_at_rest:
        goal = base.GoalStates(information)
        for cell in problem.goal_cells:
            goal.addState(_state(information, (*grid.centre_m(cell), 0.0, 0.0)))
    definition.setGoal(goal)
    objective = kind(information, problem)
    definition.setOptimizationObjective(objective)
    return definition, objective


def _state(information: base.SpaceInformation, values: tuple[float, ...]) -> base.State:
    """A state of as many of the values as there are dimensions."""
    state = information.allocState()
    for axis in range(information.getStateDimension()):
        state[axis] = values[axis]
    return state

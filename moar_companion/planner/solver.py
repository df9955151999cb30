"""Exact search on a graph: from nothing, for all states at once, or between a table's bounds.

Inputs: a graph, a goal, a start's flat cell and velocity, weights. Output: headings of the best
path. A solver owns the memory that its searches write to: one for each thread.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ..types import Weights
from . import search
from .arrays import CellMemory, StateMemory, StepCost
from .graph import Graph
from .grid import FloatArray, IntArray
from .jit import direct
from .path_cost_kernels import walk
from .plan_values import Cost

TIE_TIME_ENERGY = 1e-10
"""Added to k_T and k_E: of paths with equal J, the one with the least sum of TC and EC.
J is off its optimum by at most this times that sum of the optimal path: 1e-9 at 10 s."""

TIE_ACTION = 1e-17
"""Added per action, as much as 0.1 us of TC: orders paths that are equal in J, TC and EC."""

TIE_LEG = 1e-15
"""Added per metre of the leg behind the goal's cell, as much as 10 us of TC."""

TIE_SAFETY = 1e-14
"""Added to k_S, as much as 100 us of TC for each unit of SC d: where safety has no weight, it
orders paths that are equal in J, TC and EC. The three are as small as rounding permits: they order
equal costs, not similar ones. Paths that differ in their number of actions alone are so rare that
rounding may decide where J is large."""

_SLACK = 1e-14
"""Relative difference of bounds that is due to rounding."""

_NOWHERE = -1

_backward, _follow, _forward = map(direct, (search.backward, search.follow, search.forward))
_walk = direct(walk)


@dataclass(frozen=True, kw_only=True, eq=False)
class CostToGoTable:
    """Exact costs to go at the corners of triangles that cover all weights.

    For one goal and graph the cost to go of a state is a minimum over paths. The cost of a path is
    linear in the weights; so the minimum is concave in them. Interpolated within a triangle, its
    corners' values are therefore a lower bound, and each corner's path costs no less: an upper one.
    Both hold for any triangle that holds the weights, so neighbours need not share their corners.

    roots:     (r, 3, 3)   times weights: their shares of a root triangle's corners
    triangles: (n, 4)      three corners; then the first of the two triangles into which the middle
                           of its first edge cuts it, at its first corner; -1 if it is whole
    weights:   (c, 3)      of the corners
    costs_to_go, policies: (c, cells, M), of each corner; infinite and 0 where there is no path
    """

    roots: FloatArray
    triangles: IntArray
    weights: FloatArray
    costs_to_go: FloatArray
    policies: npt.NDArray[np.uint8]


@dataclass(frozen=True, kw_only=True, eq=False)
class Goal:
    """End of a path: (n,) flat cells, at rest there or with any heading.

    leg_m: (n,) length to be flown behind each; it decides only between equal costs.
    """

    cells: IntArray
    leg_m: FloatArray
    ends_at_rest: bool


class Solver:
    """Searches one graph. Not safe for use by two threads at once."""

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        cells, moves = len(graph.allowed), len(graph.offset) - 1
        self._version = 0
        self._label = np.empty((cells, moves))
        self._policy = np.empty((cells, moves), dtype=np.uint8)
        self._cells = CellMemory(
            lead=np.empty((cells, moves)),
            pending=np.empty(cells, dtype=np.uint32),
            touched=np.zeros(cells, dtype=np.int64),
            keys=np.empty(cells),
            items=np.empty(cells, dtype=np.int64),
            position=np.empty(cells, dtype=np.int64),
        )
        states = cells * moves
        self._states = StateMemory(
            cost=np.empty(states),
            came_by=np.empty(states, dtype=np.uint8),
            touched=np.zeros(states, dtype=np.int64),
            keys=np.empty(states),
            items=np.empty(states, dtype=np.int64),
            position=np.empty(states, dtype=np.int64),
        )

    def cold(
        self, goal: Goal, start: int, velocity: FloatArray, weights: Weights
    ) -> tuple[IntArray | None, int]:
        """The best path, None if there is none, and the number of expanded cells.

        The start is no cell of the goal.
        """
        _, first, expanded = self._backward(
            goal, start, velocity, weights, self._label, self._policy
        )
        if not first:
            return None, expanded
        headings: IntArray = _follow(
            start, first, self._policy, self.graph.offset, goal.ends_at_rest
        )
        return headings, expanded

    def field(
        self, goal: Goal, weights: Weights, label: FloatArray, policy: npt.NDArray[np.uint8]
    ) -> None:
        """Write the exact cost to go and the best next heading of all states, (cells, M)."""
        label.fill(np.inf)
        policy.fill(0)
        self._backward(goal, _NOWHERE, np.zeros(3), weights, label, policy)

    def between(
        self, goal: Goal, table: CostToGoTable, start: int, velocity: FloatArray, weights: Weights
    ) -> tuple[IntArray | None, int]:
        """Path as from `cold`, searched between the bounds of a table of this goal."""
        self._version += 1
        headings, lower, expanded = _forward(
            start,
            velocity,
            self.graph.steps,
            _step_cost(weights, self.graph.v_max_mps),
            weights.safety,
            weights.time,
            weights.energy,
            table.roots,
            table.triangles,
            table.costs_to_go,
            table.policies,
            goal.ends_at_rest,
            _SLACK,
            self._states,
            self._version,
        )
        return (headings if lower < np.inf else None), expanded

    def _backward(
        self,
        goal: Goal,
        start: int,
        velocity: FloatArray,
        weights: Weights,
        label: FloatArray,
        policy: npt.NDArray[np.uint8],
    ) -> tuple[float, int, int]:
        self._version += 1
        found: tuple[float, int, int] = _backward(
            goal.cells,
            TIE_LEG * goal.leg_m,
            goal.ends_at_rest,
            start,
            velocity,
            self.graph.steps,
            _step_cost(weights, self.graph.v_max_mps),
            label,
            policy,
            self._cells,
            self._version,
        )
        return found


def arrival_costs(graph: Graph, weights: Weights) -> tuple[FloatArray, float]:
    """J of the arrival in each state, (cells, M), but for the energy cost; that for each m/s.

    Meaningless where a move does not lead to a state.
    """
    length_m, speed = graph.length_m[1:], graph.speed[:, 1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        step = weights.safety * graph.safety[:, None] * length_m + weights.time * length_m / speed
    return step, 0.5 * weights.energy / graph.v_max_mps


def walked(
    graph: Graph, start: int, velocity: FloatArray, headings: IntArray, weights: Weights
) -> tuple[IntArray, Cost]:
    """The states along headings, (n + 1, d + 1) and read-only, and their cost.

    start: flat cell; velocity: (3,) m/s.
    """
    states, safety, time, energy = _walk(
        start, velocity, headings, len(graph.grid.shape), graph.steps, graph.v_max_mps
    )
    states.flags.writeable = False
    total = weights.safety * safety + weights.time * time + weights.energy * energy
    return states, Cost(total=total, safety=safety, time=time, energy=energy)


def _step_cost(weights: Weights, v_max_mps: float) -> StepCost:
    """The cost of a step for weights, with additions that order equal costs."""
    return StepCost(
        weights.safety + TIE_SAFETY,
        weights.time + TIE_TIME_ENERGY,
        0.5 * (weights.energy + TIE_TIME_ENERGY) / v_max_mps,
        TIE_ACTION,
    )

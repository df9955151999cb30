"""Builds tables: a goal's exact costs to go over all weights, coarse at first, then refined.

Inputs: a graph, a goal, the weights that the mission starts from. Output: a `CostToGoTable`, whole
at any time. The triangle of weights with the greatest gap between the two bounds is refined first,
by the average over a sample of states. Gaps that risks can lead into from the mission's weights
count more.
"""

from __future__ import annotations

import heapq
import itertools
import math

import numpy as np

from ..types import RiskIndices, Weights
from .adaptation import Adaptation
from .graph import Graph
from .grid import FloatArray, IntArray
from .path_cost_kernels import policy_sums
from .solver import CostToGoTable, Goal, Solver

_SAMPLES = 256
"""Number of states in the comparison of bounds."""
_LIKELY = 2.0
"""Factor of a gap that risks may lead into."""
_ALIKE = 0.05
"""A weight of energy that is small: tables made with it leave the fewest states to search."""
_MOST_CORNERS = 64
"""Most corners: more would shorten few searches."""
_FEWEST_CORNERS = 8
"""Fewest corners: with less a table is slower than none."""
_THINNEST = 1e-3
"""Least height of an initial triangle."""
_ON_THE_EDGE = 1e-9
_LEVELS = (0.0, 0.5, 1.0)
"""Levels of each risk index, for the weights that they can reach."""


class TableBuilder:
    """Builds the table of a goal. Not safe for use by two threads at once."""

    def __init__(
        self, graph: Graph, goal: Goal, adaptation: Adaptation, most: int = _MOST_CORNERS
    ) -> None:
        """Begins with the extremes and the base weights; ends with `most` corners."""
        self._solver = Solver(graph)
        self._goal = goal
        cells, moves = len(graph.allowed), len(graph.offset) - 1
        self._costs_to_go = np.empty((most, cells, moves))
        self._policies = np.empty((most, cells, moves), dtype=np.uint8)
        self._weights: list[FloatArray] = []
        self._sums: list[FloatArray] = []
        self._samples: IntArray = np.empty(0, dtype=np.int64)
        self._likely = _reachable(adaptation)
        self._triangles: list[list[int]] = []
        self._middles: dict[tuple[int, int], int] = {}
        self._worst: list[tuple[float, int]] = []
        extremes = [self._corner(corner) for corner in np.eye(3)]
        centre = np.array((adaptation.base.safety, adaptation.base.time, adaptation.base.energy))
        # No thin triangles: their shares would be inexact.
        centre[centre < _THINNEST] = 0.0
        centre /= centre.sum()
        middle = self._corner(centre) if centre.max() < 1.0 else extremes[int(centre.argmax())]
        around = [
            [first, second, middle]
            for first, second in itertools.combinations(extremes, 2)
            if abs(np.linalg.det([self._weights[at] for at in (first, second, middle)]))
            > _ON_THE_EDGE
        ]
        for corners in around:
            self._add(corners)
        self._roots = np.linalg.inv(
            [
                np.stack([self._weights[at] for at in triangle[:3]], axis=1)
                for triangle in self._triangles
            ]
        )

    @property
    def corners(self) -> int:
        """Number of weights that have a field."""
        return len(self._weights)

    def refine(self) -> bool:
        """Cuts the worst triangle into two; False if no memory or no gap is left."""
        if not self._worst or len(self._weights) == len(self._costs_to_go):
            return False
        _, index = heapq.heappop(self._worst)
        first, second, apex = self._triangles[index][:3]
        edge = (min(first, second), max(first, second))
        if edge not in self._middles:
            self._middles[edge] = self._corner(0.5 * (self._weights[first] + self._weights[second]))
        middle = self._middles[edge]
        self._triangles[index][3] = len(self._triangles)
        self._add([first, middle, apex])
        self._add([second, middle, apex])
        return True

    def table(self) -> CostToGoTable:
        """The table as it is now; refining it further does not change it."""
        count = len(self._weights)
        return CostToGoTable(
            roots=self._roots,
            triangles=np.array(self._triangles, dtype=np.int64),
            weights=np.array(self._weights),
            costs_to_go=self._costs_to_go[:count],
            policies=self._policies[:count],
        )

    def _corner(self, weights: FloatArray) -> int:
        """Computes the exact field of some weights; returns its number."""
        number = len(self._weights)
        field, policy = self._costs_to_go[number], self._policies[number]
        self._solver.field(self._goal, Weights(*(float(value) for value in weights)), field, policy)
        if not number:
            reached = np.flatnonzero(np.isfinite(field))
            self._samples = reached[:: max(1, len(reached) // _SAMPLES)].copy()
        self._weights.append(weights)
        self._sums.append(
            policy_sums(
                self._samples,
                policy,
                self._solver.graph.steps,
                self._goal.ends_at_rest,
                self._solver.graph.v_max_mps,
            )
        )
        return number

    def _add(self, corners: list[int]) -> None:
        """Adds a triangle, its longest edge first."""
        apex = max(
            range(3),
            key=lambda at: float(
                np.sum((self._weights[corners[at - 2]] - self._weights[corners[at - 1]]) ** 2)
            ),
        )
        ordered = [corners[apex - 2], corners[apex - 1], corners[apex]]
        gap = self._gap(ordered)
        if gap > _ON_THE_EDGE:
            heapq.heappush(self._worst, (-gap, len(self._triangles)))
        self._triangles.append([*ordered, -1])

    def _gap(self, corners: list[int]) -> float:
        """Gap of the bounds at the centre, times the triangle's size.

        Size is that of an edge: a larger triangle is likelier to hold the weights, and the gap of a
        small one is soon closed. A gap counts more where risks may lead, and the less the energy of
        turns weighs: that energy alone separates similar paths; without it a gap holds more states.
        """
        weights = np.array([self._weights[at] for at in corners])
        sums = np.array([self._sums[at] for at in corners])
        centre = weights.mean(axis=0)
        upper = (sums @ centre).min(axis=0)
        lower = np.einsum("csk,ck->s", sums, weights) / 3.0
        shares = np.linalg.solve(weights.T, self._likely.T)
        likely = bool((shares > -_ON_THE_EDGE).all(axis=0).any())
        size = math.sqrt(abs(float(np.linalg.det(weights))))
        states = float((upper - lower).mean()) / (float(centre[2]) + _ALIKE)
        return states * size * (_LIKELY if likely else 1.0)


def shares(graph: Graph, goals: int, most_bytes: int) -> tuple[int, int]:
    """Number of tables that the memory holds, and number of corners of each.

    One table for every goal; for some goals only, where corners would be too few.
    """
    states = len(graph.allowed) * (len(graph.offset) - 1)
    room = most_bytes // (states * (np.float64().itemsize + np.uint8().itemsize))
    corners = min(max(room // max(goals, 1), _FEWEST_CORNERS), _MOST_CORNERS)
    return room // corners, corners


def _reachable(adaptation: Adaptation) -> FloatArray:
    """Weights (n, 3) that risks lead to, over all their range."""
    risks = itertools.product(_LEVELS, repeat=4)
    reached = (
        adaptation.weights(
            RiskIndices(wind=wind, communication=radio, localization=place, battery=battery)
        )
        for wind, radio, place, battery in risks
    )
    return np.array([(each.safety, each.time, each.energy) for each in reached])

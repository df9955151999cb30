"""Comparison of two paths: the rest of a plan against a new one, and the distance of their lines.

Inputs: plans of one site. Outputs: the rest of a plan under a newer request's weights; the distance
between two paths, and their clearances. Under these weights J of the rest is comparable with J of
the newer plan.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..texts.text_format import distance
from .graph import Graph
from .grid import STOP, FloatArray, IntArray
from .maps import Maps
from .plan_values import Plan, PlanRequest
from .solver import walked

_SAME_CLEARANCE_M = 0.005
"""A difference that a text with two digits does not show."""
_SAME_PATH_M = 0.05
"""A difference that a text with one digit does not show."""
_MOST_SHOWN_M = 9_999.0
"""Greatest distance in a text."""


class PathDifference(NamedTuple):
    """Difference of a path from an earlier one.

    mean_m, greatest_m: distance of its points from the other's line; where_m: of the greatest.
    Clearances and durations are those before and after, landing legs included.
    """

    mean_m: float
    greatest_m: float
    where_m: tuple[float, ...]
    mean_clearance_m: tuple[float, float]
    min_clearance_m: tuple[float, float]
    duration_s: tuple[float, float]

    def gist(self) -> str:
        """Short text: `path 1.4 m outward`, by the mean clearance."""
        before_m, after_m = self.mean_clearance_m
        if self.greatest_m < _SAME_PATH_M:
            return "path stays"
        side = ""
        if abs(after_m - before_m) >= _SAME_CLEARANCE_M:
            side = " outward" if after_m > before_m else " inward"
        return f"path {distance(min(self.greatest_m, _MOST_SHOWN_M))} m{side or ' moved'}"

    def words(self) -> str:
        """Text: the gist, the mean distance, and the clearances before and after."""
        (before_m, after_m), (least_before_m, least_m) = self.mean_clearance_m, self.min_clearance_m
        if self.greatest_m < _SAME_PATH_M:
            return self.gist()
        moved = f"{self.gist()}, {self.mean_m:.1f} m on average"
        if not math.isfinite(after_m):
            return moved
        return (
            f"{moved}; clearance {before_m:.2f} -> {after_m:.2f} m on average, "
            f"{least_before_m:.2f} -> {least_m:.2f} m at least"
        )

    def to_dict(self) -> dict[str, Any]:
        """The difference as values for JSON; an infinite clearance is null."""

        def finite(pair: tuple[float, float]) -> list[float | None]:
            return [value if math.isfinite(value) else None for value in pair]

        return {
            "mean_m": self.mean_m,
            "greatest_m": self.greatest_m,
            "where_m": list(self.where_m),
            "mean_clearance_m": finite(self.mean_clearance_m),
            "min_clearance_m": finite(self.min_clearance_m),
            "duration_s": list(self.duration_s),
            "words": self.words(),
        }


def is_free(graph: Graph, states: IntArray) -> bool:
    """Returns True if a path of states (n, d + 1) is still free on a graph of the same grid."""
    flat = (states[:-1, :-1] + 1) @ np.array(graph.grid.strides)
    heading = states[1:, -1]
    moves = heading != STOP
    return bool((graph.allowed[flat[moves]] >> heading[moves] & 1).all())


def rest_of(plan: Plan, maps: Maps, first: int, request: PlanRequest, graph: Graph) -> Plan | None:
    """A found plan from its state `first` on, as an answer to a newer request; None if not free.

    Its cost is that under the request's weights and from its velocity; it takes the given graph
    and maps.
    """
    states = plan.states[first:]
    if not is_free(graph, states):
        return None
    velocity = np.zeros(3)
    velocity[: len(request.velocity_mps)] = request.velocity_mps
    start = graph.grid.flat(tuple(states[0, :-1]))
    headings = np.ascontiguousarray(states[1:, -1])
    _, cost = walked(graph, start, velocity, headings, request.weights)
    return replace(plan, request=request, graph=graph, maps=maps, states=states, cost=cost)


def path_difference(before: Plan, after: Plan) -> PathDifference | None:
    """Difference of a plan's path from another; None where either plan has no path."""
    if before.metrics is None or after.metrics is None:
        return None
    points = after.waypoints.position_m
    distance = _distance_to_line(points, before.waypoints.position_m)
    farthest = int(distance.argmax())
    return PathDifference(
        mean_m=float(distance.mean()),
        greatest_m=float(distance[farthest]),
        where_m=tuple(float(value) for value in points[farthest]),
        mean_clearance_m=(before.metrics.mean_clearance_m, after.metrics.mean_clearance_m),
        min_clearance_m=(before.metrics.min_clearance_m, after.metrics.min_clearance_m),
        duration_s=(before.metrics.duration_s, after.metrics.duration_s),
    )


def _distance_to_line(points_m: FloatArray, line_m: FloatArray) -> FloatArray:
    """Distances (n,) of points (n, d) from a line through points (m, d)."""
    begin, step = line_m[:-1], np.diff(line_m, axis=0)
    if not len(step):
        return np.asarray(np.sqrt(((points_m - line_m[0]) ** 2).sum(axis=1)))
    length2 = (step**2).sum(axis=1)
    offset = points_m[:, None] - begin
    along = (offset * step).sum(axis=2) / np.where(length2 > 0.0, length2, 1.0)
    nearest = np.clip(along, 0.0, 1.0)[..., None] * step
    return np.asarray(np.sqrt(((offset - nearest) ** 2).sum(axis=2)).min(axis=1))

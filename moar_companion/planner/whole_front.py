"""All optimal trade-offs between two costs of one planning problem, and the best path for a wish.

Inputs: a planner and a request. Outputs: the whole Pareto front of safety against a weighted sum of
time and energy, of safety against time, or with the energy in Wh; also between the points that
weighted sums reach (`analysis/pareto`). Exact, as plans are: to 1e-9 of a sum.
"""

from __future__ import annotations

import enum
import math
from bisect import bisect_right
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy  # its parts are loaded at their first use

from ..types import Weights
from .arrays import Criterion, Labels
from .graph import Graph
from .grid import BoolArray, FloatArray, IntArray
from .jit import direct
from .pareto_search import headings_to, pareto_search
from .plan_values import Compute, Plan, PlanRequest
from .planner import Planner, SearchProblem
from .regions import LandingLeg, landing_leg
from .solver import Solver, arrival_costs, walked

_FIRST_ROOM = 1 << 16
"""Labels for which a search has memory at first; then four times as many, again and again."""
_MOST_LABELS = 1 << 24
"""Labels at most: 0.9 GB. A front that needs more is searched less closely."""
_MOST_POINTS = 1 << 14
_CLOSENESS = 1e-3
"""Of the second sum, where the whole front takes too many labels; ten times at each further try."""
_EQUAL = 1e-9
"""Sums closer than this, relative, are equal."""
_NOT_MISSING = 1e-300
"""Added to costs: a sparse matrix takes 0 for no edge."""
_S_PER_H = 3600.0
_SAFETY, _TIME = Weights(1.0, 0.0, 0.0), Weights(0.0, 1.0, 0.0)

PowerW = Callable[[FloatArray, FloatArray], FloatArray]
"""Power in W at level and upward speeds, arrays of one shape, in m/s."""

_search, _headings_to = direct(pareto_search), direct(headings_to)


class Preference(str, enum.Enum):
    """Cost that is to be least."""

    SAFEST = "safest"
    FASTEST = "fastest"


class Limited(str, enum.Enum):
    """Value that a wish limits, with its unit; the landing leg counts.

    Duration and energy end with the rest at the target or above the landing point. The clearance is
    the least distance of the aircraft's centre to an obstacle (`d_obs`).
    """

    DURATION = "duration_s"
    ENERGY = "energy_wh"
    CLEARANCE = "clearance_m"


@dataclass(frozen=True, slots=True, kw_only=True)
class Wish:
    """A limit: at most of a duration or an energy, at least of a clearance; and what is best."""

    limited: Limited
    limit: float
    prefer: Preference


@dataclass(frozen=True, slots=True, kw_only=True)
class Choice:
    """The best path for a wish; without one, the nearest that exists.

    plan: None where no path leads to the goal at all. value: of what the wish limits, in its unit.
    """

    wish: Wish
    plan: Plan | None = None
    value: float = math.nan
    fulfilled: bool = False


@dataclass(frozen=True, kw_only=True, eq=False)
class WholeFront:
    """Optimal trade-offs of two costs, with one path of each.

    first, second: (n,) sums, the least first sum first; with the landing leg's part.

    closeness: 0 for all trade-offs; otherwise each that is left out has a neighbour whose first sum
    is not greater and whose second is at most 1 + closeness times as great.
    """

    first: FloatArray
    second: FloatArray
    closeness: float
    labels: int
    """Effort: number of paths to states."""
    _paths: Callable[[int], Plan]

    def __len__(self) -> int:
        return len(self.first)

    def plan(self, index: int) -> Plan:
        """The path of a trade-off."""
        return self._paths(index)

    @property
    def supported(self) -> BoolArray:
        """(n,) True for the corners of the lower convex hull: those that weighted sums reach."""
        hull: list[int] = []
        for at in range(len(self)):
            while len(hull) > 1 and self._turn(hull[-2], hull[-1], at) <= 0.0:
                hull.pop()
            hull.append(at)
        supported = np.zeros(len(self), dtype=bool)
        supported[hull] = True
        return supported

    def _turn(self, one: int, two: int, three: int) -> float:
        """Above 0 where the second point lies below the line from the first to the third."""
        x, z = self.first, self.second
        turn: float = (x[two] - x[one]) * (z[three] - z[one])
        return turn - float((z[two] - z[one]) * (x[three] - x[one]))

    def within_second(self, most: float) -> int | None:
        """Index of the least first sum whose second is at most that; None if none is."""
        count = bisect_right(self.second[::-1], most + _EQUAL * max(1.0, abs(most)))
        return len(self) - count if count else None


def effort_weights(weights: Weights) -> Weights:
    """The second cost of the whole front: k_T : k_E of these weights, without safety.

    Where both are 0, time and energy count alike.
    """
    time, energy = weights.time, weights.energy
    return Weights.normalised(0.0, time, energy) if time + energy > 0.0 else Weights(0.0, 0.5, 0.5)


def whole_front(planner: Planner, request: PlanRequest) -> WholeFront | None:
    """Safety against the effort k_T TC + k_E EC (`effort_weights`); None without a path.

    Raises InputError as `Planner.plan`.
    """
    problem = planner.problem(request)
    if isinstance(problem, Plan):
        return None
    return _front(
        planner,
        problem,
        _weighted(planner, problem, _SAFETY),
        _weighted(planner, problem, effort_weights(request.weights)),
    )


def choose(
    planner: Planner, request: PlanRequest, wish: Wish, power_w: PowerW | None = None
) -> Choice:
    """The best path for a wish, exactly. power_w: needed for a limit of the energy."""
    problem = planner.problem(request)
    if isinstance(problem, Plan):
        return Choice(wish=wish)
    preferred = _SAFETY if wish.prefer is Preference.SAFEST else _TIME
    if wish.limited is Limited.CLEARANCE:
        return _with_clearance(planner, problem, wish, preferred)
    if wish.limited is Limited.ENERGY:
        if power_w is None:
            raise ValueError("a limit of the energy needs the power")
        second = _powered(planner, problem, power_w)
    else:
        second = _timed(planner, problem)
    first = _timed(planner, problem) if preferred is _TIME else _weighted(planner, problem, _SAFETY)
    front = _front(planner, problem, first, second)
    if front is None:
        return Choice(wish=wish)
    index = front.within_second(wish.limit)
    at = len(front) - 1 if index is None else index
    return Choice(
        wish=wish, plan=front.plan(at), value=float(front.second[at]), fulfilled=index is not None
    )


def _weighted(planner: Planner, problem: SearchProblem, weights: Weights) -> Criterion:
    """J for weights; the landing leg has no part in it."""
    graph = planner.graph
    step, change = arrival_costs(graph, weights)
    to_go = np.empty_like(step)
    policy = np.empty(step.shape, dtype=np.uint8)
    Solver(graph).field(problem.goal.goal, weights, to_go, policy)
    return Criterion(step, to_go, np.zeros(len(graph.allowed)), change)


def _timed(planner: Planner, problem: SearchProblem) -> Criterion:
    """The duration in seconds, landing leg included."""
    step, _ = arrival_costs(planner.graph, _TIME)

    def leg_s(leg: LandingLeg, from_m: FloatArray) -> float:
        return float(_leg_times(leg, from_m)[1].sum())

    return _additive(planner, problem, step, leg_s)


def _powered(planner: Planner, problem: SearchProblem, power_w: PowerW) -> Criterion:
    """The energy in Wh, landing leg included."""
    graph = planner.graph
    speed, unit = graph.speed[:, 1:], graph.unit[1:]
    level, up = speed * np.abs(unit[:, 0]), speed * unit[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        step = power_w(level, up) * graph.length_m[1:] / speed / _S_PER_H

    def leg_wh(leg: LandingLeg, from_m: FloatArray) -> float:
        moved_m, duration_s = _leg_times(leg, from_m)
        velocity = moved_m / duration_s[:, None]
        return float(power_w(np.abs(velocity[:, 0]), velocity[:, 1]) @ duration_s) / _S_PER_H

    return _additive(planner, problem, step, leg_wh)


def _leg_times(leg: LandingLeg, from_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The moves of a landing leg that begins at a point, (n, 2), and their durations (n,)."""
    moved_m = np.diff(np.concatenate([from_m[None], leg.points_m]), axis=0)
    duration_s = np.hypot(moved_m[:, 0], moved_m[:, 1]) / leg.speed_mps
    moves = duration_s > 0.0
    return moved_m[moves], duration_s[moves]


def _additive(
    planner: Planner,
    problem: SearchProblem,
    step: FloatArray,
    of_leg: Callable[[LandingLeg, FloatArray], float],
) -> Criterion:
    """A cost of arrivals alone, with that of the landing leg behind each goal's cell."""
    graph = planner.graph
    goals = problem.goal.goal.cells
    behind = np.zeros(len(graph.allowed))
    for cell, leg, from_m in _legs(planner, problem):
        behind[cell] = of_leg(leg, from_m)
    cells, moves = step.shape
    before, after, cost = [np.full(len(goals), cells)], [goals], [behind[goals]]
    for move in range(1, moves + 1):
        source = np.flatnonzero(graph.allowed & np.uint32(1 << move))
        target = source + graph.offset[move]
        # From the goal backwards.
        before.append(target)
        after.append(source)
        cost.append(step[target, move - 1])
    edges = scipy.sparse.coo_array(
        (
            np.concatenate(cost) + _NOT_MISSING,
            (np.concatenate(before), np.concatenate(after)),
        ),
        shape=(cells + 1, cells + 1),
    )
    to_go = scipy.sparse.csgraph.dijkstra(edges.tocsr(), indices=cells)[:cells]
    return Criterion(step, np.repeat(to_go[:, None], moves, axis=1), behind, 0.0)


def _legs(planner: Planner, problem: SearchProblem) -> list[tuple[int, LandingLeg, FloatArray]]:
    """The landing leg behind each flat cell of the goal, and the point where it begins, (2,)."""
    grid, region = planner.graph.grid, problem.goal.region
    if region is None:
        return []
    return [
        (
            grid.flat(cell),
            landing_leg(planner.site, planner.vehicle, region, cell),
            np.array(grid.centre_m(cell)),
        )
        for cell in region.corners
    ]


def _front(
    planner: Planner, problem: SearchProblem, first: Criterion, second: Criterion
) -> WholeFront | None:
    """The front of two costs; None if no path leads to the goal."""
    graph, goal = planner.graph, problem.goal.goal
    if problem.is_at_goal:
        end = np.array([problem.start])
        change = float(np.sqrt((problem.velocity_mps**2).sum())) if goal.ends_at_rest else 0.0
        return WholeFront(
            first=first.behind[end],
            second=second.behind[end] + second.change * change,
            closeness=0.0,
            labels=0,
            _paths=lambda _: _plan(planner, problem, problem.stop_headings, 0),
        )
    is_goal = np.zeros(len(graph.allowed), dtype=np.uint8)
    is_goal[goal.cells] = 1
    moves = len(graph.offset) - 1
    ends = np.empty(_MOST_POINTS, dtype=np.int64)
    room, closeness = _FIRST_ROOM, 0.0
    while True:
        sums = np.empty((4, room))
        items = np.empty((3, room), dtype=np.int64)
        labels = Labels(*sums, *items)
        found, count, whole = _search(
            problem.start,
            problem.velocity_mps,
            graph.steps,
            first,
            second,
            is_goal,
            goal.ends_at_rest,
            closeness,
            np.full(len(graph.allowed) * moves + 1, np.inf),
            labels,
            ends,
        )
        if whole:
            break
        if room < _MOST_LABELS and found < _MOST_POINTS:
            room *= 4
        else:
            closeness = max(10.0 * closeness, _CLOSENESS)
    if not found:
        return None
    kept = _undominated(ends[:found], labels)
    parent, state = labels.parent[:count].copy(), labels.state[:count].copy()

    def path(index: int) -> Plan:
        headings: IntArray = _headings_to(kept[index], parent, state, moves, goal.ends_at_rest)
        return _plan(planner, problem, headings, count)

    return WholeFront(
        first=labels.first_sum[kept],
        second=labels.second_sum[kept],
        closeness=closeness,
        labels=count,
        _paths=path,
    )


def _undominated(ends: IntArray, labels: Labels) -> IntArray:
    """The ends without those whose first sum is equal, to rounding, to that of a later one."""
    first = labels.first_sum[ends]
    kept = np.append(np.diff(first) > _EQUAL * np.maximum(1.0, np.abs(first[1:])), True)
    undominated: IntArray = ends[kept]
    return undominated


def _plan(planner: Planner, problem: SearchProblem, headings: IntArray, expanded: int) -> Plan:
    request = problem.request
    states, cost = walked(
        planner.graph, problem.start, problem.velocity_mps, headings, request.weights
    )
    compute = Compute(map_ms=None, search_ms=None, expanded=expanded)
    return planner.found(request, states, cost, compute)


def _with_clearance(
    planner: Planner, problem: SearchProblem, wish: Wish, preferred: Weights
) -> Choice:
    """The best path whose clearance is nowhere less; otherwise the one of the greatest clearance.

    The cells that are too near are left out of the graph, and goals whose landing leg is.
    """
    graph, goal = planner.graph, problem.goal
    clearance_m = np.asarray(graph.grid.padded(planner.maps.obstacle_distance_m, 0.0))
    behind_m = {
        cell: float(leg.clearance_m.min(initial=math.inf))
        for cell, leg, _ in _legs(planner, problem)
    }

    def best(limit_m: float) -> Plan | None:
        if clearance_m[problem.start] < limit_m:
            return None
        kept = np.array([behind_m.get(int(cell), math.inf) >= limit_m for cell in goal.goal.cells])
        kept &= clearance_m[goal.goal.cells] >= limit_m
        if problem.is_at_goal:
            at_start = goal.goal.cells == problem.start
            if not kept[at_start].any():
                return None
            return _plan(planner, problem, problem.stop_headings, 0)
        if not kept.any():
            return None
        headings, expanded = Solver(_clear_of(graph, clearance_m >= limit_m)).cold(
            replace(goal.goal, cells=goal.goal.cells[kept], leg_m=goal.goal.leg_m[kept]),
            problem.start,
            problem.velocity_mps,
            preferred,
        )
        return None if headings is None else _plan(planner, problem, headings, expanded)

    plan = best(wish.limit)
    if plan is not None:
        return Choice(wish=wish, plan=plan, value=_clearance_m(plan), fulfilled=True)
    # The greatest clearance of any path is that of a cell or of a landing leg.
    values = np.unique([*clearance_m[np.isfinite(clearance_m)], *behind_m.values()])
    values = values[values < wish.limit]
    low, high = 0, len(values)
    while low < high:
        middle = (low + high) // 2
        found = best(float(values[middle]))
        plan, low, high = (plan, low, middle) if found is None else (found, middle + 1, high)
    value = math.nan if plan is None else _clearance_m(plan)
    return Choice(wish=wish, plan=plan, value=value, fulfilled=False)


def _clearance_m(plan: Plan) -> float:
    assert plan.metrics is not None  # a path was found
    return plan.metrics.min_clearance_m


def _clear_of(graph: Graph, clear: BoolArray) -> Graph:
    """The graph without moves into cells (cells,) that are not clear."""
    allowed = graph.allowed.copy()
    for move in range(1, len(graph.offset)):
        into = np.roll(clear, -int(graph.offset[move]))
        allowed &= np.where(into, np.uint32(0xFFFFFFFF), ~np.uint32(1 << move)).astype(np.uint32)
    return replace(graph, allowed=allowed)

"""Peers that search a graph: the paper's A*, SciPy, NetworkX and scikit-image.

The first three search the same optimum as the planner, on the same states and steps, and have to
agree with it. scikit-image has cells and no headings.
"""

from __future__ import annotations

import heapq
import math
from dataclasses import dataclass

import networkx as nx
import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from skimage.graph import MCP_Geometric

from moar_companion import Plan, Planner, Weights
from moar_companion.planner.arrays import STEPS, Steps
from moar_companion.planner.graph import Graph
from moar_companion.planner.grid import STOP, FloatArray, IntArray
from moar_companion.planner.jit import BOOL, F8, I8, jit, read, several
from moar_companion.planner.solver import Goal, walked


@dataclass(frozen=True, kw_only=True, eq=False)
class GraphProblem:
    """A planning problem as a graph: flat cells, and the velocity in space, (3,)."""

    graph: Graph
    goal: Goal
    start: int
    velocity: FloatArray
    weights: Weights

    @classmethod
    def of(cls, planner: Planner, plan: Plan) -> GraphProblem:
        """Request that a plan answers."""
        request = plan.request
        velocity = np.zeros(3)
        velocity[: len(request.velocity_mps)] = request.velocity_mps
        return cls(
            graph=plan.graph,
            goal=planner._goal((request.mission, request.target)).goal,
            start=plan.graph.grid.flat(tuple(plan.states[0, :-1].tolist())),
            velocity=velocity,
            weights=request.weights,
        )


def centres_m(plan: Plan) -> FloatArray:
    """The centres, (n, 2), of the cells of a plan."""
    grid = plan.graph.grid
    return np.array(grid.lower_m) + (plan.states[:, :-1] + 0.5) * grid.resolution_m


@jit(several(F8, I8), I8, read(F8), read(I8), BOOL, STEPS, F8, F8, F8, F8)
def _a_star(
    start: int,
    velocity: FloatArray,
    goals: IntArray,
    ends_at_rest: bool,
    steps: Steps,
    k_safety: float,
    k_time: float,
    k_energy: float,
    v_max: float,
) -> tuple[float, int]:
    cells, headings = steps.speed.shape
    origin = cells * headings
    known = np.full(origin + 1, np.inf)
    closed = np.zeros(origin + 1, dtype=np.bool_)
    is_goal = np.zeros(cells, dtype=np.bool_)
    for goal in goals:
        is_goal[goal] = True
    expanded = 0
    known[origin] = 0.0
    queue = [(0.0, origin)]
    while len(queue) > 0:
        _, state = heapq.heappop(queue)
        if closed[state]:
            continue
        closed[state] = True
        if state == origin:
            cell, heading = start, -1
            vx, vz = velocity[0], velocity[1]
        else:
            cell, heading = state // headings, state % headings
            speed = steps.speed[cell, heading]
            vx, vz = speed * steps.axes[0, heading], speed * steps.axes[1, heading]
        if is_goal[cell] and (heading == 0 or not ends_at_rest):
            return known[state], expanded
        expanded += 1
        for action in range(headings):
            if action > 0 and not steps.allowed[cell] & np.uint32(1 << action):
                continue
            if action == 0 and heading == 0:
                continue
            there = cell + steps.offset[action]
            after = there * headings + action
            speed = steps.speed[there, action]
            x, z = speed * steps.axes[0, action], speed * steps.axes[1, action]
            length = steps.length_m[action]
            total = known[state] + k_safety * steps.safety[there] * length
            total += k_energy * np.sqrt((x - vx) ** 2 + (z - vz) ** 2) / (2.0 * v_max)
            if action > 0:
                total += k_time * length / speed
            if total < known[after]:
                known[after] = total
                guess = 0.0
                if ends_at_rest:
                    dx = abs(steps.place[there, 0] - steps.place[goals[0], 0])
                    dz = abs(steps.place[there, 1] - steps.place[goals[0], 1])
                    octile = max(dx, dz) + (np.sqrt(2.0) - 1.0) * min(dx, dz)
                    guess = k_time * octile * steps.length_m[1] / v_max
                    guess += k_energy * speed / (2.0 * v_max)
                heapq.heappush(queue, (total + guess, after))
    return np.inf, expanded


def textbook(problem: GraphProblem) -> float:
    """J by A* over (cell, heading) with Eq. 8 and early exit, compiled; exits by Dijkstra."""
    weights = problem.weights
    cost, _ = _a_star(
        problem.start,
        problem.velocity,
        problem.goal.cells,
        problem.goal.ends_at_rest,
        problem.graph.steps,
        weights.safety,
        weights.time,
        weights.energy,
        problem.graph.v_max_mps,
    )
    return float(cost)


class StateGraph:
    """States and steps of a graph as arrays: state `cell * H + heading`, the start's own last."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        count, headings = graph.speed.shape
        self.origin = count * headings
        self._velocity = graph.speed[:, :, None] * graph.unit
        cells = np.flatnonzero(graph.allowed)
        tails, heads, terms = [], [], []
        for heading in range(headings):
            whose, there, term = self._steps(cells, heading, self._velocity[cells, heading])
            tails.append(cells[whose] * headings + heading)
            heads.append(there)
            terms.append(term)
        tail = np.concatenate(tails)
        order = np.argsort(tail, kind="stable")
        self._heads = np.concatenate(heads)[order]
        self._terms = np.concatenate(terms)[order]
        self._first = np.searchsorted(tail[order], np.arange(self.origin + 1))

    def weighted(self, problem: GraphProblem) -> csr_array:
        """The steps and what they cost; those of the start's own velocity are the last row."""
        own = np.array([problem.start])
        velocity = problem.velocity[: self._velocity.shape[-1]][None]
        _, heads, terms = self._steps(own, None, velocity)
        weights = problem.weights
        cost = np.array([weights.safety, weights.time, weights.energy])
        return csr_array(
            (
                np.concatenate([self._terms @ cost, terms @ cost]),
                np.concatenate([self._heads, heads]),
                np.append(self._first, len(self._heads) + len(heads)),
            ),
            shape=(self.origin + 1,) * 2,
        )

    def goals(self, goal: Goal) -> IntArray:
        """The states in which a path may end."""
        headings = len(self._graph.offset)
        first = 0 if goal.ends_at_rest else 1
        last = 1 if goal.ends_at_rest else headings
        return (goal.cells[:, None] * headings + np.arange(first, last)).reshape(-1)

    def _steps(
        self, cells: IntArray, heading: int | None, velocity: FloatArray
    ) -> tuple[IntArray, IntArray, FloatArray]:
        """All steps from cells at velocities: which cell's, the state after, (SC d, TC, EC)."""
        graph = self._graph
        headings = len(graph.offset)
        whose, heads, terms = [], [], []
        for action in range(headings):
            if action == heading == STOP:
                continue
            bit = (graph.allowed[cells] >> np.uint32(action)) & 1
            at = np.flatnonzero(bit) if action != STOP else np.arange(len(cells))
            there = cells[at] + graph.offset[action]
            change = self._velocity[there, action] - velocity[at]
            time = graph.length_m[action] / graph.speed[there, action] if action != STOP else 0.0
            whose.append(at)
            heads.append(there * headings + action)
            terms.append(
                np.column_stack(
                    [
                        graph.safety[there] * graph.length_m[action],
                        np.broadcast_to(time, at.shape),
                        np.hypot(*change.T) / (2.0 * graph.v_max_mps),
                    ]
                )
            )
        return np.concatenate(whose), np.concatenate(heads), np.concatenate(terms)


def scipy_dijkstra(
    steps: csr_array, origin: int, goals: IntArray, limit: float = math.inf
) -> float:
    """J by SciPy's compiled Dijkstra, which has no goal and ends at a limit of cost."""
    return float(dijkstra(steps, indices=origin, limit=limit)[goals].min())


def networkx_graph(steps: csr_array, goals: IntArray) -> nx.DiGraph:
    """The steps in NetworkX, with one state behind all the goals: the number of states."""
    graph = nx.from_scipy_sparse_array(steps, create_using=nx.DiGraph)
    graph.add_weighted_edges_from((goal, steps.shape[0], 0.0) for goal in goals.tolist())
    return graph


def networkx_a_star(graph: nx.DiGraph, problem: GraphProblem, origin: int) -> float:
    """J by NetworkX's A* with Eq. 8."""
    steps, goal = problem.graph, problem.goal
    headings = len(steps.offset)
    target = steps.place[goal.cells[0]]
    k_time, k_energy = problem.weights.time, problem.weights.energy

    def guess(state: int, _: int) -> float:
        if not goal.ends_at_rest or state >= origin:
            return 0.0
        cell, heading = divmod(state, headings)
        dx, dz, _ = abs(steps.place[cell] - target)
        octile = max(dx, dz) + (2.0**0.5 - 1.0) * min(dx, dz)
        ahead = k_time * octile * steps.length_m[1] + 0.5 * k_energy * steps.speed[cell, heading]
        return float(ahead / steps.v_max_mps)

    return float(nx.astar_path_length(graph, origin, origin + 1, guess))


def image_costs(planner: Planner, weights: Weights) -> FloatArray:
    """Part of J without direction, per metre in each cell: k_S SC + k_T / v_sat; occupied: inf."""
    maps = planner.maps
    costs = weights.safety * maps.safety_cost + weights.time / maps.speed_limit_mps
    return np.where(maps.occupied, np.inf, costs)


def image_path(costs: FloatArray, problem: GraphProblem) -> IntArray:
    """The cells, (n, 2), of scikit-image's least path; it cuts corners."""
    grid = problem.graph.grid
    search = MCP_Geometric(costs, sampling=(grid.resolution_m,) * 2)
    start = grid.unflat(np.array([problem.start]))
    reached, _ = search.find_costs(start, grid.unflat(problem.goal.cells), find_all_ends=False)
    ends = grid.unflat(problem.goal.cells)
    return np.array(search.traceback(min(ends.tolist(), key=lambda cell: reached[tuple(cell)])))


def graph_cost(problem: GraphProblem, cells: IntArray) -> float:
    """J of a path through neighbouring cells, (n, 2), on the graph."""
    graph = problem.graph
    heading_of = {tuple(step): heading for heading, step in enumerate(graph.moves.steps.tolist())}
    headings = [heading_of[tuple(step)] for step in np.diff(cells, axis=0).tolist()]
    headings += [STOP] * problem.goal.ends_at_rest
    _, cost = walked(graph, problem.start, problem.velocity, np.array(headings), problem.weights)
    return cost.total

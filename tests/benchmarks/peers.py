"""The planner and its peers on the same problems: `python -m tests.benchmarks.peers`.

Needs the extra `peers`. A table on stdout, and a picture `peers.png` in the folder of `--out`: J
against processor time, both axes logarithmic. Each problem has another start, velocity and
weights; with 60 problems or more the extremes of the weights are among them.

Peers that search the planner's graph must find its J: a difference above 1e-9 ends the run. OMPL's
J is that of a continuous path. It is compared with J of our refined path and of the polyline
through the centres of our cells, evaluated alike. OMPL's path and the refined path may end
anywhere in a goal cell; the polyline continues to the centre. Each planner of OMPL is called in
two forms (`peers_ompl`). The table and the picture have the form with the better result at a
hundred times our cold time. The result of the other form is printed below the table.
"""

from __future__ import annotations

import argparse
import itertools
import math
import os
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from moar_companion import Mission, Plan, Planner, Site, Vehicle
from moar_companion.planner.refinement import ContinuousCost
from moar_companion.settings.config import shipped_configs

from . import peers_graph, peers_ompl
from .peers_graph import GraphProblem, StateGraph
from .peers_ompl import Milestone, PlaneProblem
from .plans import EXTREMES, VEHICLE, Call, goal_of, problems, sites

PROBLEMS = 60
OMPL_EVERY = 6
"""OMPL is given every sixth problem and the extremes: it takes a thousand times as long."""
REPEATS = 3
NETWORKX_PROBLEMS = 2
"""Number of problems of each mission: building its graph takes seconds."""
TIMES = (10, 100, 1000)
LONGEST_S = 1.0
"""A run of OMPL that has not asked for as many costs as ours by then is cut short."""
NEAR = 1e-9
COLD, TABLES, REFINED = "ours, cold", "ours, with tables", "ours, cold and refined"
TEXTBOOK = "A* with Eq. 8, compiled"
SCIPY, LIMITED = "SciPy Dijkstra", "SciPy Dijkstra, up to J"
NETWORKX, IMAGE = "NetworkX A*", "scikit-image MCP"
REFINED_TIMES = 100
SAME_COSTS, AS_REFINED = "as many costs", f"{REFINED_TIMES} x refined"
JUDGED = f"{TIMES[1]} x cold"
"""Time at which both planners of OMPL are compared."""
MARKERS = {
    "with tables": "*",
    "cold and refined": "P",
    AS_REFINED: "X",
    f"{TIMES[0]} x cold": "v",
    JUDGED: "s",
    f"{TIMES[2]} x cold": "^",
    SAME_COSTS: "D",
}
WORST = 10.0
"""The greatest ratio that is drawn."""
COLUMNS = (
    "method",
    "problems",
    "processor ms, median / p99",
    "wall ms",
    "built before, ms",
    "times cold",
    "times with tables",
    "J by ours, median / p90",
    "ours lower",
    "equal",
    "J by refined",
    "refined lower",
    "equal",
)

_Answer = TypeVar("_Answer")


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """Result of one method on one problem, and the least times of its calls.

    building_ms: what was made for the problem before; what serves all problems of a site is not.
    graph_cost, path_cost: J on the graph, and of the continuous path; None where a method has no
    such answer, infinite where it found no path.
    cut: it was ended before its time.
    """

    method: str
    processor_ms: float
    wall_ms: float
    building_ms: float = 0.0
    graph_cost: float | None = None
    path_cost: float | None = None
    cut: bool = False


def measure(site: Site, vehicle: Vehicle, count: int) -> Iterator[dict[str, Result]]:
    """Results of all methods on each problem of one site, by method."""
    planner = Planner(site, vehicle)
    states = StateGraph(planner.graph)
    cost = ContinuousCost.on(planner.maps, vehicle.speed)
    for mission in Mission:
        calls = problems(planner, mission, count)
        plans = [planner.plan(**call) for call in calls]
        cold = [_ours(COLD, planner, cost, call) for call in calls]
        refined = [_refined(planner, call) for call in calls]
        planner.prepare(mission=mission, target=goal_of(planner, mission))
        for index, (call, plan, ours, bent) in enumerate(
            zip(calls, plans, cold, refined, strict=True)
        ):
            problem = GraphProblem.of(planner, plan)
            if problem.start in problem.goal.cells:
                continue
            same = [_ours(TABLES, planner, cost, call), _textbook(problem)]
            same += _on_state_graph(
                states, problem, ours.graph_cost, slow=index < NETWORKX_PROBLEMS
            )
            for result in same:
                if abs(result.graph_cost - ours.graph_cost) > NEAR * max(1.0, ours.graph_cost):
                    sys.exit(f"{result.method}: J = {result.graph_cost}, not {ours.graph_cost}")
            results = [ours, bent, *same, _image(planner, problem)]
            if index % OMPL_EVERY == 0 or plan.weights in EXTREMES:
                results += _in_the_plane(
                    planner, cost, plan, problem, ours.processor_ms, bent.processor_ms
                )
            yield {result.method: result for result in results}


def _ours(method: str, planner: Planner, cost: ContinuousCost, call: Call) -> Result:
    plan, result = _timed(method, lambda: planner.plan(**call))
    return replace(
        result,
        graph_cost=plan.cost.total,
        path_cost=cost.of_path(
            peers_graph.centres_m(plan),
            plan.request.velocity_mps,
            plan.weights,
            ends_at_rest=plan.mission is Mission.INSPECTION,
        ).total,
    )


def _refined(planner: Planner, call: Call) -> Result:
    found, result = _timed(REFINED, lambda: planner.refine(planner.plan(**call)))
    return replace(result, path_cost=found.cost.total)


def _textbook(problem: GraphProblem) -> Result:
    found, result = _timed(TEXTBOOK, lambda: peers_graph.textbook(problem))
    return replace(result, graph_cost=found)


def _on_state_graph(
    states: StateGraph, problem: GraphProblem, cost: float, *, slow: bool
) -> Iterator[Result]:
    """SciPy's without and with J as its limit: no early exit is earlier; NetworkX's if slow."""
    goals = states.goals(problem.goal)
    steps, built = _timed(SCIPY, lambda: states.weighted(problem), 1)
    found, result = _timed(SCIPY, lambda: peers_graph.scipy_dijkstra(steps, states.origin, goals))
    yield replace(result, building_ms=built.processor_ms, graph_cost=found)
    limit = cost + NEAR * max(1.0, cost)
    found, result = _timed(
        LIMITED, lambda: peers_graph.scipy_dijkstra(steps, states.origin, goals, limit)
    )
    yield replace(result, building_ms=built.processor_ms, graph_cost=found)
    if slow:
        graph, built = _timed(NETWORKX, lambda: peers_graph.networkx_graph(steps, goals), 1)
        found, result = _timed(
            NETWORKX, lambda: peers_graph.networkx_a_star(graph, problem, states.origin), 1
        )
        yield replace(result, building_ms=built.processor_ms, graph_cost=found)


def _image(planner: Planner, problem: GraphProblem) -> Result:
    costs, built = _timed(IMAGE, lambda: peers_graph.image_costs(planner, problem.weights))
    cells, result = _timed(IMAGE, lambda: peers_graph.image_path(costs, problem))
    return replace(
        result,
        building_ms=built.processor_ms,
        graph_cost=peers_graph.graph_cost(problem, cells),
    )


def _in_the_plane(
    planner: Planner,
    cost: ContinuousCost,
    plan: Plan,
    problem: GraphProblem,
    cold_ms: float,
    refined_ms: float,
) -> Iterator[Result]:
    """OMPL's, at multiples of our times and after as many costs as our search asks at most."""
    plane = PlaneProblem(
        planner=planner,
        cost=cost,
        start_m=tuple(peers_graph.centres_m(plan)[0].tolist()),
        velocity_mps=plan.request.velocity_mps,
        goal_cells=frozenset(map(tuple, planner.graph.grid.unflat(problem.goal.cells).tolist())),
        ends_at_rest=problem.goal.ends_at_rest,
        weights=plan.weights,
    )
    moves = len(planner.graph.offset) - 1
    milestones = [Milestone(name=f"{n} x cold", time_s=1e-3 * n * cold_ms) for n in TIMES]
    milestones.append(Milestone(name=AS_REFINED, time_s=1e-3 * REFINED_TIMES * refined_ms))
    evaluations = plan.compute.expanded * moves**2
    milestones.append(Milestone(name=SAME_COSTS, time_s=LONGEST_S, evaluations=evaluations))
    for kind, dimensions in itertools.product(peers_ompl.KINDS, peers_ompl.DIMENSIONS):
        for reached in peers_ompl.run(kind, dimensions, plane, milestones):
            yield Result(
                method=f"{kind} {dimensions}-D, {reached.name}",
                processor_ms=1e3 * reached.processor_s,
                wall_ms=1e3 * reached.wall_s,
                path_cost=reached.cost,
                cut=reached.cut,
            )


def _timed(
    method: str, work: Callable[[], _Answer], repeats: int = REPEATS
) -> tuple[_Answer, Result]:
    """Answer of a call, and the least times of its repeats."""
    processor_ms, wall_ms = [], []
    for _ in range(repeats):
        began, began_wall = time.thread_time(), time.perf_counter()
        answer = work()
        processor_ms.append(1e3 * (time.thread_time() - began))
        wall_ms.append(1e3 * (time.perf_counter() - began_wall))
    return answer, Result(method=method, processor_ms=min(processor_ms), wall_ms=min(wall_ms))


def worse_ways(cases: list[dict[str, Result]]) -> list[str]:
    """The less favourable of the two forms of calling each of OMPL's planners."""
    return [
        max(
            (f"{kind} {dimensions}-D" for dimensions in peers_ompl.DIMENSIONS),
            key=lambda way: _middle_and_most(ratios(cases, f"{way}, {JUDGED}")),
        )
        for kind in peers_ompl.KINDS
    ]


def without(cases: list[dict[str, Result]], ways: list[str]) -> list[dict[str, Result]]:
    """All results except those of some forms."""
    return [
        {
            method: result
            for method, result in case.items()
            if method.rpartition(", ")[0] not in ways
        }
        for case in cases
    ]


def ratios(cases: list[dict[str, Result]], method: str, ours: str = COLD) -> np.ndarray:
    """J of a method by ours, problem by problem, on the graph or else in the plane.

    1 where they are equal; infinite without a path, or where ours alone vanishes.
    """
    found = []
    for case in cases:
        if method not in case:
            continue
        theirs, own = case[method], case[ours]
        cost, best = (
            (theirs.path_cost, own.path_cost)
            if None in (theirs.graph_cost, own.graph_cost)
            else (theirs.graph_cost, own.graph_cost)
        )
        if cost is None:
            continue  # a cost on the graph gives no cost in the plane
        equal = abs(cost - best) <= NEAR * max(1.0, best)
        found.append(1.0 if equal else cost / best if best > 0.0 else math.inf)
    return np.array(found)


def _compared(cases: list[dict[str, Result]], method: str, ours: str) -> str:
    """J of a method by ours, and in how many problems ours is lower or equal, as cells of a row."""
    cost = ratios(cases, method, ours)
    if not len(cost):
        return "| | | "
    return f"| {_spread(cost)} | {_share(cost > 1.0)} | {_share(cost == 1.0)} "


def table(cases: list[dict[str, Result]]) -> Iterator[str]:
    """The rows of one size, Markdown."""
    yield f"| {' | '.join(COLUMNS)} |"
    yield "|---" * len(COLUMNS) + "|"
    for method in dict.fromkeys(itertools.chain.from_iterable(cases)):
        having = [case for case in cases if method in case]
        processor, wall, building = (
            np.array([getattr(case[method], name) for case in having])
            for name in ("processor_ms", "wall_ms", "building_ms")
        )
        by = [
            np.median([case[method].processor_ms / case[ours].processor_ms for case in having])
            for ours in (COLD, TABLES)
        ]
        cut = sum(case[method].cut for case in having)
        yield (
            f"| {method} | {len(having)}{f', {cut} cut' if cut else ''} | "
            f"{_figure(np.median(processor))} / {_figure(np.quantile(processor, 0.99))} | "
            f"{_figure(np.median(wall))} | {_figure(np.median(building))} | "
            f"{_figure(by[0])} | {_figure(by[1])} "
            f"{_compared(having, method, COLD)}{_compared(having, method, REFINED)}|"
        )


def _middle_and_most(cost: np.ndarray) -> tuple[float, float]:
    middle, most = np.quantile(cost, [0.5, 0.9], method="higher").tolist()
    return middle, most


def _spread(cost: np.ndarray) -> str:
    return " / ".join(
        f"{value:.3f}" if value < math.inf else "no path" for value in _middle_and_most(cost)
    )


def _figure(value: float) -> str:
    return f"{value:.3g}" if value < 100.0 else f"{value:.0f}"


def _share(which: np.ndarray) -> str:
    return f"{100.0 * which.mean():.0f} %"


def draw(found: dict[str, list[dict[str, Result]]], path: Path) -> None:
    """J against processor time: all problems, medians, and up to where nine of ten are.

    A panel for each size; what is looked at several times is joined by a line.
    """
    figure = Figure(figsize=(13.0, 6.0), layout="constrained")
    panels = figure.subplots(1, len(found), sharey=True)
    colours: dict[str, Any] = {}
    for axes, (size, cases) in zip(panels, found.items(), strict=True):
        lines: dict[str, list[tuple[float, float]]] = {}
        for method in dict.fromkeys(itertools.chain.from_iterable(cases)):
            name, _, moment = method.rpartition(", ")
            name, marker = (name, MARKERS[moment]) if moment in MARKERS else (method, "o")
            colour = colours.setdefault(name, mpl.colormaps["tab20"](2 * len(colours) % 19))
            times_ms = [case[method].processor_ms for case in cases if method in case]
            cost = np.clip(ratios(cases, method), None, WORST)
            middle, most = _middle_and_most(cost)
            at_ms = float(np.median(times_ms))
            lines.setdefault(name, []).append((at_ms, middle))
            axes.scatter(times_ms, cost, s=7, color=colour, alpha=0.4, linewidths=0)
            axes.plot([at_ms, at_ms], [middle, most], color=colour, linewidth=1.0)
            axes.scatter(
                at_ms, middle, s=60, color=colour, marker=marker, edgecolors="black", zorder=3
            )
        for name, line in lines.items():
            axes.plot(*zip(*line, strict=True), color=colours[name], linewidth=1.0)
        axes.set(xscale="log", yscale="log", ylim=(0.7, 1.1 * WORST), title=size)
        axes.set_xlabel("processor time (ms)")
        axes.set_yticks([0.7, 1.0, 2.0, 5.0, WORST], ["0.7", "1", "2", "5", f"{WORST:g}\nor none"])
        axes.axhline(1.0, color="black", linewidth=0.6)
        axes.grid(alpha=0.3)
    panels[0].set_ylabel("J, relative to ours")
    shape = {"color": "none", "markeredgecolor": "black"}
    figure.legend(
        [
            *(Line2D([], [], marker="o", linewidth=1.0, color=each) for each in colours.values()),
            *(Line2D([], [], marker=marker, **shape) for marker in MARKERS.values()),
        ],
        [*colours, *MARKERS],
        loc="outside lower center",
        ncols=6,
        fontsize=8,
    )
    figure.savefig(path, dpi=100)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split(":")[0])
    parser.add_argument("--problems", type=int, default=PROBLEMS, help="of each mission and size")
    parser.add_argument("--out", type=Path, default=Path(), help="folder of peers.png")
    options = parser.parse_args()
    vehicle = Vehicle.load(shipped_configs() / "vehicles" / VEHICLE)
    sys.stdout.write(f"load average {os.getloadavg()[0]:.2f}, {os.cpu_count()} cores\n")
    found = {}
    for size, site in sites().items():
        cases = list(measure(site, vehicle, options.problems))
        worse = worse_ways(cases)
        found[size] = without(cases, worse)
        sys.stdout.write(f"\n{size}, {len(cases)} problems\n\n")
        sys.stdout.write("\n".join(table(found[size])) + "\n\n")
        for way in worse:
            cost = _spread(ratios(cases, f"{way}, {JUDGED}"))
            sys.stdout.write(f"- {way}, {JUDGED}: J by ours {cost}\n")
        sys.stdout.flush()
    options.out.mkdir(parents=True, exist_ok=True)
    draw(found, options.out / "peers.png")


if __name__ == "__main__":
    main()

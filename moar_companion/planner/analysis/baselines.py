"""The paper's three planners to compare with (Section V-A): shortest, Voronoi and envelope.

Inputs: a planner, for its grid, moves and goals, and a request. Output: a `Baseline`, with metrics
from the same code as a plan's. What the paper leaves open is defined beside each of them. Baselines
ignore weights and speeds: they compare path lengths.
"""

from __future__ import annotations

import enum
from dataclasses import dataclass

import numpy as np
import scipy  # its parts are loaded at their first use

from ..geometry import obstacle_distance_m
from ..graph import Graph
from ..grid import STOP, TOLERANCE, BoolArray, FloatArray, IntArray
from ..maps import Maps, too_low
from ..plan_values import Metrics, PlanRequest, PlanStatus, Waypoints, trajectory
from ..planner import Planner
from ..regions import LandingLeg, goal_region, landing_leg
from ..site import Site

_TIE = 1e-6
"""Cost per metre of roadmap, to choose among connectors of equal length."""
_CLEARANCE_TIE = 1e-7
"""Relative change of a length, to choose among the shortest paths: less than by which lengths of a
few hundred moves differ."""
_PAD = np.zeros(1, dtype=np.int64)
"""The first cell of the padding, which no step of the grid leads to or from."""


class BaselineKind(str, enum.Enum):
    """The naive approaches of the paper, by its names."""

    SHORTEST = "shortest"
    VORONOI = "voronoi"
    ENVELOPE = "envelope"


@dataclass(frozen=True, kw_only=True, eq=False)
class Baseline:
    """A baseline's answer. states: (n, 3) of cell indices and heading, empty unless found.

    The status is `unreachable` too where there is no roadmap: no Voronoi diagram or envelope that
    both start and goal can be joined to.
    """

    kind: BaselineKind
    status: PlanStatus
    states: IntArray
    waypoints: Waypoints | None = None
    metrics: Metrics | None = None
    landing_leg: LandingLeg | None = None


def baseline(
    planner: Planner, kind: BaselineKind, request: PlanRequest, *, clearest: bool = True
) -> Baseline:
    """The answer of one of the paper's baselines to a planning problem.

    clearest: of the shortest paths, the one with the greatest clearance along its length; False:
    with the least.

    Raises InputError as `Planner.plan` does.
    """
    plan = planner.solve(request)
    graph, maps = planner.graph, planner.maps
    if plan.status is not PlanStatus.FOUND:
        return Baseline(kind=kind, status=plan.status, states=plan.states)
    region = None
    goals = [tuple(plan.states[-1, :-1])]
    if not request.mission.visits_targets:
        region = goal_region(
            planner.site, planner.vehicle, maps, request.mission, plan.request.target
        )
        goals = [*region.corners]
    start = graph.grid.flat(tuple(plan.states[0, :-1]))
    goal = np.array([graph.grid.flat(cell) for cell in goals])
    if kind is BaselineKind.SHORTEST:
        path = _shortest(_steps(graph, ~maps.occupied, _longer(maps, clearest)), start, goal)
    else:
        roadmap = (
            voronoi_cells(planner.site, maps)
            if kind is BaselineKind.VORONOI
            else envelope_cells(planner.site, maps, planner.vehicle.safety.d_max_m)
        )
        path = _along(graph, ~maps.occupied, roadmap, start, goal)
    if path is None:
        nothing = np.empty((0, plan.states.shape[1]), dtype=np.int64)
        return Baseline(kind=kind, status=PlanStatus.UNREACHABLE, states=nothing)
    # As in a plan, an inspection of a single state starts at rest in its target's cell.
    stops = region is None and (len(path) > 1 or any(request.velocity_mps))
    states = _states(graph, path, stops=stops)
    leg = None
    if region is not None:
        end = (int(states[-1, 0]), int(states[-1, 1]))
        leg = landing_leg(planner.site, planner.vehicle, region, end)
    waypoints, metrics = trajectory(graph, maps, states, request.velocity_mps, leg)
    return Baseline(
        kind=kind,
        status=PlanStatus.FOUND,
        states=states,
        waypoints=waypoints,
        metrics=metrics,
        landing_leg=leg,
    )


def voronoi_cells(site: Site, maps: Maps) -> BoolArray:
    """Free cells with two nearest obstacles equally far, within a cell's size, (nx, nz).

    Every obstacle is one site, the border of the workspace is another.
    """
    grid = maps.grid
    x_m, z_m = grid.axes_m
    centres = np.stack(np.meshgrid(x_m, z_m, indexing="ij"), axis=-1)
    border = np.minimum(centres - np.array(grid.lower_m), np.array(grid.upper_m) - centres)
    distances = np.stack(
        [border.min(axis=-1), *(obstacle_distance_m(item, centres) for item in site.obstacles)]
    )
    if len(distances) == 1:
        return np.zeros(grid.shape, dtype=bool)
    nearest, second = np.sort(distances, axis=0)[:2]
    equally_far: BoolArray = second - nearest <= grid.resolution_m + TOLERANCE
    return equally_far & ~maps.occupied


def envelope_cells(site: Site, maps: Maps, d_max_m: float) -> BoolArray:
    """Free cells on the inner side of the envelope's boundary, (nx, nz).

    The envelope is the obstacles' convex hull grown by d_max and clipped to the rows that may be
    flown: where it reaches the border of the workspace, the border is its boundary.
    """
    within = (maps.hull_distance_m <= d_max_m + TOLERANCE) & ~too_low(site, maps.grid)
    padded = np.pad(within, 1)
    surrounded = padded[:-2, 1:-1] & padded[2:, 1:-1] & padded[1:-1, :-2] & padded[1:-1, 2:]
    return within & ~surrounded & ~maps.occupied


def _longer(maps: Maps, clearest: bool) -> FloatArray:
    """Relative additions to the lengths of moves by their arrival cell, (nx, nz)."""
    clearance = maps.obstacle_distance_m
    greatest = clearance.max()
    # Without obstacles every clearance is infinite.
    share = clearance / greatest if 0.0 < greatest < np.inf else np.zeros_like(clearance)
    return _CLEARANCE_TIE * (1.0 - share if clearest else share)


def _steps(
    graph: Graph, usable: BoolArray, longer: FloatArray | None = None
) -> scipy.sparse.csr_array[np.float64]:
    """The lengths of all legal moves between usable cells, over padded flat indices.

    longer: relative additions by arrival cell, (nx, nz).
    """
    factor = None if longer is None else 1.0 + np.asarray(graph.grid.padded(longer, 0.0))
    inside = np.asarray(graph.grid.padded(usable, 0), dtype=bool)
    rows, columns, lengths = [], [], []
    for heading in range(1, len(graph.offset)):
        leaves = inside & ((graph.allowed >> np.uint32(heading)) & np.uint32(1)).astype(bool)
        cells = np.flatnonzero(leaves)
        cells = cells[inside[cells + graph.offset[heading]]]
        rows.append(cells)
        columns.append(cells + graph.offset[heading])
        length = np.full(len(cells), graph.length_m[heading])
        lengths.append(length if factor is None else length * factor[columns[-1]])
    entries = (np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns)))
    return scipy.sparse.coo_array(entries, shape=(len(inside), len(inside))).tocsr()


def _shortest(
    steps: scipy.sparse.csr_array[np.float64], start: int, goals: IntArray
) -> list[int] | None:
    """The shortest path of cells from a start to the nearest goal; None if there is none."""
    length, before = _search(steps, np.array([start]))
    goal = int(goals[np.argmin(length[goals])])
    return _chain(before, goal)[::-1] if np.isfinite(length[goal]) else None


def _along(
    graph: Graph, free: BoolArray, roadmap: BoolArray, start: int, goals: IntArray
) -> list[int] | None:
    """A path on a roadmap, joined to start and goals, each by its own shortest connector.

    The roadmap may be in pieces: the one with the shortest connectors to start and nearest goal is
    used. The goal is the one with the shortest path on the roadmap and over its connector.
    """
    anywhere, on_roadmap = _steps(graph, free), _steps(graph, roadmap)
    from_start, before = _search(anywhere, np.array([start]))
    to_goal, _ = _search(anywhere, goals)
    _, piece = scipy.sparse.csgraph.connected_components(on_roadmap, directed=False)
    cells = np.flatnonzero(np.asarray(graph.grid.padded(roadmap, 0)))
    both = _least_by_piece(from_start, piece, cells) + _least_by_piece(to_goal, piece, cells)
    if not np.isfinite(both).any():
        return None
    members = cells[piece[cells] == piece[cells[np.argmin(both)]]]
    nearest = from_start[members] <= from_start[members].min() + TOLERANCE
    length, previous = _search(on_roadmap, members[nearest])
    # Cell 0 is padding. From it a step leads to every cell of the roadmap. Steps to cells farther
    # along the roadmap are longer, by so little that they only choose among equal connectors.
    onto = (_TIE * (1.0 + length[members]), (np.zeros_like(members), members))
    connector, onwards = _search(
        (anywhere + scipy.sparse.coo_array(onto, shape=anywhere.shape)).tocsr(), _PAD
    )
    joined = goals[np.isfinite(connector[goals])]
    connectors = [_chain(onwards, int(goal))[-2::-1] for goal in joined]
    total = connector[joined] + [length[cells[0]] for cells in connectors]
    last = connectors[int(np.argmin(total))]
    middle = _chain(previous, last[0])[::-1]
    path = [*_chain(before, middle[0])[::-1], *middle[1:], *last[1:]]
    # A connector may pass a goal on its way to the roadmap: the path ends there.
    arrived = np.flatnonzero(np.isin(path, goals))
    return path[: int(arrived[0]) + 1]


def _search(
    steps: scipy.sparse.csr_array[np.float64], sources: IntArray
) -> tuple[FloatArray, IntArray]:
    """For every cell the length from the nearest source, and the cell before it on the path."""
    length, previous, _ = scipy.sparse.csgraph.dijkstra(
        steps, indices=sources, return_predecessors=True, min_only=True
    )
    return length, previous


def _least_by_piece(length_m: FloatArray, piece: IntArray, cells: IntArray) -> FloatArray:
    """For every cell, the least length of all cells of its piece."""
    least = np.full(piece.max() + 1, np.inf)
    np.minimum.at(least, piece[cells], length_m[cells])
    return np.asarray(least[piece[cells]])


def _chain(previous: IntArray, cell: int) -> list[int]:
    """The cells from one back to the source of a Dijkstra search."""
    cells = [cell]
    while previous[cells[-1]] >= 0:
        cells.append(int(previous[cells[-1]]))
    return cells


def _states(graph: Graph, path: list[int], *, stops: bool) -> IntArray:
    """The states (n, 3) of a path of flat cells, with a stop at its end where it stops."""
    flat = np.array(path)
    heading_of = {int(offset): heading for heading, offset in enumerate(graph.offset)}
    headings = [STOP, *(heading_of[int(offset)] for offset in np.diff(flat))]
    if stops:
        flat = np.append(flat, flat[-1])
        headings.append(STOP)
    return np.column_stack([graph.grid.unflat(flat), np.array(headings, dtype=np.int64)])

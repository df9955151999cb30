"""The paper's baselines: path lengths against a plain search, and what their paths keep to."""

from __future__ import annotations

import heapq
import math
import random
from itertools import pairwise

import numpy as np
import pytest
from shapely.geometry import Point

from moar_companion.errors import InputError
from moar_companion.planner.analysis.baselines import (
    BaselineKind,
    baseline,
    envelope_cells,
    voronoi_cells,
)
from moar_companion.planner.plan_values import PlanRequest, PlanStatus
from moar_companion.planner.planner import Planner
from moar_companion.types import Mission, RiskIndices, Weights

from . import oracle
from .problems import conductor, make_site, make_vehicle, polygon, random_problem


def request(planner, mission=Mission.INSPECTION, target=None, start=None, velocity=(0.0, 0.0)):
    return PlanRequest(
        mission=mission,
        target=target,
        start_m=planner.site.start_m if start is None else start,
        velocity_mps=velocity,
        weights=Weights(0.0, 1.0, 0.0),
        risk=RiskIndices(),
    )


def random_answers(name, kind, count):
    """Found baselines of random problems, each with its problem, planner and oracle maps."""
    rng = random.Random(name)
    while count:
        problem = random_problem(rng)
        planner = Planner(problem.site, problem.vehicle)
        asked = request(
            planner, problem.mission, problem.target, problem.start_m, problem.velocity_mps
        )
        try:
            answer = baseline(planner, kind, asked)
        except InputError:
            continue
        if answer.status is PlanStatus.FOUND:
            count -= 1
            yield problem, planner, answer


def shortest_lengths(maps, resolution_m, starts, usable):
    """A plain Dijkstra on length from any of some cells, over usable cells."""
    known = dict.fromkeys(starts, 0.0)
    queue = [(0.0, cell) for cell in starts]
    heapq.heapify(queue)
    while queue:
        length, cell = heapq.heappop(queue)
        if length > known[cell]:
            continue
        for heading, there in oracle.moves_from(maps, cell):
            longer = length + math.hypot(*oracle.DIRECTIONS[heading]) * resolution_m
            if usable(there) and longer < known.get(there, math.inf) - 1e-12:
                known[there] = longer
                heapq.heappush(queue, (longer, there))
    return known


def grid_length(problem, states):
    """The length of a path of states, landing leg left out."""
    steps = (math.hypot(*oracle.DIRECTIONS[heading]) for heading in states[1:, 2])
    return math.fsum(steps) * problem.site.workspace.resolution_m


@pytest.mark.uncounted
@pytest.mark.parametrize(
    "kind",
    [
        pytest.param(kind, marks=() if kind is BaselineKind.SHORTEST else pytest.mark.slow)
        for kind in BaselineKind
    ],
)
def test_every_path_is_legal_and_ends_as_a_plan_does(kind):
    for problem, _, answer in random_answers(f"legal {kind.value}", kind, 40):
        maps = oracle.build_maps(problem.site, problem.vehicle)
        oracle.cost_terms(problem, maps, answer.states)
        assert oracle.ends_as_it_must(problem, oracle.goal_of(problem, maps), answer.states)


@pytest.mark.uncounted
def test_the_shortest_path_is_as_long_as_that_of_a_plain_dijkstra():
    for problem, _, answer in random_answers("shortest", BaselineKind.SHORTEST, 60):
        maps = oracle.build_maps(problem.site, problem.vehicle)
        start = tuple(answer.states[0, :2].tolist())
        lengths = shortest_lengths(
            maps, problem.site.workspace.resolution_m, [start], lambda _: True
        )
        goal = oracle.goal_of(problem, maps)
        best = min(lengths.get(cell, math.inf) for cell in goal)
        assert grid_length(problem, answer.states) == pytest.approx(best)


def equidistant(problem, cell):
    """True if the two nearest of obstacles and border are equally far, but for a cell's size."""
    space = problem.site.workspace
    x, z = oracle.centre_of(space, cell)
    columns, rows = oracle.shape_of(space)
    r = space.resolution_m
    borders = [
        x - space.lower_m[0],
        space.lower_m[0] + columns * r - x,
        z - space.lower_m[1],
        space.lower_m[1] + rows * r - z,
    ]
    distances = sorted(
        [min(borders), *(oracle.clearance(item, Point(x, z)) for item in problem.site.obstacles)]
    )
    return len(distances) > 1 and distances[1] - distances[0] <= r + 1e-9


def on_envelope(problem, maps, cell):
    """True if a cell is within the grown hull, and one of its neighbours is not, or not flown."""
    limit = problem.vehicle.safety.d_max_m + 1e-9
    low = problem.site.workspace.min_altitude_m

    def within(other):
        if other not in maps.d_ch or maps.d_ch[other] > limit:
            return False
        return low is None or oracle.centre_of(problem.site.workspace, other)[1] >= low - 1e-9

    x, z = cell
    around = [(x - 1, z), (x + 1, z), (x, z - 1), (x, z + 1)]
    return within(cell) and not all(within(other) for other in around)


def check_roadmap(problem, maps, answer, mask):
    """The path is connector, roadmap, connector; each connector is the shortest of its end."""
    roadmap = {cell for cell in maps.occupied if mask[cell]}
    cells = [tuple(state[:2]) for state in answer.states.tolist()]
    goal = oracle.goal_of(problem, maps)
    resolution = problem.site.workspace.resolution_m

    def lengths(starts, usable=lambda _: True):
        return shortest_lengths(maps, resolution, starts, usable)

    def least(known, piece):
        return min(known.get(cell, math.inf) for cell in piece)

    join = lengths(cells[:1])
    leave, leave_here = lengths(goal & set(join)), lengths(cells[-1:])
    pieces = []
    unseen = set(roadmap)
    while unseen:
        pieces.append(set(lengths([unseen.pop()], roadmap.__contains__)))
        unseen -= pieces[-1]
    both = min(least(join, piece) + least(leave, piece) for piece in pieces)
    used = [
        piece
        for piece in pieces
        if least(join, piece) + least(leave, piece) == pytest.approx(both, abs=1e-9)
    ]
    off = math.fsum(
        math.dist(cell, there) * resolution
        for cell, there in pairwise(cells)
        if not (cell in roadmap and there in roadmap)
    )
    assert off <= max(least(join, piece) + least(leave_here, piece) for piece in used) + 1e-4


@pytest.mark.slow
def test_the_voronoi_path_is_equidistant_but_for_its_connectors():
    for problem, planner, answer in random_answers("voronoi", BaselineKind.VORONOI, 40):
        maps = oracle.build_maps(problem.site, problem.vehicle)
        expected = np.zeros(maps.shape, dtype=bool)
        for cell, occupied in maps.occupied.items():
            expected[cell] = not occupied and equidistant(problem, cell)
        np.testing.assert_array_equal(voronoi_cells(problem.site, planner.maps), expected)
        check_roadmap(problem, maps, answer, expected)


@pytest.mark.slow
def test_the_envelope_path_keeps_to_the_boundary_of_the_grown_hull():
    for problem, planner, answer in random_answers("envelope", BaselineKind.ENVELOPE, 40):
        maps = oracle.build_maps(problem.site, problem.vehicle)
        expected = np.zeros(maps.shape, dtype=bool)
        for cell, occupied in maps.occupied.items():
            expected[cell] = not occupied and on_envelope(problem, maps, cell)
        cells = envelope_cells(problem.site, planner.maps, problem.vehicle.safety.d_max_m)
        np.testing.assert_array_equal(cells, expected)
        check_roadmap(problem, maps, answer, expected)


TWO = (conductor(10.0, 10.0, name="left"), conductor(20.0, 10.0, name="right"))


def answer_of(kind, *obstacles, **site):
    details = {"size": (30.0, 20.0), "resolution": 0.5, "start": (15.2, 2.2)}
    site = make_site(*obstacles, **(details | {"targets": {"t": (15.2, 17.2)}} | site))
    planner = Planner(site, make_vehicle())
    return baseline(planner, kind, request(planner))


def test_between_two_conductors_the_voronoi_path_stays_in_the_middle():
    answer = answer_of(BaselineKind.VORONOI, *TWO)
    between = [state for state in answer.states.tolist() if 18 <= state[1] <= 22]
    assert {state[0] for state in between} <= {29, 30}


def test_the_envelope_path_goes_around_the_conductors_and_the_shortest_between_them():
    around = answer_of(BaselineKind.ENVELOPE, *TWO)
    straight = answer_of(BaselineKind.SHORTEST, *TWO)
    assert straight.metrics.length_m == pytest.approx(15.0)
    assert around.metrics.length_m > straight.metrics.length_m
    # At least one end of the hull is rounded at d_max (3 m), but for a cell.
    x = around.waypoints.position_m[:, 0]
    assert x.max() > 22.0 or x.min() < 8.0
    assert around.metrics.min_clearance_m > 2.4


@pytest.mark.parametrize("kind", [BaselineKind.VORONOI, BaselineKind.ENVELOPE])
def test_without_obstacles_the_status_is_that_there_is_no_roadmap(kind):
    answer = answer_of(kind)
    assert answer.status is PlanStatus.UNREACHABLE
    assert answer.states.shape == (0, 3)
    assert answer.metrics is None


def test_an_envelope_beyond_the_workspace_is_its_border():
    answer = answer_of(
        BaselineKind.ENVELOPE, conductor(5.2, 5.2), size=(10.0, 10.0), resolution=1.0,
        start=(0.5, 0.5), targets={"t": (9.5, 9.5)},
    )  # fmt: skip
    assert answer.status is PlanStatus.FOUND


@pytest.mark.parametrize("kind", list(BaselineKind))
@pytest.mark.parametrize(
    ("start", "target", "status"),
    [
        ((-1.0, 2.0), (15.2, 17.2), PlanStatus.OUT_OF_BOUNDS),
        ((10.0, 10.0), (15.2, 17.2), PlanStatus.START_OCCUPIED),
        ((15.2, 2.2), (10.0, 10.0), PlanStatus.TARGET_OCCUPIED),
    ],
)
def test_a_start_or_target_that_cannot_be_used_is_the_same_status_as_for_a_plan(
    kind, start, target, status
):
    answer = answer_of(kind, *TWO, start=start, targets={"t": target})
    assert answer.status is status
    assert answer.states.shape == (0, 3)


@pytest.mark.parametrize("kind", list(BaselineKind))
def test_a_target_behind_a_wall_is_unreachable(kind):
    wall = polygon((17.0, -1.0), (18.0, -1.0), (18.0, 21.0), (17.0, 21.0))
    answer = answer_of(kind, wall, targets={"t": (25.0, 5.0)})
    assert answer.status is PlanStatus.UNREACHABLE


@pytest.mark.parametrize("kind", list(BaselineKind))
def test_in_the_targets_cell_a_baseline_is_as_long_as_a_plan(kind):
    planner = Planner(make_site(*TWO, targets={"t": (0.7, 0.7)}), make_vehicle())
    for velocity in ((0.0, 0.0), (3.0, 0.0)):
        asked = request(planner, start=(0.5, 0.5), velocity=velocity)
        answer = baseline(planner, kind, asked)
        if answer.status is PlanStatus.FOUND:
            assert answer.states.tolist() == planner.solve(asked).states.tolist()


def test_the_metrics_of_a_baseline_are_those_of_a_plan_with_its_path():
    planner = Planner(
        make_site(conductor(5.0, 7.5), start=(0.5, 0.5), exits=[(20.0, 0.5)]), make_vehicle()
    )
    asked = request(planner, Mission.EXIT)
    answer, plan = baseline(planner, BaselineKind.SHORTEST, asked), planner.solve(asked)
    assert answer.states.tolist() == plan.states.tolist()
    assert answer.metrics == plan.metrics
    assert answer.landing_leg.length_m == plan.landing_leg.length_m


def test_of_equally_short_paths_the_one_with_the_most_clearance_or_the_least_is_found():
    site = make_site(
        conductor(10.2, 8.2), size=(20.0, 20.0), resolution=0.5,
        start=(15.2, 2.2), targets={"t": (5.2, 17.2)},
    )  # fmt: skip
    planner = Planner(site, make_vehicle())
    clear, near = (
        baseline(planner, BaselineKind.SHORTEST, request(planner), clearest=clearest).metrics
        for clearest in (True, False)
    )
    assert clear.length_m == pytest.approx(near.length_m, abs=1e-9)
    assert clear.mean_clearance_m > near.mean_clearance_m + 0.5

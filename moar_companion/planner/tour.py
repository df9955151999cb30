"""The order of visits: the stops of an inspection in the order of least total J, exit included.

Inputs: a planner, the request of the first leg, the stops. Outputs: their order (`best_order`), and
the plans along an order (`leg_plans`). All headings at stops are 0, so that the cost of a leg does
not depend on the legs before it: the order is an open travelling salesman problem with asymmetric
costs. Up to `EXACT_STOPS` stops it is solved exactly (Held and Karp, 1962, "A dynamic programming
approach to sequencing problems"); beyond, by insertion, reversals and moves of parts (2-opt,
Or-opt).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ..errors import InputError
from ..types import Mission
from .adaptation import Adaptation
from .grid import FloatArray, IntArray
from .plan_values import Plan, PlanRequest
from .planner import Planner
from .site import PlanePoint

EXACT_STOPS = 12
"""Most stops of an exact order: 50,000 steps of Held and Karp."""
_MOST_WORK = 10_000_000
"""Most cells times legs that are planned: half a second of a desktop's processor. Where an order
needs more, the cost of a leg is its length."""
_MOST_STARTS = 500
"""Most first stops that are tried, times stops: 200 stops take half a second of a desktop."""
_FAR = 1e9
"""Cost of a leg without a path: it is in no order that has another."""
_LONGEST_PART = 3
"""Stops of a part that is moved."""
_LEAST_GAIN = 1e-9


def best_order(planner: Planner, request: PlanRequest, stops: tuple[str, ...]) -> tuple[str, ...]:
    """The stops in the order of least total J. Those without a path from the start are last.

    request: of the leg to any of them: its start and velocity, its weights for all legs, its risks
    for the exit, whose weights are the vehicle's. A site without an exit ends at the last stop.
    """
    planned = (len(stops) + 1) ** 2 * planner.maps.occupied.size <= _MOST_WORK
    costs = _costs(planner, request, stops) if planned else _lengths(planner, request, stops)
    reached = [index for index in range(len(stops)) if costs[0, 1 + index] < _FAR]
    kept = np.array([0, *(1 + index for index in reached), len(stops) + 1])
    order = [reached[index] for index in least_order(costs[np.ix_(kept, kept)])]
    rest = [index for index in range(len(stops)) if index not in reached]
    return tuple(stops[index] for index in (*order, *rest))


def leg_plans(planner: Planner, request: PlanRequest, stops: tuple[str, ...]) -> tuple[Plan, ...]:
    """The plans of an order: `visit_plans`, and the exit from the last stop.

    Raises InputError for landing points that no cell sees.
    """
    plans, at = visit_plans(planner, request, stops)
    if Mission.EXIT not in planner.site.landing_m:
        return plans
    return (*plans, planner.solve(exit_request(planner, at)))


def visit_plans(
    planner: Planner, request: PlanRequest, stops: tuple[str, ...]
) -> tuple[tuple[Plan, ...], PlanRequest]:
    """The plans of an order, to each stop from the one before, and the request from the last.

    A stop without a path is left out behind its plan, which has the reason.
    """
    plans: list[Plan] = []
    at = request
    for stop in stops:
        plans.append(planner.solve(replace(at, target=stop)))
        if not plans[-1].reason:
            at = _at(request, planner.site.target(stop).position_m)
    return tuple(plans), at


def _at(request: PlanRequest, place_m: PlanePoint) -> PlanRequest:
    """The request from a stop, at rest."""
    return replace(request, start_m=place_m, velocity_mps=(0.0, 0.0))


def exit_request(planner: Planner, request: PlanRequest) -> PlanRequest:
    """The request of the exit from the same start, under the same risks."""
    escape = replace(request, mission=Mission.EXIT, target=None)
    return escape.adapted(Adaptation.of(planner.vehicle, Mission.EXIT))


def _costs(planner: Planner, request: PlanRequest, stops: tuple[str, ...]) -> FloatArray:
    """J of all legs (n + 2, n + 2): from the start or a stop, to a stop or out."""
    costs = np.full((len(stops) + 2, len(stops) + 2), _FAR)
    for before in range(len(stops) + 1):
        at = request
        if before:
            at = _at(request, planner.site.target(stops[before - 1]).position_m)
        for index, stop in enumerate(stops, start=1):
            if index != before:
                costs[before, index] = _cost(planner, replace(at, target=stop))
        costs[before, -1] = _cost(planner, exit_request(planner, at))
    if (costs[:-1, -1] >= _FAR).all():
        costs[:, -1] = 0.0  # no way out: the order of the visits alone
    return costs


def _cost(planner: Planner, request: PlanRequest) -> float:
    try:
        found = planner.solve(request).cost
    except InputError:  # no landing point in sight
        return _FAR
    return _FAR if found is None else found.total


def _lengths(planner: Planner, request: PlanRequest, stops: tuple[str, ...]) -> FloatArray:
    """Straight lengths of all legs (n + 2, n + 2), in metres; out to the nearest landing point."""
    site = planner.site
    places_m = [request.start_m, *(site.target(stop).position_m for stop in stops)]
    costs = np.zeros((len(places_m) + 1, len(places_m) + 1))
    for before, place_m in enumerate(places_m):
        costs[before, :-1] = [math.dist(place_m, other_m) for other_m in places_m]
        landings_m = site.landing_m.get(Mission.EXIT, ())
        costs[before, -1] = min((math.dist(place_m, out) for out in landings_m), default=0.0)
    return costs


def least_order(costs: FloatArray) -> tuple[int, ...]:
    """The order of n stops, from 0, of least total cost.

    costs: (n + 2, n + 2), finite, from row to column; first the start, last the end behind the last
    stop.
    """
    count = len(costs) - 2
    if count <= EXACT_STOPS:
        return _exact_order(costs)
    return _improved_order(costs)


def order_cost(costs: FloatArray, order: tuple[int, ...]) -> float:
    """Total cost of an order of stops. costs: of `least_order`."""
    nodes = [0, *(1 + index for index in order), len(costs) - 1]
    return float(sum(costs[leg] for leg in itertools.pairwise(nodes)))


def _exact_order(costs: FloatArray) -> tuple[int, ...]:
    """Held and Karp: the least cost of each set of stops by its last stop, sets in rising order."""
    count = len(costs) - 2
    if count == 0:
        return ()
    between = costs[1:-1, 1:-1]
    least = np.full((1 << count, count), np.inf)
    before = np.zeros((1 << count, count), dtype=np.int64)
    for stop in range(count):
        least[1 << stop, stop] = costs[0, 1 + stop]
    for visited in range(1, 1 << count):
        onward = least[visited][:, None] + between
        nearest = onward.argmin(axis=0)
        for stop in range(count):
            if not visited >> stop & 1:
                least[visited | 1 << stop, stop] = onward[nearest[stop], stop]
                before[visited | 1 << stop, stop] = nearest[stop]
    visited = (1 << count) - 1
    stop = int((least[visited] + costs[1:-1, -1]).argmin())
    order = [stop]
    while visited != 1 << stop:
        visited, stop = visited ^ 1 << stop, int(before[visited, stop])
        order.append(stop)
    return tuple(reversed(order))


def _improved_order(costs: FloatArray) -> tuple[int, ...]:
    """The best of the orders that begin with each of the cheapest first stops, improved."""
    starts = max(1, min(EXACT_STOPS, _MOST_STARTS // (len(costs) - 2)))
    firsts = np.argsort(costs[0, 1:-1], kind="stable")[:starts].tolist()
    orders = [_improved(costs, _inserted(costs, first)) for first in firsts]
    return min(orders, key=lambda order: order_cost(costs, order))


def _inserted(costs: FloatArray, first: int) -> IntArray:
    """Nodes of an order, start and end included: each stop is inserted where it costs least."""
    nodes = np.array([0, 1 + first, len(costs) - 1])
    left = np.delete(np.arange(1, len(costs) - 1), first)
    while left.size:
        before, after = nodes[:-1], nodes[1:]
        more = costs[before][:, left].T + costs[left][:, after] - costs[before, after]
        stop, place = divmod(int(more.argmin()), len(before))
        nodes = np.insert(nodes, place + 1, left[stop])
        left = np.delete(left, stop)
    return nodes


def _improved(costs: FloatArray, nodes: IntArray) -> tuple[int, ...]:
    """The order after the best reversal or move of a part, as long as one gains."""
    while True:
        gain, changed = max(_changes(costs, nodes), key=lambda change: change[0])
        if gain < _LEAST_GAIN:
            return tuple(int(node) - 1 for node in nodes[1:-1])
        nodes = changed


def _changes(costs: FloatArray, nodes: IntArray) -> Iterator[tuple[float, IntArray]]:
    """The best reversal of a part, and the best move of a part of each length, with their gains."""
    yield _reversed_part(costs, nodes)
    for length in range(1, _LONGEST_PART + 1):
        yield _moved_part(costs, nodes, length)


def _reversed_part(costs: FloatArray, nodes: IntArray) -> tuple[float, IntArray]:
    """2-opt for costs that differ by direction: nodes i to j in reverse, i < j."""
    forth = np.concatenate([[0.0], np.cumsum(costs[nodes[:-1], nodes[1:]])])
    back = np.concatenate([[0.0], np.cumsum(costs[nodes[1:], nodes[:-1]])])
    first, last = np.triu_indices(len(nodes) - 2, 1)
    first, last = first + 1, last + 1
    gain = forth[last + 1] - forth[first - 1] - (back[last] - back[first])
    gain -= costs[nodes[first - 1], nodes[last]] + costs[nodes[first], nodes[last + 1]]
    best = int(gain.argmax())
    i, j = int(first[best]), int(last[best])
    return float(gain[best]), np.concatenate([nodes[:i], nodes[i : j + 1][::-1], nodes[j + 1 :]])


def _moved_part(costs: FloatArray, nodes: IntArray, length: int) -> tuple[float, IntArray]:
    """Or-opt: `length` nodes from i on, moved behind node p."""
    i, p = np.meshgrid(np.arange(1, len(nodes) - length), np.arange(len(nodes) - 1), indexing="ij")
    outside = (p < i - 1) | (p >= i + length)
    i, p = i[outside], p[outside]
    before, first, last, after = nodes[i - 1], nodes[i], nodes[i + length - 1], nodes[i + length]
    gain = costs[before, first] + costs[last, after] - costs[before, after]
    gain += costs[nodes[p], nodes[p + 1]]
    gain -= costs[nodes[p], first] + costs[last, nodes[p + 1]]
    best = int(gain.argmax())
    begin, behind = int(i[best]), int(p[best])
    part = nodes[begin : begin + length]
    rest = np.delete(nodes, np.s_[begin : begin + length])
    place = behind + 1 if behind < begin else behind + 1 - length
    return float(gain[best]), np.insert(rest, place, part)

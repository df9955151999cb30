"""The compiled inner loops of the search. The jit policy of the project is in this file.

Policy: eager signatures (no compilation in flight), `nogil` (a plan never holds up the streaming
loop), `cache` (compiled once per machine), no `fastmath` (costs are compared with an oracle).
Arrays come in read-only and flat over padded cells; a state is `cell * headings + heading`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import numba as nb
import numpy as np

from .grid import FloatArray, IntArray

_Function = TypeVar("_Function", bound=Callable[..., object])

_f8 = nb.types.Array(nb.float64, 1, "C", readonly=True)
_f8x2 = nb.types.Array(nb.float64, 2, "C", readonly=True)
_i8 = nb.types.Array(nb.int64, 1, "C", readonly=True)
_u4 = nb.types.Array(nb.uint32, 1, "C", readonly=True)
_u1 = nb.types.Array(nb.uint8, 1, "C", readonly=True)
_f8_heap = nb.types.Array(nb.float64, 1, "C")
_i8_heap = nb.types.Array(nb.int64, 1, "C")


def _jit(signature: object) -> Callable[[_Function], _Function]:
    decorator: Callable[[_Function], _Function] = nb.njit(
        signature, nogil=True, cache=True, error_model="numpy"
    )
    return decorator


@_jit(nb.void(_f8_heap, _i8_heap, nb.int64, nb.float64, nb.int64))
def _push(keys: FloatArray, items: IntArray, size: int, key: float, item: int) -> None:
    """Insert into a binary heap of `size` entries."""
    at = size
    while at > 0:
        parent = (at - 1) >> 1
        if keys[parent] <= key:
            break
        keys[at] = keys[parent]
        items[at] = items[parent]
        at = parent
    keys[at] = key
    items[at] = item


@_jit(nb.void(_f8_heap, _i8_heap, nb.int64))
def _pop(keys: FloatArray, items: IntArray, size: int) -> None:
    """Remove the least of `size` entries, which stands at index 0."""
    last = size - 1
    key, item = keys[last], items[last]
    at = 0
    while True:
        child = 2 * at + 1
        if child >= last:
            break
        if child + 1 < last and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[at] = keys[child]
        items[at] = items[child]
        at = child
    keys[at] = key
    items[at] = item


@_jit(nb.float64[::1](_i8, _u4, _f8, _f8x2, _i8, _f8, nb.float64, nb.float64, nb.float64))
def cell_field(
    goals: IntArray,
    allowed: IntArray,
    safety: FloatArray,
    duration: FloatArray,
    offset: IntArray,
    length_m: FloatArray,
    k_safety: float,
    k_time: float,
    per_action: float,
) -> FloatArray:
    """Least cost from every cell to the nearest goal, energy left out: (cells,), inf if none.

    Backward Dijkstra over cells. A step costs the same whatever the state it leaves, but for its
    energy; hence the field is exact for k_E = 0 and a lower bound otherwise.
    """
    cells = allowed.size
    headings = offset.size
    field = np.full(cells, np.inf)
    keys = np.empty(goals.size + cells * (headings - 1))
    items = np.empty(keys.size, dtype=np.int64)
    size = 0
    for goal in goals:
        field[goal] = 0.0
        _push(keys, items, size, 0.0, goal)
        size += 1
    while size > 0:
        key, cell = keys[0], items[0]
        _pop(keys, items, size)
        size -= 1
        if key > field[cell]:
            continue
        risk = k_safety * safety[cell]
        for heading in range(1, headings):
            before = cell - offset[heading]
            if not (allowed[before] >> np.uint32(heading)) & np.uint32(1):
                continue
            cost = key + risk * length_m[heading] + k_time * duration[cell, heading] + per_action
            if cost < field[before]:
                field[before] = cost
                _push(keys, items, size, cost, before)
                size += 1
    return field


_found = nb.types.Tuple((nb.int64[::1], nb.int64))


@_jit(
    _found(
        nb.int64, _f8, _u1, nb.boolean, _f8, _u4, _f8, _f8x2, _f8x2, _i8, _f8, _f8x2,
        nb.float64, nb.float64, nb.float64, nb.float64, nb.float64,
    )
)  # fmt: skip
def best_path(
    start: int,
    velocity: FloatArray,
    is_goal: IntArray,
    stop_at_goal: bool,
    field: FloatArray,
    allowed: IntArray,
    safety: FloatArray,
    speed: FloatArray,
    duration: FloatArray,
    offset: IntArray,
    length_m: FloatArray,
    unit: FloatArray,
    k_safety: float,
    k_time: float,
    k_energy: float,
    v_max: float,
    per_action: float,
) -> tuple[IntArray, int]:
    """A* over states: the best path's states after the start, and the number of expansions.

    start: cell; velocity: (d,) of the vehicle, from which the first step's energy counts.
    is_goal: (cells,); with `stop_at_goal` the goal is reached at rest, else with any heading.
    field: lower bound of the cost from each cell, without energy (`cell_field`). With
    `stop_at_goal`, k_E ||v|| / (2 v_MAX) is added: the energy still to be spent is at least that
    of the straight change from v to rest (triangle inequality), so the sum is consistent.
    The goal must be reachable: the field at the start finite.
    """
    headings = offset.size
    dimensions = unit.shape[1]
    states = allowed.size * headings
    energy_scale = 0.5 * k_energy / v_max
    moving = False
    for axis in range(dimensions):
        moving = moving or velocity[axis] != 0.0
    # The start is its own node: it has heading 0 and the vehicle's velocity. At rest it is the
    # state (cell, stop).
    origin = states if moving else start * headings
    cost_to = np.full(states + 1, np.inf)
    parent = np.full(states + 1, -1, dtype=np.int64)
    closed = np.zeros(states + 1, dtype=np.uint8)
    capacity = 1 << 12
    keys = np.empty(capacity)
    items = np.empty(capacity, dtype=np.int64)
    cost_to[origin] = 0.0
    _push(keys, items, 0, field[start], origin)
    size = 1
    expanded = 0
    reached = np.int64(-1)
    from_velocity = np.zeros(dimensions)
    while size > 0:
        state = items[0]
        _pop(keys, items, size)
        size -= 1
        if closed[state]:
            continue
        closed[state] = 1
        expanded += 1
        if state == states:
            cell, heading = start, 0
            for axis in range(dimensions):
                from_velocity[axis] = velocity[axis]
        else:
            cell, heading = state // headings, state % headings
            for axis in range(dimensions):
                from_velocity[axis] = speed[cell, heading] * unit[heading, axis]
        at_rest = heading == 0 and state != states
        if is_goal[cell] and (at_rest or not stop_at_goal):
            reached = state
            break
        cost_here = cost_to[state]
        moves = allowed[cell]
        for move in range(headings):
            if move == 0:
                if at_rest:
                    continue
            elif not (moves >> np.uint32(move)) & np.uint32(1):
                continue
            there = cell + offset[move]
            next_state = there * headings + move
            if closed[next_state]:
                continue
            arrival_speed = speed[there, move]
            change_squared = 0.0
            for axis in range(dimensions):
                change = arrival_speed * unit[move, axis] - from_velocity[axis]
                change_squared += change * change
            cost = (
                cost_here
                + k_safety * safety[there] * length_m[move]
                + k_time * duration[there, move]
                + energy_scale * np.sqrt(change_squared)
                + per_action
            )
            if cost < cost_to[next_state]:
                cost_to[next_state] = cost
                parent[next_state] = state
                bound = cost + field[there]
                if stop_at_goal:
                    bound += energy_scale * arrival_speed
                if size == capacity:
                    capacity *= 2
                    more_keys = np.empty(capacity)
                    more_items = np.empty(capacity, dtype=np.int64)
                    more_keys[:size] = keys[:size]
                    more_items[:size] = items[:size]
                    keys, items = more_keys, more_items
                _push(keys, items, size, bound, next_state)
                size += 1
    length = 0
    state = reached
    while state >= 0 and state != origin:
        length += 1
        state = parent[state]
    path = np.empty(length, dtype=np.int64)
    state = reached
    for at in range(length - 1, -1, -1):
        path[at] = state
        state = parent[state]
    return path, expanded

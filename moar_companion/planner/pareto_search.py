"""The compiled search of all optimal trade-offs between two costs.

Source: BOA*, C. Hernandez Ulloa, W. Yeoh, J. Baier, H. Zhang, L. Suazo, S. Koenig: A simple and
fast bi-objective search algorithm, ICAPS 2020. Arrays are flat over padded cells, as in `search`.
"""

from __future__ import annotations

import numpy as np

from .arrays import CRITERION, LABELS, STEPS, Criterion, Labels, Steps
from .grid import FloatArray, IntArray
from .jit import BOOL, F8, I8, U1, jit, none, read, several, written

_NO_PARENT = -1


@jit(BOOL, LABELS, I8, I8)
def _before(labels: Labels, one: int, other: int) -> bool:
    """True if a label comes first: by the bound of its first sum, then of its second."""
    difference: float = labels.first_bound[one] - labels.first_bound[other]
    if difference == 0.0:
        difference = labels.second_bound[one] - labels.second_bound[other]
    return difference < 0.0


@jit(none, LABELS, I8, I8)
def _put(labels: Labels, size: int, label: int) -> None:
    """Puts a label into the heap, which had `size` items."""
    heap = labels.heap
    at = size
    while at > 0:
        above = (at - 1) >> 1
        if not _before(labels, label, heap[above]):
            break
        heap[at] = heap[above]
        at = above
    heap[at] = label


@jit(I8, LABELS, I8)
def _take(labels: Labels, size: int) -> int:
    """Takes the first label out of the heap, which had `size` items."""
    heap = labels.heap
    taken: int = heap[0]
    moved = heap[size - 1]
    count = size - 1
    at = 0
    while True:
        child = 2 * at + 1
        if child >= count:
            break
        if child + 1 < count and _before(labels, heap[child + 1], heap[child]):
            child += 1
        if not _before(labels, heap[child], moved):
            break
        heap[at] = heap[child]
        at = child
    heap[at] = moved
    return taken


@jit(BOOL, STEPS, F8, read(F8), I8, I8, F8)
def _is_dominated(
    steps: Steps,
    change: float,
    least_second: FloatArray,
    cell: int,
    heading: int,
    second_sum: float,
) -> bool:
    """True if an earlier path to the cell, by any heading, goes on from it at no greater cost."""
    moves = steps.offset.size - 1
    speed = steps.speed[cell, heading]
    for move in range(1, moves + 1):
        least = least_second[cell * moves + move - 1]
        if least > second_sum:
            continue
        other = steps.speed[cell, move]
        dx = speed * steps.axes[0, heading] - other * steps.axes[0, move]
        dy = speed * steps.axes[1, heading] - other * steps.axes[1, move]
        dz = speed * steps.axes[2, heading] - other * steps.axes[2, move]
        if least + change * np.sqrt(dx * dx + dy * dy + dz * dz) <= second_sum:
            return True
    return False


@jit(
    several(I8, I8, BOOL),
    I8, read(F8), STEPS, CRITERION, CRITERION, read(U1), BOOL, F8, written(F8), LABELS, written(I8),
)  # fmt: skip
def pareto_search(
    start: int,
    velocity: FloatArray,
    steps: Steps,
    first: Criterion,
    second: Criterion,
    is_goal: IntArray,
    ends_at_rest: bool,
    closeness: float,
    least_second: FloatArray,
    labels: Labels,
    ends: IntArray,
) -> tuple[int, int, bool]:
    """All optimal trade-offs: their number, the number of labels, and whether memory sufficed.

    The ends of the paths are labels in `ends`, by their first sum, the least first; `parent` leads
    back from each. A label is one path to a state: (cells x M), or to the end, which comes last.

    closeness: 0 for all trade-offs. Otherwise each has one in the answer whose first sum is not
    greater, and whose second is at most 1 + closeness times as great.

    Labels leave the heap by their first bound. The first cost has no part in changes of velocity.
    So a path is dominated in a cell just when an earlier one to it had no greater second sum there,
    the change from its velocity included: one number a state decides (`least_second`, which begins
    infinite, and has one more for the end). `to_go` are exact least costs, each for itself:
    consistent bounds, up to the rounding of a sum.
    """
    moves = steps.offset.size - 1
    end = len(least_second) - 1
    room = len(labels.parent)
    count, size, found = 0, 0, 0
    cell, first_here, second_here, parent = start, 0.0, 0.0, _NO_PARENT
    vx, vy, vz = velocity[0], velocity[1], velocity[2]
    while True:
        for move in range(1, moves + 1):
            if not steps.allowed[cell] & np.uint32(1 << move):
                continue
            there = cell + steps.offset[move]
            state = there * moves + move - 1
            speed = steps.speed[there, move]
            dx = speed * steps.axes[0, move] - vx
            dy = speed * steps.axes[1, move] - vy
            dz = speed * steps.axes[2, move] - vz
            change = np.sqrt(dx * dx + dy * dy + dz * dz)
            second_sum = second_here + second.step[there, move - 1] + second.change * change
            second_bound = second_sum + second.to_go[there, move - 1]
            first_to_go = first.to_go[there, move - 1]
            if (
                second_bound * (1.0 + closeness) >= least_second[end]
                or first_to_go == np.inf
                or _is_dominated(steps, second.change, least_second, there, move, second_sum)
            ):
                continue
            if count == room:
                return found, count, False
            labels.first_sum[count] = first_here + first.step[there, move - 1]
            labels.second_sum[count] = second_sum
            labels.first_bound[count] = labels.first_sum[count] + first_to_go
            labels.second_bound[count] = second_bound
            labels.state[count] = state
            labels.parent[count] = parent
            _put(labels, size, count)
            size += 1
            count += 1
        while True:
            if size == 0:
                return found, count, True
            label = _take(labels, size)
            size -= 1
            state = labels.state[label]
            if labels.second_bound[label] * (1.0 + closeness) >= least_second[end]:
                continue
            if state == end:
                least_second[end] = labels.second_sum[label]
                ends[found] = label
                found += 1
                if found == len(ends):
                    return found, count, False
                continue
            cell, move, reached = state // moves, state % moves + 1, labels.second_sum[label]
            if not _is_dominated(steps, second.change, least_second, cell, move, reached):
                least_second[state] = reached
                break
        first_here, second_here, parent = labels.first_sum[label], labels.second_sum[label], label
        speed = steps.speed[cell, move]
        vx = speed * steps.axes[0, move]
        vy = speed * steps.axes[1, move]
        vz = speed * steps.axes[2, move]
        if is_goal[cell]:
            if count == room:
                return found, count, False
            stop = speed if ends_at_rest else 0.0
            labels.first_sum[count] = first_here + first.behind[cell]
            labels.second_sum[count] = second_here + second.behind[cell] + second.change * stop
            labels.first_bound[count] = labels.first_sum[count]
            labels.second_bound[count] = labels.second_sum[count]
            labels.state[count] = end
            labels.parent[count] = parent
            _put(labels, size, count)
            size += 1
            count += 1


@jit(written(I8), I8, read(I8), read(I8), I8, BOOL)
def headings_to(
    label: int, parent: IntArray, state: IntArray, moves: int, ends_at_rest: bool
) -> IntArray:
    """The headings of the path to a label of the end; the last is stop if it ends at rest."""
    length = 1 if ends_at_rest else 0
    at = parent[label]
    while at >= 0:
        length += 1
        at = parent[at]
    headings = np.zeros(length, dtype=np.int64)
    place = length - (2 if ends_at_rest else 1)
    at = parent[label]
    while at >= 0:
        headings[place] = state[at] % moves + 1
        place -= 1
        at = parent[at]
    return headings

"""The compiled search: backward over whole cells, and forward between bounds.

Arrays are flat over padded cells; those of states are (cells, M), column `heading - 1` for each of
the M moves. A stop is no column: it never saves, by the triangle inequality
||v_b - v_a|| <= ||v_b|| + ||v_a||; only an inspection ends with one.
"""

from __future__ import annotations

import numpy as np

from .arrays import (
    CELL_MEMORY,
    HEAP,
    STATE_MEMORY,
    STEP_COST,
    STEPS,
    CellMemory,
    StateMemory,
    StepCost,
    Steps,
)
from .grid import FloatArray, IntArray
from .jit import BOOL, F8, I8, U1, jit, none, read, several, written


@jit(I8, *HEAP, I8, F8, I8, helper=True)
def put(
    keys: FloatArray, items: IntArray, position: IntArray, size: int, key: float, item: int
) -> int:
    """Puts an item into the heap, or lowers its key there; the heap's size then.

    keys, items: of the heap, in its order, the least key first. position: the place of each item in
    it, -1 for absent items.
    """
    at = position[item]
    if at < 0:
        at = size
        size += 1
    while at > 0:
        parent = (at - 1) >> 1
        if keys[parent] <= key:
            break
        keys[at] = keys[parent]
        items[at] = items[parent]
        position[items[at]] = at
        at = parent
    keys[at] = key
    items[at] = item
    position[item] = at
    return size


@jit(I8, *HEAP, I8, helper=True)
def take(keys: FloatArray, items: IntArray, position: IntArray, size: int) -> int:
    """Takes the least item, at index 0, out of the heap; the heap's size then."""
    position[items[0]] = -1
    size -= 1
    if size == 0:
        return size
    key, item = keys[size], items[size]
    at = 0
    while True:
        child = 2 * at + 1
        if child >= size:
            break
        if child + 1 < size and keys[child + 1] < keys[child]:
            child += 1
        if keys[child] >= key:
            break
        keys[at] = keys[child]
        items[at] = items[child]
        position[items[at]] = at
        at = child
    keys[at] = key
    items[at] = item
    position[item] = at
    return size


@jit(several(F8, F8, F8), STEPS, I8, I8)
def _velocity(steps: Steps, cell: int, heading: int) -> tuple[float, float, float]:
    """The velocity in a state."""
    speed = steps.speed[cell, heading]
    return (
        speed * steps.axes[0, heading],
        speed * steps.axes[1, heading],
        speed * steps.axes[2, heading],
    )


@jit(F8, STEPS, STEP_COST, I8, I8, F8, F8, F8)
def _cost(
    steps: Steps, cost: StepCost, cell: int, heading: int, vx: float, vy: float, vz: float
) -> float:
    """Eq. 7 of the step that arrives in a state from a velocity."""
    x, y, z = _velocity(steps, cell, heading)
    total: float = (
        cost.safety * steps.safety[cell] * steps.length_m[heading]
        + cost.time * steps.length_m[heading] / steps.speed[cell, heading]
        + cost.energy * np.sqrt((x - vx) ** 2 + (y - vy) ** 2 + (z - vz) ** 2)
        + cost.action
    )
    return total


@jit(none, I8, I8, read(F8), STEPS, STEP_COST, written(F8, 2), CELL_MEMORY, I8)
def _open(
    cell: int,
    start: int,
    velocity: FloatArray,
    steps: Steps,
    cost: StepCost,
    label: FloatArray,
    memory: CellMemory,
    version: int,
) -> None:
    """Initialises a cell: no label yet, only lower bounds of the cost from the start."""
    memory.touched[cell] = version
    memory.pending[cell] = 0
    memory.position[cell] = -1
    least_s, energy = 0.0, 0.0
    if start >= 0:
        energy = cost.energy
        for row in range(len(steps.pace)):
            bound_s = 0.0
            for axis in range(3):
                distance = steps.place[cell, axis] - steps.place[start, axis]
                bound_s += steps.pace[row, axis] * distance
            least_s = max(least_s, bound_s)
    for move in range(label.shape[1]):
        label[cell, move] = np.inf
        speed = steps.speed[cell, move + 1]
        dx = speed * steps.axes[0, move + 1] - velocity[0]
        dy = speed * steps.axes[1, move + 1] - velocity[1]
        dz = speed * steps.axes[2, move + 1] - velocity[2]
        change = np.sqrt(dx * dx + dy * dy + dz * dz)
        memory.lead[cell, move] = cost.time * least_s + energy * change


@jit(
    several(F8, I8, I8),
    read(I8), read(F8), BOOL, I8, read(F8), STEPS, STEP_COST,
    written(F8, 2), written(U1, 2), CELL_MEMORY, I8,
)  # fmt: skip
def backward(
    goals: IntArray,
    behind: FloatArray,
    ends_at_rest: bool,
    start: int,
    velocity: FloatArray,
    steps: Steps,
    cost: StepCost,
    label: FloatArray,
    policy: IntArray,
    memory: CellMemory,
    version: int,
) -> tuple[float, int, int]:
    """Search from the goals: J of the start, its first heading, and the number of expanded cells.

    behind: cost of the arrival at each goal.
    With start -1, all states: then `label` holds every state's exact cost to go and `policy` its
    next heading, 0 where it has arrived. Otherwise they do so along the best path; J is infinite
    when there is no path.

    A step costs c(b) + k ||v_b - v_a||, where c is known at the state of arrival b. Backwards,
    one label of b bounds those of all headings in which the cell before it may be entered: the
    queue is of cells instead of states, and each step one loop without branches. Labels are the
    costs of paths and only fall. A cell whose label fell is queued, again if need be. Its key is
    the least sum of such a label and `lead`, a lower bound of the cost from the start to the
    label's state. `lead` is the sum of two bounds:
    - k ||v - velocity||: the changes of a path sum up to at least the straight one;
    - k_T max_y y.(cell - start) over the rows y of `pace`: y.step is at most the duration of the
      step for each move, and so for sums of moves.
    Through every cell in the queue, therefore, no path is cheaper than its key, in whatever order
    cells were expanded: once no key is less than J, J is the optimum. For all states, each cell is
    expanded 1.0 to 1.2 times at the median over the weights, and 3.3 times at most (315 kV site).

    The labels of one cell differ by at most k times their velocities: all come from the same
    steps. A step that would not lower that of its own heading by more than the change of speed in
    it lowers none.

    version: another one in every call with this memory.
    """
    moves = steps.offset.size - 1
    every_move = np.uint32((1 << (moves + 1)) - 2)
    keys, items, position, lead = memory.keys, memory.items, memory.position, memory.lead
    size = 0
    best, first = np.inf, 0
    expanded = 0
    through = np.empty(moves)
    for at in range(len(goals)):
        goal = goals[at]
        _open(goal, start, velocity, steps, cost, label, memory, version)
        memory.pending[goal] = every_move
        least = np.inf
        for move in range(moves):
            last = behind[at]
            if ends_at_rest:
                last += cost.energy * steps.speed[goal, move + 1] + cost.action
            label[goal, move] = last
            policy[goal, move] = 0
            least = min(least, last + lead[goal, move])
        size = put(keys, items, position, size, least, goal)
    while size > 0 and keys[0] < best:
        cell = items[0]
        size = take(keys, items, position, size)
        expanded += 1
        fallen = memory.pending[cell]
        memory.pending[cell] = 0
        for heading in range(1, moves + 1):
            before = cell - steps.offset[heading]
            bit = np.uint32(1 << heading)
            if not (fallen & bit and steps.allowed[before] & bit):
                continue
            speed_here = steps.speed[cell, heading]
            here = (
                label[cell, heading - 1]
                + cost.safety * steps.safety[cell] * steps.length_m[heading]
                + cost.time * steps.length_m[heading] / speed_here
                + cost.action
            )
            x, y, z = _velocity(steps, cell, heading)
            if before == start:
                change = (x - velocity[0]) ** 2 + (y - velocity[1]) ** 2 + (z - velocity[2]) ** 2
                total = here + cost.energy * np.sqrt(change)
                if total < best:
                    best, first = total, heading
            if memory.touched[before] != version:
                _open(before, start, velocity, steps, cost, label, memory, version)
            change_here = cost.energy * abs(speed_here - steps.speed[before, heading])
            if label[before, heading - 1] + change_here <= here:
                continue
            for move in range(moves):
                speed = steps.speed[before, move + 1]
                dx = x - speed * steps.axes[0, move + 1]
                dy = y - speed * steps.axes[1, move + 1]
                dz = z - speed * steps.axes[2, move + 1]
                through[move] = here + cost.energy * np.sqrt(dx * dx + dy * dy + dz * dz)
            least = np.inf
            better = np.uint32(0)
            for move in range(moves):
                if through[move] < label[before, move]:
                    label[before, move] = through[move]
                    policy[before, move] = heading
                    better |= np.uint32(2 << move)
                    least = min(least, through[move] + lead[before, move])
            memory.pending[before] |= better
            if least < best and (position[before] < 0 or least < keys[position[before]]):
                size = put(keys, items, position, size, least, before)
    return best, first, expanded


@jit(written(I8), I8, I8, read(U1, 2), read(I8), BOOL)
def follow(
    start: int, first: int, policy: IntArray, offset: IntArray, ends_at_rest: bool
) -> IntArray:
    """The headings of the path that a policy leads along; the last is stop if it ends at rest."""
    length, cell, heading = 0, start, first
    while heading > 0:
        length += 1
        cell += offset[heading]
        heading = policy[cell, heading - 1]
    headings = np.empty(length + (1 if ends_at_rest else 0), dtype=np.int64)
    if ends_at_rest:
        headings[length] = 0
    cell, heading = start, first
    for at in range(length):
        headings[at] = heading
        cell += offset[heading]
        heading = policy[cell, heading - 1]
    return headings


@jit(several(written(I8), written(F8)), read(F8, 3), read(I8, 2), F8, F8, F8)
def locate(
    roots: FloatArray, triangles: IntArray, safety: float, time: float, energy: float
) -> tuple[IntArray, FloatArray]:
    """The corners of the smallest triangle around weights and their shares in them, above 0."""
    # Scalar code: operations on whole rows take four times as long to compile.
    share, shares = np.empty(3), np.empty(3)
    node, inmost = 0, -np.inf
    for root in range(len(roots)):
        least = np.inf
        for at in range(3):
            x, y, z = roots[root, at, 0], roots[root, at, 1], roots[root, at, 2]
            share[at] = x * safety + y * time + z * energy
            least = min(least, share[at])
        if least > inmost:
            node, inmost = root, least
            for at in range(3):
                shares[at] = share[at]
    while triangles[node, 3] >= 0:
        near = 0 if shares[0] >= shares[1] else 1
        half = shares[1 - near]
        corner, apex = triangles[node, near], triangles[node, 2]
        beyond, top = shares[near] - half, shares[2]
        node = triangles[node, 3] + near
        for at in range(3):
            vertex = triangles[node, at]
            shares[at] = beyond if vertex == corner else top if vertex == apex else 2.0 * half
    corners = np.empty(3, dtype=np.int64)
    count = 0
    for at in range(3):
        if shares[at] > 0.0:
            corners[count], shares[count] = triangles[node, at], shares[at]
            count += 1
    return corners[:count], shares[:count]


@jit(
    several(written(I8), F8, I8),
    I8, read(F8), STEPS, STEP_COST, F8, F8, F8, read(F8, 3), read(I8, 2), read(F8, 3), read(U1, 3),
    BOOL, F8, STATE_MEMORY, I8,
)  # fmt: skip
def forward(
    start: int,
    velocity: FloatArray,
    steps: Steps,
    cost: StepCost,
    safety: float,
    time: float,
    energy: float,
    roots: FloatArray,
    triangles: IntArray,
    costs_to_go: FloatArray,
    policies: IntArray,
    ends_at_rest: bool,
    slack: float,
    memory: StateMemory,
    version: int,
) -> tuple[IntArray, float, int]:
    """The best path between bounds: its headings, the lower bound of J, states expanded.

    roots, triangles, costs_to_go, policies: of a `solver.CostToGoTable`. In their shares of the
    weights, its corners' exact costs to go are a lower bound for each state; it is consistent, as
    each is and a step's cost is linear in the weights. Each corner's policy is a path, its cost
    here an upper bound. Where the two meet at the start (to `slack`, relative), that path is the
    answer; otherwise it is A*'s, which leaves out what is above the upper bound. Without any path
    the lower bound is infinite.
    version: another one in every call with this memory.
    """
    moves = steps.offset.size - 1
    corners, shares = locate(roots, triangles, safety, time, energy)
    vx, vy, vz = velocity[0], velocity[1], velocity[2]
    lower, first = np.inf, 0
    for heading in range(1, moves + 1):
        if steps.allowed[start] & np.uint32(1 << heading):
            there = start + steps.offset[heading]
            bound = _cost(steps, cost, there, heading, vx, vy, vz)
            for at in range(len(corners)):
                bound += shares[at] * costs_to_go[corners[at], there, heading - 1]
            if bound < lower:
                lower, first = bound, heading
    if first == 0:
        return np.empty(0, dtype=np.int64), lower, 0
    upper, leader = np.inf, corners[0]
    for corner in corners:
        total = 0.0
        cell, heading = start, first
        vx, vy, vz = velocity[0], velocity[1], velocity[2]
        while heading > 0 and total < upper:
            cell += steps.offset[heading]
            total += _cost(steps, cost, cell, heading, vx, vy, vz)
            vx, vy, vz = _velocity(steps, cell, heading)
            after = policies[corner, cell, heading - 1]
            if after == 0 and not ends_at_rest:
                total += costs_to_go[corner, cell, heading - 1]
            heading = after
        if ends_at_rest:
            total += cost.energy * np.sqrt(vx**2 + vy**2 + vz**2) + cost.action
        if total < upper:
            upper, leader = total, corner
    expanded, arrived = 0, -1
    if upper > lower + slack * max(1.0, lower):
        keys, items, position = memory.keys, memory.items, memory.position
        size = 0
        cell, heading, cost_here = start, 0, 0.0
        vx, vy, vz = velocity[0], velocity[1], velocity[2]
        while True:
            exits = steps.allowed[cell]
            for move in range(1, moves + 1):
                if not exits & np.uint32(1 << move):
                    continue
                there = cell + steps.offset[move]
                state = there * moves + move - 1
                if memory.touched[state] != version:
                    memory.touched[state] = version
                    memory.cost[state] = np.inf
                    position[state] = -1
                total = cost_here + _cost(steps, cost, there, move, vx, vy, vz)
                if total < memory.cost[state]:
                    bound = total
                    for at in range(len(corners)):
                        bound += shares[at] * costs_to_go[corners[at], there, move - 1]
                    if bound < upper:
                        memory.cost[state] = total
                        memory.came_by[state] = heading
                        size = put(keys, items, position, size, bound, state)
            if size == 0:
                break
            state = items[0]
            size = take(keys, items, position, size)
            expanded += 1
            cell, heading = state // moves, state % moves + 1
            if policies[leader, cell, heading - 1] == 0:
                arrived = state
                break
            cost_here = memory.cost[state]
            vx, vy, vz = _velocity(steps, cell, heading)
    if arrived < 0:
        headings = follow(start, first, policies[leader], steps.offset, ends_at_rest)
        return headings, lower, expanded
    length, cell, heading = 0, arrived // moves, arrived % moves + 1
    while heading > 0:
        memory.items[length] = heading
        length += 1
        state = cell * moves + heading - 1
        cell -= steps.offset[heading]
        heading = memory.came_by[state]
    headings = np.empty(length + (1 if ends_at_rest else 0), dtype=np.int64)
    if ends_at_rest:
        headings[length] = 0
    for at in range(length):
        headings[at] = memory.items[length - 1 - at]
    return headings, lower, expanded

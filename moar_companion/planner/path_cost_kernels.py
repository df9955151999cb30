"""The compiled loops along paths: their states and costs."""

from __future__ import annotations

import numpy as np

from .arrays import STEPS, Steps
from .grid import FloatArray, IntArray
from .jit import BOOL, F8, I8, U1, jit, read, several, written


@jit(several(written(I8, 2), F8, F8, F8), I8, read(F8), read(I8), I8, STEPS, F8)
def walk(
    start: int,
    velocity: FloatArray,
    headings: IntArray,
    dimensions: int,
    steps: Steps,
    v_max: float,
) -> tuple[IntArray, float, float, float]:
    """The states (n + 1, d + 1) along n headings, and the sums SC d, TC and EC (Eq. 1, 4, 6)."""
    states = np.empty((len(headings) + 1, dimensions + 1), dtype=np.int64)
    safety, time, change = 0.0, 0.0, 0.0
    cell, heading = start, 0
    vx, vy, vz = velocity[0], velocity[1], velocity[2]
    for at in range(len(states)):
        if at > 0:
            heading = headings[at - 1]
            cell += steps.offset[heading]
            speed = steps.speed[cell, heading]
            x = speed * steps.axes[0, heading]
            y = speed * steps.axes[1, heading]
            z = speed * steps.axes[2, heading]
            safety += steps.safety[cell] * steps.length_m[heading]
            time += steps.length_m[heading] / speed if heading > 0 else 0.0
            change += np.sqrt((x - vx) ** 2 + (y - vy) ** 2 + (z - vz) ** 2)
            vx, vy, vz = x, y, z
        for axis in range(dimensions):
            states[at, axis] = np.int64(steps.place[cell, axis])
        states[at, dimensions] = heading
    return states, safety, time, 0.5 * change / v_max


@jit(written(F8, 2), read(I8), read(U1, 2), STEPS, BOOL, F8)
def policy_sums(
    states: IntArray, policy: IntArray, steps: Steps, ends_at_rest: bool, v_max: float
) -> FloatArray:
    """The sums SC d, TC and EC, (n, 3), of the paths that a policy leads along from states (n,).

    A state is `cell * M + heading - 1`.
    """
    moves = steps.offset.size - 1
    sums = np.empty((len(states), 3))
    for at in range(len(states)):
        for axis in range(3):
            sums[at, axis] = 0.0
        cell, heading = states[at] // moves, states[at] % moves + 1
        while heading > 0:
            after = policy[cell, heading - 1]
            there = cell + steps.offset[after]
            sums[at, 0] += steps.safety[there] * steps.length_m[after]
            if after > 0:
                sums[at, 1] += steps.length_m[after] / steps.speed[there, after]
            if after > 0 or ends_at_rest:
                change = 0.0
                for axis in range(3):
                    here = steps.speed[cell, heading] * steps.axes[axis, heading]
                    change += (steps.speed[there, after] * steps.axes[axis, after] - here) ** 2
                sums[at, 2] += 0.5 * np.sqrt(change) / v_max
            cell, heading = there, after
    return sums

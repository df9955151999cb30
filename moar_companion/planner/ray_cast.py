"""The compiled tracing of rays through the cells of a plane."""

from __future__ import annotations

import numpy as np

from .grid import FloatArray, IntArray
from .jit import F8, U1, jit, read, written


@jit(written(F8), read(U1, 2), read(F8, 2), read(F8, 2), F8)
def free_ahead(
    blocked: IntArray, start: FloatArray, direction: FloatArray, farthest: float
) -> FloatArray:
    """Length of rays until they enter a blocked cell: (n,), at most `farthest`.

    blocked: (nx, nz); start: (n, 2) in cells from the lower corner; direction: (n, 2) in cells for
    each unit of the result. Cell by cell (Amanatides and Woo 1987); outside the grid all is free.
    Blocked cells that a ray begins in do not end it.
    """
    columns, rows = blocked.shape
    free = np.empty(len(start))
    for ray in range(len(start)):
        x, z = np.int64(np.floor(start[ray, 0])), np.int64(np.floor(start[ray, 1]))
        along_x, along_z = direction[ray, 0], direction[ray, 1]
        step_x, step_z = (1 if along_x > 0.0 else -1), (1 if along_z > 0.0 else -1)
        next_x, next_z = np.inf, np.inf
        every_x, every_z = np.inf, np.inf
        if along_x != 0.0:
            every_x = abs(1.0 / along_x)
            next_x = (x + (step_x > 0) - start[ray, 0]) / along_x
        if along_z != 0.0:
            every_z = abs(1.0 / along_z)
            next_z = (z + (step_z > 0) - start[ray, 1]) / along_z
        at, outside_once, ended = 0.0, False, False
        while not ended and (at < farthest or (not outside_once and at < np.inf)):
            solid = 0 <= x < columns and 0 <= z < rows and blocked[x, z] != 0
            ended = solid and outside_once
            outside_once = outside_once or not solid
            if not ended:
                if next_x < next_z:
                    at, next_x, x = next_x, next_x + every_x, x + step_x
                else:
                    at, next_z, z = next_z, next_z + every_z, z + step_z
        free[ray] = min(at, farthest)
    return free

"""Distances of cells to obstacles and to their keep-outs, and their repair where obstacles change.

Inputs: a grid and obstacles; clearances known for other obstacles on the same grid. Outputs: for
each cell the distance and the index of the nearest. Where that one is unchanged, only new
obstacles are evaluated: the result equals a full evaluation, bit by bit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .distance_kernels import nearest_rings
from .geometry import rings
from .grid import FloatArray, Grid, IntArray
from .site import Obstacle


@dataclass(frozen=True, kw_only=True, eq=False)
class Clearances:
    """Clearances of every cell of a grid, (nx, nz) each; infinite and -1 without obstacles.

    distance_m, nearest: to the nearest obstacle, 0 inside, and its index
    room_m, closest:     to the nearest keep-out, negative inside, and its obstacle's index
    """

    grid: Grid
    obstacles: tuple[Obstacle, ...]
    distance_m: FloatArray
    nearest: IntArray
    room_m: FloatArray
    closest: IntArray

    @classmethod
    def over(cls, grid: Grid, obstacles: tuple[Obstacle, ...], *known: Clearances) -> Clearances:
        """The clearances on a grid, repaired from the first known ones on this grid."""
        before = next((item for item in known if item.grid == grid), None)
        if before is None:
            nothing = np.empty(grid.shape), np.full(grid.shape, -1, dtype=np.int32)
            return cls._repaired(grid, obstacles, (), (*nothing, *nothing))
        if before.obstacles == obstacles:
            return before
        maps = before.distance_m, before.nearest, before.room_m, before.closest
        return cls._repaired(grid, obstacles, before.obstacles, maps)

    @classmethod
    def _repaired(
        cls,
        grid: Grid,
        obstacles: tuple[Obstacle, ...],
        before: tuple[Obstacle, ...],
        maps: tuple[FloatArray, IntArray, FloatArray, IntArray],
    ) -> Clearances:
        index_of = {obstacle: index for index, obstacle in enumerate(obstacles)}
        now = np.array([index_of.get(obstacle, -1) for obstacle in before], dtype=np.int32)
        is_new = np.ones(len(obstacles), dtype=np.uint8)
        is_new[now[now >= 0]] = 0
        x_m, z_m = grid.axes_m
        distance, nearest, room, closest = nearest_rings(
            x_m, z_m, *rings(obstacles), now, is_new, *maps
        )
        for array in (distance, nearest, room, closest):
            array.flags.writeable = False
        return cls(
            grid=grid,
            obstacles=obstacles,
            distance_m=distance,
            nearest=nearest,
            room_m=room,
            closest=closest,
        )

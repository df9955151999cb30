"""Cells and moves: the discrete state and action spaces of the paper (Section IV-B).

A grid defines the places of its cells; the moves define their ends, their lengths and the cells
that a diagonal passes between. Both are written for any number of dimensions. The search only uses
flat cell indices of a grid padded by one cell all round, and a table of moves.
"""

from __future__ import annotations

import itertools
import math
import operator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.floating[Any]]
IntArray = npt.NDArray[np.integer[Any]]
BoolArray = npt.NDArray[np.bool_]

TOLERANCE = 1e-9
"""Comparisons with a limit count within this."""

STOP = 0
"""The heading of the action that stays in its cell, at rest."""


@dataclass(frozen=True, kw_only=True)
class Grid:
    """A regular grid of cells over a workspace."""

    lower_m: tuple[float, ...]
    resolution_m: float
    shape: tuple[int, ...]

    @classmethod
    def over(
        cls, lower_m: tuple[float, ...], upper_m: tuple[float, ...], resolution_m: float
    ) -> Grid:
        """The grid of a workspace; a remainder at its upper border is left out."""
        shape = tuple(
            max(1, math.floor((upper - lower) / resolution_m + TOLERANCE))
            for lower, upper in zip(lower_m, upper_m, strict=True)
        )
        return cls(lower_m=lower_m, resolution_m=resolution_m, shape=shape)

    @cached_property
    def axes_m(self) -> tuple[FloatArray, ...]:
        """The coordinates of the cell centres along each axis."""
        return tuple(
            lower + (np.arange(count) + 0.5) * self.resolution_m
            for lower, count in zip(self.lower_m, self.shape, strict=True)
        )

    @property
    def upper_m(self) -> tuple[float, ...]:
        """The upper corner of the last cell."""
        return tuple(
            lower + count * self.resolution_m
            for lower, count in zip(self.lower_m, self.shape, strict=True)
        )

    def cell_of(self, point_m: tuple[float, ...]) -> tuple[int, ...] | None:
        """The cell that holds a point; None outside.

        On the border of two cells it is the greater, on the upper border of all the last.
        """
        cell = []
        for value, lower, count in zip(point_m, self.lower_m, self.shape, strict=True):
            position = (value - lower) / self.resolution_m
            if not -TOLERANCE <= position <= count + TOLERANCE:
                return None
            cell.append(min(math.floor(position + TOLERANCE), count - 1))
        return tuple(cell)

    def centre_m(self, cell: tuple[int, ...]) -> tuple[float, ...]:
        """The centre of a cell."""
        return tuple(
            lower + (index + 0.5) * self.resolution_m
            for lower, index in zip(self.lower_m, cell, strict=True)
        )

    @cached_property
    def strides(self) -> tuple[int, ...]:
        """Steps between neighbours along each axis in the padded flat index."""
        strides = [1]
        for count in reversed(self.shape[1:]):
            strides.insert(0, strides[0] * (count + 2))
        return tuple(strides)

    def flat(self, cell: tuple[int, ...]) -> int:
        """The padded flat index of a cell."""
        flat: int = sum(map(operator.mul, cell, self.strides), start=sum(self.strides))
        return flat

    def unflat(self, flat: IntArray) -> IntArray:
        """The cells, (n, dimensions), of padded flat indices, (n,)."""
        padded_shape = tuple(count + 2 for count in self.shape)
        return np.stack(np.unravel_index(flat, padded_shape), axis=-1).astype(np.int64) - 1

    def padded(self, array: npt.NDArray[np.generic], fill: float) -> npt.NDArray[np.generic]:
        """A map of this grid, flat, with a border of `fill` one cell wide."""
        padded = np.full([count + 2 for count in array.shape], fill, dtype=array.dtype)
        padded[(slice(1, -1),) * array.ndim] = array
        return padded.reshape(-1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Moves:
    """The actions of a state, indexed by heading; 0 is stop.

    steps:     (H, d)  cells along each axis
    unit:      (H, d)  direction, zero for stop
    cells:     (H,)    length in cells
    """

    steps: IntArray
    unit: FloatArray
    cells: FloatArray

    @classmethod
    def of_plane(cls) -> Moves:
        """Stop and the eight directions, clockwise from up; axes (x, z)."""
        return cls._of([(0, 1), (1, 1), (1, 0), (1, -1), (0, -1), (-1, -1), (-1, 0), (-1, 1)])

    @classmethod
    def _of(cls, directions: list[tuple[int, ...]]) -> Moves:
        steps = np.array([(0,) * len(directions[0]), *directions], dtype=np.int64)
        cells = np.sqrt((steps**2).sum(axis=1))
        unit = steps / np.where(cells > 0.0, cells, 1.0)[:, None]
        return cls(steps=steps, unit=unit, cells=cells)

    @cached_property
    def needed(self) -> IntArray:
        """Bit h of a move, (H,): the cell that move h leads to must be free: no cut corners.

        Its own cell, and every cell that a partial move (along a part of its axes) leads to.
        """
        heading_of = {tuple(step): heading for heading, step in enumerate(self.steps.tolist())}
        needed = np.zeros(len(self.steps), dtype=np.uint32)
        for heading, step in enumerate(self.steps.tolist()):
            for part in itertools.product(*({0, component} for component in step)):
                needed[heading] |= np.uint32(1 << heading_of[part] if any(part) else 0)
        return needed

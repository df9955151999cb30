"""Outlines of cells of a grid that are connected by edges, as vertices of a simple polygon."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import ndimage

BoolArray = npt.NDArray[np.bool_]
Corner = tuple[float, float]


def outline_of(cells: BoolArray, most_vertices: int = 200) -> list[Corner]:
    """Vertices in units of cells, counterclockwise, of the outline of cells (x, z).

    cells: connected by edges; holes are filled. Where the outline would have more vertices, it is
    that of cells twice (four times, …) as large.
    """
    size = 1
    while True:
        outline = _traced(_coarser(cells, size))
        if len(outline) <= most_vertices:
            return [(size * x, size * z) for x, z in outline]
        size *= 2


def straightened(outline: list[Corner]) -> list[Corner]:
    """Without vertices inside a straight edge."""
    kept: list[Corner] = []
    for vertex in outline:
        if len(kept) >= 2 and any(
            kept[-2][axis] == kept[-1][axis] == vertex[axis] for axis in (0, 1)
        ):
            kept[-1] = vertex
        elif not kept or kept[-1] != vertex:
            kept.append(vertex)
    return kept


def _coarser(cells: BoolArray, size: int) -> BoolArray:
    """Cells that are `size` times as large, each where one of its parts is."""
    padded = np.pad(cells, [(0, -extent % size) for extent in cells.shape])
    columns, rows = padded.shape[0] // size, padded.shape[1] // size
    return np.asarray(padded.reshape(columns, size, rows, size).any(axis=(1, 3)))


def _traced(cells: BoolArray) -> list[Corner]:
    """The boundary, the cells at its left.

    With its holes filled, a set of cells that is connected by edges touches itself at no corner.
    """
    filled = np.pad(ndimage.binary_fill_holes(cells), 1)
    inner = filled[1:-1, 1:-1]
    following: dict[tuple[int, int], tuple[int, int]] = {}
    for beside, (from_x, from_z), (to_x, to_z) in (
        (filled[1:-1, :-2], (0, 0), (1, 0)),
        (filled[2:, 1:-1], (1, 0), (1, 1)),
        (filled[1:-1, 2:], (1, 1), (0, 1)),
        (filled[:-2, 1:-1], (0, 1), (0, 0)),
    ):
        for x, z in np.argwhere(inner & ~beside).tolist():
            following[x + from_x, z + from_z] = (x + to_x, z + to_z)
    # The least corner is a corner of the outline.
    first = at = min(following)
    outline: list[Corner] = []
    while not outline or at != first:
        outline.append((float(at[0]), float(at[1])))
        at = following[at]
    outline = straightened([*outline, outline[0]])
    return outline[:-1]

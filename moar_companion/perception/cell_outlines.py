"""Outlines of cells of a grid, as simple polygons that cover exactly these cells.

A part that encloses free space is cut, so that no polygon covers the free space: an aircraft may be
inside.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt
from scipy import ndimage

BoolArray = npt.NDArray[np.bool_]
Corner = tuple[float, float]


def parts_of(
    cells: BoolArray, most_hole_cells: int, most_vertices: int = 200
) -> Iterator[tuple[BoolArray, list[Corner]]]:
    """Parts of cells (x, z), and the outline of each, counterclockwise in units of cells.

    The cells of a part share edges. A part around a hole of more than `most_hole_cells` cells is
    cut through the hole. A part with too many vertices is cut through its middle. Smaller holes are
    filled.
    """
    labels, _ = ndimage.label(cells)
    for label, box in enumerate(ndimage.find_objects(labels), 1):
        low = (box[0].start, box[1].start)
        for part, outline in _cut(labels[box] == label, most_hole_cells, most_vertices):
            whole = np.zeros_like(cells)
            whole[box] = part
            yield whole, [(x + low[0], z + low[1]) for x, z in outline]


def straightened(outline: list[Corner]) -> list[Corner]:
    """The outline without vertices inside a straight edge."""
    kept: list[Corner] = []
    for vertex in outline:
        if len(kept) >= 2 and any(
            kept[-2][axis] == kept[-1][axis] == vertex[axis] for axis in (0, 1)
        ):
            kept[-1] = vertex
        elif not kept or kept[-1] != vertex:
            kept.append(vertex)
    return kept


def _cut(
    cells: BoolArray, most_hole_cells: int, most_vertices: int
) -> Iterator[tuple[BoolArray, list[Corner]]]:
    """Parts of cells that share edges."""
    filled = ndimage.binary_fill_holes(cells)
    holes, count = ndimage.label(filled & ~cells)
    sizes = np.bincount(holes.ravel(), minlength=count + 1)[1:]
    if count and sizes.max() > most_hole_cells:
        across, _ = np.nonzero(holes == int(np.argmax(sizes)) + 1)
        axis, place = 0, int(across.min() + across.max() + 1) // 2
    else:
        outline = _traced(filled)
        if len(outline) <= most_vertices:
            yield filled, outline
            return
        axis = int(np.argmax(cells.shape))
        place = cells.shape[axis] // 2
    sides = np.arange(cells.shape[axis]) < place
    for side in (sides, ~sides):
        kept = cells & (side[:, None] if axis == 0 else side)
        yield from parts_of(kept, most_hole_cells, most_vertices)


def _traced(cells: BoolArray) -> list[Corner]:
    """The boundary, with the cells at its left.

    Without holes, a part whose cells share edges touches itself at no corner.
    """
    padded = np.pad(cells, 1)
    following: dict[tuple[int, int], tuple[int, int]] = {}
    for beside, (from_x, from_z), (to_x, to_z) in (
        (padded[1:-1, :-2], (0, 0), (1, 0)),
        (padded[2:, 1:-1], (1, 0), (1, 1)),
        (padded[1:-1, 2:], (1, 1), (0, 1)),
        (padded[:-2, 1:-1], (0, 1), (0, 0)),
    ):
        for x, z in np.argwhere(cells & ~beside).tolist():
            following[x + from_x, z + from_z] = (x + to_x, z + to_z)
    # The least corner is a corner of the outline.
    first = at = min(following)
    outline: list[Corner] = []
    while not outline or at != first:
        outline.append((float(at[0]), float(at[1])))
        at = following[at]
    return straightened([*outline, outline[0]])[:-1]

"""A table: exact costs to one goal for some weights, and so bounds for all weights."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from .grid import FloatArray, IntArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """Exact costs to go at the corners of triangles that cover all weights.

    For one goal and graph the cost to go of a state is a minimum over paths of functions that are
    linear in the weights, hence concave in them. Interpolated within a triangle, its corners'
    values are therefore a lower bound, and each corner's path costs no less: an upper one. Both
    hold for any triangle that holds the weights, so neighbours need not share their corners.

    roots:     (r, 3, 3)   times weights: their shares of a root triangle's corners
    triangles: (n, 4)      corners, and the first of the two triangles that it is cut into in the
                           middle of its first edge, that of the first corner; -1 if it is whole
    weights:   (c, 3)      of the corners
    costs_to_go, policies: (c, cells, M), of each corner; infinite and 0 where there is no path
    """

    roots: FloatArray
    triangles: IntArray
    weights: FloatArray
    costs_to_go: FloatArray
    policies: npt.NDArray[np.uint8]

"""Height of points above the ground: the lowest points of a grid, opened and filled."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
from scipy import ndimage

FloatArray = npt.NDArray[np.float64]

_CELL_M = 2.0
_OPENING_M = 18.0
"""Window wider than roofs and tree crowns without a point of ground beneath them."""
_MAX_CELLS = 4_000_000


def ground_height_m(points_m: FloatArray) -> FloatArray:
    """Height (n,) of the ground beneath each of (n, 3) points.

    The lowest point of each cell of 2 m (coarser for clouds of many kilometres), after a
    morphological opening over 18 m. The opening removes objects on the ground, as ground filters
    begin (Zhang et al. 2003, doi:10.1109/TGRS.2003.810682). Cells without points take the height of
    the nearest cell.
    """
    low = points_m[:, :2].min(axis=0)
    extent = np.ptp(points_m[:, :2], axis=0)
    cell_m = max(_CELL_M, math.sqrt(float(np.prod(extent + _CELL_M)) / _MAX_CELLS))
    cells = ((points_m[:, :2] - low) / cell_m).astype(np.intp)
    shape = cells.max(axis=0) + 1
    lowest = np.full(shape, np.inf)
    np.minimum.at(lowest, (cells[:, 0], cells[:, 1]), points_m[:, 2])
    empty = np.isinf(lowest)
    if empty.any():
        nearest = ndimage.distance_transform_edt(empty, return_distances=False, return_indices=True)
        lowest = lowest[tuple(nearest)]
    size = max(3, round(_OPENING_M / cell_m) | 1)
    # A single low point (an echo from below the ground) would lower the ground around it.
    level = ndimage.grey_opening(ndimage.median_filter(lowest, 3), (size, size))
    return np.asarray(level[cells[:, 0], cells[:, 1]])

"""Points of a search and lines through them: narrow neighbourhoods, and rows among other points.

A conductor that hangs alone is all that there is within metres of it: its neighbourhood is long and
narrow. Of several wires close to each other each is a row of points with a gap around it. A roof,
leaves and rows that are chance have points in the gap, too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Row:
    """A row of points, and the gap around it, of the same width.

    most_beside: greatest number of points in the gap per point in the row; a roof has 1, leaves 3.
    """

    radius_m: float
    least_points: int
    most_beside: float


_ROWS = (
    _Row(radius_m=0.12, least_points=6, most_beside=0.5),
    _Row(radius_m=0.3, least_points=8, most_beside=0.35),
)
"""For wires from 0.35 m and from 0.7 m apart."""
_GROWN = 1.4
"""Radius about a wire over the radius of its rows, whose lines have two points each."""
_NARROW = 0.16
"""Width over length of a neighbourhood up to which it is a wire or a bundle of four."""
_NEIGHBOURS = 64
"""Greatest number of points in a neighbourhood."""
_LEAST_POINTS = 5
_TRIES = 8
"""Number of rows that are tried through each point, for each radius."""
_PART = 20_000
"""Number of points that are processed at once, for the memory."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LocalLines:
    """Line through each of n points.

    directions: (n, 3); radius_m: (n,) within which a conductor's points lie, 0 for a point on no
    line.
    """

    directions: FloatArray
    radius_m: FloatArray

    def parallel(self, direction: FloatArray, least_cosine: float) -> BoolArray:
        """Points (n,) on lines along a horizontal direction (2,)."""
        return (self.radius_m > 0.0) & (abs(self.directions[:, :2] @ direction) > least_cosine)


def thinned(points_m: FloatArray, voxel_m: float) -> FloatArray:
    """One point of each voxel: the first."""
    voxels = (
        np.floor((points_m - points_m.min(axis=0)) / voxel_m).astype(np.int64)
        if len(points_m)
        else np.zeros((0, 3), dtype=np.int64)
    )
    sizes = voxels.max(axis=0) + 1 if len(voxels) else np.ones(3, dtype=np.int64)
    _, first = np.unique(
        (voxels[:, 0] * sizes[1] + voxels[:, 1]) * sizes[2] + voxels[:, 2], return_index=True
    )
    return points_m[np.sort(first)]


def local_lines(
    points_m: FloatArray,
    tree: KDTree,
    random: np.random.Generator,
    *,
    neighbourhood_m: float,
    max_width: float,
    bundle_radius_m: float,
) -> LocalLines:
    """The line through each of (n, 3) points.

    neighbourhood_m: radius of a neighbourhood; max_width: greatest width over length of a narrow
    one; bundle_radius_m: radius about the curve of a conductor that has it to itself.
    """
    count = len(points_m)
    lines = LocalLines(directions=np.zeros((count, 3)), radius_m=np.zeros(count))
    padded = np.vstack((points_m, np.full((1, 3), np.nan)))
    for part in np.array_split(np.arange(count), max(1, count // _PART)):
        _, neighbours = tree.query(
            points_m[part], k=_NEIGHBOURS, distance_upper_bound=neighbourhood_m
        )
        around = padded[neighbours]
        directions, width = _narrow(around)
        lines.directions[part] = directions
        lines.radius_m[part[width <= max_width]] = bundle_radius_m
        wide = np.flatnonzero(width > _NARROW)
        for row in _ROWS:
            in_row, along = _in_row(around[wide], row, random)
            found = part[wide[in_row]]
            lines.directions[found] = along[in_row]
            lines.radius_m[found] = _GROWN * row.radius_m
            wide = wide[~in_row]
    return lines


def _narrow(around: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Direction (n, 3) of neighbourhoods (n, k, 3), and their width (n,) over their length."""
    known = np.isfinite(around[:, :, 0]).sum(axis=1)
    offset = np.nan_to_num(around - np.nanmean(around, axis=1, keepdims=True))
    values, vectors = np.linalg.eigh(np.einsum("nki,nkj->nij", offset, offset))
    width = np.sqrt(np.maximum(values[:, 1], 0.0) / np.maximum(values[:, 2], 1e-12))
    return vectors[:, :, 2], np.where(known >= _LEAST_POINTS, width, np.inf)


def _in_row(
    around: FloatArray, row: _Row, random: np.random.Generator
) -> tuple[BoolArray, FloatArray]:
    """Neighbourhoods (n, k, 3) with a row through their first point, and its direction (n, 3)."""
    offset = around - around[:, :1]
    distance = np.sqrt(np.einsum("nki,nki->nk", offset, offset))
    most = np.zeros(len(around), dtype=np.int64)
    along = np.zeros((len(around), 3))
    # A line to a near point would miss the ends of its row.
    far = distance > 0.5 * np.nanmax(distance, axis=1, initial=0.0)[:, None]
    order = np.argsort(np.where(far, random.random(far.shape), 2.0), axis=1)
    each = np.arange(len(around))
    for partner in order[:, :_TRIES].T:
        line = offset[each, partner] / np.maximum(distance[each, partner], 1e-6)[:, None]
        run = np.einsum("nki,ni->nk", offset, line)
        off = np.sqrt(np.maximum(distance**2 - run**2, 0.0))
        on = (off <= row.radius_m).sum(axis=1)
        beside = (off <= 2.0 * row.radius_m).sum(axis=1) - on
        good = far[each, partner] & (on >= row.least_points) & (beside <= row.most_beside * on)
        better = good & (on > most)
        most[better], along[better] = on[better], line[better]
    return most > 0, along

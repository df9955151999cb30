"""Obstacles in the plane of a site besides conductors: ground, vegetation, towers.

Inputs: points near the plane (x, z) with their classes. Outputs: the surface of the ground and of
objects on it, landing places, and polygons.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..cell_outlines import parts_of, straightened
from ..spans import PointClass
from .site_document import Document, polygon

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

LANDING_REACH_M = 25.0
"""Greatest distance of a landing place beside the workspace."""
_CELL_M = 0.5
_FLOATING_GAP_M = 5.0
"""Least gap below a point that hangs; a point with a smaller gap is filled down to the ground."""
_LONE_M = 2.0
_LATTICE_M = 2.0
"""Half the width of holes in a tower that are filled."""
_MOST_HOLE_CELLS = round((2.0 * _LATTICE_M / _CELL_M) ** 2)
_ABOVE_GROUND_M = 0.5
_PROFILE_M = 0.2
"""Greatest difference of the profile of the ground from its columns."""
_LANDING_HEIGHT_M = 2.5


class Surface:
    """Highest points of ground and of objects on it, in columns of the plane."""

    def __init__(
        self, plane_m: FloatArray, classes: npt.NDArray[np.uint8], low_x: float, high_x: float
    ) -> None:
        self._low_x = low_x - LANDING_REACH_M - 5.0
        count = int((high_x - low_x + 2.0 * LANDING_REACH_M + 10.0) / _CELL_M)
        self._x_m = self._low_x + (np.arange(count) + 0.5) * _CELL_M
        standing = np.isin(classes, (PointClass.GROUND, PointClass.VEGETATION))
        columns = ((plane_m[:, 0] - self._low_x) / _CELL_M).astype(np.intp)
        standing &= (columns >= 0) & (columns < count)
        ground = standing & (classes == PointClass.GROUND)
        self.ground_m = _filled(_highest(columns[ground], plane_m[ground, 1], count))
        self.stands = np.zeros(len(plane_m), dtype=bool)
        """Points that stand on the ground instead of hanging above it."""
        tops = self.ground_m.copy()
        order = np.flatnonzero(standing)
        order = order[np.argsort(plane_m[order, 1])]
        for index in order:
            column = columns[index]
            around = tops[max(column - 1, 0) : column + 2].max()
            if plane_m[index, 1] <= around + _FLOATING_GAP_M:
                tops[column] = max(tops[column], plane_m[index, 1])
                self.stands[index] = True
        self.tops_m = tops

    def top_at(self, x_m: float, reach_m: float) -> float:
        """Highest top within a distance of x."""
        return float(self.tops_m[abs(self._x_m - x_m) <= reach_m].max())

    @cached_property
    def profile_m(self) -> list[tuple[float, float]]:
        """Profile of the ground, no lower than any column; empty where it is even.

        Corners are left out that change it by less than `_PROFILE_M`.
        """
        if float(np.abs(self.ground_m).max()) <= _ABOVE_GROUND_M:
            return []
        kept = _corners(np.column_stack((self._x_m, self.ground_m)))
        x_m, z_m = self._x_m[kept], self.ground_m[kept]
        z_m = z_m + float((self.ground_m - np.interp(self._x_m, x_m, z_m)).max())
        return list(zip(x_m.tolist(), (np.ceil(z_m * 100.0) / 100.0).tolist(), strict=True))

    def runs(self, low_x: float, high_x: float, above_m: float) -> Iterator[FloatArray]:
        """Left edges and tops (n, 2) of neighbouring columns that reach above the ground.

        Above its profile; where it is even, above 0.
        """
        level_m = np.interp(self._x_m, *np.array(self.profile_m or [(0.0, 0.0)]).T)
        inside = (self._x_m > low_x) & (self._x_m < high_x) & (self.tops_m > level_m + above_m)
        labels, count = ndimage.label(inside)
        for label in range(1, count + 1):
            run = labels == label
            yield np.column_stack((self._x_m[run] - _CELL_M / 2.0, self.tops_m[run]))

    def landing(self, edge_m: float, towards: float) -> tuple[float, float] | None:
        """Nearest even place with free space on it and before it, at hover height above it."""
        for distance in np.arange(4.0, LANDING_REACH_M, _CELL_M):
            x = edge_m + towards * distance
            patch = abs(self._x_m - x) <= 2.5
            before = (self._x_m - edge_m) * towards
            between = (before >= 0.0) & (before <= distance)
            ground = self.ground_m[patch]
            even = float(np.ptp(ground)) <= 0.6
            free = float((self.tops_m - self.ground_m)[patch].max()) <= _ABOVE_GROUND_M
            low = float(self.tops_m[between].max()) <= float(ground.max()) + 1.0
            if even and free and low:
                return float(x), float(ground.max()) + _LANDING_HEIGHT_M
        return None


def _corners(points_m: FloatArray) -> list[int]:
    """Indices of the points (n, 2) that keep the line within `_PROFILE_M` (Douglas-Peucker)."""
    kept, pending = [0, len(points_m) - 1], [(0, len(points_m) - 1)]
    while pending:
        first, last = pending.pop()
        between = points_m[first : last + 1]
        line_m = np.interp(between[:, 0], *between[[0, -1]].T)
        off_m = np.abs(between[:, 1] - line_m)
        farthest = int(off_m.argmax())
        if off_m[farthest] > _PROFILE_M:
            kept.append(first + farthest)
            pending += [(first, first + farthest), (first + farthest, last)]
    return sorted(kept)


def _highest(columns: npt.NDArray[np.intp], z_m: FloatArray, count: int) -> FloatArray:
    tops = np.full(count, -np.inf)
    np.maximum.at(tops, columns, z_m)
    return tops


def _filled(tops_m: FloatArray) -> FloatArray:
    """Tops with columns without points at the higher of the known ones at both sides."""
    known = np.flatnonzero(np.isfinite(tops_m))
    if not len(known):
        return np.zeros_like(tops_m)
    index = np.arange(len(tops_m))
    left = known[np.clip(np.searchsorted(known, index, "right") - 1, 0, len(known) - 1)]
    right = known[np.clip(np.searchsorted(known, index), 0, len(known) - 1)]
    return np.asarray(np.maximum(tops_m[left], tops_m[right]))


def polygons_of(
    plane_m: FloatArray,
    classes: npt.NDArray[np.uint8],
    surface: Surface,
    low_x: float,
    high_x: float,
    low_z: float,
    high_z: float,
) -> tuple[list[Document], FloatArray]:
    """Obstacles besides conductors, as polygons; and the lone points that were left out."""
    shapes: list[tuple[str, list[tuple[float, float]]]] = []
    for run in surface.runs(low_x, high_x, _ABOVE_GROUND_M):
        top = np.ceil(run[:, 1] * 10.0) / 10.0
        outline = [(run[0, 0], low_z - 1.0)]
        for (x, _), z in zip(run, top, strict=True):
            outline += [(x, z), (x + _CELL_M, z)]
        outline.append((run[-1, 0] + _CELL_M, low_z - 1.0))
        shapes.append(("ground", straightened(outline)))
    apart = ~surface.stands & np.isin(classes, (PointClass.VEGETATION, PointClass.TOWER))
    apart &= (plane_m[:, 0] > low_x) & (plane_m[:, 0] < high_x)
    apart &= (plane_m[:, 1] > low_z) & (plane_m[:, 1] < high_z)
    places = plane_m[apart]
    tower = classes[apart] == PointClass.TOWER
    alone = _alone(places) & ~tower
    left_out, places, tower = places[alone], places[~alone], tower[~alone]
    low = np.array([low_x - 3.0, low_z - 3.0])
    shape = ((np.array([high_x, high_z]) + 3.0 - low) / _CELL_M).astype(np.intp) + 1
    for kind, part in (("tower", places[tower]), ("hanging", places[~tower])):
        cells = ((part - low) / _CELL_M).astype(np.intp)
        occupied = np.zeros(shape, dtype=bool)
        occupied[cells[:, 0], cells[:, 1]] = True
        if kind == "tower":  # no aircraft fits the holes of a lattice
            occupied = ndimage.binary_closing(occupied, iterations=round(_LATTICE_M / _CELL_M))
        for _, outline in parts_of(ndimage.binary_dilation(occupied), _MOST_HOLE_CELLS):
            corners = [(low[0] + x * _CELL_M, low[1] + z * _CELL_M) for x, z in outline]
            shapes.append((kind, corners))
    numbers: dict[str, int] = {}
    polygons = []
    for kind, corners in shapes:
        numbers[kind] = numbers.get(kind, 0) + 1
        polygons.append(polygon(f"{kind}-{numbers[kind]}", corners))
    return polygons, left_out


def _alone(places: FloatArray) -> BoolArray:
    """Mask of points without another within 2 m."""
    distance = np.full(len(places), np.inf)
    for index, place in enumerate(places):
        offset = np.hypot(*(places - place).T)
        offset[index] = np.inf
        distance[index] = offset.min(initial=np.inf)
    return distance > _LONE_M

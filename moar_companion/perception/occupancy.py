"""Rolling occupancy of the plane of the site: present obstacles, as polygons.

A cell gains evidence with each scan that has echoes in it, and loses evidence with each scan that
measured beyond it. Rays within the slab about the plane clear cells up to the measured distance,
never behind a return. A ray without an echo clears nothing: the sensor may be covered.
"""

from __future__ import annotations

import math
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..planner.site import Polygon, Site
from .cell_outlines import parts_of
from .plane_rays import PlaneRays, sector_of

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
_Cell = TypeVar("_Cell", bound=np.generic)

_BORDER_M = 3.0
"""Border around workspace, start and landing places."""
_MOST_CELLS = 40_000
"""Greatest number of cells, since each scan updates all; larger planes have larger cells."""
_LEAST_SHARE = 0.03
"""Least share of the rays through a cell that end in it. Heavy rain has 0.006 at a cell of 0.3
m."""
_SPREAD_M = 5.0
"""Distance up to which the beams of a lidar stay within the slab; beyond it their number falls as
1/distance."""
_LEAST_PASSING = 3
_OCCUPIED, _GREATEST = 2.5, 5.0
"""Evidence, in scans with echoes, from which a cell is occupied; and its maximum."""
_PASSED = 0.3
"""Evidence that a scan removes when it measured beyond; leaves hit by a quarter of the scans
stay."""
_DECAY_PER_S = 1.0
"""Decay of a cell that is not occupied, so that single wrong echoes do not add up."""
_REMEMBERED_S = 60.0
"""Time without an echo after which an obstacle is removed: twice the visit of a target."""
_GONE_S, _EDGES_S = 1.0, 5.0
"""Least time between two changes of polygons: after a removal, and after an edge moved by a
cell."""
_FILLED_M = 1.0
"""Width of holes that are filled; no aircraft fits inside."""
_AROUND = np.ones((3, 3), dtype=bool)


class Occupancy:
    """Evidence of cells (x, z). The cells move with jumps of the position estimate."""

    def __init__(self, site: Site) -> None:
        corners = [site.workspace.lower_m, site.workspace.upper_m, site.start_m]
        corners += [place for places in site.landing_m.values() for place in places]
        lower = np.min(corners, axis=0) - _BORDER_M
        extent = np.max(corners, axis=0) + _BORDER_M - lower
        self._cell_m = max(
            site.workspace.resolution_m, math.sqrt(float(np.prod(extent)) / _MOST_CELLS)
        )
        # Cells of the workspace's grid.
        base = np.array(site.workspace.lower_m)
        self._lower_m = base - np.ceil((base - lower) / self._cell_m) * self._cell_m
        shape = np.ceil((lower + extent - self._lower_m) / self._cell_m).astype(int)
        self._shape = (int(shape[0]), int(shape[1]))
        middles = [
            self._lower_m[axis] + (np.arange(self._shape[axis]) + 0.5) * self._cell_m
            for axis in (0, 1)
        ]
        self._x_m, self._z_m = np.meshgrid(*middles, indexing="ij")
        self._offset_m = np.zeros(2)
        """Offset from the grid to the site: the sum of the jumps, at most half a cell."""
        self._evidence = np.zeros(self._shape)
        self._hit_s = np.full(self._shape, -math.inf)
        self._occupied = np.zeros(self._shape, dtype=bool)
        self._time_s: float | None = None
        self._shown = np.zeros(self._shape, dtype=bool)
        self._shown_s = -math.inf
        self._numbers = np.zeros(self._shape, dtype=int)
        """Number of the polygon that has a cell; 0 for none."""
        self._given = 0
        self._outlines: dict[int, tuple[tuple[float, float], ...]] = {}

    def add(
        self,
        rays: PlaneRays,
        points_m: FloatArray,
        solid: BoolArray,
        time_s: float,
        *,
        beams: int = 0,
        echoes: int = 1,
    ) -> None:
        """Takes the points (n, 3) of a scan, of which `solid` (n,) are of obstacles.

        beams: number of beams sent, where known. echoes: number in a cell below which echoes count
        as wrong.
        """
        elapsed_s = 0.0 if self._time_s is None else max(time_s - self._time_s, 0.0)
        self._time_s = time_s
        cells = ((points_m[:, [0, 2]] - self._offset_m - self._lower_m) / self._cell_m).astype(int)
        # Truncation rounds negative indices towards 0; the border is wider than a cell.
        within = solid & rays.inside & ((cells > 0) & (cells < self._shape)).all(axis=1)
        flat = cells[within, 0] * self._shape[1] + cells[within, 1]
        hits = np.bincount(flat, minlength=self._evidence.size).reshape(self._shape)
        x = self._x_m + self._offset_m[0] - rays.centre_m[0]
        z = self._z_m + self._offset_m[1] - rays.centre_m[1]
        distance = np.sqrt(x * x + z * z)
        sector = sector_of(x, z, rays.sectors)
        passing = rays.passing(self._cell_m, 0.75 * self._cell_m)
        step = np.minimum((distance / self._cell_m).astype(np.intp), passing.shape[1] - 1)
        wide = self._cell_m * rays.sectors / (2.0 * math.pi * np.maximum(distance, self._cell_m))
        passed = passing[sector, step] * np.maximum(wide, 1.0)
        # Beams into the sky have no points.
        sent = beams / rays.sectors * wide * np.minimum(_SPREAD_M / np.maximum(distance, 1e-6), 1.0)
        hit = (hits >= echoes) & (hits >= _LEAST_SHARE * np.maximum(hits + passed, sent))
        returned = within.copy()
        returned[within] = hit.reshape(-1)[flat]
        before = rays.nearest_m(returned)[sector]
        least = min(_LEAST_PASSING, echoes)
        cleared = ~hit & (passed >= least) & (distance + 0.75 * self._cell_m < before)
        self._evidence[hit] = np.minimum(self._evidence[hit] + 1.0, _GREATEST)
        self._hit_s[hit] = time_s
        self._evidence[cleared] -= _PASSED
        self._evidence[~self._occupied] -= _DECAY_PER_S * elapsed_s
        self._evidence[time_s - self._hit_s > _REMEMBERED_S] = 0.0
        np.maximum(self._evidence, 0.0, out=self._evidence)
        self._occupied = np.where(self._occupied, self._evidence > 0.0, self._evidence >= _OCCUPIED)
        self._show(time_s)

    def release(self, points_m: list[tuple[float, float]], within_m: float) -> None:
        """Clears the cells about places that are no solid obstacles but conductors."""
        for x, z in points_m:
            away = np.hypot(self._x_m + self._offset_m[0] - x, self._z_m + self._offset_m[1] - z)
            near = away < within_m + self._cell_m
            self._evidence[near] = 0.0
            self._occupied[near] = False

    def shift(self, x_m: float, z_m: float) -> None:
        """Moves all cells by a whole number of cells; the rest becomes the offset of the grid."""
        self._offset_m += (x_m, z_m)
        whole = np.round(self._offset_m / self._cell_m).astype(int)
        self._offset_m -= whole * self._cell_m
        moved = (int(whole[0]), int(whole[1]))
        self._evidence = _moved(self._evidence, moved, 0.0)
        self._hit_s = _moved(self._hit_s, moved, -math.inf)
        self._occupied = _moved(self._occupied, moved, False)
        self._shown = _moved(self._shown, moved, False)
        self._numbers = _moved(self._numbers, moved, 0)
        self._name_parts()

    @property
    def polygons(self) -> tuple[Polygon, ...]:
        """Outlines of occupied cells; unchanged as long as the cells are."""
        return tuple(
            Polygon(
                name=f"seen-solid-{number}",
                vertices_m=tuple(
                    (x + float(self._offset_m[0]), z + float(self._offset_m[1])) for x, z in outline
                ),
            )
            for number, outline in sorted(self._outlines.items())
        )

    def _show(self, time_s: float) -> None:
        """Updates the shown cells. A cell at an occupied edge stays shown: its evidence fluctuates.

        New cells beside shown ones, and removals, wait: each change makes new maps.
        """
        beside = ndimage.binary_dilation(self._occupied, _AROUND)
        shown = self._occupied | (self._shown & beside)
        if np.array_equal(shown, self._shown):
            return
        apart = shown & ~ndimage.binary_dilation(self._shown, _AROUND)
        gone = self._shown & ~ndimage.binary_dilation(beside, _AROUND)
        waits_s = 0.0 if apart.any() else _GONE_S if gone.any() else _EDGES_S
        if time_s - self._shown_s >= waits_s:
            self._shown, self._shown_s = shown, time_s
            self._name_parts()

    def _name_parts(self) -> None:
        """Gives each part the number that most of its cells had, the largest part first."""
        closed = ndimage.binary_closing(np.pad(self._shown, 1), _AROUND)[1:-1, 1:-1]
        parts = sorted(
            parts_of(closed, int((_FILLED_M / self._cell_m) ** 2)), key=lambda part: -part[0].sum()
        )
        numbers = np.zeros_like(self._numbers)
        self._outlines = {}
        for part, outline in parts:
            known = np.bincount(self._numbers[part], minlength=self._given + 1)
            known[[0, *self._outlines]] = 0
            number = int(np.argmax(known))
            if not known[number]:
                self._given += 1
                number = self._given
            numbers[part] = number
            self._outlines[number] = tuple(
                (
                    float(self._lower_m[0]) + x * self._cell_m,
                    float(self._lower_m[1]) + z * self._cell_m,
                )
                for x, z in outline
            )
        self._numbers = numbers


def _moved(cells: npt.NDArray[_Cell], by: tuple[int, int], empty: float) -> npt.NDArray[_Cell]:
    """The cells moved by whole numbers; cells from outside the grid are empty."""
    moved = np.full_like(cells, empty)
    into, out_of = [], []
    for step, extent in zip(by, cells.shape, strict=True):
        most = max(-extent, min(step, extent))
        into.append(slice(max(most, 0), extent + min(most, 0)))
        out_of.append(slice(max(-most, 0), extent + min(-most, 0)))
    moved[tuple(into)] = cells[tuple(out_of)]
    return moved

"""The paper's graph in the form that the search reads: flat, padded, one row of moves per cell."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from ..settings.vehicle import SpeedLimits, Vehicle
from .arrays import Steps
from .distance_kernels import steps_of
from .grid import TOLERANCE, FloatArray, Grid, IntArray, Moves
from .maps import Maps

_ROUNDING = 1e-12


@dataclass(frozen=True, kw_only=True, eq=False)
class Graph:
    """States are (cell, heading); all data of a step belong to the cell it arrives in.

    allowed:   (cells,)    bit h: move h may be made from the cell
    safety:    (cells,)    SC
    speed:     (cells, H)  v(d_obs, heading), zero for stop
    offset:    (H,)        step of a move in the flat index
    length_m:  (H,)        length of a move
    unit:      (H, d)      direction of a move
    place:     (cells, 3)  the cell's indices; a plane's third is 0
    axes:      (3, H)      `unit` by axes; a plane's third is 0
    pace:      (n, 3)      seconds per cell: times a displacement at most its least duration
    """

    grid: Grid
    moves: Moves
    v_max_mps: float
    heading_speed_mps: FloatArray
    allowed: IntArray
    safety: FloatArray
    speed: FloatArray
    offset: IntArray
    length_m: FloatArray
    unit: FloatArray
    place: FloatArray
    axes: FloatArray
    pace: FloatArray

    @cached_property
    def steps(self) -> Steps:
        """Arrays that the compiled search reads."""
        return Steps(*(getattr(self, name) for name in Steps._fields))


def heading_speeds_mps(speed: SpeedLimits) -> FloatArray:
    """v_max by heading of the plane: stop, then clockwise from up."""
    right = [
        speed.up_mps,
        speed.diagonal_up_mps,
        speed.horizontal_mps,
        speed.diagonal_down_mps,
        speed.down_mps,
    ]
    return np.array([0.0, *right, *right[3:0:-1]])


def elevation_speed_mps(speed: SpeedLimits, direction: FloatArray) -> FloatArray:
    """v_max in any direction (..., 2), interpolated over elevation between the headings."""
    elevation = np.arctan2(direction[..., 1], np.abs(direction[..., 0]))
    known = heading_speeds_mps(speed)[5:0:-1]
    between: FloatArray = np.interp(elevation, np.radians([-90.0, -45.0, 0.0, 45.0, 90.0]), known)
    return between


def build_graph(maps: Maps, vehicle: Vehicle) -> Graph:
    """The graph of a site's maps, independent of weights, start and goal."""
    grid = maps.grid
    moves, place, pace = _frame(grid, vehicle.speed)
    heading_speed = heading_speeds_mps(vehicle.speed)
    length_m = moves.cells * grid.resolution_m
    offset = moves.steps @ np.array(grid.strides)
    allowed, speed = steps_of(
        grid.padded(~maps.occupied, 0).view(np.uint8),
        np.asarray(grid.padded(maps.speed_limit_mps, 0.0), dtype=np.float64),
        heading_speed,
        offset,
        moves.needed,
    )
    graph = Graph(
        grid=grid,
        moves=moves,
        v_max_mps=vehicle.speed.max_mps,
        heading_speed_mps=heading_speed,
        allowed=allowed,
        safety=np.asarray(grid.padded(maps.safety_cost, 0.0), dtype=np.float64),
        speed=speed,
        offset=offset,
        length_m=length_m,
        unit=moves.unit,
        place=place,
        axes=_three_axes(moves.unit).T.copy(),
        pace=pace,
    )
    for array in vars(graph).values():
        if isinstance(array, np.ndarray):
            array.flags.writeable = False
    return graph


@lru_cache(maxsize=1)
def _frame(grid: Grid, speed: SpeedLimits) -> tuple[Moves, FloatArray, FloatArray]:
    """Data that no obstacle changes: moves, the cells' places and the least paces."""
    moves = Moves.of_plane()
    duration = moves.cells[1:] * grid.resolution_m / heading_speeds_mps(speed)[1:]
    return moves, _places(grid), least_paces(moves.steps[1:], duration)


def least_paces(steps: IntArray, duration: FloatArray) -> FloatArray:
    """Rows y, (n, 3), of which y.step <= duration holds for all moves: (m, d) cells, (m,) s.

    For any path, the sum of its durations is therefore at least y times its displacement. They
    are the corners of that polyhedron, where the bound is greatest.
    """
    dimensions = steps.shape[1]
    chosen = np.array(list(itertools.combinations(range(len(steps)), dimensions)))
    edges = steps[chosen].astype(np.float64)
    regular = np.abs(np.linalg.det(edges)) > TOLERANCE
    corners = np.linalg.solve(edges[regular], duration[chosen[regular]][..., None])[..., 0]
    within = (corners @ steps.T <= duration * (1.0 + _ROUNDING)).all(axis=1)
    paces = np.unique(np.round(corners[within] / duration.max(), 12), axis=0) * duration.max()
    return _three_axes(paces * (1.0 - 1e3 * _ROUNDING))


def _places(grid: Grid) -> FloatArray:
    """The indices of every padded cell along three axes, (cells, 3)."""
    padded = tuple(count + 2 for count in grid.shape)
    return _three_axes(np.indices(padded).reshape(len(padded), -1).T - 1.0)


def _three_axes(array: FloatArray) -> FloatArray:
    """An array (n, d) with zeros for the missing axes, (n, 3)."""
    whole = np.zeros((len(array), 3))
    whole[:, : array.shape[1]] = array
    return whole

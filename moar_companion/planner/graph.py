"""The paper's graph in the form that the search reads: flat, padded, one row of moves per cell."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..vehicle import SpeedLimits, Vehicle
from .grid import FloatArray, Grid, IntArray, Moves
from .maps import Maps


@dataclass(frozen=True, kw_only=True, eq=False)
class Graph:
    """States are (cell, heading); everything about a step is known at the cell it arrives in.

    allowed:   (cells,)    bit h: move h may be made from the cell
    safety:    (cells,)    SC
    speed:     (cells, H)  v(d_obs, heading), zero for stop
    duration:  (cells, H)  seconds of the move that arrives with this heading, zero for stop
    offset:    (H,)        step of a move in the flat index
    length_m:  (H,)        length of a move
    unit:      (H, d)      direction of a move
    """

    grid: Grid
    moves: Moves
    v_max_mps: float
    heading_speed_mps: FloatArray
    allowed: IntArray
    safety: FloatArray
    speed: FloatArray
    duration: FloatArray
    offset: IntArray
    length_m: FloatArray
    unit: FloatArray


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
    grid, moves = maps.grid, Moves.of_plane()
    heading_speed = heading_speeds_mps(vehicle.speed)
    length_m = moves.cells * grid.resolution_m
    limit = np.asarray(grid.padded(maps.speed_limit_mps, 0.0))
    speed = np.minimum(limit[:, None], heading_speed[None, :])
    duration = np.divide(length_m[None, :], speed, out=np.zeros_like(speed), where=speed > 0.0)
    graph = Graph(
        grid=grid,
        moves=moves,
        v_max_mps=vehicle.speed.max_mps,
        heading_speed_mps=heading_speed,
        allowed=np.asarray(grid.padded(moves.allowed(~maps.occupied), 0), dtype=np.uint32),
        safety=np.asarray(grid.padded(maps.safety_cost, 0.0), dtype=np.float64),
        speed=speed,
        duration=duration,
        offset=moves.steps @ np.array(grid.strides),
        length_m=length_m,
        unit=moves.unit,
    )
    for array in vars(graph).values():
        if isinstance(array, np.ndarray):
            array.flags.writeable = False
    return graph

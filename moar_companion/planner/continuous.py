"""J of a continuous path: for planners without a grid, and for this one.

Inputs: the maps of a site and points in its plane, joined by straight legs. Output: the sums of J,
infinite for a path that leaves the free cells. `polyline` defines the samples of a leg.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..settings.vehicle import SpeedLimits
from ..types import Weights
from .arrays import Field
from .graph import heading_speeds_mps
from .grid import FloatArray
from .maps import Maps
from .plan_values import Cost
from .polyline import path_sums

SAMPLES_PER_CELL = 4
OCCUPIED, FREE, CLEAR = 0, 1, 2
"""States of a cell: never entered; free in its centre; clear of every keep-out all over it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ContinuousCost:
    """J of continuous paths on the maps of one site."""

    field: Field
    v_max_mps: float

    @classmethod
    def on(
        cls, maps: Maps, speed: SpeedLimits, *, samples_per_cell: int = SAMPLES_PER_CELL
    ) -> ContinuousCost:
        """J on maps, for a vehicle's speeds."""
        grid = maps.grid
        # No point of a cell is farther from its centre than half a diagonal.
        clear = maps.room_m >= np.sqrt(0.5) * grid.resolution_m
        free = np.where(maps.occupied, OCCUPIED, np.where(clear, CLEAR, FREE)).astype(np.uint8)
        values = np.stack([maps.safety_cost, maps.speed_limit_mps], axis=-1)
        elevation_mps = heading_speeds_mps(speed)[5:0:-1].copy()
        for array in (free, values, elevation_mps):
            array.flags.writeable = False
        return cls(
            field=Field(
                values=values,
                free=free,
                elevation_mps=elevation_mps,
                left_m=float(grid.lower_m[0]),
                low_m=float(grid.lower_m[1]),
                cell_m=float(grid.resolution_m),
                spacing_m=grid.resolution_m / samples_per_cell,
            ),
            v_max_mps=speed.max_mps,
        )

    def of_path(
        self,
        points_m: FloatArray,
        velocity_mps: tuple[float, ...],
        weights: Weights,
        *,
        ends_at_rest: bool,
    ) -> Cost:
        """J of a path (n, 2) that is entered at a velocity, and its sums; infinite if not free."""
        vx, vz = velocity_mps
        safety, time, change = path_sums(
            np.ascontiguousarray(points_m, dtype=np.float64), vx, vz, ends_at_rest, self.field
        )
        energy = 0.5 * change / self.v_max_mps
        total = weights.safety * safety + weights.time * time + weights.energy * energy
        if not np.isfinite(safety):
            total = np.inf  # and no 0 times infinity
        return Cost(total=total, safety=safety, time=time, energy=energy)

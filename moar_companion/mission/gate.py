"""The gate: the last look at a setpoint before it leaves.

Pure: the setpoint and the maps in, a reason to refuse it out. A setpoint lies in a free cell of
the workspace, near the plane; or in the corridor of a leg that was checked when it was made.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from ..types import Vector

Occupancy = npt.NDArray[np.bool_]
Corridor = tuple[Vector, ...]

_TOLERANCE_M = 1e-9


def refusal(
    position_m: Vector,
    velocity_mps: Vector,
    *,
    cell: tuple[int, ...] | None,
    occupied: Occupancy,
    min_altitude_m: float | None,
    corridors_m: tuple[Corridor, ...],
    corridor_width_m: float,
    plane_tolerance_m: float,
) -> str | None:
    """Why a setpoint must not be sent; None when it may.

    position_m, velocity_mps: (x, y, z) in the site's frame. cell: of the position, None outside
    the workspace. corridors_m: the checked legs that may be flown now, by their points.
    """
    if not all(math.isfinite(value) for value in (*position_m, *velocity_mps)):
        return "the setpoint is not finite"
    if abs(position_m[1]) > plane_tolerance_m:
        return f"the setpoint is {abs(position_m[1]):.1f} m from the plane"
    low = min_altitude_m is not None and position_m[2] < min_altitude_m - _TOLERANCE_M
    if cell is not None and not occupied[cell] and not low:
        return None
    if any(distance_m(position_m, leg) <= corridor_width_m for leg in corridors_m):
        return None
    if cell is None:
        return "the setpoint is outside the workspace"
    return "the setpoint is too close to an obstacle or too low"


def distance_m(point_m: Vector, corridor_m: Corridor) -> float:
    """Distance from a point to a line through points, of which there is at least one."""
    point, line = np.array(point_m), np.array(corridor_m)
    starts, along = line[:-1], np.diff(line, axis=0)
    if not len(along):
        return math.dist(point_m, corridor_m[0])
    squares = (along**2).sum(axis=1)
    part = ((point - starts) * along).sum(axis=1) / np.where(squares > 0.0, squares, 1.0)
    nearest = starts + np.clip(part, 0.0, 1.0)[:, None] * along
    return float(np.sqrt(((nearest - point) ** 2).sum(axis=1)).min())

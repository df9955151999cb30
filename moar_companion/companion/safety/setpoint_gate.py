"""The setpoint gate: the last check of a setpoint before it is sent.

Pure: the setpoint and the maps in, a reason to refuse it out. A setpoint is in a free cell of the
workspace, near the plane; or in the corridor of a leg that was checked when it was made. From its
predecessor it moves no faster, and changes its speed no harder, than the vehicle may.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from ...texts.text_format import distance, exceeds
from ...types import Vector

Occupancy = npt.NDArray[np.bool_]
Distances = npt.NDArray[np.floating[Any]]
Corridor = tuple[Vector, ...]

_TOLERANCE_M = 1e-9
_TOLERANCE_MPS = 0.05
"""Speed that the rounding of corners adds."""
_HARDER = 4.0
"""Factor on the planned acceleration: a setpoint brakes twice as hard for an aircraft that falls
behind. At the same time it may turn, and begin or end to move over from another place."""
_MOST_PAIRS = 20_000
"""Limit of pairs of a point and a segment whose distances are computed at once, for its memory."""
_SMALL_CORNER = 0.15
"""Arcs are made of straights: fraction of the speed that turns from one to the next."""


class Refusal(NamedTuple):
    """Reason why a setpoint must not be sent. value, limit: in `unit`; None where it has none."""

    reason: str
    value: float | None = None
    limit: float | None = None
    unit: str | None = None


def refusal(
    position_m: Vector,
    velocity_mps: Vector,
    yaw_rad: float,
    *,
    cell: tuple[int, ...] | None,
    occupied: Occupancy,
    room_m: Distances,
    widened_m: float,
    margin_m: float = 0.0,
    min_altitude_m: float | None,
    corridors_m: tuple[Corridor, ...],
    legs_from_beside_m: tuple[Corridor, ...] = (),
    corridor_width_m: float,
    plane_tolerance_m: float,
) -> Refusal | None:
    """Reason why a setpoint must not be sent, by its position; None if it may be sent.

    position_m, velocity_mps: (x, y, z) in the site's frame. yaw_rad: the heading. cell: of the
    position, None outside the workspace. room_m: from the hull in each cell to the nearest
    keep-out. widened_m: inflation of keep-outs for a setpoint that moves; a hold in free space
    needs no better position. Below 0 it reduces the margin of keep-outs. margin_m: part of
    keep-outs for the errors of a flight; inside it a stop is safer than further flight.
    corridors_m: the checked legs that may be flown now, by their points; they lead through cells
    that are not free, or too near. legs_from_beside_m: those of them that begin beside the plane.
    """
    if not all(math.isfinite(value) for value in (*position_m, *velocity_mps, yaw_rad)):
        return Refusal("setpoint not finite")
    aside_m = abs(position_m[1])
    if aside_m > plane_tolerance_m and not any(
        distance_m(position_m, leg) <= corridor_width_m for leg in legs_from_beside_m
    ):
        reason = f"setpoint {distance(aside_m)} m from the plane"
        return Refusal(reason, aside_m, plane_tolerance_m, "m")
    low = min_altitude_m is not None and position_m[2] < min_altitude_m - _TOLERANCE_M
    moves = any(velocity_mps)
    free = cell is not None and not low and (not occupied[cell] or widened_m <= room_m[cell] < 0.0)
    if free and (not moves or room_m[cell] >= widened_m - _TOLERANCE_M):
        return None
    if cell is not None and not moves and not low and -margin_m <= room_m[cell] < 0.0:
        return None
    if any(distance_m(position_m, leg) <= corridor_width_m for leg in corridors_m):
        return None
    if free:
        reason = f"setpoint too close to an obstacle (widened by {widened_m:.1f} m)"
        return Refusal(reason, float(room_m[cell]), widened_m, "m")
    if cell is None:
        return Refusal("setpoint outside the workspace")
    return Refusal("setpoint near an obstacle, or low")


def motion_refusal(
    before: tuple[Vector, Vector] | None,
    after: tuple[Vector, Vector],
    elapsed_s: float,
    *,
    greatest_mps: float,
    least_mps: float,
    acceleration_mps2: float,
    drifting_at_m: Vector | None = None,
) -> Refusal | None:
    """Reason why a setpoint must not be sent, by its motion; None if it may be sent.

    before, after: position and velocity of the setpoint that was sent `elapsed_s` ago, None for the
    first one, and of this one. greatest_mps: the vehicle's speed; least_mps: speed of a setpoint
    that moves over to its path. drifting_at_m: position of an aircraft that wind moves; at rest,
    the setpoint may move to there at any speed.
    """
    if drifting_at_m is not None and before is not None and not any(after[1]):
        nearer = math.dist(after[0], drifting_at_m) <= math.dist(before[0], drifting_at_m)
        return None if nearer else Refusal("setpoint leaves drifting aircraft")
    speed_mps = math.hypot(*after[1])
    # A setpoint may begin to move over while it still brakes on its path.
    most_mps = greatest_mps + least_mps
    too_fast = exceeds("setpoint at", speed_mps, most_mps, "m/s")
    if too_fast is not None and speed_mps > most_mps + _TOLERANCE_MPS:
        return Refusal(too_fast, speed_mps, most_mps, "m/s")
    if before is None:
        return None
    moved_m = math.dist(before[0], after[0])
    most_m = (most_mps + _TOLERANCE_MPS) * elapsed_s + _TOLERANCE_M
    if moved_m > most_m:
        return Refusal(f"setpoint jumps by {distance(moved_m)} m", moved_m, most_m, "m")
    changed_mps = math.dist(before[1], after[1])
    small_mps = max(least_mps, _SMALL_CORNER * greatest_mps)
    most_change_mps = _HARDER * acceleration_mps2 * elapsed_s + small_mps + _TOLERANCE_MPS
    if changed_mps > most_change_mps:
        reason = f"setpoint speed jump {distance(changed_mps)} m/s"
        return Refusal(reason, changed_mps, most_change_mps, "m/s")
    return None


def distance_m(point_m: Vector, corridor_m: Corridor) -> float:
    """Distance from a point to a line through points, of which there is at least one."""
    return float(distances_m(np.array([point_m]), corridor_m)[0])


def distances_m(points_m: Distances, corridor_m: Corridor) -> Distances:
    """Distances from points (n, 3) to a line through points: (n,)."""
    line = np.array(corridor_m)
    if len(line) == 1:
        line = np.concatenate([line, line])
    blocks = np.array_split(points_m, 1 + len(points_m) * len(line) // _MOST_PAIRS)
    return np.concatenate([_distances_m(block, line) for block in blocks])


def _distances_m(points_m: Distances, line: Distances) -> Distances:
    points = points_m[:, None]
    starts, along = line[:-1], np.diff(line, axis=0)
    squares = (along**2).sum(axis=1)
    part = ((points - starts) * along).sum(axis=2) / np.where(squares > 0.0, squares, 1.0)
    nearest = starts + np.clip(part, 0.0, 1.0)[..., None] * along
    return np.asarray(np.sqrt(((nearest - points) ** 2).sum(axis=2)).min(axis=1))

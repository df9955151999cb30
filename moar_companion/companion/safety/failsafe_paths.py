"""Straight paths of failsafe and offboard-loss actions, and the obstacles on them. Pure.

Inputs: actions as the autopilot's profile reads them from its parameters; places in the plane; the
reach to obstacles. Outputs: the obstacle that an action would hit from each place, and the reason
why a flight should not be flown.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ...mavlink.autopilots.failsafe_actions import (
    AutopilotAction,
    FailsafeAction,
    Failsafes,
    ReturnHeight,
)
from ...mavlink.autopilots.offboard_loss import OffboardLoss
from ...planner.free_distance import FreeDistance
from ...planner.grid import TOLERANCE, BoolArray, FloatArray, IntArray
from ...types import Vector

_LEAST_M = 1e-9
"""Least length of a path."""
_DOWN = frozenset({AutopilotAction.LAND, AutopilotAction.DESCEND, AutopilotAction.FALL})
STAYS = frozenset({AutopilotAction.NONE, AutopilotAction.HOLD})
"""Actions after which the aircraft stays in place; the others have paths."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Hit:
    """Obstacle on a path. index: of the first place with a path that hits it."""

    obstacle: str
    index: int


Path = tuple[FloatArray, FloatArray]
"""Straight paths: starts (n, 2) and ends (n, 2)."""


def failsafe_hit(
    failsafes: Failsafes, reach: FreeDistance, places_m: FloatArray, *, drifting: bool = False
) -> tuple[FailsafeAction, Hit] | None:
    """First action that would hit an obstacle from these places (n, 2), and its hit.

    drifting: includes the drift to the side.
    """
    for item in failsafes.actions:
        drift_m = item.drift_m if drifting else 0.0
        candidates = paths(item.action, item.home, reach, places_m, failsafes.home_m, drift_m)
        found = first_hit(reach, candidates, from_within=True)
        if found is not None:
            return item, found
    return None


def exposed_places(
    failsafes: Failsafes, reach: FreeDistance, places_m: FloatArray, *, drifting: bool = False
) -> BoolArray:
    """Mask (n,) of the places (n, 2) from which an action hits an obstacle.

    drifting: as in `failsafe_hit`.
    """
    mask = np.zeros(len(places_m), dtype=np.bool_)
    looked_at: set[tuple[AutopilotAction, ReturnHeight | None, float]] = set()
    for item in failsafes.actions:
        drift_m = item.drift_m if drifting else 0.0
        down = item.action in _DOWN
        case = (AutopilotAction.LAND, None, drift_m) if down else (item.action, item.home, drift_m)
        if case in looked_at:
            continue
        looked_at.add(case)
        action, home, _ = case
        for starts_m, ends_m in paths(action, home, reach, places_m, failsafes.home_m, drift_m):
            free_m, length_m, *_, there = _free_lengths(reach, starts_m, ends_m, from_within=True)
            mask[there] |= free_m < length_m
    return mask


def spare_drift_m(
    failsafes: Failsafes,
    reach: FreeDistance,
    places_m: FloatArray,
    *,
    radius_m: float,
    margin_m: float,
) -> FloatArray:
    """Drift to the side, beyond the expected one, in which no action hits an obstacle: (n,).

    By places (n, 2). The margin, which the keep-outs of `reach` contain, is a part of the drift,
    not added to it. A place from where a return hits an obstacle has minus infinity.
    """
    grid, spare_m = reach.grid, np.full(len(places_m), np.inf)
    blocked = reach.clearances.room_m < radius_m - margin_m - TOLERANCE
    cells = np.floor((places_m - np.array(grid.lower_m)) / grid.resolution_m)
    x, z = np.clip(cells, 0, np.array(grid.shape) - 1).astype(np.int64).T
    outside_m = np.abs(cells[:, 0] - x) * grid.resolution_m
    for item in failsafes.actions:
        down = item.action in _DOWN
        if down or item.action is AutopilotAction.DRIFT:
            barred = np.logical_or.accumulate(blocked, axis=1) if down else blocked
            free_m = _aside_m(barred, grid.resolution_m)[x, z] + outside_m
            np.minimum(spare_m, free_m - max(item.drift_m, margin_m), out=spare_m)
        else:
            alone = replace(failsafes, actions=(item,))
            spare_m[exposed_places(alone, reach, places_m)] = -np.inf
    return spare_m


def _aside_m(barred: BoolArray, resolution_m: float) -> FloatArray:
    """Level distance from the centre of each cell (nx, nz) to the nearest barred one of its row.

    Negative in a barred cell.
    """
    index, far = np.arange(len(barred))[:, None], np.inf
    before = np.maximum.accumulate(np.where(barred, index, -far), axis=0)
    after = np.minimum.accumulate(np.where(barred, index, far)[::-1], axis=0)[::-1]
    apart = np.minimum(index - before, after - index)
    return np.asarray((apart - 0.5) * resolution_m)


def loss_objection(
    loss: OffboardLoss, reach: FreeDistance, rests_m: FloatArray, home_m: Vector | None
) -> str | None:
    """Reason why an offboard loss at these stop points (n, 2) is unsafe; None if it is safe.

    home_m: (x, y, z) in the site's frame. Only the site's obstacles are known. A return is
    checked as far as it lies in the plane; without a home, only its climb.
    """
    if loss.objection_anywhere is not None or loss.action is AutopilotAction.HOLD:
        return loss.objection_anywhere
    candidates = paths(loss.action, loss.home, reach, rests_m, home_m)
    hit = first_hit(reach, candidates, from_within=True)
    return None if hit is None else loss.collision(hit.obstacle)


def paths(
    action: AutopilotAction,
    home: ReturnHeight | None,
    reach: FreeDistance,
    places_m: FloatArray,
    home_m: Vector | None,
    drift_m: float = 0.0,
) -> list[Path]:
    """Straight paths of an action; none if it stays in place. Any other counts as a return.

    home_m: (x, y, z) in the site's frame. A return has its path in the plane, without a home only
    its climb. drift_m: a descent has a path from every cell within this distance to the side; a
    hold of the height drifts level by it.
    """
    x_m, z_m = places_m.T
    if action is AutopilotAction.DRIFT:
        return [(places_m, places_m + np.array([aside_m, 0.0])) for aside_m in (-drift_m, drift_m)]
    if action in _DOWN:
        cells = math.ceil(drift_m / reach.grid.resolution_m)
        asides_m = np.linspace(-drift_m, drift_m, 2 * cells + 1).tolist() if cells else [0.0]
        return [_descent(reach, x_m + aside_m, z_m) for aside_m in sorted(asides_m, key=abs)]
    if action in STAYS:
        return []
    if home_m is None or home is None:
        return [(places_m, np.stack([x_m, np.full_like(z_m, reach.grid.upper_m[1])], axis=1))]
    home_x_m, home_y_m, home_z_m = home_m
    heights = [
        home.height_m(z - home_z_m, math.hypot(x - home_x_m, home_y_m))
        for x, z in places_m.tolist()
    ]
    top_m = home_z_m + np.array(heights)
    above = np.stack([x_m, top_m], 1)
    above_home = np.stack([np.full_like(x_m, home_x_m), top_m], 1)
    if reach.ground is not None:  # it lands on the ground there, which is nothing that it hits
        home_z_m = max(home_z_m, float(reach.descent_end_m(np.array([home_x_m]))[0]))
    down = np.tile([home_x_m, home_z_m], (len(x_m), 1))
    return [(places_m, above), (above, above_home), (above_home, down)]


def _descent(reach: FreeDistance, x_m: FloatArray, z_m: FloatArray) -> Path:
    """Straight paths down from places to the ground; of length 0 for a place near the ground."""
    end_m = reach.descent_end_m(x_m)
    if reach.ground is not None:
        end_m = np.minimum(z_m, end_m)
    return np.stack([x_m, z_m], axis=1), np.stack([x_m, end_m], axis=1)


def first_hit(
    reach: FreeDistance, candidates: list[Path], *, from_within: bool = False
) -> Hit | None:
    """First obstacle on these paths, and the index of its place; None without one.

    from_within: includes an obstacle with the start inside its keep-out, unless the path leaves it.
    """
    for starts_m, ends_m in candidates:
        free_m, length_m, starts, direction, there = _free_lengths(
            reach, starts_m, ends_m, from_within=from_within
        )
        hits = np.flatnonzero(free_m < length_m)
        if len(hits):
            first = int(hits[0])
            beyond_m = free_m[first] + 0.5 * reach.grid.resolution_m
            x_m, z_m = starts[first] + beyond_m * direction[first]
            return Hit(obstacle=reach.nearest((float(x_m), float(z_m))), index=int(there[first]))
    return None


def _free_lengths(
    reach: FreeDistance, starts_m: FloatArray, ends_m: FloatArray, *, from_within: bool
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, IntArray]:
    """Free length of straight paths, and their length on the grid, both in metres.

    With their starts on the grid, their directions and their indices. Paths are clipped to the
    grid: they are checked cell by cell, and a home may be wrong by thousands of kilometres.
    """
    along = ends_m - starts_m
    borders = np.array([reach.grid.lower_m, reach.grid.upper_m])[:, None]
    parts = (borders - starts_m) / np.where(np.abs(along) > _LEAST_M, along, _LEAST_M)
    entered = np.clip(parts.min(axis=0).max(axis=1), 0.0, 1.0)
    left = np.clip(parts.max(axis=0).min(axis=1), 0.0, 1.0)
    there = np.flatnonzero(entered < left)
    starts = starts_m[there] + entered[there, None] * along[there]
    along = (left - entered)[there, None] * along[there]
    length_m = np.hypot(along[:, 0], along[:, 1])
    direction = along / np.where(length_m > 0.0, length_m, 1.0)[:, None]
    free_m = length_m
    if len(there):
        farthest_m = float(length_m.max())
        free_m = reach.free_m(starts, direction, farthest_m)
        if from_within:
            free_m[reach.leads_inwards(starts, direction)] = 0.0
        np.minimum(free_m, reach.over_ground_m(starts, direction, farthest_m), out=free_m)
    return free_m, length_m, starts, direction, there

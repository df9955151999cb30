"""Refuges from the autopilot's own actions: places near by from where these hit nothing. Pure.

Inputs: failsafes, the site's maps, places in the plane. Outputs: what each cell tolerates beyond
the expected drift, and the places from where no leg leads to a cell that tolerates it.
"""

from __future__ import annotations

import numpy as np

from ...mavlink.autopilots.failsafe_actions import Failsafes
from ...planner.escape import refuge_leg
from ...planner.grid import BoolArray, FloatArray
from ...planner.maps import Maps
from ...planner.site import Site
from ...settings.vehicle import Vehicle
from .failsafe_paths import spare_drift_m

BLIND_LEG_M = 5.0
"""Longest leg without a fix: a longer one would be flown on an estimate that is off by more. It may
be longer than `blind_leg_m`: then the landing begins on the way out, and ArduPilot's later."""
_LANDS_S = 5.0
"""Time from the loss of the fix to PX4's landing; ArduPilot's comes 7.9 s after it."""
_NOTICED_S = 1.5
"""Time from the loss of the fix until the aircraft leaves or brakes: the receiver's reports, and
`blind_landing`."""


def blind_leg_m(vehicle: Vehicle) -> float:
    """Length of the leg that ends before the autopilot lands, with the braking before it."""
    speed_mps, acceleration_mps2 = vehicle.speed.horizontal_mps, vehicle.guidance.acceleration_mps2
    change_s = speed_mps / acceleration_mps2
    left_s = max(0.0, _LANDS_S - _NOTICED_S - change_s)
    if left_s < 2.0 * change_s:
        return min(BLIND_LEG_M, 0.25 * acceleration_mps2 * left_s**2)
    return min(BLIND_LEG_M, speed_mps * (left_s - change_s))


def spare_in_cells_m(failsafes: Failsafes, site: Site, vehicle: Vehicle, maps: Maps) -> FloatArray:
    """Drift to spare in each cell, (nx, nz), as `spare_drift_m`; minus infinity where occupied."""
    spare_m, free = np.full(maps.grid.shape, -np.inf), ~maps.occupied
    centres_m = np.array(maps.grid.lower_m) + (np.argwhere(free) + 0.5) * maps.grid.resolution_m
    spare_m[free] = spare_at_m(failsafes, site, vehicle, maps, centres_m)
    return spare_m


def spare_at_m(
    failsafes: Failsafes, site: Site, vehicle: Vehicle, maps: Maps, places_m: FloatArray
) -> FloatArray:
    """Drift to spare at places (n, 2): (n,), as `spare_drift_m`."""
    return spare_drift_m(
        failsafes,
        maps.reach,
        places_m,
        radius_m=vehicle.radius_m,
        margin_m=site.margin.total_m,
    )


def unprotected(
    failsafes: Failsafes, site: Site, vehicle: Vehicle, maps: Maps, places_m: FloatArray
) -> BoolArray:
    """Mask (n,) of places (n, 2) from where an action hits an obstacle, and no leg ends in time."""
    mask = spare_at_m(failsafes, site, vehicle, maps, places_m) < 0.0
    if not mask.any():
        return mask
    spare_m, longest_m = spare_in_cells_m(failsafes, site, vehicle, maps), blind_leg_m(vehicle)
    for index in np.flatnonzero(mask):
        start_m = float(places_m[index, 0]), float(places_m[index, 1])
        end_m = refuge_leg(site, vehicle, maps, start_m, spare_m, longest_m=longest_m)
        cell = None if end_m is None else maps.grid.cell_of(end_m)
        mask[index] = cell is None or not spare_m[cell] >= 0.0
    return mask

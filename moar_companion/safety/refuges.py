"""Refuges from the autopilot's own actions: places near by from where these hit nothing. Pure.

Inputs: failsafes, the site's maps, places in the plane. Outputs: what each cell tolerates beyond
the expected drift, and the places from where no leg leads to a cell that tolerates it.
"""

from __future__ import annotations

import numpy as np

from ..autopilots.failsafe_actions import Failsafes
from ..planner.escape import refuge_leg
from ..planner.grid import BoolArray, FloatArray
from ..planner.maps import Maps
from ..site import Site
from ..vehicle import Vehicle
from .failsafe_paths import spare_drift_m

BLIND_LEG_M = 5.0
"""Longest leg without a fix: at 1 m/s2 it takes 4.5 s, and PX4 lands 5 s after the loss. A longer
one would be flown on an estimate that is off by more."""


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
    """Mask (n,) of places (n, 2) from where an action hits an obstacle, and no short leg helps."""
    mask = spare_at_m(failsafes, site, vehicle, maps, places_m) < 0.0
    if not mask.any():
        return mask
    spare_m = spare_in_cells_m(failsafes, site, vehicle, maps)
    for index in np.flatnonzero(mask):
        start_m = float(places_m[index, 0]), float(places_m[index, 1])
        end_m = refuge_leg(site, vehicle, maps, start_m, spare_m, longest_m=BLIND_LEG_M)
        cell = None if end_m is None else maps.grid.cell_of(end_m)
        mask[index] = cell is None or not spare_m[cell] >= 0.0
    return mask

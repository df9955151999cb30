"""The escape leg: out of an occupied or outside cell that is not inside an obstacle.

A gust, a low take-off or a new obstacle can leave the vehicle where nothing is planned. The leg is
the shortest straight one to a free cell along which the clearance never decreases (planner page,
"Starts in flight"); it is flown at v_MIN or below.
"""

from __future__ import annotations

import numpy as np

from ..site import PlanePoint, Site
from .grid import TOLERANCE
from .maps import Maps
from .regions import obstacle_clearance_m

_SAMPLES_PER_CELL = 10
_REACH_M = 10.0
"""An aircraft that is farther from any free cell is not near the structure at all."""


def escape_leg(site: Site, maps: Maps, start_m: PlanePoint) -> PlanePoint | None:
    """The centre of the free cell at the end of the escape leg; None if there is no such leg."""
    start = np.array(start_m)
    here = float(obstacle_clearance_m(site, start))
    if here <= 0.0:
        return None
    grid = maps.grid
    cells = np.argwhere(~maps.occupied)
    centres = np.array(grid.lower_m) + (cells + 0.5) * grid.resolution_m
    distance = np.hypot(*(centres - start).T)
    near = np.flatnonzero(distance <= _REACH_M)
    for index in near[np.argsort(distance[near], kind="stable")]:
        samples = 2 + int(distance[index] / grid.resolution_m * _SAMPLES_PER_CELL)
        along = np.linspace(0.0, 1.0, samples)[:, None]
        clearance = obstacle_clearance_m(site, start + along * (centres[index] - start))
        # Infinite without obstacles: then nothing decreases.
        if (clearance[1:] >= clearance[:-1] - TOLERANCE).all():
            return float(centres[index, 0]), float(centres[index, 1])
    return None

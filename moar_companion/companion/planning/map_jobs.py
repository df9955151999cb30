"""Map jobs: maps of a site whose obstacles or settings have changed, made in the planner's thread.

A job leaves the machine as a value, and its answer enters the machine as another, as for plan jobs.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...planner.escape import pocket
from ...planner.maps import Maps
from ...planner.site import Site, Target
from ...settings.vehicle import Vehicle
from .planner_set import PlannerSet
from .site_maps import SiteMaps

_LARGE = 0.5
"""Least share of the free cells in the region of a target that was moved."""


@dataclass(frozen=True, slots=True, kw_only=True)
class MapJob:
    """A site with its present obstacles, and the number that its answer carries.

    slack_m: greatest distance by which a blocked target is moved.
    """

    job_id: int
    site: Site
    slack_m: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class SettingsJob(MapJob):
    """A map job with other settings: the vehicle is another one, the site has its margin."""

    vehicle: Vehicle


@dataclass(frozen=True, slots=True, kw_only=True)
class MapAnswer:
    """The maps of a job; None: the planner has failed. Targets of the site may have moved."""

    job_id: int
    site_maps: SiteMaps | None


def answer_map_job(planners: PlannerSet, job: MapJob) -> MapAnswer:
    """Makes the maps; from now on the planners use them. After an error they are as before."""
    site = job.site
    with planners.exact.all_or_nothing():
        planners.set_site(site, job.vehicle if isinstance(job, SettingsJob) else None)
        maps = planners.exact.maps
        targets = tuple(_moved(target, maps, job.slack_m) for target in site.targets)
        if targets != site.targets:
            site = replace(site, targets=targets)
            planners.set_site(site)
    return MapAnswer(job_id=job.job_id, site_maps=SiteMaps(site=site, maps=planners.exact.maps))


def _moved(target: Target, maps: Maps, slack_m: float) -> Target:
    """The target, moved to the nearest free cell within `slack_m` where its own is not free.

    The moved target looks at the original place. Cells of small regions, as between conductors, are
    left out.
    """
    grid, free = maps.grid, ~maps.occupied
    cell = grid.cell_of(target.position_m)
    if cell is None or free[cell]:
        return target
    columns, rows = grid.axes_m
    distance_m = np.hypot(
        columns[:, None] - target.position_m[0], rows[None] - target.position_m[1]
    )
    most = _LARGE * free.sum()
    while (free & (distance_m <= slack_m)).any():
        nearest = np.unravel_index(np.where(free, distance_m, np.inf).argmin(), free.shape)
        place_m = (float(columns[nearest[0]]), float(rows[nearest[1]]))
        region = pocket(maps, place_m)
        if region.sum() >= most:
            look_at_m = target.look_at_m or target.position_m
            return replace(target, position_m=place_m, look_at_m=look_at_m)
        free &= ~region
    return target

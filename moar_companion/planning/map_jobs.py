"""Map jobs: maps of a site whose obstacles have changed in flight, made in the planner's thread.

A job leaves the machine as a value, and its answer enters the machine as another, as plan jobs do.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from ..estimation.pose_tracker import SiteMaps
from ..planner.grid import BoolArray
from ..planner.maps import Maps
from ..site import Site, Target
from .planner_set import PlannerSet

_NEIGHBOURS = np.ones((3, 3))


@dataclass(frozen=True, slots=True, kw_only=True)
class MapJob:
    """A site as it is seen now, with the number that its answer carries.

    slack_m: distance by which a target is moved out of what keeps it from being reached.
    """

    job_id: int
    site: Site
    slack_m: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class MapAnswer:
    """The maps of a job; None: the planner has failed. Targets of their site may have moved."""

    job_id: int
    site_maps: SiteMaps | None


def answer_map_job(planners: PlannerSet, job: MapJob) -> MapAnswer:
    """Makes the maps; from now on the planners plan on them."""
    site = job.site
    planners.set_site(site)
    free = _main_region(planners.exact.maps)
    targets = tuple(
        _moved(target, planners.exact.maps, free, job.slack_m) for target in site.targets
    )
    if targets != site.targets:
        site = replace(site, targets=targets)
        planners.set_site(site)
    return MapAnswer(job_id=job.job_id, site_maps=SiteMaps(site=site, maps=planners.exact.maps))


def _main_region(maps: Maps) -> BoolArray:
    """Cells (nx, nz) of the largest free region: pockets between conductors are left out."""
    labels, count = ndimage.label(~maps.occupied, _NEIGHBOURS)
    if not count:
        return np.zeros(maps.grid.shape, dtype=np.bool_)
    largest = 1 + int(np.argmax(np.bincount(labels.ravel())[1:]))
    return np.asarray(labels == largest)


def _moved(target: Target, maps: Maps, free: BoolArray, slack_m: float) -> Target:
    """The target, at the nearest free cell within `slack_m` where its own is not free.

    It then looks at where it was.
    """
    cell = maps.grid.cell_of(target.position_m)
    if cell is None or free[cell] or not free.any():
        return target
    cells = np.argwhere(free)
    centres_m = np.array(maps.grid.lower_m) + maps.grid.resolution_m * (cells + 0.5)
    distance_m = np.hypot(*(centres_m - np.array(target.position_m)).T)
    nearest = int(distance_m.argmin())
    if distance_m[nearest] > slack_m:
        return target
    x_m, z_m = centres_m[nearest].tolist()
    return replace(target, position_m=(x_m, z_m), look_at_m=target.look_at_m or target.position_m)

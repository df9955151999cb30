"""Crowding: the part of the margin that blocks a plan."""

from __future__ import annotations

from collections.abc import Callable

from .plane_fence import PlaneFence
from .planner import Planner


def blocking_part(
    planner: Planner, finds: Callable[[Planner], bool], fence: PlaneFence | None = None
) -> str | None:
    """The least part of the site's margin without which there is a plan; None if there is none.

    finds: True if a planner of the same site with less margin has the plan. fence: as it is flown.
    """
    margin = planner.site.margin
    parts = {
        f"tracking error {margin.tracking_m:g} m": margin.tracking_m,
        f"position error {margin.position_m:g} m": margin.position_m,
        str(margin): margin.total_m,
    }
    for words, part_m in parts.items():
        if part_m and finds(
            Planner(
                planner.site,
                planner.vehicle,
                position_uncertainty_m=-part_m,
                fence=fence,
                clock=planner.clock,
            )
        ):
            return (
                f"the margin of {margin.total_m:g} m beyond keep-outs leaves no path; there is "
                f"one without {words}"
            )
    return None

"""Reasons of a plan without a path, as text. Pure."""

from __future__ import annotations

import numpy as np

from .maps import Maps
from .plan_values import PlanStatus
from .site import Site

_WORDS = {
    PlanStatus.OUT_OF_BOUNDS: "is outside the workspace",
    PlanStatus.START_OCCUPIED: "is too close to an obstacle or too low",
    PlanStatus.TARGET_OCCUPIED: "is too close to an obstacle or too low",
    PlanStatus.UNREACHABLE: "cannot be reached: no free path leads there",
}


def reason_of(
    status: PlanStatus, what: str, point_m: tuple[float, ...] | None, site: Site, maps: Maps
) -> str:
    """Returns the reason: the subject, its point, and the rule that excludes it.

    what: the start, the goal or a target. point_m: (x, z); None for a goal of several cells.
    """
    if point_m is None:
        return f"{what} {_WORDS[status]}"
    why = _WORDS[status]
    if status is PlanStatus.OUT_OF_BOUNDS:
        why = _uncovered(point_m, site, maps) or why
    fence = maps.fence
    crossed = None if fence is None else fence.crossed(np.array([point_m[:2]]))
    if crossed is not None and fence is not None:
        why = f"is outside the autopilot's fence, {crossed}, less {fence.margin_m:g} m"
    return f"{what} at ({point_m[0]:g}, {point_m[1]:g}) {why}"


def _uncovered(point_m: tuple[float, ...], site: Site, maps: Maps) -> str | None:
    """Reason of a point within the workspace that no cell holds; None for one outside."""
    space, grid = site.workspace, maps.grid
    if space.outside_m((point_m[0], point_m[1])):
        return None
    ends = zip("xz", point_m, grid.upper_m, space.upper_m, strict=True)
    strips = [
        f"{axis} {covered:g} to {upper:g}" for axis, at, covered, upper in ends if at > covered
    ]
    return (
        f"is in the strip of the workspace that no whole cell of {grid.resolution_m:g} m "
        f"covers ({', '.join(strips)})"
    )

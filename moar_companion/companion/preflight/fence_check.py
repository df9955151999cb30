"""Conflicts of the autopilot's fence with a site: the reported fence in, findings out. Pure.

Uses the same functions as in flight: `Profile.fence`, `plane_fence`, and plans within the fence.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...mavlink.autopilots.fence import Fence
from ...planner.plan_values import PlanStatus
from ...planner.plane_fence import PlaneFence
from ...planner.planner import Planner
from ...planner.site import PlanePoint
from ...types import Mission, Vector
from ..estimation.site_fence import fenced, plane_fence
from .findings import Finding, Level
from .site_routes import routes_of, unseen

SUBJECT = "fence"
_WIDEN = "widen the autopilot's fence, or move it"


def fence_findings(
    planner: Planner | None, fence: Fence, home_m: Vector | None, margin_m: float, *, reported: bool
) -> list[Finding]:
    """Returns all findings on the autopilot's fence.

    planner: of the site, without the fence; None without a site. home_m: in the site's frame, None
    if unknown. reported: True if the autopilot has reported its uploaded areas.
    """
    found = [_summary(fence)]
    if not reported:
        found.append(
            Finding(
                level=Level.WARNING,
                subject="uploaded fence",
                text="unknown, the autopilot does not answer: plans may cross it",
                remedy="check again over a better link, or look it up in the ground station",
            )
        )
    if planner is None or not fence.names:
        return found
    if fence.about_home and home_m is None:
        return [
            *found,
            Finding(
                level=Level.NO_GO,
                subject=SUBJECT,
                text="the fence is relative to home, and home is unknown",
                remedy="wait for a position, then check again",
            ),
        ]
    plane = plane_fence(fence, planner.site.frame, home_m, margin_m)
    height_m = planner.vehicle.guidance.landing_height_m
    cut = fenced(plane, planner.site, height_m)
    if cut is None:
        text = "the whole site and its landing points are inside"
        return [*found, Finding(level=Level.OK, subject=SUBJECT, text=text)]
    return [*found, *_source(fence), *_outside(planner, cut)]


def _summary(fence: Fence) -> Finding:
    if not fence.names:
        return Finding(level=Level.OK, subject=SUBJECT, text="none")
    text = f"{', '.join(fence.names)}; outside the autopilot would {fence.action}"
    if fence.overrules_land:
        text += ", and replace a LAND that is ordered there by that hold"
    return Finding(level=Level.NOTE, subject=SUBJECT, text=text)


def _source(fence: Fence) -> Iterator[Finding]:
    if fence.source_gnss:
        yield Finding(
            level=Level.WARNING,
            subject=fence.source_gnss,
            text="1: the fence is judged by the receiver's position, not by the estimator's",
            remedy="set 0, or add the receiver's error to supervision.fence_margin_m",
        )


def _outside(planner: Planner, fence: PlaneFence) -> Iterator[Finding]:
    """Yields findings on places and routes of the site that are outside."""
    site, vehicle = planner.site, planner.vehicle
    inner = Planner(site, vehicle, fence=fence, clock=planner.clock)
    places = [
        ("start", site.start_m, Level.WARNING),
        *((f"target {item.name}", item.position_m, Level.NO_GO) for item in site.targets),
    ]
    clear = True
    for subject, point, level in places:
        crossed = fence.crossed(np.array([point]))
        if crossed is not None:
            clear = False
            yield _finding(level, subject, f"{_shown(point)} is outside {crossed}", fence)
    for mission in (Mission.EXIT, Mission.EVACUATION):
        for index, point in enumerate(site.landing_m.get(mission, ())):
            if unseen(inner, mission, index) is None or unseen(planner, mission, index):
                continue
            clear = False
            above = np.array([[point[0], point[1] + vehicle.guidance.landing_height_m]])
            crossed = fence.crossed(above) or ", ".join(bound.name for bound in fence.bounds)
            text = f"{_shown(point)} cannot be reached inside {crossed}"
            yield _finding(Level.NO_GO, f"landing {mission.value} {index}", text, fence)
    inside = routes_of(inner)
    for target, routes in routes_of(planner).items():
        kept = {route.name: route.plan.status for route in inside.get(target, ())}
        for route in routes:
            if route.plan.status is not PlanStatus.FOUND or route.name not in kept:
                continue
            if kept[route.name] is not PlanStatus.FOUND:
                clear = False
                crossed = fence.crossed(route.plan.waypoints.position_m)
                text = f"{route.name}: no path inside {crossed}"
                yield _finding(Level.NO_GO, f"target {target}", text, fence)
    if clear:
        text = f"all targets and routes keep {fence.margin_m:g} m from it"
        yield Finding(level=Level.OK, subject=SUBJECT, text=text)


def _finding(level: Level, subject: str, text: str, fence: PlaneFence) -> Finding:
    return Finding(
        level=level, subject=subject, text=f"{text}, less {fence.margin_m:g} m", remedy=_WIDEN
    )


def _shown(point_m: PlanePoint) -> str:
    return f"({point_m[0]:g}, {point_m[1]:g})"

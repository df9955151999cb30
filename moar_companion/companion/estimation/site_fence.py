"""The site fence: the autopilot's fence in the site's plane.

Inputs: the fence, home, the site's frame, the margin. Outputs: a `PlaneFence`, or the reason why it
is unknown. Circles and polygons become intervals of x without the parts nearer to their border than
the margin. Heights count from home. Pure.

The fence is kept for every fence action: it is a limit that the operator has set.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable

import numpy as np

from ...mavlink.autopilots import profile
from ...mavlink.autopilots.fence import Area, Fence, Limit
from ...mavlink.autopilots.parameter_names import Parameters
from ...mavlink.telemetry import FenceItem
from ...planner.plane_fence import Bound, Interval, PlaneFence
from ...planner.site import Site
from ...planner.site_frame import SiteFrame
from ...types import AutopilotKind, Vector
from .pose import home_moved

_UNREAD = "autopilot's fence not read yet"
_NO_HOME = "fence about home, home unknown"
_HOME_MOVES_M = 0.1
"""A smaller move of home, as of its estimate, is covered by the fence's margin. One metre, the
tolerance for a return route, would be most of that margin."""
_OFFSET_STEP_M = 0.1
"""Step of the line's offset: a smaller change makes no other fence."""
_Intervals = tuple[Interval, ...]
_Place = tuple[float, float]
_EVERYWHERE: _Intervals = ((-math.inf, math.inf),)


class SiteFence:
    """Keeps the last reported fence, also while it is requested again."""

    def __init__(self, site: Site | None, margin_m: float) -> None:
        self._site = site
        self._margin_m = margin_m
        self._reported: tuple[object, ...] = ()
        self._home_m: Vector | None = None
        """Home of the last fence calculation."""
        self._placed: Fence | None = None
        """The source of `plane`; None before the first fence."""
        self.plane: PlaneFence | None = None
        """In the site's plane; None where there is no fence, or none is known."""
        self.not_ready_reason: str | None = _UNREAD
        """Reason why no mission can start; None once the fence's place is known."""

    def take_margin(self, margin_m: float) -> None:
        """Takes another margin: the next `learn` places the fence by it."""
        if margin_m != self._margin_m:
            self._margin_m, self._reported = margin_m, ()

    @property
    def is_placed(self) -> bool:
        """True once a fence, or that there is none, was known with its place."""
        return self._placed is not None

    def learn(
        self,
        kind: AutopilotKind,
        parameters: Parameters,
        items: tuple[FenceItem, ...] | None,
        home_m: Vector | None,
        *,
        enabled: bool = False,
        offset_x_m: float = 0.0,
    ) -> None:
        """Takes the reported fence. items: None while the uploaded fence is still requested.

        enabled: SYS_STATUS reports a fence. home_m: (x, y, z) in the site's frame; None where
        unknown. offset_x_m: of the line's frame, in which the plane is: the autopilot keeps its
        fence by its own estimate.
        """
        offset_x_m = round(offset_x_m / _OFFSET_STEP_M) * _OFFSET_STEP_M
        if self._site is None or items is None:
            return
        reported = (
            kind,
            items,
            enabled,
            offset_x_m,
            *(parameters.get(name, "") for name in profile(kind).fence_parameters),
        )
        before, self._reported = self._reported, reported
        if reported == before and not home_moved(home_m, self._home_m, _HOME_MOVES_M):
            return
        fence = profile(kind).fence(parameters, items, enabled=enabled)
        if fence is None:
            return
        self._home_m = home_m
        if fence.about_home and home_m is None:
            if fence != self._placed:
                self.not_ready_reason = _NO_HOME
            return
        self.not_ready_reason, self._placed = None, fence
        frame, margin_m = self._site.frame, self._margin_m
        self.plane = plane_fence(fence, frame, home_m, margin_m, offset_x_m)


def plane_fence(
    fence: Fence,
    frame: SiteFrame,
    home_m: Vector | None,
    margin_m: float,
    offset_x_m: float = 0.0,
) -> PlaneFence | None:
    """A fence in the plane of a site; None where the fence has no limits.

    home_m: required for limits about home. margin_m: minimum distance from the fence; a greater
    margin of the autopilot replaces it. offset_x_m: added to the places of areas.
    """
    margin_m = max(margin_m, fence.margin_m)
    bounds: list[Bound] = []
    if home_m is not None:
        bounds += _about_home(fence, home_m, margin_m)
    together: _Intervals = ()
    for area in fence.areas:
        intervals = _area_intervals(area, frame, margin_m)
        x_m = tuple((low + offset_x_m, high + offset_x_m) for low, high in intervals)
        if fence.union and area.inclusion:
            together = _united(together, x_m)
        else:
            bounds.append(Bound(name=area.name, x_m=x_m))
    if fence.union and any(area.inclusion for area in fence.areas):
        bounds.append(Bound(name="inclusion areas", x_m=together))
    return PlaneFence(bounds=tuple(bounds), margin_m=margin_m) if bounds else None


def fenced(fence: PlaneFence | None, site: Site, landing_height_m: float) -> PlaneFence | None:
    """The part of a fence that can restrict a plan on a site; None: no part."""
    if fence is None:
        return None
    space = site.workspace
    landings = [point for points in site.landing_m.values() for point in points]
    above = [(x_m, z_m + landing_height_m) for x_m, z_m in landings]
    return fence.cutting(np.array([space.lower_m, space.upper_m, *above]))


def _about_home(fence: Fence, home_m: Vector, margin_m: float) -> Iterable[Bound]:
    x_m, y_m, z_m = home_m
    if fence.circle is not None:
        kept = _disk(x_m, y_m, fence.circle.value_m - margin_m)
        yield Bound(name=str(fence.circle), x_m=kept)
    for limit, low in ((fence.ceiling, False), (fence.floor, True)):
        if limit is not None:
            yield Bound(name=str(limit), z_m=_heights(limit, z_m, margin_m, low=low))


def _heights(limit: Limit, home_z_m: float, margin_m: float, *, low: bool) -> Interval:
    height_m = home_z_m + limit.value_m
    return (height_m + margin_m, math.inf) if low else (-math.inf, height_m - margin_m)


def _area_intervals(area: Area, frame: SiteFrame, margin_m: float) -> _Intervals:
    """Intervals of the plane's line (y = 0) within an inclusion, or outside an exclusion."""
    places = [frame.place_of(*vertex) for vertex in area.vertices_deg]
    if area.radius_m is not None:
        ((x_m, y_m),) = places
        if area.inclusion:
            return _disk(x_m, y_m, area.radius_m - margin_m)
        return _without(_EVERYWHERE, _disk(x_m, y_m, area.radius_m + margin_m))
    edges = list(zip(places, [*places[1:], places[0]], strict=True))
    inside = _inside(edges)
    kept = inside if area.inclusion else _without(_EVERYWHERE, inside)
    for start, end in edges:
        kept = _without(kept, _near_edge(start, end, margin_m))
    return kept


def _disk(x_m: float, y_m: float, radius_m: float) -> _Intervals:
    """Interval of the line within a circle."""
    if radius_m <= abs(y_m):
        return ()
    half_m = math.sqrt(radius_m**2 - y_m**2)
    return ((x_m - half_m, x_m + half_m),)


def _inside(edges: Iterable[tuple[_Place, _Place]]) -> _Intervals:
    """Intervals of the line inside a polygon (even-odd rule, as in both autopilots)."""
    crossings = sorted(
        x0 + (x1 - x0) * y0 / (y0 - y1) for (x0, y0), (x1, y1) in edges if (y0 > 0.0) != (y1 > 0.0)
    )
    return tuple(zip(crossings[::2], crossings[1::2], strict=True))


def _near_edge(start: _Place, end: _Place, margin_m: float) -> _Intervals:
    """Interval of the line nearer to an edge than the margin: one, since that area is convex."""
    (x0, y0), (x1, y1) = start, end
    reached = [x_m for x, y in (start, end) for part in _disk(x, y, margin_m) for x_m in part]
    length_m = math.hypot(x1 - x0, y1 - y0)
    if length_m > 0.0 and margin_m > 0.0:
        across_x, across_y = (y0 - y1) / length_m * margin_m, (x1 - x0) / length_m * margin_m
        corners = [
            (x0 + across_x, y0 + across_y),
            (x1 + across_x, y1 + across_y),
            (x1 - across_x, y1 - across_y),
            (x0 - across_x, y0 - across_y),
        ]
        sides = zip(corners, [*corners[1:], corners[0]], strict=True)
        reached += itertools.chain.from_iterable(_inside(sides))
    return ((min(reached), max(reached)),) if reached else ()


def _without(kept: _Intervals, parts: _Intervals) -> _Intervals:
    """Intervals less the open inside of others."""
    for low, high in parts:
        kept = tuple(
            piece
            for start, end in kept
            for piece in ((start, min(end, low)), (max(start, high), end))
            if piece[0] < piece[1]
        )
    return kept


def _united(some: _Intervals, others: _Intervals) -> _Intervals:
    united: list[Interval] = []
    for low, high in sorted((*some, *others)):
        if united and low <= united[-1][1]:
            united[-1] = (united[-1][0], max(high, united[-1][1]))
        else:
            united.append((low, high))
    return tuple(united)

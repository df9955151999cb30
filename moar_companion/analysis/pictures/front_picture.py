"""The picture of a trade-off: the best paths for all weights, the weights for each, and the others.

Inputs: a plan, the fronts of its problem, site and maps. Output: one figure in a file.
"""

from __future__ import annotations

from os import PathLike
from typing import IO, Any

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import Normalize

from ...planner.analysis.pareto import Supported
from ...planner.grid import FloatArray
from ...planner.maps import Maps
from ...planner.plan_values import Plan
from ...planner.site import Site
from ...planner.whole_front import WholeFront, effort_weights
from ...settings.vehicle import Vehicle
from .figure import DPI, INK, Page, page_style
from .labels import place_labels
from .plan_marks import draw_goal
from .site_axes import COLOUR_BAR_IN, draw_colour_bars, draw_plane, view_of

_COLOURS = colormaps["viridis"]
_OWN = "#e4002b"
"""Colour of the requested plan."""

_FAINT = "#b8b8b8"

# The page, in inches.
_LEFT, _PLANE_WIDTH, _RIGHT = 0.75, 7.6, 0.15
_TITLE, _BELOW = 0.65, 0.6
_GAP, _TRIANGLE_WIDTH = 0.95, 4.4
_TRADE_OFFS_WIDTH = 4.4
_CORNERS = np.array([[0.5, np.sqrt(0.75)], [0.0, 0.0], [1.0, 0.0]])
"""Corners where safety, time and energy alone count."""


def draw_front(
    plan: Plan,
    front: list[Supported],
    whole: WholeFront | None,
    site: Site,
    vehicle: Vehicle,
    maps: Maps,
    file: str | PathLike[str] | IO[bytes],
    file_format: str = "png",
) -> None:
    """Draw a plan among the front of its problem, also an empty one, into a file."""
    with page_style():
        page = _draw_page(plan, front, whole, site, vehicle, maps)
        page.figure.savefig(file, format=file_format, dpi=DPI)


def _draw_page(
    plan: Plan,
    front: list[Supported],
    whole: WholeFront | None,
    site: Site,
    vehicle: Vehicle,
    maps: Maps,
) -> Page:
    paths = [point.plan.waypoints.position_m[: len(point.plan.states)] for point in front]
    x_m, z_m = plan.request.start_m
    view = view_of(site, vehicle, [(x_m, z_m)])
    height_in = _PLANE_WIDTH * (view[3] - view[2]) / (view[1] - view[0])
    triangle_left_in = _LEFT + _PLANE_WIDTH + COLOUR_BAR_IN + _GAP
    page = Page(
        triangle_left_in + _TRIANGLE_WIDTH + _GAP + _TRADE_OFFS_WIDTH + _RIGHT,
        _TITLE + max(height_in, 0.95 * _TRIANGLE_WIDTH) + _BELOW,
    )
    times = np.array([point.sums[1] for point in front])
    norm = Normalize(times.min(initial=np.inf), times.max(initial=-np.inf)) if front else None
    colours = ScalarMappable(norm, _COLOURS)

    plane = page.panel(_LEFT, _BELOW, _PLANE_WIDTH, height_in)
    draw_plane(plane, site, maps, view)
    draw_goal(plane, site, maps, plan.mission, plan.request.target, None)
    plane.add_collection(
        LineCollection(paths, colors=colours.to_rgba(times), linewidth=1.6, zorder=6),
        autolim=False,
    )
    own = plan.waypoints.position_m[: len(plan.states)]
    plane.plot(*own.T, color=_OWN, linewidth=1.4, linestyle=(0, (2, 1.6)), zorder=7)
    plane.plot(x_m, z_m, marker="o", markersize=8, color="white", markeredgecolor=INK, zorder=8)
    if front:
        draw_colour_bars(plane, [(colours, "time (s), without landing leg")])
    place_labels(plane, own)

    triangle = page.panel(triangle_left_in, _BELOW, _TRIANGLE_WIDTH, 0.95 * _TRIANGLE_WIDTH)
    _draw_triangle(triangle, plan, front, colours.to_rgba(times))
    trade_offs_left_in = triangle_left_in + _TRIANGLE_WIDTH + _GAP
    if whole is not None:
        panel = page.panel(trade_offs_left_in, _BELOW, _TRADE_OFFS_WIDTH, 0.9 * _TRIANGLE_WIDTH)
        _draw_trade_offs(panel, plan, whole)
    _draw_title(page, plan, len(front))
    return page


def _draw_triangle(axes: Any, plan: Plan, front: list[Supported], colours: FloatArray) -> None:
    """All weights: for each path of the front, the region in which it is the best."""
    axes.set_axis_off()
    axes.set_aspect("equal")
    axes.set_xlim(-0.12, 1.12)
    axes.set_ylim(-0.12, 1.0)
    regions = [point.region @ _CORNERS for point in front]
    axes.add_collection(
        PolyCollection(regions, facecolors=colours, edgecolors="white", linewidths=0.5)
    )
    axes.plot(*_CORNERS[[0, 1, 2, 0]].T, color=INK, linewidth=1.0)
    weights = np.array((plan.weights.safety, plan.weights.time, plan.weights.energy))
    axes.plot(*(weights @ _CORNERS), marker="*", markersize=13, color=_OWN, markeredgecolor="white")
    names = ("safety alone", "time alone", "energy alone")
    for (x, y), name, offset in zip(_CORNERS, names, (0.04, -0.04, -0.04), strict=True):
        axes.text(x, y + offset, name, ha="center", va="center", fontsize=9)


def _draw_trade_offs(axes: Any, plan: Plan, whole: WholeFront) -> None:
    """All trade-offs of safety and effort; filled those that weighted sums reach."""
    supported = whole.supported
    axes.step(whole.first, whole.second, where="post", color=_FAINT, linewidth=1.0, zorder=1)
    for chosen, colour, words in (
        (supported, INK, "best for some weights"),
        (~supported, "white", "between them"),
    ):
        axes.plot(
            whole.first[chosen],
            whole.second[chosen],
            linestyle="none",
            marker="o",
            markersize=5,
            color=colour,
            markeredgecolor=INK,
            label=f"{words}: {chosen.sum()}",
        )
    if plan.cost is not None:
        effort = effort_weights(plan.weights)
        own = effort.time * plan.cost.time + effort.energy * plan.cost.energy
        axes.plot(
            plan.cost.safety,
            own,
            linestyle="none",
            marker="*",
            markersize=13,
            color=_OWN,
            markeredgecolor="white",
            label="the plan",
        )
    axes.set_xlabel("safety cost")
    axes.set_ylabel("time and energy cost, in the plan's proportion")
    axes.legend(loc="upper right", frameon=False, fontsize=9)


def _draw_title(page: Page, plan: Plan, count: int) -> None:
    target = "" if plan.request.target is None else f" of {plan.request.target}"
    found = (
        f"the best paths for all weights, {count}; red: for the weights asked for"
        if count
        else f"no plan, {plan.reason}"
    )
    page.title(_LEFT, plan.site, f"{plan.mission.value.capitalize()}{target}: {found}")

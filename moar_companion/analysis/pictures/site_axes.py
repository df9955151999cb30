"""The plane of a site over its safety map, on any axes (paper, Fig. 1, 3 and 9).

Inputs: a site and its maps. `view_of` selects the part to show, and `draw_plane` draws it. The
helpers below, here and in `plan_marks`, draw areas, names at the border and colour bars.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.patches import Circle, Rectangle
from matplotlib.patches import Polygon as PolygonPatch
from matplotlib.ticker import MultipleLocator

from ...planner.grid import BoolArray
from ...planner.maps import Maps, too_low
from ...planner.site import Conductor, PlanePoint, Site
from ...settings.vehicle import Vehicle
from .figure import INK
from .labels import label

View = tuple[float, float, float, float]
"""Visible part of the plane, m: least and greatest x, least and greatest z."""

COLOUR_BAR_IN = 0.88
"""Width of a colour bar with its figures."""

_OUTSIDE = "#f1f2f4"
_OCCUPIED = "#45484d"
_TOO_LOW = "#b4b8be"
_SOLID = "#17181b"
_EARTH = "#8a7a66"
_SAFETY = LinearSegmentedColormap.from_list(
    "safety cost", ["#fffdf7", "#fee3b8", "#fdb56d", "#ee7a35", "#b8420f"]
)
"""White to burnt orange: apart from the blues of the path for every kind of colour vision."""

_REACH = 0.5
"""Distance outside the workspace that is still shown, as part of its greater extent."""
_MARGIN = 0.03
_FLOOR_POINTS = 500
"""Points of the line of the minimum altitude above a profile of the ground."""
_TICKS = 9
"""Ticks along the longer side, at most; the shorter side has the same step,"""
_FEW_TICKS = 4
"""unless it would then have fewer than these."""
_FLATTEST, _TALLEST = 0.3, 0.9
"""Height over width of the view: flatter or taller ones are filled up with surroundings."""


def view_of(site: Site, vehicle: Vehicle, points_m: list[PlanePoint]) -> View:
    """Part of the plane in a picture: the workspace, obstacles that matter, and the points.

    Obstacles are shown as far as they cost safety; points that lie so far off that they would
    squeeze the workspace are left outside.
    """
    space = site.workspace
    lower, upper = np.array(space.lower_m), np.array(space.upper_m)
    extent_m = float((upper - lower).max())
    reach_m = _REACH * extent_m
    obstacle_reach_m = min(vehicle.safety.d_max_m, reach_m)
    seen = [lower, upper]
    for obstacle in site.obstacles:
        low, high = lower - obstacle_reach_m, upper + obstacle_reach_m
        seen += [np.clip(point, low, high) for point in obstacle.outline_m]
    seen += [np.clip(p, lower - reach_m, upper + reach_m) for p in points_m]
    margin_m = _MARGIN * extent_m
    low, high = np.min(seen, axis=0) - margin_m, np.max(seen, axis=0) + margin_m
    width_m, height_m = high - low
    wider_m = max(0.0, height_m / _TALLEST - width_m)
    taller_m = max(0.0, _FLATTEST * width_m - height_m)
    return (
        float(low[0] - 0.5 * wider_m),
        float(high[0] + 0.5 * wider_m),
        float(low[1] - 0.5 * taller_m),
        float(high[1] + 0.5 * taller_m),
    )


def draw_plane(axes: Any, site: Site, maps: Maps, view: View) -> ScalarMappable:
    """Draw the site over its safety map; returns the map's colours, for a colour bar."""
    set_up_plane(axes, view)
    heat: ScalarMappable = axes.imshow(
        maps.safety_cost.T,
        extent=_extent(maps),
        origin="lower",
        cmap=_SAFETY,
        norm=Normalize(0.0, 1.0),
        interpolation="nearest",
        zorder=1,
        aspect="equal",
    )
    low, altitude_m = too_low(site, maps.grid), site.workspace.min_altitude_m
    paint(axes, maps, maps.occupied & ~low, _OCCUPIED, "occupied")
    paint(axes, maps, low, _TOO_LOW, "too low")
    x_low, x_high, z_low, z_high = _extent(maps)
    if site.ground is not None:
        outline_m = site.ground.vertices_m
        axes.add_patch(PolygonPatch(outline_m, facecolor=_EARTH, linewidth=0.0, zorder=2.5))
        _explain(axes, _EARTH, "ground")
    x_m = np.linspace(x_low, x_high, 2 if site.ground is None else _FLOOR_POINTS)
    floor_m = site.workspace.floor_m(x_m)
    if floor_m.min() < z_high and floor_m.max() > z_low:
        axes.plot(
            x_m,
            floor_m,
            color=INK,
            linewidth=1.0,
            linestyle=(0, (6, 2, 1, 2)),
            label=f"minimum altitude {altitude_m:g} m{' above ground' if site.ground else ''}",
            zorder=3,
        )
    lower, upper = site.workspace.lower_m, site.workspace.upper_m
    axes.add_patch(
        Rectangle(
            lower,
            upper[0] - lower[0],
            upper[1] - lower[1],
            fill=False,
            edgecolor=INK,
            linewidth=1.3,
            zorder=3,
        )
    )
    _draw_obstacles(axes, site, view)
    axes.set_xlim(view[:2])
    axes.set_ylim(view[2:])
    return heat


def draw_colour_bars(axes: Any, bars: list[tuple[ScalarMappable, str]]) -> None:
    """Colour bars to the right of axes, as high as these are."""
    axes.apply_aspect()
    width_in = axes.get_position().width * axes.figure.get_figwidth()
    for index, (colours, name) in enumerate(bars):
        left_in = 0.18 + COLOUR_BAR_IN * index
        box = axes.inset_axes([1.0 + left_in / width_in, 0.0, 0.17 / width_in, 1.0])
        bar = axes.figure.colorbar(colours, cax=box)
        bar.set_label(name)
        bar.outline.set_linewidth(0.6)


def paint(axes: Any, maps: Maps, cells: BoolArray, colour: str, name: str) -> None:
    """Paint cells of the grid in one colour."""
    if not cells.any():
        return
    axes.imshow(
        np.where(cells, 0.0, np.nan).T,
        extent=_extent(maps),
        origin="lower",
        cmap=LinearSegmentedColormap.from_list(name, [colour, colour]),
        interpolation="nearest",
        zorder=2,
        aspect="equal",
    )
    _explain(axes, colour, name)


def inside(axes: Any, point_m: PlanePoint) -> PlanePoint:
    """The point, or the nearest place at the border of the view if it lies outside."""
    (x_low, x_high), (z_low, z_high) = axes.get_xlim(), axes.get_ylim()
    edge = 0.015 * (x_high - x_low)
    return (
        min(max(point_m[0], x_low + edge), x_high - edge),
        min(max(point_m[1], z_low + edge), z_high - edge),
    )


def set_up_plane(axes: Any, view: View) -> None:
    """Limits, names and ticks of the axes."""
    axes.set_aspect("equal")
    axes.set_xlim(view[:2])
    axes.set_ylim(view[2:])
    axes.set_facecolor(_OUTSIDE)
    axes.set_xlabel("x (m)")
    axes.set_ylabel("z (m)")
    axes.tick_params(direction="out", length=3.0)
    width_m, height_m = view[1] - view[0], view[3] - view[2]
    step_m = _round_step(max(width_m, height_m) / _TICKS)
    for axis, length_m in ((axes.xaxis, width_m), (axes.yaxis, height_m)):
        axis.set_major_locator(MultipleLocator(min(step_m, _round_step(length_m / _FEW_TICKS))))


def _draw_obstacles(axes: Any, site: Site, view: View) -> None:
    """Conductors as discs, at least large enough to be seen; filled shapes."""
    conductors = site.conductors
    for item in site.obstacles:
        if isinstance(item, Conductor):
            x_m, z_m = item.position_m
        else:
            axes.add_patch(
                PolygonPatch(
                    item.vertices_m,
                    closed=True,
                    facecolor=_SOLID,
                    edgecolor="white",
                    linewidth=0.8,
                    zorder=4,
                )
            )
            corners = np.clip(item.vertices_m, (view[0], view[2]), (view[1], view[3]))
            x_m, z_m = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
        if view[0] < x_m < view[1] and view[2] < z_m < view[3]:
            label(axes, (float(x_m), float(z_m)), item.name)
    if len(conductors) < len(site.obstacles):
        _explain(axes, _SOLID, "obstacle")
    if conductors:
        for item in conductors:
            axes.add_patch(
                Circle(item.position_m, item.radius_m, facecolor=_SOLID, linewidth=0, zorder=4)
            )
        axes.plot(
            *np.array([item.position_m for item in conductors]).T,
            marker="o",
            markersize=6.5,
            color=_SOLID,
            markeredgecolor="white",
            markeredgewidth=1.0,
            linestyle="none",
            label="conductor",
            zorder=4.5,
        )


def _explain(axes: Any, colour: str, name: str) -> None:
    """An entry of the legend for an area."""
    axes.plot([], [], marker="s", markersize=9, color=colour, linestyle="none", label=name)


def _round_step(least: float) -> float:
    """The least of 1, 2, 5 times a power of ten that is not below `least`."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= least)


def _extent(maps: Maps) -> View:
    """The outer edges of the grid's cells."""
    (x_low, z_low), (x_high, z_high) = maps.grid.lower_m, maps.grid.upper_m
    return x_low, x_high, z_low, z_high

"""Pictures of the plane: site, safety map, path and what it costs (paper, Fig. 1, 3 and 9).

Inputs: a plan with its site and maps. Output: one figure in a file, drawn without a screen.
`draw_plan` makes the whole picture; `draw_plane`, `draw_goal`, `draw_path` and `draw_start` draw
on any axes, `place_labels` then moves the names apart, so that other pictures can be made of the
same parts.
"""

from __future__ import annotations

import math
import textwrap
import warnings
from os import PathLike
from typing import IO, Any

import numpy as np
from matplotlib import colormaps, patheffects, style
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from matplotlib.patches import Polygon as PolygonPatch
from matplotlib.ticker import MultipleLocator

from ..errors import InputError
from ..planner.grid import TOLERANCE, BoolArray, FloatArray
from ..planner.maps import Maps
from ..planner.plan import Plan
from ..planner.regions import GoalRegion, goal_region
from ..site import Conductor, PlanePoint, Site
from ..types import Mission
from ..vehicle import Vehicle

View = tuple[float, float, float, float]
"""What is seen of the plane, m: least and greatest x, least and greatest z."""

DPI = 150

STYLE = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.linewidth": 0.8,
    "savefig.dpi": DPI,
    "figure.dpi": DPI,
    "svg.fonttype": "path",
}
_OUTSIDE = "#f1f2f4"
_OCCUPIED = "#45484d"
_TOO_LOW = "#b4b8be"
_INK = "#1b1d21"
_REGION = "#0a8f5b"
_ALERT = "#b00020"
_SAFETY = LinearSegmentedColormap.from_list(
    "safety cost", ["#fffdf7", "#fee3b8", "#fdb56d", "#ee7a35", "#b8420f"]
)
"""White to burnt orange: apart from the blues of the path for every kind of colour vision."""
_SPEED = LinearSegmentedColormap.from_list(
    "speed", colormaps["YlGnBu_r"](np.linspace(0.04, 0.68, 64))
)
"""Dark blue (slow) to light green (fast); the path's dark rim sets it off from the map."""
_LABEL = "label"
"""The gid of the names that `place_labels` moves."""

_REACH = 0.5
"""How far outside the workspace something is still shown, of the workspace's greater extent."""
_MARGIN = 0.03
_TICKS = 9
"""Ticks along the longer side, at most; the shorter side has the same step,"""
_FEW_TICKS = 4
"""unless it would then have fewer than these."""
_FLATTEST, _TALLEST = 0.3, 0.9
"""Height over width of the view: flatter or taller ones are filled up with surroundings."""

# The page, in inches.
_LEFT, _PLANE_WIDTH, _COLOUR_BAR, _RIGHT = 0.75, 8.6, 0.88, 0.1
_TITLE, _BELOW_PLANE, _LEGEND, _SUMMARY = 0.65, 0.5, 0.55, 1.5
_COLUMN_GAP = 0.38


def draw_plan(
    plan: Plan,
    site: Site,
    vehicle: Vehicle,
    maps: Maps,
    file: str | PathLike[str] | IO[bytes],
    file_format: str = "png",
) -> None:
    """Draw a plan, also one that was not found, into a file (png, svg or pdf)."""
    with style.context(["default", STYLE], after_reset=True), warnings.catch_warnings():
        # A name in a script that the font does not have is drawn as boxes.
        warnings.filterwarnings("ignore", message="Glyph .* missing from")
        _plan_figure(plan, site, vehicle, maps).savefig(file, format=file_format, dpi=DPI)


def view_of(site: Site, vehicle: Vehicle, points_m: list[PlanePoint]) -> View:
    """What a picture of the plane shows: the workspace, obstacles that matter, and the points.

    Obstacles are shown as far as they cost safety; points that lie so far off that they would
    squeeze the workspace are left outside.
    """
    space = site.workspace
    lower, upper = np.array(space.lower_m), np.array(space.upper_m)
    extent_m = float((upper - lower).max())
    obstacle_reach_m = min(vehicle.safety.d_max_m, _REACH * extent_m)
    seen = [lower, upper]
    for obstacle in site.obstacles:
        points = [obstacle.position_m] if isinstance(obstacle, Conductor) else obstacle.vertices_m
        seen += [np.clip(p, lower - obstacle_reach_m, upper + obstacle_reach_m) for p in points]
    reach_m = _REACH * extent_m
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
    x_low, x_high, z_low, z_high = _extent(maps)
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
    low_rows = np.zeros(maps.grid.shape, dtype=bool)
    altitude_m = site.workspace.min_altitude_m
    if altitude_m is not None:
        low_rows[:, maps.grid.axes_m[1] < altitude_m - TOLERANCE] = True
    _paint(axes, maps, maps.occupied & ~low_rows, _OCCUPIED, "occupied")
    _paint(axes, maps, low_rows, _TOO_LOW, "too low")
    if altitude_m is not None and z_low < altitude_m < z_high:
        axes.plot(
            [x_low, x_high],
            [altitude_m, altitude_m],
            color=_INK,
            linewidth=1.0,
            linestyle=(0, (6, 2, 1, 2)),
            label=f"minimum altitude {altitude_m:g} m",
            zorder=3,
        )
    lower, upper = site.workspace.lower_m, site.workspace.upper_m
    axes.add_patch(
        Rectangle(
            lower,
            upper[0] - lower[0],
            upper[1] - lower[1],
            fill=False,
            edgecolor=_INK,
            linewidth=1.3,
            zorder=3,
        )
    )
    _draw_obstacles(axes, site, view)
    axes.set_xlim(view[:2])
    axes.set_ylim(view[2:])
    return heat


def draw_goal(
    axes: Any,
    site: Site,
    maps: Maps,
    mission: Mission,
    target: str | int | None,
    region: GoalRegion | None,
) -> None:
    """Draw where a mission ends: the target among the others, or goal region and landing points."""
    if mission is Mission.INSPECTION:
        others = [item for item in site.targets if item.name != target]
        for item in site.targets:
            if item.name == target:
                axes.plot(
                    *item.position_m,
                    marker="*",
                    markersize=15,
                    color="#ffd23f",
                    markeredgecolor=_INK,
                    linestyle="none",
                    label="target",
                    zorder=8,
                )
        if others:
            axes.plot(
                *np.array([item.position_m for item in others]).T,
                marker="*",
                markersize=9,
                color="white",
                markeredgecolor=_INK,
                linestyle="none",
                label="targets" if target is None else "other targets",
                zorder=5,
            )
        for item in site.targets:
            _label(axes, item.position_m, item.name, bold=item.name == target)
        return
    if region is not None:
        _paint(axes, maps, region.mask, _REGION, "goal region")
    for index, point in enumerate(site.landing_m.get(mission, ())):
        if target is None or target == index:
            _draw_landing(axes, index, point)


def draw_path(axes: Any, plan: Plan, greatest_mps: float | None = None) -> ScalarMappable | None:
    """Draw the path of a plan, coloured by speed, and its landing leg, dashed.

    greatest_mps: the speed at the upper end of the colours; the path's own by default. Returns
    the colours, for a colour bar; None where the plan has no move.
    """
    count = len(plan.states)
    position = plan.waypoints.position_m
    if len(position) > count:
        axes.plot(
            *position[count - 1 :].T,
            color=_INK,
            linewidth=1.8,
            linestyle=(0, (4, 2)),
            label="landing leg",
            zorder=6,
        )
    if count < 2:
        return None
    path = position[:count]
    speed = plan.waypoints.speed_mps[1:count]
    top_mps = float(speed.max()) if greatest_mps is None else greatest_mps
    axes.plot(*path.T, color=_INK, linewidth=5.2, solid_capstyle="round", label="_path", zorder=6.1)
    lines = LineCollection(
        list(np.stack([path[:-1], path[1:]], axis=1)),
        array=speed,
        cmap=_SPEED,
        norm=Normalize(0.0, top_mps or 1.0),
        linewidth=3.4,
        capstyle="round",
        zorder=6.2,
    )
    axes.add_collection(lines, autolim=False)
    return lines


def draw_start(axes: Any, position_m: PlanePoint, velocity_mps: PlanePoint) -> None:
    """Draw where the vehicle starts, with an arrow for its velocity.

    The arrow is as long as the way of one second, within what can be seen.
    """
    speed_mps = math.hypot(*velocity_mps)
    moving = f", at {speed_mps:.1f} m/s" if speed_mps > 0.0 else ", at rest"
    place = _inside(axes, position_m)
    axes.plot(
        *place,
        marker="o",
        markersize=9,
        color="white",
        markeredgecolor=_INK,
        markeredgewidth=2.0,
        linestyle="none",
        label=f"start{moving}",
        zorder=9,
    )
    away = place != position_m
    _label(axes, place, f"start ({position_m[0]:g}, {position_m[1]:g})" if away else "start")
    if speed_mps > 0.0:
        x_low, x_high = axes.get_xlim()
        length_m = min(max(speed_mps, 0.05 * (x_high - x_low)), 0.15 * (x_high - x_low))
        tip = [p + length_m * v / speed_mps for p, v in zip(place, velocity_mps, strict=True)]
        arrow = axes.annotate(
            "",
            xy=tip,
            xytext=place,
            arrowprops={
                "arrowstyle": "-|>,head_width=0.35,head_length=0.6",
                "color": _INK,
                "linewidth": 2.2,
                "shrinkA": 5.0,
                "shrinkB": 0.0,
            },
            zorder=8.5,
        )
        arrow.arrow_patch.set_path_effects(
            [patheffects.withStroke(linewidth=4.5, foreground="white")]
        )


def draw_colour_bars(axes: Any, bars: list[tuple[ScalarMappable, str]]) -> None:
    """Colour bars to the right of axes, as high as these are."""
    axes.apply_aspect()
    width_in = axes.get_position().width * axes.figure.get_figwidth()
    for index, (colours, name) in enumerate(bars):
        left_in = 0.18 + _COLOUR_BAR * index
        box = axes.inset_axes([1.0 + left_in / width_in, 0.0, 0.17 / width_in, 1.0])
        bar = axes.figure.colorbar(colours, cax=box)
        bar.set_label(name)
        bar.outline.set_linewidth(0.6)


def place_labels(axes: Any, path_m: FloatArray | None = None) -> None:
    """Move the names on axes apart from each other, from the path (n, 2) and from markers.

    A name for which there is no room is left out.
    """
    figure = axes.figure
    figure.draw_without_rendering()
    renderer = figure.canvas.get_renderer()
    point_px = figure.dpi / 72.0
    labels = [text for text in axes.texts if text.get_gid() == _LABEL]
    room = axes.get_window_extent(renderer).padded(-2.0 * point_px)
    in_the_way = [axes.transData.transform([text.xy for text in labels])] if labels else []
    if path_m is not None and len(path_m):
        in_the_way.append(axes.transData.transform(path_m))
    for text in axes.texts:
        if text.arrow_patch is not None:
            ends = axes.transData.transform([text.xyann, text.xy])
            in_the_way.append(np.linspace(ends[0], ends[1], 20))
    points = np.concatenate(in_the_way) if in_the_way else np.empty((0, 2))
    placed: list[Any] = []
    for text in labels:
        best = None
        for rank, (offset, horizontal, vertical) in enumerate(_PLACES):
            text.set_position(offset)
            text.set_ha(horizontal)
            text.set_va(vertical)
            box = text.get_window_extent(renderer).padded(3.0 * point_px)
            if any(box.overlaps(other) for other in placed):
                continue
            if not (room.contains(box.x0, box.y0) and room.contains(box.x1, box.y1)):
                continue
            covered = int(
                (
                    (points[:, 0] > box.x0 - 4.0 * point_px)
                    & (points[:, 0] < box.x1 + 4.0 * point_px)
                    & (points[:, 1] > box.y0 - 3.0 * point_px)
                    & (points[:, 1] < box.y1 + 3.0 * point_px)
                ).sum()
            )
            if best is None or covered < best[0]:
                best = (covered, rank, box)
        if best is None:
            text.set_visible(False)
            continue
        offset, horizontal, vertical = _PLACES[best[1]]
        text.set_position(offset)
        text.set_ha(horizontal)
        text.set_va(vertical)
        placed.append(best[2])


_PLACES = tuple(
    ((reach * x, reach * y), horizontal, vertical)
    for reach in (11.0, 18.0, 26.0)
    for x, y, horizontal, vertical in (
        (0.0, 1.0, "center", "bottom"),
        (1.0, 0.0, "left", "center"),
        (-1.0, 0.0, "right", "center"),
        (0.0, -1.0, "center", "top"),
        (0.8, 0.8, "left", "bottom"),
        (-0.8, 0.8, "right", "bottom"),
        (0.8, -0.8, "left", "top"),
        (-0.8, -0.8, "right", "top"),
    )
)
"""Where a name may stand beside its point: offset (points of print) and alignment."""


def draw_legend(axes: Any, plane: Any) -> None:
    """What the marks on the plane mean, in axes of its own."""
    axes.set_axis_off()
    handles, names = plane.get_legend_handles_labels()
    unique = dict(zip(names, handles, strict=True))
    axes.legend(
        unique.values(),
        unique.keys(),
        loc="center left",
        bbox_to_anchor=(0.0, 0.5),
        ncols=min(6, max(1, math.ceil(len(unique) / 2))) if len(unique) > 6 else len(unique),
        frameon=False,
        fontsize=8.5,
        borderaxespad=0.0,
        borderpad=0.0,
        handlelength=1.8,
        columnspacing=1.6,
    )


def draw_summary(axes: Any, plan: Plan) -> None:
    """Mission, cost, weights, risks and metrics of a plan as columns of figures."""
    axes.set_axis_off()
    axes.set_xlim(0.0, axes.get_position().width * axes.figure.get_figwidth())
    axes.set_ylim(0.0, 1.0)
    left_in = 0.0
    for title, width_in, rows in _summary_columns(plan):
        right_in = left_in + width_in
        axes.text(left_in, 1.0, title, va="top", weight="bold", fontsize=9)
        axes.plot([left_in, right_in], [0.86, 0.86], color=_INK, linewidth=0.6)
        for row, (name, value) in enumerate(rows):
            height = 0.81 - 0.165 * row
            axes.text(left_in, height, name, va="top", fontsize=8.5, color="#44474d")
            axes.text(right_in, height, value, va="top", ha="right", fontsize=8.5)
        left_in = right_in + _COLUMN_GAP


def _plan_figure(plan: Plan, site: Site, vehicle: Vehicle, maps: Maps) -> Figure:
    mission, target = plan.mission, plan.request.target
    start_m, velocity_mps = _pair(plan.request.start_m), _pair(plan.request.velocity_mps)
    goals = list(site.landing_m.get(mission, ()))
    if mission is Mission.INSPECTION:
        goals = [item.position_m for item in site.targets if item.name == target]
    elif isinstance(target, int):
        goals = [goals[target]]
    view = view_of(site, vehicle, [start_m, *goals])
    height_in = _PLANE_WIDTH * (view[3] - view[2]) / (view[1] - view[0])
    bars = 1 if plan.cost is None else 2
    page_in = (
        _LEFT + _PLANE_WIDTH + bars * _COLOUR_BAR + _RIGHT,
        _TITLE + height_in + _BELOW_PLANE + _LEGEND + _SUMMARY,
    )
    figure = Figure(figsize=page_in, facecolor="white")
    FigureCanvasAgg(figure)

    def panel(bottom_in: float, panel_height_in: float, width_in: float) -> Any:
        return figure.add_axes(
            (
                _LEFT / page_in[0],
                bottom_in / page_in[1],
                width_in / page_in[0],
                panel_height_in / page_in[1],
            )
        )

    plane = panel(_SUMMARY + _LEGEND + _BELOW_PLANE, height_in, _PLANE_WIDTH)
    heat = draw_plane(plane, site, maps, view)
    draw_goal(plane, site, maps, mission, target, _region(plan, site, vehicle, maps))
    speeds = draw_path(plane, plan)
    leg = plan.landing_leg
    if leg is not None:
        _draw_descent(plane, leg.points_m[-1], site.landing_m[mission][leg.landing_index])
    draw_start(plane, start_m, velocity_mps)
    colours = [(heat, "safety cost")]
    if speeds is not None:
        colours.append((speeds, "speed (m/s)"))
    draw_colour_bars(plane, colours)
    place_labels(plane, plan.waypoints.position_m)
    whole_width_in = page_in[0] - _LEFT - _RIGHT
    draw_legend(panel(_SUMMARY, _LEGEND - 0.1, whole_width_in), plane)
    draw_summary(panel(0.12, _SUMMARY - 0.22, whole_width_in), plan)
    _draw_title(figure, page_in, plan)
    return figure


def _draw_title(figure: Figure, page_in: tuple[float, float], plan: Plan) -> None:
    what = plan.mission.value.capitalize()
    if plan.mission is Mission.INSPECTION:
        what += f" of {plan.request.target}"
    elif plan.landing_leg is not None:
        what += f", to landing point {plan.landing_leg.landing_index}"
    elif plan.request.target is not None:
        what += f", to landing point {plan.request.target}"
    colour = _INK
    if plan.reason:
        what += f": no plan, {plan.reason} ({plan.status.value})"
        colour = _ALERT
    left = _LEFT / page_in[0]
    lines = (
        (0.12, textwrap.shorten(plan.site, 90, placeholder=" …"), 13, "bold", _INK),
        (0.4, textwrap.shorten(what, 130, placeholder=" …"), 10.5, "normal", colour),
    )
    for down_in, text, size, weight, text_colour in lines:
        figure.text(
            left,
            1.0 - down_in / page_in[1],
            text,
            fontsize=size,
            weight=weight,
            color=text_colour,
            va="top",
            parse_math=False,
        )


def _summary_columns(plan: Plan) -> list[tuple[str, float, list[tuple[str, str]]]]:
    """Title, width in inches, and rows of name and value."""
    cost, metrics, weights, compute = plan.cost, plan.metrics, plan.weights, plan.compute
    risk = plan.request.risk.as_dict()
    columns = [
        (
            "Plan",
            1.9,
            [
                ("status", plan.status.value),
                ("J", "none" if cost is None else f"{cost.total:.3f}"),
                ("states", f"{len(plan.states)}"),
                ("maps", f"{compute.map_ms:.1f} ms"),
                ("search", f"{compute.search_ms:.1f} ms"),
            ],
        ),
        (
            "Weights",
            1.25,
            [
                ("safety $k_S$", f"{weights.safety:.3f}"),
                ("time $k_T$", f"{weights.time:.3f}"),
                ("energy $k_E$", f"{weights.energy:.3f}"),
            ],
        ),
        ("Risk indices", 1.4, [(name, f"{index:.2f}") for name, index in risk.items()]),
    ]
    if cost is not None and metrics is not None:
        columns += [
            (
                "Cost (unweighted)",
                1.6,
                [
                    ("safety $\\Sigma\\,SC\\,d$", f"{cost.safety:.2f}"),
                    ("time $\\Sigma\\,TC$", f"{cost.time:.2f} s"),
                    ("energy $\\Sigma\\,EC$", f"{cost.energy:.2f}"),
                ],
            ),
            (
                "Trajectory",
                1.95,
                [
                    ("length", f"{metrics.length_m:.1f} m"),
                    ("duration", f"{metrics.duration_s:.1f} s"),
                    ("mean clearance", _clearance(metrics.mean_clearance_m)),
                    ("least clearance", _clearance(metrics.min_clearance_m)),
                    ("velocity change", f"{metrics.velocity_change_mps:.1f} m/s"),
                ],
            ),
        ]
    return columns


def _clearance(distance_m: float) -> str:
    return f"{distance_m:.1f} m" if math.isfinite(distance_m) else "none"


def _region(plan: Plan, site: Site, vehicle: Vehicle, maps: Maps) -> GoalRegion | None:
    """The goal region; None where no landing point is seen, of which a failed plan may not know."""
    if plan.mission is Mission.INSPECTION:
        return None
    try:
        return goal_region(site, vehicle, maps, plan.mission, plan.request.target)
    except InputError:
        return None


def _draw_landing(axes: Any, index: int, point_m: PlanePoint) -> None:
    place = _inside(axes, point_m)
    axes.plot(
        *place,
        marker="s",
        markersize=9,
        color=_REGION,
        markeredgecolor=_INK,
        linestyle="none",
        label="landing point",
        zorder=8,
    )
    where = "" if place == point_m else f" ({point_m[0]:g}, {point_m[1]:g})"
    _label(axes, place, f"landing {index}{where}")


def _draw_descent(axes: Any, above_m: FloatArray, landing_m: PlanePoint) -> None:
    """The landing itself, which is the autopilot's: from the end of the leg straight down."""
    axes.plot(
        *np.array([above_m, landing_m]).T,
        color=_INK,
        linewidth=1.4,
        linestyle=(0, (1, 1.5)),
        label="landing (autopilot)",
        zorder=6,
    )


def _draw_obstacles(axes: Any, site: Site, view: View) -> None:
    """Conductors as discs, at least large enough to be seen; filled shapes."""
    conductors = [item for item in site.obstacles if isinstance(item, Conductor)]
    for item in site.obstacles:
        if isinstance(item, Conductor):
            place = item.position_m
        else:
            axes.add_patch(
                PolygonPatch(
                    item.vertices_m,
                    closed=True,
                    facecolor="#17181b",
                    edgecolor="white",
                    linewidth=0.8,
                    zorder=4,
                )
            )
            corners = np.clip(item.vertices_m, (view[0], view[2]), (view[1], view[3]))
            place = _pair(0.5 * (corners.min(axis=0) + corners.max(axis=0)))
        if view[0] < place[0] < view[1] and view[2] < place[1] < view[3]:
            _label(axes, place, item.name)
    if len(conductors) < len(site.obstacles):
        _explain(axes, "#17181b", "obstacle")
    if conductors:
        for item in conductors:
            axes.add_patch(
                Circle(item.position_m, item.radius_m, facecolor="#17181b", linewidth=0, zorder=4)
            )
        axes.plot(
            *np.array([item.position_m for item in conductors]).T,
            marker="o",
            markersize=6.5,
            color="#17181b",
            markeredgecolor="white",
            markeredgewidth=1.0,
            linestyle="none",
            label="conductor",
            zorder=4.5,
        )


def _paint(axes: Any, maps: Maps, cells: BoolArray, colour: str, name: str) -> None:
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


def _explain(axes: Any, colour: str, name: str) -> None:
    """An entry of the legend for an area."""
    axes.plot([], [], marker="s", markersize=9, color=colour, linestyle="none", label=name)


def _label(axes: Any, point_m: PlanePoint, text: str, *, bold: bool = False) -> None:
    axes.annotate(
        text,
        point_m,
        xytext=(0.0, 9.0),
        textcoords="offset points",
        fontsize=8.5,
        weight="bold" if bold else "normal",
        color=_INK,
        path_effects=[patheffects.withStroke(linewidth=2.6, foreground="white")],
        gid=_LABEL,
        zorder=10,
        parse_math=False,
    )


def _inside(axes: Any, point_m: PlanePoint) -> PlanePoint:
    """The point, or the nearest place at the border of the view if it lies outside."""
    (x_low, x_high), (z_low, z_high) = axes.get_xlim(), axes.get_ylim()
    edge = 0.015 * (x_high - x_low)
    return (
        min(max(point_m[0], x_low + edge), x_high - edge),
        min(max(point_m[1], z_low + edge), z_high - edge),
    )


def _round_step(least: float) -> float:
    """The least of 1, 2, 5 times a power of ten that is not below `least`."""
    power = 10.0 ** math.floor(math.log10(least))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= least)


def _extent(maps: Maps) -> View:
    """The outer edges of the grid's cells."""
    (x_low, z_low), (x_high, z_high) = maps.grid.lower_m, maps.grid.upper_m
    return x_low, x_high, z_low, z_high


def _pair(point: Any) -> PlanePoint:
    return float(point[0]), float(point[1])

"""Start, path and end of a plan: marks on the axes of a plane."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import colormaps, patheffects
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import LinearSegmentedColormap, Normalize

from ...planner.grid import FloatArray
from ...planner.maps import Maps
from ...planner.plan_values import Plan
from ...planner.regions import GoalRegion
from ...planner.site import PlanePoint, Site
from ...types import Mission
from .figure import INK
from .labels import label
from .site_axes import inside, paint

if TYPE_CHECKING:
    from ...planner.refinement import Refinement

_REGION = "#0a8f5b"
_TARGET = "#ffd23f"
_REFINED = "#e619e6"
_ALTERNATIVES = ("#7b2cbf", "#0077b6", "#2a9d3a", "#d6006e", "#00a6a6", "#5c4033", "#808000")
"""Distinct from each other, from the safety map and from the colours of speed."""
_SPEED = LinearSegmentedColormap.from_list(
    "speed", colormaps["YlGnBu_r"](np.linspace(0.04, 0.68, 64))
)
"""Dark blue (slow) to light green (fast); the path's dark rim sets it off from the map."""


def draw_goal(
    axes: Any,
    site: Site,
    maps: Maps,
    mission: Mission,
    target: str | int | None,
    region: GoalRegion | None,
) -> None:
    """Draw the end of a mission: the target among the others, or goal region and landing points."""
    if mission.visits_targets:
        _draw_targets(axes, site, target)
        return
    if region is not None:
        paint(axes, maps, region.mask, _REGION, "goal region")
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
            color=INK,
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
    axes.plot(*path.T, color=INK, linewidth=5.2, solid_capstyle="round", label="_path", zorder=6.1)
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


def draw_refined(axes: Any, refined: Refinement) -> None:
    """Draw the refined path of a plan, dots where its legs end, and its landing leg, dashed."""
    name = f"refined path, J {refined.cost.total:.3f} (unrefined {refined.plan_cost.total:.3f})"
    white = patheffects.withStroke(linewidth=3.2, foreground="white")
    style = {"color": _REFINED, "linewidth": 1.9, "path_effects": [white]}
    axes.plot(*refined.points_m.T, marker=".", markersize=7, label=name, zorder=6.4, **style)
    if refined.landing_leg is not None:
        leg = np.concatenate([refined.points_m[-1:], refined.landing_leg.points_m])
        axes.plot(*leg.T, linestyle=(0, (4, 2)), label="_landing leg", zorder=6.4, **style)


def draw_alternatives(axes: Any, others: Sequence[Plan]) -> list[Any]:
    """Draw the paths of a problem under other risks as thin lines; returns the lines."""
    return [
        axes.plot(
            *other.waypoints.position_m.T,
            color=_ALTERNATIVES[index % len(_ALTERNATIVES)],
            linewidth=1.7,
            label="_alternative",
            path_effects=[patheffects.withStroke(linewidth=2.9, foreground="white")],
            zorder=5.8,
        )[0]
        for index, other in enumerate(others)
    ]


def draw_descent(axes: Any, above_m: FloatArray, landing_m: PlanePoint) -> None:
    """Draw the landing, flown by the autopilot: from the end of the leg straight down."""
    axes.plot(
        *np.array([above_m, landing_m]).T,
        color=INK,
        linewidth=1.4,
        linestyle=(0, (1, 1.5)),
        label="landing (autopilot)",
        zorder=6,
    )


def draw_start(axes: Any, position_m: PlanePoint, velocity_mps: PlanePoint) -> None:
    """Draw the start of the vehicle, with an arrow for its velocity.

    The arrow is as long as the distance flown in one second, within visible limits.
    """
    speed_mps = math.hypot(*velocity_mps)
    moving = f", at {speed_mps:.1f} m/s" if speed_mps > 0.0 else ", at rest"
    place = inside(axes, position_m)
    axes.plot(
        *place,
        marker="o",
        markersize=9,
        color="white",
        markeredgecolor=INK,
        markeredgewidth=2.0,
        linestyle="none",
        label=f"start{moving}",
        zorder=9,
    )
    label(axes, place, "start" + _elsewhere(place, position_m))
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
                "color": INK,
                "linewidth": 2.2,
                "shrinkA": 5.0,
                "shrinkB": 0.0,
            },
            zorder=8.5,
        )
        arrow.arrow_patch.set_path_effects(
            [patheffects.withStroke(linewidth=4.5, foreground="white")]
        )


def _draw_targets(axes: Any, site: Site, target: str | int | None) -> None:
    """Draw all targets as stars, the chosen one larger and with its name in bold."""
    star = {"marker": "*", "markeredgecolor": INK, "linestyle": "none"}
    meant = [item.position_m for item in site.targets if item.name == target]
    others = [item.position_m for item in site.targets if item.name != target]
    if meant:
        axes.plot(
            *np.array(meant).T, **star, markersize=15, color=_TARGET, label="target", zorder=8
        )
    if others:
        name = "targets" if target is None else "other targets"
        over = 8 if target is None else 5
        axes.plot(*np.array(others).T, **star, markersize=9, color="white", label=name, zorder=over)
    for item in site.targets:
        label(axes, item.position_m, item.name, bold=item.name == target)


def _draw_landing(axes: Any, index: int, point_m: PlanePoint) -> None:
    place = inside(axes, point_m)
    axes.plot(
        *place,
        marker="s",
        markersize=9,
        color=_REGION,
        markeredgecolor=INK,
        linestyle="none",
        label="landing point",
        zorder=8,
    )
    label(axes, place, f"landing {index}{_elsewhere(place, point_m)}")


def _elsewhere(place_m: PlanePoint, point_m: PlanePoint) -> str:
    """Addition to the name of a point that is drawn at the border of the view."""
    return "" if place_m == point_m else f" ({point_m[0]:g}, {point_m[1]:g})"

"""The picture of a plan: site, safety map and path, and below them cost, weights and risks.

Inputs: a plan with its site and maps. Output: one figure in a file, drawn without a screen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from os import PathLike
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from ...errors import InputError
from ...planner.analysis.alternatives import risk_words, safety_words, same_path
from ...planner.maps import Maps
from ...planner.plan_values import Plan
from ...planner.regions import GoalRegion, goal_region
from ...planner.site import PlanePoint, Site
from ...settings.vehicle import Vehicle
from ...types import Mission
from .figure import DPI, INK, Page, page_style
from .labels import place_labels
from .plan_marks import (
    draw_alternatives,
    draw_descent,
    draw_goal,
    draw_path,
    draw_refined,
    draw_start,
)
from .site_axes import COLOUR_BAR_IN, draw_colour_bars, draw_plane, view_of

if TYPE_CHECKING:
    from ...planner.refinement import Refinement

_ALERT = "#b00020"

# The page, in inches.
_LEFT, _PLANE_WIDTH, _RIGHT = 0.75, 8.6, 0.1
_TITLE, _BELOW_PLANE, _LEGEND, _SUMMARY = 0.65, 0.5, 0.55, 1.5
_ALTERNATIVE, _BELOW_NAMES = 0.19, 0.12
_COLUMN_GAP = 0.38

_Rows = list[tuple[str, str]]


def draw_plan(
    plan: Plan,
    site: Site,
    vehicle: Vehicle,
    maps: Maps,
    file: str | PathLike[str] | IO[bytes],
    file_format: str = "png",
    *,
    alternatives: Sequence[Plan] = (),
    refined: Refinement | None = None,
    unmoved: str = "",
) -> None:
    """Draw a plan, also one that was not found, into a file (png, svg or pdf).

    alternatives: of the same problem under other risks, drawn as thin lines. refined: the refined
    path. unmoved: a line on the risks that do not move the path.
    """
    with page_style():
        page = _draw_page(plan, site, vehicle, maps, alternatives, refined, unmoved)
        page.figure.savefig(file, format=file_format, dpi=DPI)


def draw_tour(
    plans: Sequence[Plan],
    site: Site,
    vehicle: Vehicle,
    maps: Maps,
    what: str,
    file: str | PathLike[str] | IO[bytes],
    file_format: str = "png",
) -> None:
    """Draw the legs of a tour, the way out last, into a file (png, svg or pdf).

    what: the subject of its title.
    """
    with page_style():
        start_m = _pair(plans[0].request.start_m)
        landings_m = list(site.landing_m.get(plans[-1].mission, ()))
        view = view_of(site, vehicle, [start_m, *landings_m])
        height_in = _PLANE_WIDTH * (view[3] - view[2]) / (view[1] - view[0])
        whole_width_in = _PLANE_WIDTH + 2 * COLOUR_BAR_IN
        below_in = _BELOW_PLANE + _LEGEND
        page = Page(_LEFT + whole_width_in + _RIGHT, _TITLE + height_in + below_in)
        plane = page.panel(_LEFT, below_in, _PLANE_WIDTH, height_in)
        colours = [(draw_plane(plane, site, maps, view), "safety cost")]
        draw_goal(plane, site, maps, Mission.INSPECTION, None, None)
        fastest_mps = max(float(plan.waypoints.speed_mps.max(initial=0.0)) for plan in plans)
        speeds = [draw_path(plane, plan, fastest_mps) for plan in plans]
        colours += [(item, "speed (m/s)") for item in speeds[:1] if item is not None]
        for plan in plans:
            if not plan.mission.visits_targets:
                draw_goal(plane, site, maps, plan.mission, None, _region(plan, site, vehicle, maps))
            leg = plan.landing_leg
            if leg is not None:
                landing_m = site.landing_m[plan.mission][leg.landing_index]
                draw_descent(plane, leg.points_m[-1], landing_m)
        draw_start(plane, start_m, _pair(plans[0].request.velocity_mps))
        draw_colour_bars(plane, colours)
        place_labels(plane, np.concatenate([plan.waypoints.position_m for plan in plans]))
        _draw_legend(page.panel(_LEFT, 0.1, whole_width_in, _LEGEND - 0.1), plane)
        page.title(_LEFT, site.name, what)
        page.figure.savefig(file, format=file_format, dpi=DPI)


def _draw_page(
    plan: Plan,
    site: Site,
    vehicle: Vehicle,
    maps: Maps,
    alternatives: Sequence[Plan],
    refined: Refinement | None,
    unmoved: str,
) -> Page:
    mission, target = plan.mission, plan.request.target
    start_m, velocity_mps = _pair(plan.request.start_m), _pair(plan.request.velocity_mps)
    goals = list(site.landing_m.get(mission, ()))
    if mission.visits_targets:
        goals = [item.position_m for item in site.targets if item.name == target]
    elif isinstance(target, int):
        goals = [goals[target]]
    view = view_of(site, vehicle, [start_m, *goals])
    height_in = _PLANE_WIDTH * (view[3] - view[2]) / (view[1] - view[0])
    bars = 1 if plan.cost is None else 2
    whole_width_in = _PLANE_WIDTH + bars * COLOUR_BAR_IN
    others = _grouped(plan, [other for other in alternatives if len(other.states)])
    others_in = _ALTERNATIVE * (len(others) + bool(unmoved)) + (_BELOW_NAMES if others else 0.0)
    below_in = _BELOW_PLANE + _LEGEND + others_in + _SUMMARY
    page = Page(_LEFT + whole_width_in + _RIGHT, _TITLE + height_in + below_in)

    plane = page.panel(_LEFT, below_in, _PLANE_WIDTH, height_in)
    colours = [(draw_plane(plane, site, maps, view), "safety cost")]
    draw_goal(plane, site, maps, mission, target, _region(plan, site, vehicle, maps))
    speeds = draw_path(plane, plan)
    if speeds is not None:
        colours.append((speeds, "speed (m/s)"))
    leg = plan.landing_leg
    if leg is not None:
        draw_descent(plane, leg.points_m[-1], site.landing_m[mission][leg.landing_index])
    thin = draw_alternatives(plane, [other for other, _ in others[1:]])
    if refined is not None:
        draw_refined(plane, refined)
    draw_start(plane, start_m, velocity_mps)
    draw_colour_bars(plane, colours)
    drawn = [plan, *(other for other, _ in others)]
    place_labels(plane, np.concatenate([each.waypoints.position_m for each in drawn]))
    legend_in = _SUMMARY + others_in
    _draw_legend(page.panel(_LEFT, legend_in, whole_width_in, _LEGEND - 0.1), plane)
    if others:
        _draw_names(page.panel(_LEFT, _SUMMARY, whole_width_in, others_in), thin, others, unmoved)
    _draw_summary(page.panel(_LEFT, 0.12, whole_width_in, _SUMMARY - 0.22), plan, whole_width_in)
    _draw_title(page, plan, site)
    return page


def _pair(point: Any) -> PlanePoint:
    return float(point[0]), float(point[1])


def _region(plan: Plan, site: Site, vehicle: Vehicle, maps: Maps) -> GoalRegion | None:
    """The goal region; None for an inspection, or where no landing point is visible."""
    if plan.mission.visits_targets:
        return None
    try:
        return goal_region(site, vehicle, maps, plan.mission, plan.request.target)
    except InputError:
        return None


def _grouped(plan: Plan, alternatives: Sequence[Plan]) -> list[tuple[Plan, list[str]]]:
    """Plans of different paths with the risks of each, the plan itself first; empty without any."""
    groups: list[tuple[Plan, list[str]]] = [(plan, [])] if alternatives else []
    for other in alternatives:
        words = risk_words(other.request.risk)
        known = next((names for group, names in groups if same_path(group, other)), None)
        if known is None:
            groups.append((other, [words]))
        else:
            known.append(words)
    return groups


def _draw_names(
    axes: Any, lines: list[Any], others: list[tuple[Plan, list[str]]], unmoved: str
) -> None:
    """Draw the legend of paths, their safety and their risks, in axes of its own."""
    axes.set_axis_off()
    bold = axes.plot([], [], color=INK, linewidth=4.0)
    axes.legend(
        [*bold, *lines],
        [_name(plan, names) for plan, names in others],
        loc="upper left",
        bbox_to_anchor=(0.0, 1.0),
        frameon=False,
        fontsize=8.5,
        borderaxespad=0.0,
        borderpad=0.0,
        handlelength=1.8,
    )
    axes.text(0.0, 0.08, unmoved, transform=axes.transAxes, fontsize=8.5, va="bottom")


def _name(plan: Plan, names: list[str]) -> str:
    risks = "with " + "; ".join(names) if names else "as planned"
    return f"{risks}: {safety_words(plan)}"


def _draw_legend(axes: Any, plane: Any) -> None:
    """Draw the legend of the marks on the plane, in axes of its own."""
    axes.set_axis_off()
    handles, names = plane.get_legend_handles_labels()
    unique = dict(zip(names, handles, strict=True))
    axes.legend(
        unique.values(),
        unique.keys(),
        loc="center left",
        bbox_to_anchor=(0.0, 0.5),
        ncols=min(6, math.ceil(len(unique) / 2)) if len(unique) > 6 else len(unique),
        frameon=False,
        fontsize=8.5,
        borderaxespad=0.0,
        borderpad=0.0,
        handlelength=1.8,
        columnspacing=1.6,
    )


def _draw_summary(axes: Any, plan: Plan, width_in: float) -> None:
    """Mission, cost, weights, risks and metrics of a plan as columns of figures."""
    axes.set_axis_off()
    axes.set_xlim(0.0, width_in)
    axes.set_ylim(0.0, 1.0)
    left_in = 0.0
    for title, column_in, rows in _summary_columns(plan):
        right_in = left_in + column_in
        axes.text(left_in, 1.0, title, va="top", weight="bold", fontsize=9)
        axes.plot([left_in, right_in], [0.86, 0.86], color=INK, linewidth=0.6)
        for row, (name, value) in enumerate(rows):
            height = 0.81 - 0.165 * row
            axes.text(left_in, height, name, va="top", fontsize=8.5, color="#44474d")
            axes.text(right_in, height, value, va="top", ha="right", fontsize=8.5)
        left_in = right_in + _COLUMN_GAP


def _summary_columns(plan: Plan) -> list[tuple[str, float, _Rows]]:
    """Title, width in inches, and rows of name and value."""
    cost, metrics, weights, compute = plan.cost, plan.metrics, plan.weights, plan.compute
    about: _Rows = [
        ("status", plan.status.value),
        ("J", "none" if cost is None else f"{cost.total:.3f}"),
        ("states", f"{len(plan.states)}"),
        ("maps", compute.map_words),
        ("search", compute.search_words),
    ]
    weighed: _Rows = [
        ("safety $k_S$", f"{weights.safety:.3f}"),
        ("time $k_T$", f"{weights.time:.3f}"),
        ("energy $k_E$", f"{weights.energy:.3f}"),
    ]
    risks: _Rows = [(name, f"{risk:.2f}") for name, risk in plan.request.risk.as_dict().items()]
    columns = [("Plan", 1.9, about), ("Weights", 1.25, weighed), ("Risk indices", 1.4, risks)]
    if cost is not None and metrics is not None:
        costs: _Rows = [
            ("safety $\\Sigma\\,SC\\,d$", f"{cost.safety:.2f}"),
            ("time $\\Sigma\\,TC$", f"{cost.time:.2f} s"),
            ("energy $\\Sigma\\,EC$", f"{cost.energy:.2f}"),
        ]
        trajectory: _Rows = [
            ("length", f"{metrics.length_m:.1f} m"),
            (
                "duration" if plan.landing_leg is None else "duration with leg",
                f"{metrics.duration_s:.1f} s",
            ),
            ("mean clearance", _clearance(metrics.mean_clearance_m)),
            ("least clearance", _clearance(metrics.min_clearance_m)),
            ("velocity change", f"{metrics.velocity_change_mps:.1f} m/s"),
        ]
        columns += [("Cost (unweighted)", 1.6, costs), ("Trajectory", 1.95, trajectory)]
    return columns


def _clearance(distance_m: float) -> str:
    return f"{distance_m:.1f} m" if math.isfinite(distance_m) else "none"


def _draw_title(page: Page, plan: Plan, site: Site) -> None:
    what = plan.mission.value.capitalize()
    if plan.mission.visits_targets:
        what += f" of {plan.request.target}"
    elif plan.landing_leg is not None:
        what += f", to landing point {plan.landing_leg.landing_index}"
    elif plan.request.target is not None:
        what += f", to landing point {plan.request.target}"
    margin_m = site.margin.total_m
    kept = f"{margin_m:g} m of margin" if margin_m else "no margin"
    what += f"; {kept} for the flight's errors"
    colour = INK
    if plan.reason:
        what += f": no plan, {plan.reason} ({plan.status.value})"
        colour = _ALERT
    page.title(_LEFT, plan.site, what, colour)

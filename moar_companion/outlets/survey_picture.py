"""The picture of a survey: plan view and side view of the points, and the plane that was laid."""

from __future__ import annotations

from dataclasses import dataclass
from os import PathLike
from typing import IO, Any

import numpy as np
import numpy.typing as npt
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Rectangle
from matplotlib.patches import Polygon as PolygonPatch

from .figure import DPI, INK, Page, page_style

FloatArray = npt.NDArray[np.float64]

_CLASSES = {  # LAS 1.4
    2: ("ground", "#c9b48f"),
    5: ("other points", "#5b9a57"),
    15: ("tower", "#6d6f75"),
    13: ("earth wire", "#e39a2d"),
    14: ("conductor", "#2c6fb3"),
}
_MOST_POINTS = 60_000
_BESIDE_M, _ABOVE_M = 12.0, 2.0
"""Surroundings of the workspace that are shown."""

# The page, in inches.
_WIDTH_IN, _BELOW_IN, _SIDE_IN, _PLAN_IN = 8.6, 0.55, 1.7, 1.5


@dataclass(frozen=True, kw_only=True, eq=False)
class SurveyView:
    """Values of a survey that the picture draws.

    document: of the site file; points_m: (n, 3) along the line, across it and up, from the site's
    origin, with their LAS classes; plane_m: (k, 2) x and z of those near the plane, with theirs;
    left_out_m: (j, 2) points that are no obstacle of the site.
    """

    document: dict[str, Any]
    points_m: FloatArray
    classes: npt.NDArray[np.uint8]
    plane_m: FloatArray
    plane_classes: npt.NDArray[np.uint8]
    left_out_m: FloatArray


def draw_survey(
    survey: SurveyView, file: str | PathLike[str] | IO[bytes], file_format: str = "png"
) -> None:
    """Draw a survey into a file (png, svg, pdf)."""
    space = survey.document["workspace"]
    width_m = space["x_m"][1] - space["x_m"][0] + 2.0 * _BESIDE_M
    height_m = space["z_m"][1] - space["z_m"][0] + 2.0 * _ABOVE_M
    section_in = _WIDTH_IN * height_m / width_m
    side_in = _BELOW_IN + section_in + 0.75
    plan_in = side_in + _SIDE_IN + 0.55
    with page_style():
        page = Page(0.75 + _WIDTH_IN + 0.25, plan_in + _PLAN_IN + 0.85)
        page.title(0.75, survey.document["name"], "survey: plan view, side view, the plane")
        _draw_section(page.panel(0.75, _BELOW_IN, _WIDTH_IN, section_in), survey)
        side = page.panel(0.75, side_in, _WIDTH_IN, _SIDE_IN)
        _draw_points(side, survey.points_m[:, [0, 2]], survey.classes)
        side.set_xlabel("along the line, m")
        side.set_ylabel("height, m")
        plan = page.panel(0.75, plan_in, _WIDTH_IN, _PLAN_IN)
        _draw_points(plan, survey.points_m[:, [0, 1]], survey.classes)
        plan.set_ylabel("across, m")
        for panel in (side, plan):
            panel.axvline(0.0, color=INK, linewidth=0.8, linestyle="--")
        page.figure.savefig(file, format=file_format, dpi=DPI)


def _draw_points(axes: Any, places: FloatArray, classes: npt.NDArray[np.uint8]) -> None:
    step = max(1, len(places) // _MOST_POINTS)
    for kind, (_, colour) in _CLASSES.items():
        part = classes[::step] == kind
        axes.scatter(*places[::step][part].T, s=0.6, c=colour, linewidths=0.0, rasterized=True)
    axes.margins(0.01)


def _draw_section(axes: Any, survey: SurveyView) -> None:
    document = survey.document
    space = document["workspace"]
    (low_x, high_x), (low_z, high_z) = space["x_m"], space["z_m"]
    axes.set_xlim(low_x - _BESIDE_M, high_x + _BESIDE_M)
    axes.set_ylim(low_z - _ABOVE_M, high_z + _ABOVE_M)
    axes.set_aspect("equal")
    axes.add_patch(
        Rectangle(
            (low_x, low_z), high_x - low_x, high_z - low_z, fill=False, edgecolor=INK, linewidth=1.0
        )
    )
    for entry in document["obstacles"]:
        polygon = entry.get("polygon")
        if polygon:
            axes.add_patch(
                PolygonPatch(
                    polygon["vertices_m"], facecolor="#d9dbdf", edgecolor="#8d9096", linewidth=0.6
                )
            )
    _draw_points(axes, survey.plane_m, survey.plane_classes)
    labelled: set[str] = set()
    for entry in document["obstacles"]:
        wire = entry.get("conductor")
        if wire:
            axes.add_patch(
                Circle(
                    (wire["x_m"], wire["z_m"]),
                    wire["keep_out_m"],
                    fill=False,
                    edgecolor="#a3271b",
                    linewidth=0.8,
                )
            )
            bundle = wire["name"].rstrip("abcdefgh")
            if bundle not in labelled:
                labelled.add(bundle)
                right = wire["x_m"] >= 0.0
                covered = any(  # by a target: the text goes below
                    (x >= wire["x_m"]) == right and abs(z - wire["z_m"]) < 1.0
                    for x, z in _targets(document).values()
                )
                axes.annotate(
                    f"{bundle}  {wire['z_m']:.1f} m",
                    (wire["x_m"], wire["z_m"]),
                    xytext=(14 if right else -14, -12 if covered else 0),
                    textcoords="offset points",
                    ha="left" if right else "right",
                    va="center",
                    fontsize=7,
                )
    if len(survey.left_out_m):
        axes.scatter(*survey.left_out_m.T, marker="x", s=30, c="#a3271b")
    for label, places, marker in (
        ("start", [document["start"]], "o"),
        ("landing", document["landing"]["evacuation"], "v"),
    ):
        for place in places:
            axes.plot(place["x_m"], place["z_m"], marker, color=INK, markersize=5)
            axes.annotate(
                label,
                (place["x_m"], place["z_m"]),
                xytext=(0, 6),
                textcoords="offset points",
                ha="center",
                fontsize=7,
            )
    for name, (x, z) in _targets(document).items():
        axes.plot(x, z, "*", color="#a3271b", markersize=9)
        axes.annotate(
            name, (x, z), xytext=(0, 8), textcoords="offset points", ha="center", fontsize=7
        )
    axes.set_xlabel("x across the line, m")
    axes.set_ylabel("z above the ground, m")
    handles = [
        Line2D([], [], marker="o", linestyle="", color=colour, markersize=4, label=name)
        for name, colour in _CLASSES.values()
    ]
    if len(survey.left_out_m):
        handles.append(
            Line2D([], [], marker="x", linestyle="", color="#a3271b", label="left out: lone points")
        )
    axes.legend(handles=handles, loc="upper right", fontsize=7, frameon=True)


def _targets(document: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """Places of the targets: beside their conductors."""
    wires = {
        entry["conductor"]["name"]: entry["conductor"]
        for entry in document["obstacles"]
        if "conductor" in entry
    }
    sides = {"left": (-1.0, 0.0), "right": (1.0, 0.0), "above": (0.0, 1.0), "below": (0.0, -1.0)}
    places = {}
    for name, target in document["targets"].items():
        wire, towards = wires[target["conductor"]], sides[target["side"]]
        distance = wire["radius_m"] + target["standoff_m"]
        places[name] = (
            wire["x_m"] + towards[0] * distance,
            wire["z_m"] + towards[1] * distance,
        )
    return places

"""The picture of a survey: plan view, side view, cross-section, and points left out."""

from __future__ import annotations

import math
import re
from os import PathLike
from typing import IO, Any

import numpy as np
import numpy.typing as npt
from matplotlib.lines import Line2D
from matplotlib.patches import Circle, Patch, Rectangle
from matplotlib.patches import Polygon as PolygonPatch

from ...perception.survey.survey_view import FloatArray, SurveyMark, SurveyView
from .figure import DPI, INK, Page, page_style

_CLASSES = {  # LAS 1.4
    2: ("ground", "#c9b48f"),
    5: ("other points", "#5b9a57"),
    15: ("tower", "#6d6f75"),
    13: ("earth wire", "#e39a2d"),
    14: ("conductor", "#2c6fb3"),
}
_RED = "#a3271b"
_STANDING = ("#d9dbdf", "#8d9096")
"""Face and rim of obstacles in the plane."""
_MARKS = {  # of map features: legend, marker, colour
    "conductor": ("conductor", "o", "#2c6fb3"),
    "tower": ("tower, obstacle", "s", "#6d6f75"),
    "obstacle": ("tower, obstacle", "s", "#6d6f75"),
    "outline": ("outline", ".", "#6d6f75"),
    "ground": ("ground", "_", "#a08a5e"),
    "target": ("target", "*", _RED),
    "start": ("start", "o", INK),
    "exit": ("landing place", "v", INK),
    "evacuation": ("landing place", "v", INK),
}
_MOST_POINTS = 60_000
_BESIDE_M, _ABOVE_M = 12.0, 2.0
"""Surroundings of the workspace that are shown."""

# The page, in inches.
_LEFT_IN, _WIDTH_IN, _BELOW_IN, _SIDE_IN = 0.75, 8.6, 1.25, 1.7
_PLAN_IN = (1.6, 3.6)
"""Least and greatest height of the plan view."""


def draw_survey(
    survey: SurveyView, file: str | PathLike[str] | IO[bytes], file_format: str = "png"
) -> None:
    """Draw a survey into a file (png, svg, pdf)."""
    space = survey.document["workspace"]
    width_m = space["x_m"][1] - space["x_m"][0] + 2.0 * _BESIDE_M
    height_m = space["z_m"][1] - space["z_m"][0] + 2.0 * _ABOVE_M
    section_in = _WIDTH_IN * height_m / width_m
    side_in = _BELOW_IN + section_in + 0.3
    plan_at_in = side_in + _SIDE_IN + 0.55
    along_m = np.concatenate(
        [survey.points_m[:, 0], *(each.points_m[:, 0] for each in survey.marks), [-10.0, 10.0]]
    )
    length_m = 1.1 * float(along_m.max() - along_m.min())
    plan_in = min(max(_WIDTH_IN * width_m / length_m, _PLAN_IN[0]), _PLAN_IN[1])
    with page_style():
        page = Page(_LEFT_IN + _WIDTH_IN + 0.25, plan_at_in + plan_in + 0.85)
        page.title(_LEFT_IN, survey.document["name"], "survey: plan view, side view, the plane")
        _draw_section(page.panel(_LEFT_IN, _BELOW_IN, _WIDTH_IN, section_in), survey)
        side = page.panel(_LEFT_IN, side_in, _WIDTH_IN, _SIDE_IN)
        _draw_points(side, survey.points_m[:, [0, 2]], survey.classes)
        _draw_marks(side, survey.marks, (0, 2))
        side.set_ylabel("height, m")
        plan = page.panel(_LEFT_IN, plan_at_in, _WIDTH_IN, plan_in)
        _draw_plan(plan, survey, (float(along_m.min() + along_m.max()) / 2.0, length_m))
        side.set_xlim(plan.get_xlim())
        side.margins(y=0.1)
        side.axvline(0.0, color=INK, linewidth=0.8, linestyle="--")
        page.figure.savefig(file, format=file_format, dpi=DPI)


def _draw_plan(axes: Any, survey: SurveyView, along: tuple[float, float]) -> None:
    """The plan view, true to scale. along: middle and length of the view along the line."""
    low_x, high_x = survey.document["workspace"]["x_m"]
    box = axes.get_position()
    width_in, height_in = (
        share * size
        for share, size in zip((box.width, box.height), axes.figure.get_size_inches(), strict=True)
    )
    metres_per_in = max(along[1] / width_in, (high_x - low_x + 2.0 * _BESIDE_M) / height_in)
    half_m, middle_m = 0.5 * metres_per_in * height_in, 0.5 * (low_x + high_x)
    axes.set_xlim(*(along[0] + sign * 0.5 * metres_per_in * width_in for sign in (-1.0, 1.0)))
    axes.set_ylim(middle_m - half_m, middle_m + half_m)
    _draw_points(axes, survey.points_m[:, [0, 1]], survey.classes)
    _draw_marks(axes, survey.marks, (0, 1))
    if not any(mark.kind == "target" for mark in survey.marks):
        for name, (x, _) in _targets(survey.document).items():
            axes.plot(0.0, x, "*", color=_RED, markersize=8, zorder=5)
            _write(axes, name, (0.0, x), (6, 4), "left")
    axes.plot([0.0, 0.0], [low_x, high_x], color=INK, linewidth=1.0, linestyle="--")
    _write(axes, "plane", (0.0, high_x), (4, 2), "left")
    axes.set_xlabel("along the line, m", labelpad=1)
    axes.set_ylabel("x across, m")
    azimuth = math.radians(survey.document["frame"]["azimuth_deg"])
    right, up = -math.sin(azimuth), math.cos(azimuth)
    for text, length, arrow in (("", 14.0, {"arrowstyle": "<|-", "color": INK}), ("N", 22.0, None)):
        axes.annotate(
            text,
            (0.96, 1.0 - 0.35 / height_in),
            xycoords="axes fraction",
            xytext=(length * right, length * up),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=8,
            weight="bold",
            arrowprops=arrow,
        )


def _draw_points(axes: Any, places: FloatArray, classes: npt.NDArray[np.uint8]) -> None:
    step = max(1, len(places) // _MOST_POINTS)
    for kind, (_, colour) in _CLASSES.items():
        part = classes[::step] == kind
        if part.any():
            axes.scatter(*places[::step][part].T, s=0.6, c=colour, linewidths=0.0, rasterized=True)
    axes.margins(x=0.01)


def _draw_marks(axes: Any, marks: tuple[SurveyMark, ...], columns: tuple[int, int]) -> None:
    """Marks by two of along, across and up; those left out with a red cross and their name."""
    for mark in marks:
        places = mark.points_m[:, columns]
        _, marker, colour = _MARKS[mark.kind]
        line = "-" if mark.kind in ("conductor", "outline") else ""
        size = 8 if marker == "*" else 4
        axes.plot(*places.T, marker, linestyle=line, color=colour, markersize=size, linewidth=0.8)
        if mark.left_out_m is not None:
            axes.plot(*places.T, "x", color=_RED, markersize=9)
        if columns == (0, 1) and (mark.left_out_m is not None or mark.kind in ("target", "tower")):
            _write(axes, mark.name, places[0], (6, 4), "left")


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
    face, rim = _STANDING
    if "ground" in document:
        axes.plot(*np.array(document["ground"]).T, color=rim, linewidth=1.2, zorder=3)
    for entry in document["obstacles"]:
        polygon = entry.get("polygon")
        if polygon:
            axes.add_patch(
                PolygonPatch(polygon["vertices_m"], facecolor=face, edgecolor=rim, linewidth=0.6)
            )
    _draw_points(axes, survey.plane_m, survey.plane_classes)
    _draw_wires(axes, document)
    if len(survey.left_out_m):
        axes.scatter(*survey.left_out_m.T, marker="x", s=30, c=_RED)
    _draw_marks(axes, tuple(each for each in survey.marks if each.left_out_m is not None), (1, 2))
    for mark in survey.marks:
        if mark.left_out_m is not None:
            _write(axes, mark.name, mark.points_m[0, 1:], (8, 0), "left")
    landing = {
        (place["x_m"], place["z_m"]) for places in document["landing"].values() for place in places
    }
    start = {(document["start"]["x_m"], document["start"]["z_m"])}
    for label, places, marker in (("start", start, "o"), ("landing", landing, "v")):
        for at in sorted(places):
            axes.plot(*at, marker, color=INK, markersize=5)
            _write(axes, label, at, (0, 8))
    for name, at in _targets(document).items():
        axes.plot(*at, "*", color=_RED, markersize=9)
        _write(axes, name, at, (0, 10))
    axes.set_xlabel("x across the line, m")
    axes.set_ylabel("z above the ground, m")
    axes.legend(
        handles=legend_of(survey),
        loc="upper center",
        bbox_to_anchor=(0.5, -0.42 / (axes.get_position().height * axes.figure.get_figheight())),
        borderaxespad=0.0,
        ncol=5,
        fontsize=7,
        frameon=False,
    )


def _draw_wires(axes: Any, document: dict[str, Any]) -> None:
    """Keep-outs of the conductors, and the height of the first wire of each bundle."""
    labelled: set[str] = set()
    targets = _targets(document).values()
    for entry in document["obstacles"]:
        wire = entry.get("conductor")
        if not wire:
            continue
        at = wire["x_m"], wire["z_m"]
        keep_out = Circle(at, wire["keep_out_m"], fill=False, edgecolor=_RED, linewidth=0.8)
        axes.add_patch(keep_out)
        axes.plot(*at, ".", color=_CLASSES[14][1], markersize=3)
        bundle = re.sub(r"(?<=\d)[a-h]$", "", wire["name"])
        if bundle in labelled:
            continue
        labelled.add(bundle)
        right = at[0] >= 0.0
        covered = any(  # by a target: the text is placed below
            (x >= at[0]) == right and abs(z - at[1]) < 1.0 for x, z in targets
        )
        offset = (14 if right else -14, -12 if covered else 0)
        _write(axes, f"{bundle}  {at[1]:.1f} m", at, offset, "left" if right else "right")


def legend_of(survey: SurveyView) -> list[Any]:
    """The legend of the objects in this picture."""
    document = survey.document

    def dot(label: str, marker: str, colour: str, size: float = 4.0) -> Line2D:
        return Line2D(
            [], [], marker=marker, linestyle="", color=colour, markersize=size, label=label
        )

    named = {
        label: dot(label, "o", colour)
        for kind, (label, colour) in _CLASSES.items()
        if (survey.classes == kind).any()
    }
    for mark in survey.marks:
        label, marker, colour = _MARKS[mark.kind]
        named.setdefault(label, dot(label, marker, colour))
    if document["targets"]:
        named["target"] = dot("target", "*", _RED, 7.0)
    entries = [entry for entry in document["obstacles"] if "polygon" in entry]
    handles: list[Any] = list(named.values())
    if entries:
        handles.append(Patch(facecolor=_STANDING[0], edgecolor=_STANDING[1], label="obstacle"))
    if len(entries) < len(document["obstacles"]):
        ring = dot("keep-out of a conductor", "o", _RED, 7.0)
        ring.set_markerfacecolor("none")
        handles.append(ring)
    handles.append(Patch(fill=False, edgecolor=INK, label="workspace"))
    handles.append(Line2D([], [], color=INK, linestyle="--", label="plane"))
    lone = len(survey.left_out_m)
    if lone:
        label = f"left out: {lone} lone point{'s' if lone > 1 else ''}"
        handles.append(dot(label, "x", _RED, 6.0))
    handles += [
        dot(
            f"left out: {mark.kind} {mark.name}, {mark.left_out_m:.0f} m from the plane",
            "x",
            _RED,
            6.0,
        )
        for mark in survey.marks
        if mark.left_out_m is not None
    ]
    return handles


def _write(
    axes: Any, text: str, at: Any, offset: tuple[float, float], side: str = "center"
) -> None:
    """A text beside a place; offset in points."""
    axes.annotate(
        text,
        tuple(at),
        xytext=offset,
        textcoords="offset points",
        ha=side,
        va="center",
        fontsize=7,
        parse_math=False,
        annotation_clip=True,
    )


def _targets(document: dict[str, Any]) -> dict[str, tuple[float, float]]:
    """Places of the targets."""
    wires = {
        entry["conductor"]["name"]: entry["conductor"]
        for entry in document["obstacles"]
        if "conductor" in entry
    }
    sides = {"left": (-1.0, 0.0), "right": (1.0, 0.0), "above": (0.0, 1.0), "below": (0.0, -1.0)}
    places = {}
    for name, target in document["targets"].items():
        if "x_m" in target:
            places[name] = (target["x_m"], target["z_m"])
            continue
        wire, towards = wires[target["conductor"]], sides[target["side"]]
        distance = wire["radius_m"] + target["standoff_m"]
        places[name] = (
            wire["x_m"] + towards[0] * distance,
            wire["z_m"] + towards[1] * distance,
        )
    return places

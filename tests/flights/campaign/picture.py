"""Picture of a flight in the plane of its site: the true course, the setpoints, the violations."""

from __future__ import annotations

import io
import math

import numpy as np
from matplotlib.patches import Circle
from matplotlib.patches import Polygon as Outline

from moar_companion.analysis.evaluation.figures.drawing import new_figure
from moar_companion.planner.site import Conductor, Site

from .flying import Record
from .judge import Judgement, controlled

_INK, _FLOWN, _SENT, _BROKEN, _FAULT = "#1b1d21", "#1f5fd0", "#e69f00", "#d01f2e", "#7a4fb5"


def flight_png(record: Record, judgement: Judgement) -> bytes:
    """The picture as PNG."""
    drawn = record.draw
    figure = new_figure(11.0, 7.5)
    axes = figure.add_subplot()
    _draw_obstacles(axes, drawn.site, record.vehicle.radius_m, _INK)
    if drawn.mapped is not None:
        _draw_obstacles(axes, drawn.mapped, record.vehicle.radius_m, _FAULT)
    ours = controlled(record)
    for places, colour, width, label in (
        (record.true_m, "#b4b7bc", 0.8, "true course"),
        (np.where(ours[:, None], record.true_m, math.nan), _FLOWN, 1.6, "… by the companion"),
    ):
        axes.plot(places[:, 0], places[:, 2], color=colour, linewidth=width, label=label)
    sent = np.array([item.reported_m for item in record.sent]).reshape(-1, 3)
    axes.plot(sent[:, 0], sent[:, 2], ".", color=_SENT, markersize=1.5, label="setpoints")
    marks = [
        (began_s, name.partition(" ")[2], _FAULT, "v")
        for name, (began_s, _) in record.began_s.items()
    ]
    marks += [
        (item.time_s, _words(item.rule, item.value, item.outside), _BROKEN, "X")
        for item in judgement.violations
    ]
    for time_s, words, colour, marker in sorted(marks):
        index = min(int(np.searchsorted(record.time_s, time_s)), len(record.time_s) - 1)
        x_m, _, z_m = record.true_m[index]
        axes.plot(x_m, z_m, marker, color=colour, markersize=7, zorder=5)
        axes.annotate(
            f"{time_s:.1f} s {words}",
            (x_m, z_m),
            xytext=(6, 6),
            textcoords="offset points",
            color=colour,
            fontsize=7,
        )
    space = drawn.site.workspace
    axes.plot(
        [space.lower_m[0], space.upper_m[0], space.upper_m[0], space.lower_m[0], space.lower_m[0]],
        [space.lower_m[1], space.lower_m[1], space.upper_m[1], space.upper_m[1], space.lower_m[1]],
        ":",
        color="#55585e",
        linewidth=0.8,
    )
    kinds = ", ".join(fault.kind for fault in drawn.faults)
    axes.set_title(
        f"seed {drawn.seed}, {drawn.manner.value}, {drawn.vehicle}, {drawn.site.name}:"
        f" {judgement.verdict}\n{kinds}",
        fontsize=9,
    )
    axes.set_aspect("equal")
    axes.set_xlabel("x (m)")
    axes.set_ylabel("z (m)")
    axes.legend(loc="lower left", fontsize=7)
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=110)
    return stream.getvalue()


def _words(rule: str, value: float, outside: tuple[str, ...]) -> str:
    beyond = f" (outside: {', '.join(outside)})" if outside else ""
    return f"{rule} {value:g}{beyond}"


def _draw_obstacles(axes, site: Site, radius_m: float, colour: str) -> None:
    """Obstacles, and around conductors where the aircraft's middle touches them or a keep-out."""
    for item in site.obstacles:
        if not isinstance(item, Conductor):
            axes.add_patch(Outline(item.vertices_m, facecolor=colour, alpha=0.6))
            continue
        axes.plot(*item.position_m, "o", color=colour, markersize=3)
        for kept_m, style in ((0.0, "-"), (item.keep_out_m, "--")):
            around_m = item.radius_m + radius_m + kept_m
            circle = Circle(item.position_m, around_m, fill=False, color=colour, linestyle=style)
            circle.set_linewidth(0.7)
            axes.add_patch(circle)

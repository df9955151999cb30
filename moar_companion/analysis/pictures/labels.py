"""Names beside points on axes, moved apart from each other and from marks they would hide."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import patheffects

from ...planner.grid import FloatArray
from ...planner.site import PlanePoint
from .figure import INK

_LABEL = "label"
"""The gid of the names that `place_labels` moves."""
_TIME_ROWS = 6
_ROW_IN, _LETTER_IN = 0.14, 0.065
"""Rows of names above axes of time, their height, and the width of a letter there."""
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
"""Places of a name beside its point: offset (points of print) and alignment."""


def label(axes: Any, point_m: PlanePoint, text: str, *, bold: bool = False) -> None:
    """Name a point; `place_labels` chooses the place beside it."""
    axes.annotate(
        text,
        point_m,
        xytext=(0.0, 9.0),
        textcoords="offset points",
        fontsize=8.5,
        weight="bold" if bold else "normal",
        color=INK,
        path_effects=[patheffects.withStroke(linewidth=2.6, foreground="white")],
        gid=_LABEL,
        zorder=10,
        parse_math=False,
    )


def name_times(axes: Any, times: Sequence[tuple[float, str]]) -> None:
    """Draws a line at each time up to its name above the axes; no line crosses a name.

    times: in order, within the axes' limits. Where many are close, the first names overlap.
    """
    begin, end = axes.get_xlim()
    extent = axes.get_window_extent()
    width_in, height_in = extent.width / axes.figure.dpi, extent.height / axes.figure.dpi
    along = {"transform": axes.get_xaxis_transform(), "clip_on": False}
    rows: list[tuple[float, int]] = []
    for time, name in reversed(times):
        words = f" {name.replace('_', ' ')}"
        until = time + len(words) * _LETTER_IN / width_in * (end - begin)
        row = max((row + 1 for later, row in rows if later < until), default=0)
        rows.append((time, min(row, _TIME_ROWS - 1)))
        bottom = 1.0 + (0.05 + _ROW_IN * rows[-1][1]) / height_in
        axes.plot(
            [time, time],
            [0.0, bottom + 0.8 * _ROW_IN / height_in],
            color="#888888",
            lw=0.6,
            **along,
        )
        axes.text(time, bottom, words, fontsize=7.5, color="#444444", va="bottom", **along)


def place_labels(axes: Any, path_m: FloatArray | None = None) -> None:
    """Moves the names on axes apart from each other, from the path (n, 2) and from markers.

    A name without room is left out.
    """
    figure = axes.figure
    figure.draw_without_rendering()
    renderer = figure.canvas.get_renderer()
    point_px = figure.dpi / 72.0
    labels = [text for text in axes.texts if text.get_gid() == _LABEL]
    room = axes.get_window_extent(renderer).padded(-2.0 * point_px)
    in_the_way = _in_the_way(axes, labels, path_m)
    placed: list[Any] = []
    for text in labels:
        best = None
        for place in _PLACES:
            _move(text, place)
            box = text.get_window_extent(renderer).padded(3.0 * point_px)
            if any(box.overlaps(other) for other in placed):
                continue
            if not (room.contains(box.x0, box.y0) and room.contains(box.x1, box.y1)):
                continue
            low = (box.x0 - 4.0 * point_px, box.y0 - 3.0 * point_px)
            high = (box.x1 + 4.0 * point_px, box.y1 + 3.0 * point_px)
            hidden = int(((in_the_way > low) & (in_the_way < high)).all(axis=1).sum())
            if best is None or hidden < best[0]:
                best = (hidden, place, box)
        if best is None:
            text.set_visible(False)
            continue
        _move(text, best[1])
        placed.append(best[2])


def _in_the_way(axes: Any, labels: list[Any], path_m: FloatArray | None) -> FloatArray:
    """Points (n, 2), in pixels, that a name should not hide: markers, the path, arrows."""
    transform = axes.transData.transform
    points = [np.empty((0, 2))]
    if labels:
        points.append(transform([text.xy for text in labels]))
    if path_m is not None and len(path_m):
        points.append(transform(path_m))
    arrows = [text for text in axes.texts if text.arrow_patch is not None]
    for tail, head in (transform([arrow.xyann, arrow.xy]) for arrow in arrows):
        points.append(np.linspace(tail, head, 20))
    return np.concatenate(points)


def _move(text: Any, place: tuple[tuple[float, float], str, str]) -> None:
    offset, horizontal, vertical = place
    text.set_position(offset)
    text.set_ha(horizontal)
    text.set_va(vertical)

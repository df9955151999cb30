"""Fig. 8 of the paper: paths, clearance and length under risks; and the same for all scenes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ....planner.analysis.baselines import BaselineKind
from ....types import Mission
from ...pictures.figure import INK, page_style
from ..adaptability import LEVELS, SHOWN, Adaptability, Way
from ..scenes import SWEPT, problem
from .drawing import (
    BASELINE_COLOURS,
    BASELINE_NAMES,
    Picture,
    draw_coloured_paths,
    draw_free_space,
    label_combinations,
    new_figure,
    picture,
)

COLOURS: dict[tuple[int, ...], str] = {
    (0, 0, 0): "#202020",
    (1, 0, 0): "#1a9641",
    (0, 1, 0): "#d7191c",
    (0, 0, 1): "#2c7bb6",
    (1, 1, 0): "#00c4d4",
    (1, 0, 1): "#e6b800",
    (0, 1, 1): "#c51b8a",
    (1, 1, 1): "#8c6d46",
}
"""Colours of the integer combinations of wind, battery and localization risk, as in the paper:
yellow for wind and localization, cyan for wind and battery."""
RISKS = ("wind", "battery", "GPS")
_WAY_COLOURS = ("#8a8f98", "#b58900", "#d6006e", "#5b2a86")
_CURVES = {"mean_clearance_m": "average distance to obstacles (m)", "length_m": "path length (m)"}


def figure_8(results: Sequence[Adaptability]) -> Picture:
    """Sensitivity to risk, inspection in Env. 1: one row for each way of adaptation."""
    result = _of(results, 1, Mission.INSPECTION)
    ways = list(result.responses)
    with page_style():
        figure = new_figure(14.0, 3.9 * len(ways) + 0.4)
        for row, way in zip(figure.subplots(len(ways), 3, squeeze=False), ways, strict=True):
            response = result.responses[way]
            draw_free_space(row[0], problem(result.scene))
            draw_coloured_paths(
                row[0], result.paths.points_m, response.path, response.risks, COLOURS
            )
            row[0].set_title(f"(a) {result.scene.name}: {way.name}", fontsize=9.5)
            for axes, letter, metric in zip(row[1:], "bc", _CURVES, strict=True):
                _draw_curve(axes, result, way, metric)
                axes.set_title(f"({letter}) {way.name}", fontsize=9.5)
        handles, names = figure.axes[1].get_legend_handles_labels()
        label_combinations(figure, COLOURS, RISKS, handles, names)
        return picture(
            figure,
            "fig8_risks",
            "Fig. 8: sensitivity to risk factors, Env. 1, inspection",
            f"The paper's figure is the row of {SHOWN.name}. Points: the six wind risks of the "
            "paper, all other risks 0; the line is a grid of 101.",
        )


def figure_8_all(results: Sequence[Adaptability]) -> Picture:
    """Position between A* and Voronoi against wind risk, the nine scenes as surveyed."""
    shown = [result for result in results if result.scene in SWEPT]
    with page_style():
        figure = new_figure(12.0, 2.1 * len(shown) + 0.4)
        for row, result in zip(figure.subplots(len(shown), 2, squeeze=False), shown, strict=True):
            for axes, metric in zip(row, _CURVES, strict=True):
                for way, colour in zip(result.responses, _WAY_COLOURS, strict=False):
                    response = result.responses[way]
                    values = result.paths.metric(metric)[response.wind_path]
                    axes.plot(response.fine, values, color=colour, label=way.name)
                _draw_levels(axes, result, metric)
                axes.set_title(result.scene.name, fontsize=9)
                axes.set_ylabel(_CURVES[metric], fontsize=8)
        figure.axes[-1].set_xlabel("wind risk")
        figure.axes[-2].set_xlabel("wind risk")
        handles, names = figure.axes[0].get_legend_handles_labels()
        figure.legend(handles, names, loc="outside lower center", ncols=7, frameon=False)
        return picture(
            figure,
            "fig8_all_scenes",
            "Fig. 8 (b) and (c) for all environments and missions",
            "Average distance to obstacles and path length against wind risk, all other risks 0.",
        )


FIGURES = (figure_8, figure_8_all)


def _of(results: Sequence[Adaptability], environment: int, mission: Mission) -> Adaptability:
    return next(
        result
        for result in results
        if result.scene in SWEPT
        and (result.scene.environment, result.scene.mission) == (environment, mission)
    )


def _draw_curve(axes: Any, result: Adaptability, way: Way, metric: str) -> None:
    """Draws a metric against wind risk, with the baselines as lines."""
    response = result.responses[way]
    values = result.paths.metric(metric)
    axes.plot(response.fine, values[response.wind_path], color=INK, linewidth=1.0)
    coarse = np.linspace(0, len(response.fine) - 1, LEVELS).round().astype(int)
    axes.plot(
        response.fine[coarse],
        values[response.wind_path[coarse]],
        "o",
        color=INK,
        markersize=5,
        label="our planner",
    )
    _draw_levels(axes, result, metric)
    axes.set_xlabel("wind risk")
    axes.set_ylabel(_CURVES[metric])


def _draw_levels(axes: Any, result: Adaptability, metric: str) -> None:
    for kind in BaselineKind:
        value = result.baselines.value(kind, metric)
        if np.isfinite(value):
            axes.axhline(
                value,
                color=BASELINE_COLOURS[kind],
                linestyle=(0, (5, 2)),
                linewidth=1.4,
                label=BASELINE_NAMES[kind],
            )

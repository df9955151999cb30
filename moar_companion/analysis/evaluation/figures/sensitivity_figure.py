"""Fig. 6 and 7 of the paper, and the exact front beside them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.colors import Normalize
from scipy.spatial import cKDTree

from ....planner.grid import FloatArray
from ....types import Mission
from ...pictures.figure import INK, page_style
from ..scenes import problem
from ..sensitivity import SHOWN, Sensitivity
from .drawing import (
    BASELINE_NAMES,
    Picture,
    draw_baselines,
    draw_coloured_paths,
    draw_free_space,
    label_combinations,
    new_figure,
    picture,
)

COLOURS: dict[tuple[int, ...], str] = {
    (1, 0, 0): "#1a9641",
    (0, 1, 0): "#f07f09",
    (0, 0, 1): "#7b3294",
    (1, 1, 0): "#9a9a00",
    (1, 0, 1): "#00a5b5",
    (0, 1, 1): "#d6006e",
    (1, 1, 1): "#202020",
}
"""Colours of the integer combinations of k_S, k_T, k_E, as in the paper: k_S alone is green and
k_T alone orange."""
WEIGHTS = ("$k_S$", "$k_T$", "$k_E$")
IN_PAPER = ((1, Mission.EXIT), (2, Mission.INSPECTION), (3, Mission.EVACUATION))
"""The scenes of Fig. 6."""
METRIC_NAMES = {
    "length_m": "path length (m)",
    "duration_s": "path duration (s)",
    "mean_clearance_m": "average distance to obstacles (m)",
    "velocity_change_mps": "total velocity changes (m/s)",
}
_RASTER = 240
_SATURATION = 99.5
"""Percentile of the greatest colour (Section V-A)."""
_OUTLIER = 1.5


def figure_6(results: Sequence[Sensitivity]) -> Picture:
    """Path comparison and sensitivity, the three scenes of the paper."""
    chosen = [
        result
        for which in IN_PAPER
        for result in results
        if (result.scene.environment, result.scene.mission) == which
    ]
    with page_style():
        figure = new_figure(11.0, 3.9 * len(chosen) + 0.5)
        panels = figure.subplots(len(chosen), 2, squeeze=False)
        for (left, right), result in zip(panels, chosen, strict=True):
            name = f"Env. {result.scene.environment} {result.scene.mission.value}"
            posed = problem(result.scene)
            for axes, what in ((left, "comparison"), (right, "sensitivity")):
                draw_free_space(axes, posed)
                axes.set_title(f"{name} {what}")
            draw_baselines(left, result.baselines)
            draw_coloured_paths(
                right, result.paths.points_m, result.path, result.combinations, COLOURS
            )
        handles, names = panels[0][0].get_legend_handles_labels()
        label_combinations(figure, COLOURS, WEIGHTS, handles, names)
        return picture(
            figure,
            "fig6_paths",
            "Fig. 6: path comparison and sensitivity",
            "Left: the three baselines. Right: the paths of all combinations of weights, solid "
            "for integer combinations, dotted in the colour of the nearest one. Occupied space is "
            "black, the Voronoi diagram grey, exit edges blue, evacuation edges red.",
        )


def figure_6_all(results: Sequence[Sensitivity]) -> Picture:
    """The same for all nine scenes, the baselines beneath the sweep."""
    with page_style():
        figure = new_figure(14.0, 10.6)
        panels = figure.subplots(3, 3).flat
        for axes, result in zip(panels, results, strict=True):
            draw_free_space(axes, problem(result.scene))
            draw_baselines(axes, result.baselines, width=4.2)
            draw_coloured_paths(
                axes, result.paths.points_m, result.path, result.combinations, COLOURS
            )
            axes.set_title(f"{result.scene.name}: {len(result.paths.points_m)} paths", fontsize=9.5)
        return picture(
            figure,
            "fig6_all_scenes",
            "Fig. 6 for all environments and missions",
            "The sweep over the baselines (broad): A* orange, Voronoi blue, envelope green.",
        )


def figure_7(results: Sequence[Sensitivity]) -> Picture:
    """The metrics over all weights, Env. 2 inspection."""
    result = next(
        each
        for each in results
        if (each.scene.environment, each.scene.mission) == (2, Mission.INSPECTION)
    )
    weights = result.combinations / result.combinations.sum(axis=1, keepdims=True)
    tree = cKDTree(weights[:, :2])
    middles = (np.arange(_RASTER) + 0.5) / _RASTER
    places = np.stack(np.meshgrid(middles, middles, indexing="ij"), axis=-1)
    nearest = tree.query(places.reshape(-1, 2))[1].reshape(_RASTER, _RASTER)
    inside = places.sum(axis=-1) <= 1.0
    with page_style():
        figure = new_figure(11.0, 9.0)
        for axes, name in zip(figure.subplots(2, 2).flat, SHOWN, strict=True):
            _draw_triangle(axes, figure, np.where(inside, result.metric(name)[nearest], np.nan))
            axes.set_title(METRIC_NAMES[name])
            shown = [
                f"{BASELINE_NAMES[kind]} {result.baselines.value(kind, name):.1f}"
                for kind in result.baselines.metrics
            ]
            if name in {"length_m", "mean_clearance_m"}:
                axes.text(0.98, 0.86, "\n".join(shown), ha="right", fontsize=8, color=INK)
        return picture(
            figure,
            "fig7_metrics",
            "Fig. 7: trajectory metrics in Env. 2, inspection",
            "Each point is a combination of weights, normalised: k_S to the right, k_T upwards, "
            "k_E towards the lower left corner. Red: above the 99.5-percentile, where the greatest "
            "value is far above it (its value in the panel).",
        )


def figure_front(results: Sequence[Sensitivity]) -> Picture:
    """The exact front and the sweep's paths, by their sums."""
    with page_style():
        figure = new_figure(13.0, 10.5)
        for axes, result in zip(figure.subplots(3, 3).flat, results, strict=True):
            sums = result.front.sums
            axes.scatter(
                *sums[:, :2].T, s=46, facecolors="none", edgecolors=INK, label="exact front"
            )
            axes.scatter(
                *result.paths.sums[:, :2].T,
                c=result.paths.sums[:, 2],
                s=13,
                cmap="viridis",
                label="sweep",
            )
            swept, exact = result.hypervolumes
            share = f"{100.0 * swept / exact:.1f} %" if exact > 0.0 else "one point"
            axes.set_title(f"{result.scene.name}: hypervolume {share}", fontsize=9)
            axes.set_xlabel("Σ SC d (m)")
            axes.set_ylabel("Σ TC (s)")
        figure.axes[0].legend(fontsize=8)
        return picture(
            figure,
            "front",
            "The sweep and the exact Pareto front",
            "Each point is a path: sum of safety and of time cost, colour for energy. Rings: the "
            "exact (supported) front. The hypervolume is the sweep's, as part of the front's.",
        )


FIGURES = (figure_6, figure_6_all, figure_7, figure_front)


def _draw_triangle(axes: Any, figure: Any, values: FloatArray) -> None:
    known = values[np.isfinite(values)]
    low, greatest = float(known.min()), float(known.max())
    high = float(np.percentile(known, _SATURATION))
    saturates = greatest - low > _OUTLIER * (high - low)
    colours = colormaps["viridis"].with_extremes(over="#e4002b", bad="white")
    image = axes.imshow(
        values.T,
        origin="lower",
        extent=(0.0, 1.0, 0.0, 1.0),
        cmap=colours,
        norm=Normalize(low, high if saturates else greatest),
        interpolation="nearest",
    )
    figure.colorbar(image, ax=axes, extend="max" if saturates else "neither")
    axes.plot([0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], color=INK, linewidth=1.0)
    axes.set_xlabel("$k_S$")
    axes.set_ylabel("$k_T$")
    axes.annotate(
        "$k_E$",
        xy=(0.03, 0.03),
        xytext=(0.16, 0.16),
        color="white",
        arrowprops={"arrowstyle": "->", "color": "white"},
    )
    if saturates:
        axes.text(0.98, 0.96, f"max {greatest:.1f}", ha="right", fontsize=8, color="#e4002b")

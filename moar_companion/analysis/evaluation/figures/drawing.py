"""Parts of all figures: pages, the plane of a scene as in the paper's Fig. 6, coloured paths."""

from __future__ import annotations

import io
import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from ....planner.analysis.baselines import BaselineKind, voronoi_cells
from ....planner.grid import BoolArray, FloatArray, IntArray
from ....planner.maps import Maps
from ....planner.regions import goal_region
from ....planner.site import Site
from ....types import Mission
from ...pictures.figure import DPI, INK
from ..paths import Baselines
from ..scenes import Problem

BASELINE_COLOURS = {
    BaselineKind.SHORTEST: "#d55e00",
    BaselineKind.VORONOI: "#0072b2",
    BaselineKind.ENVELOPE: "#009e73",
}
BASELINE_NAMES = {
    BaselineKind.SHORTEST: "A*, shortest",
    BaselineKind.VORONOI: "Voronoi",
    BaselineKind.ENVELOPE: "envelope",
}
_FREE, _OCCUPIED, _VORONOI = "#eeeff1", "#1b1d21", "#b4b7bc"
_REGIONS = {Mission.EXIT: "#1f5fd0", Mission.EVACUATION: "#d01f2e"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A figure in files. name: without ending."""

    name: str
    title: str
    caption: str
    png: bytes
    svg: bytes


def new_figure(width_in: float, height_in: float) -> Any:
    """An empty white figure without a screen; it arranges its axes itself."""
    figure: Any = Figure(figsize=(width_in, height_in), facecolor="white", layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def picture(figure: Any, name: str, title: str, caption: str) -> Picture:
    """The files of a figure, the same each time."""
    png, svg = io.BytesIO(), io.BytesIO()
    with rc_context({"svg.hashsalt": name}):
        figure.savefig(png, format="png", dpi=DPI)
        figure.savefig(svg, format="svg", metadata={"Date": None})
    return Picture(name=name, title=title, caption=caption, png=png.getvalue(), svg=svg.getvalue())


def draw_free_space(axes: Any, posed: Problem, *, goals: bool = True) -> None:
    """Draws free and occupied space, Voronoi diagram, goal region, conductors, start and goal."""
    planner, request = posed.planner, posed.request
    site, maps = planner.site, planner.maps
    extent = set_up_plane(axes, site, maps)
    axes.set_facecolor(_FREE)
    for cells, colour in (
        (voronoi_cells(site, maps), _VORONOI),
        (maps.occupied, _OCCUPIED),
    ):
        paint(axes, cells, colour, extent)
    if goals and not request.mission.visits_targets:
        region = goal_region(site, planner.vehicle, maps, request.mission)
        paint(axes, region.mask, _REGIONS[request.mission], extent)
    draw_conductors(axes, site)
    if goals:
        axes.plot(*request.start_m, "o", color="white", markeredgecolor=INK, markersize=6, zorder=9)
        if request.mission.visits_targets:
            target = site.target(str(request.target)).position_m
            axes.plot(*target, "*", color="#ffd23f", markeredgecolor=INK, markersize=11, zorder=9)


def set_up_plane(axes: Any, site: Site, maps: Maps) -> tuple[float, float, float, float]:
    """Sets limits and labels of axes for a plane; returns the extent of the maps."""
    (x_low, z_low), (x_high, z_high) = maps.grid.lower_m, maps.grid.upper_m
    axes.set_aspect("equal")
    axes.set_xlim(site.workspace.lower_m[0], site.workspace.upper_m[0])
    axes.set_ylim(site.workspace.lower_m[1], site.workspace.upper_m[1])
    axes.set_xlabel("x (m)")
    axes.set_ylabel("z (m)")
    return x_low, x_high, z_low, z_high


def paint(axes: Any, cells: BoolArray, colour: str, extent: tuple[float, ...]) -> None:
    """Paints cells in one colour."""
    axes.imshow(
        np.where(cells, 0.0, np.nan).T,
        extent=extent,
        origin="lower",
        cmap=ListedColormap([colour]),
        interpolation="nearest",
        aspect="equal",
        zorder=2,
    )


def draw_conductors(axes: Any, site: Site, colour: str = "black") -> None:
    """Draws the conductors in the window as discs of visible size."""
    points = [item.position_m for item in site.conductors]
    axes.plot(
        *np.array(points).T, "o", color=colour, markeredgecolor="white", markersize=5.5, zorder=8
    )


def draw_baselines(axes: Any, baselines: Baselines, width: float = 2.2) -> None:
    """Draws the paths of the baselines."""
    for kind, points in baselines.points_m.items():
        axes.plot(
            *points.T,
            color=BASELINE_COLOURS[kind],
            linewidth=width,
            label=BASELINE_NAMES[kind],
            zorder=6,
        )


def draw_coloured_paths(
    axes: Any,
    points_m: Sequence[FloatArray],
    path: IntArray,
    combinations: FloatArray,
    colours: dict[tuple[int, ...], str],
) -> None:
    """Draws the paths of a sweep: those of integer combinations solid, all others dotted.

    A dotted path has the colour of the integer combination nearest to most of its combinations.
    """
    corners = np.array(list(colours), dtype=np.float64)
    distance = np.linalg.norm(combinations[:, None, :] - corners[None, :, :], axis=2)
    nearest = distance.argmin(axis=1)
    names = list(colours.values())
    dotted = []
    for number in np.unique(path):
        votes = np.bincount(nearest[path == number], minlength=len(names))
        dotted.append((int(number), names[int(votes.argmax())]))
    axes.add_collection(
        LineCollection(
            [points_m[number] for number, _ in dotted],
            colors=[colour for _, colour in dotted],
            linewidths=1.1,
            linestyles=(0, (1.0, 1.3)),
            zorder=5,
        ),
        autolim=False,
    )
    at = [int(each) for each in distance.argmin(axis=0)]
    # Several lines of the same path overlap: each later line is thinner.
    widths = itertools.count(0)
    drawn: dict[int, int] = {}
    for corner, colour in zip(at, names, strict=True):
        number = int(path[corner])
        drawn[number] = drawn.get(number, -1) + 1
        axes.plot(
            *points_m[number].T,
            color=colour,
            linewidth=max(3.4 - 0.8 * drawn[number], 0.8),
            solid_capstyle="round",
            zorder=6 + 0.01 * next(widths),
        )


def label_combinations(
    figure: Any,
    colours: dict[tuple[int, ...], str],
    names: Sequence[str],
    handles: Sequence[Any],
    labels: Sequence[str],
) -> None:
    """Adds a legend below: handles with their labels, then the colours of combinations."""
    lines = [Line2D([], [], color=colour, linewidth=2.6) for colour in colours.values()]
    figure.legend(
        [*handles, *lines],
        [*labels, *(_combination(each, names) for each in colours)],
        loc="outside lower center",
        ncols=6,
        fontsize=8.5,
        frameon=False,
    )


def _combination(values: tuple[int, ...], names: Sequence[str]) -> str:
    shown = [name for name, value in zip(names, values, strict=True) if value]
    return " = ".join(shown) + " = 1" if shown else "all 0"

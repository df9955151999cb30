"""Fig. 2 to 5 and 9 of the paper: cost terms, safety cost, speed map, graph, actions, a flight."""

from __future__ import annotations

from typing import Any

import numpy as np

from ....planner.graph import heading_speeds_mps
from ....planner.grid import FloatArray
from ....planner.planner import Planner
from ....types import Mission
from ...pictures.figure import INK, page_style
from ...pictures.site_axes import draw_plane, view_of
from ..flight import FlightTest
from ..scenes import SPLICES, Scene, problem
from .drawing import Picture, draw_conductors, new_figure, paint, picture, set_up_plane

_COST_COLOURS = "RdYlBu_r"
"""Red is 1 and blue is 0."""
_ARROW = "#2bff4a"
_ARROWS_EACH_M = 5.1
_LONGEST_M, _SHORTEST_M = 2.4, 0.1
_WINDOW_M = 4.5
_FLOWN = ("#1f5fd0", "#c51b8a")


def figure_maps(environment: int) -> Picture:
    """The maps of an environment."""
    scene = Scene(
        environment=environment, mission=Mission.INSPECTION, splice=SPLICES[0], displaced=False
    )
    posed = problem(scene)
    planner, maps, shape = posed.planner, posed.planner.maps, posed.planner.vehicle.safety
    with page_style():
        figure = new_figure(14.0, 7.6)
        (first, second) = figure.subplots(2, 3)
        costs = (
            ("(a) collision", maps.collision_cost),
            ("(b) insertion", maps.insertion_cost),
            ("(c) damage", maps.damage_cost),
        )
        for axes, (name, cost) in zip(first, costs, strict=True):
            _draw_cost(axes, planner, cost)
            axes.set_title(f"Fig. 2 {name}")
        image = _draw_cost(second[0], planner, maps.safety_cost)
        figure.colorbar(image, ax=first, label="C(d)", shrink=0.8)
        second[0].set_title(
            f"Fig. 3: $SC_i$, $k_a$ = {shape.collision:g}, $k_b$ = {shape.insertion:g}, "
            f"$k_c$ = {shape.damage:g}"
        )
        speeds = _draw_speeds(second[1], planner)
        figure.colorbar(speeds, ax=second[1], label="m/s", shrink=0.8)
        second[1].set_title("Fig. 4: $v_{sat}(d_{obs})$ and v(θ)")
        _draw_graph(second[2], planner)
        second[2].set_ylabel("")
        second[2].set_title("Fig. 5: the 9 actions of a node, and a path")
        return picture(
            figure,
            f"fig2to5_env{environment}",
            f"Fig. 2 to 5: maps and graph, {planner.site.name}",
            f"d_min = {shape.d_min_m:g} m, d_max = {shape.d_max_m:g} m. Costs: red is 1, blue is "
            "0. Speed: low is black, high is yellow; green arrows are v(d_obs, θ) by direction, "
            "2.4 m long for the greatest speed. Graph: white is free, "
            "black occupied; blue arrows are the actions of a node, the ring is the stop; orange "
            "is a part of the optimal path, a dot for each node.",
        )


def _draw_cost(axes: Any, planner: Planner, cost: FloatArray) -> Any:
    extent = set_up_plane(axes, planner.site, planner.maps)
    image = axes.imshow(
        cost.T,
        extent=extent,
        origin="lower",
        cmap=_COST_COLOURS,
        vmin=0.0,
        vmax=1.0,
        interpolation="nearest",
    )
    draw_conductors(axes, planner.site)
    return image


def _draw_speeds(axes: Any, planner: Planner) -> Any:
    """The speed limit, and arrows of v(d_obs, heading) in some cells."""
    maps, graph = planner.maps, planner.graph
    extent = set_up_plane(axes, planner.site, maps)
    image = axes.imshow(
        maps.speed_limit_mps.T,
        extent=extent,
        origin="lower",
        cmap="inferno",
        interpolation="nearest",
    )
    each = round(_ARROWS_EACH_M / maps.grid.resolution_m)
    x_m, z_m = (axis[each // 2 :: each] for axis in maps.grid.axes_m)
    limit = maps.speed_limit_mps[each // 2 :: each, each // 2 :: each]
    heading_speed = heading_speeds_mps(planner.vehicle.speed)[1:]
    speed = np.minimum(limit[..., None], heading_speed) / graph.v_max_mps
    length = np.maximum(_LONGEST_M * speed, _SHORTEST_M)
    centres = np.stack(np.meshgrid(x_m, z_m, indexing="ij"), axis=-1)[:, :, None, :]
    tails = np.broadcast_to(centres, (*length.shape, 2)).reshape(-1, 2)
    arrows = (length[..., None] * graph.unit[1:]).reshape(-1, 2)
    axes.quiver(
        *tails.T,
        *arrows.T,
        color=_ARROW,
        angles="xy",
        scale_units="xy",
        scale=1.0,
        width=0.004,
    )
    draw_conductors(axes, planner.site)
    return image


def _draw_graph(axes: Any, planner: Planner) -> None:
    """A part of the grid at the target: actions of a node, and the path that ends there."""
    grid, site = planner.maps.grid, planner.site
    plan = planner.plan(mission=Mission.INSPECTION, target=site.targets[0].name)
    path = plan.waypoints.position_m
    extent = set_up_plane(axes, site, planner.maps)
    axes.set_facecolor("white")
    paint(axes, planner.maps.occupied, "#1b1d21", extent)
    end = path[-1]
    low = end - 0.5 * _WINDOW_M
    axes.set_xlim(low[0], low[0] + _WINDOW_M)
    axes.set_ylim(low[1] - 0.6, low[1] + _WINDOW_M - 0.6)
    lines = [
        np.arange(n + 1) * grid.resolution_m + grid.lower_m[at] for at, n in enumerate(grid.shape)
    ]
    for draw, places in zip((axes.axvline, axes.axhline), lines, strict=True):
        for place in places:
            draw(place, color="#c9ccd1", linewidth=0.6, zorder=1)
    axes.plot(*path.T, "-o", color="#f07f09", markersize=3.5, linewidth=1.8, zorder=5)
    cell = grid.cell_of((float(end[0]) - 4 * grid.resolution_m, float(end[1])))
    if cell is not None:
        node = grid.centre_m(cell)
        axes.plot(*node, "o", markersize=11, color="none", markeredgecolor="#1f5fd0", zorder=6)
        axes.plot(*node, "o", markersize=4, color=INK, zorder=6)
        for step in planner.graph.moves.steps[1:]:
            axes.annotate(
                "",
                xy=node + step * grid.resolution_m,
                xytext=node,
                arrowprops={"arrowstyle": "-|>", "color": "#1f5fd0", "linewidth": 1.3},
                zorder=6,
            )
    draw_conductors(axes, site)


def figure_9(result: FlightTest) -> Picture:
    """The flight over the safety map."""
    planner, plan = result.planner, result.plan
    site = planner.site
    with page_style():
        figure = new_figure(8.6, 7.4)
        axes = figure.subplots()
        heat = draw_plane(axes, site, planner.maps, view_of(site, planner.vehicle, []))
        axes.plot(
            *plan.waypoints.position_m.T, color="#202020", linewidth=3.4, label="planned", zorder=6
        )
        for (autopilot, flight), colour in zip(result.flown.items(), _FLOWN, strict=False):
            axes.plot(
                *flight.places_m.T, color=colour, linewidth=1.4, label=f"flown, {autopilot}",
                zorder=7,
            )  # fmt: skip
        axes.plot(*site.targets[0].position_m, "*", color="#ffd23f", markersize=13, zorder=8)
        axes.legend(loc="lower right", fontsize=8.5)
        figure.colorbar(heat, ax=axes, label="safety cost", shrink=0.9)
        return picture(
            figure,
            "fig9_flight",
            "Fig. 9: the flight",
            "Planned inspection trajectory towards the top left conductor, and flights of the "
            "companion in lockstep with the fake autopilots.",
        )

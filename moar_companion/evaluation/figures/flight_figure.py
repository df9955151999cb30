"""Fig. 9 of the paper: planned and flown path towards the top left conductor."""

from __future__ import annotations

from ...outlets.figure import page_style
from ...outlets.site_axes import draw_plane, view_of
from ..flight import FlightTest
from .drawing import Picture, new_figure, picture

_FLOWN = ("#1f5fd0", "#c51b8a")


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

"""The picture of a flight: planned and flown paths over the safety map, the risks over time below.

Input: the decisions that the recorder wrote, and the path that was flown. Output: one figure.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.collections import LineCollection

from ...planner.maps import Maps
from ...planner.site import PlanePoint, Site
from ...settings.vehicle import Vehicle
from ...types import Mission
from .figure import DPI, Page, page_style
from .labels import name_times, place_labels
from .plan_marks import draw_goal
from .site_axes import View, draw_colour_bars, draw_plane, view_of

_RISKS = {
    "wind": "#1f77b4",
    "communication": "#9467bd",
    "localization": "#2ca02c",
    "battery": "#d62728",
}
_MISSIONS = {
    Mission.INSPECTION: colormaps["Blues"],
    Mission.EXIT: colormaps["Purples"],
    Mission.EVACUATION: colormaps["Reds"],
}
_FLOWN = "#111111"
_JUMP, _JUMP_S = 0.4, 6.0
"""Least rise of an index that is named, and the time within which it happens."""
_STEADY = 0.02

# The page, in inches.
_LEFT, _WIDTH, _RIGHT = 0.7, 9.6, 1.55
_BOTTOM, _RISKS_HEIGHT, _BETWEEN, _TOP = 0.55, 1.9, 1.35, 0.45


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedPath:
    """A path that was adopted. points_m: (n, 2) of the plane, landing leg included."""

    time_s: float
    mission: Mission
    points_m: np.ndarray[Any, Any]
    states: int
    """Number of points that belong to the path proper; the rest is the landing leg."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightStory:
    """Decisions of the companion in a flight; times in seconds since its first record.

    risk: (n, 4) in the order of the paper, at time_s (n,).
    """

    plans: tuple[PlannedPath, ...]
    time_s: np.ndarray[Any, Any]
    risk: np.ndarray[Any, Any]
    states: tuple[tuple[float, str], ...]
    orders: tuple[tuple[float, str], ...]

    @classmethod
    def read(cls, path: str | PathLike[str]) -> FlightStory:
        """The story in a `decisions.jsonl`; a last line cut short by a crash is left out."""
        return cls.of(_lines(Path(path).read_text(encoding="utf-8")))

    @classmethod
    def of(cls, decisions: Iterable[dict[str, Any]]) -> FlightStory:
        """The story of recorded decisions."""
        plans, states, orders, times, risks = [], [], [], [], []
        begin_s: float | None = None
        for decision in decisions:
            begin_s = decision["time_s"] if begin_s is None else begin_s
            time_s, data = decision["time_s"] - begin_s, decision["data"]
            match decision["kind"]:
                case "plan":
                    waypoints = data["plan"]["waypoints"]
                    plans.append(
                        PlannedPath(
                            time_s=time_s,
                            mission=Mission(data["plan"]["mission"]),
                            points_m=np.array([(p["x_m"], p["z_m"]) for p in waypoints]),
                            states=len(data["plan"]["states"]),
                        )
                    )
                case "state":
                    states.append((time_s, data["state"]))
                case "order":
                    orders.append((time_s, data["order"]))
                case "status":
                    times.append(time_s)
                    risks.append([data["risk"][name] for name in _RISKS])
        return cls(
            plans=tuple(plans),
            time_s=np.array(times),
            risk=np.array(risks).reshape(-1, len(_RISKS)),
            states=tuple(states),
            orders=tuple(orders),
        )

    @property
    def landing_legs_m(self) -> list[list[PlanePoint]]:
        """The last planned escape route of each place where one ended, from its last cell."""
        legs: dict[PlanePoint, list[PlanePoint]] = {}
        for plan in self.plans:
            if plan.states < len(plan.points_m):
                leg = [(float(x), float(z)) for x, z in plan.points_m[plan.states - 1 :]]
                legs[leg[-1]] = leg
        return list(legs.values())


def draw_flight(
    story: FlightStory,
    flown_m: list[PlanePoint],
    site: Site,
    vehicle: Vehicle,
    maps: Maps,
    file: str | PathLike[str],
) -> None:
    """Draw a flight into a PNG file; `flown_m` are points of the plane in order of time."""
    landing = [point for points in site.landing_m.values() for point in points]
    view = view_of(site, vehicle, [*flown_m, *landing])
    plane_in = _WIDTH * (view[3] - view[2]) / (view[1] - view[0])
    below_in = _BOTTOM + _RISKS_HEIGHT + _BETWEEN
    with page_style():
        page = Page(_LEFT + _WIDTH + _RIGHT, below_in + plane_in + _TOP)
        plane = page.panel(_LEFT, below_in, _WIDTH, plane_in)
        _draw_paths(plane, story, flown_m, site, maps, view)
        _draw_risks(page.panel(_LEFT, _BOTTOM, _WIDTH, _RISKS_HEIGHT), story, vehicle.risk.unknown)
        page.figure.savefig(file, format="png", dpi=DPI)


def _lines(text: str) -> Iterable[dict[str, Any]]:
    for line in text.splitlines():
        try:
            yield json.loads(line)
        except json.JSONDecodeError:
            return


def _draw_paths(
    axes: Any,
    story: FlightStory,
    flown_m: list[PlanePoint],
    site: Site,
    maps: Maps,
    view: View,
) -> None:
    """Planned paths, later ones darker, and the flown one over them."""
    safety = draw_plane(axes, site, maps, view)
    draw_colour_bars(axes, [(safety, "safety cost")])
    for mission, colours in _MISSIONS.items():
        plans = [plan for plan in story.plans if plan.mission is mission]
        if plans:
            shades = colours(np.linspace(1.0, 0.6, len(plans))[::-1])
            axes.add_collection(
                LineCollection([plan.points_m for plan in plans], colors=shades, linewidths=1.5)
            )
            axes.plot([], [], color=shades[-1], lw=1.5, label=f"planned, {mission.value}")
    if flown_m:
        axes.plot(*np.array(flown_m).T, color=_FLOWN, lw=1.8, label="flown")
    for mission in {Mission.INSPECTION} | {plan.mission for plan in story.plans}:
        draw_goal(axes, site, maps, mission, None, None)
    drawn = [np.array(flown_m).reshape(-1, 2), *(plan.points_m for plan in story.plans)]
    place_labels(axes, np.concatenate(drawn))
    named = dict(zip(*reversed(axes.get_legend_handles_labels()), strict=True))
    axes.legend(named.values(), named.keys(), loc="upper left", framealpha=0.9)
    axes.set_title(f"{site.name}: planned and flown", loc="left", fontweight="bold")


def _draw_risks(axes: Any, story: FlightStory, unknown: float) -> None:
    """The four indices over time, with the mission's states named above."""
    for column, (name, colour) in enumerate(_RISKS.items()):
        axes.plot(story.time_s, story.risk[:, column], color=colour, lw=1.6, label=name)
        _name_changes(axes, story.time_s, story.risk[:, column], unknown, name, colour)
    end_s = max(1.0, float(story.time_s[-1])) if len(story.time_s) else 1.0
    axes.set_xlim(0.0, end_s)
    axes.set_ylim(0.0, 1.0)
    name_times(axes, story.states)
    axes.set_xlabel(f"time (s); an unknown index is {unknown:g}")
    axes.set_ylabel("risk index")
    axes.grid(visible=True, color="#dddddd", lw=0.6)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.02), frameon=False)


def _name_changes(
    axes: Any,
    time_s: np.ndarray[Any, Any],
    risk: np.ndarray[Any, Any],
    unknown: float,
    name: str,
    colour: str,
) -> None:
    """Name where an index jumps up, from what to what, and where it becomes unknown."""
    words = {"fontsize": 7.5, "color": colour, "textcoords": "offset points", "zorder": 5}
    jumped = True
    for index, (now_s, value) in enumerate(zip(time_s, risk, strict=True)):
        before = risk[(time_s >= now_s - _JUMP_S) & (time_s <= now_s)]
        least, next_risk = float(before.min()), float(risk[min(index + 1, len(risk) - 1)])
        if value == unknown and index and risk[index - 1] != unknown:
            axes.annotate("unknown", (now_s, value), xytext=(-3, 4), ha="right", **words)
            jumped = True
        elif value - least >= _JUMP and not jumped and next_risk - value < _STEADY:
            axes.annotate(
                f"{name} {least:.2f} to {value:.2f}", (now_s, value), xytext=(5, -9), **words
            )
            jumped = True
        elif value - least < _STEADY:
            jumped = False

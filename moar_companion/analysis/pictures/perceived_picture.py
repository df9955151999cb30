"""The picture of a flight with perception: obstacles as true, in the site file, and seen.

Input: the decisions that the recorder wrote, the true site and the site of the file, and the flown
path. Output: one figure; colours are times, of sightings and of the places flown to.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterable
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.patches import Polygon as PolygonPatch
from matplotlib.patches import Rectangle

from ...planner.grid import FloatArray
from ...planner.site import Conductor, Obstacle, PlanePoint, Site
from ...settings.vehicle import Vehicle
from .figure import DPI, INK, Page, page_style
from .labels import label, name_times, place_labels
from .site_axes import View, draw_colour_bars, set_up_plane, view_of

_COLOURS = colormaps["plasma"]
_LATEST = 0.92
"""End of the used colours: later ones have little contrast on white."""
_ADDED = "#c2185b"
_GIVEN = "#1565c0"
_STILL_M = 0.2
"""Smallest step of a place in half a second that is not noise."""
_NAME_SHARE, _LINE_SHARE = 0.1, 0.07
"""Length of a name and height of a line, as parts of the panel of first sights."""
_SAME_M = 2.0
"""Greatest distance of a sighting from its obstacle."""

# The page, in inches.
_LEFT, _WIDTH, _RIGHT = 0.7, 9.6, 1.15
_BOTTOM, _BELOW_HEIGHT, _BETWEEN, _TOP = 0.55, 2.6, 1.4, 0.75


@dataclass(frozen=True, slots=True, kw_only=True)
class FirstSight:
    """A seen conductor. position_m: its last seen place; from_m: the aircraft at that time."""

    time_s: float
    name: str
    position_m: PlanePoint
    from_m: PlanePoint

    @property
    def distance_m(self) -> float:
        """From the aircraft to the conductor."""
        return math.dist(self.from_m, self.position_m)


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenStory:
    """Perception of a companion in a flight; times in seconds since its first record.

    solids: outlines as each was reported, in order. places: recorded places of the aircraft;
    estimates: the same by the autopilot alone, while the line shows another one.
    """

    conductors: tuple[FirstSight, ...]
    solids: tuple[tuple[float, tuple[PlanePoint, ...]], ...]
    places: tuple[tuple[float, PlanePoint], ...]
    estimates: tuple[PlanePoint, ...]
    states: tuple[tuple[float, str], ...]

    @property
    def moves(self) -> tuple[tuple[float, PlanePoint], ...]:
        """The places from just before the first one that differs, to just after the last."""
        moved = [
            index
            for index, ((_, before_m), (_, after_m)) in enumerate(itertools.pairwise(self.places))
            if math.dist(before_m, after_m) > _STILL_M
        ]
        return self.places[moved[0] : moved[-1] + 2] if moved else ()

    @classmethod
    def read(cls, path: str | PathLike[str]) -> SeenStory:
        """The story in a `decisions.jsonl`; a last line cut short by a crash is left out."""
        whole, _, _ = Path(path).read_text(encoding="utf-8").rpartition("\n")
        return cls.of(json.loads(line) for line in whole.splitlines())

    @classmethod
    def of(cls, decisions: Iterable[dict[str, Any]]) -> SeenStory:
        """The story of recorded decisions."""
        first: dict[str, float] = {}
        last: dict[str, PlanePoint] = {}
        solids: dict[tuple[PlanePoint, ...], float] = {}
        places: list[tuple[float, PlanePoint]] = []
        estimates: list[PlanePoint] = []
        states: list[tuple[float, str]] = []
        begin_s: float | None = None
        for decision in decisions:
            begin_s = decision["time_s"] if begin_s is None else begin_s
            time_s, data = decision["time_s"] - begin_s, decision["data"]
            match decision["kind"]:
                case "seen":
                    for each in data["conductors"]:
                        first.setdefault(each["name"], time_s)
                        last[each["name"]] = (each["x_m"], each["z_m"])
                    for each in data["solids"]:
                        outline = tuple((x, z) for x, z in each["vertices_m"])
                        solids.setdefault(outline, time_s)
                case "status" if data["position_m"] is not None:
                    x_m, _, z_m = data["position_m"]
                    places.append((time_s, (x_m, z_m)))
                    if (offset_m := data.get("line_offset_m")) is not None:
                        estimates.append((x_m - offset_m[0], z_m - offset_m[1]))
                case "state":
                    states.append((time_s, data["state"]))
        return cls(
            conductors=tuple(
                FirstSight(
                    time_s=time_s, name=name, position_m=last[name], from_m=_at(places, time_s)
                )
                for name, time_s in first.items()
            ),
            solids=tuple((time_s, outline) for outline, time_s in solids.items()),
            places=tuple(places),
            estimates=tuple(estimates),
            states=tuple(states),
        )


def draw_perceived(
    story: SeenStory,
    flown_m: list[PlanePoint],
    true: Site,
    given: Site,
    vehicle: Vehicle,
    file: str | PathLike[str],
    *,
    added: tuple[str, ...] = (),
) -> None:
    """Draw a flight into a PNG file; `flown_m` are points of the plane in order of time.

    added: names of the obstacles of the true site that no survey has.
    """
    seen_m = [each.position_m for each in story.conductors]
    landing = [point for points in given.landing_m.values() for point in points]
    view = view_of(true, vehicle, [*flown_m, *landing, *seen_m])
    plane_in = _WIDTH * (view[3] - view[2]) / (view[1] - view[0])
    below_in = _BOTTOM + _BELOW_HEIGHT + _BETWEEN
    times = [each.time_s for each in story.conductors] + [time_s for time_s, _ in story.moves]
    begin_s, end_s = min(times, default=0.0), max(times, default=1.0)
    norm = Normalize(begin_s, begin_s + max(1.0, end_s - begin_s) / _LATEST)
    with page_style():
        page = Page(_LEFT + _WIDTH + _RIGHT, below_in + plane_in + _TOP)
        page.title(
            _LEFT,
            f"{true.name}: what was seen when",
            f"given: no obstacle, {len(given.targets)} rough places. Colour: seconds from the"
            " start, of first sightings as of the places flown to",
        )
        plane = page.panel(_LEFT, below_in, _WIDTH, plane_in)
        _draw_plane(plane, story, flown_m, true, given, view, norm, added)
        _draw_sightings(page.panel(_LEFT, _BOTTOM, _WIDTH, _BELOW_HEIGHT), story, true, norm)
        page.figure.savefig(file, format="png", dpi=DPI)


def _at(places: list[tuple[float, PlanePoint]], time_s: float) -> PlanePoint:
    """The aircraft's place at a time: the last recorded one; NaN before the first."""
    return next((place for reported_s, place in reversed(places) if reported_s <= time_s + 0.5),
                (math.nan, math.nan))  # fmt: skip


def _draw_plane(
    axes: Any,
    story: SeenStory,
    flown_m: list[PlanePoint],
    true: Site,
    given: Site,
    view: View,
    norm: Normalize,
    added: tuple[str, ...],
) -> None:
    set_up_plane(axes, view)
    space = given.workspace
    width_m, height_m = (high - low for low, high in zip(space.lower_m, space.upper_m, strict=True))
    axes.add_patch(
        Rectangle(
            space.lower_m, width_m, height_m,
            facecolor="white", edgecolor=_GIVEN, lw=1.2, label="given: workspace", zorder=1,
        )
    )  # fmt: skip
    for time_s, outline in sorted(story.solids, key=lambda each: -each[0]):
        axes.add_patch(PolygonPatch(outline, color=_COLOURS(norm(time_s)), lw=0.0, zorder=3))
    axes.plot([], [], "s", ms=9, color=_COLOURS(norm(0.0)), label="seen: solid")
    for item in true.obstacles:
        _draw_true(axes, item, view, _ADDED if item.name in added else INK)
    _explain_true(axes, added)
    for sight in story.conductors:
        colour = _COLOURS(norm(sight.time_s))
        axes.plot(*zip(sight.from_m, sight.position_m, strict=True), color=colour, lw=0.7, zorder=2)
        axes.plot(
            *sight.position_m, "o", ms=6.5, color=colour, mec="white", mew=0.7, zorder=6
        )  # fmt: skip
    axes.plot([], [], "o", ms=6.5, color=_COLOURS(norm(0.0)), mec="white", label="seen: conductor")
    if flown_m:
        axes.plot(*np.array(flown_m).T, color=INK, lw=1.0, label="flown, true", zorder=4)
    if story.moves:
        times, places = zip(*story.moves, strict=True)
        axes.scatter(
            *np.array(places).T, c=times, cmap=_COLOURS, norm=norm, s=14.0, zorder=5,
            label="flown, by the line" if story.estimates else "flown, as estimated",
        )  # fmt: skip
    if story.estimates:
        by_autopilot_m = np.array(story.estimates).T
        axes.plot(*by_autopilot_m, "x", ms=4.0, color="#888888", label="flown, by the autopilot")
    for target in given.targets:
        axes.plot(*target.position_m, "*", ms=13, color=_GIVEN, mec="white", zorder=7)
        label(axes, target.position_m, target.name)
    axes.plot([], [], "*", ms=13, color=_GIVEN, mec="white", label="given: rough target")
    place_labels(axes, _lines(story, flown_m))
    draw_colour_bars(axes, [(ScalarMappable(norm, _COLOURS), "seen, flown at (s)")])
    axes.legend(loc="upper left", framealpha=0.9, fontsize=8.0)


def _lines(story: SeenStory, flown_m: list[PlanePoint]) -> FloatArray:
    """Points (n, 2) of the lines that a name should not hide."""
    sights = [np.linspace(each.from_m, each.position_m, 80) for each in story.conductors]
    drawn = np.concatenate([np.array(flown_m).reshape(-1, 2), *sights])
    known: FloatArray = drawn[np.isfinite(drawn).all(axis=1)]
    return known


def _draw_true(axes: Any, item: Obstacle, view: View, colour: str) -> None:
    """A true obstacle, hollow, with its name."""
    if isinstance(item, Conductor):
        axes.plot(*item.position_m, "o", ms=12, mfc="none", mec=colour, mew=1.2, zorder=5.5)
        x_m, z_m = item.position_m
    else:
        axes.add_patch(
            PolygonPatch(item.vertices_m, fill=False, edgecolor=colour, lw=1.6, zorder=5.5)
        )
        corners = np.array(item.vertices_m)
        x_m, z_m = (float(each) for each in 0.5 * (corners.min(axis=0) + corners.max(axis=0)))
    if view[0] < x_m < view[1] and view[2] < z_m < view[3]:
        label(axes, (x_m, z_m), item.name)


def _explain_true(axes: Any, added: tuple[str, ...]) -> None:
    axes.plot([], [], "o", ms=10, mfc="none", mec=INK, ls="none", label="truly there")
    if added:
        axes.plot(
            [], [], "s", ms=9, mfc="none", mec=_ADDED, ls="none", label="truly there, in no file"
        )


def _draw_sightings(axes: Any, story: SeenStory, true: Site, norm: Normalize) -> None:
    """Distance at which each conductor was first seen, over time; the mission's states above."""
    begin_s = float(norm.vmin or 0.0) - 1.0
    end_s = max([begin_s + 2.0, *(time_s for time_s, _ in story.moves)])
    _draw_first_sights(axes, story, true, norm, end_s - begin_s)
    for time_s, _ in story.solids:
        axes.axvline(time_s, ymax=0.05, color=_COLOURS(norm(time_s)), lw=1.2)
    axes.set_xlim(begin_s, end_s)
    axes.set_ylim(bottom=0.0)
    states = [each for each in story.states if begin_s <= each[0] <= end_s]
    name_times(axes, states)
    axes.set_xlabel("time (s); ticks below: outlines of solids")
    axes.set_ylabel("seen first from (m)")
    axes.grid(visible=True, color="#dddddd", lw=0.6)


def _draw_first_sights(
    axes: Any, story: SeenStory, true: Site, norm: Normalize, shown_s: float
) -> None:
    """Points with names beside them, none over another; shown_s: length of the axis."""
    sights = sorted(
        (each for each in story.conductors if not math.isnan(each.from_m[0])),
        key=lambda each: each.distance_m,
    )
    name_m, before_s = 0.0, -math.inf
    for sight in sights:
        colour = _COLOURS(norm(sight.time_s))
        axes.plot(sight.time_s, sight.distance_m, "o", ms=5.5, color=colour, mec="white")
        beside = abs(sight.time_s - before_s) < _NAME_SHARE * shown_s
        name_m = max(sight.distance_m, name_m) if beside else sight.distance_m
        axes.annotate(
            _name(sight.position_m, true), (sight.time_s, name_m), xytext=(7.0, 0.0),
            textcoords="offset points", fontsize=7.5, va="center",
        )  # fmt: skip
        name_m, before_s = name_m + _LINE_SHARE * sights[-1].distance_m, sight.time_s


def _name(point_m: PlanePoint, true: Site) -> str:
    """The true conductor at a place; `nothing` where there is none."""
    near = [(math.dist(item.position_m, point_m), item.name) for item in true.conductors]
    distance_m, name = min(near, default=(math.inf, ""))
    return name if distance_m <= _SAME_M else "nothing"

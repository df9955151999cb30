"""A site, a flown path and the places of pictures, as SVG in the colours of the page. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

from ...planner.site import Conductor, PlanePoint, Site
from .flight_account import FlightAccount, Visit, place_of

_WIDTH = 900.0
"""Width of a drawing in its own units; the page scales it."""
_MARGIN_M = 1.0
_DETAIL_M = 2.5
"""Around the places of a detail."""
_MARK = 11.0
_Box = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Frame:
    """Lower and upper corner in the plane, and units per metre."""

    box: _Box
    scale: float

    @property
    def size(self) -> tuple[float, float]:
        x_low, z_low, x_high, z_high = self.box
        return (x_high - x_low) * self.scale, (z_high - z_low) * self.scale

    def at(self, point_m: PlanePoint) -> tuple[float, float]:
        return (point_m[0] - self.box[0]) * self.scale, (self.box[3] - point_m[1]) * self.scale

    def list_of(self, points_m: Iterable[PlanePoint]) -> str:
        return " ".join(f"{x:.1f},{y:.1f}" for x, y in map(self.at, points_m))


def site_drawing(account: FlightAccount) -> str:
    """The whole site with the path that was flown; a numbered mark at each place."""
    site, space = account.site, account.site.workspace
    points = [space.lower_m, space.upper_m, *(target.position_m for target in site.targets)]
    points += [(x_m, z_m) for _, x_m, z_m in account.path]
    points += [point for landing in site.landing_m.values() for point in landing]
    frame = _frame(_box(points, _MARGIN_M), _WIDTH)
    x, y = frame.at((space.lower_m[0], space.upper_m[1]))
    width, height = (
        (high - low) * frame.scale for low, high in zip(space.lower_m, space.upper_m, strict=True)
    )
    parts = [
        f'<rect class="space" x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}"/>'
    ]
    parts += _obstacles(frame, site)
    parts += [_landing(frame, point) for point in _landings(site)]
    path = [(x_m, z_m) for _, x_m, z_m in account.path]
    if path:
        parts.append(f'<polyline class="path" points="{frame.list_of(path)}"/>')
    for number, visit in enumerate(account.visits, start=1):
        parts += _place(frame, visit, number)
    return _svg(
        frame, parts, f"Site {site.name} with the flown path and {len(account.visits)} places"
    )


def place_drawing(account: FlightAccount, visit: Visit, number: int) -> str:
    """A place with its shots and the point that they aim at."""
    target = visit.target
    places = [place_of(row) for row in visit.shots]
    points = [target.position_m, *places, *([target.look_at_m] if target.look_at_m else [])]
    frame = _frame(_square(_box(points, _DETAIL_M)), 300.0)
    parts = _obstacles(frame, account.site)
    path = [(x_m, z_m) for _, x_m, z_m in account.path]
    if path:
        parts.append(f'<polyline class="path" points="{frame.list_of(path)}"/>')
    for row, place in zip(visit.shots, places, strict=True):
        aim = frame.list_of([place, (row["aim_m"][0], row["aim_m"][1])])
        parts.append(f'<polyline class="aim" points="{aim}"/>')
        x, y = frame.at(place)
        parts.append(f'<circle class="shot" cx="{x:.1f}" cy="{y:.1f}" r="4"/>')
    parts += _place(frame, visit, number)
    return _svg(frame, parts, f"Place {target.name}, its surroundings and aim")


def chart(points: Sequence[tuple[float, float]], began_s: float, what: str) -> str:
    """A line of fractions over the minutes of the flight."""
    last_s = max((time_s for time_s, _ in points), default=began_s) - began_s
    minutes = max(last_s / 60.0, 1e-9)
    width, height, left, below = 420.0, 120.0, 44.0, 22.0

    def at(time_s: float, value: float) -> str:
        x = left + (time_s - began_s) / 60.0 / minutes * (width - left - 8.0)
        return f"{x:.1f},{(1.0 - value) * (height - below - 6.0) + 6.0:.1f}"

    parts = []
    for value in (0.0, 0.5, 1.0):
        y = float(at(began_s, value).partition(",")[2])
        parts.append(
            f'<line class="grid" x1="{left}" x2="{width - 8.0}" y1="{y:.1f}" y2="{y:.1f}"/>'
        )
        tick = f'<text class="tick" x="{left - 6.0}" y="{y + 4.0:.1f}"'
        parts.append(f'{tick} text-anchor="end">{value:.0%}</text>')
    line = " ".join(at(time_s, value) for time_s, value in points)
    parts.append(f'<polyline class="line" points="{line}"/>')
    end = f'<text class="tick" y="{height - 4.0}"'
    parts.append(f'{end} x="{left}">0 min</text>')
    parts.append(f'{end} x="{width - 8.0}" text-anchor="end">{minutes:.1f} min</text>')
    return _document(width, height, parts, what)


def _box(points_m: Iterable[PlanePoint], margin_m: float) -> _Box:
    xs, zs = zip(*points_m, strict=True)
    return min(xs) - margin_m, min(zs) - margin_m, max(xs) + margin_m, max(zs) + margin_m


def _square(box: _Box) -> _Box:
    x_low, z_low, x_high, z_high = box
    half = 0.5 * max(x_high - x_low, z_high - z_low)
    x, z = 0.5 * (x_low + x_high), 0.5 * (z_low + z_high)
    return x - half, z - half, x + half, z + half


def _frame(box: _Box, width: float) -> _Frame:
    return _Frame(box=box, scale=width / (box[2] - box[0]))


def _landings(site: Site) -> list[PlanePoint]:
    return list(dict.fromkeys(point for points in site.landing_m.values() for point in points))


def _obstacles(frame: _Frame, site: Site) -> list[str]:
    parts = []
    for item in site.obstacles:
        name = f"<title>{escape(item.name)}</title>"
        if isinstance(item, Conductor):
            x, y = frame.at(item.position_m)
            kept = (item.radius_m + item.keep_out_m) * frame.scale
            parts.append(
                f'<circle class="keep" cx="{x:.1f}" cy="{y:.1f}" r="{kept:.1f}">{name}</circle>'
            )
            radius = max(item.radius_m * frame.scale, 3.5)
            parts.append(
                f'<circle class="wire" cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}">{name}</circle>'
                f'<text class="name" x="{x:.1f}" y="{y + 20.0:.1f}">{escape(item.name)}</text>'
            )
        else:
            points = frame.list_of(item.vertices_m)
            parts.append(f'<polygon class="solid" points="{points}">{name}</polygon>')
    return parts


def _landing(frame: _Frame, point_m: PlanePoint) -> str:
    x, y = frame.at(point_m)
    return (
        f'<rect class="landing" x="{x - 5.0:.1f}" y="{y - 5.0:.1f}" width="10" height="10">'
        "<title>landing point</title></rect>"
    )


def _place(frame: _Frame, visit: Visit, number: int) -> list[str]:
    """The numbered mark of a place, and the line of its aim."""
    target, parts = visit.target, []
    if target.look_at_m is not None:
        aim = frame.list_of([target.position_m, target.look_at_m])
        parts.append(f'<polyline class="aim" points="{aim}"/>')
    x, y = frame.at(target.position_m)
    state = "done" if visit.done else "open"
    parts.append(
        f'<a href="#place-{number}"><circle class="mark {state}" cx="{x:.1f}" cy="{y:.1f}" '
        f'r="{_MARK}"><title>{escape(target.name)}: {visit.outcome}</title></circle>'
        f'<text class="number" x="{x:.1f}" y="{y + 4.5:.1f}">{number}</text></a>'
    )
    return parts


def _svg(frame: _Frame, parts: Iterable[str], what: str) -> str:
    return _document(*frame.size, parts, what)


def _document(width: float, height: float, parts: Iterable[str], what: str) -> str:
    return (
        f'<svg viewBox="0 0 {width:.1f} {height:.1f}" role="img" aria-label="{escape(what)}">'
        f"{''.join(parts)}</svg>"
    )

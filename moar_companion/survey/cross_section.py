"""A site from a point cloud: the plane across the line at a target, and what stands in it.

Inputs: points in metres (x east, y north, z up) whose origin is the target on the map, and what
`perception` found in them. Output: the document of a site file, and the cross-section as drawn.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from ..frames import SiteFrame
from ..perception.conductors import DetectedConductor
from ..perception.spans import PointClass, PowerLine
from ..types import GeodeticPoint

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
Document = dict[str, Any]

MIN_ALTITUDE_M = 2.0
_BESIDE_M = 60.0
"""Conductors within this distance of the target belong to its line."""
_BEYOND_END_M = 3.0
"""A conductor crosses the plane also this far beyond its last point."""
_CELL_M = 0.5
_FLOATING_GAP_M = 5.0
"""What hangs this far above anything else stands apart; else it is filled down to the ground."""
_LONE_M = 2.0
_LATTICE_M = 2.0
"""Half the width of holes in a tower that are filled."""
_ABOVE_GROUND_M = 0.5
_LANDING_HEIGHT_M = 2.5
_LANDING_REACH_M = 25.0


class SurveyError(Exception):
    """A survey that no site can be made of; the text says why."""


@dataclass(frozen=True, kw_only=True)
class SiteOptions:
    """How a site is laid out."""

    name: str = "surveyed site"
    standoff_m: float = 4.0
    resolution_m: float = 0.3
    slab_m: float = 3.0
    """Points up to this far from the plane stand in it."""
    margin_m: float = 12.0
    """Workspace beside the outer conductors."""
    headroom_m: float = 8.0
    """Workspace above the highest conductor."""
    radius_m: float = 0.02
    """Of a wire: no scan tells it."""
    keep_out_m: float = 0.5
    """Beyond three standard deviations of a conductor's place: sag changes with current and
    temperature, and the survey's own position is known to decimetres."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CrossSection:
    """The plane that was laid, in the frame of the points.

    origin_m: (3,) x = 0, z = 0 of the site; across: (2,) unit vector of +x; plane_m: (n, 2) x and
    z of points near the plane, classes: (n,) of these; left_out_m: (k, 2) lone points.
    """

    document: Document
    origin_m: FloatArray
    across: FloatArray
    plane_m: FloatArray
    classes: npt.NDArray[np.uint8]
    left_out_m: FloatArray
    conductors: tuple[DetectedConductor, ...]
    notes: tuple[str, ...]


def site_of_cloud(
    points_m: FloatArray,
    line: PowerLine,
    at: GeodeticPoint,
    target_height_m: float | None,
    options: SiteOptions,
) -> CrossSection:
    """The site at the points' origin, whose place on the map is `at` (its altitude: of z = 0).

    target_height_m: z of the conductor that is inspected; else the lowest phase conductor's.
    Raises SurveyError where no conductor crosses.
    """
    direction, crossing = _crossing(line)
    across = np.array([direction[1], -direction[0]])
    if across[0] < 0.0 or (across[0] == 0.0 and across[1] < 0.0):
        across = -across  # +x points east: azimuth in [0, 180)
    places = np.array([place for _, place in crossing])
    centre = float(np.mean([(place[:2] @ across) for place in places]))
    near = abs(points_m[:, :2] @ direction) <= options.slab_m
    slab_x_m = points_m[near, :2] @ across - centre
    classes = line.classes[near]
    ground_z_m = _ground(slab_x_m, points_m[near, 2], classes, line, points_m)
    origin_m = np.array([*(across * centre), ground_z_m])
    plane_m = np.column_stack((slab_x_m, points_m[near, 2] - ground_z_m))

    named = dict(_named(line, crossing, origin_m, across, options))
    conductors_m = np.array([(entry["x_m"], entry["z_m"]) for entry in named.values()])
    low_x = math.floor(conductors_m[:, 0].min() - options.margin_m)
    high_x = math.ceil(conductors_m[:, 0].max() + options.margin_m)
    high_z = math.ceil(conductors_m[:, 1].max() + options.headroom_m)
    inside = (plane_m[:, 0] > low_x - _LANDING_REACH_M - 5.0) & (
        plane_m[:, 0] < high_x + _LANDING_REACH_M + 5.0
    )
    plane_m, classes = plane_m[inside], classes[inside]
    surface = _Surface(plane_m, classes, low_x, high_x)
    low_z = min(0, math.floor(float(surface.tops_m.min())))
    polygons, left_out = _polygons(plane_m, classes, surface, low_x, high_x, low_z, high_z)
    target, target_name = _target(
        named,
        (-centre, None if target_height_m is None else target_height_m - ground_z_m),
        options,
        surface,
    )
    side = 1.0 if target[0] >= 0.0 else -1.0
    start_x = (high_x if side > 0.0 else low_x) - side * 2.0
    start_z = max(MIN_ALTITUDE_M + 0.5, surface.top_at(start_x, 3.0) + 3.0)
    landing = {
        towards: surface.landing(edge, towards)
        for edge, towards in ((high_x, 1.0), (low_x, -1.0))
    }
    exits = [landing[side], landing[-side]]
    notes = [
        f"no landing place found beyond x = {edge} m: add one to the file"
        for edge, towards in ((high_x, 1.0), (low_x, -1.0))
        if landing[towards] is None
    ]
    if len(left_out):
        notes.append(f"{len(left_out)} lone points left out")
    frame = _frame(at, origin_m, across)
    points = [
        {"x_m": round(x, 2), "z_m": round(z, 2)} for x, z in (each for each in exits if each)
    ]
    document: Document = {
        "name": options.name,
        "frame": {
            "origin": {
                "latitude_deg": round(frame.origin.latitude_deg, 8),
                "longitude_deg": round(frame.origin.longitude_deg, 8),
                "altitude_amsl_m": round(frame.origin.altitude_amsl_m, 3),
            },
            "azimuth_deg": round(frame.azimuth_deg, 4),
        },
        "workspace": {
            "x_m": [float(low_x), float(high_x)],
            "z_m": [float(low_z), float(high_z)],
            "resolution_m": options.resolution_m,
            "min_altitude_m": MIN_ALTITUDE_M,
        },
        "obstacles": [{"conductor": entry} for entry in named.values()]
        + [{"polygon": entry} for entry in polygons],
        "start": {"x_m": round(start_x, 2), "z_m": round(start_z, 2)},
        "targets": {f"at-{target_name}": target[2]},
        "landing": {"exit": points[:1], "evacuation": points},
    }
    return CrossSection(
        document=document,
        origin_m=origin_m,
        across=across,
        plane_m=plane_m,
        classes=classes,
        left_out_m=left_out,
        conductors=tuple(each for each, _ in crossing),
        notes=tuple(notes),
    )


def _crossing(line: PowerLine) -> tuple[FloatArray, list[tuple[DetectedConductor, FloatArray]]]:
    """Direction of the line at the origin, and each conductor with its point in the plane there."""
    conductors = [each for span in line.spans for each in span.conductors]
    here = np.zeros(3)
    if not conductors:
        raise SurveyError("no conductor was found in the points")

    def place(conductor: DetectedConductor, direction: FloatArray) -> FloatArray | None:
        along = conductor.curve.crossing(here, direction)
        low, high = conductor.curve.extent_m
        if not low - _BEYOND_END_M <= along <= high + _BEYOND_END_M:
            return None
        point = conductor.curve.points_at(np.array([along]))[0]
        return point if np.hypot(*point[:2]) <= _BESIDE_M else None

    first = min(
        (each for each in conductors if place(each, each.curve.direction) is not None),
        key=lambda each: _distance(place(each, each.curve.direction)),
        default=None,
    )
    if first is None:
        nearest = min(
            float(np.hypot(*each.curve.points_at(np.linspace(*each.curve.extent_m, 50))[:, :2].T)
                  .min())
            for each in conductors
        )
        raise SurveyError(
            f"no conductor crosses the plane at --at; the nearest is {nearest:.0f} m away"
        )
    direction = first.curve.direction
    for _ in range(2):
        members = [(each, at) for each in conductors if (at := place(each, direction)) is not None]
        turned = [
            each.curve.direction * math.copysign(1.0, each.curve.direction @ direction)
            for each, _ in members
        ]
        weights = [each.curve.length_m for each, _ in members]
        direction = np.average(turned, axis=0, weights=weights)
        direction /= np.hypot(*direction)
    members = [(each, at) for each in conductors if (at := place(each, direction)) is not None]
    return direction, members


def _distance(point: FloatArray | None) -> float:
    return math.inf if point is None else float(np.hypot(*point[:2]))


def _ground(
    x_m: FloatArray,
    z_m: FloatArray,
    classes: npt.NDArray[np.uint8],
    line: PowerLine,
    points_m: FloatArray,
) -> float:
    """Height of the ground beneath the line."""
    beneath = (classes == PointClass.GROUND) & (abs(x_m) < 10.0)
    if beneath.any():
        return float(np.median(z_m[beneath]))
    nearest = np.argsort(np.hypot(*points_m[:, :2].T))[:50]
    return float(np.median(points_m[nearest, 2] - line.height_m[nearest]))


def _named(
    line: PowerLine,
    crossing: list[tuple[DetectedConductor, FloatArray]],
    origin_m: FloatArray,
    across: FloatArray,
    options: SiteOptions,
) -> Iterator[tuple[str, Document]]:
    """Conductors as in a site file, by name; a bundle's wires are a, b, …"""
    order = {id(each): place for each, place in crossing}
    circuits = [
        members
        for span in line.spans
        for circuit in span.circuits
        if (members := [each for each in circuit if id(each) in order])
    ]
    circuits.sort(key=lambda members: np.mean([order[id(each)][:2] @ across for each in members]))
    earth = [each for span in line.spans for each in span.earth_wires if id(each) in order]
    earth.sort(key=lambda each: float(order[id(each)][:2] @ across))
    names = [
        (f"circuit-{number}-phase-{phase}", each)
        for number, members in enumerate(circuits, 1)
        for phase, each in enumerate(members, 1)
    ] + [(f"earth-wire-{number}", each) for number, each in enumerate(earth, 1)]
    normal = np.array([-across[1], across[0]])
    for name, conductor in names:
        wires = conductor.wires
        for letter, wire in zip("abcdefgh", wires, strict=False):
            along = wire.crossing(np.zeros(3), normal)
            x, y, z = wire.points_at(np.array([along]))[0]
            deviation = math.sqrt(float(np.linalg.eigvalsh(wire.covariance_at(along))[-1]))
            full_name = f"{name}{letter}" if len(wires) > 1 else name
            yield full_name, {
                "name": full_name,
                "x_m": round(float(np.array([x, y]) @ across - origin_m[:2] @ across), 2),
                "z_m": round(float(z - origin_m[2]), 2),
                "radius_m": options.radius_m,
                "keep_out_m": math.ceil((options.keep_out_m + 3.0 * deviation) * 100.0) / 100.0,
            }


class _Surface:
    """The highest of ground and what stands on it, in columns of the plane."""

    def __init__(
        self, plane_m: FloatArray, classes: npt.NDArray[np.uint8], low_x: float, high_x: float
    ) -> None:
        self._low_x = low_x - _LANDING_REACH_M - 5.0
        count = int((high_x - low_x + 2.0 * _LANDING_REACH_M + 10.0) / _CELL_M)
        self._x_m = self._low_x + (np.arange(count) + 0.5) * _CELL_M
        standing = np.isin(classes, (PointClass.GROUND, PointClass.VEGETATION))
        columns = ((plane_m[:, 0] - self._low_x) / _CELL_M).astype(np.intp)
        standing &= (columns >= 0) & (columns < count)
        ground = standing & (classes == PointClass.GROUND)
        self.ground_m = _filled(_highest(columns[ground], plane_m[ground, 1], count))
        self.stands = np.zeros(len(plane_m), dtype=bool)
        """Points that stand on the ground, not hang above it."""
        tops = self.ground_m.copy()
        order = np.flatnonzero(standing)
        order = order[np.argsort(plane_m[order, 1])]
        for index in order:
            column = columns[index]
            around = tops[max(column - 1, 0) : column + 2].max()
            if plane_m[index, 1] <= around + _FLOATING_GAP_M:
                tops[column] = max(tops[column], plane_m[index, 1])
                self.stands[index] = True
        self.tops_m = tops

    def top_at(self, x_m: float, reach_m: float) -> float:
        """The highest top within a distance of x."""
        return float(self.tops_m[abs(self._x_m - x_m) <= reach_m].max())

    def runs(self, low_x: float, high_x: float, above_m: float) -> Iterator[FloatArray]:
        """(n, 2) left edges and tops of neighbouring columns that reach above a height."""
        inside = (self._x_m > low_x) & (self._x_m < high_x) & (self.tops_m > above_m)
        labels, count = ndimage.label(inside)
        for label in range(1, count + 1):
            run = labels == label
            yield np.column_stack((self._x_m[run] - _CELL_M / 2.0, self.tops_m[run]))

    def landing(self, edge_m: float, towards: float) -> tuple[float, float] | None:
        """The nearest even place without anything on it or before it, a hover above it."""
        for distance in np.arange(4.0, _LANDING_REACH_M, _CELL_M):
            x = edge_m + towards * distance
            patch = abs(self._x_m - x) <= 2.5
            before = (self._x_m - edge_m) * towards
            way = (before >= 0.0) & (before <= distance)
            ground = self.ground_m[patch]
            even = float(np.ptp(ground)) <= 0.6
            free = float((self.tops_m - self.ground_m)[patch].max()) <= _ABOVE_GROUND_M
            low = float(self.tops_m[way].max()) <= float(ground.max()) + 1.0
            if even and free and low:
                return float(x), float(ground.max()) + _LANDING_HEIGHT_M
        return None


def _highest(columns: npt.NDArray[np.intp], z_m: FloatArray, count: int) -> FloatArray:
    tops = np.full(count, -np.inf)
    np.maximum.at(tops, columns, z_m)
    return tops


def _filled(tops_m: FloatArray) -> FloatArray:
    """Columns without points at the higher of the known ones at both sides."""
    known = np.flatnonzero(np.isfinite(tops_m))
    if not len(known):
        return np.zeros_like(tops_m)
    index = np.arange(len(tops_m))
    left = known[np.clip(np.searchsorted(known, index, "right") - 1, 0, len(known) - 1)]
    right = known[np.clip(np.searchsorted(known, index), 0, len(known) - 1)]
    return np.asarray(np.maximum(tops_m[left], tops_m[right]))


def _polygons(
    plane_m: FloatArray,
    classes: npt.NDArray[np.uint8],
    surface: _Surface,
    low_x: float,
    high_x: float,
    low_z: float,
    high_z: float,
) -> tuple[list[Document], FloatArray]:
    """What is no conductor, as polygons; and the lone points that were left out."""
    shapes: list[tuple[str, list[list[float]]]] = []
    for run in surface.runs(low_x, high_x, _ABOVE_GROUND_M):
        top = np.ceil(run[:, 1] * 10.0) / 10.0
        outline = [[run[0, 0], low_z - 1.0]]
        for (x, _), z in zip(run, top, strict=True):
            outline += [[x, z], [x + _CELL_M, z]]
        outline.append([run[-1, 0] + _CELL_M, low_z - 1.0])
        shapes.append(("ground", _straightened(outline)))
    apart = ~surface.stands & np.isin(classes, (PointClass.VEGETATION, PointClass.TOWER))
    apart &= (plane_m[:, 0] > low_x) & (plane_m[:, 0] < high_x)
    apart &= (plane_m[:, 1] > low_z) & (plane_m[:, 1] < high_z)
    places = plane_m[apart]
    tower = classes[apart] == PointClass.TOWER
    alone = _alone(places) & ~tower
    left_out, places, tower = places[alone], places[~alone], tower[~alone]
    low = np.array([low_x - 3.0, low_z - 3.0])
    shape = ((np.array([high_x, high_z]) + 3.0 - low) / _CELL_M).astype(np.intp) + 1
    for kind, part in (("tower", places[tower]), ("hanging", places[~tower])):
        cells = ((part - low) / _CELL_M).astype(np.intp)
        occupied = np.zeros(shape, dtype=bool)
        occupied[cells[:, 0], cells[:, 1]] = True
        if kind == "tower":  # a lattice has holes that nobody flies through
            occupied = ndimage.binary_closing(occupied, iterations=round(_LATTICE_M / _CELL_M))
        labels, count = ndimage.label(ndimage.binary_dilation(occupied))
        for label in range(1, count + 1):
            outline = _outline(labels == label)
            shapes.append((kind, [[*(low + np.array(each) * _CELL_M)] for each in outline]))
    numbers: dict[str, int] = {}
    polygons = []
    for kind, outline in shapes:
        numbers[kind] = numbers.get(kind, 0) + 1
        vertices = [[round(float(x), 2), round(float(z), 2)] for x, z in outline]
        polygons.append(
            {"name": f"{kind}-{numbers[kind]}", "vertices_m": vertices, "keep_out_m": 0.3}
        )
    return polygons, left_out


def _alone(places: FloatArray) -> BoolArray:
    """Points without another within 2 m."""
    distance = np.full(len(places), np.inf)
    for index, place in enumerate(places):
        offset = np.hypot(*(places - place).T)
        offset[index] = np.inf
        distance[index] = offset.min(initial=np.inf)
    return distance > _LONE_M


def _outline(cells: BoolArray) -> list[list[float]]:
    """Outline of cells (x, z) that are connected by edges: each row from its first to its last."""
    rows = np.flatnonzero(cells.any(axis=0))
    left = [int(np.argmax(cells[:, row])) for row in rows]
    right = [len(cells) - int(np.argmax(cells[::-1, row])) for row in rows]
    up = [[float(x), float(z)] for row, x in zip(rows, right, strict=True) for z in (row, row + 1)]
    down = [
        [float(x), float(z)]
        for row, x in zip(rows[::-1], left[::-1], strict=True)
        for z in (row + 1, row)
    ]
    return _straightened(up + down)


def _straightened(outline: list[list[float]]) -> list[list[float]]:
    """Without vertices inside a straight edge."""
    kept: list[list[float]] = []
    for vertex in outline:
        if len(kept) >= 2 and any(
            kept[-2][axis] == kept[-1][axis] == vertex[axis] for axis in (0, 1)
        ):
            kept[-1] = vertex
        elif not kept or kept[-1] != vertex:
            kept.append(vertex)
    return kept


def _target(
    named: dict[str, Document],
    at_m: tuple[float, float | None],
    options: SiteOptions,
    surface: _Surface,
) -> tuple[tuple[float, float, Document], str]:
    """The conductor nearest to the place asked for, seen from the side on which most is free.

    Without a height: the lowest phase conductor of those that are nearest across.
    """
    x_m, z_m = at_m
    if z_m is None:
        phases = [each for name, each in named.items() if name.startswith("circuit")]
        nearest = min(
            phases or named.values(), key=lambda each: (round(abs(each["x_m"] - x_m)), each["z_m"])
        )
    else:
        nearest = min(
            named.values(), key=lambda each: math.hypot(each["x_m"] - x_m, each["z_m"] - z_m)
        )
    others = np.array(
        [(each["x_m"], each["z_m"]) for each in named.values() if each is not nearest]
        or [(math.inf, math.inf)]
    )
    sides = {"left": (-1.0, 0.0), "right": (1.0, 0.0), "above": (0.0, 1.0), "below": (0.0, -1.0)}
    clearance = {}
    for side, (towards_x, towards_z) in sides.items():
        distance = options.standoff_m + options.radius_m
        x, z = nearest["x_m"] + towards_x * distance, nearest["z_m"] + towards_z * distance
        beneath = z - max(surface.top_at(x, 2.0), MIN_ALTITUDE_M)
        to_others = float(np.hypot(others[:, 0] - x, others[:, 1] - z).min())
        clearance[side] = min(to_others, beneath)
    # A picture is taken from beside; from above or below only where no side is free.
    best = max(clearance, key=lambda side: (clearance[side] > options.standoff_m and
                                            side in ("left", "right"), clearance[side]))
    entry = {"conductor": nearest["name"], "standoff_m": options.standoff_m, "side": best}
    towards_x = sides[best][0] or (1.0 if nearest["x_m"] >= 0.0 else -1.0)
    return (towards_x, nearest["z_m"], entry), nearest["name"]


def _frame(at: GeodeticPoint, origin_m: FloatArray, across: FloatArray) -> SiteFrame:
    """The site's frame: `at` is the points' origin on the map."""
    map_frame = SiteFrame(origin=at, azimuth_deg=90.0)  # x east, y north
    azimuth_deg = math.degrees(math.atan2(across[0], across[1])) % 360.0
    x, y, z = (float(each) for each in origin_m)
    return SiteFrame(origin=map_frame.to_geodetic((x, y, z)), azimuth_deg=azimuth_deg)

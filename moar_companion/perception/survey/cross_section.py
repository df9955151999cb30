"""A site from a point cloud: the plane across the line at a target, and its obstacles.

Inputs: points in metres (x east, y north, z up) whose origin is the target on the map, and the
conductors and classes that `perception` found. Outputs: the document of a site file, and the
cross-section for a picture.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ...planner.site_frame import SiteFrame
from ...types import GeodeticPoint
from ..conductors import DetectedConductor
from ..spans import PointClass, PowerLine
from .site_document import MIN_ALTITUDE_M, Document, SiteOptions, SurveyError, place, site_document
from .solid_obstacles import LANDING_REACH_M, Surface, polygons_of

FloatArray = npt.NDArray[np.float64]

_BESIDE_M = 60.0
"""Conductors within this distance of the target belong to its line."""
_BEYOND_END_M = 3.0
"""Distance beyond its last point within which a conductor still crosses the plane."""


@dataclass(frozen=True, kw_only=True, eq=False)
class CrossSection:
    """The plane of the site, in the frame of the points.

    origin_m: (3,) x = 0, z = 0 of the site; across: (2,) unit vector of +x; plane_m: (n, 2) x and z
    of points near the plane, classes: (n,) of these; left_out_m: (k, 2) lone points.
    """

    document: Document
    origin_m: FloatArray
    across: FloatArray
    plane_m: FloatArray
    classes: npt.NDArray[np.uint8]
    left_out_m: FloatArray
    conductors: dict[str, DetectedConductor]
    """Conductors that cross the plane, by name; the wires of a bundle have one more letter."""
    notes: tuple[str, ...]

    def turned(self, points_m: FloatArray) -> FloatArray:
        """Points (n, 3) along the line to the right of x, across it and up, from the origin."""
        offset = points_m - self.origin_m
        along = np.array([self.across[1], -self.across[0]])
        return np.column_stack((offset[:, :2] @ along, offset[:, :2] @ self.across, offset[:, 2]))


def site_of_cloud(
    points_m: FloatArray,
    line: PowerLine,
    at: GeodeticPoint,
    target_height_m: float | None,
    options: SiteOptions,
) -> CrossSection:
    """The site at the points' origin, whose place on the map is `at` (its altitude: of z = 0).

    target_height_m: z of the inspected conductor; None: that of the lowest phase conductor. Raises
    SurveyError where no conductor crosses.
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

    conductors = _names(line, crossing, across)
    named = dict(_named(conductors, origin_m, across, options))
    conductors_m = np.array([(entry["x_m"], entry["z_m"]) for entry in named.values()])
    low_x = math.floor(conductors_m[:, 0].min() - options.margin_m)
    high_x = math.ceil(conductors_m[:, 0].max() + options.margin_m)
    high_z = math.ceil(conductors_m[:, 1].max() + options.headroom_m)
    inside = (plane_m[:, 0] > low_x - LANDING_REACH_M - 5.0) & (
        plane_m[:, 0] < high_x + LANDING_REACH_M + 5.0
    )
    plane_m, classes = plane_m[inside], classes[inside]
    surface = Surface(plane_m, classes, low_x, high_x)
    low_z = min(0, math.floor(float(surface.tops_m.min())))
    polygons, left_out = polygons_of(plane_m, classes, surface, low_x, high_x, low_z, high_z)
    target_x, target_name, target = _target(
        named,
        (-centre, None if target_height_m is None else target_height_m - ground_z_m),
        options,
        surface,
        plane_m[~surface.stands & (classes != PointClass.CONDUCTOR)],
    )
    side = 1.0 if target_x >= 0.0 else -1.0
    start_x = (high_x if side > 0.0 else low_x) - side * 2.0
    start_z = max(MIN_ALTITUDE_M + 0.5, surface.top_at(start_x, 3.0) + 3.0)
    landing = {
        towards: surface.landing(edge, towards) for edge, towards in ((high_x, 1.0), (low_x, -1.0))
    }
    exits = [landing[side], landing[-side]]
    notes = [
        f"no landing place found beyond x = {edge} m: add one to the file"
        for edge, towards in ((high_x, 1.0), (low_x, -1.0))
        if landing[towards] is None
    ]
    if len(left_out):
        notes.append(f"{len(left_out)} lone point{'s' if len(left_out) > 1 else ''} left out")
    points = [place(*each) for each in exits if each]
    document = site_document(
        options,
        _frame(at, origin_m, across),
        x_m=(low_x, high_x),
        z_m=(low_z, high_z),
        obstacles=[{"conductor": entry} for entry in named.values()] + polygons,
        start=place(start_x, start_z),
        targets={f"at-{target_name}": target},
        landing={"exit": points[:1], "evacuation": points},
        ground_m=surface.profile_m,
    )
    return CrossSection(
        document=document,
        origin_m=origin_m,
        across=across,
        plane_m=plane_m,
        classes=classes,
        left_out_m=left_out,
        conductors=conductors,
        notes=tuple(notes),
    )


def _crossing(line: PowerLine) -> tuple[FloatArray, list[tuple[DetectedConductor, FloatArray]]]:
    """Direction of the line at the origin, and each conductor with its crossing of the plane."""
    conductors = [each for span in line.spans for each in span.conductors]
    here = np.zeros(3)
    if not conductors:
        raise SurveyError("no conductor was found in the points")

    def at(conductor: DetectedConductor, direction: FloatArray) -> FloatArray | None:
        along = conductor.curve.crossing(here, direction)
        low, high = conductor.curve.extent_m
        if not low - _BEYOND_END_M <= along <= high + _BEYOND_END_M:
            return None
        point = conductor.curve.points_at(np.array([along]))[0]
        return point if np.hypot(*point[:2]) <= _BESIDE_M else None

    first = min(
        (each for each in conductors if at(each, each.curve.direction) is not None),
        key=lambda each: _distance(at(each, each.curve.direction)),
        default=None,
    )
    if first is None:
        nearest = min(
            float(
                np.hypot(
                    *each.curve.points_at(np.linspace(*each.curve.extent_m, 50))[:, :2].T
                ).min()
            )
            for each in conductors
        )
        raise SurveyError(
            f"no conductor crosses the plane at --at; the nearest is {nearest:.0f} m away"
        )
    direction = first.curve.direction
    for _ in range(2):
        members = [
            (each, place_m) for each in conductors if (place_m := at(each, direction)) is not None
        ]
        turned = [
            each.curve.direction * math.copysign(1.0, each.curve.direction @ direction)
            for each, _ in members
        ]
        weights = [each.curve.length_m for each, _ in members]
        direction = np.average(turned, axis=0, weights=weights)
        direction /= np.hypot(*direction)
    members = [
        (each, place_m) for each in conductors if (place_m := at(each, direction)) is not None
    ]
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


def _names(
    line: PowerLine, crossing: list[tuple[DetectedConductor, FloatArray]], across: FloatArray
) -> dict[str, DetectedConductor]:
    """Conductors that cross the plane, by name: circuits from left to right, then earth wires."""
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
    return {
        f"circuit-{number}-phase-{phase}": each
        for number, members in enumerate(circuits, 1)
        for phase, each in enumerate(members, 1)
    } | {f"earth-wire-{number}": each for number, each in enumerate(earth, 1)}


def _named(
    conductors: dict[str, DetectedConductor],
    origin_m: FloatArray,
    across: FloatArray,
    options: SiteOptions,
) -> Iterator[tuple[str, Document]]:
    """Wires as in a site file, by name; those of a bundle have the letters a, b and so on."""
    normal = np.array([-across[1], across[0]])
    for name, conductor in conductors.items():
        wires = conductor.wires
        for letter, wire in zip("abcdefgh", wires, strict=False):
            along = wire.crossing(np.zeros(3), normal)
            x, y, z = wire.points_at(np.array([along]))[0]
            deviation = math.sqrt(float(np.linalg.eigvalsh(wire.covariance_at(along))[-1]))
            full_name = f"{name}{letter}" if len(wires) > 1 else name
            yield (
                full_name,
                {
                    "name": full_name,
                    "x_m": round(float(np.array([x, y]) @ across - origin_m[:2] @ across), 2),
                    "z_m": round(float(z - origin_m[2]), 2),
                    "radius_m": options.radius_m,
                    "keep_out_m": math.ceil((options.keep_out_m + 3.0 * deviation) * 100.0) / 100.0,
                },
            )


def _target(
    named: dict[str, Document],
    at_m: tuple[float, float | None],
    options: SiteOptions,
    surface: Surface,
    hanging_m: FloatArray,
) -> tuple[float, str, Document]:
    """The conductor nearest to the given place, seen from the side with the most free space.

    Returns its x, the name of its bundle, and the target as in a site file.

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
    bundle = [each for each in named.values() if _bundle(each) == _bundle(nearest)]
    wires = [(each["x_m"], each["z_m"]) for each in named.values() if each not in bundle]
    # A point closer to the bundle than a spacer belongs to the bundle.
    here = np.array([nearest["x_m"], nearest["z_m"]])
    hanging_m = hanging_m[np.hypot(*(hanging_m - here).T) > 1.0]
    others = np.vstack((np.full((1, 2), math.inf), np.array(wires).reshape(-1, 2), hanging_m))
    views: list[tuple[tuple[bool, float], str, Document]] = []
    for side, (towards_x, towards_z) in _SIDES.items():
        wire = max(bundle, key=lambda each: towards_x * each["x_m"] + towards_z * each["z_m"])
        distance = options.standoff_m + options.radius_m
        x, z = wire["x_m"] + towards_x * distance, wire["z_m"] + towards_z * distance
        above_ground = z - max(surface.top_at(x, 2.0), MIN_ALTITUDE_M)
        clearance = min(float(np.hypot(others[:, 0] - x, others[:, 1] - z).min()), above_ground)
        # A camera looks from beside; from above or below only where no side is free.
        preferred = clearance > options.standoff_m and towards_x != 0.0
        views.append(((preferred, clearance), side, wire))
    _, side, wire = max(views, key=lambda view: view[0])
    entry = {"conductor": wire["name"], "standoff_m": options.standoff_m, "side": side}
    return wire["x_m"] + _SIDES[side][0] * options.standoff_m, _bundle(wire), entry


_SIDES = {"left": (-1.0, 0.0), "right": (1.0, 0.0), "above": (0.0, 1.0), "below": (0.0, -1.0)}


def _bundle(entry: Document) -> str:
    return str(entry["name"]).rstrip("abcdefgh")


def _frame(at: GeodeticPoint, origin_m: FloatArray, across: FloatArray) -> SiteFrame:
    """Frame of the site; `at` is the points' origin on the map."""
    map_frame = SiteFrame(origin=at, azimuth_deg=90.0)  # x east, y north
    azimuth_deg = math.degrees(math.atan2(across[0], across[1])) % 360.0
    x, y, z = (float(each) for each in origin_m)
    return SiteFrame(origin=map_frame.to_geodetic((x, y, z)), azimuth_deg=azimuth_deg)

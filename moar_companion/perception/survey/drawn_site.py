"""A site from features on a map, and the features of a site.

A conductor is given by points along it. The plane stands across the conductors at the first target.
Where a conductor has no point in the plane, its height is that of the straight line between its two
neighbouring points. Its keep-out grows by the sag that may hang below this line.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from ...errors import InputError
from ...planner.plan_values import Plan
from ...planner.site import Polygon, Site
from ...planner.site_frame import SiteFrame
from ...types import GeodeticPoint, Mission
from .map_features import KINDS, MapFeature
from .site_document import MIN_ALTITUDE_M, Document, SiteOptions, place, polygon, site_document
from .survey_view import SurveyMark

FloatArray = npt.NDArray[np.float64]

_LEAST_CONSTANT_M = 500.0
"""Catenary constant of the slackest line (315 kV of Hydro-Québec: 699)."""
_LONGEST_M = 60.0
"""Greatest distance of a conductor's points on both sides of the plane: 0.9 m of sag."""
_IN_PLANE_M = 5.0
_AT_POINT_M = 0.01
"""Distance from the plane within which a point of a conductor is in it, without unknown sag."""
_DRAWN_M = 5.0
"""Half the length of a conductor as drawn on the map."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnSite:
    """The document of a site file, and the features with their places about its plane."""

    document: Document
    marks: tuple[SurveyMark, ...]
    distances: tuple[str, ...]
    """Distances of the start and the landing places from the target, as lines of text."""

    @property
    def left_out(self) -> tuple[str, ...]:
        """Features outside the site, each with its distance from the plane."""
        return tuple(
            f"{each.kind} {each.name}, {each.left_out_m:.0f} m from the plane"
            for each in self.marks
            if each.left_out_m is not None
        )


def site_of_features(
    features: tuple[MapFeature, ...], source: str, options: SiteOptions
) -> DrawnSite:
    """The site; raises InputError that names the faulty feature."""
    of = {kind: [each for each in features if each.kind == kind] for kind in KINDS}
    if not of["target"] or not of["conductor"]:
        kind = "target" if not of["target"] else "conductor"
        raise InputError(source, "", f"has no {kind}: needs one target and one conductor at least")
    first = of["target"][0].points[0]
    map_frame = SiteFrame(origin=first, azimuth_deg=90.0)

    def metres(feature: MapFeature) -> FloatArray:
        return np.array([_metres(map_frame, point) for point in feature.points])

    for each in features:
        _check_reach(each, metres(each), source, options.reach_m)
    direction = _direction(of["conductor"], source, metres)
    across = np.array([direction[1], -direction[0]])
    if across[0] < 0.0:
        across = -across
    along = np.array([-across[1], across[0]])
    azimuth_deg = math.degrees(math.atan2(across[0], across[1])) % 360.0
    heights = [point.altitude_amsl_m for each in of["ground"] or features for point in each.points]
    ground = min(heights)
    above_ground_m = first.altitude_amsl_m - ground
    obstacles: list[dict[str, Any]] = []
    left_out: dict[tuple[str, str], float] = {}
    for conductor in of["conductor"]:
        x, z, sag_m = _in_plane(conductor, metres(conductor), across, along, source)
        kept_m = options.keep_out_m if conductor.keep_out_m is None else conductor.keep_out_m
        obstacles.append(
            {
                "conductor": {
                    "name": conductor.name,
                    "x_m": round(x, 2),
                    "z_m": round(z + above_ground_m, 2),
                    "radius_m": conductor.radius_m or options.radius_m,
                    "keep_out_m": _rounded_up_m(kept_m + sag_m),
                }
            }
        )
    for solid in of["tower"] + of["obstacle"]:
        x, y, z = _plane(_top(solid, metres(solid), source), across, along)
        if abs(y) > (solid.radius_m or 0.0) + _IN_PLANE_M:
            left_out[solid.kind, solid.name] = abs(y)
        else:
            obstacles.append(_box(solid, x, z + above_ground_m))
    for outline in of["outline"]:
        corners = [_plane(each, across, along) for each in metres(outline)]
        if corners[0] == corners[-1]:
            corners.pop()
        vertices = [(x, z + above_ground_m) for x, _, z in corners]
        obstacles.append(polygon(outline.name, vertices, outline.keep_out_m))
    places: dict[str, list[tuple[str, dict[str, float]]]] = {}
    for kind in ("target", "start", "exit", "evacuation"):
        places[kind] = []
        for each in of[kind]:
            x, y, z = _plane(metres(each)[0], across, along)
            if abs(y) > _IN_PLANE_M and kind == "target":
                left_out[kind, each.name] = abs(y)
                continue
            if abs(y) > _IN_PLANE_M and kind == "start":
                raise InputError(
                    source,
                    each.name,
                    f"is {abs(y):.1f} m beside the plane through {of['target'][0].name}, must be "
                    f"within {_IN_PLANE_M:g} m",
                )
            places[kind].append((each.name, place(x, z + above_ground_m)))
    wires = [each["conductor"] for each in obstacles if "conductor" in each]
    inner = [*wires, *(each for _, each in places["target"] + places["start"])]
    low_x = math.floor(min(each["x_m"] for each in inner) - options.margin_m)
    high_x = math.ceil(max(each["x_m"] for each in inner) + options.margin_m)
    high_z = math.ceil(max(each["z_m"] for each in inner) + options.headroom_m)
    side_x = high_x - 2.0 if places["target"][0][1]["x_m"] >= 0.0 else low_x + 2.0
    start = places["start"][0][1] if places["start"] else {"x_m": side_x, "z_m": 0.0}
    start["z_m"] = max(start["z_m"], MIN_ALTITUDE_M + 0.5)
    document = site_document(
        options,
        SiteFrame(origin=replace(first, altitude_amsl_m=ground), azimuth_deg=azimuth_deg),
        x_m=(low_x, high_x),
        z_m=(0.0, high_z),
        obstacles=obstacles,
        start=start,
        targets=dict(places["target"]),
        landing={
            mission: [each for _, each in places[mission]] for mission in ("exit", "evacuation")
        },
    )
    axes = np.array([[*-along, 0.0], [*across, 0.0], [0.0, 0.0, 1.0]])
    above = np.array([0.0, 0.0, above_ground_m])
    marks = tuple(
        SurveyMark(
            kind=each.kind,
            name=each.name,
            points_m=metres(each) @ axes.T + above,
            left_out_m=left_out.get((each.kind, each.name)),
        )
        for each in features
    )
    distances = tuple(
        f"{kind} {each.name}: {math.hypot(x, y):.1f} m from {of['target'][0].name}, "
        f"{z:+.1f} m in height, {abs(y):.1f} m beside the plane"
        for kind in ("start", "exit", "evacuation")
        for each in of[kind]
        for x, y, z in (_plane(metres(each)[0], across, along),)
    )
    return DrawnSite(document=document, marks=marks, distances=distances)


def _check_reach(feature: MapFeature, points_m: FloatArray, source: str, reach_m: float) -> None:
    """Raises InputError for a point far from the target, or from the conductor's next one."""
    wrong = "are latitude and longitude in the wrong order? --reach M permits more"
    away_m = float(np.hypot(*points_m[:, :2].T).min())
    if away_m > reach_m:
        problem = f"is {away_m:.0f} m from the target, must be within {reach_m:g} m: {wrong}"
        raise InputError(source, feature.name, problem)
    apart_m = np.hypot(*np.diff(points_m[:, :2], axis=0).T)
    if feature.kind == "conductor" and apart_m.max(initial=0.0) > reach_m:
        problem = f"has points {apart_m.max():.0f} m apart, must be at most {reach_m:g} m: {wrong}"
        raise InputError(source, feature.name, problem)


def _metres(frame: SiteFrame, point: GeodeticPoint) -> tuple[float, float, float]:
    east, north = frame.place_of(point.latitude_deg, point.longitude_deg)
    return east, north, point.altitude_amsl_m - frame.origin.altitude_amsl_m


def _direction(conductors: list[MapFeature], source: str, metres: Any) -> FloatArray:
    """Mean horizontal direction of the conductors, each by its piece nearest to the target."""
    total = np.zeros(2)
    for conductor in conductors:
        points = metres(conductor)[:, :2]
        if len(points) < 2:
            raise InputError(
                source, conductor.name, "has one point, must have two or more along the conductor"
            )
        middles = (points[1:] + points[:-1]) / 2.0
        index = int(np.argmin(np.hypot(*middles.T)))
        piece = points[index + 1] - points[index]
        length = float(np.hypot(*piece))
        if length < 0.1:
            raise InputError(source, conductor.name, "has two points at one place")
        total += piece / length * math.copysign(1.0, float(piece @ total) or 1.0)
    return np.asarray(total / np.hypot(*total))


def _plane(
    point_m: FloatArray, across: FloatArray, along: FloatArray
) -> tuple[float, float, float]:
    return float(point_m[:2] @ across), float(point_m[:2] @ along), float(point_m[2])


def _in_plane(
    conductor: MapFeature, points_m: FloatArray, across: FloatArray, along: FloatArray, source: str
) -> tuple[float, float, float]:
    """Crossing x, z of the conductor with the plane, and the sag that may hang below."""
    beside = points_m[:, :2] @ along
    order = np.argsort(beside)
    beside, points_m = beside[order], points_m[order]
    upper = int(np.searchsorted(beside, 0.0))
    if not 0 < upper < len(beside) and abs(beside).min() > 0.5:
        raise InputError(
            source, conductor.name, "has points at one side of the plane only, must have both"
        )
    upper = min(max(upper, 1), len(beside) - 1)
    span_m = float(beside[upper] - beside[upper - 1])
    if span_m > _LONGEST_M:
        raise InputError(
            source,
            conductor.name,
            f"has {span_m:.0f} m between its points at both sides of the plane, must be at most "
            f"{_LONGEST_M:g} m: the sag between is not known",
        )
    if abs(beside).min() < _AT_POINT_M:
        point = points_m[int(np.argmin(abs(beside)))]
        return float(point[:2] @ across), float(point[2]), 0.0
    share = -float(beside[upper - 1]) / span_m if span_m > 0.0 else 0.0
    point = points_m[upper - 1] + share * (points_m[upper] - points_m[upper - 1])
    sag_m = max(share * (1.0 - share), 0.0) * span_m**2 / (2.0 * _LEAST_CONSTANT_M)
    return float(point[:2] @ across), float(point[2]), sag_m


def _rounded_up_m(length_m: float) -> float:
    """The length rounded up to centimetres, after removal of rounding errors."""
    return math.ceil(round(length_m * 100.0, 6)) / 100.0


def _top(solid: MapFeature, points_m: FloatArray, source: str) -> FloatArray:
    """Highest point of a tower or obstacle."""
    if solid.radius_m is None or solid.radius_m <= 0.0:
        raise InputError(source, solid.name, "has no radius_m: must have half its width, in m")
    return np.asarray(points_m[int(np.argmax(points_m[:, 2]))])


def _box(solid: MapFeature, x: float, top: float) -> Document:
    """A tower or obstacle as a rectangle up to its height."""
    left, right = x - (solid.radius_m or 0.0), x + (solid.radius_m or 0.0)
    corners = ((left, -1.0), (right, -1.0), (right, top), (left, top))
    return polygon(solid.name, corners, solid.keep_out_m)


def features_of_site(site: Site, plans: Iterable[Plan]) -> tuple[MapFeature, ...]:
    """The site on the map: conductors as short lines across the plane, places, paths."""

    def point(x: float, z: float, y: float = 0.0) -> GeodeticPoint:
        return site.frame.to_geodetic((x, y, z))

    features = [
        MapFeature(
            kind="conductor",
            name=each.name,
            points=(
                point(*each.position_m, -_DRAWN_M),
                point(*each.position_m),
                point(*each.position_m, _DRAWN_M),
            ),
            radius_m=each.radius_m,
            keep_out_m=each.keep_out_m,
        )
        for each in site.conductors
    ]
    features += [
        MapFeature(
            kind="outline",
            name=each.name,
            points=tuple(point(*vertex) for vertex in (*each.vertices_m, each.vertices_m[0])),
            keep_out_m=each.keep_out_m,
        )
        for each in site.obstacles
        if isinstance(each, Polygon)
    ]
    features.append(MapFeature(kind="ground", name="z = 0", points=(point(0.0, 0.0),)))
    features += [
        MapFeature(kind="target", name=each.name, points=(point(*each.position_m),))
        for each in site.targets
    ]
    features.append(MapFeature(kind="start", name="start", points=(point(*site.start_m),)))
    for mission in (Mission.EXIT, Mission.EVACUATION):
        features += [
            MapFeature(kind=mission.value, name=f"{mission.value}-{index}", points=(point(*place),))
            for index, place in enumerate(site.landing_m.get(mission, ()))
        ]
    features += [
        MapFeature(
            kind="path",
            name=path_name(plan),
            points=tuple(point(x, z) for x, z in waypoints_m(plan)),
        )
        for plan in plans
    ]
    return tuple(features)


def path_name(plan: Plan) -> str:
    """Name of the path: the mission, and the target if one was given."""
    target = plan.request.target
    return plan.mission.value if target is None else f"{plan.mission.value} {target}"


def waypoints_m(plan: Plan) -> list[tuple[float, float]]:
    """The plan's points (x, z)."""
    return [(each["x_m"], each["z_m"]) for each in plan.to_dict()["waypoints"]]

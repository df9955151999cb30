"""A flight with a rough site file: the true obstacles, and the rough places of the file.

The conductors of a site file become wires across its plane, its polygons solids in it. Two
obstacles that no file has are added. One is a crane's jib across the straight path to the first
target, the other a thin cable, which is visible only nearby. The lidar and the judge have all
obstacles, the service's site file has none.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import yaml
from shapely.geometry import LineString
from shapely.geometry import Polygon as Shape

from moar_companion.companion.error_margin import flown_site, margin_of
from moar_companion.companion.planning.map_jobs import MapJob, answer_map_job
from moar_companion.companion.planning.planner_set import PlannerSet
from moar_companion.errors import InputError
from moar_companion.planner.plan_values import Plan, PlanStatus
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Conductor, Obstacle, PlanePoint, Polygon, Site, Workspace
from moar_companion.settings.config import Supervision
from moar_companion.settings.perception_config import Perception
from moar_companion.settings.vehicle import Vehicle
from moar_companion.types import Mission
from sitl.geodesy import Geodetic
from sitl.lidar import Box, LidarScene, Prism, Tree, Wire
from sitl.lidar_scene import PlacedScene
from sitl.lidar_sender import LidarSender

ADDED = ("crane", "cable")
GIVEN = "site.yaml"
"""Name of the service's site file in the flight's folder."""
_ROUGH_M = 0.5
"""Step of the places of targets in the rough file."""
_HALF_SPAN_M, _SAG_M = 150.0, 8.0
_LEAST_WIRE_M = 0.015
_DEPTH_M = 6.0
"""Distance of towers along the line; the plane is in the middle."""
_JIB_M = (0.4, 0.3)
"""Half the width and height of the crane's jib where it crosses the plane."""
_CABLE_M = 0.015
"""Diameter of the cable: it is seen from 11 m."""
_CABLE_STEPS = 9
"""Number of places of the cable, one metre apart, on each side of the last target."""
_OFFSETS_M = tuple(sign * 0.5 * step for step in range(7) for sign in ((1, -1) if step else (1,)))
_SHARES = (0.5, 0.45, 0.55, 0.4, 0.6, 0.35, 0.65, 0.3, 0.7)
_KEEP_OUT_M = 0.25
"""Keep-out of seen obstacles, as of the shipped sites' conductors, between which there is little
room."""
_SLACKS_M = (0.6, 0.5, 0.4, 0.3)
"""Room of the remaining path beside the kept distances: seen obstacles are broader than true
ones."""
_INSIDE_M = 1.2
"""Distance of that path from the sides of the workspace, which an aircraft must not leave."""
_AWAY_M = 10.0
"""Distance of trees and a house from all places of the flight."""
_SPEAKER = "MOAR: "
_SAID = f"{_SPEAKER}wire "


@dataclass(frozen=True, slots=True, kw_only=True)
class Perceiving:
    """Files of one flight. site: the true obstacles."""

    site: Site
    given: Path
    scene: Path
    port: int

    def configuration(self) -> dict[str, Any]:
        """The service's section `perception`."""
        return {
            "sensor": "velodyne",
            "address": "127.0.0.1",
            "port": self.port,
            "keep_out_m": _KEEP_OUT_M,
        }

    def arguments(self) -> tuple[str, ...]:
        """Arguments of the fake autopilot."""
        return ("--lidar", f"127.0.0.1:{self.port}", "--lidar-scene", str(self.scene))

    def sender(self) -> LidarSender:
        """The lidar on a real autopilot's aircraft."""
        return LidarSender(lidar_scene(self.site), "127.0.0.1", self.port)


def prepare(folder: Path, site: Site, vehicle: Vehicle, port: int) -> Perceiving:
    """Writes the files; InputError where no obstacle can be added."""
    true = site.with_obstacles((*site.obstacles, *added_obstacles(site, vehicle)))
    given, scene = folder / GIVEN, folder / "scene.yaml"
    given.write_text(yaml.safe_dump(given_document(site), sort_keys=False), encoding="utf-8")
    scene.write_text(lidar_scene(true).text(), encoding="utf-8")
    return Perceiving(site=true, given=given, scene=scene, port=port)


def given_document(site: Site) -> dict[str, Any]:
    """The site file that the service gets: no obstacle, and rough places of the targets."""
    origin, space = site.frame.origin, site.workspace
    return {
        "name": f"{site.name}, given roughly",
        "frame": {
            "origin": {
                "latitude_deg": origin.latitude_deg,
                "longitude_deg": origin.longitude_deg,
                "altitude_amsl_m": origin.altitude_amsl_m,
            },
            "azimuth_deg": site.frame.azimuth_deg,
        },
        "workspace": {
            "x_m": [space.lower_m[0], space.upper_m[0]],
            "z_m": [space.lower_m[1], space.upper_m[1]],
            "resolution_m": space.resolution_m,
            **({} if space.min_altitude_m is None else {"min_altitude_m": space.min_altitude_m}),
        },
        **({"ground": [list(point_m) for point_m in space.ground_m]} if space.ground_m else {}),
        "obstacles": [],
        "start": _place(site.start_m),
        "targets": {
            target.name: {**_place(_rough(target.position_m)), "dwell_s": target.dwell_s}
            for target in site.targets
        },
        "landing": {
            mission.value: [_place(point) for point in points]
            for mission, points in site.landing_m.items()
        },
    }


def lidar_scene(site: Site) -> PlacedScene:
    """Scene of the lidar: the site's obstacles, and trees and a house beyond it."""
    origin = site.frame.origin
    xs = [
        site.workspace.lower_m[0],
        site.workspace.upper_m[0],
        *(point[0] for points in site.landing_m.values() for point in points),
    ]
    left_m, right_m = min(xs) - _AWAY_M, max(xs) + _AWAY_M
    return PlacedScene(
        name=site.name,
        origin=Geodetic(
            latitude_deg=origin.latitude_deg,
            longitude_deg=origin.longitude_deg,
            altitude_amsl_m=origin.altitude_amsl_m,
        ),
        azimuth_deg=site.frame.azimuth_deg,
        scene=LidarScene(
            wires=tuple(_wire(item) for item in site.conductors),
            prisms=tuple(
                Prism(
                    vertices_m=item.vertices_m,
                    lower_y_m=-_DEPTH_M / 2.0,
                    upper_y_m=_DEPTH_M / 2.0,
                )
                for item in site.obstacles
                if isinstance(item, Polygon)
            ),
            trees=(
                Tree(centre_m=(right_m, 2.0, 4.0), radius_m=3.5),
                Tree(centre_m=(right_m + 6.0, -4.0, 5.0), radius_m=4.5),
                Tree(centre_m=(left_m + 4.0, 12.0, 4.0), radius_m=3.0),
            ),
            boxes=(Box(lower_m=(left_m - 9.0, -6.0, 0.0), upper_m=(left_m, 6.0, 7.0)),),
        ),
    )


def added_obstacles(site: Site, vehicle: Vehicle) -> tuple[Obstacle, ...]:
    """The jib of a crane across the straight path to the first target, and a cable.

    From the first of fixed places for each with which all targets and a landing point can be
    reached, with the most room that such places leave. Without a place for the cable there is no
    cable.
    """
    for slack_m in _SLACKS_M:
        for jib in _jibs(site, vehicle):
            if _leaves_a_path(site, vehicle, (jib,), slack_m):
                cables = (
                    cable
                    for cable in _cables(site, _kept_m(vehicle) + slack_m)
                    if _leaves_a_path(site, vehicle, (jib, cable), slack_m)
                )
                return (jib, *itertools.islice(cables, 1))
    raise InputError("--perceive", "", f"{site.name} has no room for an obstacle on the way")


def _jibs(site: Site, vehicle: Vehicle) -> Iterator[Polygon]:
    """Jibs that bar the straight path, from its middle outwards."""
    (x_m, z_m), (end_x_m, end_z_m) = site.start_m, _rough(site.targets[0].position_m)
    along_m = (end_x_m - x_m, end_z_m - z_m)
    length_m = math.hypot(*along_m)
    straight = LineString([(x_m, z_m), (end_x_m, end_z_m)])
    for offset_m in _OFFSETS_M if length_m > 0.0 else ():
        for share in _SHARES:
            jib = _jib(
                x_m + share * along_m[0] - offset_m * along_m[1] / length_m,
                z_m + share * along_m[1] + offset_m * along_m[0] / length_m,
            )
            if Shape(jib.vertices_m).distance(straight) < _kept_m(vehicle):
                yield jib


def _cables(site: Site, kept_m: float) -> Iterator[Conductor]:
    """Cables that are not visible from the start, from the last target outwards.

    They keep their distance from all targets.
    """
    space, (x_m, z_m) = site.workspace, _rough(site.targets[-1].position_m)
    kept_from = [(_rough(target.position_m), kept_m) for target in site.targets]
    kept_from.append((site.start_m, _wire(_cable((x_m, z_m))).visible_m + 1.0))
    steps = range(-_CABLE_STEPS, _CABLE_STEPS + 1)
    places = [(x_m + dx, z_m + dz) for dx in steps for dz in steps]
    for place in sorted(places, key=lambda place: (math.dist(place, (x_m, z_m)), place)):
        inside = all(
            low < at < high
            for low, at, high in zip(space.lower_m, place, space.upper_m, strict=True)
        )
        if inside and all(math.dist(place, point) > least_m for point, least_m in kept_from):
            yield _cable(place)


class Sightings:
    """Lines about sightings, each once, from texts of the companion."""

    def __init__(self) -> None:
        self._reported: set[str] = set()

    def lines(self, texts: Sequence[str]) -> list[str]:
        """The new ones among all texts so far."""
        new = [text for text in texts if text.startswith(_SAID) and text not in self._reported]
        self._reported.update(new)
        return [f"seen: {text.removeprefix(_SPEAKER)}" for text in new]


def _kept_m(vehicle: Vehicle) -> float:
    """Distance of the aircraft from the seen obstacle."""
    return vehicle.radius_m + _KEEP_OUT_M + margin_of(vehicle, Supervision()).total_m


def _leaves_a_path(
    site: Site, vehicle: Vehicle, added: tuple[Obstacle, ...], slack_m: float
) -> bool:
    """True if paths reach all places, well inside the workspace, also with broader obstacles."""
    for wider_m in (0.0, slack_m):
        planner = _sighted(site, vehicle, added, wider_m)
        plans = [
            planner.plan(mission=Mission.INSPECTION, target=target.name) for target in site.targets
        ]
        escape = planner.plan(
            mission=next(mission for mission, points in site.landing_m.items() if points)
        )
        found = all(plan.status is PlanStatus.FOUND for plan in (*plans, escape))
        if not (found and all(_is_inside(plan, site.workspace) for plan in plans)):
            return False
    return True


def _sighted(site: Site, vehicle: Vehicle, added: tuple[Obstacle, ...], slack_m: float) -> Planner:
    """The planner with all obstacles seen, its targets moved as in flight."""
    seen = tuple(
        replace(item, keep_out_m=_KEEP_OUT_M + slack_m) for item in (*site.obstacles, *added)
    )
    targets = tuple(
        replace(target, position_m=_rough(target.position_m)) for target in site.targets
    )
    given = replace(site.with_obstacles(seen), targets=targets)
    flown = flown_site(given, vehicle, Supervision())
    planners = PlannerSet(Planner(flown, vehicle))
    job = MapJob(job_id=1, site=flown, slack_m=Perception().target_slack_m)
    answer_map_job(planners, job)
    return planners.exact


def _is_inside(plan: Plan, space: Workspace) -> bool:
    xs = plan.waypoints.position_m[:, 0]
    low_m, high_m = space.lower_m[0] + _INSIDE_M, space.upper_m[0] - _INSIDE_M
    return bool(xs.min() >= low_m and xs.max() <= high_m)


def _cable(place_m: PlanePoint) -> Conductor:
    return Conductor(name=ADDED[1], position_m=place_m, radius_m=_CABLE_M / 2.0)


def _jib(x_m: float, z_m: float) -> Polygon:
    wide_m, high_m = _JIB_M
    corners = ((-wide_m, -high_m), (wide_m, -high_m), (wide_m, high_m), (-wide_m, high_m))
    return Polygon(name=ADDED[0], vertices_m=tuple((x_m + dx, z_m + dz) for dx, dz in corners))


def _wire(conductor: Conductor) -> Wire:
    """A wire with its lowest point in the plane."""
    x_m, z_m = conductor.position_m
    return Wire(
        start_m=(x_m, -_HALF_SPAN_M, z_m + _SAG_M),
        end_m=(x_m, _HALF_SPAN_M, z_m + _SAG_M),
        sag_m=_SAG_M,
        diameter_m=max(2.0 * conductor.radius_m, _LEAST_WIRE_M),
    )


def _rough(point_m: PlanePoint) -> PlanePoint:
    return (round(point_m[0] / _ROUGH_M) * _ROUGH_M, round(point_m[1] / _ROUGH_M) * _ROUGH_M)


def _place(point_m: PlanePoint) -> dict[str, float]:
    return {"x_m": float(point_m[0]), "z_m": float(point_m[1])}

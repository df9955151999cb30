"""The judge: true course of a flight, from the fake autopilot's truth log and the site.

Independent of the planner's geometry on purpose: distances are Shapely's.
"""

from __future__ import annotations

import csv
import itertools
import math
from dataclasses import dataclass
from pathlib import Path

from shapely.geometry import LineString, Point, Polygon, box
from shapely.geometry.base import BaseGeometry

from moar_companion.planner.site import Conductor, Obstacle, PlanePoint, Site
from moar_companion.planner.site_frame import radii_of_curvature_m

_LEG_TOLERANCE_M = 2.0
"""Maximum distance from the landing leg, in wind, outside the workspace."""
_WAVER_M = 1.0
"""Distance by which an aircraft that comes in from outside may stray from it again."""
_THERE_M = 3.0
"""Distance at a target or a landing point; PX4 deviates by 2.55 m from its setpoint."""
_GROUND_M = 0.0
"""Height of the ground; PX4's own simulator stands centimetres below it, even when it first reports
flight."""
_OFF_PLANE_M = 3.0
"""Distance beside the plane that is still workspace, for the judge."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightTruth:
    """One row of the truth log, in the site's plane: x along it, y off it, z up."""

    time_s: float
    position_m: tuple[float, float, float]
    on_ground: bool
    armed: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Faults of a flight; empty when there are none."""

    faults: tuple[str, ...]
    least_clearance_m: float
    """Distance between the aircraft's hull and the nearest obstacle."""


def read_truth(path: Path, site: Site) -> list[FlightTruth]:
    """The truth log in the site's frame; a last row that a full disk cut short is left out."""
    origin = site.frame.origin
    azimuth = math.radians(site.frame.azimuth_deg)
    meridian_m, prime_vertical_m = radii_of_curvature_m(origin.latitude_deg)
    parallel_m = prime_vertical_m * math.cos(math.radians(origin.latitude_deg))
    rows = []
    whole_lines, _, _ = path.read_text(encoding="utf-8").rpartition("\n")
    lines = (line for line in whole_lines.splitlines() if not line.startswith("#"))
    for row in csv.DictReader(lines):
        north_m = math.radians(float(row["latitude_deg"]) - origin.latitude_deg) * meridian_m
        east_m = math.radians(origin.east_deg(float(row["longitude_deg"]))) * parallel_m
        rows.append(
            FlightTruth(
                time_s=float(row["time_s"]),
                position_m=(
                    north_m * math.cos(azimuth) + east_m * math.sin(azimuth),
                    north_m * math.sin(azimuth) - east_m * math.cos(azimuth),
                    float(row["altitude_amsl_m"]) - origin.altitude_amsl_m,
                ),
                on_ground=row["on_ground"] == "1",
                armed=row["armed"] == "1",
            )
        )
    return rows


def judge(
    flight: list[FlightTruth],
    site: Site,
    radius_m: float,
    landing_legs_m: list[list[PlanePoint]],
    landings_m: list[tuple[PlanePoint, ...]],
) -> Verdict:
    """Returns the objections about targets, landings, obstacles and the workspace.

    landing_legs_m: the planned legs out of the workspace, from their last cells to above their
    landing points. The vertical line below each end is permitted, too. An aircraft that took off
    outside the workspace may only come nearer. landings_m: the landing points of each flight, of
    which it may choose one.
    """
    faults: list[str] = []
    obstacles = [_shape(obstacle) for obstacle in site.obstacles]
    space = site.workspace
    workspace = box(*space.lower_m, *space.upper_m)
    flown = [row for row in flight if not row.on_ground]
    legs = [LineString([*leg_m, (leg_m[-1][0], _GROUND_M)]) for leg_m in landing_legs_m]
    least_m = math.inf
    for row in flown:
        place = Point(_place(row))
        least_m = min(least_m, *(shape.distance(place) for shape in obstacles), math.inf)
    left = _left(flight, workspace, legs)
    if left is not None:
        x_m, z_m = _place(left)
        faults.append(f"left the workspace at {left.time_s:.1f} s, x {x_m:.1f} m, z {z_m:.1f} m")
    if least_m <= radius_m:
        faults.append(f"touched an obstacle: {least_m:.2f} m from it, its radius is {radius_m} m")
    if not flown:
        faults.append("never flew")
    elif flight[-1].armed or not flight[-1].on_ground:
        faults.append("did not land")
    else:
        faults += _missed(flight, site, landings_m)
    return Verdict(faults=tuple(faults), least_clearance_m=least_m - radius_m)


def _missed(
    flight: list[FlightTruth], site: Site, landings_m: list[tuple[PlanePoint, ...]]
) -> list[str]:
    """Targets that were not reached, and landings that were not at their points."""
    faults = []
    for target in site.targets:
        nearest_m = min(math.dist(_place(row), target.position_m) for row in flight)
        if nearest_m > _THERE_M:
            faults.append(f"target {target.name} was not reached: {nearest_m:.1f} m from it")
    ends = [_place(rows[-1]) for rows in _flights(flight)]
    for number, points in enumerate(landings_m):
        x_m = ends[number][0] if number < len(ends) else math.inf
        if min(abs(x_m - point[0]) for point in points) > _THERE_M:
            where = " or ".join(f"{point[0]:g}" for point in points)
            found = f"landed at {x_m:.1f} m" if math.isfinite(x_m) else "not flown"
            faults.append(f"landing {number + 1} was to be at x {where} m: {found}")
    return faults


def _left(
    flight: list[FlightTruth], workspace: BaseGeometry, legs: list[LineString]
) -> FlightTruth | None:
    """First place outside the workspace that is neither on a landing leg nor on the way in."""
    within = workspace.buffer(-_WAVER_M)
    allowed_m = math.inf  # from the workspace
    for row in flight:
        if row.on_ground:
            allowed_m = math.inf
            continue
        x_m, z_m = _place(row)
        place = Point(x_m, max(z_m, _GROUND_M))
        away_m = workspace.distance(place)
        on_leg = any(leg.distance(place) <= _LEG_TOLERANCE_M for leg in legs)
        if (away_m > allowed_m and not on_leg) or abs(row.position_m[1]) > _OFF_PLANE_M:
            return row
        allowed_m = 0.0 if within.covers(place) else min(allowed_m, away_m + _WAVER_M)
    return None


def _flights(flight: list[FlightTruth]) -> list[list[FlightTruth]]:
    """Returns the places in the air, from each arming to disarming."""
    groups = itertools.groupby(flight, key=lambda row: row.armed)
    in_air = ([row for row in rows if not row.on_ground] for armed, rows in groups if armed)
    return [rows for rows in in_air if rows]


def _place(row: FlightTruth) -> PlanePoint:
    return row.position_m[0], row.position_m[2]


def _shape(obstacle: Obstacle) -> BaseGeometry:
    if isinstance(obstacle, Conductor):
        return Point(obstacle.position_m).buffer(obstacle.radius_m)
    return Polygon(obstacle.vertices_m)

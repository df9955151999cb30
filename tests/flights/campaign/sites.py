"""Sites of drawn flights: shipped ones, generated ones, one with a narrow gap."""

from __future__ import annotations

import math
import random
from dataclasses import replace

import shapely
from shapely.geometry import Point

from moar_companion.companion.error_margin import margin_of
from moar_companion.planner.site import Conductor, Obstacle, Polygon, Site, Target, Workspace
from moar_companion.planner.site_frame import SiteFrame
from moar_companion.settings.config import Supervision, shipped_configs
from moar_companion.types import GeodeticPoint, Mission
from tests.vehicles import named_vehicle

from ..judging import shape
from ..lockstep import as_simulated
from ..operator import Manner

SHIPPED = ("315kv_double_circuit", "120kv_single_circuit", "horizontal_three_conductors")
FREE_COLUMN_M = 5.0
"""Around the take-off."""
STANDOFF_M = (3.8, 5.0)
START_M = (27.0, 2.5)
LANDING_M = {Mission.EXIT: ((40.0, 2.5),), Mission.EVACUATION: ((-10.0, 2.5), (40.0, 2.5))}


def shipped_site(name: str) -> Site:
    """A site of the shipped configurations."""
    return Site.load(shipped_configs() / "sites" / f"{name}.yaml")


def generated_site(rng: random.Random, seed: int) -> Site:
    """One to five conductors, sometimes a tower leg; two targets; landing points on both sides."""
    obstacles: list[Obstacle] = [
        Conductor(
            name=f"conductor {number}",
            position_m=(rng.uniform(4.0, START_M[0] - FREE_COLUMN_M), rng.uniform(4.0, 18.0)),
            radius_m=rng.uniform(0.01, 0.03),
            keep_out_m=rng.choice((0.0, 0.25, rng.uniform(0.0, 0.8))),
        )
        for number in range(rng.randint(1, 5))
    ]
    if rng.random() < 0.4:
        x_m, wide_m, high_m = rng.uniform(6.0, 18.0), rng.uniform(0.5, 2.0), rng.uniform(4.0, 12.0)
        corners = ((x_m, 0.0), (x_m + wide_m, 0.0), (x_m + wide_m, high_m), (x_m, high_m))
        obstacles.append(Polygon(name="tower leg", vertices_m=corners, keep_out_m=0.3))
    site = _anywhere(rng, f"generated {seed}", obstacles)
    return replace(site, targets=tuple(_targets(rng, obstacles)))


def _targets(rng: random.Random, obstacles: list[Obstacle]) -> list[Target]:
    """Two places at a standoff from a conductor, and at least as far from all others."""
    conductors = [item for item in obstacles if isinstance(item, Conductor)]
    targets: list[Target] = []
    for _ in range(200):
        conductor = rng.choice(conductors)
        standoff_m, angle_rad = rng.uniform(*STANDOFF_M), rng.uniform(0.0, math.tau)
        x_m = conductor.position_m[0] + standoff_m * math.cos(angle_rad)
        z_m = conductor.position_m[1] + standoff_m * math.sin(angle_rad)
        room_m = min(
            shapely.distance(shape(item), Point(x_m, z_m)) - item.keep_out_m for item in obstacles
        )
        if 1.0 < x_m < 29.0 and 3.0 < z_m < 19.0 and room_m > STANDOFF_M[0] - 1.0:
            name = f"target {len(targets)}"
            targets.append(
                Target(
                    name=name,
                    position_m=(x_m, z_m),
                    dwell_s=rng.uniform(2.0, 8.0),
                    look_at_m=conductor.position_m,
                )
            )
        if len(targets) == 2:
            return targets
    return [*targets, Target(name="in the open", position_m=(28.0, 8.0), dwell_s=5.0)]


def narrow_site(rng: random.Random, manner: Manner, vehicle: str) -> tuple[Site, float]:
    """A wall of conductors with one gap, and a target beyond it; and the part of the gap.

    part: of the width that the vehicle needs as it is flown; below 1 there is no path.
    """
    flown = as_simulated(named_vehicle(vehicle), manner)
    keep_out_m, radius_m, part = 0.25, 0.0175, rng.uniform(0.98, 1.2)
    needed_m = flown.radius_m + radius_m + keep_out_m + margin_of(flown, Supervision()).total_m
    x_m, middle_m = rng.uniform(12.0, 16.0), rng.uniform(7.0, 13.0)
    closed_m = 1.6 * needed_m
    heights_m = []
    for direction in (-1.0, 1.0):
        z_m = middle_m + direction * part * needed_m
        while -closed_m < z_m < 20.0 + closed_m:
            heights_m.append(z_m)
            z_m += direction * closed_m
    obstacles = [
        Conductor(
            name=f"conductor {number}",
            position_m=(x_m, z_m),
            radius_m=radius_m,
            keep_out_m=keep_out_m,
        )
        for number, z_m in enumerate(sorted(heights_m))
        if z_m > 0.5
    ]
    target = Target(name="beyond", position_m=(x_m - 7.0, middle_m), dwell_s=4.0)
    site = _anywhere(rng, "narrow gap", obstacles)
    return replace(site, targets=(target,)), part


def moved_conductors(site: Site, rng: random.Random, most_m: float) -> tuple[Site, float]:
    """The site with each conductor elsewhere, and the greatest of these distances."""
    greatest_m = 0.0
    obstacles: list[Obstacle] = []
    for item in site.obstacles:
        if isinstance(item, Conductor):
            off_m, towards_rad = rng.uniform(0.1, most_m), rng.uniform(0.0, math.tau)
            x_m, z_m = item.position_m
            place_m = (x_m + off_m * math.cos(towards_rad), z_m + off_m * math.sin(towards_rad))
            obstacles.append(replace(item, position_m=place_m))
            greatest_m = max(greatest_m, off_m)
        else:
            obstacles.append(item)
    return replace(site, obstacles=tuple(obstacles)), greatest_m


def _anywhere(rng: random.Random, name: str, obstacles: list[Obstacle]) -> Site:
    """The obstacles anywhere on the earth, without a target."""
    origin = GeodeticPoint(
        latitude_deg=rng.uniform(-60.0, 60.0),
        longitude_deg=rng.uniform(-179.0, 179.0),
        altitude_amsl_m=rng.uniform(0.0, 1500.0),
    )
    return Site(
        name=name,
        frame=SiteFrame(origin=origin, azimuth_deg=rng.uniform(0.0, 360.0)),
        workspace=Workspace(
            lower_m=(0.0, 0.0), upper_m=(30.0, 20.0), resolution_m=0.3, min_altitude_m=2.0
        ),
        obstacles=tuple(obstacles),
        start_m=START_M,
        targets=(),
        landing_m=LANDING_M,
    )

"""Flight of a seed: line, surroundings, target, autopilot, wind, position noise."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass

from moar_companion.planner.site import PlanePoint, Site, Target, Workspace
from moar_companion.planner.site_frame import SiteFrame
from moar_companion.types import GeodeticPoint, Mission
from sitl.geodesy import Geodetic
from sitl.lidar import Box, LidarScene, Tree, Wire
from sitl.lidar_scene import PlacedScene

from ..operator import Manner
from .judging import clearance_m

START_M = (27.0, 2.5)
TURNED_DEG = 10.0
DIAMETERS_M = (0.015, 0.040)
HALF_SPAN_M = 150.0
STANDOFF_M = {Manner.PX4: (4.2, 6.0), Manner.ARDUPILOT: (3.2, 5.0)}
"""Beyond hull, keep-out and margin, with room for errors of the seen places."""
FREE_COLUMN_M = 5.0
"""Around the take-off."""
ROUGH_M = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Draw:
    """All inputs of one flight. site: the companion's. true_target_m: not rounded."""

    seed: int
    site: Site
    scene: PlacedScene
    true_target_m: PlanePoint
    added: str
    manner: Manner
    wind_mps: float
    wind_from_deg: float
    gust_mps: float
    position_noise: float


def draw(seed: int) -> Draw:
    """The flight of a seed."""
    rng = random.Random(seed)
    manner = rng.choice(list(Manner))
    turned = math.tan(math.radians(rng.uniform(-TURNED_DEG, TURNED_DEG)))
    wires = _line(rng, turned)
    trees = _trees(rng)
    target_m = _target(rng, manner, wires, trees)
    added = rng.choice(("nothing", "nothing", "solid", "wire"))
    more_wires, boxes = _added(rng, added, target_m, turned)
    origin = GeodeticPoint(
        latitude_deg=rng.uniform(-60.0, 60.0),
        longitude_deg=rng.uniform(-179.0, 179.0),
        altitude_amsl_m=rng.uniform(0.0, 1500.0),
    )
    azimuth_deg = rng.uniform(0.0, 360.0)
    rough_m = (round(target_m[0] / ROUGH_M) * ROUGH_M, round(target_m[1] / ROUGH_M) * ROUGH_M)
    return Draw(
        seed=seed,
        site=Site(
            name=f"unknown {seed}",
            frame=SiteFrame(origin=origin, azimuth_deg=azimuth_deg),
            workspace=Workspace(
                lower_m=(0.0, 0.0), upper_m=(30.0, 20.0), resolution_m=0.3, min_altitude_m=2.0
            ),
            obstacles=(),
            start_m=START_M,
            targets=(Target(name="target", position_m=rough_m, dwell_s=5.0),),
            landing_m={Mission.EXIT: ((40.0, 2.5),), Mission.EVACUATION: ((40.0, 2.5),)},
        ),
        scene=PlacedScene(
            name=f"unknown {seed}",
            origin=Geodetic(
                latitude_deg=origin.latitude_deg,
                longitude_deg=origin.longitude_deg,
                altitude_amsl_m=origin.altitude_amsl_m,
            ),
            azimuth_deg=azimuth_deg,
            scene=LidarScene(
                wires=(*wires, *more_wires),
                trees=trees,
                boxes=boxes,
                rain_per_m=rng.choice((0.0, 0.0, 0.002)),
            ),
        ),
        true_target_m=target_m,
        added=added,
        manner=manner,
        wind_mps=rng.uniform(0.0, 8.0),
        wind_from_deg=rng.uniform(0.0, 360.0),
        gust_mps=rng.choice((0.0, rng.uniform(0.0, 0.8))),
        position_noise=rng.uniform(0.3, 1.2),
    )


def wire_at(place_m: PlanePoint, diameter_m: float, turned: float, sag_m: float = 8.0) -> Wire:
    """A wire that crosses the plane at a place, where it hangs lowest; turned: dx for each dy."""
    x_m, z_m = place_m
    aside_m = turned * HALF_SPAN_M
    return Wire(
        start_m=(x_m - aside_m, -HALF_SPAN_M, z_m + sag_m),
        end_m=(x_m + aside_m, HALF_SPAN_M, z_m + sag_m),
        sag_m=sag_m,
        diameter_m=diameter_m,
    )


def _line(rng: random.Random, turned: float) -> tuple[Wire, ...]:
    """One or two circuits of two or three conductors each, on three levels or on one."""
    circuits, phases = rng.choice((1, 2)), rng.choice((2, 3))
    on_one_level = rng.random() < 0.4
    spacing_m, sag_m = rng.uniform(3.0, 7.0), rng.uniform(3.0, 10.0)
    low_m = rng.uniform(4.0, max(4.1, 18.0 - (0.0 if on_one_level else spacing_m * (phases - 1))))
    right_m = START_M[0] - FREE_COLUMN_M - rng.uniform(0.0, 4.0)
    apart_m = rng.uniform(6.0, 12.0)
    wires = []
    for circuit in range(circuits):
        diameter_m = rng.uniform(*DIAMETERS_M)
        for phase in range(phases):
            x_m = right_m - circuit * apart_m - (phase * spacing_m if on_one_level else 0.0)
            x_m -= rng.uniform(0.0, 1.5)
            z_m = low_m + (0.0 if on_one_level else phase * spacing_m)
            wires.append(wire_at((x_m, z_m), diameter_m, turned, sag_m))
    return tuple(wires)


def _trees(rng: random.Random) -> tuple[Tree, ...]:
    """Up to three, at the far end of the workspace or behind the start."""
    return tuple(
        Tree(
            centre_m=(
                rng.choice((rng.uniform(-8.0, 4.0), rng.uniform(36.0, 44.0))),
                rng.uniform(-6.0, 6.0),
                rng.uniform(2.0, 5.0),
            ),
            radius_m=rng.uniform(1.5, 3.5),
        )
        for _ in range(rng.randint(0, 3))
    )


def _target(
    rng: random.Random, manner: Manner, wires: tuple[Wire, ...], trees: tuple[Tree, ...]
) -> PlanePoint:
    """A place at a standoff from a wire, as far from all others; the start if there is none."""
    scene = LidarScene(wires=wires, trees=trees)
    for _ in range(300):
        middle = rng.choice(wires).ends()[12]
        standoff_m, angle_rad = rng.uniform(*STANDOFF_M[manner]), rng.uniform(0.0, math.tau)
        x_m = float(middle[0]) + standoff_m * math.cos(angle_rad)
        z_m = float(middle[2]) + standoff_m * math.sin(angle_rad)
        room_m = float(clearance_m(scene, [(x_m, 0.0, z_m)])[0])
        far = math.dist((x_m, z_m), START_M) > 4.0
        if 1.0 < x_m < 29.0 and 3.0 < z_m < 19.0 and far and room_m > STANDOFF_M[manner][0] - 0.5:
            return x_m, z_m
    return START_M[0], 9.0


def _added(
    rng: random.Random, added: str, target_m: PlanePoint, turned: float
) -> tuple[tuple[Wire, ...], tuple[Box, ...]]:
    """An obstacle near the straight path from the start to the target; the take-off stays free."""
    share = rng.uniform(0.45, 0.7)
    x_m = START_M[0] + share * (target_m[0] - START_M[0]) + rng.uniform(-1.0, 1.0)
    z_m = START_M[1] + share * (target_m[1] - START_M[1]) + rng.uniform(-1.0, 1.0)
    diameter_m, wide_m, high_m = (
        rng.uniform(*DIAMETERS_M),
        rng.uniform(0.3, 1.0),
        rng.uniform(0.3, 1.0),
    )
    deep_m = rng.uniform(2.0, 5.0)
    taken = min(math.dist((x_m, z_m), START_M), math.dist((x_m, z_m), target_m)) < 4.5
    if added == "nothing" or taken:
        return (), ()
    if added == "wire":
        return (wire_at((x_m, z_m), diameter_m, turned),), ()
    lower_m = (x_m - wide_m, -deep_m, z_m - high_m)
    return (), (Box(lower_m=lower_m, upper_m=(x_m + wide_m, deep_m, z_m + high_m)),)

"""Flight of a seed: site, vehicle, autopilot, wind, orders and faults."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass, field

import shapely
from shapely.geometry import Point

from moar_companion.config import Authority, shipped_configs
from moar_companion.frames import SiteFrame
from moar_companion.site import Conductor, Obstacle, Polygon, Site, Target, Workspace
from moar_companion.types import GeodeticPoint, Mission

from ..judging import shape
from ..operator import EVACUATION, EXIT, INSPECTION, Manner
from .kinds import KINDS

SHIPPED = ("315kv_double_circuit", "120kv_single_circuit", "horizontal_three_conductors")
VEHICLES = ("x500", "x500", "linedrone_uniform", "linedrone")
LASTS_S = 55.0
"""Duration of a flight, from its first order."""
FAULTS_S = (2.0, 35.0)
FREE_COLUMN_M = 5.0
"""Around the take-off."""
STANDOFF_M = (3.8, 5.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Order:
    """Action of the operator at a time after the first order: a mission, pause or continue."""

    at_s: float
    word: str
    mission: int = INSPECTION
    index: float = -1


@dataclass(frozen=True, slots=True, kw_only=True)
class Fault:
    """A fault of a kind: its begin after the first order, and its duration."""

    kind: str
    at_s: float
    lasts_s: float
    seed: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Draw:
    """All inputs of one flight."""

    seed: int
    site: Site
    vehicle: str
    manner: Manner
    authority: Authority
    parameters: dict[str, float]
    wind_mps: float
    wind_from_deg: float
    gust_mps: float
    orders: tuple[Order, ...]
    faults: tuple[Fault, ...]
    lasts_s: float = field(default=LASTS_S)


def draw(seed: int) -> Draw:
    """The flight of a seed. Successive seeds take successive kinds for the first fault."""
    rng = random.Random(seed)
    manner = rng.choice(list(Manner))
    names = [name for name, kind in KINDS.items() if manner in kind.manners]
    kinds = [names[seed % len(names)]]
    while len(kinds) < 3 and rng.random() < 0.4:
        kinds.append(rng.choice(names))
    site = _shipped(rng) if rng.random() < 0.6 else generated_site(rng, seed)
    return Draw(
        seed=seed,
        site=site,
        vehicle=rng.choice(VEHICLES),
        manner=manner,
        authority=Authority.ENGAGE if rng.random() < 0.2 else Authority.STREAM,
        parameters=_parameters(rng, manner),
        wind_mps=rng.uniform(0.0, 5.0),
        wind_from_deg=rng.uniform(0.0, 360.0),
        gust_mps=rng.choice((0.0, 0.0, rng.uniform(0.0, 0.8))),
        orders=_orders(rng, len(site.targets)),
        faults=tuple(_fault(rng, name) for name in kinds),
    )


def _shipped(rng: random.Random) -> Site:
    return Site.load(shipped_configs() / "sites" / f"{rng.choice(SHIPPED)}.yaml")


def _parameters(rng: random.Random, manner: Manner) -> dict[str, float]:
    if manner is Manner.PX4:
        return {"COM_OF_LOSS_T": rng.choice((0.5, 1.0))}
    return {"GUID_TIMEOUT": rng.choice((0.5, 1.0)), "SIM_BOOT_S": 8.0}


def _orders(rng: random.Random, targets: int) -> tuple[Order, ...]:
    first = rng.choice((INSPECTION, INSPECTION, INSPECTION, EXIT, EVACUATION))
    index = rng.choice((-1, rng.randrange(targets))) if first == INSPECTION else -1
    orders = [Order(at_s=0.0, word="mission", mission=first, index=index)]
    for _ in range(rng.randrange(4)):
        at_s, word = rng.uniform(3.0, 50.0), rng.choice(("mission", "mission", "pause", "go_on"))
        mission = rng.choice((INSPECTION, EXIT, EVACUATION))
        orders.append(Order(at_s=at_s, word=word, mission=mission))
    return tuple(sorted(orders, key=lambda order: order.at_s))


def _fault(rng: random.Random, name: str) -> Fault:
    low_s, high_s = KINDS[name].lasts_s
    return Fault(
        kind=name,
        at_s=round(rng.uniform(*FAULTS_S), 2),
        lasts_s=round(rng.uniform(low_s, high_s), 2),
        seed=rng.randrange(2**32),
    )


def generated_site(rng: random.Random, seed: int) -> Site:
    """One to five conductors, sometimes a tower leg; two targets; landing points on both sides."""
    start_m = (27.0, 2.5)
    obstacles: list[Obstacle] = [
        Conductor(
            name=f"conductor {number}",
            position_m=(rng.uniform(4.0, start_m[0] - FREE_COLUMN_M), rng.uniform(4.0, 18.0)),
            radius_m=rng.uniform(0.01, 0.03),
            keep_out_m=rng.choice((0.0, 0.25, rng.uniform(0.0, 0.8))),
        )
        for number in range(rng.randint(1, 5))
    ]
    if rng.random() < 0.4:
        x_m, wide_m, high_m = rng.uniform(6.0, 18.0), rng.uniform(0.5, 2.0), rng.uniform(4.0, 12.0)
        corners = ((x_m, 0.0), (x_m + wide_m, 0.0), (x_m + wide_m, high_m), (x_m, high_m))
        obstacles.append(Polygon(name="tower leg", vertices_m=corners, keep_out_m=0.3))
    origin = GeodeticPoint(
        latitude_deg=rng.uniform(-60.0, 60.0),
        longitude_deg=rng.uniform(-179.0, 179.0),
        altitude_amsl_m=rng.uniform(0.0, 1500.0),
    )
    return Site(
        name=f"generated {seed}",
        frame=SiteFrame(origin=origin, azimuth_deg=rng.uniform(0.0, 360.0)),
        workspace=Workspace(
            lower_m=(0.0, 0.0), upper_m=(30.0, 20.0), resolution_m=0.3, min_altitude_m=2.0
        ),
        obstacles=tuple(obstacles),
        start_m=start_m,
        targets=tuple(_targets(rng, obstacles)),
        landing_m={
            Mission.EXIT: ((40.0, 2.5),),
            Mission.EVACUATION: ((-10.0, 2.5), (40.0, 2.5)),
        },
    )


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

"""Flight of a seed: site, vehicle, autopilot, wind, orders and faults."""

from __future__ import annotations

import random
from collections.abc import Sequence
from dataclasses import dataclass, field

from moar_companion.planner.site import Site
from moar_companion.settings.config import Authority

from ..operator import EVACUATION, EXIT, INSPECTION, Manner
from .kinds import KINDS
from .sites import SHIPPED, generated_site, shipped_site

VEHICLES = ("x500", "x500", "linedrone_uniform", "linedrone")
LASTS_S = 55.0
"""Duration of a flight, from its first order."""
FAULTS_S = (2.0, 35.0)
FROM_GROUND = 0.25
"""Share of the flights that are flown whole, which costs 16 s of a flight more."""


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
    """All inputs of one flight. site: the true one."""

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
    mapped: Site | None = None
    """Site of the companion's file; None: the true one."""
    map_error_m: float = 0.0
    """Greatest distance of an obstacle from its place in the file."""
    gap_part: float | None = None
    """Width of the site's narrow gap, over the width that is needed."""
    whole: bool = True
    """The companion is there from the boot on, and also flies after a landing; otherwise it starts
    beside an aircraft in the air, and the flight ends after a landing."""
    lidar: bool = False
    signed: bool = False
    orders_by_mqtt: bool = False
    firmware: str = ""
    """Version whose names the autopilot's parameters have; empty: of the fake's own."""

    @property
    def file_site(self) -> Site:
        """Site of the companion's file."""
        return self.site if self.mapped is None else self.mapped


def draw(seed: int, kinds: Sequence[str] | None = None) -> Draw:
    """The flight of a seed. Successive seeds take successive kinds for the first fault.

    kinds: those to draw from; None: all.
    """
    rng = random.Random(seed)
    manner = rng.choice(list(Manner))
    names = [name for name in kinds or KINDS if manner in KINDS[name].manners]
    chosen = [names[seed % len(names)]]
    while len(chosen) < 3 and rng.random() < 0.4:
        chosen.append(rng.choice(names))
    site = shipped_site(rng.choice(SHIPPED)) if rng.random() < 0.6 else generated_site(rng, seed)
    drawn = Draw(
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
        faults=tuple(_fault(rng, name) for name in _compatible(chosen)),
        whole=rng.random() < FROM_GROUND,
    )
    for fault in drawn.faults:
        prepare = KINDS[fault.kind].prepare
        if prepare is not None:
            drawn = prepare(drawn, random.Random(fault.seed))
    return drawn


def _compatible(chosen: list[str]) -> list[str]:
    """The kinds, without a second one that prepares the flight: it would undo the first."""
    kept: list[str] = []
    for name in chosen:
        if KINDS[name].prepare is None or all(KINDS[each].prepare is None for each in kept):
            kept.append(name)
    return kept


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

"""One flight that captures views, from a seed to its result."""

from __future__ import annotations

import random
from collections import Counter
from dataclasses import dataclass, replace

from moar_companion.planner.site import Site, Target, TargetView
from moar_companion.settings.config import Inspection, OnFailure, shipped_configs
from sitl.payload import Payload

from ..cameras import payload_of
from ..lockstep import Lockstep, hovering
from ..operator import INSPECTION, Manner

PICTURES = 2
LONGEST_S = 200.0
ONE_TARGET = 0.7
"""Part of the flights that capture one target alone."""
PILOT = (255, 190)
OURS = (1, 195)
FAULTS = (
    "none",
    "camera silent",
    "camera busy for 6 s",
    "card full",
    "confirmations lost",
    "answers lost",
    "link loses 15 %",
    "slow gimbal",
    "gimbal does not look down",
    "gimbal silent",
    "pilot holds the gimbal",
    "pilot takes the gimbal",
    "pilot takes over",
    "hold and continue",
    "position noise",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Draw:
    """What a seed decides. fault_s: its time after the arrival at the first view."""

    manner: Manner
    target: int
    wind_mps: float
    wind_from_deg: float
    gust_mps: float
    fault: str
    fault_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """A judged flight. offs: of each counted picture (right, down, blur_px, marked)."""

    draw: Draw
    faults: tuple[str, ...]
    wanted: int
    counted: int
    taken: int
    failed: int
    offs: tuple[tuple[float, float, float, bool], ...]
    flown_s: float


def draw(seed: int) -> Draw:
    """The draw of a seed, always the same."""
    rng = random.Random(seed)
    return Draw(
        manner=rng.choice(list(Manner)),
        target=0 if rng.random() < ONE_TARGET else -1,
        wind_mps=rng.uniform(0.0, 7.0),
        wind_from_deg=rng.uniform(0.0, 360.0),
        gust_mps=rng.uniform(0.0, 1.0),
        fault=rng.choice(FAULTS),
        fault_s=rng.uniform(0.0, 4.0),
    )


def site_with_views() -> Site:
    """The shipped site; from the place of its first splice also the conductors above and below."""
    site = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
    outer, inner = site.targets
    conductors = {item.name: item.position_m for item in site.conductors}
    aims = [conductors[name] for name in ("right-middle", "right-upper", "right-lower")]
    views = [_view(outer, number, aim_m) for number, aim_m in enumerate(aims, start=1)]
    assert inner.look_at_m is not None
    return replace(site, targets=(*views, _view(inner, 1, inner.look_at_m)))


def _view(target: Target, number: int, aim_m: tuple[float, float]) -> Target:
    view = TargetView(
        target=target.name, number=number, aim_m=aim_m, pictures=PICTURES, video_s=0.0
    )
    name = f"{target.name}/{number}"
    return replace(target, name=name, dwell_s=0.0, look_at_m=aim_m, view=view)


def fly(seed: int) -> Result:
    """Flies and judges a seed."""
    drawn = draw(seed)
    site = site_with_views()
    options = payload_of(site)
    flight = hovering(
        site=site,
        manner=drawn.manner,
        payload=options,
        inspection=Inspection(on_failure=OnFailure.CONTINUE),
    )
    flight.payload = Payload(replace(options, seed=seed))
    began_s = flight.now_s
    conditions = flight.autopilot.conditions
    conditions.wind_mps, conditions.wind_from_deg = drawn.wind_mps, drawn.wind_from_deg
    conditions.gust_mps = drawn.gust_mps
    if drawn.fault == "pilot holds the gimbal":
        flight.payload.holder = PILOT
    if drawn.fault == "link loses 15 %":
        conditions.link_loss_percent = 15.0
    if drawn.fault == "position noise":
        conditions.gps_noise_factor = 3.0
    flight.begin(INSPECTION, drawn.target)
    holders = _flown(flight, drawn)
    return _judged(flight, drawn, site, holders, flight.now_s - began_s)


def _flown(flight: Lockstep, drawn: Draw) -> Counter[tuple[int, int]]:
    """Flies to the end; returns the holders of the gimbal at each change of it."""
    holders: Counter[tuple[int, int]] = Counter()
    end_s, arrived_s, faulty = flight.now_s + LONGEST_S, None, False
    while flight.now_s < end_s:
        before = flight.payload.holder
        flight.step()
        if flight.payload.holder != before:
            holders[flight.payload.holder] += 1
        if flight.state == "at_target" and arrived_s is None:
            arrived_s = flight.now_s
        if not faulty and arrived_s is not None and flight.now_s >= arrived_s + drawn.fault_s:
            faulty = True
            _fail(flight, drawn.fault)
        if flight.state in {"holding", "overridden", "released", "idle"}:
            break
    flight.run(3.0)
    return holders


def _fail(flight: Lockstep, fault: str) -> None:
    faults = flight.payload.faults
    match fault:
        case "camera silent":
            faults.camera_silent = True
        case "camera busy for 6 s":
            faults.busy = True
            flight.run(6.0)
            faults.busy = False
        case "card full":
            faults.card_full = True
        case "confirmations lost":
            faults.confirmations_lost = 0.6
        case "answers lost":
            faults.answers_lost = 0.4
        case "slow gimbal":
            faults.gimbal_rate_dps = 4.0
        case "gimbal does not look down":
            faults.gimbal_least_deg = -20.0
        case "gimbal silent":
            faults.gimbal_silent = True
        case "pilot takes the gimbal":
            flight.payload.holder = PILOT
        case "pilot takes over":
            flight.operator.mode("hold")
        case "hold and continue":
            flight.operator.pause()
            flight.run(3.0)
            flight.operator.go_on()
            flight.run(1.0)


def _judged(
    flight: Lockstep,
    drawn: Draw,
    site: Site,
    holders: Counter[tuple[int, int]],
    flown_s: float,
) -> Result:
    rows = [item.data for item in flight.decisions if item.kind == "picture"]
    counted = [row for row in rows if row["count"]]
    pictures = {picture.number: picture for picture in flight.payload.pictures}
    by_stop = Counter(row["stop"] for row in counted)
    faults = [
        f"{stop}: {count} pictures count, {PICTURES} were wanted"
        for stop, count in by_stop.items()
        if count > PICTURES
    ]
    offs = []
    for row in counted:
        sighting = pictures[row["number"]].sightings.get(row["stop"])
        marked = bool(row["marks"])
        if sighting is None:
            faults.append(f"picture {row['number']} does not show {row['stop']}")
            continue
        offs.append((sighting.right, sighting.down, sighting.blur_px, marked))
        good = sighting.in_middle_fifth and sighting.blur_px < 1.0
        if not (good or marked):
            faults.append(f"picture {row['number']} is off or blurred, and not marked: {sighting}")
    needless = [row["number"] for row in rows if not row["count"] and not row["marks"]]
    if needless:
        faults.append(f"taken again without need: {needless}")
    unread = len(pictures) - len(rows)
    may_lose = {"confirmations lost", "link loses 15 %", "camera silent", "pilot takes over"}
    if unread > 0 and drawn.fault not in may_lose:
        faults.append(f"{unread} pictures without a row")
    if drawn.fault == "pilot holds the gimbal" and holders:
        faults.append("the gimbal was taken from the pilot")
    if drawn.fault == "pilot takes the gimbal" and flight.payload.holder != PILOT:
        faults.append("the gimbal was taken back from the pilot")
    # A silent gimbal cannot take the release.
    if flight.payload.holder == OURS and drawn.fault != "gimbal silent":
        faults.append("the gimbal was not given back")
    stops = len(site.targets) if drawn.target < 0 else 3
    return Result(
        draw=drawn,
        faults=tuple(faults),
        wanted=PICTURES * stops,
        counted=len(counted),
        taken=len(pictures),
        failed=sum(
            item.data["outcome"] == "failed" for item in flight.decisions if item.kind == "view"
        ),
        offs=tuple(offs),
        flown_s=round(flown_s, 1),
    )

"""Settings of a demonstration from the command line: files, folder and end of the flight."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

from moar_companion.errors import InputError
from moar_companion.planner.site import PlanePoint, Site
from moar_companion.settings.config import shipped_configs
from moar_companion.types import Mission

from .manners import MANNERS
from .operator import EVACUATION, EXIT
from .options import parser
from .real import RealError, autopilot_at

ESCAPE_COMMANDS = {Mission.EXIT: EXIT, Mission.EVACUATION: EVACUATION}
"""The first mission for which a site has landing points is flown, unless another is requested."""
_SCENARIOS = Path(__file__).parents[1] / "scenarios"
_SITE = "315kv_double_circuit.yaml"
_ALL = "all"
_TOUR = "tour.yaml"
"""The scenario of a user's own site, and of a flight with perception."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """Values of the command line."""

    headless: bool
    autopilot: str
    speed: float
    site: Path
    scenario: Path
    out: Path
    links_latest: bool
    """True for a flight in `flights/`."""
    landing: str | None
    """`exit`, `evacuation:1` (a mission, and the index of its landing point), or `all`."""
    mqtt: bool
    page: bool
    real: Path | None
    """PX4's build folder or ArduCopter's program; None: the fake."""
    perceive: bool
    """The service's site has rough places alone, and a lidar measures the true obstacles."""
    pictures: str | None
    """`simulated`: each target has a view, which a simulated camera captures; `own`: the real
    autopilot's camera."""

    def check(self, site: Site) -> None:
        """Check that the script can be flown on a site; InputError otherwise."""
        if self.perceive and self.pictures:
            raise InputError("--pictures", "", "is flown without --perceive alone")
        if self.pictures == "own" and self.real is None:
            raise InputError("--pictures", "", "is own, must be simulated without --real")
        if not site.targets or not any(site.landing_m.values()):
            raise InputError(str(self.site), "", "must have targets and landing points to be flown")
        landing_choices(site, self.landing)


def landing_choices(site: Site, wanted: str | None) -> list[tuple[Mission, int]]:
    """The missions that end the flights and their landing points, -1 for any."""
    missions = [mission for mission in ESCAPE_COMMANDS if site.landing_m.get(mission)]
    if wanted is None:
        return [(missions[0], -1)]
    if wanted == _ALL:
        places: dict[PlanePoint, tuple[Mission, int]] = {}
        for mission in missions:
            for index, point in enumerate(site.landing_m[mission]):
                places.setdefault(point, (mission, index))
        return list(places.values())
    name, _, number = wanted.partition(":")
    chosen = next((mission for mission in missions if mission.value == name), None)
    count = 0 if chosen is None else len(site.landing_m[chosen])
    if chosen is not None and not number:
        return [(chosen, -1)]
    if chosen is None or not (number.isascii() and number.isdigit() and int(number) < count):
        allowed = " or ".join(
            [f"{item.value}[:N], N < {len(site.landing_m[item])}" for item in missions] + [_ALL]
        )
        raise InputError("--landing", "", f"is {wanted!r}, must be {allowed}")
    return [(chosen, int(number))]


def landing_points(site: Site, mission: Mission, index: int) -> tuple[PlanePoint, ...]:
    """The landing points that an order allows."""
    points = site.landing_m[mission]
    return points if index < 0 else (points[index],)


def read_settings(arguments: list[str] | None) -> Settings:
    """The settings, with their defaults; RealError for another kind of autopilot."""
    read = parser().parse_args(arguments)
    real = None if read.real is None else read.real.resolve()
    autopilot = read.autopilot or "px4"
    if real is not None:
        autopilot = autopilot_at(real)
        if read.autopilot not in {None, autopilot}:
            raise RealError(f"--real {real} is {autopilot}, not --autopilot {read.autopilot}")
    calm = read.perceive or read.site is not None
    usual = _TOUR if calm else MANNERS[autopilot].scenario
    landing = read.landing or (None if read.site is None else _ALL)
    scenario = read.scenario or _SCENARIOS / usual
    started = datetime.now(tz=timezone.utc).strftime("%Y%m%dT%H%M%SZ")
    return Settings(
        headless=read.headless,
        autopilot=autopilot,
        mqtt=read.mqtt,
        page=read.page,
        real=real,
        speed=read.speed,
        site=(read.site or shipped_configs() / "sites" / _SITE).resolve(),
        scenario=scenario.resolve(),
        out=(read.out or Path("flights") / started).resolve(),
        links_latest=read.out is None,
        landing=landing,
        perceive=read.perceive,
        pictures=read.pictures,
    )

"""Fly the demonstration: `sitl/fly`, or `python -m sitl.demonstration`.

Starts the fake autopilot and the companion service as two processes that know of each other only
by MAVLink, plays the operator, and judges the flight by the truth log. Exit status 0 when the
aircraft flew its mission and landed without touching anything and without leaving the workspace
other than by its landing leg.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import shutil
import sys
import tempfile
import webbrowser
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import NoReturn

import yaml

from moar_companion.config import shipped_configs
from moar_companion.errors import InputError
from moar_companion.outlets.flight_picture import FlightStory, draw_flight
from moar_companion.planner.maps import build_maps
from moar_companion.site import Site
from moar_companion.types import Mission
from moar_companion.vehicle import Vehicle
from sitl.scenario import Scenario, ScenarioError

from .judge import judge, read_truth
from .manners import MANNERS
from .operator import Operator, OperatorError
from .processes import free_ports, running
from .screen import open_screen, say
from .script import Script

_SCENARIOS = Path(__file__).parents[1] / "scenarios"
_VEHICLE = "x500.yaml"
_VEHICLE_FILE = "vehicle.yaml"
"""In the flight's folder."""
_SITE = "315kv_double_circuit.yaml"
_LEAST_FREE_MB = 50.0
"""Ten times what a flight writes."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """What the command line says."""

    headless: bool
    autopilot: str
    speed: float
    site: Path
    scenario: Path
    out: Path


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}\n")


def main(arguments: list[str] | None = None) -> int:
    """Fly; the exit status."""
    try:
        settings = _settings(arguments)
        site = Site.load(settings.site)
        Scenario.load(settings.scenario)
        _check(site, settings.site)
        _make_folder(settings.out)
        vehicle = _vehicle(settings)
    except (InputError, ScenarioError) as error:
        return _failed(str(error), 2)
    except OSError as error:
        return _failed(f"{settings.out}: {error.strerror}", 2)
    try:
        try:
            problem = _fly(settings, site)
        except KeyboardInterrupt:
            problem = "stopped by the user"
        return _report(settings, site, vehicle, problem)
    except OSError as error:
        return _failed(f"{error.filename or settings.out}: {error.strerror}", 1)
    except KeyboardInterrupt:
        return _failed("stopped by the user, without a picture", 1)


def _failed(message: str, status: int) -> int:
    sys.stderr.write(f"sitl/fly: {message}\n")
    return status


def _check(site: Site, path: Path) -> None:
    """Whether the script can be flown on a site; InputError otherwise."""
    if not site.targets or Mission.EXIT not in site.landing_m:
        raise InputError(str(path), "", "must have targets and landing.exit to be flown")


def _make_folder(out: Path) -> None:
    """A folder that can be written, has room, and holds no flight yet."""
    out.mkdir(parents=True, exist_ok=True)
    if (out / "truth.csv").exists():
        raise InputError("--out", "", f"{out} already holds a flight, must be another folder")
    with tempfile.TemporaryFile(dir=out):
        pass
    free_mb = shutil.disk_usage(out).free / 1e6
    if free_mb < _LEAST_FREE_MB:
        problem = f"{out} has {free_mb:.0f} MB free, must be at least {_LEAST_FREE_MB:.0f}"
        raise InputError("--out", "", problem)


def _vehicle(settings: Settings) -> Vehicle:
    """The X500 with the simulated autopilot and battery, as a file of the flight."""
    shipped = shipped_configs() / "vehicles" / _VEHICLE
    values = yaml.safe_load(shipped.read_text(encoding="utf-8"))
    values["autopilot"] = settings.autopilot
    values["risk"]["cells"] = MANNERS[settings.autopilot].cells
    file = settings.out / _VEHICLE_FILE
    file.write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")
    return Vehicle.load(file)


def _settings(arguments: list[str] | None) -> Settings:
    parser = _Parser(prog="sitl/fly", description="Fly the demonstration.")
    parser.add_argument("--headless", action="store_true", help="neither live view nor picture")
    parser.add_argument("--autopilot", choices=tuple(MANNERS), default="px4")
    parser.add_argument("--site", type=Path, metavar="FILE", help="default: 315 kV double circuit")
    parser.add_argument("--scenario", type=Path, metavar="FILE", help="default: wind, battery")
    parser.add_argument(
        "--speed", type=_speed, default=1.0, metavar="N", help="simulated seconds in a real one"
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="default: flights/ and the time")
    read = parser.parse_args(arguments)
    scenario = read.scenario or _SCENARIOS / MANNERS[read.autopilot].scenario
    started = datetime.now(tz=timezone.utc).strftime("%Y%m%dT%H%M%SZ")
    return Settings(
        headless=read.headless,
        autopilot=read.autopilot,
        speed=read.speed,
        site=(read.site or shipped_configs() / "sites" / _SITE).resolve(),
        scenario=scenario.resolve(),
        out=(read.out or Path("flights") / started).resolve(),
    )


def _speed(text: str) -> float:
    try:
        speed = float(text)
    except ValueError:
        speed = math.nan
    if not 0.0 < speed < math.inf:
        raise argparse.ArgumentTypeError(f"is {text!r}, must be a number more than 0")
    return speed


def _fly(settings: Settings, site: Site) -> str | None:
    """The whole flight; what went wrong, or None."""
    companion_port, operator_port = free_ports(2)
    home = site.frame.to_geodetic((site.start_m[0], 0.0, 0.0))
    config = settings.out / "companion.yaml"
    manner = MANNERS[settings.autopilot]
    with contextlib.ExitStack() as stack:
        # A socket's path may not be long: not in the user's folder.
        view = Path(stack.enter_context(tempfile.TemporaryDirectory())) / "view.sock"
        values = {
            "vehicle": _VEHICLE_FILE,
            "site": str(settings.site),
            "links": [{"url": f"udp:127.0.0.1:{companion_port}", "role": "autopilot"}],
            "recorder": {"directory": str(settings.out)},
            "view": {"socket": str(view)},
        }
        config.write_text(yaml.safe_dump(values, sort_keys=False), encoding="utf-8")
        screen = stack.enter_context(open_screen(view, live=not settings.headless))
        operator = Operator(operator_port, manner, speed=settings.speed, meanwhile=screen.refresh)
        stack.callback(operator.close)
        speed = str(settings.speed)
        autopilot = running(
            "autopilot",
            settings.out / "autopilot.log",
            "sitl",
            *("--autopilot", settings.autopilot),
            *("--home", f"{home.latitude_deg!r},{home.longitude_deg!r},{home.altitude_amsl_m!r}"),
            *("--link", f"companion=udpout:127.0.0.1:{companion_port}"),
            *("--link", f"gcs=udpout:127.0.0.1:{operator_port}"),
            *(word for value in manner.parameters for word in ("--param", value)),
            *("--scenario", str(settings.scenario)),
            *("--truth", str(settings.out / "truth.csv")),
            *("--speed", speed),
        )
        companion = running(
            "companion",
            settings.out / "companion.log",
            "sitl.demonstration.companion",
            *("--config", str(config), "--speed", speed),
        )
        script = Script(
            operator=operator,
            manner=manner,
            processes=(stack.enter_context(autopilot), stack.enter_context(companion)),
            speed=settings.speed,
            say=screen.say,
        )
        try:
            script.fly()
        except OperatorError as error:
            fast = settings.speed > 1.0
            hint = f"; is --speed {settings.speed:g} too much for this machine?" if fast else ""
            return f"{error}{hint}"
    return None


def _report(settings: Settings, site: Site, vehicle: Vehicle, problem: str | None) -> int:
    """Judge the flight, draw it, and say what came of it; the exit status."""
    recorded = sorted(settings.out.glob("flight_*"))
    truth = settings.out / "truth.csv"
    if not recorded or not truth.exists():
        say(f"nothing was flown: {problem or 'no recording'}; see the logs in {settings.out}")
        return 1
    folder = recorded[-1]
    shutil.move(folder / "flight.tlog", settings.out / "flight.tlog")
    shutil.move(folder / "decisions.jsonl", settings.out / "decisions.jsonl")
    folder.rmdir()
    story = FlightStory.read(settings.out / "decisions.jsonl")
    flight = read_truth(truth, site)
    verdict = judge(flight, site, vehicle.radius_m, story.landing_leg_m)
    picture = settings.out / "flight.png"
    flown = [(row.position_m[0], row.position_m[2]) for row in flight if not row.on_ground]
    draw_flight(story, flown, site, vehicle, build_maps(site, vehicle), picture)
    faults = [*([problem] if problem else []), *verdict.faults]
    say(f"least clearance {verdict.least_clearance_m:.2f} m, {len(story.plans)} paths planned")
    say(f"picture {picture}")
    say(f"recording {settings.out / 'flight.tlog'}")
    for fault in faults:
        say(f"FAULT: {fault}")
    if not settings.headless and not faults:
        webbrowser.open(picture.as_uri())
    say("FAILED" if faults else "mission flown and landed")
    return 1 if faults else 0

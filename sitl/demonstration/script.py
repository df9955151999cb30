"""Fly the demonstration: `sitl/fly`, or `python -m sitl.demonstration`.

Starts the fake autopilot and the companion service as two processes that know of each other only
by MAVLink, plays the operator, and judges the flight by the truth log. Exit status 0 when the
aircraft flew its mission and landed without touching anything and without leaving the workspace
other than by its landing leg.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import webbrowser
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import NoReturn

from moar_companion.config import shipped_configs
from moar_companion.errors import InputError
from moar_companion.outlets.flight_picture import FlightStory, draw_flight
from moar_companion.planner.maps import build_maps
from moar_companion.site import Site
from moar_companion.types import Mission
from moar_companion.vehicle import Vehicle
from sitl.scenario import Scenario, ScenarioError

from .judge import judge, read_truth
from .operator import EXIT, INSPECTION, Operator, OperatorError

_SCENARIO = Path(__file__).parents[1] / "scenarios" / "wind_then_battery.yaml"
_VEHICLE = "x500.yaml"
_SITE = "315kv_double_circuit.yaml"
_LOW_BATTERY_PERCENT = 35
_STREAM_FIRST_S = 1.5
"""PX4 gives OFFBOARD to a stream that has run for a second."""
_LONGEST_INSPECTION_S = 600.0
_LONGEST_HOLD_S = 60.0
_IN_AIR = 2
_TAKEN_OFF_M = 2.3
_STOP_TIMEOUT_S = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """What the command line says."""

    headless: bool
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
        vehicle = Vehicle.load(shipped_configs() / "vehicles" / _VEHICLE)
        Scenario.load(settings.scenario)
        _check(site, settings.site)
        _make_folder(settings.out)
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
    """A folder that can be written, and holds no flight yet."""
    out.mkdir(parents=True, exist_ok=True)
    if (out / "truth.csv").exists():
        raise InputError("--out", "", f"{out} already holds a flight, must be another folder")
    with tempfile.TemporaryFile(dir=out):
        pass


def _settings(arguments: list[str] | None) -> Settings:
    parser = _Parser(prog="sitl/fly", description="Fly the demonstration.")
    parser.add_argument("--headless", action="store_true", help="do not open the picture")
    parser.add_argument("--autopilot", choices=("px4",), default="px4")
    parser.add_argument("--site", type=Path, metavar="FILE", help="default: 315 kV double circuit")
    parser.add_argument("--scenario", type=Path, default=_SCENARIO, metavar="FILE")
    parser.add_argument("--out", type=Path, metavar="DIR", help="default: flights/ and the time")
    read = parser.parse_args(arguments)
    started = datetime.now(tz=timezone.utc).strftime("%Y%m%dT%H%M%SZ")
    return Settings(
        headless=read.headless,
        site=(read.site or shipped_configs() / "sites" / _SITE).resolve(),
        scenario=read.scenario.resolve(),
        out=(read.out or Path("flights") / started).resolve(),
    )


def _fly(settings: Settings, site: Site) -> str | None:
    """The whole flight; what went wrong, or None."""
    companion_port, operator_port = _free_ports(2)
    home = site.frame.to_geodetic((site.start_m[0], 0.0, 0.0))
    config = settings.out / "companion.yaml"
    config.write_text(
        json.dumps(
            {
                "vehicle": str(shipped_configs() / "vehicles" / _VEHICLE),
                "site": str(settings.site),
                "links": [{"url": f"udp:127.0.0.1:{companion_port}", "role": "autopilot"}],
                "recorder": {"directory": str(settings.out)},
            },
            indent=2,
        )
    )
    operator = Operator(operator_port)
    with (
        contextlib.closing(operator),
        _process(
            settings.out / "autopilot.log",
            "sitl",
            "--home",
            f"{home.latitude_deg!r},{home.longitude_deg!r},{home.altitude_amsl_m!r}",
            "--link",
            f"companion=udpout:127.0.0.1:{companion_port}",
            "--link",
            f"gcs=udpout:127.0.0.1:{operator_port}",
            "--scenario",
            str(settings.scenario),
            "--truth",
            str(settings.out / "truth.csv"),
        ),
        _process(
            settings.out / "companion.log", "moar_companion", "--config", str(config)
        ) as companion,
    ):
        try:
            _operate(operator, companion)
        except OperatorError as error:
            return str(error)
    return None


def _operate(operator: Operator, companion: subprocess.Popen[bytes]) -> None:
    """The operator's script."""

    def alive() -> bool:
        if companion.poll() is not None:
            raise OperatorError("the companion ended; see companion.log")
        for text in operator.texts:
            if text.startswith(("MOAR released", "MOAR overridden")) and not operator.landing:
                raise OperatorError(f"the companion let go: {text}")
        return True

    _say("waiting for autopilot and companion")
    operator.wait_for("ready to arm", lambda: operator.ready_to_arm and alive(), 30.0)
    operator.wait_for("the companion", lambda: operator.companion_heard and alive(), 30.0)
    _say("arm, take off")
    operator.take_off(height_m=3.0)
    operator.wait_for("in the air", lambda: operator.landed_state == _IN_AIR, 20.0)
    operator.wait_for("take-off done", lambda: operator.altitude_m > _TAKEN_OFF_M, 20.0)
    _pause(operator, 3.0)
    _say("order the inspection, give OFFBOARD")
    operator.order("inspection", INSPECTION)
    _pause(operator, _STREAM_FIRST_S)
    operator.give_offboard()
    operator.wait_for("flying", lambda: operator.said("MOAR flying inspection"), 5.0)
    _say("flying; the wind will rise")
    operator.wait_for(
        "the end of the inspection",
        lambda: alive() and (operator.said("every target is done") or _low_battery(operator)),
        _LONGEST_INSPECTION_S,
    )
    if not _low_battery(operator):
        _say("every target is done; holding until the battery falls")
        with contextlib.suppress(OperatorError):
            operator.wait_for(
                "a low battery", lambda: alive() and _low_battery(operator), _LONGEST_HOLD_S
            )
    _say(f"battery at {operator.battery_percent} %: order the exit")
    operator.order("exit", EXIT)
    operator.wait_for(
        "the end of the exit", lambda: operator.said("MOAR holding exit") and alive(), 300.0
    )
    _say("above the landing point: LAND")
    operator.land()
    operator.wait_for("landed and disarmed", lambda: not operator.armed, 60.0)
    _say("landed")


def _low_battery(operator: Operator) -> bool:
    percent = operator.battery_percent
    return percent is not None and percent <= _LOW_BATTERY_PERCENT


def _pause(operator: Operator, seconds: float) -> None:
    """Let time pass while the screen goes on reading."""
    with contextlib.suppress(OperatorError):
        operator.wait_for("time", lambda: False, seconds)


def _report(settings: Settings, site: Site, vehicle: Vehicle, problem: str | None) -> int:
    """Judge the flight, draw it, and say what came of it; the exit status."""
    recorded = sorted(settings.out.glob("flight_*"))
    truth = settings.out / "truth.csv"
    if not recorded or not truth.exists():
        _say(f"nothing was flown: {problem or 'no recording'}; see the logs in {settings.out}")
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
    _say(f"least clearance {verdict.least_clearance_m:.2f} m, {len(story.plans)} paths planned")
    _say(f"picture {picture}")
    _say(f"recording {settings.out / 'flight.tlog'}")
    for fault in faults:
        _say(f"FAULT: {fault}")
    if not settings.headless and not faults:
        webbrowser.open(picture.as_uri())
    _say("FAILED" if faults else "mission flown and landed")
    return 1 if faults else 0


@contextlib.contextmanager
def _process(log: Path, *module_and_arguments: str) -> Iterator[subprocess.Popen[bytes]]:
    """A Python module as a process, with its output in a file; ended by SIGTERM."""
    with log.open("wb") as output:
        process = subprocess.Popen(
            [sys.executable, "-m", *module_and_arguments],
            stdout=output,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            cwd=Path(__file__).parents[2],
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
            start_new_session=True,
        )
        try:
            yield process
        finally:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(_STOP_TIMEOUT_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _free_ports(count: int) -> list[int]:
    """UDP ports on this machine that nobody listens on."""
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(count)]
    try:
        for item in sockets:
            item.bind(("127.0.0.1", 0))
        return [int(item.getsockname()[1]) for item in sockets]
    finally:
        for item in sockets:
            item.close()


def _say(text: str) -> None:
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()

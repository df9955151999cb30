"""The demonstration's command line. It needs no package, so that its help needs no installation."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import NoReturn

from sitl.terminal import printable

AUTOPILOTS = ("px4", "ardupilot")


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {printable(message)}\n")


def parser() -> argparse.ArgumentParser:
    """The parser; its errors are one line, with status 2."""
    made = _Parser(prog="sitl/fly", description="Fly the demonstration.")
    made.add_argument(
        "--headless", action="store_true", help="plain lines, and the picture is not opened"
    )
    made.add_argument("--autopilot", choices=AUTOPILOTS, help="default: px4")
    made.add_argument(
        "--real",
        type=Path,
        metavar="PATH",
        help="fly a real one: PX4's build folder or the program arducopter (sitl/REAL.md)",
    )
    made.add_argument(
        "--site",
        type=Path,
        metavar="FILE",
        help="your own: every target, every landing point; default: 315 kV double circuit",
    )
    made.add_argument(
        "--scenario",
        type=Path,
        metavar="FILE",
        help="default: wind, battery; with --site or --perceive calm",
    )
    made.add_argument(
        "--speed", type=_speed, default=1.0, metavar="N", help="simulated seconds in a real one"
    )
    made.add_argument(
        "--landing",
        metavar="MISSION[:N]|all",
        help="where it ends; all: a flight to each landing point; default: exit, with --site all",
    )
    made.add_argument(
        "--mqtt",
        action="store_true",
        help="publish to an MQTT broker, which is started too, and read it with paho",
    )
    made.add_argument(
        "--page",
        action="store_true",
        help="serve the aircraft's page, and open it in the browser",
    )
    made.add_argument(
        "--perceive",
        action="store_true",
        help="tell the service rough targets alone: a simulated lidar sees what is there",
    )
    made.add_argument(
        "--pictures",
        nargs="?",
        const="simulated",
        choices=("simulated", "own"),
        help="capture each target with a simulated camera and gimbal; own: with those of --real",
    )
    made.add_argument("--out", type=Path, metavar="DIR", help="default: flights/ and the time")
    return made


def _speed(text: str) -> float:
    try:
        speed = float(text)
    except ValueError:
        speed = math.nan
    if not 0.0 < speed < math.inf:
        raise argparse.ArgumentTypeError(f"is {text!r}, must be a number more than 0")
    return speed


if __name__ == "__main__":
    parser().print_help()

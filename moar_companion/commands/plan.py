"""`moar-companion plan`: one path on a site, as a summary, JSON, maps and a picture.

Everything is checked before anything is written. That there is no path is an answer: JSON, maps
and picture are written all the same, stderr has the reason, and the exit status is 2.
"""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import IO, TYPE_CHECKING

from ..errors import InputError
from ..types import Mission, RiskIndices, Weights
from .options import add_file, file_name, numbers, refused, risk_indices
from .outputs import check_outputs, replacing

if TYPE_CHECKING:
    from ..planner.maps import Maps
    from ..planner.plan import Plan
    from ..site import Site

_STDOUT = "-"
_PICTURE_FORMATS = ("png", "svg", "pdf")
_MAX_VELOCITY_MPS = 1_000.0
"""Faster is no drone, and keeps all products finite."""
_MAPS = (
    "occupied",
    "safety_cost",
    "speed_limit_mps",
    "obstacle_distance_m",
    "hull_distance_m",
    "horizontal_distance_m",
    "collision_cost",
    "insertion_cost",
    "damage_cost",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The site and the problem; the outputs."""
    parser.add_argument("site", metavar="SITE", type=file_name("SITE"), help="the site file (YAML)")
    parser.add_argument(
        "--mission",
        metavar="|".join(mission.value for mission in Mission),
        type=_mission,
        required=True,
        help="to a target, or out of the site to a landing point",
    )
    parser.add_argument(
        "--target",
        metavar="NAME|INDEX",
        help="inspection: name of the target (default: the first); exit and evacuation: index of "
        "the landing point, from 0 (default: any)",
    )
    parser.add_argument(
        "--start",
        metavar="X,Z",
        type=numbers("--start", "X,Z", "metres"),
        help="where the vehicle is, in m (default: the site's start)",
    )
    parser.add_argument(
        "--velocity",
        metavar="VX,VZ",
        type=_velocity,
        default=(0.0, 0.0),
        help="how it moves, in m/s (default: at rest)",
    )
    add_file(parser, "--vehicle", "the vehicle file (default: the LineDrone)")
    parser.add_argument(
        "--risk",
        metavar="NAME=INDEX,...",
        type=risk_indices("--risk"),
        default={},
        help="risk indices in [0, 1] of wind, communication, localization, battery (default: 0), "
        "which adjust the weights",
    )
    parser.add_argument(
        "--weights",
        metavar="S,T,E",
        type=_weights,
        help="weights of safety, time and energy, not negative, of any sum (default: the "
        "vehicle's for the mission)",
    )
    add_file(parser, "--json", "write the plan as JSON; - is stdout")
    add_file(parser, "--maps", "write the maps as NPZ")
    add_file(parser, "--plot", "draw a picture (.png, .svg, .pdf)")


def run(arguments: argparse.Namespace) -> int:
    """Plan, write, tell."""
    from ..config import shipped_configs  # noqa: PLC0415
    from ..planner.planner import Planner  # noqa: PLC0415
    from ..site import Site  # noqa: PLC0415
    from ..vehicle import Vehicle  # noqa: PLC0415

    vehicle_file = arguments.vehicle or str(shipped_configs() / "vehicles" / "linedrone.yaml")
    site = Site.load(arguments.site)
    vehicle = Vehicle.load(vehicle_file)
    mission: Mission = arguments.mission
    target = _target(site, arguments.site, mission, arguments.target)
    picture_format = _picture_format(arguments.plot)
    _check_outputs(arguments, vehicle_file)
    risk = RiskIndices(**arguments.risk)
    weights: Weights = arguments.weights or vehicle.weights[mission]
    planner = Planner(site, vehicle)
    plan = planner.plan(
        mission=mission,
        target=target,
        start=arguments.start,
        velocity=arguments.velocity,
        weights=weights.adjusted(risk),
        risk=risk,
    )

    def draw(stream: IO[bytes]) -> None:
        from ..outlets.plan_picture import draw_plan  # noqa: PLC0415

        draw_plan(plan, site, vehicle, planner.maps, stream, picture_format)

    failures = [
        _write("--json", arguments.json, lambda stream: _write_json(plan, stream)),
        _write("--maps", arguments.maps, lambda stream: write_maps(planner.maps, stream)),
        _write("--plot", arguments.plot, draw),
    ]
    _say(plan.to_json() + "\n" if arguments.json == _STDOUT else summary(plan))
    problems = [failure for failure in failures if failure]
    if problems:
        raise OSError("; ".join(problems))
    if plan.reason:
        raise InputError("no plan", plan.status.value, plan.reason)
    return 0


def summary(plan: Plan) -> str:
    """The plan in a few lines for a person."""
    target = "" if plan.request.target is None else f" of {plan.request.target}"
    if plan.mission is not Mission.INSPECTION and target:
        target = f" to landing point {plan.request.target}"
    lines = [f"{plan.site}: {plan.mission.value}{target}: {plan.status.value}"]
    weights, compute = plan.weights, plan.compute
    if plan.cost is not None and plan.metrics is not None:
        cost, metrics = plan.cost, plan.metrics
        lines.append(
            f"  cost       J = {cost.total:.3f} (safety {cost.safety:.3f}, "
            f"time {cost.time:.3f} s, energy {cost.energy:.3f})"
        )
        lines.append(
            f"  path       {metrics.length_m:.1f} m in {metrics.duration_s:.1f} s, "
            f"{len(plan.waypoints.time_s)} waypoints, "
            f"velocity change {metrics.velocity_change_mps:.1f} m/s"
        )
        lines.append(
            "  clearance  no obstacles"
            if math.isinf(metrics.min_clearance_m)
            else f"  clearance  {metrics.mean_clearance_m:.2f} m on average, "
            f"{metrics.min_clearance_m:.2f} m at least"
        )
    lines.append(
        f"  weights    safety {weights.safety:.3f}, time {weights.time:.3f}, "
        f"energy {weights.energy:.3f}"
    )
    lines.append(
        f"  computed   maps {compute.map_ms:.1f} ms, search {compute.search_ms:.1f} ms, "
        f"{compute.expanded} states expanded"
    )
    return "\n".join(lines) + "\n"


def write_maps(maps: Maps, stream: IO[bytes]) -> None:
    """The maps in the form of the contract (NPZ)."""
    import numpy as np  # noqa: PLC0415

    x_m, z_m = maps.grid.axes_m
    np.savez_compressed(stream, x_m=x_m, z_m=z_m, **{name: getattr(maps, name) for name in _MAPS})


def _mission(text: str) -> Mission:
    known = [mission.value for mission in Mission]
    if text not in known:
        raise refused("--mission", text, f"must be one of {', '.join(known)}")
    return Mission(text)


def _velocity(text: str) -> tuple[float, ...]:
    velocity = numbers("--velocity", "VX,VZ", "m/s")(text)
    if math.hypot(*velocity) > _MAX_VELOCITY_MPS:
        raise refused("--velocity", text, f"must be at most {_MAX_VELOCITY_MPS:g} m/s")
    return velocity


def _weights(text: str) -> Weights:
    values = numbers("--weights", "S,T,E", "not negative")(text)
    try:
        return Weights.normalised(*values)
    except ValueError:
        raise refused("--weights", text, "must not be negative, with a positive sum") from None


def _target(site: Site, source: str, mission: Mission, given: str | None) -> str | int | None:
    """The target's name or the landing point's index, which the site has."""
    if mission is Mission.INSPECTION:
        names = [target.name for target in site.targets]
        if not names:
            raise InputError(source, "targets", "has none, an inspection needs one")
        if given is not None and given not in names:
            raise refused("--target", given, f"must be a target of the site: {', '.join(names)}")
        return given
    points = site.landing_m.get(mission, ())
    if not points:
        raise InputError(
            source, f"landing.{mission.value}", f"has none, an {mission.value} needs one"
        )
    if given is None:
        return None
    if not re.fullmatch(r"\d{1,9}", given, re.ASCII) or int(given) >= len(points):
        known = ", ".join(f"{index} at ({x:g}, {z:g})" for index, (x, z) in enumerate(points))
        raise refused("--target", given, f"must be the index of a landing point: {known}")
    return int(given)


def _picture_format(path: str | None) -> str:
    """By the file's ending; PNG without one."""
    ending = Path(path or "").suffix.removeprefix(".").lower() or _PICTURE_FORMATS[0]
    if path and ending not in _PICTURE_FORMATS:
        known = ", ".join(f".{known}" for known in _PICTURE_FORMATS)
        raise refused("--plot", path, f"must end in one of {known}")
    return ending


def _check_outputs(arguments: argparse.Namespace, vehicle_file: str) -> None:
    for option in ("--maps", "--plot"):
        if getattr(arguments, option[2:]) == _STDOUT:
            raise refused(option, _STDOUT, "must be a file: only --json goes to stdout")
    check_outputs(
        {
            "--json": None if arguments.json == _STDOUT else arguments.json,
            "--maps": arguments.maps,
            "--plot": arguments.plot,
        },
        {"the site": arguments.site, "the vehicle": vehicle_file},
    )


def _write_json(plan: Plan, stream: IO[bytes]) -> None:
    stream.write((plan.to_json() + "\n").encode())


def _write(option: str, path: str | None, content: Callable[[IO[bytes]], None]) -> str | None:
    """Write one file; what kept it from being written. The others are written all the same."""
    if path is None or path == _STDOUT:
        return None
    try:
        with replacing(path) as stream:
            content(stream)
    except OSError as error:
        return f"{option}: {path}: {error.strerror or error}"
    return None


def _say(text: str) -> None:
    if sys.stdout is None:
        raise OSError("stdout is closed")
    sys.stdout.write(text)
    sys.stdout.flush()

"""`moar-companion plan`: one path on a site, as a summary, JSON, maps and a picture.

Everything is checked before anything is written. If there is no path, JSON, maps and picture are
still written, stderr has the reason, and the exit status is 2.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import time
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from ..errors import InputError
from ..planner.adaptation import Adaptation
from ..settings.vehicle import AdaptationKind
from ..status_values import json_dict
from ..types import Mission, RiskIndices, Weights
from .options import add_file, file_name, number, numbers, refused, require, risk_indices
from .outputs import STDOUT, check_outputs, print_text, report_compiling, write_output
from .plan_summary import summary

if TYPE_CHECKING:
    from ..planner.analysis.pareto import Supported
    from ..planner.maps import Maps
    from ..planner.plan_values import Plan
    from ..planner.planner import Planner
    from ..planner.site import Site
    from ..planner.whole_front import Choice, WholeFront, Wish
    from ..settings.vehicle import Vehicle

_PICTURE_FORMATS = ("png", "svg", "pdf")
_MAX_VELOCITY_MPS = 1_000.0
"""Greatest speed of any drone; the limit keeps all products finite."""
_LIMITS = {
    "--within": ("duration_s", "s", "the longest that the flight may take, landing leg included"),
    "--energy": ("energy_wh", "Wh", "the most energy, by the powers of the vehicle file"),
    "--clearance": ("clearance_m", "m", "the least distance to an obstacle on all the path"),
}
"""Options of a wish: `whole_front.Limited`, unit, meaning."""
_PREFERENCES = {"safest": "the least safety cost", "fastest": "the least duration"}
_NOT_WITH_A_WISH = ("weights", "risk", "adaptation", "explain", "alternatives", "refine")
ALL = "all"
"""Target of a tour of all targets."""
_OF_ONE_PATH = (
    *_LIMITS,
    "--explain",
    "--alternatives",
    "--refine",
    "--pareto",
    "--pareto-plot",
)
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
    """Adds the site, the problem and the outputs."""
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
        help="inspection: name of the target or view (default: the first), or all: the tour of "
        "least cost; exit and evacuation: index of the landing point, from 0 (default: any)",
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
    add_file(parser, "--vehicle", "the vehicle file (default: the LineDrone as flown)")
    parser.add_argument(
        "--risk",
        metavar="NAME=INDEX,...",
        type=risk_indices("--risk"),
        default={},
        help="risk indices in [0, 1] of wind, communication, localization, battery (default: 0), "
        "which adjust the weights",
    )
    parser.add_argument(
        "--adaptation",
        metavar="|".join(kind.value for kind in AdaptationKind),
        type=_adaptation,
        help="how risks adjust the weights: as Eq. 9, or calibrated along the exact front from the "
        "start (default: the vehicle's)",
    )
    parser.add_argument(
        "--weights",
        metavar="S,T,E",
        type=_weights,
        help="weights of safety, time and energy, not negative, of any sum (default: the "
        "vehicle's for the mission)",
    )
    limits = parser.add_mutually_exclusive_group()
    for option, (_, unit, meaning) in _LIMITS.items():
        limits.add_argument(
            option,
            metavar=unit.upper(),
            type=partial(_limit, option, unit),
            help=f"{meaning}: the best path of the whole trade-off that keeps it",
        )
    preferences = parser.add_mutually_exclusive_group()
    for preference, meaning in _PREFERENCES.items():
        preferences.add_argument(
            f"--{preference}",
            dest="prefer",
            action="store_const",
            const=preference,
            help=f"with a limit: the path with {meaning} (default: --fastest with --clearance, "
            "--safest with the others)",
        )
    parser.add_argument(
        "--as-flown",
        action="store_true",
        help="keep the margin, too, that the service keeps from obstacles where no other is "
        "configured (`check` reports it)",
    )
    parser.add_argument(
        "--explain",
        action="store_true",
        help="tell what the risks did to the weights and, against the path without them, to it",
    )
    parser.add_argument(
        "--alternatives",
        action="store_true",
        help="also plan for other levels of risk: listed, in the JSON, thin lines in the picture",
    )
    parser.add_argument(
        "--refine",
        action="store_true",
        help="also bend and straighten the path, at any angle, where that costs less: in the "
        "summary, the JSON and the picture; it is not what the service flies",
    )
    add_file(parser, "--json", "write the plan as JSON; - is stdout")
    add_file(parser, "--maps", "write the maps as NPZ")
    add_file(parser, "--plot", "draw a picture (.png, .svg, .pdf); needs the extra plots")
    add_file(
        parser,
        "--pareto",
        "write the best paths for all weights, and how far weights and risks can move before the "
        "path changes, as JSON",
    )
    add_file(
        parser,
        "--pareto-plot",
        "draw the best paths for all weights (.png, .svg, .pdf); needs the extra plots",
    )


def run(arguments: argparse.Namespace) -> int:
    """Plans, writes the outputs, prints the summary."""
    from ..companion.error_margin import flown_site, margin_of  # noqa: PLC0415
    from ..planner.analysis.alternatives import alternatives, unmoved_words  # noqa: PLC0415
    from ..planner.planner import Planner  # noqa: PLC0415
    from ..planner.site import Site  # noqa: PLC0415
    from ..settings.config import Supervision, default_vehicle  # noqa: PLC0415
    from ..settings.vehicle import Vehicle  # noqa: PLC0415

    report_compiling()
    vehicle_file = arguments.vehicle or str(default_vehicle())
    site = Site.load(arguments.site)
    vehicle = Vehicle.load(vehicle_file)
    if arguments.as_flown:
        site = flown_site(site, vehicle, Supervision())
    mission: Mission = arguments.mission
    if _is_tour(site, arguments):
        return _plan_tour(arguments, site, vehicle, vehicle_file)
    target = _target(site, arguments.site, mission, arguments.target)
    wish = _wish(arguments)
    pictures = {"--plot": arguments.plot, "--pareto-plot": arguments.pareto_plot}
    formats = {option: _picture_format(option, path) for option, path in pictures.items()}
    _check_outputs(arguments, vehicle_file)
    for option, path in pictures.items():
        if path is not None:
            require(option, "matplotlib", "plots")
    risk = RiskIndices(**arguments.risk)
    weights: Weights = arguments.weights or vehicle.weights[mission]
    planner = Planner(site, vehicle, clock=time.perf_counter)
    plan = planner.plan(
        mission=mission,
        target=target,
        start=arguments.start,
        velocity=arguments.velocity,
        weights=weights,
        risk=risk,
        adaptation=arguments.adaptation,
    )

    choice = None if wish is None or plan.reason else _chosen(planner, plan, wish, vehicle)
    if choice is not None and choice.plan is not None:
        plan = choice.plan
    adaptation = plan.request.adaptation
    assert adaptation is not None  # the request has risks
    explanation = _explained(planner, plan, adaptation) if arguments.explain else {}

    others = alternatives(planner, plan.request, adaptation) if arguments.alternatives else ()
    unmoved = unmoved_words(planner, plan, others)
    refined = planner.refine(plan) if arguments.refine and not plan.reason else None
    margin_m = margin_of(vehicle, Supervision()).total_m
    notes = {"margin": _margin_words(margin_m, flown=arguments.as_flown)}
    left = len(site.targets) - 1
    if mission.visits_targets and target is None and left > 0:
        notes["targets"] = (
            f"the first alone; --target all: the tour with {left} more, as it is flown"
        )
    document = _document(plan, explanation, others)
    if choice is not None:
        document["wish"] = _wish_document(choice)
        notes["wish"] = _wish_words(choice)
    if arguments.refine:
        document["refined"] = None if refined is None else refined.to_dict()

    def draw(stream: IO[bytes]) -> None:
        from ..analysis.pictures.plan_picture import draw_plan  # noqa: PLC0415

        draw_plan(
            plan,
            site,
            vehicle,
            planner.maps,
            stream,
            formats["--plot"],
            alternatives=others,
            refined=refined,
            unmoved=unmoved,
        )

    def draw_trade_off(stream: IO[bytes]) -> None:
        from ..analysis.pictures.front_picture import draw_front  # noqa: PLC0415

        draw_front(
            plan, front, whole, site, vehicle, planner.maps, stream, formats["--pareto-plot"]
        )

    front: list[Supported] = []
    whole: WholeFront | None = None
    trade_off: dict[str, Any] = {}
    if arguments.pareto or arguments.pareto_plot:
        front, whole, trade_off = _trade_off(planner, plan, adaptation)
    failures = [
        write_output("--json", arguments.json, lambda stream: _write(document, stream)),
        write_output("--maps", arguments.maps, lambda stream: write_maps(planner.maps, stream)),
        write_output("--plot", arguments.plot, draw),
        write_output("--pareto", arguments.pareto, lambda stream: _write(trade_off, stream)),
        write_output("--pareto-plot", arguments.pareto_plot, draw_trade_off),
    ]
    if arguments.json == STDOUT:
        print_text(_text(document))
    else:
        print_text(summary(plan, notes, refined, explanation, others, unmoved))
    problems = [failure for failure in failures if failure]
    if problems:
        raise OSError("; ".join(problems))
    if plan.reason:
        raise InputError("no plan", plan.status.value, _whole_reason(planner, plan))
    if choice is not None and not choice.fulfilled:
        raise InputError(_limit_option(choice)[0], "", _wish_words(choice))
    return 0


def _is_tour(site: Site, arguments: argparse.Namespace) -> bool:
    """True for `--target all`; a target of that name takes precedence."""
    mission: Mission = arguments.mission
    return mission.visits_targets and arguments.target == ALL and ALL not in site.target_names


def _plan_tour(
    arguments: argparse.Namespace, site: Site, vehicle: Vehicle, vehicle_file: str
) -> int:
    """Plans the tour of all targets, writes the outputs, prints the summary."""
    from ..companion.error_margin import margin_of  # noqa: PLC0415
    from ..planner.planner import Planner  # noqa: PLC0415
    from ..settings.config import Supervision  # noqa: PLC0415
    from .plan_tour import planned_tour  # noqa: PLC0415

    for option in _OF_ONE_PATH:
        if getattr(arguments, option.removeprefix("--").replace("-", "_")) not in (None, False):
            raise refused("--target", ALL, f"but {option} is of one path: name a target")
    _target(site, arguments.site, arguments.mission, None)
    picture_format = _picture_format("--plot", arguments.plot)
    _check_outputs(arguments, vehicle_file)
    if arguments.plot is not None:
        require("--plot", "matplotlib", "plots")
    planner = Planner(site, vehicle, clock=time.perf_counter)
    tour = planned_tour(
        planner,
        start_m=arguments.start,
        velocity_mps=arguments.velocity,
        weights=arguments.weights,
        risk=RiskIndices(**arguments.risk),
        adaptation=arguments.adaptation,
    )
    margin_m = margin_of(vehicle, Supervision()).total_m
    margin = _margin_words(margin_m, flown=arguments.as_flown)
    failures = [
        write_output("--json", arguments.json, lambda stream: _write(tour.document(), stream)),
        write_output("--maps", arguments.maps, lambda stream: write_maps(planner.maps, stream)),
        write_output("--plot", arguments.plot, partial(tour.draw, picture_format)),
    ]
    print_text(_text(tour.document()) if arguments.json == STDOUT else tour.summary(margin))
    problems = [failure for failure in failures if failure]
    if problems:
        raise OSError("; ".join(problems))
    if tour.missing is not None:
        reason = _whole_reason(planner, tour.missing)
        raise InputError("no tour", tour.missing.status.value, reason)
    return 0


def _margin_words(margin_m: float, *, flown: bool) -> str:
    """The margin for the flight's errors that a plan keeps."""
    if flown:
        return f"{margin_m:g} m for the flight's errors, as the service keeps"
    return f"none; the service keeps {margin_m:g} m more from obstacles (--as-flown)"


def _whole_reason(planner: Planner, plan: Plan) -> str:
    """Reason why there is no plan, with the part of the margin that blocks the path, if any."""
    from ..planner.blocking_margin import blocking_part  # noqa: PLC0415

    def finds(freer: Planner) -> bool:
        try:
            return not freer.solve(plan.request).reason
        except InputError:
            return False

    part = blocking_part(planner, finds)
    return plan.reason if part is None else f"{plan.reason}: {part}"


def write_maps(maps: Maps, stream: IO[bytes]) -> None:
    """The maps of `--maps`, as arrays of an NPZ file."""
    import numpy as np  # noqa: PLC0415

    x_m, z_m = maps.grid.axes_m
    np.savez_compressed(stream, x_m=x_m, z_m=z_m, **{name: getattr(maps, name) for name in _MAPS})


def _limit(option: str, unit: str, text: str) -> float:
    value = number(text.removesuffix(unit))
    if value is None or value <= 0.0:
        raise refused(option, text, f"must be a positive number, in {unit}")
    return value


def _wish(arguments: argparse.Namespace) -> Wish | None:
    """The wish that the options make; None without a limit."""
    given = {
        option: value
        for option in _LIMITS
        if (value := getattr(arguments, option.removeprefix("--"))) is not None
    }
    if not given:
        if arguments.prefer is not None:
            raise refused(
                f"--{arguments.prefer}", "", f"needs a limit: one of {', '.join(_LIMITS)}"
            )
        return None
    from ..planner.whole_front import Limited, Preference, Wish  # noqa: PLC0415

    ((option, value),) = given.items()
    for other in _NOT_WITH_A_WISH:
        if getattr(arguments, other):
            raise refused(option, f"{value:g}", f"not with --{other}: the limit decides the path")
    limited = Limited(_LIMITS[option][0])
    usual = "fastest" if limited is Limited.CLEARANCE else "safest"
    return Wish(limited=limited, limit=value, prefer=Preference(arguments.prefer or usual))


def _chosen(planner: Planner, plan: Plan, wish: Wish, vehicle: Vehicle) -> Choice:
    from ..planner.whole_front import choose  # noqa: PLC0415
    from ..risk.power import PowerModel  # noqa: PLC0415

    began_s = time.perf_counter()
    choice = choose(planner, plan.request, wish, PowerModel.of(vehicle).powers_w)
    if choice.plan is None:
        return choice
    search_ms = 1e3 * (time.perf_counter() - began_s)
    compute = replace(choice.plan.compute, map_ms=plan.compute.map_ms, search_ms=search_ms)
    return replace(choice, plan=replace(choice.plan, compute=compute))


def _wish_document(choice: Choice) -> dict[str, Any]:
    wish = choice.wish
    return {
        "prefer": wish.prefer.value,
        "limited": wish.limited.value,
        "limit": wish.limit,
        "value": choice.value if math.isfinite(choice.value) else None,
        "fulfilled": choice.fulfilled,
    }


def _limit_option(choice: Choice) -> tuple[str, str]:
    """The option of a wish, and its unit."""
    limited = choice.wish.limited.value
    return next((option, unit) for option, (name, unit, _) in _LIMITS.items() if name == limited)


def _wish_words(choice: Choice) -> str:
    wish = choice.wish
    _, unit = _limit_option(choice)
    compared = "at least" if wish.limited.value == "clearance_m" else "at most"
    value = f"{choice.value:.2f} {unit}"
    if not choice.fulfilled:
        return f"no path has {compared} {wish.limit:g} {unit}, the nearest has {value}"
    return f"the {wish.prefer.value} with {compared} {wish.limit:g} {unit}: it has {value}"


def _mission(text: str) -> Mission:
    known = [mission.value for mission in Mission]
    if text not in known:
        raise refused("--mission", text, f"must be one of {', '.join(known)}")
    return Mission(text)


def _adaptation(text: str) -> AdaptationKind:
    known = [kind.value for kind in AdaptationKind]
    if text not in known:
        raise refused("--adaptation", text, f"must be one of {', '.join(known)}")
    return AdaptationKind(text)


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
    """The target's name or the landing point's index, checked against the site."""
    if mission.visits_targets:
        names = [*dict.fromkeys((*site.target_names, *(item.name for item in site.targets)))]
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


def _picture_format(option: str, path: str | None) -> str:
    """Format by the file's ending; PNG without one."""
    ending = Path(path or "").suffix.removeprefix(".").lower() or _PICTURE_FORMATS[0]
    if path and ending not in _PICTURE_FORMATS:
        known = ", ".join(f".{known}" for known in _PICTURE_FORMATS)
        raise refused(option, path, f"must end in one of {known}")
    return ending


def _check_outputs(arguments: argparse.Namespace, vehicle_file: str) -> None:
    files = {
        "--maps": arguments.maps,
        "--plot": arguments.plot,
        "--pareto": arguments.pareto,
        "--pareto-plot": arguments.pareto_plot,
    }
    for option, path in files.items():
        if path == STDOUT:
            raise refused(option, STDOUT, "must be a file: only --json goes to stdout")
    json_file = None if arguments.json == STDOUT else arguments.json
    check_outputs(
        {"--json": json_file, **files}, {"the site": arguments.site, "the vehicle": vehicle_file}
    )


def _trade_off(
    planner: Planner, plan: Plan, adaptation: Adaptation
) -> tuple[list[Supported], WholeFront | None, dict[str, Any]]:
    """The fronts of a plan's problem, and their document with the plan's sensitivity."""
    from ..planner.analysis.pareto import front_document, pareto_front, sensitivity  # noqa: PLC0415
    from ..planner.whole_front import whole_front  # noqa: PLC0415

    if plan.reason:
        return [], None, front_document(plan, [], {}, None)
    planner.prepare(mission=plan.mission, target=plan.request.target)
    front, whole = pareto_front(planner, plan.request), whole_front(planner, plan.request)
    return front, whole, front_document(plan, front, sensitivity(planner, plan, adaptation), whole)


def _text(document: dict[str, Any]) -> str:
    return json.dumps(document, allow_nan=False) + "\n"


def _write(document: dict[str, Any], stream: IO[bytes]) -> None:
    stream.write(_text(document).encode())


def _explained(planner: Planner, plan: Plan, adaptation: Adaptation) -> dict[str, Any]:
    """Effect of the risks on weights and path: against the plan of the problem without them."""
    from ..planner.comparison import path_difference  # noqa: PLC0415
    from ..risk.explain import weights_section  # noqa: PLC0415

    request = replace(plan.request, risk=RiskIndices()).adapted(adaptation)
    difference = path_difference(planner.solve(request), plan)
    return {
        "weights": json_dict(weights_section(adaptation, plan.request.risk)),
        "path": None if difference is None else difference.to_dict(),
    }


def _document(plan: Plan, explanation: dict[str, Any], others: Sequence[Plan]) -> dict[str, Any]:
    document = plan.to_dict() | ({"explanation": explanation} if explanation else {})
    if others:
        keys = ("risk", "weights", "status", "cost", "states", "waypoints", "metrics")
        plans = [other.to_dict() for other in others]
        document["alternatives"] = [{key: plan[key] for key in keys} for plan in plans]
    return document

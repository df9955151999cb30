"""`moar-companion site`: a site file from a point cloud or a map; what is made of a site."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from ..errors import InputError
from ..settings.input_file import open_file, unreadable
from . import site_actions, site_move, site_new
from .options import add_file, file_name, number, numbers, refused
from .outputs import check_outputs, print_text, report_compiling, write_output
from .site_move import shift_text
from .site_output import finished, next_step, out_file, plot_format, write_text

if TYPE_CHECKING:
    from ..planner.plan_values import Plan
    from ..planner.planner import Planner
    from ..planner.site import Site

_NEW = "new"
_MAPS = (".kml", ".geojson", ".json", ".csv")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the actions, each with its own options."""
    parser.add_argument(
        "action",
        metavar="|".join(_ACTIONS),
        type=_action,
        help="a site from a point cloud; from points on a map; of a typical line; a site on a "
        "map; moved in the world; its orders for ground stations",
    )
    parser.add_argument(
        "file",
        metavar="FILE",
        nargs="?",
        type=file_name("FILE"),
        help="the point cloud, map or site file; new has none",
    )
    cloud = parser.add_argument_group("from-cloud (.las .laz .ply .pcd .npz .xyz .pcap)")
    cloud.add_argument(
        "--at",
        metavar="LAT,LON|X,Y[,Z]",
        type=_place,
        help="the target: on the map, or in the file's coordinates",
    )
    cloud.add_argument(
        "--crs", metavar="EPSG:N", help="the coordinate system, where the file names none"
    )
    cloud.add_argument(
        "--origin",
        metavar="LAT,LON,ALT",
        type=numbers("--origin", "LAT,LON,ALT", "degrees and metres above mean sea level"),
        help="where the file's 0,0,0 is, if it has no coordinate system: x east, y north",
    )
    add_file(cloud, "--metadata", "of a .pcap of an Ouster: the sensor's description (.json)")
    cloud.add_argument(
        "--port", metavar="N", type=_port, help="of a .pcap: UDP port of the data packets"
    )
    cloud.add_argument("--seed", metavar="N", type=_seed, default=0, help="of RANSAC (default: 0)")
    written = parser.add_argument_group("all but show")
    add_file(written, "--out", "the site file to write; of actions: the folder")
    made = parser.add_argument_group("from-cloud, from-map and new")
    add_file(made, "--plot", "draw what was found (.png, .svg, .pdf); needs the extra plots")
    made.add_argument("--name", metavar="NAME", help="of the site (default: the file's)")
    made.add_argument(
        "--standoff",
        metavar="M",
        type=_length("--standoff"),
        default=4.0,
        help="of the target from its conductor, in m (default: 4)",
    )
    made.add_argument(
        "--keep-out",
        metavar="M",
        type=_length("--keep-out"),
        default=0.5,
        help="kept from conductors beyond the vehicle's distances, in m: sag changes with current "
        "and temperature (default: 0.5)",
    )
    made.add_argument(
        "--reach",
        metavar="M",
        type=_length("--reach", 100_000.0),
        default=500.0,
        help="from-map: greatest distance from the target, and between points of a conductor, in m "
        "(default: 500)",
    )
    shown = parser.add_argument_group("show")
    add_file(shown, "--kml", "write site and paths as KML")
    add_file(shown, "--geojson", "write site and paths as GeoJSON")
    add_file(shown, "--qgc-plan", "write the paths as a mission of QGroundControl")
    add_file(shown, "--vehicle", "the vehicle file (default: the LineDrone as flown)")
    site_new.add_arguments(parser)
    site_move.add_arguments(parser)
    site_actions.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Runs one action."""
    if arguments.file is None and arguments.action != _NEW:
        raise InputError("FILE", "", f"is missing: the file of {arguments.action}")
    report_compiling()
    return _ACTIONS[arguments.action](arguments)


def _from_cloud(arguments: argparse.Namespace) -> int:
    from ..perception.conductors import DetectorSettings  # noqa: PLC0415
    from ..perception.spans import find_power_line  # noqa: PLC0415
    from ..perception.survey.cross_section import site_of_cloud  # noqa: PLC0415
    from ..perception.survey.site_document import SiteOptions, SurveyError  # noqa: PLC0415
    from .point_clouds import around, height_notes, read_cloud  # noqa: PLC0415

    out = out_file(arguments)
    if arguments.at is None:
        raise InputError("--at", "", "is missing: the target, LAT,LON or X,Y[,Z]")
    cloud = read_cloud(arguments.file, arguments.crs, arguments.metadata, arguments.port)
    local = around(cloud, arguments.at, arguments.origin)
    line = find_power_line(local.points_m, DetectorSettings(seed=arguments.seed))
    options = SiteOptions(
        name=arguments.name or Path(arguments.file).stem,
        standoff_m=arguments.standoff,
        keep_out_m=arguments.keep_out,
    )
    try:
        section = site_of_cloud(local.points_m, line, local.at, local.target_height_m, options)
    except SurveyError as error:
        raise InputError(arguments.file, "", str(error)) from None
    system = cloud.crs.name if cloud.crs is not None else "its own metres"
    remarks = (
        f"From {Path(arguments.file).name} ({len(cloud.points)} points, {system}).",
        "Heights as scanned: sag changes with current, temperature and ice. Look at the picture,",
        "and survey targets and landing places before a flight.",
        *height_notes(cloud),
    )

    def draw(stream: IO[bytes]) -> None:
        from ..analysis.pictures.survey_picture import draw_survey  # noqa: PLC0415
        from ..perception.survey.survey_view import SurveyView  # noqa: PLC0415

        view = SurveyView(
            document=section.document,
            points_m=section.turned(local.points_m),
            classes=line.classes,
            plane_m=section.plane_m,
            plane_classes=section.classes,
            left_out_m=section.left_out_m,
        )
        draw_survey(view, stream, plot_format(arguments.plot))

    failure = _written(out, section.document, remarks)
    failures = [failure, write_output("--plot", arguments.plot, draw)]
    rows = "".join(
        f"  {name:<18} {len(each.wires)} wire{'s' if len(each.wires) > 1 else ' '}, "
        f"{each.curve.length_m:6.1f} m, {len(each.inliers):6} points, deviation "
        f"{each.sigma_m:.2f} m, confidence {each.confidence:.2f}\n"
        for name, each in section.conductors.items()
    )
    plane = _plane_text(section.document)
    notes = "".join(f"note: {note}\n" for note in (*section.notes, *height_notes(cloud)))
    head = f"{len(section.conductors)} conductors cross the plane:\n"
    print_text(f"{head}{rows}{plane}{notes}{next_step(out)}")
    return finished(failures, out)


def _from_map(arguments: argparse.Namespace) -> int:
    from ..perception.survey.drawn_site import site_of_features  # noqa: PLC0415
    from ..perception.survey.map_features import features_of  # noqa: PLC0415
    from ..perception.survey.site_document import SiteOptions  # noqa: PLC0415

    out = out_file(arguments)
    ending = Path(arguments.file).suffix.lower()
    if ending not in _MAPS:
        raise InputError(arguments.file, "", f"must end in one of {', '.join(_MAPS)}")
    try:
        with open_file(arguments.file) as file:
            text = file.read().decode("utf-8-sig")
    except OSError as error:
        raise InputError(arguments.file, "", unreadable(error)) from None
    except UnicodeDecodeError:
        raise InputError(arguments.file, "", "is no text in UTF-8") from None
    options = SiteOptions(
        name=arguments.name or Path(arguments.file).stem,
        standoff_m=arguments.standoff,
        keep_out_m=arguments.keep_out,
        reach_m=arguments.reach,
    )
    drawn = site_of_features(features_of(text, arguments.file, ending), arguments.file, options)

    def draw(stream: IO[bytes]) -> None:
        from ..analysis.pictures.survey_picture import draw_survey  # noqa: PLC0415
        from ..perception.survey.survey_view import SurveyView  # noqa: PLC0415

        view = SurveyView(document=drawn.document, marks=drawn.marks)
        draw_survey(view, stream, plot_format(arguments.plot))

    lines = (
        *(f"  {each}" for each in drawn.distances),
        *(f"left out: {each}" for each in drawn.left_out),
    )
    remarks = (f"From the points in {Path(arguments.file).name}.",)
    failures = [
        _written(out, drawn.document, remarks),
        write_output("--plot", arguments.plot, draw),
    ]
    counts = ", ".join(
        f"{len(drawn.document[key])} {key if len(drawn.document[key]) != 1 else key[:-1]}"
        for key in ("obstacles", "targets")
    )
    plane = _plane_text(drawn.document)
    print_text(f"{counts}\n{plane}" + "".join(f"{line}\n" for line in lines) + next_step(out))
    return finished(failures, out)


def _plane_text(document: dict[str, Any]) -> str:
    """A line with place and direction of the plane."""
    frame = document["frame"]
    origin = frame["origin"]
    return (
        f"the plane: x = 0 at {origin['latitude_deg']:.6f}, {origin['longitude_deg']:.6f} "
        f"(latitude, longitude), x to {frame['azimuth_deg']:.0f} deg\n"
    )


def _show(arguments: argparse.Namespace) -> int:
    from ..companion.error_margin import flown_site  # noqa: PLC0415
    from ..perception.survey.drawn_site import features_of_site, path_name  # noqa: PLC0415
    from ..perception.survey.map_features import geojson_of, kml_of  # noqa: PLC0415
    from ..perception.survey.qgc_plan import qgc_plan_of  # noqa: PLC0415
    from ..planner.planner import Planner  # noqa: PLC0415
    from ..planner.site import Site  # noqa: PLC0415
    from ..settings.config import Supervision, default_vehicle  # noqa: PLC0415
    from ..settings.vehicle import Vehicle  # noqa: PLC0415

    outputs = {
        "--kml": arguments.kml,
        "--geojson": arguments.geojson,
        "--qgc-plan": arguments.qgc_plan,
    }
    if not any(outputs.values()):
        raise InputError("show", "", f"writes nothing: give one of {', '.join(outputs)}")
    vehicle_file = arguments.vehicle or str(default_vehicle())
    check_outputs(outputs, {"the site": arguments.file, "the vehicle": vehicle_file})
    site, vehicle = Site.load(arguments.file), Vehicle.load(vehicle_file)
    plans, missing = _paths(Planner(flown_site(site, vehicle, Supervision()), vehicle), site)
    features = features_of_site(site, plans)
    texts = {
        "--kml": kml_of(site.name, features),
        "--geojson": geojson_of(features),
        "--qgc-plan": qgc_plan_of(site, plans, vehicle.autopilot),
    }
    failures = [
        write_output(option, path, partial(write_text, texts[option]))
        for option, path in outputs.items()
    ]
    print_text(
        "".join(map(shift_text, site.shifts))
        + "".join(f"{path_name(plan)}: {len(plan.states)} waypoints\n" for plan in plans)
        + "".join(f"no path: {reason}\n" for reason in missing)
    )
    return finished(failures)


def _paths(planner: Planner, site: Site) -> tuple[list[Plan], list[str]]:
    """Paths of an inspection of all targets, in the best order, and of the exit from the last."""
    from ..planner.plan_values import PlanRequest  # noqa: PLC0415
    from ..planner.tour import best_order, exit_request, visit_plans  # noqa: PLC0415
    from ..types import Mission, RiskIndices  # noqa: PLC0415

    request = PlanRequest(
        mission=Mission.INSPECTION,
        target=None,
        start_m=site.start_m,
        velocity_mps=(0.0, 0.0),
        weights=planner.vehicle.weights[Mission.INSPECTION],
        risk=RiskIndices(),
    )
    stops = best_order(planner, request, tuple(target.name for target in site.targets))
    visits, last = visit_plans(planner, request, stops)
    plans, missing = [*visits], []
    if Mission.EXIT in site.landing_m:
        try:
            plans.append(planner.solve(exit_request(planner, last)))
        except InputError as error:  # a landing place that cannot be flown to
            missing.append(str(error))
    missing += [
        f"{plan.request.target or plan.mission.value}: {plan.reason}"
        for plan in plans
        if plan.reason
    ]
    return [plan for plan in plans if not plan.reason], missing


def _written(out: str, document: dict[str, Any], remarks: tuple[str, ...]) -> str | None:
    from ..perception.survey.site_document import site_text  # noqa: PLC0415

    text = site_text(document, remarks)
    return write_output("--out", out, partial(write_text, text))


def _action(text: str) -> str:
    if text not in _ACTIONS:
        raise refused("site", text, f"must be one of {', '.join(_ACTIONS)}")
    return text


def _place(text: str) -> tuple[float, ...]:
    values = [number(part) for part in text.split(",")]
    known = tuple(value for value in values if value is not None)
    if len(known) != len(values) or len(known) not in (2, 3):
        raise refused("--at", text, "must be LAT,LON or X,Y or X,Y,Z: finite numbers")
    return known


def _seed(text: str) -> int:
    if not text.isascii() or not text.isdigit() or len(text) > 9:
        raise refused("--seed", text, "must be a whole number from 0 to 999999999")
    return int(text)


def _port(text: str) -> int:
    if not text.isascii() or not text.isdigit() or not 1 <= int(text[:9]) <= 65_535:
        raise refused("--port", text, "must be a UDP port from 1 to 65535")
    return int(text)


def _length(option: str, most_m: float = 100.0) -> Callable[[str], float]:
    def parse(text: str) -> float:
        value = number(text)
        if value is None or not 0.0 < value <= most_m:
            raise refused(option, text, f"must be a number of metres in (0, {most_m:.0f}]")
        return value

    return parse


_ACTIONS: dict[str, Callable[[argparse.Namespace], int]] = {
    "from-cloud": _from_cloud,
    "from-map": _from_map,
    _NEW: site_new.run,
    "show": _show,
    "shift": site_move.run,
    "actions": site_actions.run,
}

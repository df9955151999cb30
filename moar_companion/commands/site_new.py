"""`moar-companion site new`: a site of a typical line, by questions, options or a marked place."""

from __future__ import annotations

import argparse
import asyncio
from functools import partial

from ..errors import InputError, LinkError
from ..mavlink.telemetry import Gnss
from ..mavlink.urls import parse_url
from ..perception.survey.marked_place import MEANS, RTK_FIXED, MarkedPlace, PlaceMarker
from ..perception.survey.site_document import SiteOptions, site_text
from ..perception.survey.typical_lines import TYPICAL_LINES, frame_through, typical_site
from ..planner.site import PlanePoint
from ..types import GeodeticPoint
from .options import number, numbers, refused
from .outputs import print_text, write_output
from .questions import Questions
from .site_output import finished, next_step, out_file, write_text

_MOST_SPREAD_M = 0.3
"""Spread of a marked place above which it is no survey: it would eat the margin."""
_LONGEST_S = 60.0
_OLD_FIX_S = 2.0
"""Two reports of the fix."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `new`."""
    new = parser.add_argument_group(
        "new (--at LAT,LON,ALT: the ground below the line's axis, or --mark)"
    )
    new.add_argument(
        "--line",
        metavar="|".join(TYPICAL_LINES),
        type=_line,
        help="voltage class and circuits: "
        + "; ".join(f"{name}: {line.text}" for name, line in TYPICAL_LINES.items()),
    )
    new.add_argument(
        "--height",
        metavar="M",
        type=_height,
        help="of the lowest conductor above the ground in the plane, in m",
    )
    new.add_argument(
        "--along",
        metavar="DEG",
        type=_direction,
        help="compass direction in which you look along the line: the plane stands across it, and "
        "x grows to the right",
    )
    new.add_argument(
        "--mark",
        metavar="X,Z",
        type=numbers("--mark", "X,Z", "metres"),
        help="take the place from the aircraft on --connect, which hovers or stands at rest there "
        f"in the plane (0,0: on the ground below the axis; x to the right along --along): "
        f"mean of {MEANS} means of its RTK position",
    )
    new.add_argument("--connect", metavar="URL", help="of --mark: link to the autopilot")
    new.add_argument(
        "--any-fix", action="store_true", help="of --mark: take a position without RTK, too"
    )
    new.add_argument("--yes", action="store_true", help="ask nothing: take every default")


def run(arguments: argparse.Namespace) -> int:
    """Asks what is missing, marks the place, writes the site."""
    if arguments.file is not None:
        raise InputError("new", "", f"reads no file, but {arguments.file!r} is given")
    out, questions = out_file(arguments), Questions(yes=arguments.yes)
    if arguments.mark is not None and arguments.connect is None:
        raise InputError("--connect", "", "is missing: the link to the aircraft that marks")
    if arguments.mark is None and arguments.at is not None:
        _point(arguments.at)
    names = ", ".join(TYPICAL_LINES)
    name = questions.ask("--line", f"typical line: {names}", arguments.line, _line)
    lowest_m = questions.ask(
        "--height", "height of the lowest conductor here, m", arguments.height, _height
    )
    along_deg = questions.ask(
        "--along",
        "compass direction in which you look along the line, x to the right, deg",
        arguments.along,
        _direction,
    )
    remarks, place_m = [], (0.0, 0.0)
    if arguments.mark is None:
        at = questions.ask(
            "--at",
            "ground below the line's axis: LAT,LON,ALT",
            None if arguments.at is None else _point(arguments.at),
            lambda text: _point(numbers("--at", "LAT,LON,ALT", "degrees and metres")(text)),
        )
    else:
        place_m = _plane_point(arguments.mark)
        marked = asyncio.run(_marked(arguments.connect, needs_rtk=not arguments.any_fix))
        print_text(f"marked {marked}\n")
        if max(marked.horizontal_m, marked.vertical_m) > _MOST_SPREAD_M:
            raise LinkError(
                f"--mark: the position spreads by more than {_MOST_SPREAD_M:g} m: wait for a "
                "steady RTK fix, and hover at rest"
            )
        at = marked.point
        remarks = [f"x {place_m[0]:g}, z {place_m[1]:g} marked at {marked}."]
    line = TYPICAL_LINES[name]
    options = SiteOptions(
        name=arguments.name or line.text,
        standoff_m=arguments.standoff,
        keep_out_m=arguments.keep_out,
    )
    frame = frame_through(place_m, at, along_deg)
    document = typical_site(line, frame, lowest_m, options)
    text = site_text(
        document,
        [
            f"A typical line, not surveyed: {line.text}.",
            f"Spacings and diameters: {line.source}. z = 0: level ground.",
            "Survey conductors, targets and landing places before a flight.",
            *remarks,
        ],
    )
    failure = write_output("--out", out, partial(write_text, text))
    print_text(
        f"{line.text}; spacings: {line.source}\n"
        f"x grows towards {frame.azimuth_deg:g} degrees of the compass\n"
        "not surveyed: measure your conductors before a flight\n" + next_step(out)
    )
    return finished([failure], out)


async def _marked(url: str, *, needs_rtk: bool) -> MarkedPlace:
    """The place of the aircraft on a link; LinkError without enough positions."""
    from rich.console import Console  # noqa: PLC0415

    from .link_search import opened, until  # noqa: PLC0415

    parse_url(url)
    marker = PlaceMarker(needs_rtk=needs_rtk)
    with Console(stderr=True).status(f"listening on {url}") as status:
        async with opened([url]) as reader:

            def collected() -> bool:
                position, gnss = reader.telemetry.global_position, reader.telemetry.gnss
                if position is not None:
                    fix_type = _fix_type(gnss, position.received_s)
                    marker.add(position.point, position.received_s, fix_type)
                status.update(f"averaging the position: {marker.share:.0%}, fix {marker.fix_type}")
                return marker.done

            if not await until(collected, _LONGEST_S):
                raise LinkError(f"{url}: {_why_not(marker)}")
            return marker.result()


def _fix_type(gnss: Gnss | None, now_s: float) -> int | None:
    """Type of a receiver's fix; None if it was not reported lately."""
    return None if gnss is None or now_s - gnss.received_s > _OLD_FIX_S else gnss.fix_type


def _why_not(marker: PlaceMarker) -> str:
    if marker.fix_type is None:
        return f"no position with its fix for {_LONGEST_S:g} s"
    return (
        f"no RTK fix (type {RTK_FIXED}) for long enough, the last was type {marker.fix_type}: wait "
        "for it, or --any-fix"
    )


def _point(values: tuple[float, ...]) -> GeodeticPoint:
    shown = ",".join(f"{value:g}" for value in values)
    if len(values) != 3 or abs(values[0]) > 90.0 or abs(values[1]) > 180.0:
        raise refused("--at", shown, "must be LAT,LON,ALT: degrees, metres above mean sea level")
    latitude_deg, longitude_deg, altitude_m = values
    return GeodeticPoint(
        latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_amsl_m=altitude_m
    )


def _plane_point(values: tuple[float, ...]) -> PlanePoint:
    x_m, z_m = values
    return x_m, z_m


def _line(text: str) -> str:
    if text not in TYPICAL_LINES:
        raise refused("--line", text, f"must be one of {', '.join(TYPICAL_LINES)}")
    return text


def _height(text: str) -> float:
    value = number(text)
    if value is None or not 3.0 <= value <= 100.0:
        raise refused("--height", text, "must be a number of metres from 3 to 100")
    return value


def _direction(text: str) -> float:
    value = number(text)
    if value is None or not 0.0 <= value <= 360.0:
        raise refused("--along", text, "must be a compass direction from 0 to 360 degrees")
    return value

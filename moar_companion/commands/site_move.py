"""`moar-companion site shift`: a site that moves in the world, with a record in its file."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from datetime import date, datetime, timezone
from functools import partial
from typing import TYPE_CHECKING

from ..errors import InputError
from .options import number, refused
from .outputs import print_text, write_output
from .site_output import finished, next_step, out_file, write_text

if TYPE_CHECKING:
    from ..planner.site import FrameShift


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `shift`."""
    shifted = parser.add_argument_group("shift (a site whose RTK base has moved)")
    for direction in ("north", "east", "up"):
        shifted.add_argument(
            f"--{direction}",
            metavar="M",
            type=_displacement(f"--{direction}"),
            default=0.0,
            help=f"how far the site moves {direction}, in m (default: 0)",
        )
    shifted.add_argument(
        "--reason", metavar="TEXT", type=_reason, help="for the record in the file"
    )
    shifted.add_argument(
        "--date", metavar="DATE", type=_date, help="for the record, as 2026-05-31 (default: today)"
    )


def run(arguments: argparse.Namespace) -> int:
    """Writes the moved site, and shows its place."""
    from ..planner.site import FrameShift, Site  # noqa: PLC0415
    from ..planner.site_shift import shifted_text  # noqa: PLC0415
    from ..settings.yaml_file import text_of  # noqa: PLC0415

    out = out_file(arguments)
    if not (arguments.north or arguments.east or arguments.up):
        raise InputError("shift", "", "moves nothing: give --north, --east or --up")
    if not arguments.reason:
        raise InputError("--reason", "", "is missing: why the site is moved")
    shift = FrameShift(
        north_m=arguments.north,
        east_m=arguments.east,
        up_m=arguments.up,
        reason=arguments.reason,
        date=arguments.date or datetime.now(timezone.utc).date().isoformat(),
    )
    text = shifted_text(text_of(arguments.file), arguments.file, shift)
    frame = Site.of_text(text, out).frame
    failure = write_output("--out", out, partial(write_text, text))
    place = f"x = 0 at {frame.origin.latitude_deg:.8f}, {frame.origin.longitude_deg:.8f}"
    print_text(
        f"{shift_text(shift)}{place}, {frame.origin.altitude_amsl_m:.2f} m\n{next_step(out)}"
    )
    return finished([failure], out)


def shift_text(shift: FrameShift) -> str:
    """A line with the move of a frame."""
    return f"frame moved {shift}\n"


def _displacement(option: str) -> Callable[[str], float]:
    def parse(text: str) -> float:
        from ..planner.site import MAX_SHIFT_M  # noqa: PLC0415

        value = number(text)
        if value is None or abs(value) > MAX_SHIFT_M:
            allowed = f"must be a number of metres from -{MAX_SHIFT_M:g} to {MAX_SHIFT_M:g}"
            raise refused(option, text, allowed)
        return value

    return parse


def _reason(text: str) -> str:
    if not text.strip() or len(text) > 100 or not text.isprintable():
        raise refused("--reason", text, "must be 1 to 100 printable characters")
    return text


def _date(text: str) -> str:
    try:
        return date.fromisoformat(text).isoformat()
    except ValueError:
        raise refused("--date", text, "must be a day, as 2026-05-31") from None

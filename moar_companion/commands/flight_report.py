"""`moar-companion report`: what a flight inspected, as one self-contained HTML page.

Reads the flight's `.mcap` and, beside it, `inspection.jsonl`. With the camera's pictures the page
shows them beside their places, and copies of them get place, direction and time.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..analysis.inspection_report.flight_account import (
    TOPICS,
    AccountBuilder,
    FlightAccount,
)
from ..errors import InputError
from ..service.recording.calls import START, arguments_decoded
from ..service.recording.schemas import CALLS
from ..settings.input_file import unreadable
from .options import add_file, file_name, refused, require
from .outputs import check_outputs, print_text, write_output

if TYPE_CHECKING:
    from ..analysis.inspection_report.report_page import Thumbnail
    from ..planner.site import Site

RECORD = "inspection.jsonl"
_FLIGHT = "flight.mcap"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the flight, the pictures and the output."""
    parser.add_argument(
        "flight",
        metavar="FLIGHT",
        type=file_name("FLIGHT"),
        help="folder of the flight's recording, or its .mcap",
    )
    parser.add_argument(
        "--pictures",
        metavar="FOLDER",
        type=file_name("--pictures"),
        help="folder with the camera's pictures: shown in the page, and copied beside it with "
        "place, direction and time in EXIF; needs the extra plots",
    )
    add_file(parser, "--out", "the page (default: report.html in the flight's folder)")


def run(arguments: argparse.Namespace) -> int:
    """Reads the flight, writes the page and the copies, prints a summary."""
    from ..analysis.inspection_report.report_page import report_page  # noqa: PLC0415

    flight = Path(arguments.flight)
    recording = flight / _FLIGHT if flight.is_dir() else flight
    if not recording.is_file():
        raise InputError(arguments.flight, "", f"has no {_FLIGHT}, must be a flight's recording")
    out = Path(arguments.out or recording.with_name("report.html"))
    check_outputs({"--out": str(out)}, {"the recording": str(recording)})
    if arguments.pictures is not None:
        require("--pictures", "PIL", "plots")
        if not Path(arguments.pictures).is_dir():
            raise refused("--pictures", arguments.pictures, "must be a folder")
    account = _account(recording)
    thumbnails: dict[int, Thumbnail] = {}
    notes = [f"Made of {recording.name}; times are UTC."]
    if arguments.pictures is not None:
        thumbnails, more = _with_pictures(account, Path(arguments.pictures), out)
        notes += more
    page = report_page(account, thumbnails, notes).encode()
    failure = write_output("--out", str(out), lambda stream: stream.write(page))
    if failure:
        raise OSError(failure)
    print_text(_summary(account, out, notes[1:]))
    return 0


def _account(recording: Path) -> FlightAccount:
    """The account of a recording. Raises InputError for one that has no site."""
    from .replay_mcap import messages_of  # noqa: PLC0415

    builder, site, vehicle = AccountBuilder(), None, ""
    for topic, wall_s, content in messages_of(recording, TOPICS | {CALLS}):
        if topic != CALLS:
            builder.take(topic, wall_s, json.loads(content))
        elif site is None and (b'"take_ground"' in content or f'"{START}"'.encode() in content):
            site, vehicle = _site_of(json.loads(content)["calls"], vehicle)
    if site is None:
        raise InputError(str(recording), "", "has no site: nothing was inspected")
    return builder.account(recording.parent.name, site, vehicle, _record(recording.parent / RECORD))


def _site_of(calls: list[list[Any]], vehicle: str) -> tuple[Site | None, str]:
    """The site, if these calls have it, and the vehicle's name."""
    site: Site | None = None
    for method, data, _, _ in calls:
        if method == START:
            (start,) = arguments_decoded(method, data)
            site, vehicle = start.site or site, start.vehicle.name
        elif method == "take_ground":
            (site,) = arguments_decoded(method, data)
    return site, vehicle


def _record(path: Path) -> list[dict[str, Any]] | None:
    """Rows of the inspection's record; None without one. A last line that is cut is left out."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except FileNotFoundError:
        return None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(str(path), "", unreadable(error)) from error
    rows = []
    for number, line in enumerate(lines, start=1):
        try:
            rows.append(json.loads(line))
        except ValueError as error:
            if number < len(lines):
                raise InputError(str(path), f"line {number}", "is no JSON") from error
    return rows


def _with_pictures(
    account: FlightAccount, folder: Path, out: Path
) -> tuple[dict[int, Thumbnail], list[str]]:
    """Thumbnails by the index of their shot, with copies beside the page; notes on the others."""
    from ..analysis.inspection_report.picture_match import matched  # noqa: PLC0415
    from ..analysis.inspection_report.report_page import Thumbnail  # noqa: PLC0415
    from .picture_files import pictures_in, thumbnail_base64, write_copy  # noqa: PLC0415

    try:
        files = list(pictures_in(folder))
    except OSError as error:
        raise InputError(str(folder), "", unreadable(error)) from error
    indices = [index for index, row in enumerate(account.shots) if row["kind"] == "picture"]
    found = matched([account.shots[index] for index in indices], files)
    copies = out.with_name(f"{out.stem}-pictures")
    thumbnails: dict[int, Thumbnail] = {}
    unsound: list[str] = []
    for place, file in found.items():
        index, path = indices[place], folder / file.name
        copy = copies / f"{len(thumbnails) + 1:03d}-{path.name}"
        small = thumbnail_base64(path)
        copies.mkdir(parents=True, exist_ok=True)
        if small is None or not write_copy(path, copy, account.shots[index]):
            unsound.append(file.name)
            continue
        thumbnails[index] = Thumbnail(
            jpeg_base64=small, file=file.name, copy=f"{copies.name}/{copy.name}"
        )
    unmatched = len(files) - len(found)
    notes = [f"{len(thumbnails)} of {len(indices)} pictures of the record have their file."]
    if thumbnails:
        notes.append(f"Copies with place, direction and time: {copies.name}.")
    if unmatched:
        notes.append(f"{unmatched} files belong to no picture of the record.")
    if unsound:
        notes.append(f"No sound pictures: {', '.join(unsound)}.")
    return thumbnails, notes


def _summary(account: FlightAccount, out: Path, notes: list[str]) -> str:
    done = sum(visit.done for visit in account.visits)
    lines = [f"{account.site.name}: {done} of {len(account.visits)} places done"]
    lines += [
        f"  {visit.target.name}: {visit.outcome}{f', {visit.reason}' if visit.reason else ''}"
        for visit in account.visits
    ]
    return "\n".join([*lines, *(f"  {note}" for note in notes), f"wrote {out}"]) + "\n"

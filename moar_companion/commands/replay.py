"""`moar-companion replay`: risk indices and events over a recorded flight.

The recording is read whole, played by the code that flies, and shown as a summary, JSON and a
picture, which needs the extra `plots`. `recording_formats` reads it.
"""

from __future__ import annotations

import argparse
import contextlib
import gzip
import io
import math
import os
import zlib
from pathlib import Path
from typing import IO, TYPE_CHECKING

from ..errors import InputError
from ..settings.input_file import open_file, unreadable
from ..texts.text_format import printable
from .options import add_file, file_name, refused, require
from .outputs import STDOUT, check_outputs, print_text, report_compiling, write_output

if TYPE_CHECKING:
    from ..analysis.replay.replay_report import Replay
    from ..analysis.replay.site_position import SitePosition
    from ..risk.drag_fit import DragFlight
    from ..settings.vehicle import Vehicle

_GZIP = b"\x1f\x8b"
_MAX_BYTES = 512 << 20
"""Greatest size of a recording, unpacked: a day of telemetry has as much."""
_PIECE_BYTES = 1 << 20
_MAX_EVENTS = 60
"""Most events in the summary; the JSON has all."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the recording, its vehicle and site, and the outputs."""
    parser.add_argument(
        "recording",
        metavar="RECORDING",
        type=file_name("RECORDING"),
        help="the recording (.tlog, .tlog.gz, .mcap; .bin of ArduPilot; .ulg of PX4, with the "
        "extra ulog)",
    )
    add_file(parser, "--vehicle", "the vehicle file (default: the LineDrone as simulated)")
    add_file(parser, "--site", "the site file: where on it the aircraft was, and its escape route")
    add_file(parser, "--json", "write everything as JSON; - is stdout")
    add_file(parser, "--plot", "draw a picture (.png); needs the extra plots")
    parser.add_argument(
        "--exact",
        action="store_true",
        help="feed an .mcap to the companion again, and compare each decision and each byte that "
        "it sent; status 1 where they part",
    )
    add_file(parser, "--signing-key", "of --exact: the key of the recording's signed links")
    parser.add_argument(
        "--fit-drag",
        action="store_true",
        help="measure the vehicle's drag instead: prints lines for the vehicle file. Flown in calm "
        "air: hover for 20 s, then straight legs there and back, at two speeds or more",
    )


def run(arguments: argparse.Namespace) -> int:
    """Replays, writes the outputs, prints the summary, the JSON or the drag."""
    if arguments.exact:
        return _run_exactly(arguments)
    if arguments.signing_key is not None:
        raise refused("--signing-key", arguments.signing_key, "must come with --exact")
    from ..settings.config import shipped_configs  # noqa: PLC0415
    from ..settings.vehicle import Vehicle  # noqa: PLC0415

    report_compiling()
    vehicle_file = arguments.vehicle or str(shipped_configs() / "vehicles" / "linedrone.yaml")
    _check_outputs(arguments, vehicle_file)
    if arguments.plot is not None:
        require("--plot", "matplotlib", "plots")
    vehicle = Vehicle.load(vehicle_file)
    site_position = None if arguments.site is None else site_position_of(arguments.site, vehicle)
    drag = _drag_flight() if arguments.fit_drag else None
    replay = played(arguments.recording, vehicle, site_position, drag)

    def draw(stream: IO[bytes]) -> None:
        from ..analysis.pictures.replay_picture import draw_replay  # noqa: PLC0415

        draw_replay(replay, stream)

    failures = [
        write_output("--json", arguments.json, lambda stream: stream.write(_json(replay).encode())),
        write_output("--plot", arguments.plot, draw),
    ]
    if drag is not None:
        print_text(_drag_lines(arguments.recording, drag))
    else:
        print_text(_json(replay) if arguments.json == STDOUT else summary(replay))
    problems = [failure for failure in failures if failure]
    if problems:
        raise OSError("; ".join(problems))
    return 0


def _run_exactly(arguments: argparse.Namespace) -> int:
    from ..service.signing_key import signing_key_in  # noqa: PLC0415
    from .replay_mcap import MAGIC, replay_exactly  # noqa: PLC0415

    for name in ("vehicle", "site", "json", "plot"):
        given = getattr(arguments, name)
        if given is not None:
            raise refused(f"--{name}", given, "must be left out with --exact")
    if arguments.fit_drag:
        raise refused("--fit-drag", "", "must be left out with --exact")
    if not begins_with(arguments.recording, MAGIC):
        raise InputError(arguments.recording, "", "is no .mcap, as --exact needs")
    key = None if arguments.signing_key is None else signing_key_in(Path(arguments.signing_key))
    return replay_exactly(arguments.recording, key)


def summary(replay: Replay) -> str:
    """The replay in a few lines for a reader."""
    vehicle = f" {replay.vehicle_type}" if replay.vehicle_type else ""
    head = f"{replay.recording}: {replay.autopilot}{vehicle}, {replay.duration_s:.1f} s"
    lines = [f"{head}, judged as {replay.vehicle}"]
    for name, measures in replay.measures.items():
        values = [sample.risk[name] for sample in replay.samples]
        known = [value for value in values if value is not None]
        line = "unknown"
        if known:
            line = f"{min(known):.2f} to {max(known):.2f}"
        never = [item for item, measure in measures.items() if measure.greatest_risk is None]
        if known and never:
            line += f"; never known: {', '.join(never)}"
        lines.append(f"  {name:14} {line}")
    lines += _place_lines(replay)
    shown = replay.events[:_MAX_EVENTS]
    lines += [f"  {event.time_s:8.1f} s  {event.kind:9}  {event.text}" for event in shown]
    if len(shown) < len(replay.events):
        lines.append(f"  and {len(replay.events) - len(shown)} more events (--json has all)")
    return "\n".join(lines) + "\n"


def _place_lines(replay: Replay) -> list[str]:
    """Lines with the least clearance and the longest evacuation on the site."""
    places = [(sample.time_s, sample.place) for sample in replay.samples if sample.place]
    known = [
        (place.clearance_m, time_s) for time_s, place in places if place.clearance_m is not None
    ]
    evacuations_s = [place.evacuation_s for _, place in places if place.evacuation_s is not None]
    lines = []
    if known:
        least_m, time_s = min(known)
        lines.append(f"  clearance      {least_m:.2f} m at least, at {time_s:.1f} s")
    if evacuations_s:
        lines.append(f"  evacuation     {max(evacuations_s):.1f} s at most")
    return lines


def site_position_of(site_file: str, vehicle: Vehicle) -> SitePosition:
    """Positions on a site file, as it is flown. Raises InputError."""
    from ..analysis.replay.site_position import SitePosition  # noqa: PLC0415
    from ..companion.error_margin import flown_site  # noqa: PLC0415
    from ..planner.planner import Planner  # noqa: PLC0415
    from ..planner.site import Site  # noqa: PLC0415
    from ..settings.config import Supervision  # noqa: PLC0415

    return SitePosition(Planner(flown_site(Site.load(site_file), vehicle, Supervision()), vehicle))


def _drag_flight() -> DragFlight:
    from ..risk.drag_fit import DragFlight  # noqa: PLC0415

    return DragFlight()


def _drag_lines(path: str, flight: DragFlight) -> str:
    """Lines for the vehicle file; raises InputError where the flight yields no drag."""
    fit = flight.fit()
    if isinstance(fit, str):
        raise InputError(path, "", fit)
    return (
        f"risk:  # drag from {fit.seconds:.0f} s, speeds within {fit.span_mps:.1f} m/s, wind "
        f"{math.hypot(*fit.wind_ne_mps):.1f} m/s, residual {fit.residual_mps2:.2f} m/s2\n"
        f"  drag_per_s: {fit.drag_per_s:.3f}\n"
        f"  drag_per_m: {fit.drag_per_m:.4f}\n"
    )


def played(
    path: str,
    vehicle: Vehicle,
    site_position: SitePosition | None = None,
    drag: DragFlight | None = None,
) -> Replay:
    """A recording, replayed; raises InputError for a file that is none, or tells nothing."""
    from ..mavlink.dataflash import MAGIC as DATAFLASH  # noqa: PLC0415
    from .recording_formats import (  # noqa: PLC0415
        ULOG,
        Flight,
        dataflash_played,
        mcap_played,
        tlog_played,
        ulog_played,
    )
    from .replay_mcap import MAGIC  # noqa: PLC0415

    name = printable(os.fsencode(Path(path).name).decode(errors="replace"))
    flight = Flight(vehicle, site_position, drag)
    if begins_with(path, MAGIC):
        return mcap_played(path, flight).finish(name)
    data, whole = _content(path)
    if data.startswith(ULOG):
        return ulog_played(path, data, flight).finish(name)
    if data.startswith(DATAFLASH):
        return dataflash_played(path, data, flight).finish(name)
    return tlog_played(path, data, flight, whole=whole).finish(name)


def begins_with(path: str, magic: bytes) -> bool:
    """True if a readable file begins with these bytes; later code reports an unreadable one."""
    with contextlib.suppress(OSError, ValueError), open_file(path) as file:
        return file.read(len(magic)) == magic
    return False


def _content(path: str) -> tuple[bytes, bool]:
    """The bytes of a recording, unpacked if they are packed; False if the file is cut short.

    The first bytes decide whether it is packed, not its name.
    """
    try:
        with open_file(path) as file:
            packed = file.read(len(_GZIP)) == _GZIP
            file.seek(0)
            data, whole = _read(gzip.GzipFile(fileobj=file) if packed else file)
    except (gzip.BadGzipFile, zlib.error) as error:
        raise InputError(path, "", f"is no sound gzip file: {error}") from error
    except (OSError, ValueError) as error:
        raise InputError(path, "", unreadable(error)) from error
    if not data:
        raise InputError(path, "", "is empty, must be a recording")
    if len(data) > _MAX_BYTES:
        limit = f"{_MAX_BYTES >> 20} MiB"
        raise InputError(path, "", f"is too long, must have at most {limit}, unpacked")
    return data, whole


def _read(stream: io.BufferedReader | gzip.GzipFile) -> tuple[bytes, bool]:
    """The content of a stream, up to the limit; False where a packed one is cut short."""
    content = io.BytesIO()
    try:
        while content.tell() <= _MAX_BYTES and (piece := stream.read1(_PIECE_BYTES)):
            content.write(piece)
    except EOFError:
        return content.getvalue(), False
    return content.getvalue(), True


def _check_outputs(arguments: argparse.Namespace, vehicle_file: str) -> None:
    plot: str | None = arguments.plot
    if plot == STDOUT:
        raise refused("--plot", STDOUT, "must be a file: only --json goes to stdout")
    if arguments.fit_drag and arguments.json == STDOUT:
        raise refused("--json", STDOUT, "must be a file: stdout is for --fit-drag")
    if plot is not None and Path(plot).suffix.lower() not in {"", ".png"}:
        raise refused("--plot", plot, "must end in .png")
    inputs = {"the recording": arguments.recording, "the vehicle": vehicle_file}
    if arguments.site is not None:
        inputs["the site"] = arguments.site
    check_outputs(
        {"--json": None if arguments.json == STDOUT else arguments.json, "--plot": plot}, inputs
    )


def _json(replay: Replay) -> str:
    return replay.to_json() + "\n"

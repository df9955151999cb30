"""`moar-companion check`: checks files and aircraft, flies nothing; go or no-go.

Every finding is printed, a line each. Exit status 2: a file cannot be used; 1: no-go, or no
aircraft was checked. With `--files` only the files are checked.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import errno
import math
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

from ..errors import InputError, LinkError
from ..service.mqtt_settings import SettingNames, read_broker, read_order_key
from ..service.signing_clock import load_signing
from ..settings.config import CompanionConfig
from ..texts.text_format import printable
from .options import add_file, add_json
from .outputs import json_output, print_text, report_compiling
from .service import add_config, link_problems, merged

if TYPE_CHECKING:
    from ..companion.preflight.aircraft_check import Preflight
    from ..companion.preflight.findings import Finding
    from ..mavlink.peers import Address
    from ..mavlink.signing import Signing
    from ..planner.planner import Planner
    from ..planner.site import Site
    from ..settings.vehicle import Vehicle, VehicleFile

_PERIOD_S = 0.02
_STYLES = ("green", "cyan", "yellow", "bold red")
"""Colours by level."""
_STOP_THE_SERVICE = "stop the service: systemctl stop moar-companion, or what else uses it"
_LINK_REMEDIES = {
    errno.ENOENT: "is it plugged in? `ls /dev/tty* /dev/serial/by-id/*` shows what is",
    errno.EACCES: "allow it: sudo usermod -aG dialout $USER, then log in again",
    errno.EADDRINUSE: _STOP_THE_SERVICE,
    errno.EAGAIN: _STOP_THE_SERVICE,
    errno.EBUSY: _STOP_THE_SERVICE,
}
"""Remedies by the errno of opening a link."""
_LEVEL_WIDTH = 7
Value = TypeVar("Value")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the service's options, with the same meaning."""
    add_config(parser)
    add_file(parser, "--vehicle", "the vehicle (default: the LineDrone as flown)")
    add_file(parser, "--site", "the site (default: none)")
    parser.add_argument(
        "--connect",
        metavar="URL",
        action="append",
        default=[],
        help="look at the aircraft on this link, in place of the configuration's; may be "
        "repeated; forms as of the service",
    )
    parser.add_argument("--files", action="store_true", help="the files alone: open no link")
    add_json(parser, "write verdict and findings as JSON")


def run(arguments: argparse.Namespace) -> int:
    """Checks the files, then the aircraft; prints the findings."""
    with json_output(arguments.json) as document:
        return _run(arguments, document)


def _run(arguments: argparse.Namespace, document: dict[str, Any]) -> int:
    """Checks; fills the document. Its findings are there when a file cannot be used, too."""
    from ..companion.preflight.findings import Level, worst  # noqa: PLC0415

    report_compiling()
    errors: list[InputError] = []
    config, file, site, signing = _read(arguments, errors)
    if errors or config is None or file is None:
        _document(document, "NO-GO", _report("Files", _unusable(errors)))
        first, more = errors[0], len(errors) - 1
        print_text(f"NO-GO: {_counted(len(errors), 'finding')}\n")
        problem = first.problem + (f" (and {more} more)" if more else "")
        raise InputError(first.source, first.key, problem)
    from ..service.stored_parameters import start_settings  # noqa: PLC0415
    from .service_check import service_findings  # noqa: PLC0415

    named = arguments.vehicle is not None
    settings = start_settings(config, file, vehicle_named=named, put_aside=False)
    config, vehicle = settings.config, settings.vehicle
    found = service_findings(settings, site, ports=not arguments.files)
    _report("Files", found)
    planner = None if site is None else _planner(site, vehicle, config)
    if planner is not None:
        found += _report(f"Site {planner.site.name}", _looked_at(planner))
    seen = False
    if not arguments.files:
        aircraft, seen = _aircraft(config, vehicle, planner, signing)
        found += aircraft
    summary = _summary(found, files=arguments.files, seen=seen)
    print_text(f"{summary}\n")
    _document(document, summary, found)
    stopped = worst(found) is Level.NO_GO or not (seen or arguments.files)
    return 1 if stopped else 0


def _aircraft(
    config: CompanionConfig, vehicle: Vehicle, planner: Planner | None, signing: Signing | None
) -> tuple[list[Finding], bool]:
    """Findings about the aircraft on the links; True if there is an aircraft."""
    from rich.console import Console  # noqa: PLC0415

    from ..companion.preflight.aircraft_check import Preflight  # noqa: PLC0415

    urls = [link.url for link in config.links]
    print_text(f"Aircraft on {', '.join(urls)}\n")
    preflight = Preflight(config, vehicle, planner, signing=signing)
    try:
        with Console(stderr=True).status("listening to the aircraft, 6 to 20 s"):
            asyncio.run(_listen(preflight, urls))
    except LinkError as error:
        return _report("", [_unopened(error)]), False
    return _report("", preflight.findings()), preflight.found


def _read(
    arguments: argparse.Namespace, errors: list[InputError]
) -> tuple[CompanionConfig | None, VehicleFile | None, Site | None, Signing | None]:
    """Reads each file separately, so that all errors are reported at once."""
    if arguments.files and arguments.connect:
        raise InputError("--files", "", "opens no link, must be given without --connect")
    from ..planner.site import Site  # noqa: PLC0415
    from ..settings.vehicle import VehicleFile  # noqa: PLC0415

    config = _tried(partial(merged, arguments), errors)
    vehicle_file, site_file = arguments.vehicle, arguments.site
    signing = None
    if config is not None:
        errors += link_problems(config, arguments)
        signing = _tried(partial(load_signing, config, time.time()), errors)
        names = SettingNames(source=str(config.file), section="mqtt.")
        _tried(partial(read_broker, config.mqtt, names), errors)
        _tried(partial(read_order_key, config.mqtt, str(config.file)), errors)
        vehicle_file, site_file = config.vehicle, config.site
    file = None if vehicle_file is None else _tried(partial(VehicleFile.load, vehicle_file), errors)
    site = None if site_file is None else _tried(partial(Site.load, site_file), errors)
    return config, file, site, signing


def _tried(load: Callable[[], Value], errors: list[InputError]) -> Value | None:
    try:
        return load()
    except InputError as error:
        errors += error.parts
        return None


def _unusable(errors: Iterable[InputError]) -> list[Finding]:
    from ..companion.preflight.findings import Finding, Level  # noqa: PLC0415

    return [
        Finding(
            level=Level.NO_GO,
            subject=": ".join(filter(None, (error.source, error.key))),
            text=error.problem,
        )
        for error in errors
    ]


def _planner(site: Site, vehicle: Vehicle, config: CompanionConfig) -> Planner:
    """Planner for the site as the service flies it."""
    from ..companion.error_margin import flown_site  # noqa: PLC0415
    from ..planner.planner import Planner  # noqa: PLC0415

    return Planner(flown_site(site, vehicle, config.supervision), vehicle)


def _looked_at(planner: Planner) -> list[Finding]:
    from ..companion.preflight.site_check import site_findings  # noqa: PLC0415

    return site_findings(planner)


async def _listen(preflight: Preflight, urls: Sequence[str]) -> None:
    """Carries bytes between the machine and the links until the machine is done."""
    from ..mavlink.link import open_link  # noqa: PLC0415
    from ..mavlink.link_basics import clock_s  # noqa: PLC0415
    from ..mavlink.urls import parse_url  # noqa: PLC0415

    arrived: list[tuple[str, bytes, float, Address | None]] = []

    def receive(url: str, data: bytes, arrived_s: float, address: Address | None) -> None:
        arrived.append((url, data, arrived_s, address))

    async with contextlib.AsyncExitStack() as stack:
        links = {
            url: await stack.enter_async_context(open_link(parse_url(url), partial(receive, url)))
            for url in urls
        }
        while not preflight.done:
            for url, data, time_s, address in arrived:
                preflight.receive(url, data, time_s, address)
            arrived.clear()
            preflight.tick(clock_s())
            for url, data in preflight.data_to_send():
                links[url].send(data, math.inf, preflight.peers(url))
            await asyncio.sleep(_PERIOD_S)


def _unopened(error: LinkError) -> Finding:
    """Finding for a link that cannot be opened."""
    from ..companion.preflight.findings import Finding, Level  # noqa: PLC0415

    cause = error.__cause__
    number = cause.errno if isinstance(cause, OSError) else None
    return Finding(
        level=Level.NO_GO,
        subject="link",
        text=str(error),
        remedy=_LINK_REMEDIES.get(number or 0, "correct --connect, or the configuration's links"),
    )


def _report(heading: str, findings: list[Finding]) -> list[Finding]:
    """Prints and returns findings: in columns and colours on a terminal, else a line each."""
    from rich.console import Console  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415
    from rich.text import Text  # noqa: PLC0415

    console = Console()
    if heading:
        print_text(f"{heading}\n")
    if console.is_terminal:
        table = Table.grid(padding=(0, 2))
        for finding in findings:
            table.add_row(
                Text(f"  {finding.level!s:{_LEVEL_WIDTH}}", style=_STYLES[finding.level]),
                Text(printable(finding.subject)),
                Text(printable(finding.explanation)),
            )
        console.print(table)
    else:
        lines = (f"  {item.level!s:{_LEVEL_WIDTH}}  {item}\n" for item in findings)
        print_text("".join(lines))
    return findings


def _document(document: dict[str, Any], summary: str, findings: list[Finding]) -> None:
    """Fills the document of `--json`."""
    verdict, _, _ = summary.partition(":")
    document |= {
        "verdict": verdict,
        "summary": summary,
        "findings": [
            {
                "level": str(item.level),
                "subject": item.subject,
                "text": item.text,
                "remedy": item.remedy,
            }
            for item in findings
        ],
    }


def _summary(findings: list[Finding], *, files: bool, seen: bool) -> str:
    """The last line. files: only the files were checked. seen: an aircraft was checked."""
    from ..companion.preflight.findings import Level  # noqa: PLC0415

    levels = [finding.level for finding in findings]
    stopping, warnings = levels.count(Level.NO_GO), levels.count(Level.WARNING)
    unseen = [] if seen or files else ["no aircraft was checked"]
    if stopping or unseen:
        words = [_counted(stopping, "finding"), _counted(warnings, "warning"), *unseen]
        return f"NO-GO: {', '.join(words)}"
    words = [_counted(warnings, "warning")] if warnings else []
    if files:
        words.append("the aircraft was not checked")
    words += [finding.closing for finding in findings if finding.closing]
    return ("FILES OK" if files else "GO") + (f": {', '.join(words)}" if words else "")


def _counted(count: int, word: str) -> str:
    return f"{count} {word}{'' if count == 1 else 's'}"

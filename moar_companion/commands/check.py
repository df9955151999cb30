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
import os
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from ..config import Authority, CompanionConfig, KeySource
from ..error_margin import sight_speed_mps
from ..errors import InputError, LinkError
from ..mqtt_config import Mqtt, broker_address
from ..service.directories import Directory, recorder_folder, state_folder, view_socket
from ..service.mqtt_settings import SettingNames, read_broker, read_order_key
from ..service.perception_process import tried
from ..service.signing_clock import load_signing
from .options import add_file
from .outputs import say
from .service import INSTALLED_CONFIG, add_config, link_problems, merged

if TYPE_CHECKING:
    from ..mavlink.peers import Address
    from ..mavlink.signing import Signing
    from ..planner.planner import Planner
    from ..preflight.aircraft_check import Preflight
    from ..preflight.findings import Finding
    from ..site import Site
    from ..vehicle import Vehicle

_PERIOD_S = 0.02
_STYLES = ("green", "cyan", "yellow", "bold red")
"""Colours by level."""
_STOP_THE_SERVICE = "stop the service: systemctl stop moar-companion, or what else uses it"
_LINK_REMEDIES = {
    errno.ENOENT: "is it plugged in? `ls /dev/tty*` shows what is",
    errno.EACCES: "allow it: sudo usermod -aG dialout $USER, then log in again",
    errno.EADDRINUSE: _STOP_THE_SERVICE,
    errno.EAGAIN: _STOP_THE_SERVICE,
    errno.EBUSY: _STOP_THE_SERVICE,
}
"""Remedies by the errno of opening a link."""
_OWN_HOSTS = {"127.0.0.1", "::1", "localhost"}
_LEVEL_WIDTH = 7
_LONGEST_SOCKET_PATH = 107
"""Longest path in Linux's sun_path, in bytes."""
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


def run(arguments: argparse.Namespace) -> int:
    """Checks the files, then the aircraft; prints the findings."""
    from ..preflight.findings import Level, worst  # noqa: PLC0415

    errors: list[InputError] = []
    config, vehicle, site, signing = _read(arguments, errors)
    if errors or config is None or vehicle is None:
        _tell("Files", _unusable(errors))
        first, more = errors[0], len(errors) - 1
        say(f"NO-GO: {_counted(len(errors), 'finding')}\n")
        problem = first.problem + (f" (and {more} more)" if more else "")
        raise InputError(first.source, first.key, problem)
    found = _files(config, vehicle, site, ports=not arguments.files)
    _tell("Files", found)
    planner = None if site is None else _planner(site, vehicle, config)
    if planner is not None:
        found += _tell(f"Site {planner.site.name}", _looked_at(planner))
    seen = False
    if not arguments.files:
        aircraft, seen = _aircraft(config, vehicle, planner, signing)
        found += aircraft
    say(_summary(found, files=arguments.files, seen=seen) + "\n")
    stopped = worst(found) is Level.NO_GO or not (seen or arguments.files)
    return 1 if stopped else 0


def _aircraft(
    config: CompanionConfig, vehicle: Vehicle, planner: Planner | None, signing: Signing | None
) -> tuple[list[Finding], bool]:
    """Findings about the aircraft on the links; True if there is an aircraft."""
    from ..preflight.aircraft_check import Preflight  # noqa: PLC0415

    urls = [link.url for link in config.links]
    say(f"Aircraft on {', '.join(urls)}\n")
    preflight = Preflight(config, vehicle, planner, signing=signing)
    try:
        asyncio.run(_listen(preflight, urls))
    except LinkError as error:
        return _tell("", [_unopened(error)]), False
    return _tell("", preflight.findings()), preflight.found


def _read(
    arguments: argparse.Namespace, errors: list[InputError]
) -> tuple[CompanionConfig | None, Vehicle | None, Site | None, Signing | None]:
    """Reads each file separately, so that all errors are reported at once."""
    if arguments.files and arguments.connect:
        raise InputError("--files", "", "opens no link, must be given without --connect")
    from ..site import Site  # noqa: PLC0415
    from ..vehicle import Vehicle  # noqa: PLC0415

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
    vehicle = None if vehicle_file is None else _tried(partial(Vehicle.load, vehicle_file), errors)
    site = None if site_file is None else _tried(partial(Site.load, site_file), errors)
    return config, vehicle, site, signing


def _tried(load: Callable[[], Value], errors: list[InputError]) -> Value | None:
    try:
        return load()
    except InputError as error:
        errors += error.parts
        return None


def _unusable(errors: Iterable[InputError]) -> list[Finding]:
    from ..preflight.findings import Finding, Level  # noqa: PLC0415

    return [
        Finding(
            level=Level.NO_GO,
            subject=": ".join(filter(None, (error.source, error.key))),
            text=error.problem,
        )
        for error in errors
    ]


def _files(
    config: CompanionConfig, vehicle: Vehicle, site: Site | None, *, ports: bool
) -> list[Finding]:
    """Findings from the files about the service. ports: True tries its sensor's port, too."""
    from ..preflight.findings import Finding, Level  # noqa: PLC0415

    never = config.authority is Authority.OBSERVE
    found = [
        Finding(
            level=Level.OK,
            subject="configuration",
            text=f"none, nor {INSTALLED_CONFIG}: the defaults"
            if config.file is None
            else str(config.file),
        ),
        Finding(level=Level.OK, subject="vehicle", text=f"{vehicle.name} ({config.vehicle})"),
        Finding(
            level=Level.NOTE if never else Level.OK,
            subject="authority",
            text=config.authority.value + (": nothing is ever streamed" if never else ""),
        ),
        Finding(
            level=Level.OK,
            subject="links",
            text=", ".join(
                f"{link.url} ({link.role.value}{', signed' if link.signed else ''})"
                for link in config.links
            ),
        ),
        _folder(
            "recorder",
            recorder_folder(config),
            "none: the flight is not recorded (recorder.directory)",
        ),
        _folder(
            "state",
            state_folder(config),
            "none: no state is kept after a crash (state.directory, or systemd's)",
        ),
        _view(view_socket(config)),
        _mqtt(config.mqtt),
        _perception(config, vehicle, ports=ports),
    ]
    if config.signing != KeySource() and not any(link.signed for link in config.links):
        found.append(
            Finding(
                level=Level.WARNING,
                subject="signing",
                text="a key is named, but no link is signed",
                remedy="set signed: true on the links that are to be, or remove signing",
            )
        )
    if site is None:
        text = "none: telemetry and risk only, no mission is flown"
        found.append(Finding(level=Level.NOTE, subject="site", text=text))
    return found


def _mqtt(settings: Mqtt) -> Finding:
    """Finding on the broker that the service publishes to; the broker itself is not asked."""
    from ..preflight.findings import Finding, Level  # noqa: PLC0415

    address = None if settings.url is None else broker_address(settings.url)
    if address is None:
        text = "none: nothing is published (mqtt.url)"
        return Finding(level=Level.NOTE, subject="mqtt", text=text)
    orders = ", takes signed orders" if settings.takes_orders else ""
    if settings.username is not None and not address.tls and address.host not in _OWN_HOSTS:
        return Finding(
            level=Level.WARNING,
            subject="mqtt",
            text=f"{address} has no TLS: the network can read the password",
            remedy="use mqtts://, or a broker on this computer that is bridged with TLS",
        )
    text = f"{address} as {settings.vehicle}{orders}"
    return Finding(level=Level.OK, subject="mqtt", text=text)


def _perception(config: CompanionConfig, vehicle: Vehicle, *, ports: bool) -> Finding:
    """Finding on the sensor that looks for obstacles, and on the speed that its sight permits.

    ports: True tries the port of its packets, too.
    """
    from ..preflight.findings import Finding, Level  # noqa: PLC0415

    settings, subject = config.perception, "perception"
    if settings.sensor is None:
        text = "none: obstacles are those of the site file (perception.sensor)"
        return Finding(level=Level.NOTE, subject=subject, text=text)
    try:
        tried(settings, str(config.file), port=ports)
    except (InputError, LinkError) as error:
        text = error.problem if isinstance(error, InputError) else str(error)
        return Finding(level=Level.NO_GO, subject=subject, text=text)
    most_mps, port = sight_speed_mps(vehicle, config), settings.data_port
    place = "" if port is None else f" on {settings.address}:{port}"
    text = f"{settings.sensor.value}{place}, sight {settings.sight_m:g} m"
    if most_mps < vehicle.speed.min_mps:
        return Finding(
            level=Level.NO_GO,
            subject=subject,
            text=f"{text}: at v_MIN of {vehicle.speed.min_mps:g} m/s the aircraft stops too late",
            remedy="set perception.sight_m to what the sensor sees, or reduce the margin",
        )
    return Finding(level=Level.OK, subject=subject, text=f"{text}: at most {most_mps:.1f} m/s")


def _folder(subject: str, folder: Directory | None, without: str) -> Finding:
    """Finding on write access to a folder. without: text where no folder is configured."""
    from ..preflight.findings import Finding, Level  # noqa: PLC0415

    if folder is None:
        return Finding(level=Level.NOTE, subject=subject, text=without)
    problem = _folder_problem(folder.path)
    if problem is None:
        return Finding(level=Level.OK, subject=subject, text=str(folder.path))
    return Finding(
        level=Level.NO_GO,
        subject=subject,
        text=f"{folder.path} cannot be written: {problem}",
        remedy=f"correct {folder.name}, or the rights there: else the service does not start",
    )


def _folder_problem(path: Path) -> str | None:
    try:
        there = next(at for at in (path, *path.absolute().parents) if at.exists())
        if not there.is_dir():
            return f"{there} is not a directory"
    except OSError as error:
        return error.strerror or str(error)
    return None if os.access(there, os.W_OK | os.X_OK) else f"{there} belongs to another user"


def _view(place: Directory | None) -> Finding:
    """Finding on the socket of the view: the service must be able to create it."""
    from ..preflight.findings import Finding, Level  # noqa: PLC0415

    if place is None:
        text = "none: no live view (view.socket, or systemd's)"
        return Finding(level=Level.NOTE, subject="view", text=text)
    problem = _socket_problem(place.path)
    if problem is None:
        return Finding(level=Level.OK, subject="view", text=str(place.path))
    return Finding(
        level=Level.NO_GO,
        subject="view",
        text=f"{place.path} cannot be made: {problem}",
        remedy=f"correct {place.name}, or the rights there: else the service does not start",
    )


def _socket_problem(path: Path) -> str | None:
    folder = path.absolute().parent
    if len(os.fsencode(path)) > _LONGEST_SOCKET_PATH:
        return f"a socket's path has no more than {_LONGEST_SOCKET_PATH} bytes"
    try:
        if path.exists() and not path.is_socket():
            return "something else is there"
        writable = folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)
    except OSError as error:
        return error.strerror or str(error)
    return None if writable else f"{folder} is no folder that can be written"


def _planner(site: Site, vehicle: Vehicle, config: CompanionConfig) -> Planner:
    """Planner for the site as the service flies it."""
    from ..error_margin import flown_site  # noqa: PLC0415
    from ..planner.planner import Planner  # noqa: PLC0415

    return Planner(flown_site(site, vehicle, config.supervision), vehicle)


def _looked_at(planner: Planner) -> list[Finding]:
    from ..preflight.site_check import site_findings  # noqa: PLC0415

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
    from ..preflight.findings import Finding, Level  # noqa: PLC0415

    cause = error.__cause__
    number = cause.errno if isinstance(cause, OSError) else None
    return Finding(
        level=Level.NO_GO,
        subject="link",
        text=str(error),
        remedy=_LINK_REMEDIES.get(number or 0, "correct --connect, or the configuration's links"),
    )


def _tell(heading: str, findings: list[Finding]) -> list[Finding]:
    """Prints findings: in columns and colours on a terminal, else a line each; returns them."""
    from rich.console import Console  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415
    from rich.text import Text  # noqa: PLC0415

    console = Console()
    if heading:
        say(f"{heading}\n")
    if console.is_terminal:
        table = Table.grid(padding=(0, 2))
        for finding in findings:
            table.add_row(
                Text(f"  {finding.level!s:{_LEVEL_WIDTH}}", style=_STYLES[finding.level]),
                Text(finding.subject),
                Text(finding.explanation),
            )
        console.print(table)
    else:
        lines = (f"  {item.level!s:{_LEVEL_WIDTH}}  {item}\n" for item in findings)
        say("".join(lines))
    return findings


def _summary(findings: list[Finding], *, files: bool, seen: bool) -> str:
    """The last line. files: only the files were checked. seen: an aircraft was checked."""
    from ..preflight.findings import Level  # noqa: PLC0415

    levels = [finding.level for finding in findings]
    stopping, warnings = levels.count(Level.NO_GO), levels.count(Level.WARNING)
    unseen = [] if seen or files else ["no aircraft was looked at"]
    if stopping or unseen:
        words = [_counted(stopping, "finding"), _counted(warnings, "warning"), *unseen]
        return f"NO-GO: {', '.join(words)}"
    words = [_counted(warnings, "warning")] if warnings else []
    if files:
        words.append("the aircraft was not looked at")
    return ("FILES OK" if files else "GO") + (f": {', '.join(words)}" if words else "")


def _counted(count: int, word: str) -> str:
    return f"{count} {word}{'' if count == 1 else 's'}"

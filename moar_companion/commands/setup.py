"""`moar-companion setup`: finds the autopilot, asks what it cannot read, writes the configuration.

Nothing is written before every question is answered and the new files are read as the service
reads them. It never arms. Parameters of the autopilot are set after a yes alone, one by one, each
read back, while the autopilot reports that it is disarmed.
"""

from __future__ import annotations

import argparse
import asyncio
import os
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError, LinkError
from ..mavlink.urls import parse_url
from ..settings.config import Authority, CompanionConfig, LossCheck, shipped_configs
from ..types import AUTOPILOTS, AutopilotKind
from .options import add_file, add_json, number, numbers, refused
from .outputs import check_outputs, json_output, print_text, replace_together, write_output
from .questions import Questions
from .service import INSTALLED_CONFIG

if TYPE_CHECKING:
    from ..companion.preflight.parameter_advice import Advice
    from ..mavlink.autopilot_reader import AutopilotReader, SetResult
    from ..mavlink.autopilots.parameter_names import Parameters
    from ..mavlink.identity import Autopilot
    from ..mavlink.telemetry import Telemetry
    from ..settings.vehicle import Vehicle

_RADIUS_M = 0.38
"""Of a quadrotor of 500 mm with propellers of 10 inches (Holybro X500)."""
_AUTHORITIES = tuple(item.value for item in Authority)
_NAME = "drone"
_EDITORS_LINE = "# yaml-language-server:"
"""Begin of the shipped file's first line, which names a schema beside it."""
_FOUND_S = 10.0
"""Ten heartbeats."""
_NONE, _NEW = "none", "new"
"""Answers for no site, and for a vehicle file that is to be written."""
_UNREADABLE = ("/home", "/root", "/run/user", "/tmp", "/var/tmp")  # noqa: S108 - named, not used
"""Folders that the unit hides from the service (`ProtectHome=`, `PrivateTmp=`)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Aircraft:
    """What the autopilot on the link has reported."""

    autopilot: Autopilot
    parameters: Parameters
    telemetry: Telemetry
    types: dict[str, int]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds an option for each question."""
    parser.add_argument("--yes", action="store_true", help="ask nothing: take every default")
    parser.add_argument(
        "--out",
        metavar="DIR",
        help="folder of companion.yaml and vehicle.yaml (default: "
        f"{INSTALLED_CONFIG.parent} if it is there, else the present folder)",
    )
    link = parser.add_argument_group("the link")
    link.add_argument(
        "--connect",
        metavar="URL",
        help="link to the autopilot (default: search the serial ports at the usual rates, and the "
        "UDP ports 14540 and 14550)",
    )
    link.add_argument(
        "--offline",
        action="store_true",
        help="contact no autopilot: needs --connect and --autopilot",
    )
    link.add_argument(
        "--autopilot",
        metavar="|".join(AUTOPILOTS),
        type=_autopilot,
        help="with --offline: kind of the autopilot",
    )
    vehicle = parser.add_argument_group("the vehicle")
    add_file(
        vehicle,
        "--vehicle",
        "use this vehicle file, and write none (default: that of the configuration, unless one of "
        "the options below is given)",
    )
    vehicle.add_argument("--name", metavar="NAME", type=_name, help="of the vehicle")
    vehicle.add_argument(
        "--radius",
        metavar="M",
        type=_radius,
        help=f"of the hull, propellers included, in m (default: {_RADIUS_M:g})",
    )
    vehicle.add_argument(
        "--speeds",
        metavar="LEVEL,UP,DOWN",
        type=_speeds,
        help="cruising speeds, in m/s (default: the autopilot's)",
    )
    vehicle.add_argument(
        "--cells",
        metavar="N",
        type=_cells,
        help="of the battery, in series; 0: not known (default: the autopilot's)",
    )
    mission = parser.add_argument_group("the service")
    add_file(
        mission,
        "--site",
        f"the site; {_NONE}: telemetry and risk only (default: that of the configuration)",
    )
    mission.add_argument(
        "--authority",
        metavar="|".join(_AUTHORITIES),
        type=_authority,
        help="observe never streams; stream: when the pilot has given the mode; engage: may "
        "request modes (default: that of the configuration, else stream)",
    )
    parameters = parser.add_argument_group("the autopilot's parameters")
    parameters.add_argument(
        "--parameters",
        metavar="FILE",
        type=_parameter_file,
        help="write what should be set: .params for QGroundControl, .param for Mission Planner",
    )
    parameters.add_argument(
        "--apply",
        action="store_true",
        help="set it on the autopilot, which must be disarmed (never by --yes alone)",
    )
    add_json(parser, "write what was found and done as JSON")


def run(arguments: argparse.Namespace) -> int:
    """Sets up the companion; 0 when everything that was asked for is done."""
    with json_output(arguments.json) as document:
        return _set_up(arguments, document)


def _set_up(arguments: argparse.Namespace, document: dict[str, Any]) -> int:
    questions, folder = Questions(yes=arguments.yes), _folder(arguments)
    check_outputs({"--parameters": arguments.parameters}, {})
    config_file = folder / "companion.yaml"
    _load_named(arguments, folder)
    before = _before(config_file)
    url = _link(arguments, questions)
    aircraft = None if arguments.offline else asyncio.run(_read(url))
    kind: AutopilotKind = arguments.autopilot if aircraft is None else aircraft.autopilot.kind
    print_text(f"{_described(kind, aircraft)} on {url}\n")
    files: dict[Path, str] = {}
    vehicle_file = _vehicle(arguments, questions, folder, before, files, kind, aircraft)
    site = _site(arguments, questions, folder, before)
    present = Authority.STREAM if before is None else before.authority
    authority = questions.ask(
        "--authority",
        f"authority: {', '.join(_AUTHORITIES)}",
        arguments.authority,
        _authority,
        present,
        present.value,
    )
    from .setup_files import config_text  # noqa: PLC0415

    template = config_file if before is not None else shipped_configs() / "companion.yaml"
    text = template.read_text(encoding="utf-8")
    files[config_file] = config_text(
        text.partition("\n")[2] if text.startswith(_EDITORS_LINE) else text,
        str(template),
        before=before,
        url=url,
        vehicle=_relative(vehicle_file, folder),
        site=None if site is None else _relative(site, folder),
        authority=authority,
    )
    config, vehicle = _tried(files, config_file, vehicle_file)
    replace_together(files)
    print_text("".join(f"wrote {path}\n" for path in files))
    _check(config_file, files_only=aircraft is None)
    advice, results = _advise(
        arguments, questions, url, aircraft, vehicle, config.supervision.loss_action
    )
    print_text(f"next: moar-companion check --config {config_file}\n")
    document |= {
        "link": url,
        "autopilot": kind,
        "firmware": None if aircraft is None else str(aircraft.telemetry.firmware or "unknown"),
        "files": [str(path) for path in files],
        "parameters": [asdict(each) for each in advice],
        "set": [{"name": each.change.name, "status": each.status.value} for each in results],
    }
    return int(any(each.status.value != "set" for each in results))


# The link


def _link(arguments: argparse.Namespace, questions: Questions) -> str:
    """The URL of the link to the autopilot: as given, or as found."""
    if arguments.connect is not None:
        parse_url(arguments.connect)
        return str(arguments.connect)
    if arguments.offline:
        raise InputError("--connect", "", "is missing: --offline searches no link")
    found, silent = asyncio.run(_searched())
    if not found:
        listened = "; ".join(f"{url}: {why}" for url, why in silent.items())
        raise LinkError(
            "no autopilot was found: is it powered, is MAVLink set up on its port, are TX and RX "
            f"crossed? ({listened})"
        )
    for each in found:
        print_text(f"found {each.autopilot.kind}, system {each.autopilot.system_id}: {each.url}\n")
    urls: list[str] = [each.url for each in found]
    if len(urls) == 1:
        return urls[0]
    return questions.ask("--connect", f"which link: {', '.join(urls)}", None, _one_of(urls))


async def _searched() -> tuple[list[Any], dict[str, str]]:
    from rich.console import Console  # noqa: PLC0415

    from .link_search import UDP_LINKS, search, serial_ports, urls_of  # noqa: PLC0415

    devices = serial_ports()
    print_text(f"serial ports: {', '.join(devices) or 'none'}\n")
    ports = [*map(urls_of, devices), *([url] for url in UDP_LINKS)]
    with Console(stderr=True).status("listening for heartbeats") as status:
        return await search(ports, lambda url: status.update(f"listening on {url}"))


async def _read(url: str) -> _Aircraft:
    """Reads the autopilot on a link; LinkError without one."""
    from rich.console import Console  # noqa: PLC0415

    from .link_search import opened, until  # noqa: PLC0415

    with Console(stderr=True).status(f"listening on {url}") as status:
        async with opened([url]) as reader:

            def done() -> bool:
                status.update(f"reading parameters: {reader.read:.0%}")
                return reader.done

            await _found(reader, url)
            await until(done)
            if reader.conflict is not None:
                raise LinkError(f"{url}: {reader.conflict.reason}: connect one at a time")
            assert reader.autopilot is not None
            return _Aircraft(
                autopilot=reader.autopilot,
                parameters=reader.parameters,
                telemetry=reader.telemetry,
                types=dict(reader.types),
            )


async def _found(reader: AutopilotReader, url: str) -> None:
    """Waits for the autopilot; LinkError when none is received."""
    from .link_search import until  # noqa: PLC0415

    if not await until(lambda: reader.autopilot is not None, _FOUND_S):
        count = reader.received_bytes
        problem = f"no heartbeat of an autopilot for {_FOUND_S:g} s ({count} bytes)"
        raise LinkError(f"{url}: {problem}")


def _described(kind: AutopilotKind, aircraft: _Aircraft | None) -> str:
    from ..mavlink.autopilots import profile  # noqa: PLC0415

    if aircraft is None:
        return f"{profile(kind).name}, not contacted,"
    firmware = aircraft.telemetry.firmware or "of unknown version"
    return f"{profile(kind).name} {firmware}, system {aircraft.autopilot.system_id},"


# Vehicle and site


def _vehicle(
    arguments: argparse.Namespace,
    questions: Questions,
    folder: Path,
    before: CompanionConfig | None,
    files: dict[Path, str],
    kind: AutopilotKind,
    aircraft: _Aircraft | None,
) -> Path:
    """The vehicle file: the given or present one, or a new one of answers, added to the files.

    A file that the new one replaces is kept beside it.
    """
    from ..mavlink.autopilots.parameter_names import Parameters  # noqa: PLC0415
    from ..mavlink.telemetry import Telemetry  # noqa: PLC0415
    from .setup_files import (  # noqa: PLC0415
        CAUTIOUS_SPEEDS_MPS,
        VehicleAnswers,
        capacity_of,
        cells_of,
        speeds_of,
        vehicle_text,
    )

    if arguments.vehicle is not None:
        return Path(arguments.vehicle)
    present = _present_vehicle(arguments, before, kind)
    if present is not None:
        answer = questions.ask(
            "--vehicle",
            f"vehicle file; {_NEW}: asks for another vehicle",
            None,
            lambda text: text if text == _NEW else _vehicle_file(text, folder),
            present,
        )
        if answer != _NEW:
            return Path(answer)
    parameters = Parameters({}) if aircraft is None else aircraft.parameters
    telemetry = Telemetry() if aircraft is None else aircraft.telemetry
    name = questions.ask("--name", "name of the vehicle", arguments.name, _name, _NAME)
    radius_m = questions.ask(
        "--radius", "radius with propellers, m", arguments.radius, _radius, _RADIUS_M
    )
    reported, names = speeds_of(kind, parameters)
    default = CAUTIOUS_SPEEDS_MPS if reported is None else reported
    speeds_mps = questions.ask(
        "--speeds",
        "cruising speeds level, up, down, m/s",
        arguments.speeds,
        _speeds,
        default,
        ",".join(f"{value:g}" for value in default),
    )
    own = speeds_mps == reported
    cells = questions.ask(
        "--cells",
        "cells of the battery in series, 0: not known",
        arguments.cells,
        _cells,
        cells_of(kind, parameters, telemetry) or 0,
    )
    path = folder / "vehicle.yaml"
    if path.exists():
        files[folder / "vehicle.yaml.old"] = path.read_text(encoding="utf-8", errors="replace")
    files[path] = vehicle_text(
        VehicleAnswers(
            name=name,
            autopilot=kind,
            radius_m=radius_m,
            speeds_mps=speeds_mps,
            speeds_from=f"the autopilot's {names}" if own else "as answered",
            cells=cells or None,
            capacity_mah=capacity_of(kind, parameters),
        )
    )
    return path


def _present_vehicle(
    arguments: argparse.Namespace, before: CompanionConfig | None, kind: AutopilotKind
) -> str | None:
    """The configuration's vehicle file; None if it is of another autopilot, or others are given."""
    from ..settings.vehicle import Vehicle  # noqa: PLC0415

    new = (arguments.name, arguments.radius, arguments.speeds, arguments.cells)
    if before is None or any(each is not None for each in new):
        return None
    try:
        fits = Vehicle.load(before.vehicle).autopilot == kind
    except InputError:
        return None
    return str(before.vehicle) if fits else None


def _site(
    arguments: argparse.Namespace,
    questions: Questions,
    folder: Path,
    before: CompanionConfig | None,
) -> Path | None:
    present = None if before is None else before.site
    file = questions.ask(
        "--site",
        f"site file (moar-companion site new makes one); {_NONE}: telemetry and risk only",
        arguments.site,
        lambda text: text if text == _NONE else _site_file(text, folder),
        _NONE if present is None else str(present),
    )
    return None if file == _NONE else Path(file)


def _before(config_file: Path) -> CompanionConfig | None:
    """The configuration that is there; None without one, and for the example of the package."""
    if not config_file.exists():
        return None
    before = CompanionConfig.load(config_file)
    example = (shipped_configs() / "companion.yaml").read_bytes()
    return None if config_file.read_bytes() == example else before


def _load_named(arguments: argparse.Namespace, folder: Path) -> None:
    """Refuses files of the command line that cannot be used, before anything is searched."""
    if arguments.site not in (None, _NONE):
        _site_file(arguments.site, folder)
    if arguments.vehicle is not None:
        _vehicle_file(arguments.vehicle, folder)


def _site_file(text: str, folder: Path) -> str:
    from ..planner.site import Site  # noqa: PLC0415

    Site.load(text)
    return _for_service("--site", text, folder)


def _vehicle_file(text: str, folder: Path) -> str:
    from ..settings.vehicle import Vehicle  # noqa: PLC0415

    Vehicle.load(text)
    return _for_service("--vehicle", text, folder)


def _for_service(option: str, text: str, folder: Path) -> str:
    """A file's name; InputError for one that the installed service could not read."""
    installed, real = INSTALLED_CONFIG.parent, Path(text).resolve()
    hidden = any(real.is_relative_to(each) for each in _UNREADABLE)
    if hidden and folder.resolve().is_relative_to(installed):
        raise refused(option, text, f"where the service may not read: copy it to {installed}")
    return text


def _tried(
    files: dict[Path, str], config_file: Path, vehicle_file: Path
) -> tuple[CompanionConfig, Vehicle]:
    """The new files as the service reads them, read in another folder."""
    from ..settings.vehicle import Vehicle  # noqa: PLC0415

    with tempfile.TemporaryDirectory() as folder:
        staged = {path: Path(folder) / path.name for path in files}
        for path, text in files.items():
            staged[path].write_text(text, encoding="utf-8")
        try:
            config = CompanionConfig.load(staged[config_file])
        except InputError as error:
            raise InputError(str(config_file), error.key, error.problem) from None
        return config, Vehicle.load(staged.get(vehicle_file, vehicle_file))


def _check(config_file: Path, *, files_only: bool) -> None:
    """Runs `check` on the written files; its verdict is its own, and no failure of the setup."""
    from .check import add_arguments as add_check  # noqa: PLC0415
    from .check import run as check  # noqa: PLC0415

    parser = argparse.ArgumentParser()
    add_check(parser)
    options = ["--config", str(config_file), *(["--files"] if files_only else [])]
    check(parser.parse_args(options))


# The autopilot's parameters


def _advise(
    arguments: argparse.Namespace,
    questions: Questions,
    url: str,
    aircraft: _Aircraft | None,
    vehicle: Vehicle,
    policy: LossCheck,
) -> tuple[list[Advice], list[SetResult]]:
    """Shows what should be set, writes it into a file, and sets it after a yes."""
    if aircraft is None:
        return [], []
    from ..companion.preflight.parameter_advice import (  # noqa: PLC0415
        advices,
        mission_planner_text,
        qgroundcontrol_text,
    )
    from ..mavlink.autopilots import profile  # noqa: PLC0415

    advice = advices(
        profile(aircraft.autopilot.kind),
        aircraft.parameters,
        vehicle,
        policy,
        ground_station_received=aircraft.telemetry.ground_station is not None,
    )
    if not advice:
        print_text("the autopilot's parameters: none has to be set\n")
        return [], []
    print_text("parameters to set:\n" + "".join(f"  {each}\n" for each in advice))
    if arguments.parameters is not None:
        text = (
            mission_planner_text(advice)
            if arguments.parameters.endswith(".param")
            else qgroundcontrol_text(advice, aircraft.autopilot, aircraft.types)
        )
        failure = write_output(
            "--parameters", arguments.parameters, lambda stream: stream.write(text.encode())
        )
        if failure:
            raise OSError(failure)
        print_text(f"wrote {arguments.parameters}\n")
    question = f"set these {len(advice)} parameters on the autopilot, which must be disarmed?"
    if not questions.confirmed(question, given=arguments.apply):
        return advice, []
    return advice, asyncio.run(_applied(url, advice))


async def _applied(url: str, advice: Sequence[Advice]) -> list[SetResult]:
    """Sets parameters one by one; prints each result."""
    from ..mavlink.autopilot_reader import Change, SetStatus  # noqa: PLC0415
    from .link_search import opened, until  # noqa: PLC0415

    async with opened([url]) as reader:
        await _found(reader, url)
        await until(lambda: reader.done)  # with the types, by which integers are encoded
        for each in advice:
            reader.set([Change(name=each.name, value=each.value)])
            await until(lambda: not reader.setting)
            result = reader.results[-1]
            value = "" if result.value is None else f", now {result.value:g}"
            print_text(f"  {each.name}: {result.status.value}{value}\n")
            if result.status in {SetStatus.ARMED, SetStatus.SILENT}:
                break
        return reader.results


# Answers


def _folder(arguments: argparse.Namespace) -> Path:
    installed = INSTALLED_CONFIG.parent
    name = arguments.out or (str(installed) if installed.is_dir() else ".")
    folder = Path(name)
    if not folder.is_dir():
        raise refused("--out", name, "is no folder: make it, or name another")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise refused("--out", name, "but nothing may be written there: sudo, or another folder")
    if arguments.offline and arguments.autopilot is None:
        raise InputError("--autopilot", "", f"is missing: one of {', '.join(AUTOPILOTS)}")
    if arguments.offline and arguments.apply:
        raise InputError("--apply", "", "sets parameters, must be given without --offline")
    return folder


def _relative(path: Path, folder: Path) -> str:
    """A path as the configuration in a folder names it."""
    real, base = path.resolve(), folder.resolve()
    return str(real.relative_to(base)) if real.is_relative_to(base) else str(real)


def _one_of(words: Sequence[str]) -> Callable[[str], str]:
    def parse(text: str) -> str:
        if text not in words:
            raise refused("answer", text, f"must be one of {', '.join(words)}")
        return text

    return parse


def _autopilot(text: str) -> AutopilotKind:
    for kind in AUTOPILOTS:
        if text == kind:
            return kind
    raise refused("--autopilot", text, f"must be one of {', '.join(AUTOPILOTS)}")


def _authority(text: str) -> Authority:
    if text not in _AUTHORITIES:
        raise refused("--authority", text, f"must be one of {', '.join(_AUTHORITIES)}")
    return Authority(text)


def _name(text: str) -> str:
    if not text.strip() or len(text) > 100 or not text.isprintable():
        raise refused("--name", text, "must be 1 to 100 printable characters")
    return text


def _radius(text: str) -> float:
    value = number(text)
    if value is None or not 0.05 <= value <= 5.0:
        raise refused("--radius", text, "must be a number of metres from 0.05 to 5")
    return value


def _cells(text: str) -> int:
    if not text.isascii() or not text.isdigit() or int(text[:4]) > 50:
        raise refused("--cells", text, "must be a whole number from 0 to 50")
    return int(text)


def _speeds(text: str) -> tuple[float, float, float]:
    level_mps, up_mps, down_mps = numbers("--speeds", "LEVEL,UP,DOWN", "m/s")(text)
    if not 0.5 <= min(level_mps, up_mps, down_mps) <= max(level_mps, up_mps, down_mps) <= 30.0:
        raise refused("--speeds", text, "must be three speeds from 0.5 to 30 m/s")
    return level_mps, up_mps, down_mps


def _parameter_file(text: str) -> str:
    if not text.endswith((".params", ".param")):
        raise refused("--parameters", text, "must end in .params or .param")
    return text

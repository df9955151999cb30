"""The default command: the companion service, as configured by file and command line."""

from __future__ import annotations

import argparse
import gc
import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from ..errors import InputError
from ..mavlink.urls import LinkAddress, parse_url
from ..settings.config import CompanionConfig, default_vehicle
from ..settings.link_config import LinkConfig, LinkRole
from .options import add_file

INSTALLED_CONFIG = Path("/etc/moar-companion/companion.yaml")
"""Configuration file of the installed service."""


def add_config(parser: argparse.ArgumentParser) -> None:
    """Adds the option that names the configuration."""
    add_file(
        parser, "--config", f"the configuration (default: {INSTALLED_CONFIG}, if there is one)"
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the options, each of which overrides the configuration file."""
    add_config(parser)
    parser.add_argument(
        "--connect",
        metavar="URL",
        action="append",
        default=[],
        help="a link, in place of those of the configuration, of which it stays signed when it is; "
        "may be repeated: udp:HOST:PORT, udpout:HOST:PORT, tcp:HOST:PORT, serial:DEVICE:BAUD",
    )
    add_file(parser, "--vehicle", "the vehicle (default: the LineDrone as flown)")
    add_file(parser, "--site", "the site (default: none, telemetry and risk only)")


def run(arguments: argparse.Namespace) -> int:
    """Runs the service until it is stopped."""
    # No garbage collection until all is loaded: imported objects last as long as the process.
    gc.disable()
    config = configured(arguments)
    from ..service.app import run_service  # noqa: PLC0415

    return run_service(config, vehicle_named=arguments.vehicle is not None)


def configured(arguments: argparse.Namespace) -> CompanionConfig:
    """The configuration: command line over file over default; its link URLs are checked."""
    config = merged(arguments)
    for problem in link_problems(config, arguments):
        raise problem
    return config


def merged(arguments: argparse.Namespace) -> CompanionConfig:
    """The configuration of the service and of `check`: command line over file over default.

    The file is the one that is named, else the installed one.
    """
    file = arguments.config
    if file is None and os.path.lexists(INSTALLED_CONFIG):
        file = INSTALLED_CONFIG
    if file is None:
        config = CompanionConfig(vehicle=Path(arguments.vehicle or default_vehicle()))
    else:
        config = CompanionConfig.load(file, vehicle=arguments.vehicle)
    if arguments.site is not None:
        config = replace(config, site=Path(arguments.site))
    if arguments.connect:
        signed = {link.url for link in config.links if link.signed}
        links = (LinkConfig(url=url, signed=url in signed) for url in arguments.connect)
        config = replace(config, links=tuple(links))
    if all(link.role is LinkRole.OPERATOR for link in config.links):
        problem = "has none to an autopilot, must have one, or --connect be given"
        raise InputError(str(file), "links", problem)
    urls = [link.url for link in config.links]
    for index, url in enumerate(config.commands.links or ()):
        if url not in urls:
            problem = f"is {url!r}, must be one of the links ({', '.join(urls)})"
            raise InputError(str(file), f"commands.links[{index}]", problem)
    return config


def link_problems(config: CompanionConfig, arguments: argparse.Namespace) -> Iterator[InputError]:
    """Errors in the URLs of the links, one after the other."""
    seen: dict[LinkAddress, str] = {}
    for index, link in enumerate(config.links):
        source, key = (
            ("--connect", "") if arguments.connect else (str(config.file), f"links[{index}].url")
        )
        try:
            address = parse_url(link.url, source=source, key=key)
        except InputError as error:
            yield error
        else:
            if address in seen:
                problem = f"{link.url!r} is given twice ({seen[address]!r}), must be given once"
                yield InputError(source, key, problem)
            seen[address] = link.url

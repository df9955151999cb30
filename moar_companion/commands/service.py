"""The default command: the companion service, as configured by file and command line."""

from __future__ import annotations

import argparse
import logging
from dataclasses import replace
from pathlib import Path

from ..config import CompanionConfig, LinkConfig, shipped_configs
from ..errors import InputError
from ..mavlink.urls import parse_url
from .options import add_file, refused


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options, all of them laid over the configuration file."""
    add_file(parser, "--config", "the configuration (companion.yaml)")
    parser.add_argument(
        "--connect",
        metavar="URL",
        action="append",
        default=[],
        help="a link, in place of those of the configuration; may be repeated: udp:HOST:PORT, "
        "udpout:HOST:PORT, tcp:HOST:PORT, serial:DEVICE:BAUD",
    )
    add_file(parser, "--vehicle", "the vehicle (default: the LineDrone as flown)")
    add_file(parser, "--site", "the site (default: none, telemetry and risk only)")


def run(arguments: argparse.Namespace) -> int:
    """Run the service until it is told to end."""
    config = configured(arguments)
    from ..service.app import run_service  # noqa: PLC0415

    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(message)s")

    return run_service(config)


def configured(arguments: argparse.Namespace) -> CompanionConfig:
    """The configuration: command line over file over default."""
    if arguments.config is None:
        shipped = shipped_configs() / "vehicles" / "linedrone_flight.yaml"
        config = CompanionConfig(vehicle=Path(arguments.vehicle or shipped))
    else:
        config = CompanionConfig.load(arguments.config, vehicle=arguments.vehicle)
    if arguments.site is not None:
        config = replace(config, site=Path(arguments.site))
    urls: list[str] = arguments.connect
    for index, url in enumerate(urls):
        if not url.strip() or url in urls[:index]:
            problem = "is given twice, must be given once" if url.strip() else "must be a URL"
            raise refused("--connect", url, problem)
    if urls:
        config = replace(config, links=tuple(LinkConfig(url=url) for url in urls))
    if not config.links:
        problem = "is empty, must have at least one link, or --connect be given"
        raise InputError(str(arguments.config), "links", problem)
    for index, link in enumerate(config.links):
        source, key = ("--connect", "") if urls else (str(arguments.config), f"links[{index}].url")
        parse_url(link.url, source=source, key=key)
    return config

"""`moar-companion site actions`: the orders of a site as files for ground stations."""

from __future__ import annotations

import argparse
from functools import partial

from ..errors import InputError
from .options import refused
from .outputs import output_folder, print_text, write_output
from .site_output import finished, write_text


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the options of `actions`."""
    orders = parser.add_argument_group("actions")
    orders.add_argument(
        "--component",
        metavar="N",
        type=_component,
        default=195,
        help="the companion's component_id (default: 195)",
    )


def run(arguments: argparse.Namespace) -> int:
    """Writes the files into a folder."""
    from ..planner.site import Site  # noqa: PLC0415
    from .order_files import order_files  # noqa: PLC0415

    if arguments.out is None:
        raise InputError("--out", "", "is missing: the folder to write into")
    site = Site.load(arguments.file)
    folder = output_folder("--out", arguments.out)
    failures = []
    for name, text in order_files(site, arguments.component).items():
        path = folder / name
        verb = "replaced" if path.exists() else "wrote"
        failure = write_output("--out", str(path), partial(write_text, text))
        failures.append(failure)
        if failure is None:
            print_text(f"{verb} {path}\n")
    return finished(failures)


def _component(text: str) -> int:
    if not text.isascii() or not text.isdigit() or not 2 <= int(text[:9]) <= 255:
        raise refused("--component", text, "must be the companion's component id, 2 to 255")
    return int(text)

"""Site files as output of `moar-companion site`: their option, and the check of what is written."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import IO

from ..errors import InputError
from .options import refused, require
from .outputs import check_outputs


def out_file(arguments: argparse.Namespace) -> str:
    """The site file to write; InputError without one, or where it or the plot cannot be written."""
    if arguments.out is None:
        raise InputError("--out", "", "is missing: the site file to write")
    if arguments.plot:
        plot_format(arguments.plot)
        require("--plot", "matplotlib", "plots")
    inputs = {} if arguments.file is None else {"the input": arguments.file}
    check_outputs({"--out": arguments.out, "--plot": arguments.plot}, inputs)
    return str(arguments.out)


def plot_format(path: str) -> str:
    """Format of a picture, by the ending of its file; InputError for another one."""
    ending = Path(path).suffix.removeprefix(".").lower() or "png"
    if ending not in ("png", "svg", "pdf"):
        raise refused("--plot", path, "must end in one of .png, .svg, .pdf")
    return ending


def write_text(text: str, stream: IO[bytes]) -> None:
    """Writes a text, as the content of an output."""
    stream.write(text.encode())


def next_step(out: str) -> str:
    """A line with the command for a site file that was written."""
    return f"wrote {out}; next: moar-companion check --files --site {out}\n"


def finished(failures: list[str | None], written: str | None = None) -> int:
    """Exit status; reads a written site file as its users do, which may refuse it."""
    from ..planner.site import Site  # noqa: PLC0415

    problems = [failure for failure in failures if failure]
    if problems:
        raise OSError("; ".join(problems))
    if written is not None:
        Site.load(written)
    return 0

"""`moar-companion evaluate`: the paper's experiments, rerun, and the campaign of random flights.

The sweeps are tasks of processes on this computer, or of a Dask cluster. Their results are joined
in the order of the scenes, so that files do not depend on the distribution of the tasks. Times of
plans, which differ each time, are in a file of their own. The campaign is a program of the
checkout, which writes its own files.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import Executor
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

from ..errors import InputError
from .options import file_name, refused, require
from .outputs import output_folder, print_text, replacing
from .task_pool import run_tasks, task_pool

if TYPE_CHECKING:
    from ..analysis.evaluation.experiments import Results
    from ..analysis.evaluation.figures.drawing import Picture

_EXPERIMENTS = ("maps", "sensitivity", "adaptability", "tests", "flight")
_ALL = "all"
_CAMPAIGN = "campaign"
_OUT = "evaluation"
_MODULES = ("matplotlib", "pyarrow")
_MOST_WORKERS = 1024
_FLIGHT = "tests.flights.paper_flight"
_CAMPAIGN_PROGRAM = "tests.flights.campaign"
"""Programs of the checkout: the companion does not import its simulator."""
_SEEDS = "1:101"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the experiment, the outputs and where it is computed."""
    parser.add_argument(
        "experiment",
        metavar="|".join((*_EXPERIMENTS, _ALL, _CAMPAIGN)),
        type=_experiment,
        help="maps (the paper's Fig. 2-5), sensitivity (6, 7), adaptability (8), the 36 tests, "
        "flight (9; needs a checkout), or all; campaign: random flights with faults (needs a "
        "checkout)",
    )
    parser.add_argument(
        "--out",
        metavar="DIR",
        type=file_name("--out"),
        help=f"folder for report.html, figures and Parquet files (default: {_OUT}, or {_CAMPAIGN})",
    )
    parser.add_argument(
        "--seeds",
        metavar="A:B",
        type=seeds_text,
        help=f"seeds of the campaign, B not included (default: {_SEEDS}); those that the folder "
        "has are not flown again",
    )
    parser.add_argument(
        "--workers",
        metavar="N",
        type=workers_number,
        help="number of processes (default: one for each core)",
    )
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        type=file_name("--scheduler"),
        help="address of a Dask scheduler, whose workers compute instead",
    )


def run(arguments: argparse.Namespace) -> int:
    """Runs the experiments, writes all files, prints the overview."""
    if arguments.scheduler and arguments.workers:
        raise refused("--workers", str(arguments.workers), "must not be given with --scheduler")
    if arguments.experiment == _CAMPAIGN:
        return _fly_campaign(arguments)
    if arguments.seeds:
        raise refused("--seeds", arguments.seeds, f"must be given with {_CAMPAIGN} alone")
    for module in (*_MODULES, *(("distributed",) if arguments.scheduler else ())):
        require("evaluate", module, "evaluation")
    chosen = _EXPERIMENTS if arguments.experiment == _ALL else (arguments.experiment,)
    checkout = _checkout(_FLIGHT) if "flight" in chosen else None
    folder = output_folder("--out", arguments.out or _OUT)
    workers = arguments.workers or _cores()
    with task_pool(workers, arguments.scheduler) as pool:
        results, pictures = _evaluated(chosen, checkout, pool)
    _write(results, pictures, folder)
    return 0


def _evaluated(
    chosen: Sequence[str], checkout: Path | None, pool: Executor
) -> tuple[Results, dict[str, list[Picture]]]:
    """Computes, flies and draws the chosen experiments."""
    from ..analysis.evaluation import experiments, flight  # noqa: PLC0415

    calls = {name: experiments.sweeps(name, time.thread_time) for name in chosen}
    flights = None if checkout is None else _start_flights(checkout)
    try:
        found = run_tasks("computing", [call for part in calls.values() for call in part], pool)
        flown = None if flights is None else flight.of_flights(_flown(flights))
    finally:
        if flights is not None:
            flights.kill()
            flights.wait()
    parts = _divided(found, {name: len(part) for name, part in calls.items()})
    computed = {name: part for name, part in parts.items() if part}
    results = experiments.Results(**computed, flight=flown)
    calls = {name: experiments.drawings(name, results) for name in chosen}
    drawn = run_tasks("drawing", [call for part in calls.values() for call in part], pool)
    return results, _divided(drawn, {name: len(part) for name, part in calls.items()})


def _divided(items: Sequence[Any], counts: dict[str, int]) -> dict[str, list[Any]]:
    """Items in parts of these lengths, by name."""
    parts, begin = {}, 0
    for name, count in counts.items():
        parts[name] = list(items[begin : begin + count])
        begin += count
    return parts


def _write(results: Results, pictures: dict[str, list[Picture]], folder: Path) -> None:
    from ..analysis.evaluation import experiments  # noqa: PLC0415

    files = {"report.html": experiments.report(results, pictures).encode()}
    for each in (picture for part in pictures.values() for picture in part):
        files |= {f"{each.name}.png": each.png, f"{each.name}.svg": each.svg}
    for name, content in files.items():
        with replacing(str(folder / name)) as stream:
            stream.write(content)
    for name, columns in experiments.columns(results).items():
        with replacing(str(folder / f"{name}.parquet")) as stream:
            _write_parquet(columns, stream)
    print_text(f"{experiments.summary(results)}report: {folder / 'report.html'}\n")


def _write_parquet(columns: dict[str, Any], stream: IO[bytes]) -> None:
    import pyarrow as pa  # noqa: PLC0415
    from pyarrow import parquet  # noqa: PLC0415

    parquet.write_table(pa.table(columns), stream, compression="zstd")


def _fly_campaign(arguments: argparse.Namespace) -> int:
    """Flies random flights; returns the exit status of their program: 1 for a broken promise."""
    modules = (("shapely", "dev"), *((module, "evaluation") for module in _MODULES))
    for module, extra in (
        *modules,
        *((("distributed", "evaluation"),) if arguments.scheduler else ()),
    ):
        require("evaluate", module, extra)
    checkout = _checkout(_CAMPAIGN_PROGRAM)
    folder = output_folder("--out", arguments.out or _CAMPAIGN)
    where = (
        ("--scheduler", arguments.scheduler)
        if arguments.scheduler
        else ("--workers", str(arguments.workers or _cores()))
    )
    seeds = arguments.seeds or _SEEDS
    words = ("--seeds", seeds, "--out", str(folder.resolve()), *where)
    return subprocess.run(  # noqa: S603 - ourselves
        [sys.executable, "-m", _CAMPAIGN_PROGRAM, *words], cwd=checkout, check=False
    ).returncode


def _cores() -> int:
    return len(os.sched_getaffinity(0))


def _checkout(program: str) -> Path:
    """The root of the checkout that this program runs from; InputError without one.

    program: a module or package of the checkout.
    """
    root = Path(__file__).resolve().parents[2]
    path = root.joinpath(*program.split("."))
    if not path.is_dir() and not path.with_suffix(".py").exists():
        raise InputError(
            "evaluate",
            "",
            "flight, all and campaign need a checkout, whose simulator flies",
        )
    return root


def _start_flights(checkout: Path) -> subprocess.Popen[bytes]:
    from ..analysis.evaluation.scenes import FLIGHT_SITE, FLIGHT_VEHICLE  # noqa: PLC0415

    return subprocess.Popen(  # noqa: S603 - ourselves
        [sys.executable, "-m", _FLIGHT, str(FLIGHT_SITE), str(FLIGHT_VEHICLE)],
        cwd=checkout,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def _flown(flights: subprocess.Popen[bytes]) -> dict[str, Any]:
    """Document of the flights; OSError with the last line of their output after a failure."""
    content, errors = flights.communicate()
    if flights.returncode != 0:
        last = errors.decode(errors="replace").strip().splitlines()[-1:]
        raise OSError(f"the flight failed: {''.join(last)}")
    document: dict[str, Any] = json.loads(content)
    return document


def _experiment(text: str) -> str:
    known = (*_EXPERIMENTS, _ALL, _CAMPAIGN)
    if text not in known:
        raise refused("experiment", text, f"must be one of {', '.join(known)}")
    return text


def seeds_text(text: str) -> str:
    """The text of `--seeds`, A:B; InputError where it names no seeds."""
    first, _, end = text.partition(":")
    numbers = [part for part in (first, end) if part.isascii() and part.isdigit()]
    if len(numbers) != 2 or not int(first) < int(end):
        raise refused("--seeds", text, "must be A:B, whole numbers, A below B")
    return text


def workers_number(text: str) -> int:
    """The number of `--workers`; InputError outside its bounds."""
    if not (text.isascii() and text.isdigit() and 1 <= int(text) <= _MOST_WORKERS):
        raise refused("--workers", text, f"must be a whole number from 1 to {_MOST_WORKERS}")
    return int(text)

"""Many flights, each from a seed: flown by processes or a Dask cluster, kept row by row.

DIR/flights.jsonl has a line for each flight, in the order of their ends: a run that is killed loses
the flights under way alone, and the next one with the same DIR flies what is missing, and anew what
has ended in an error: the later line of a seed counts.
DIR/flights.parquet has the same rows in the order of the seeds, from the end of a run on.
"""

from __future__ import annotations

import argparse
import fcntl
import functools
import hashlib
import json
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from pathlib import Path
from typing import IO, Any

from moar_companion.commands.evaluate import seeds_text, workers_number
from moar_companion.commands.outputs import replacing
from moar_companion.commands.task_pool import task_pool
from moar_companion.errors import InputError

ROOT = Path(__file__).parents[3]
CODE = ("moar_companion", "sitl", "configs", "tests/flights")
"""Folders whose programs and settings a flight depends on."""
ROWS = "flights.jsonl"
TABLE = "flights.parquet"
_FLIGHTS_OF_A_PROCESS = 100
"""A process is replaced after so many: caches of sites and kernels grow."""
Row = dict[str, Any]
Files = dict[str, bytes]
"""Content of files by their names."""
Fly = Callable[[int], tuple[Row, Files]]


@functools.cache
def code() -> str:
    """Name of the state of the code that flies here."""
    digest = hashlib.sha256()
    for folder in CODE:
        for path in sorted((ROOT / folder).rglob("*")):
            if path.suffix in {".py", ".yaml"}:
                digest.update(f"{path.relative_to(ROOT)}\n".encode() + path.read_bytes())
    return digest.hexdigest()[:12]


def seeds_of(text: str) -> range:
    """`A:B`, B not included, or one seed; InputError for another text."""
    if text.isascii() and text.isdigit():
        return range(int(text), int(text) + 1)
    first, _, end = seeds_text(text).partition(":")
    return range(int(first), int(end))


def add_arguments(parser: argparse.ArgumentParser, out: str) -> None:
    """Adds the seeds, the outputs and the processes that fly. out: default folder.

    Parsing raises InputError for a value that is out of bounds.
    """
    parser.add_argument("--seeds", type=seeds_of, required=True, metavar="A:B")
    parser.add_argument("--out", type=Path, default=Path(out), metavar="DIR")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--workers", type=workers_number, default=1, metavar="N", help="processes")
    where.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="of a Dask scheduler, whose workers fly instead; both run in a checkout like this "
        "one, with PYTHONPATH=.",
    )


def timed_row(fly: Fly, seed: int) -> tuple[Row, Files]:
    """A seed's row with its processor seconds and the state of the code, and its files."""
    began_s, files = time.process_time(), {}
    try:
        row, files = fly(seed)
    except Exception as error:  # noqa: BLE001 - a flight that cannot be flown is a row, too
        row = {"seed": seed, "verdict": "error", "error": f"{type(error).__name__}: {error}"}
    spent_s = round(time.process_time() - began_s, 2)
    return {**row, "code": code(), "cpu_s": spent_s}, files


def fly_all(
    fly: Fly, seeds: Sequence[int], out: Path, *, workers: int = 1, scheduler: str | None = None
) -> list[Row]:
    """Flies the seeds that the folder lacks; returns all of its rows, in the order of the seeds.

    fly: a function of a module. Raises InputError where the folder or a worker has other code, the
    folder is in use by another run, or the scheduler does not answer.
    """
    code()  # that of the start: files may change while it flies
    out.mkdir(parents=True, exist_ok=True)
    with (out / ROWS).open("a+b") as journal:
        try:
            fcntl.flock(journal, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            raise InputError("--out", "", f"is {str(out)!r}, another run writes there") from None
        kept = {row["seed"]: row for row in _kept(journal, out)}
        again = {seed for seed in seeds if kept.get(seed, {}).get("verdict") == "error"}
        rows = {seed: row for seed, row in kept.items() if seed not in again}
        missing = [seed for seed in seeds if seed not in rows]
        for row, files in _flown(fly, missing, workers, scheduler):
            for name, content in files.items():
                (out / name).write_bytes(content)
            journal.write(json.dumps(row).encode() + b"\n")
            journal.flush()
            rows[row["seed"]] = row
            count = f"{len(rows)} of {len(set(seeds) | rows.keys())}"
            sys.stderr.write(f"{row['seed']} {row['verdict']} {row['cpu_s']:.1f} s ({count})\n")
    return [rows[seed] for seed in sorted(rows)]


def _kept(journal: IO[bytes], out: Path) -> Iterator[Row]:
    """The rows of earlier runs; a last one that is cut is removed."""
    journal.seek(0)
    whole = 0
    for line in journal:
        if not line.endswith(b"\n"):
            break
        row = json.loads(line)
        if row["code"] != code():
            allowed = "has flights of another state of the code, must be a new folder"
            raise InputError("--out", "", f"is {str(out)!r}, {allowed}")
        whole += len(line)
        yield row
    journal.truncate(whole)


def _flown(
    fly: Fly, seeds: Sequence[int], workers: int, scheduler: str | None
) -> Iterator[tuple[Row, Files]]:
    """Rows and files in the order of the flights' ends."""
    part = len(seeds) if scheduler is not None else workers * _FLIGHTS_OF_A_PROCESS
    for begin in range(0, len(seeds), max(part, 1)):
        with task_pool(workers, scheduler) as pool:
            flights = [pool.submit(timed_row, fly, seed) for seed in seeds[begin : begin + part]]
            for future in as_completed(flights):
                try:
                    flight = future.result()
                except Exception as error:  # noqa: BLE001 - not the flight's: that is a row
                    reason = f"{type(error).__name__}: {error}".splitlines()[0]
                    raise _failed(workers, scheduler, f"a process ended: {reason}") from None
                if flight[0]["code"] != code():
                    raise _failed(workers, scheduler, "one has another state of the code")
                yield flight


def _failed(workers: int, scheduler: str | None, reason: str) -> InputError:
    """The error of the processes or the cluster that should fly."""
    if scheduler is None:
        return InputError("--workers", "", f"is {workers}, and {reason}")
    needed = "its scheduler and workers must run in a checkout like this one, with PYTHONPATH=."
    return InputError("--scheduler", "", f"is {scheduler!r}, {needed}: {reason}")


def write_table(rows: Sequence[Row], out: Path, schema: Any = None) -> None:
    """Writes the rows as Parquet. schema: of pyarrow; None: as the rows are."""
    import pyarrow as pa
    from pyarrow import parquet

    names = dict.fromkeys(name for row in rows for name in row)  # a failed flight has few of them
    table = pa.Table.from_pylist([{**names, **row} for row in rows], schema)
    with replacing(os.fspath(out / TABLE)) as stream:
        parquet.write_table(table, stream, compression="zstd")

"""The command: flies seeds, writes a row for each, and prints the broken promises.

    python -m tests.flights.campaign --seeds A:B [--workers N] [--out DIR] [--trace]

Rows: DIR/flights.jsonl, in the order of the seeds. Exit status 1 when a flight broke the promise.
"""

from __future__ import annotations

import argparse
import csv
import json
import multiprocessing
import sys
import time
from pathlib import Path

from .flying import Record, fly
from .judge import judge
from .report import summary

TRACED = (
    "time_s", "mode", "state", "x_m", "y_m", "z_m", "error_x_m", "error_y_m", "error_z_m",
    "reported_accuracy_m", "wind_x_mps", "wind_y_mps", "wind_z_mps", "setpoint_x_m", "setpoint_y_m",
    "setpoint_z_m", "setpoint_moves",
)  # fmt: skip


def row_of(seed: int) -> dict:
    """The row of a seed: the same each time."""
    return _row(fly(seed))


def _row(record: Record) -> dict:
    drawn = record.draw
    return {
        "seed": drawn.seed,
        "site": drawn.site.name,
        "vehicle": drawn.vehicle,
        "manner": drawn.manner.value,
        "authority": drawn.authority.value,
        "wind_mps": round(drawn.wind_mps, 2),
        "faults": record.notes,
        **judge(record).row,
        "states": list(dict.fromkeys(record.states)),
    }


def _timed(seed: int) -> tuple[int, dict, float]:
    return timed_row(row_of, seed)


def trace(seed: int, directory: Path) -> None:
    """State at each step of one flight (.csv); its row and the texts to operators (.txt)."""
    record = fly(seed)
    sent = {round(item.time_s, 3): item for item in record.sent}
    with (directory / f"trace-{seed}.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(TRACED)
        for index, time_s in enumerate(record.time_s):
            item = sent.get(round(float(time_s), 3))
            numbers = [
                *record.true_m[index],
                *record.error_m[index],
                record.reported_m[index],
                *record.wind_mps[index],
                *(() if item is None else (*item.reported_m, float(item.moves))),
            ]
            words = [f"{time_s:.2f}", record.modes[index], record.states[index]]
            writer.writerow([*words, *(f"{number:.3f}" for number in numbers)])
    (directory / f"trace-{seed}.txt").write_text(
        "\n".join([json.dumps(_row(record), indent=1), *record.texts]) + "\n"
    )


def seeds_of(text: str) -> range:
    """`A:B`, B not included, or one seed."""
    first, _, end = text.partition(":")
    try:
        return range(int(first), int(end) if end else int(first) + 1)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: must be A:B or A, whole numbers") from None


def fly_all(timed, seeds: range, workers: int, out: Path) -> tuple[list[dict], list[float]]:
    """Rows and processor seconds of all seeds; the rows are also written, in order.

    timed: a function of a module, of a seed to that seed, its row and its seconds.
    """
    rows, seconds = [], []
    context = multiprocessing.get_context("spawn")
    with (
        context.Pool(workers, maxtasksperchild=25) as pool,
        (out / "flights.jsonl").open("w") as file,
    ):
        for seed, row, spent_s in pool.imap(timed, seeds):
            rows.append(row)
            seconds.append(spent_s)
            file.write(json.dumps(row) + "\n")
            file.flush()
            sys.stderr.write(f"{seed} {row['verdict']} {spent_s:.1f} s\n")
    return rows, seconds


def timed_row(row_of, seed: int) -> tuple[int, dict, float]:
    """A seed, its row and its processor seconds."""
    began_s = time.process_time()
    try:
        row = row_of(seed)
    except Exception as error:  # noqa: BLE001 - a flight that cannot be flown is a row, too
        row = {"seed": seed, "verdict": "error", "error": f"{type(error).__name__}: {error}"}
    return seed, row, time.process_time() - began_s


def main(arguments: list[str] | None = None) -> int:
    """Exit status 0 when the promise was kept, 1 when it was broken."""
    parser = argparse.ArgumentParser(prog="python -m tests.flights.campaign", description=__doc__)
    parser.add_argument("--seeds", type=seeds_of, required=True, metavar="A:B")
    parser.add_argument("--workers", type=int, default=1, metavar="N")
    parser.add_argument("--out", type=Path, default=Path("campaign"), metavar="DIR")
    parser.add_argument("--trace", action="store_true", help="a trace of each flight, too")
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    if options.trace:
        for seed in options.seeds:
            trace(seed, options.out)
    rows, seconds = fly_all(_timed, options.seeds, options.workers, options.out)
    text = summary(rows, seconds)
    (options.out / "summary.md").write_text(text)
    sys.stdout.write(text)
    return int(any(row["verdict"] in {"broken", "error"} for row in rows))

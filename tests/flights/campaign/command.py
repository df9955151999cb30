"""The command: flies seeds, writes a row for each, and a report.

    python -m tests.flights.campaign --seeds A:B [--workers N | --scheduler ADDRESS] [--out DIR]

DIR: flights.jsonl and flights.parquet (a row for each flight), report.html, summary.md, and
broken-SEED.png for each flight that broke the promise. A second call with the same DIR flies only
the seeds that DIR lacks, and reports all. Exit status 1 when a flight broke the promise.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
from pathlib import Path

from moar_companion.errors import InputError

from .batch import Files, Row, add_arguments, fly_all, write_table
from .flying import Record, fly
from .judge import Judgement, judge
from .picture import flight_png
from .report import report, summary
from .rows import schema, table_row

TRACED = (
    "time_s", "mode", "state", "x_m", "y_m", "z_m", "error_x_m", "error_y_m", "error_z_m",
    "reported_accuracy_m", "wind_x_mps", "wind_y_mps", "wind_z_mps", "setpoint_x_m", "setpoint_y_m",
    "setpoint_z_m", "setpoint_moves",
)  # fmt: skip


def row_of(seed: int) -> Row:
    """The row of a seed: the same each time."""
    record = fly(seed)
    return _row(record, judge(record))


def flown(seed: int) -> tuple[Row, Files]:
    """The row of a seed, and the picture of a flight that broke the promise."""
    record = fly(seed)
    judgement = judge(record)
    broken = judgement.verdict == "broken"
    files = {f"broken-{seed}.png": flight_png(record, judgement)} if broken else {}
    return _row(record, judgement), files


def _row(record: Record, judgement: Judgement) -> Row:
    drawn = record.draw
    return {
        "seed": drawn.seed,
        "site": drawn.site.name,
        "vehicle": drawn.vehicle,
        "manner": drawn.manner.value,
        "firmware": drawn.firmware,
        "authority": drawn.authority.value,
        "lidar": drawn.lidar,
        "signed": drawn.signed,
        "whole": drawn.whole,
        "wind_mps": round(drawn.wind_mps, 2),
        "faults": record.notes,
        "reached": not record.why,
        "why": record.why,
        **judgement.row,
        "states": list(dict.fromkeys(record.states)),
    }


def trace(seed: int, directory: Path) -> None:
    """State at each step of one flight (.csv, .png); its row and the texts to operators (.txt)."""
    record = fly(seed)
    judgement = judge(record)
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
    (directory / f"trace-{seed}.png").write_bytes(flight_png(record, judgement))
    (directory / f"trace-{seed}.txt").write_text(
        "\n".join([json.dumps(_row(record, judgement), indent=1), *record.texts]) + "\n"
    )


def main(arguments: list[str] | None = None) -> int:
    """Exit status 0 when the promise was kept, 1 when it was broken, 2 for wrong arguments."""
    parser = argparse.ArgumentParser(prog="python -m tests.flights.campaign", description=__doc__)
    add_arguments(parser, "campaign")
    parser.add_argument("--trace", action="store_true", help="trace each flight; no rows")
    try:
        options = parser.parse_args(arguments)
        out = options.out
        if options.trace:
            out.mkdir(parents=True, exist_ok=True)
            for seed in options.seeds:
                trace(seed, out)
            return 0
        rows = fly_all(
            flown, options.seeds, out, workers=options.workers, scheduler=options.scheduler
        )
    except InputError as error:
        sys.stderr.write(f"{parser.prog}: {error}\n")
        return 2
    write_table([table_row(row) for row in rows], out, schema())
    (out / "report.html").write_text(report(rows, out))
    text = summary(rows)
    (out / "summary.md").write_text(text)
    sys.stdout.write(text)
    return int(any(row["verdict"] in {"broken", "error"} for row in rows))

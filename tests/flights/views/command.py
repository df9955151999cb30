"""The command: flies seeds, writes a row for each, and prints the broken promises.

    python -m tests.flights.views --seeds A:B [--workers N | --scheduler ADDRESS] [--out DIR]

Rows: DIR/flights.jsonl and DIR/flights.parquet. A second call with the same DIR flies only the
seeds that DIR lacks. Exit status 1 after a broken promise.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from moar_companion.errors import InputError

from ..campaign.batch import Files, Row, add_arguments, fly_all, write_table
from .flying import FAULTS, fly


def row_of(seed: int) -> Row:
    """The row of a seed: the same each time."""
    result = fly(seed)
    drawn = result.draw
    return {
        "seed": seed,
        "verdict": "broken" if result.faults else "kept",
        "faults": list(result.faults),
        "manner": drawn.manner.value,
        "fault": drawn.fault,
        "wind_mps": round(drawn.wind_mps, 1),
        "gust_mps": round(drawn.gust_mps, 2),
        "wanted": result.wanted,
        "counted": result.counted,
        "taken": result.taken,
        "failed": result.failed,
        "flown_s": result.flown_s,
        "offs": [[round(float(value), 4) for value in off] for off in result.offs],
    }


def flown(seed: int) -> tuple[Row, Files]:
    """The row of a seed; no files."""
    return row_of(seed), {}


def summary(rows: list[Row]) -> str:
    """Verdicts, pictures and their errors, and each fault's pictures, in Markdown."""
    judged = [row for row in rows if row["verdict"] != "error"]
    broken = [row for row in judged if row["verdict"] == "broken"]
    lines = ["# Flights that capture views", ""]
    lines.append(f"{len(rows)} flights: {len(broken)} broken, {len(rows) - len(judged)} errors.")
    offs = np.array([off for row in judged for off in row["offs"]]).reshape(-1, 4)
    if len(offs):
        right, down, blur, marked = np.abs(offs).T
        lines.append(
            f"{len(offs)} pictures count, {int(marked.sum())} of them marked. Aim off the middle:"
            f" median {np.median(np.maximum(right, down)):.3f}, greatest"
            f" {np.maximum(right, down).max():.3f} of width or height; blur: greatest"
            f" {blur.max():.2f} pixels."
        )
    lines += ["", "| fault | flights | wanted | counted | taken | failed views |"]
    lines.append("|---|---|---|---|---|---|")
    for fault in FAULTS:
        of = [row for row in judged if row["fault"] == fault]
        sums = (sum(row[name] for row in of) for name in ("wanted", "counted", "taken", "failed"))
        lines.append(f"| {fault} | {len(of)} | {' | '.join(map(str, sums))} |")
    lines.append("")
    lines += [f"- seed {row['seed']}: {row['error']}" for row in rows if row["verdict"] == "error"]
    lines += [
        f"- seed {row['seed']} ({row['manner']}, {row['fault']}): {'; '.join(row['faults'])}"
        for row in broken
    ]
    return "\n".join(lines) + "\n"


def main(arguments: list[str] | None = None) -> int:
    """Exit status 0 without a broken promise, 1 after one or an error."""
    parser = argparse.ArgumentParser(prog="python -m tests.flights.views", description=__doc__)
    add_arguments(parser, "views")
    try:
        options = parser.parse_args(arguments)
        out = options.out
        rows = fly_all(
            flown, options.seeds, out, workers=options.workers, scheduler=options.scheduler
        )
    except InputError as error:
        sys.stderr.write(f"{parser.prog}: {error}\n")
        return 2
    write_table(rows, out)
    text = summary(rows)
    (out / "summary.md").write_text(text)
    sys.stdout.write(text)
    return int(any(row["verdict"] != "kept" for row in rows))

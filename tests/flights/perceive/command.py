"""The command: flies seeds, writes a row for each, and prints the collisions.

    python -m tests.flights.perceive --seeds A:B [--workers N | --scheduler ADDRESS] [--out DIR]

Rows: DIR/flights.jsonl and DIR/flights.parquet. A second call with the same DIR flies only the
seeds that DIR lacks. Exit status 1 after a collision.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from moar_companion.errors import InputError

from ..campaign.batch import Files, Row, add_arguments, fly_all, write_table
from .flying import fly

FALSE_M = 2.5
"""A reported conductor farther from all true ones is a false one: the position's error is less."""


def row_of(seed: int) -> Row:
    """The row of a seed: the same each time."""
    flight = fly(seed)
    drawn = flight.draw
    return {
        "seed": seed,
        "verdict": "kept" if flight.least_clearance_m > 0.0 else "collision",
        "manner": drawn.manner.value,
        "reached": not flight.why,
        "why": flight.why,
        "least_clearance_m": round(flight.least_clearance_m, 2),
        "flown_s": flight.flown_s,
        "wires": len(drawn.scene.scene.wires),
        "added": drawn.added,
        "trees": len(drawn.scene.scene.trees),
        "wind_mps": round(drawn.wind_mps, 1),
        "gust_mps": round(drawn.gust_mps, 2),
        "position_noise": round(drawn.position_noise, 2),
        "rain": drawn.scene.scene.rain_per_m > 0.0,
        "sights": [
            [round(each.diameter_m, 4), round(each.from_m, 1), round(each.off_m, 2)]
            for each in flight.sights
        ],
    }


def flown(seed: int) -> tuple[Row, Files]:
    """The row of a seed; no files."""
    return row_of(seed), {}


def summary(rows: list[Row]) -> str:
    """Collisions, clearances, targets, and first sights by diameter, in Markdown."""
    flown = [row for row in rows if row["verdict"] != "error"]
    clear_m = [row["least_clearance_m"] for row in flown]
    collisions = sum(row["verdict"] == "collision" for row in rows)
    reached = sum(row["reached"] for row in flown)
    spent_s = np.mean([row["cpu_s"] for row in rows])
    summary_line = (
        f"{len(rows)} flights: {collisions} collisions, {len(rows) - len(flown)} errors;"
        f" {reached} reached the target. Processor time {spent_s:.1f} s a flight."
    )
    lines = ["# Flights by sight", "", summary_line, ""]
    if flown:
        least = min(flown, key=lambda row: row["least_clearance_m"])
        summary_line = (
            f"Least clearance of a hull: {least['least_clearance_m']} m (seed {least['seed']}); of"
            f" all median {np.median(clear_m):.2f} m, 5 % {np.percentile(clear_m, 5):.2f} m."
        )
        lines += [summary_line, "", *_sights(flown)]
    lines += [f"- seed {row['seed']}: {row['error']}" for row in rows if row["verdict"] == "error"]
    lines += [
        f"- seed {row['seed']} ({row['manner']}, added {row['added']}): {row['verdict']},"
        f" {row['least_clearance_m']} m; {row['why'] or 'reached'}"
        for row in flown
        if row["verdict"] == "collision" or row["why"]
    ]
    return "\n".join(lines) + "\n"


def _sights(flown: list[Row]) -> list[str]:
    sights = np.array([sight for row in flown for sight in row["sights"]]).reshape(-1, 3)
    false = sights[:, 2] > FALSE_M
    lines = [
        f"Conductors that were reported: {len(sights)}, of which false {false.sum()}.",
        "",
        "| diameter, mm | conductors | first seen from, median m | least m | off by, median m |",
        "|---|---|---|---|---|",
    ]
    for low, high in ((15, 20), (20, 25), (25, 30), (30, 35), (35, 41)):
        of = sights[~false & (sights[:, 0] >= low / 1e3) & (sights[:, 0] < high / 1e3)]
        if len(of):
            figures = (
                f"{np.median(of[:, 1]):.1f} | {of[:, 1].min():.1f} | {np.median(of[:, 2]):.2f}"
            )
            lines.append(f"| {low} to {high} | {len(of)} | {figures} |")
    return [*lines, ""]


def main(arguments: list[str] | None = None) -> int:
    """Exit status 0 without a collision, 1 after a collision or an error."""
    parser = argparse.ArgumentParser(prog="python -m tests.flights.perceive", description=__doc__)
    add_arguments(parser, "perceive")
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

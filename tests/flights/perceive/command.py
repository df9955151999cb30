"""The command: flies seeds, writes a row for each, and prints the collisions.

    python -m tests.flights.perceive --seeds A:B [--workers N] [--out DIR]

Rows: DIR/flights.jsonl, in the order of the seeds. Exit status 1 after a collision.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

from ..campaign.command import fly_all, seeds_of, timed_row
from .flying import fly

FALSE_M = 2.5
"""A reported conductor farther from all true ones is a false one: the position's error is less."""


def row_of(seed: int) -> dict:
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


def timed(seed: int) -> tuple[int, dict, float]:
    """A seed, its row and its processor seconds."""
    return timed_row(row_of, seed)


def summary(rows: list[dict], seconds: list[float]) -> str:
    """Collisions, clearances, targets, and first sights by diameter, in Markdown."""
    flown = [row for row in rows if row["verdict"] != "error"]
    clear_m = [row["least_clearance_m"] for row in flown]
    collisions = sum(row["verdict"] == "collision" for row in rows)
    reached = sum(row["reached"] for row in flown)
    summary_line = (
        f"{len(rows)} flights: {collisions} collisions, {len(rows) - len(flown)} errors;"
        f" {reached} reached the target. Processor time {np.mean(seconds):.1f} s a flight."
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


def _sights(flown: list[dict]) -> list[str]:
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
    parser.add_argument("--seeds", type=seeds_of, required=True, metavar="A:B")
    parser.add_argument("--workers", type=int, default=1, metavar="N")
    parser.add_argument("--out", type=Path, default=Path("perceive"), metavar="DIR")
    options = parser.parse_args(arguments)
    options.out.mkdir(parents=True, exist_ok=True)
    rows, seconds = fly_all(timed, options.seeds, options.workers, options.out)
    text = summary(rows, seconds)
    (options.out / "summary.md").write_text(text)
    sys.stdout.write(text)
    return int(any(row["verdict"] != "kept" for row in rows))

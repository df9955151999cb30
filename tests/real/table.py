"""Fly scenarios and write the table of real against fake.

    python -m tests.real.table OUT --on fake-px4,real-px4 --scenario nominal,exit

OUT is a folder: a folder for each flight, rows.jsonl, table.md. Flights that are in rows.jsonl
already are flown again, and their rows are replaced. `--page FILE` puts the table in the place of
that of a Markdown page; with `--scenario ''` without a flight.
"""

from __future__ import annotations

import argparse
import fcntl
import json
import shutil
import sys
from dataclasses import asdict
from pathlib import Path

from .figures import Row, flown, table
from .kinds import KINDS
from .scenarios import SCENARIOS


def main():
    """Exit status 0 when no flown flight has a fault."""
    parser = argparse.ArgumentParser(prog="table")
    parser.add_argument("out", type=Path)
    parser.add_argument("--on", default=",".join(KINDS))
    parser.add_argument("--scenario", default=",".join(SCENARIOS))
    parser.add_argument("--speed", type=float)
    parser.add_argument("--page", type=Path)
    arguments = parser.parse_args()
    faults = 0
    for scenario in filter(None, arguments.scenario.split(",")):
        for name in arguments.on.split(","):
            kind = KINDS[name]
            if kind.missing:
                sys.stdout.write(f"{name}: {kind.missing}\n")
                continue
            folder = arguments.out.resolve() / name / scenario
            shutil.rmtree(folder, ignore_errors=True)
            row = flown(kind, SCENARIOS[scenario], folder, speed=arguments.speed)
            result = row.unable or "; ".join(row.faults) or "nothing against it"
            for reason in row.spoilt_before:
                result += f"; an earlier flight was spoilt: {reason}"
            if row.spoilt:
                result += f"; spoilt by {row.spoilt}"
            sys.stdout.write(f"{name} {scenario}: {result}\n")
            sys.stdout.flush()
            faults += bool(row.faults) and not row.unable
            keep(arguments.out, row)
    if arguments.page is not None:
        text = arguments.page.read_text()
        arguments.page.write_text(replaced(text, (arguments.out / "table.md").read_text()))
    return 1 if faults else 0


def replaced(page, new):
    """A page with another table of rows: in the place of the one with the same first columns."""
    begin = new[: new.index("|", new.index("|", 1) + 1) + 1]
    lines = page.splitlines(keepends=True)
    first = next(number for number, line in enumerate(lines) if line.startswith(begin))
    last = first
    while last < len(lines) and lines[last].startswith("|"):
        last += 1
    return "".join([*lines[:first], new, *lines[last:]])


def keep(out, row):
    """Write a row into the file of rows, and all rows into the table; two programs may do so."""
    out.mkdir(parents=True, exist_ok=True)
    with (out / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        _keep(out, row)


def _keep(out, row):
    file = out / "rows.jsonl"
    rows = {}
    if file.exists():
        for line in file.read_text().splitlines():
            other = Row(**json.loads(line))
            rows[other.scenario, other.kind] = other
    rows[row.scenario, row.kind] = row
    order = [(scenario, kind) for scenario in SCENARIOS for kind in KINDS]
    there = [rows[key] for key in order if key in rows]
    file.write_text("".join(json.dumps(asdict(item)) + "\n" for item in there))
    (out / "table.md").write_text(table(there))


if __name__ == "__main__":
    sys.exit(main())

"""The summary of many flights, in Markdown."""

from __future__ import annotations

import numpy as np

from .kinds import KINDS

FIGURES = (
    ("clearance, m", "least_clearance_m", (50, 1)),
    ("to keep-out, m", "least_keep_out_m", (50, 1)),
    ("step, m/s", "greatest_step_mps", (50, 99)),
)
"""Percentile that is shown of figures that are better when greater: the 99th from above."""


def summary(rows: list[dict], seconds: list[float]) -> str:
    """Verdicts, violations by rule, and a table with a line per kind of fault."""
    lines = ["# Random flights", "", _verdicts(rows)]
    if seconds:
        lines.append(
            f"Processor time: {np.mean(seconds):.1f} s a flight, {np.percentile(seconds, 99):.1f} s"
            f" at p99; 1,000 flights: {np.mean(seconds) * 1000 / 3600:.1f} h on one core."
        )
    lines += ["", *_broken(rows), *_rules(rows), *_kinds(rows)]
    return "\n".join(lines) + "\n"


def _verdicts(rows: list[dict]) -> str:
    counts = {}
    for row in rows:
        counts[row["verdict"]] = counts.get(row["verdict"], 0) + 1
    verdicts = ", ".join(f"{count} {verdict}" for verdict, count in sorted(counts.items()))
    flown_s = sum(row.get("controlled_s", 0.0) for row in rows)
    within_s = sum(row.get("within_s", 0.0) for row in rows)
    return (
        f"{len(rows)} flights: {verdicts}. Under control {flown_s / 60:.0f} min, of which"
        f" {within_s / 60:.0f} min within the promise."
    )


def _broken(rows: list[dict]) -> list[str]:
    lines = ["## Flights that broke the promise", ""]
    for row in rows:
        if row["verdict"] == "error":
            lines.append(f"- seed {row['seed']}: {row['error']}")
        elif row["verdict"] == "broken":
            faults = ", ".join(f"{fault['kind']} at {fault['at_s']}" for fault in row["faults"])
            found = "; ".join(
                f"{item['rule']} {item['value']} at {item['time_s']} s ({item['state']})"
                for item in row["violations"]
                if not item["outside"]
            )
            lines.append(
                f"- seed {row['seed']} ({row['manner']}, {row['vehicle']}, {row['site']}): {found}."
                f" Faults: {faults}"
            )
    return [*(lines if len(lines) > 2 else [*lines, "None."]), ""]


def _rules(rows: list[dict]) -> list[str]:
    found: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for row in rows:
        for item in row.get("violations", ()):
            what = " + ".join(item["outside"]) or "within the promise"
            found.setdefault((item["rule"], what), []).append((row["seed"], item["times"]))
    lines = ["## Violations", "", "| rule | not held | times | flights |", "|---|---|---|---|"]
    for (rule, what), each in sorted(found.items()):
        few = " ".join(str(seed) for seed, _ in each[:8])
        lines.append(f"| {rule} | {what} | {sum(n for _, n in each)} | {len(each)}: {few} |")
    return [*lines, ""]


def _kinds(rows: list[dict]) -> list[str]:
    heads = [f"{title}, {'p50' if q == 50 else 'p99'}" for title, _, qs in FIGURES for q in qs]
    lines = [
        "## Kinds of faults",
        "",
        f"| kind | flights | broken | outside | {' | '.join(heads)} |",
        "|" + "---|" * (4 + len(heads)),
    ]
    for name in KINDS:
        of_kind = [
            row for row in rows if any(fault["kind"] == name for fault in row.get("faults", ()))
        ]
        if not of_kind:
            continue
        verdicts = [row["verdict"] for row in of_kind]
        figures = []
        for _, key, percentiles in FIGURES:
            values = [row[key] for row in of_kind if row[key] is not None]
            figures += [f"{np.percentile(values, q):.2f}" if values else "" for q in percentiles]
        lines.append(
            f"| {name} | {len(of_kind)} | {verdicts.count('broken')} |"
            f" {verdicts.count('outside')} | {' | '.join(figures)} |"
        )
    return lines

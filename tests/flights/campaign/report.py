"""Summary of many flights in Markdown, and the report with its plots in HTML."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from moar_companion.analysis.evaluation.figures.drawing import Picture, new_figure, picture
from moar_companion.analysis.evaluation.report import ReportSection, document
from moar_companion.analysis.evaluation.tables import Table

from .batch import Row
from .kinds import KINDS

FIGURES = (
    ("clearance, m", "least_clearance_m", (50, 1)),
    ("to keep-out, m", "least_keep_out_m", (50, 1)),
    ("step, m/s", "greatest_step_mps", (50, 99)),
)
"""Percentile that is shown of figures that are better when greater: the 99th from above."""
WITHIN = "within the promise"
_COLOURS = {"kept": "#8fb8de", "outside": "#e6a23c", "broken": "#d01f2e", "error": "#55585e"}
_REASONS = 25
_NUMBER = re.compile(r"-?\d+(\.\d+)?")


def summary(rows: list[Row]) -> str:
    """Verdicts, violations by rule, reasons of unreached targets, a line per kind of fault."""
    spent_s = [row["cpu_s"] for row in rows]
    lines = ["# Random flights", "", _verdicts(rows), _reached(rows)]
    if spent_s:
        lines.append(
            f"Processor time: {np.mean(spent_s):.1f} s a flight, {np.percentile(spent_s, 99):.1f} s"
            f" at p99; 1,000 flights: {np.mean(spent_s) * 1000 / 3600:.1f} h on one core."
        )
    lines += ["", "## Flights that broke the promise", "", *(_broken(rows) or ["None."]), ""]
    for table in tables(rows):
        lines += [f"## {table.title}", "", *_markdown(table), ""]
    return "\n".join(lines[:-1]) + "\n"


def report(rows: list[Row], folder: Path) -> str:
    """The report as one HTML document. folder: has the pictures of broken flights."""
    violations, reasons, kinds = tables(rows)
    broken = [
        Picture(name=path.stem, title=path.stem, caption="", png=path.read_bytes(), svg=b"")
        for row in rows
        if (path := folder / f"broken-{row['seed']}.png").exists()
    ]
    return document(
        "Random flights",
        [
            ReportSection(
                title="Overview",
                text=f"{_verdicts(rows)} {_reached(rows)}",
                tables=[violations],
                pictures=[_by("autopilot", "manner", rows), _by("site", "site", rows)],
            ),
            ReportSection(
                title="Flights that broke the promise",
                text="Each with its violations within the promise, and its faults.",
                tables=[_broken_table(rows)],
                pictures=broken,
            ),
            ReportSection(
                title="Targets that were not reached",
                text="Reasons as the operators were told them, # for a number.",
                tables=[reasons],
                pictures=[_reason_bars(rows)],
            ),
            ReportSection(
                title="Kinds of faults",
                text="A flight has one to three faults, and counts for each of them.",
                tables=[kinds],
                pictures=[_kind_bars(rows), _clearances(rows)],
            ),
        ],
    )


def _broken_table(rows: list[Row]) -> Table:
    lines = tuple((line.removeprefix("- "),) for line in _broken(rows))
    return Table(title="By seed", note="", header=("flight",), rows=lines or (("None.",),))


def tables(rows: list[Row]) -> tuple[Table, Table, Table]:
    """Violations by rule, reasons of unreached targets, figures by kind of fault."""
    heads = (f"{title}, {'p50' if q == 50 else 'p99'}" for title, _, qs in FIGURES for q in qs)
    return (
        Table(
            title="Violations",
            note="not held: the parts of the promise that did not hold then",
            header=("rule", "not held", "times", "flights"),
            rows=_rules(rows),
        ),
        Table(
            title="Reasons of unreached goals",
            note="the state at the end, and the last reason that the operators were told",
            header=("reason", "flights"),
            rows=tuple(_reasons(rows).most_common(_REASONS)),
        ),
        Table(
            title="Kinds of faults",
            note="least or greatest values of the flights with this kind",
            header=("kind", "flights", "broken", "outside", "reached", *heads),
            rows=_kinds(rows),
        ),
    )


def _verdicts(rows: list[Row]) -> str:
    counts = Counter(row["verdict"] for row in rows)
    verdicts = ", ".join(f"{count} {verdict}" for verdict, count in sorted(counts.items()))
    flown_s = sum(row.get("controlled_s", 0.0) for row in rows)
    within_s = sum(row.get("within_s", 0.0) for row in rows)
    return (
        f"{len(rows)} flights: {verdicts}. Under control {flown_s / 60:.0f} min, of which"
        f" {within_s / 60:.0f} min within the promise."
    )


def _reached(rows: list[Row]) -> str:
    flown = _flown(rows)
    return f"The first order's goal was reached in {sum(row['reached'] for row in flown)} of them."


def _flown(rows: list[Row]) -> list[Row]:
    return [row for row in rows if row["verdict"] != "error"]


def _broken(rows: list[Row]) -> list[str]:
    lines = []
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
    return lines


def _rules(rows: list[Row]) -> tuple[tuple[str, str, int, str], ...]:
    found: dict[tuple[str, str], list[tuple[int, int]]] = {}
    for row in rows:
        for item in row.get("violations", ()):
            what = " + ".join(item["outside"]) or WITHIN
            found.setdefault((item["rule"], what), []).append((row["seed"], item["times"]))
    return tuple(
        (
            rule,
            what,
            sum(times for _, times in each),
            f"{len(each)}: {' '.join(str(seed) for seed, _ in each[:8])}",
        )
        for (rule, what), each in sorted(found.items())
    )


def _reasons(rows: list[Row]) -> Counter[str]:
    return Counter(_NUMBER.sub("#", row["why"]) for row in _flown(rows) if row["why"])


def _kinds(rows: list[Row]) -> tuple[tuple[str | int, ...], ...]:
    found = []
    for name in KINDS:
        of_kind = _of_kind(rows, name)
        if not of_kind:
            continue
        verdicts = [row["verdict"] for row in of_kind]
        figures = []
        for _, key, percentiles in FIGURES:
            values = [row[key] for row in of_kind if row[key] is not None]
            figures += [f"{np.percentile(values, q):.2f}" if values else "" for q in percentiles]
        counts = (verdicts.count("broken"), verdicts.count("outside"))
        reached = sum(row["reached"] for row in of_kind)
        found.append((name, len(of_kind), *counts, reached, *figures))
    return tuple(found)


def _of_kind(rows: list[Row], name: str) -> list[Row]:
    return [row for row in rows if any(fault["kind"] == name for fault in row.get("faults", ()))]


def _markdown(table: Table) -> list[str]:
    rows = [table.header, ("---",) * len(table.header), *table.rows]
    return [f"| {' | '.join(map(str, row))} |" for row in rows]


# Plots ------------------------------------------------------------------------------------------


def _by(what: str, key: str, rows: list[Row]) -> Picture:
    names = sorted({_group(row[key]) for row in _flown(rows)})
    return _stacked(
        f"by-{what}",
        f"Verdicts by {what}",
        names,
        lambda name: [row for row in _flown(rows) if _group(row[key]) == name],
    )


def _group(name: str) -> str:
    return _NUMBER.sub("", name).strip() if name.startswith("generated") else name


def _kind_bars(rows: list[Row]) -> Picture:
    names = [name for name in KINDS if _of_kind(rows, name)]
    return _stacked("by-kind", "Verdicts by kind", names, lambda name: _of_kind(rows, name))


def _stacked(
    name: str, title: str, groups: Sequence[str], of: Callable[[str], list[Row]]
) -> Picture:
    """A bar for each group of flights, divided by verdict."""
    figure = new_figure(9.0, 1.2 + 0.2 * len(groups))
    axes = figure.add_subplot()
    left = np.zeros(len(groups))
    for verdict, colour in _COLOURS.items():
        counts = np.array(
            [sum(row["verdict"] == verdict for row in of(group)) for group in groups], float
        )
        if counts.any():
            axes.barh(range(len(groups)), counts, left=left, color=colour, label=verdict)
        left += counts
    _label(axes, groups, "flights")
    axes.legend(fontsize=7)
    return picture(figure, name, title, "")


def _reason_bars(rows: list[Row]) -> Picture:
    reasons = _reasons(rows).most_common(_REASONS)
    figure = new_figure(11.0, 1.2 + 0.22 * len(reasons))
    axes = figure.add_subplot()
    axes.barh(range(len(reasons)), [count for _, count in reasons], color=_COLOURS["kept"])
    _label(axes, [text for text, _ in reasons], "flights")
    return picture(figure, "reasons", "Reasons of unreached goals", "")


def _label(axes, names: Sequence[str], unit: str) -> None:
    axes.set_yticks(range(len(names)), names, fontsize=7)
    axes.invert_yaxis()
    axes.set_xlabel(unit)


def _clearances(rows: list[Row]) -> Picture:
    figure = new_figure(9.0, 4.0)
    axes = figure.add_subplot()
    for manner in sorted({row["manner"] for row in _flown(rows)}):
        values = [
            row["least_keep_out_m"]
            for row in _flown(rows)
            if row["manner"] == manner and row["least_keep_out_m"] is not None
        ]
        finite = [value for value in values if np.isfinite(value)]
        axes.hist(finite, bins=60, histtype="step", label=manner)
    axes.axvline(0.0, color=_COLOURS["broken"], linewidth=1.0)
    axes.set_xlabel("least distance from hull to keep-out (m)")
    axes.set_ylabel("flights")
    axes.legend(fontsize=7)
    return picture(figure, "clearances", "Least distance to a keep-out", "")

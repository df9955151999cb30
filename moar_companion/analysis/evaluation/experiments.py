"""The experiments as tasks, and their results: columns, pictures, tables, the report.

A task is a function and its arguments. Function, arguments and answer can be sent to another
process. The order of the results is that of the tasks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...types import Mission
from . import adaptability, flight, measures, missions, sensitivity
from .adaptability import Adaptability
from .flight import FlightTest
from .missions import MissionTest
from .report import ReportSection, document, text
from .scenes import ENVIRONMENTS, SCENES, SWEPT
from .sensitivity import Sensitivity
from .tables import Columns, Table, joined, of_rows, path_rows, scene_table

if TYPE_CHECKING:
    from .figures.drawing import Picture

Call = tuple[Callable[..., Any], tuple[Any, ...]]
"""A function and its arguments."""

TITLE = "The MOAR planner's experiments, rerun"
_TEXTS = {
    "maps": "Maps and graph (Fig. 2 to 5).",
    "sensitivity": "All combinations of weights on nine scenes (ReportSection V-A, Fig. 6, 7).",
    "adaptability": "All combinations of risks on the 36 scenes (ReportSection V-B, Fig. 8).",
    "tests": "Three environments, three missions, four variations (ReportSection V-A).",
    "flight": "The physical experiment (ReportSection V-C, Fig. 9), in lockstep.",
}


@dataclass(frozen=True, kw_only=True)
class Results:
    """Results of the finished experiments; empty or None for the others."""

    sensitivity: Sequence[Sensitivity] = ()
    adaptability: Sequence[Adaptability] = ()
    tests: Sequence[MissionTest] = ()
    flight: FlightTest | None = None


def sweeps(experiment: str, clock: missions.Clock) -> list[Call]:
    """The computations of an experiment; none for those that only draw or fly.

    clock: seconds, for the times of plans; it can be sent to another process, too.
    """
    calls: dict[str, list[Call]] = {
        "sensitivity": [(sensitivity.sweep, (scene,)) for scene in SWEPT],
        "adaptability": [(adaptability.sweep, (scene,)) for scene in SCENES],
        "tests": [(missions.run, (scene, clock)) for scene in SCENES],
    }
    return calls.get(experiment, [])


def drawings(experiment: str, results: Results) -> list[Call]:
    """The figures of an experiment; each call returns a picture."""
    from .figures import adaptability_figure as risks  # noqa: PLC0415
    from .figures import map_figure  # noqa: PLC0415
    from .figures import sensitivity_figure as weights  # noqa: PLC0415

    calls: dict[str, list[Call]] = {
        "maps": [(map_figure.figure_maps, (number,)) for number in range(1, len(ENVIRONMENTS) + 1)],
        "sensitivity": [(draw, (results.sensitivity,)) for draw in weights.FIGURES],
        "adaptability": [(draw, (results.adaptability,)) for draw in risks.FIGURES],
        "flight": [(map_figure.figure_9, (results.flight,))],
    }
    return calls.get(experiment, [])


def columns(results: Results) -> dict[str, Columns]:
    """The Parquet files by name; only `tests_times` differs from run to run."""
    files: dict[str, Columns] = {}
    if results.sensitivity:
        swept = results.sensitivity
        files["sensitivity"] = joined([sensitivity.rows(each) for each in swept])
        files["sensitivity_measures"] = of_rows([sensitivity.summary(each) for each in swept])
        files["sensitivity_paths"] = joined(
            [
                path_rows(each.scene, {"sweep": each.paths, "front": each.front}, each.baselines)
                for each in swept
            ]
        )
    if results.adaptability:
        adapted = results.adaptability
        files["adaptability"] = joined([adaptability.rows(each) for each in adapted])
        files["adaptability_measures"] = of_rows(
            [adaptability.summary(each, way) for way in adaptability.WAYS for each in adapted]
        )
        files["adaptability_paths"] = joined(
            [
                path_rows(each.scene, {"sweep": each.paths, "front": each.front}, each.baselines)
                for each in adapted
            ]
        )
    if results.tests:
        files["tests"] = joined([missions.rows(each) for each in results.tests])
        files["tests_times"] = of_rows([missions.times(each) for each in results.tests])
    if results.flight is not None:
        rows = flight.compared(results.flight)
        files["flight"] = {"row": list(rows)} | {
            name: [values[at] for values in rows.values()]
            for at, name in enumerate(flight.COMPARED)
        }
    return files


def headline(results: Results) -> Table:
    """The paper's numbers beside ours."""
    rows: list[tuple[str | float | int, ...]] = []

    def spread(name: str, paper: str, values: Sequence[float]) -> None:
        rows.append((name, paper, *measures.quartiles(np.array(values, dtype=float))))

    swept = [sensitivity.summary(each) for each in results.sensitivity]
    if swept:
        for label, paper in (("length", "1.50"), ("clearance", "0.76")):
            spread(
                f"weights: range of {label} over that of the baselines",
                paper,
                [row[f"{label}_range_ratio"] for row in swept],
            )
        for label in ("length", "clearance"):
            spread(
                f"weights: part of the baselines' range of {label} that is covered",
                "",
                [row[f"{label}_coverage"] for row in swept],
            )
        spread(
            "weights: hypervolume, of the front's", "", [row["hypervolume_ratio"] for row in swept]
        )
        spread("weights: distinct paths", "", [row["paths"] for row in swept])
    for way in adaptability.WAYS if results.adaptability else ():
        judged = [(each.scene, adaptability.summary(each, way)) for each in results.adaptability]
        of = f"risks, {way.name}"
        for label, paper in (("clearance", "0.90"), ("length", "0.88")):
            for what in ("coverage", "over wind", "together"):
                spread(
                    f"{of}: {label} between A* and Voronoi, {what}",
                    paper if what == "coverage" else "",
                    [row[f"{label}: {what}"] for _, row in judged],
                )
            for mission in Mission:
                spread(
                    f"{of}: {label} between A* and Voronoi, coverage, {mission.value}",
                    paper,
                    [
                        row[f"{label}: coverage"]
                        for scene, row in judged
                        if scene.mission is mission
                    ],
                )
        for label in ("clearance", "length"):
            for what, paper in (
                ("half passed at", "0.5"),
                ("greatest step", ""),
                ("front's gap", ""),
            ):
                spread(
                    f"{of}: {label} over wind, {what}",
                    paper,
                    [row[f"{label}: {what}"] for _, row in judged],
                )
    if results.tests:
        times = [missions.times(each) for each in results.tests]
        for name in ("cold", "with tables"):
            for part in ("p50", "p99"):
                spread(
                    f"time of a plan, {name}, {part} (ms)",
                    "10",
                    [row[f"{name}, {part} (ms)"] for row in times],
                )
    return Table(
        title="The paper's numbers, and ours",
        note="Ours over the scenes: n of those in which the figure is defined, quartiles, median. "
        "What each is, and what the paper leaves open: evaluation/environments/README.md.",
        header=("figure", "paper", "n", "first quartile", "median", "third quartile"),
        rows=tuple(rows),
    )


def report(results: Results, pictures: Mapping[str, Sequence[Picture]]) -> str:
    """The report of the experiments with pictures or results, as HTML."""
    overview = headline(results)
    tables = {
        "sensitivity": _sensitivity_tables(results.sensitivity),
        "adaptability": _adaptability_tables(results.adaptability),
        "tests": _test_tables(results.tests),
        "flight": _flight_tables(results.flight),
    }
    sections = [
        ReportSection(
            title=name.capitalize(),
            text=_TEXTS[name],
            tables=tables.get(name, []),
            pictures=drawn,
        )
        for name, drawn in pictures.items()
    ]
    if overview.rows:
        first = ReportSection(title="Overview", text="", tables=[overview], pictures=())
        sections.insert(0, first)
    return document(TITLE, sections)


def summary(results: Results) -> str:
    """The figures that the paper also has, in lines of text."""
    lines = [
        f"{name}: {text(median)} (quartiles {text(low)}, {text(high)}; n = {count}); paper {paper}"
        for name, paper, count, low, median, high in headline(results).rows
        if paper
    ]
    if results.flight is not None:
        for name, values in flight.compared(results.flight).items():
            shown = zip(flight.COMPARED, values, strict=True)
            lines.append(
                f"flight, {name}: " + ", ".join(f"{what} {text(it)}" for what, it in shown)
            )
    return "".join(f"{line}\n" for line in lines)


def _sensitivity_tables(swept: Sequence[Sensitivity]) -> list[Table]:
    if not swept:
        return []
    return [
        scene_table(
            "Sensitivity, scene by scene",
            "Range ratio and coverage against the three baselines; paths: distinct paths of the "
            "sweep; front: those of the exact front.",
            [sensitivity.summary(each) for each in swept],
        )
    ]


def _adaptability_tables(adapted: Sequence[Adaptability]) -> list[Table]:
    tables = []
    for way in adaptability.WAYS if adapted else ():
        rows = [adaptability.summary(each, way) for each in adapted]
        for row in rows:
            del row["way"]
        # One table for each metric; a single table is too wide.
        tables += [_metric_table(way.name, label, rows) for label in adaptability.COMPARED]
    return tables


def _metric_table(way: str, label: str, rows: Sequence[dict[str, Any]]) -> Table:
    prefix = f"{label}: "
    return scene_table(
        f"{way}: {label}",
        "Coverage of the interval between A* and Voronoi: over all combinations, over wind alone, "
        "over wind, communication and localization together, by the paths for safety, time and "
        "energy alone (corners), and the most that any weights reach (front). Steps, of wind "
        "alone, and the front's gap: of their range. A dash: not defined.",
        [
            {"scene": row["scene"], "paths": row["paths"]}
            | {
                name.removeprefix(prefix): value
                for name, value in row.items()
                if name.startswith(prefix)
            }
            for row in rows
        ],
    )


def _test_tables(tests: Sequence[MissionTest]) -> list[Table]:
    if not tests:
        return []
    return [
        scene_table(
            "Metrics of the 36 tests",
            "The plan with the vehicle's weights, and lengths and clearances of the baselines.",
            [missions.summary(each) for each in tests],
        ),
        scene_table(
            "Times",
            "Whole plans with other weights each; states: free cells times actions. The paper: "
            "about 10 ms for 20,000 states.",
            [missions.times(each) for each in tests],
        ),
    ]


def _flight_tables(flown: FlightTest | None) -> list[Table]:
    if flown is None:
        return []
    rows: list[tuple[str | float | int, ...]] = [
        (name, *values) for name, values in flight.compared(flown).items()
    ]
    return [
        Table(
            title="The flight",
            note="Flown: the true aircraft from where the companion begins to fly until it holds "
            "at the target.",
            header=("", *flight.COMPARED),
            rows=tuple(rows),
        )
    ]

"""Tables of the report and columns of the Parquet files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from .measures import quartiles
from .paths import Baselines, Paths
from .scenes import Scene

Columns = dict[str, Any]
"""Values by the name of a column, all of one length."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """A table of the report: rows of texts and numbers, the first column names the row."""

    title: str
    note: str
    header: tuple[str, ...]
    rows: tuple[tuple[str | float | int, ...], ...]


def joined(parts: Sequence[Columns]) -> Columns:
    """The rows of all parts, in their order."""
    whole: Columns = {name: [] for name in parts[0]}
    for part in parts:
        for name, values in part.items():
            whole[name].extend(np.asarray(values).tolist())
    return whole


def of_rows(rows: Sequence[Mapping[str, Any]]) -> Columns:
    """Columns of rows that have the same keys."""
    return {name: [row[name] for row in rows] for name in rows[0]}


def path_rows(scene: Scene, sets: Mapping[str, Paths], baselines: Baselines) -> Columns:
    """The points of all paths of a scene, one in a row."""
    columns: Columns = {}
    drawn = [
        (name, number, points)
        for name, paths in sets.items()
        for number, points in enumerate(paths.points_m)
    ]
    drawn += [(kind.value, 0, points) for kind, points in baselines.points_m.items()]
    for name, number, points in drawn:
        count = len(points)
        part: Columns = {
            **{key: [value] * count for key, value in scene.key.items()},
            "set": [name] * count,
            "path": [number] * count,
            "x_m": points[:, 0].tolist(),
            "z_m": points[:, 1].tolist(),
        }
        for key, values in part.items():
            columns.setdefault(key, []).extend(values)
    return columns


def scene_table(title: str, note: str, rows: Sequence[Mapping[str, Any]]) -> Table:
    """A table with a row for each scene, and below them n, quartiles and median of each column.

    rows: with the same keys; the first is the row's name, the others are numbers.
    """
    names = tuple(rows[0])
    body = [tuple(row[name] for name in names) for row in rows]
    spreads = [quartiles(np.array([row[name] for row in rows], dtype=float)) for name in names[1:]]
    for at, label in enumerate(("n", "first quartile", "median", "third quartile")):
        body.append((label, *(spread[at] for spread in spreads)))
    return Table(title=title, note=note, header=names, rows=tuple(body))

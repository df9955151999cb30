"""Files of an inspection beside the recording: its pictures as lines of JSON, as a map, as a table.

    FOLDER/inspection.jsonl     a line for each picture, video and view
    FOLDER/inspection.geojson   pictures and videos, for maps
    FOLDER/inspection.csv       pictures, as photogrammetry programs import them

They begin with the first row. The content is made by `companion/inspection/picture_record`; the
recorder's thread writes them.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ..companion.inspection.picture_record import KINDS, csv_text, geojson, iso_utc

FILE_STEM = "inspection"


def rows_of(
    decisions: Iterable[tuple[float, str, dict[str, Any]]], offset_s: float
) -> list[dict[str, Any]]:
    """Rows of the decisions that belong to the inspection. offset_s: wall clock minus machine's."""
    return [
        {
            "time_s": round(time_s + offset_s, 3),
            "utc": iso_utc(time_s + offset_s),
            "kind": kind,
            **data,
        }
        for time_s, kind, data in decisions
        if kind in KINDS
    ]


class InspectionFiles:
    """The files in a folder; `write` raises OSError if they cannot be written."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / FILE_STEM
        self._rows: list[dict[str, Any]] = []

    def write(self, rows: list[dict[str, Any]]) -> None:
        """Appends rows, and makes map and table anew."""
        if not rows:
            return
        self._rows += rows
        with self._path.with_suffix(".jsonl").open("a", encoding="utf-8") as file:
            file.writelines(json.dumps(row, allow_nan=False) + "\n" for row in rows)
        map_text = json.dumps(geojson(self._rows), allow_nan=False)
        self._path.with_suffix(".geojson").write_text(map_text, encoding="utf-8")
        self._path.with_suffix(".csv").write_text(csv_text(self._rows), encoding="utf-8")

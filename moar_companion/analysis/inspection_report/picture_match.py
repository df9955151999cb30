"""Matches of picture files with the rows of a record: by name, camera's number, or time. Pure.

A camera rarely reports the names of its files, its numbers begin anywhere, and its clock may be off
by its time zone or more. A difference that is common to all pictures is therefore found first.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any

_NUMBER = re.compile(r"(\d+)\D*$")
_BLANKS = "\0 "
_CLOCK_S = 2.0
"""Greatest difference of a picture's time, beside the common one: cameras write whole seconds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureFile:
    """A file of a picture. taken_s: time in it, as if it were UTC; None without one."""

    name: str
    taken_s: float | None = None

    @property
    def number(self) -> int | None:
        """The last number in its name."""
        found = _NUMBER.search(self.name.rpartition(".")[0])
        return None if found is None else int(found[1])


def matched(
    rows: Sequence[Mapping[str, Any]], files: Sequence[PictureFile]
) -> dict[int, PictureFile]:
    """The file of each row that has one, by the row's index. Rows are pictures of one record."""
    names = {file.name.lower(): file for file in files}
    found = {
        index: names[name]
        for index, row in enumerate(rows)
        if (name := str(row.get("file") or "").replace("\\", "/").rpartition("/")[2].lower())
        in names
    }
    for key, measure, tolerance in (
        (_row_number, lambda file: file.number, 0.0),
        (_row_time_s, lambda file: file.taken_s, _CLOCK_S),
    ):
        taken = {file.name for file in found.values()}
        left = [index for index in range(len(rows)) if index not in found]
        rest = [file for file in files if file.name not in taken]
        found |= _by_measure(rows, left, rest, key, measure, tolerance)
    return found


def _row_number(row: Mapping[str, Any]) -> float | None:
    return row.get("number")


def _row_time_s(row: Mapping[str, Any]) -> float | None:
    text = row.get("camera_utc")
    if text:
        return datetime.fromisoformat(text.replace("Z", "+00:00")).timestamp()
    return row.get("time_s")


def _by_measure(
    rows: Sequence[Mapping[str, Any]],
    left: Sequence[int],
    files: Sequence[PictureFile],
    key: Callable[[Mapping[str, Any]], float | None],
    measure: Callable[[PictureFile], float | None],
    tolerance: float,
) -> dict[int, PictureFile]:
    """Matches by a number of rows and files, less the difference that most pairs have."""
    wanted = {index: value for index in left if (value := key(rows[index])) is not None}
    offered = {file: value for file in files if (value := measure(file)) is not None}
    if not wanted or not offered:
        return {}
    step = max(1.0, tolerance)
    counts = Counter(
        round((has - asks) / step) for asks in wanted.values() for has in offered.values()
    )
    # Of equal counts the least difference: a camera that counts and clocks as the record.
    common, count = max(counts.items(), key=lambda item: (item[1], -abs(item[0])))
    if count < min(2, len(wanted), len(offered)):
        return {}
    near = [
        (abs(has - asks - common * step), index, file)
        for index, asks in wanted.items()
        for file, has in offered.items()
    ]
    found: dict[int, PictureFile] = {}
    for off, index, file in sorted(near, key=lambda item: (item[0], item[1], item[2].name)):
        if off <= 2.0 * tolerance and index not in found and file not in found.values():
            found[index] = file
    return found


def exif_time_s(text: str, fraction: str = "") -> float | None:
    """Time of EXIF's DateTimeOriginal, as `2026:11:28 14:05:09`, taken as UTC; None for others."""
    try:
        taken = datetime.strptime(f"{text.strip(_BLANKS)} +0000", "%Y:%m:%d %H:%M:%S %z")
    except ValueError:
        return None
    digits = fraction.strip(_BLANKS)
    part_s = float(f"0.{digits}") if digits.isascii() and digits.isdigit() else 0.0
    return taken.timestamp() + part_s

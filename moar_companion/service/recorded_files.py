"""Recordings in a directory: their names, and the removal of old ones.

Only files that the recorder has named are removed: those of other flights first, in the order of
their names, then earlier parts of this one. The name of this one does not count, since a host's
clock may be wrong.
"""

from __future__ import annotations

import contextlib
import logging
import re
from collections.abc import Collection
from pathlib import Path

_FLIGHT = re.compile(r"flight_\d{8}T\d{6}\.\d{6}Z")
_FILE = re.compile(
    r"(?:flight|decisions)(?:-(\d+))?\.(?:tlog|jsonl|mcap)|inspection\.(?:jsonl|geojson|csv)"
)

_logger = logging.getLogger(__name__)


def part_name(name: str, number: int) -> str:
    """The name of a file in a part: `flight.mcap`, `flight-2.mcap`."""
    path = Path(name)
    return name if number == 1 else f"{path.stem}-{number}{path.suffix}"


def is_flight(folder: Path) -> bool:
    """True for the folder of a recorded flight."""
    return (
        _FLIGHT.fullmatch(folder.name) is not None and folder.is_dir() and not folder.is_symlink()
    )


def is_recorded(path: Path) -> bool:
    """True for a file that the recorder has named."""
    return _FILE.fullmatch(path.name) is not None and path.is_file() and not path.is_symlink()


def make_room(
    directory: Path, kept: Collection[Path], most_bytes: float, short_bytes: float
) -> None:
    """Removes the oldest recordings until all have at most `most_bytes`.

    kept: files that stay, of the present part; other parts of this flight are removed last.
    short_bytes: to be removed at least, if there is as much. Raises OSError if the directory cannot
    be read; recordings that a person removes meanwhile do not count.
    """
    present = {path.parent for path in kept}
    files: list[tuple[bool, str, int, Path, int]] = []
    for folder in directory.iterdir():
        if not _FLIGHT.fullmatch(folder.name) or folder.is_symlink():
            continue
        with contextlib.suppress(FileNotFoundError, NotADirectoryError):
            files += [
                (folder in present, folder.name, int(name[1] or 1), path, path.stat().st_size)
                for path in folder.iterdir()
                if (name := _FILE.fullmatch(path.name)) and path.is_file()
            ]
    over_bytes = max(sum(size for *_, size in files) - most_bytes, short_bytes)
    for *_, path, size in sorted(files):
        if over_bytes <= 0.0:
            return
        if path in kept:
            continue
        with contextlib.suppress(OSError):
            path.unlink()
            over_bytes -= size
            _logger.info("removed %s to make room", path)
            path.parent.rmdir()

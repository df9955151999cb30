"""A flight's folder: made before it, gathered after it."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
from pathlib import Path

from moar_companion.errors import InputError

_LATEST = "latest"
_LEAST_FREE_MB = 50.0
"""Ten times the size of a flight's files."""


def make_folder(out: Path) -> None:
    """Make a folder that can be written, has room, and has no flight yet."""
    out.mkdir(parents=True, exist_ok=True)
    if (out / "truth.csv").exists():
        raise InputError("--out", "", f"{out} already holds a flight, must be another folder")
    with tempfile.TemporaryFile(dir=out):
        pass
    free_mb = shutil.disk_usage(out).free / 1e6
    if free_mb < _LEAST_FREE_MB:
        problem = f"{out} has {free_mb:.0f} MB free, must be at least {_LEAST_FREE_MB:.0f}"
        raise InputError("--out", "", problem)


def gather(out: Path) -> bool:
    """Move the service's recording into the flight's folder; True if there is any."""
    recorded = sorted(out.glob("flight_*"))
    if recorded:
        for file in recorded[-1].iterdir():
            shutil.move(file, out / file.name)
        recorded[-1].rmdir()
    return (out / "flight.tlog").exists() and (out / "decisions.jsonl").exists()


def link_latest(out: Path) -> None:
    """Make `latest` beside the flight's folder lead to it, where links can be made."""
    link = out.parent / _LATEST
    with contextlib.suppress(OSError):
        if link.is_symlink():
            link.unlink()
        link.symlink_to(out.name)

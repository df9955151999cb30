"""Recordings that the page lists, sends and removes: files that the recorder has named."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

from ..recorded_files import is_flight, is_recorded

_PLAYED = "flight.mcap"
"""File of a flight that is played back; its further parts are beside it."""


class PageRecordings:
    """Flights in a folder, or one file. folder, file: None without."""

    def __init__(self, folder: Path | None = None, file: Path | None = None) -> None:
        self._folder = folder
        self._file = file

    def flights(self, active: str | None) -> list[dict[str, Any]]:
        """Name and files of each flight, the newest first. active: the one being recorded."""
        if self._file is not None:
            files = [{"name": self._file.name, "bytes": self._file.stat().st_size}]
            return [_flight(self._file.name, files, active)]
        if self._folder is None:
            return []
        folders = filter(is_flight, _content(self._folder))
        names = sorted(folders, key=lambda folder: folder.name, reverse=True)
        return [_flight(folder.name, _files(folder), active) for folder in names]

    def path(self, name: str, file: str | None) -> Path | None:
        """A file of a flight, without one that is played back; None if it is not there."""
        if self._file is not None:
            return self._file if name == self._file.name and file in {None, name} else None
        flight = self._flight(name)
        path = None if flight is None else flight / (file or _PLAYED)
        return path if path is not None and is_recorded(path) else None

    def remove(self, name: str) -> bool:
        """Removes a flight's files; False if there is no such flight."""
        flight = self._flight(name)
        if flight is None:
            return False
        for path in flight.iterdir():
            if is_recorded(path):
                path.unlink(missing_ok=True)
        with contextlib.suppress(OSError):  # a person's own file in it stays
            flight.rmdir()
        return True

    def _flight(self, name: str) -> Path | None:
        if self._folder is None or "/" in name:
            return None
        flight = self._folder / name
        return flight if is_flight(flight) else None


def _flight(name: str, files: list[dict[str, Any]], active: str | None) -> dict[str, Any]:
    size = sum(item["bytes"] for item in files)
    return {"name": name, "bytes": size, "active": name == active, "files": files}


def _files(folder: Path) -> list[dict[str, Any]]:
    files = []
    for path in filter(is_recorded, _content(folder)):
        with contextlib.suppress(FileNotFoundError):  # the recorder makes room meanwhile
            files.append({"name": path.name, "bytes": path.stat().st_size})
    return files


def _content(folder: Path) -> list[Path]:
    """Paths in a folder by name; none of one that cannot be read."""
    try:
        return sorted(folder.iterdir())
    except OSError:
        return []

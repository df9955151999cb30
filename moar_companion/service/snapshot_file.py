"""File of the mission snapshot: complete at any moment, written without blocking the control loop.

    DIRECTORY/mission.json

After a failed write, or one that the end of the process does not wait for, the file is removed: an
outdated snapshot is worse than none.
"""

from __future__ import annotations

import contextlib
import logging
import threading
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from pydantic import TypeAdapter

from ..companion.mission_snapshot import MissionSnapshot
from ..companion.safety.file_faults import FileFault
from ..settings.input_file import open_file
from ..texts import service_texts
from .whole_file import WholeFile

_NAME = "mission.json"
_LONGEST_BYTES = 65536
"""A longer file is not a mission snapshot."""

_REMOVAL_S = 1.0
"""Longest wait for the removal of an outdated file at the end of the process."""

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True, kw_only=True)
class _File:
    """Content of the file; its times are seconds since 1970."""

    version: Literal[1] = 1
    memory: MissionSnapshot


_FILE = TypeAdapter(_File)


class SnapshotFile:
    """File in a folder, and the thread that writes it.

    Only the constructor raises OSError, if the folder cannot be written.
    """

    def __init__(self, directory: Path) -> None:
        directory.mkdir(parents=True, exist_ok=True)
        self._file = WholeFile(directory / _NAME, "memory", failed=self._remove)
        self._file.beside.write_bytes(b"")
        self._file.beside.unlink()
        self._load_fault: FileFault | None = None

    @property
    def faults(self) -> tuple[FileFault, ...]:
        """Current faults of the file; a file that was unusable at the start stays in the list."""
        faults = self._file.faults(service_texts.NO_STATE_FILE, "restart goes idle")
        return (*filter(None, (self._load_fault,)), *faults)

    def load(self, clock_offset_s: float) -> MissionSnapshot | None:
        """Returns the snapshot; None without one. Logs an unusable file, moves a broken one aside.

        clock_offset_s: wall clock minus the machine's clock, now.
        """
        path = self._file.path
        try:
            with open_file(path) as file:
                return decoded(file.read(_LONGEST_BYTES), clock_offset_s)
        except FileNotFoundError:
            return None
        except OSError as error:
            _logger.warning("%s: not read: %s", path, error.strerror)
            self._load_fault = FileFault(
                reason=service_texts.STATE_UNREADABLE(), action="starting idle"
            )
        except ValueError:
            aside = path.with_suffix(".broken")
            _logger.warning("%s: no memory of this version, put aside as %s", path, aside)
            with contextlib.suppress(OSError):
                path.replace(aside)
            self._load_fault = FileFault(
                reason=service_texts.STATE_UNUSABLE(), action="starting idle"
            )
        return None

    def save(self, memory: MissionSnapshot, clock_offset_s: float) -> None:
        """Queues a snapshot for writing; of several that wait, only the newest is written."""
        self._file.put(encoded(memory, clock_offset_s))

    def close(self) -> None:
        """Waits a limited time for the pending write; after that the outdated file is removed."""
        if self._file.close():
            return
        path = self._file.path
        _logger.warning("%s: the last state is not written: the disk is too slow", path)
        # A removal needs no disk where the write waits for it; the process ends in any case.
        removal = threading.Thread(target=self._remove, name="outdated state", daemon=True)
        removal.start()
        removal.join(_REMOVAL_S)

    def _remove(self) -> None:
        for path in (self._file.beside, self._file.path):
            with contextlib.suppress(OSError):
                path.unlink(missing_ok=True)


def encoded(memory: MissionSnapshot, clock_offset_s: float) -> bytes:
    """Mission snapshot as JSON. clock_offset_s: wall clock minus the machine's clock."""
    since_s = memory.since_s + clock_offset_s
    return _FILE.dump_json(_File(memory=replace(memory, since_s=since_s)), indent=1)


def decoded(data: bytes, clock_offset_s: float) -> MissionSnapshot:
    """Mission snapshot of a file, on this machine's clock; ValueError if the file has none."""
    memory = _FILE.validate_json(data, strict=True).memory
    return replace(memory, since_s=memory.since_s - clock_offset_s)

"""A small file that is replaced whole, by a thread of its own: the control loop waits for no disk.

A new file is written beside it and renamed over it. A killed process or a loss of power leaves the
old file or the new one.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Callable
from pathlib import Path

from ..companion.safety.file_faults import FileFault, words
from ..texts.text_patterns import PilotText
from .background_writer import BackgroundWriter, Batches

_logger = logging.getLogger(__name__)


class WholeFile:
    """The file, and the thread that writes it. failed: called in it after a failed write.

    A failure is logged once, as a warning, until a write succeeds.
    """

    def __init__(self, path: Path, thread: str, failed: Callable[[], None] = lambda: None) -> None:
        self.path = path
        self.beside = path.with_name(f".{path.name}.new")
        """The new file, before it is renamed."""
        self._failed = failed
        self._error: OSError | None = None
        self._writer = BackgroundWriter(thread, self._write_loop)

    def faults(self, text: PilotText, action: str) -> tuple[FileFault, ...]:
        """Fault of the last write as this text; none after a write that succeeded."""
        error = self._error
        if error is None:
            return ()
        return (FileFault(reason=text(fault=words(error)), action=action),)

    def put(self, data: bytes) -> None:
        """Queues a content; of several that wait, only the newest is written."""
        self._writer.put(data)

    def close(self) -> bool:
        """Waits a limited time for the pending write; True if all is written."""
        return self._writer.close()

    def write(self, data: bytes) -> None:
        """Writes a content now; notes a failure."""
        try:
            self._replace(data)
        except OSError as error:
            level = logging.WARNING if self._error is None else logging.DEBUG
            self._error = error
            _logger.log(level, "%s: not written: %s", self.path, error.strerror)
            self._failed()
        else:
            self._error = None

    def _write_loop(self, batches: Batches) -> None:
        for batch in batches:
            (newest,) = batch[-1]
            self.write(newest)

    def _replace(self, data: bytes) -> None:
        with self.beside.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        self.beside.replace(self.path)
        _sync(self.path.parent)


def _sync(directory: Path) -> None:
    """Makes a rename survive a loss of power."""
    descriptor = os.open(directory, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)

"""File of the parameters that were set in flight: written whole, without blocking the control loop.

Its content, and how a process starts with it: `stored_parameters`.
"""

from __future__ import annotations

import logging
from pathlib import Path

from ..companion.safety.file_faults import FileFault, words
from ..settings.flight_parameters import FlightParameters
from ..texts import service_texts
from .background_writer import BackgroundWriter, Batches
from .snapshot_file import write_whole
from .stored_parameters import FILE_NAME, StartSettings, encoded

_logger = logging.getLogger(__name__)


class ParameterFile:
    """The file, and the thread that writes it."""

    def __init__(self, folder: Path, settings: StartSettings) -> None:
        self._path = folder / FILE_NAME
        self._settings = settings
        self._write_fault: FileFault | None = None
        self._writer = BackgroundWriter("parameters", self._write_loop)

    @property
    def faults(self) -> tuple[FileFault, ...]:
        """Current faults of the file; those of the start stay in the list."""
        return (*self._settings.faults, *filter(None, (self._write_fault,)))

    def keep(self, parameters: FlightParameters) -> None:
        """Queues the values for writing; of several that wait, only the newest are written."""
        self._writer.put(encoded(self._settings, parameters))

    def close(self) -> None:
        """Waits a limited time for the pending write."""
        self._writer.close()

    def _write_loop(self, batches: Batches) -> None:
        for batch in batches:
            (data,) = batch[-1]
            try:
                write_whole(self._path, data)
            except OSError as error:
                level = logging.WARNING if self._write_fault is None else logging.DEBUG
                reason = service_texts.NO_PARAMETER_FILE(fault=words(error))
                self._write_fault = FileFault(reason=reason, action="not kept")
                _logger.log(level, "%s: not written: %s", self._path, error.strerror)
            else:
                self._write_fault = None

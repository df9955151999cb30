"""The recording of the service: each cycle's packets, decisions and calls, for its writer."""

from __future__ import annotations

import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..companion.companion import Companion
from ..companion.reports import Decision
from ..settings.config import RecorderSettings
from .recorder import Recorder, RecordingLimits
from .recording.calls import Call, RecordedCompanion
from .recording.channels import Cycle, CycleSampler
from .recording.flight_log import FlightLog

_logger = logging.getLogger(__name__)


class CycleRecorder:
    """Records the cycles of a companion in a folder.

    settings: limits of its files. status: the present status. clock_offset_s: wall clock less the
    companion's clock.
    Raises OSError for a folder that cannot be written.
    """

    def __init__(
        self,
        folder: Path,
        settings: RecorderSettings,
        companion: Companion,
        status: Callable[[], dict[str, Any]],
        *,
        clock_offset_s: float,
        now_s: float,
    ) -> None:
        self._companion = companion
        self._status = status
        self._sampler = CycleSampler()
        self._recorder: Recorder[Cycle] = Recorder(
            folder,
            clock_offset_s,
            now_s,
            source=FlightLog(clock_offset_s),
            limits=RecordingLimits(
                part_bytes=1e6 * settings.part_mb,
                part_s=60.0 * settings.part_min,
                keep_bytes=1e9 * settings.keep_gb,
                floor_bytes=1e6 * settings.floor_mb,
            ),
        )
        _logger.info("recording to %s", self._recorder.folder)

    @property
    def folder(self) -> Path:
        """Folder of the recording."""
        return self._recorder.folder

    @property
    def ended(self) -> OSError | None:
        """Fault that has ended the recording; None while the recording continues."""
        return self._recorder.ended

    def record(
        self, now_s: float, sent: list[tuple[str, bytes]], decisions: list[Decision]
    ) -> None:
        """Passes the cycle at `now_s` to the writer; a fault ends the recording alone."""
        companion = self._companion
        received = companion.received_packets()
        calls = companion.calls() if isinstance(companion, RecordedCompanion) else []
        if self._recorder.ended is not None:
            return
        try:
            self._recorder.write(
                [*received, *((now_s, data) for _, data in sent)],
                ((item.time_s, item.kind, item.data) for item in decisions),
                self._cycle(calls, now_s),
                now_s,
            )
        except Exception as error:  # noqa: BLE001 - the flight goes on without a recording
            self._recorder.end(error)

    def _cycle(self, calls: list[Call], now_s: float) -> Cycle | None:
        if not calls:
            return None
        status = self._status() if self._sampler.status_is_due(now_s) else None
        return self._sampler.cycle(self._companion, calls, status, now_s)

    def close(self) -> None:
        """Writes what is queued and closes the files."""
        self._recorder.close()

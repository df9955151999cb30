"""The recording of the service: each cycle's packets, decisions and calls, for its writer."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..companion.companion import Companion
from ..companion.reports import Decision
from ..config import CompanionConfig
from ..recording.calls import RecordedCompanion
from ..recording.channels import Cycle, CycleSampler
from ..recording.flight_log import FlightLog
from .directories import recorder_folder

if TYPE_CHECKING:
    from ..outlets.recorder import Recorder

_logger = logging.getLogger(__name__)


class CycleRecorder:
    """Records the cycles of a companion; nothing where no folder is configured.

    clock_offset_s: wall clock less the companion's clock. status: the present status.
    """

    def __init__(
        self,
        config: CompanionConfig,
        companion: Companion,
        status: Callable[[], dict[str, Any]],
        *,
        clock_offset_s: float,
        now_s: float,
        stack: contextlib.AsyncExitStack,
    ) -> None:
        self._companion = companion
        self._status = status
        self._sampler = CycleSampler()
        self._recorder: Recorder[Cycle] | None = None
        folder, keys = recorder_folder(config), config.recorder
        if folder is None:
            return
        # Only a service that records imports the library of its files.
        from ..outlets.recorder import Recorder, RecordingLimits  # noqa: PLC0415

        try:
            self._recorder = Recorder(
                folder.path,
                clock_offset_s,
                now_s,
                source=FlightLog(clock_offset_s),
                limits=RecordingLimits(
                    part_bytes=1e6 * keys.part_mb,
                    part_s=60.0 * keys.part_min,
                    keep_bytes=1e9 * keys.keep_gb,
                    floor_bytes=1e6 * keys.floor_mb,
                ),
            )
        except OSError as error:
            raise folder.unwritable(error) from error
        stack.callback(self._recorder.close)
        _logger.info("recording to %s", self._recorder.folder)

    @property
    def folder(self) -> Path | None:
        """Folder of the recording; None without one."""
        return None if self._recorder is None else self._recorder.folder

    @property
    def ended(self) -> OSError | None:
        """Fault that has ended the recording; None while the recording continues."""
        return None if self._recorder is None else self._recorder.ended

    def record(
        self, now_s: float, sent: list[tuple[str, bytes]], decisions: list[Decision]
    ) -> None:
        """Passes the cycle at `now_s` to the writer."""
        companion, recorder, cycle = self._companion, self._recorder, None
        received = companion.received_packets()
        calls = companion.calls() if isinstance(companion, RecordedCompanion) else []
        if recorder is None or recorder.ended is not None:
            return
        if calls:
            status = self._status() if self._sampler.status_is_due(now_s) else None
            cycle = self._sampler.cycle(companion, calls, status, now_s)
        recorder.write(
            [*received, *((now_s, data) for _, data in sent)],
            ((item.time_s, item.kind, item.data) for item in decisions),
            cycle,
            now_s,
        )

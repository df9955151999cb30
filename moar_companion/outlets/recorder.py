"""The recorder: what was heard, sent and decided, in files that survive the flight.

    FOLDER/flight_20261121T114500Z/flight.tlog      packets of both directions, for ground stations
    FOLDER/flight_20261121T114500Z/decisions.jsonl  one JSON object a line: time_s, kind, data

A .tlog is a sequence of 8 bytes big-endian microseconds since 1970 and one raw packet. The
machine's times are turned into wall-clock times by the offset at the start, so that both files
agree even when the host's clock is set in flight. A full disk ends the recording, not the flight.
"""

from __future__ import annotations

import json
import logging
import struct
from collections.abc import Iterable
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

_logger = logging.getLogger(__name__)


class Recorder:
    """Two open files. clock_offset_s: wall clock minus the machine's clock."""

    def __init__(self, directory: Path, clock_offset_s: float, now_s: float) -> None:
        """Opens a new folder in `directory`; raises OSError when that cannot be done."""
        self._offset_s = clock_offset_s
        started = datetime.fromtimestamp(now_s + clock_offset_s, tz=timezone.utc)
        self.folder = directory / f"flight_{started:%Y%m%dT%H%M%S.%fZ}"
        self.folder.mkdir(parents=True)
        self._packets = (self.folder / "flight.tlog").open("wb")
        self._decisions = (self.folder / "decisions.jsonl").open("w", encoding="utf-8")
        self._failed = False

    def write(
        self,
        packets: Iterable[tuple[float, bytes]],
        decisions: Iterable[tuple[float, str, dict[str, Any]]],
    ) -> None:
        """Appends packets and decisions, each with the machine's time; never raises OSError."""
        if self._failed:
            return
        try:
            for time_s, packet in packets:
                stamp = struct.pack(">Q", round((time_s + self._offset_s) * 1e6))
                self._packets.write(stamp + packet)
            for time_s, kind, data in decisions:
                line = {"time_s": round(time_s + self._offset_s, 6), "kind": kind, "data": data}
                self._decisions.write(json.dumps(line, allow_nan=False) + "\n")
        except OSError as error:
            self._give_up(error)

    def flush(self) -> None:
        """Hands everything to the operating system, so that a killed process loses nothing."""
        if self._failed:
            return
        try:
            self._packets.flush()
            self._decisions.flush()
        except OSError as error:
            self._give_up(error)

    def close(self) -> None:
        """Flush and close."""
        self.flush()
        for file in (self._packets, self._decisions):
            try:
                file.close()
            except OSError as error:
                self._give_up(error)

    def _give_up(self, error: OSError) -> None:
        if not self._failed:
            self._failed = True
            _logger.warning("recording ended: %s: %s", self.folder, error.strerror)

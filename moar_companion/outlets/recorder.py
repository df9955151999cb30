"""The recorder: packets received and sent, and decisions, in files kept after the flight.

    FOLDER/flight_20261121T114500Z/flight.tlog      packets of both directions, for ground stations
    FOLDER/flight_20261121T114500Z/decisions.jsonl  one JSON object a line: time_s, kind, data

A .tlog is a sequence of 8 bytes big-endian microseconds since 1970 and one raw packet. The
machine's times are turned into wall-clock times by the offset at the start, so that both files
agree even when the host's clock is set in flight. A thread writes, so that a slow disk delays
nothing else. A disk that is full, or too slow for long, ends the recording and not the flight: the
recording has no gaps.
"""

from __future__ import annotations

import errno
import json
import logging
import os
import stat
import struct
from collections.abc import Iterable
from datetime import datetime, timezone
from functools import partial
from pathlib import Path
from typing import Any, BinaryIO

from .background_writer import BackgroundWriter, Batches

_PERIOD_S = 1.0
"""Longest part of a flight that a killed process loses."""
_MOST_BYTES = 8 * 1024 * 1024
"""Limit of the data that waits for the disk: more than a minute of a link at 921600 baud."""
_TOO_SLOW = "the disk is too slow"

_logger = logging.getLogger(__name__)


class Recorder:
    """Two files and the thread that writes them. clock_offset_s: wall clock minus machine's."""

    def __init__(self, directory: Path, clock_offset_s: float, now_s: float) -> None:
        """Opens a new folder in `directory`; raises OSError when that cannot be done."""
        self._offset_s = clock_offset_s
        started = datetime.fromtimestamp(now_s + clock_offset_s, tz=timezone.utc)
        self.folder = directory / f"flight_{started:%Y%m%dT%H%M%S.%fZ}"
        self.folder.mkdir(parents=True)
        packets = (self.folder / "flight.tlog").open("wb")
        decisions = (self.folder / "decisions.jsonl").open("wb")
        self.ended: OSError | None = None
        """Reason why the recording has ended; None while the flight is recorded."""
        self._writer = BackgroundWriter(
            "recorder",
            partial(self._write_loop, packets, decisions),
            period_s=_PERIOD_S,
            most_bytes=_MOST_BYTES,
        )

    def write(
        self,
        packets: Iterable[tuple[float, bytes]],
        decisions: Iterable[tuple[float, str, dict[str, Any]]],
    ) -> None:
        """Appends packets and decisions, each with the machine's time; waits for nothing."""
        if self.ended is not None:
            return
        stamped = b"".join(
            struct.pack(">Q", round((time_s + self._offset_s) * 1e6)) + packet
            for time_s, packet in packets
        )
        lines = "".join(self._line(*decision) for decision in decisions).encode()
        if (stamped or lines) and not self._writer.put(stamped, lines):
            self._end(OSError(errno.ETIMEDOUT, _TOO_SLOW))

    def close(self) -> None:
        """Waits a limited time for unwritten data, then closes."""
        if not self._writer.close():
            self._end(OSError(errno.ETIMEDOUT, _TOO_SLOW))

    def _line(self, time_s: float, kind: str, data: dict[str, Any]) -> str:
        line = {"time_s": round(time_s + self._offset_s, 6), "kind": kind, "data": data}
        return json.dumps(line, allow_nan=False) + "\n"

    def _write_loop(self, packets: BinaryIO, decisions: BinaryIO, batches: Batches) -> None:
        try:
            with packets, decisions:
                for batch in batches:
                    packets.writelines(stamped for stamped, _ in batch)
                    decisions.writelines(lines for _, lines in batch)
                    packets.flush()
                    decisions.flush()
                    _check_kept(packets)
        except OSError as error:
            self._end(error)

    def _end(self, why: OSError) -> None:
        if self.ended is None:
            self.ended = why
            _logger.warning("recording ended: %s: %s", self.folder, why.strerror or why)


def _check_kept(file: BinaryIO) -> None:
    """Raises FileNotFoundError for a file that was deleted while it is open."""
    kept = os.fstat(file.fileno())
    if stat.S_ISREG(kept.st_mode) and not kept.st_nlink:
        raise FileNotFoundError(errno.ENOENT, "the folder is gone")

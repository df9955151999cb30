"""The recorder: files of a flight, kept after the flight.

    FOLDER/flight_20261121T114500Z/flight.tlog      packets of both directions, for ground stations
    FOLDER/flight_20261121T114500Z/decisions.jsonl  one JSON object a line: time_s, kind, data
    FOLDER/flight_20261121T114500Z/flight.mcap      all of it, for Foxglove and for exact replay
    FOLDER/flight_20261121T114500Z/inspection.jsonl and beside it: pictures (`inspection_files`)

A .tlog is a sequence of 8 bytes big-endian microseconds since 1970 and one raw packet. The offset
at the start turns the machine's times into wall-clock times. All files therefore agree even when
the host's clock is set in flight. A long recording continues in a next part, in `flight-2.tlog` and
so on; the oldest recordings are removed when space is needed (`recorded_files`).

A thread encodes and writes, so that a slow disk delays nothing else. A disk that is full, or too
slow for long, ends the recording and not the flight: the recording has no gaps.
"""

from __future__ import annotations

import contextlib
import errno
import json
import logging
import os
import stat
import struct
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, BinaryIO, Generic, Protocol, TypeVar

from mcap.writer import CompressionType, Writer

from .background_writer import BackgroundWriter, Batches
from .inspection_files import InspectionFiles, rows_of
from .recorded_files import make_room, part_name

_PERIOD_S = 0.4
"""Period of writes; a killed process loses two of them at most: data of a stream may wait for its
next portion."""
_MOST_BYTES = 8 * 1024 * 1024
"""Limit of the data that waits for the disk: more than a minute of a link at 921600 baud."""
_CYCLE_BYTES = 1024
"""Waiting data of a cycle beyond its packets and decisions; roughly."""
_TOO_SLOW = "the disk is too slow"

_logger = logging.getLogger(__name__)
Item = TypeVar("Item")

TimedMessage = tuple[str, int, bytes]
"""Channel of the .mcap, nanoseconds since 1970, JSON."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RecordingLimits:
    """Limits of the recordings in a directory, in bytes and seconds.

    part: of one part's .mcap. keep: of all recordings. floor: of the disk's free space.
    """

    part_bytes: float
    part_s: float
    keep_bytes: float
    floor_bytes: float


NO_LIMITS = RecordingLimits(
    part_bytes=float("inf"), part_s=float("inf"), keep_bytes=float("inf"), floor_bytes=0.0
)


class McapSource(Protocol[Item]):
    """Makes the messages of an .mcap, in the recorder's thread."""

    @property
    def channels(self) -> Mapping[str, tuple[str, bytes]]:
        """By topic the name of its schema and the JSON schema."""

    @property
    def library(self) -> str:
        """The writer's name and versions, for the file's header."""

    def latched(self) -> Iterable[TimedMessage]:
        """Messages that each part begins with."""

    def messages(self, items: list[Item], *, last: bool) -> Iterable[TimedMessage]:
        """Messages of the given data. last: no data follow."""


class Recorder(Generic[Item]):
    """A flight's files and the thread that writes them. clock_offset_s: wall clock minus machine's.

    source: of the .mcap; None: there is none.
    """

    def __init__(
        self,
        directory: Path,
        clock_offset_s: float,
        now_s: float,
        *,
        source: McapSource[Item] | None = None,
        limits: RecordingLimits = NO_LIMITS,
    ) -> None:
        """Opens a new folder in `directory`; raises OSError when that cannot be done."""
        self._offset_s = clock_offset_s
        started = datetime.fromtimestamp(now_s + clock_offset_s, tz=timezone.utc)
        self.folder = directory / f"flight_{started:%Y%m%dT%H%M%S.%fZ}"
        self.folder.mkdir(parents=True)
        self._source = source
        self._limits = limits
        self._inspection = InspectionFiles(self.folder)
        first = _Part(self.folder, 1, source)
        self.ended: OSError | None = None
        """Reason why the recording has ended; None while the flight is recorded."""
        self._began_s = now_s
        self._writer = BackgroundWriter(
            "recorder",
            lambda batches: self._write_loop(first, batches),
            period_s=_PERIOD_S,
            most_bytes=_MOST_BYTES,
        )

    def write(
        self,
        packets: Iterable[tuple[float, bytes]],
        decisions: Iterable[tuple[float, str, dict[str, Any]]],
        item: Item | None = None,
        now_s: float = 0.0,
    ) -> None:
        """Appends packets and decisions, each with the machine's time; waits for nothing.

        item: for the source of the .mcap. now_s: the machine's time.
        """
        if self.ended is not None:
            return
        stamped = b"".join(
            struct.pack(">Q", round((time_s + self._offset_s) * 1e6)) + packet
            for time_s, packet in packets
        )
        taken = list(decisions)
        lines = "".join(self._line(*decision) for decision in taken).encode()
        size_bytes = len(stamped) + len(lines)
        if item is not None:
            size_bytes = 3 * size_bytes + _CYCLE_BYTES
        rows = rows_of(taken, self._offset_s)
        batch = (stamped, lines, item, now_s, rows)
        if size_bytes and not self._writer.put(*batch, size_bytes=size_bytes):
            self.end(OSError(errno.ETIMEDOUT, _TOO_SLOW))

    def end(self, error: Exception) -> None:
        """Ends the recording with one warning; the data written before stay."""
        if self.ended is None:
            if not isinstance(error, OSError):
                error = OSError(0, f"{type(error).__name__}: {error}")
            self.ended = error
            _logger.warning("recording ended: %s: %s", self.folder, error.strerror or error)

    def close(self) -> None:
        """Waits a limited time for unwritten data, then closes."""
        if not self._writer.close():
            self.end(OSError(errno.ETIMEDOUT, _TOO_SLOW))

    def _line(self, time_s: float, kind: str, data: dict[str, Any]) -> str:
        line = {"time_s": round(time_s + self._offset_s, 6), "kind": kind, "data": data}
        return json.dumps(line, allow_nan=False) + "\n"

    def _write_loop(self, part: _Part[Item], batches: Batches) -> None:
        try:
            self._keep_room(part)
            for batch in batches:
                part.write(batch)
                self._inspection.write([row for *_, rows in batch for row in rows])
                now_s = batch[-1][3]
                if part.size_bytes >= self._limits.part_bytes or (
                    now_s - self._began_s >= self._limits.part_s
                ):
                    part = part.next()
                    self._began_s = now_s
                    self._keep_room(part)
                elif _free_bytes(self.folder) < self._limits.floor_bytes:
                    self._keep_room(part)
            part.write([], last=True)
        except FileNotFoundError:
            self.end(FileNotFoundError(errno.ENOENT, "the folder is gone"))
        except Exception as error:  # noqa: BLE001 - the flight goes on without a recording
            self.end(error)
        finally:
            with contextlib.suppress(OSError):
                part.close()

    def _keep_room(self, part: _Part[Item]) -> None:
        """Removes the oldest recordings; raises OSError if that leaves too little room."""
        floor_bytes = self._limits.floor_bytes
        short_bytes = floor_bytes - _free_bytes(self.folder)
        make_room(self.folder.parent, part.paths, self._limits.keep_bytes, short_bytes)
        if _free_bytes(self.folder) < floor_bytes:
            raise OSError(errno.ENOSPC, f"less than {floor_bytes / 1e6:.0f} MB free")


class _Part(Generic[Item]):
    """The files of one part of a recording; raises OSError if they cannot be opened."""

    def __init__(self, folder: Path, number: int, source: McapSource[Item] | None) -> None:
        self._folder, self._number, self._source = folder, number, source
        names = ["flight.tlog", "decisions.jsonl", *(["flight.mcap"] if source else [])]
        self.paths = [folder / part_name(name, number) for name in names]
        self._packets, self._decisions, *others = (path.open("wb") for path in self.paths)
        self._packets_bytes = 0
        self._file: BinaryIO | None = others[0] if others else None
        self._mcap: _McapFile | None = None
        if source is not None and self._file is not None:
            self._mcap = _McapFile(self._file, source.channels, source.library)
            self._mcap.write(source.latched())

    @property
    def size_bytes(self) -> int:
        """Size of its greatest file."""
        return max(self._packets_bytes, 0 if self._file is None else self._file.tell())

    def write(self, batch: list[tuple[Any, ...]], *, last: bool = False) -> None:
        """Writes a batch to all files. last: no data follow."""
        self._packets.writelines(stamped for stamped, *_ in batch)
        self._packets_bytes += sum(len(stamped) for stamped, *_ in batch)
        self._decisions.writelines(lines for _, lines, *_ in batch)
        self._packets.flush()
        self._decisions.flush()
        if self._mcap is not None and self._source is not None:
            items = [item for _, _, item, *_ in batch if item is not None]
            self._mcap.write(self._source.messages(items, last=last))
        _check_kept(self._packets)

    def next(self) -> _Part[Item]:
        """Closes, and returns the next part."""
        self.close()
        return _Part(self._folder, self._number + 1, self._source)

    def close(self) -> None:
        """Closes the files, once; the .mcap gets its index."""
        if self._packets.closed:
            return
        with self._packets, self._decisions:
            if self._mcap is not None:
                self._mcap.close()


class _McapFile:
    """One .mcap: JSON messages on channels with schemas, whole at any moment up to its last flush.

    A flush ends a chunk, which any reader of MCAP can read without the rest. A file that was not
    closed has no index: readers scan it from its beginning.

    channels: by topic the name of its schema and the JSON schema.
    """

    def __init__(
        self, file: BinaryIO, channels: Mapping[str, tuple[str, bytes]], library: str
    ) -> None:
        self._file = file
        self._writer = Writer(file, compression=CompressionType.ZSTD)
        self._writer.start(profile="", library=library)
        schemas: dict[str, int] = {}
        self._ids: dict[str, int] = {}
        for topic, (name, schema) in channels.items():
            if name not in schemas:
                schemas[name] = self._writer.register_schema(name, "jsonschema", schema)
            self._ids[topic] = self._writer.register_channel(topic, "json", schemas[name])

    def write(self, messages: Iterable[TimedMessage]) -> None:
        """Adds messages, and flushes them to the file."""
        for topic, time_ns, content in messages:
            self._writer.add_message(self._ids[topic], time_ns, content, time_ns)
        self._writer.flush()  # type: ignore[no-untyped-call]

    def close(self) -> None:
        """Writes the index and closes."""
        with self._file:
            self._writer.finish()  # type: ignore[no-untyped-call]


def _free_bytes(folder: Path) -> float:
    """Free space for programs without root's rights."""
    disk = os.statvfs(folder)
    return float(disk.f_bavail * disk.f_frsize)


def _check_kept(file: BinaryIO) -> None:
    """Raises FileNotFoundError for a file that was deleted while it is open."""
    kept = os.fstat(file.fileno())
    if stat.S_ISREG(kept.st_mode) and not kept.st_nlink:
        raise FileNotFoundError

"""A .tlog's bytes to packets with their times. No I/O.

A record is 8 bytes of big-endian microseconds (since 1970, or since a start) and one raw packet,
MAVLink 1 or 2. Records with a broken packet are left out; where what follows is no record, the
next one is looked for.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from .codec import frame_size, is_sound

_MARKERS = re.compile(b"[\xfd\xfe]")
_STAMP_BYTES = 8
_MAX_STAMP_US = 1 << 52
"""The year 2112: what looks like a later time is none."""
_HEAD_BYTES = 65_536
"""A recording that has no sound packet within these is none."""


@dataclass(frozen=True, slots=True)
class Record:
    """One packet and when it was recorded, by the recorder's clock."""

    time_s: float
    packet: bytes


class Tlog:
    """The records of a .tlog; what was wrong with it is told once they have been read."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.bad_packets = 0
        """Records whose packet does not have its checksum."""
        self.skipped_bytes = 0
        """Bytes between records that belong to none."""
        self.cut_short = False
        """The last record is not whole."""

    @property
    def recognised(self) -> bool:
        """Whether it begins as a .tlog does: with a time before the first sound packet."""
        head = self._data[:_HEAD_BYTES]
        return not _sound_at(head, 0) and _next_record(head, 0) is not None

    def __iter__(self) -> Iterator[Record]:
        self.bad_packets = self.skipped_bytes = 0
        self.cut_short = False
        data, position, end = self._data, 0, len(self._data)
        while position < end:
            record = _record_at(data, position, end)
            if record is None:
                found = _next_record(data, position + 1)
                self.cut_short = found is None and _is_cut(data, position, end)
                if not self.cut_short:
                    self.skipped_bytes += (end if found is None else found) - position
                if found is None:
                    return
                position = found
                continue
            size, sound = record
            after = position + size
            if sound is False:
                self.bad_packets += 1
            else:
                stamp_us = int.from_bytes(data[position : position + _STAMP_BYTES], "big")
                yield Record(stamp_us * 1e-6, data[position + _STAMP_BYTES : after])
            position = after


def _record_at(data: bytes, position: int, end: int) -> tuple[int, bool | None] | None:
    """Length of the record that starts here, and whether its packet is sound; None: none does.

    A packet that cannot be checked, or is not sound, stands for a record if another follows it.
    """
    size = _framed(data, position, end)
    if size is None:
        return None
    sound = is_sound(data, position + _STAMP_BYTES)
    after = position + size
    if sound or after == end or _framed(data, after, end) or _is_cut(data, after, end):
        return size, sound
    return None


def _framed(data: bytes, position: int, end: int) -> int | None:
    """Length of the time and the whole frame that seem to start here; None without these."""
    frame = position + _STAMP_BYTES
    if frame >= end or data[frame] not in {0xFD, 0xFE}:
        return None
    if int.from_bytes(data[position:frame], "big") > _MAX_STAMP_US:
        return None
    size = frame_size(data, frame, end)
    return _STAMP_BYTES + size if size and frame + size <= end else None


def _is_cut(data: bytes, position: int, end: int) -> bool:
    """Whether the data end within the record that starts here."""
    frame = position + _STAMP_BYTES
    if frame >= end:
        return True
    if data[frame] not in {0xFD, 0xFE}:
        return False
    size = frame_size(data, frame, end)
    return size is None or frame + size > end


def _sound_at(data: bytes, frame: int) -> bool:
    """Whether a whole sound frame of a known message starts here."""
    end = len(data)
    if frame >= end or data[frame] not in {0xFD, 0xFE}:
        return False
    size = frame_size(data, frame, end)
    return bool(size) and frame + (size or 0) <= end and is_sound(data, frame) is True


def _next_record(data: bytes, position: int) -> int | None:
    """Where the next record with a sound packet starts, at `position` or later."""
    for marker in _MARKERS.finditer(data, position + _STAMP_BYTES):
        begin = marker.start() - _STAMP_BYTES
        if _sound_at(data, marker.start()) and _framed(data, begin, len(data)) is not None:
            return begin
    return None

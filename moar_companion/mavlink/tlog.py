"""Bytes of a .tlog to packets with their times. No I/O.

A record is 8 bytes of big-endian microseconds (since 1970, or since a start) and one raw packet,
MAVLink 1 or 2. The reader skips records with a broken packet, and bytes up to the next record.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass

from .codec import frame_size, is_sound

_MARKERS = re.compile(b"[\xfd\xfe]")
_STAMP_BYTES = 8
_MAX_STAMP_US = 1 << 52
"""Greatest plausible time: the year 2112."""
_HEAD_BYTES = 65_536
"""Head of a recording that must contain a valid packet."""


@dataclass(frozen=True, slots=True)
class Record:
    """One packet and the time of its recording, by the recorder's clock."""

    time_s: float
    packet: bytes


class Tlog:
    """Records of a .tlog; its errors are known once all records have been read."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self.bad_packets = 0
        """Count of records whose packet has a wrong checksum."""
        self.skipped_bytes = 0
        """Count of bytes between records."""
        self.cut_short = False
        """True if the last record is incomplete."""

    @property
    def recognised(self) -> bool:
        """True if the data start as a .tlog does: with a time before the first valid packet."""
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
    """Length of the record at `position`, and True if its packet is valid; None: no record.

    The flag is None for an unknown message. A packet that is unknown or invalid counts as a record
    if another record or the end of the data follows.
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
    """Length of the time and the whole frame that may start at `position`; None without them."""
    frame = position + _STAMP_BYTES
    if frame >= end or data[frame] not in {0xFD, 0xFE}:
        return None
    if int.from_bytes(data[position:frame], "big") > _MAX_STAMP_US:
        return None
    size = frame_size(data, frame, end)
    return _STAMP_BYTES + size if size and frame + size <= end else None


def _is_cut(data: bytes, position: int, end: int) -> bool:
    """Returns True if the data end within the record that starts at `position`."""
    frame = position + _STAMP_BYTES
    if frame >= end:
        return True
    if data[frame] not in {0xFD, 0xFE}:
        return False
    size = frame_size(data, frame, end)
    return size is None or frame + size > end


def _sound_at(data: bytes, frame: int) -> bool:
    """Returns True if a whole valid frame of a known message starts at `frame`."""
    end = len(data)
    if frame >= end or data[frame] not in {0xFD, 0xFE}:
        return False
    size = frame_size(data, frame, end)
    return bool(size) and frame + (size or 0) <= end and is_sound(data, frame) is True


def _next_record(data: bytes, position: int) -> int | None:
    """Start of the next record with a valid packet, at `position` or later; None: no more."""
    for marker in _MARKERS.finditer(data, position + _STAMP_BYTES):
        begin = marker.start() - _STAMP_BYTES
        if _sound_at(data, marker.start()) and _framed(data, begin, len(data)) is not None:
            return begin
    return None

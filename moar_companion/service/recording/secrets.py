"""Keys in received bytes: SETUP_SIGNING and AUTH_KEY are blanked before recording.

A blanked packet has the same length and the right checksum, so that a replay counts it as the
machine did. Its signature, if it has one, is not made again. On a stream the packet may arrive in
pieces: cycles wait, for one batch, for the last piece.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from ...mavlink.codec import SECRETS, checksum_of, frame_head, frame_size, is_sound
from .channels import Cycle

_MARKERS = re.compile(b"[\xfd\xfe]")
_LONGEST_BYTES = 280
"""Greatest MAVLink 2 packet, with its signature."""

_Place = tuple[int, int, int]
"""Index of a cycle, of a call in it, and of a portion of bytes in that."""


class Blanking:
    """Takes batches of cycles, and returns those without keys in their bytes."""

    def __init__(self) -> None:
        self._waiting: list[Cycle] = []

    def ready(self, cycles: list[Cycle], *, last: bool = False) -> list[Cycle]:
        """Cycles that can be recorded now, in order. last: all of them."""
        held, cycles = len(self._waiting), [*self._waiting, *cycles]
        streams: dict[Any, list[tuple[_Place, bytes]]] = {}
        for place, link, data, address in _portions(cycles):
            # A datagram has whole packets; the other bytes of a link are one stream.
            key = link if address is None else (link, place)
            streams.setdefault(key, []).append((place, data))
        changed: dict[_Place, bytes] = {}
        wait_from = len(cycles)
        for key, portions in streams.items():
            whole = b"".join(data for _, data in portions)
            blank, open_at = blanked(whole, final=last or not isinstance(key, str))
            position = 0
            for place, data in portions:
                after = position + len(data)
                if blank[position:after] != data:
                    changed[place] = bytes(blank[position:after])
                if open_at < after:
                    wait_from = min(wait_from, place[0])
                position = after
        if wait_from < held:
            return self.ready([], last=True) + self.ready(cycles[held:], last=last)
        for index in {place[0] for place in changed}:
            cycles[index] = _with(cycles[index], index, changed)
        self._waiting = cycles[wait_from:]
        return cycles[:wait_from]


def blanked(data: bytes, *, final: bool) -> tuple[bytes, int]:
    """Bytes without keys, and the start of an incomplete packet (otherwise the end).

    final: no bytes follow; a key that is cut short is then blanked to the end.
    """
    blank, end = bytearray(data), len(data)
    for marker in _MARKERS.finditer(data):
        at = marker.start()
        head = frame_head(data, at)
        if head is None:
            if not final:
                return bytes(blank), at
            continue
        message_id, start, length = head
        if message_id not in SECRETS or _is_payload(data, at):
            continue
        stop = start + length
        whole = at + (frame_size(data, at, end) or 0) <= end
        if not whole and not final:
            return bytes(blank), at
        sound = whole and is_sound(data, at)
        blank[start : min(stop, end)] = bytes(min(stop, end) - start)
        if sound:
            blank[stop : stop + 2] = checksum_of(blank, at)
    return bytes(blank), end


def _is_payload(data: bytes, at: int) -> bool:
    """True if a marker lies within a sound packet that begins before it."""
    end = len(data)
    for marker in _MARKERS.finditer(data, max(0, at - _LONGEST_BYTES), at):
        begin = marker.start()
        size = frame_size(data, begin, end)
        if size and at < begin + size <= end and is_sound(data, begin):
            return True
    return False


def _portions(cycles: list[Cycle]) -> Iterator[tuple[_Place, str, bytes, Any]]:
    """Received bytes in order: place, link, bytes, address."""
    for index, cycle in enumerate(cycles):
        for number, call in enumerate(cycle.calls):
            if call.method == "take_in":
                for portion, (_, link, data, address) in enumerate(call.arguments[0]):
                    yield (index, number, portion), link, data, address
            elif call.method == "receive":
                link, data, _, *address = call.arguments
                yield (index, number, 0), link, data, address[0] if address else None


def _with(cycle: Cycle, index: int, changed: dict[_Place, bytes]) -> Cycle:
    """A cycle with other bytes in some places."""
    calls = []
    for number, call in enumerate(cycle.calls):
        if call.method == "take_in":
            arrived, now_s = call.arguments
            kept = tuple(
                (time_s, link, changed.get((index, number, portion), data), address)
                for portion, (time_s, link, data, address) in enumerate(arrived)
            )
            calls.append(replace(call, arguments=(kept, now_s)))
        elif call.method == "receive":
            link, data, *rest = call.arguments
            data = changed.get((index, number, 0), data)
            calls.append(replace(call, arguments=(link, data, *rest)))
        else:
            calls.append(call)
    return replace(cycle, calls=calls)

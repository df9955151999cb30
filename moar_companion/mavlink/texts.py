"""STATUSTEXT: what people are told, in chunks, and not over and over. No I/O."""

from __future__ import annotations

import enum

from .dialect import Message, create

CHUNK_BYTES = 50
_MAX_BYTES = 1000
"""Nobody reads more of one message on a ground station."""
_REPEAT_S = 10.0


class Severity(enum.IntEnum):
    """MAV_SEVERITY, as far as we use it."""

    CRITICAL = 2
    """A primary failure."""
    ERROR = 3
    """A secondary failure."""
    WARNING = 4
    NOTICE = 5
    INFO = 6


class StatusTexts:
    """Texts to STATUSTEXT messages; the same text is not sent again within 10 s."""

    def __init__(self) -> None:
        self._sent_s: dict[str, float] = {}
        self._last_id = 0

    def messages(self, severity: Severity, text: str, now_s: float) -> list[Message]:
        """The chunks of a text, none when it was sent within the last 10 s.

        Up to 50 characters go as one message with id 0; more as chunks of 50 with an id and a
        chunk_seq, the last of which has a NUL in it. What is not ASCII becomes a question mark.
        """
        self._sent_s = {
            known: sent_s for known, sent_s in self._sent_s.items() if now_s - sent_s < _REPEAT_S
        }
        if text in self._sent_s:
            return []
        self._sent_s[text] = now_s
        data = text.encode("ascii", errors="replace")[:_MAX_BYTES]
        if len(data) <= CHUNK_BYTES:
            return [_chunk(severity, data, text_id=0, sequence=0)]
        self._last_id = self._last_id % 65535 + 1
        return [
            _chunk(severity, data[start : start + CHUNK_BYTES], self._last_id, sequence)
            for sequence, start in enumerate(range(0, len(data) + 1, CHUNK_BYTES))
        ]


def _chunk(severity: Severity, data: bytes, text_id: int, sequence: int) -> Message:
    return create("STATUSTEXT", severity=int(severity), text=data, id=text_id, chunk_seq=sequence)

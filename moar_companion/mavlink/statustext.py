"""STATUSTEXT: short texts for operators without repeats, and texts of other senders. No I/O."""

from __future__ import annotations

import enum
import re
from typing import NamedTuple

from ..texts.text_format import TEXT_CHARS as CHUNK_BYTES
from ..texts.text_format import printable
from .dialect import Message, create

_MAX_BYTES = 1000
"""Limit of one text: an operator reads no more on a ground station."""
_REPEAT_S = 10.0
_NEWS_REPEAT_S = 1.0
_MOST_REMEMBERED = 256
"""Limit of stored texts, far more than 10 s of them. Beyond it the oldest may be repeated."""
_VALUE = re.compile(r"-?\d+\.\d+|\d+(?= ?(?:s|m|%|m/s)(?!\w))")
"""Measured number, as opposed to a number in a name."""

_SEVERITIES = ("emergency", "alert", "critical", "error", "warning", "notice", "info", "debug")
"""Names of MAV_SEVERITY."""


class Severity(enum.IntEnum):
    """Values of MAV_SEVERITY that the companion uses."""

    CRITICAL = 2
    """A primary failure."""
    ERROR = 3
    """A secondary failure."""
    WARNING = 4
    NOTICE = 5
    INFO = 6


class StatusTexts:
    """Texts to STATUSTEXT messages; repeats within 10 s are dropped, unless they are new.

    Texts that differ in measured values only are repeats. A text for one link belongs to an answer
    there, and is sent with each: the answers' own rate is limited.
    """

    def __init__(self) -> None:
        self._sent_s: dict[str, float] = {}
        """Time of the last sending to all links by text; the oldest first."""
        self._last_id = 0

    def messages(
        self,
        severity: Severity,
        text: str,
        now_s: float,
        *,
        is_new: bool = False,
        link: str | None = None,
    ) -> list[Message]:
        """Returns the chunks of a text; none if the same was sent within the last 10 s.

        link: the only link; None: all. is_new: the text reports a change, for example that a held
        mission resumes. Such a text is sent again, unless it was the last one and less than a
        second ago.

        Up to 50 characters are one message with id 0; more are chunks with an id and a chunk_seq,
        cut between words (`_chunks`). Characters outside ASCII become question marks.
        """
        if link is None and self._is_repeat(text, is_new, now_s):
            return []
        data = text.encode("ascii", errors="replace")[:_MAX_BYTES]
        if len(data) <= CHUNK_BYTES:
            return [_chunk(severity, data, text_id=0, sequence=0)]
        self._last_id = self._last_id % 65535 + 1
        return [
            _chunk(severity, chunk, self._last_id, sequence)
            for sequence, chunk in enumerate(_chunks(data))
        ]

    def _is_repeat(self, text: str, is_new: bool, now_s: float) -> bool:
        self._forget_old(now_s)
        same = _VALUE.sub("#", text)
        if same in self._sent_s and not (is_new and self._is_due(same, now_s)):
            return True
        self._sent_s.pop(same, None)
        self._sent_s[same] = now_s
        return False

    def _forget_old(self, now_s: float) -> None:
        """Drops old texts, each once, so that the cost per text is constant."""
        while self._sent_s:
            oldest = next(iter(self._sent_s))
            recent = now_s - self._sent_s[oldest] < _REPEAT_S
            if recent and len(self._sent_s) < _MOST_REMEMBERED:
                return
            del self._sent_s[oldest]

    def _is_due(self, same: str, now_s: float) -> bool:
        last = next(reversed(self._sent_s))
        return same != last or now_s - self._sent_s[same] >= _NEWS_REPEAT_S


class ReceivedText(NamedTuple):
    """Whole text of one sender. severity: name of its MAV_SEVERITY."""

    severity: str
    text: str


class ReceivedTexts:
    """STATUSTEXT messages to texts: joins the chunks of one sender."""

    def __init__(self) -> None:
        self._text_id = 0
        self._severity = 0
        self._chunks: list[str] = []

    def handle(self, message: Message) -> list[ReceivedText]:
        """Returns the texts that this chunk completes; a text without its end ends at the next."""
        done = []
        if self._chunks and message.id != self._text_id:
            done += self.rest()
        self._text_id, self._severity = message.id, message.severity
        self._chunks.append(message.text)
        if message.id == 0 or len(message.text) < CHUNK_BYTES:
            done += self.rest()
        return done

    def rest(self) -> list[ReceivedText]:
        """Returns the received part of an incomplete text."""
        text = " ".join(printable("".join(self._chunks)).split())
        self._chunks = []
        return [ReceivedText(severity=_severity_word(self._severity), text=text)] if text else []


def _chunks(data: bytes) -> list[bytes]:
    """Chunks of a text, which cut no word or number of fewer than 50 characters.

    A chunk of fewer than 50 bytes ends a text, so the others are filled with blanks. Their last
    byte before the next word is a blank: a ground station that joins the chunks shows no two words
    as one, and one that shows each by itself shows whole words.
    """
    chunks = []
    while len(data) >= CHUNK_BYTES:
        end = data.rfind(b" ", 0, CHUNK_BYTES) + 1 or CHUNK_BYTES
        chunks.append(data[:end].ljust(CHUNK_BYTES))
        data = data[end:]
    return [*chunks, data]


def _severity_word(severity: int) -> str:
    return _SEVERITIES[severity] if severity < len(_SEVERITIES) else f"severity {severity}"


def _chunk(severity: Severity, data: bytes, text_id: int, sequence: int) -> Message:
    return create("STATUSTEXT", severity=int(severity), text=data, id=text_id, chunk_seq=sequence)

"""STATUSTEXT: what people are told, short and not over and over; what others tell. No I/O."""

from __future__ import annotations

import enum
import re
from dataclasses import dataclass

from .dialect import Message, create

CHUNK_BYTES = 50
_MAX_BYTES = 1000
"""Nobody reads more of one message on a ground station."""
_OURS = "MOAR: "
_NAME_CHARS = 16
_CUT = ".."
_DETAIL = re.compile(r"\s*\([^()]*\)")
_MACHINE_WORD = re.compile(r"(?<=[a-z])_(?=[a-z])")
"""In `at_target`; parameters, as GF_MAX_HOR_DIST, keep their names."""
_REPEAT_S = 10.0
_NEWS_REPEAT_S = 1.0
_MOST_REMEMBERED = 256
"""Texts; far more than are said in 10 s. Beyond it the oldest is forgotten, and may be repeated."""
_VALUE = re.compile(r"-?\d+\.\d+|\d+(?= ?(?:s|m|%|m/s)(?!\w))")
"""A number of something measured, which is no other thing's name."""

_SEVERITIES = ("emergency", "alert", "critical", "error", "warning", "notice", "info", "debug")
"""MAV_SEVERITY in words."""


class Severity(enum.IntEnum):
    """MAV_SEVERITY, as far as we use it."""

    CRITICAL = 2
    """A primary failure."""
    ERROR = 3
    """A secondary failure."""
    WARNING = 4
    NOTICE = 5
    INFO = 6


def pilot_text(reason: str, action: str = "") -> str:
    """A text for pilots that fits into one chunk: `MOAR: wind 12.3 m/s > 10, holding`.

    reason: what is wrong, value and limit; details in parentheses are for the record. action: what
    the companion does.
    """
    tail = f", {action}" if action else ""
    return f"{_OURS}{_shortened(reason, CHUNK_BYTES - len(_OURS) - len(tail))}{tail}"


def short_name(name: str) -> str:
    """The name of a target or an obstacle, cut so that there is room for what is said of it."""
    return name if len(name) <= _NAME_CHARS else name[: _NAME_CHARS - len(_CUT)].rstrip() + _CUT


def _shortened(reason: str, room: int) -> str:
    """Without details; where that is too long, long names are cut, then clauses, then words."""
    before = ""
    while before != reason:  # details may have details
        before, reason = reason, _DETAIL.sub("", reason)
    words = _MACHINE_WORD.sub(" ", reason).split()
    if len(" ".join(words)) > room:
        words = [short_name(word) for word in words]
    text = " ".join(words)
    for separator in (", ", " "):
        while len(text) > room and separator in text:
            text = text.rpartition(separator)[0].rstrip(",;:")
    return text[:room]


class StatusTexts:
    """Texts to STATUSTEXT messages; the same not again within 10 s, unless it is news.

    Texts that differ in measured values only are the same.
    """

    def __init__(self) -> None:
        self._sent_s: dict[tuple[str | None, str], float] = {}
        """When a text was last sent, by its link (None: all links); the oldest first."""
        self._last_id = 0

    def messages(
        self,
        severity: Severity,
        text: str,
        now_s: float,
        *,
        news: bool = False,
        link: str | None = None,
    ) -> list[Message]:
        """The chunks of a text, none when the same was sent within the last 10 s.

        link: for which it is; None: for all. What is told on one counts for that one alone.
        news: it says that something has changed, or answers somebody, and is sent again unless it
        was said within a second and nothing else since: a mission that was held flies again.

        Up to 50 characters go as one message with id 0; more as chunks of 50 with an id and a
        chunk_seq, the last of which has a NUL in it. What is not ASCII becomes a question mark.
        """
        self._forget_old(now_s)
        same = (link, _VALUE.sub("#", text))
        if same in self._sent_s and not (news and self._is_news(same, now_s)):
            return []
        self._sent_s.pop(same, None)
        self._sent_s[same] = now_s
        data = text.encode("ascii", errors="replace")[:_MAX_BYTES]
        if len(data) <= CHUNK_BYTES:
            return [_chunk(severity, data, text_id=0, sequence=0)]
        self._last_id = self._last_id % 65535 + 1
        return [
            _chunk(severity, data[start : start + CHUNK_BYTES], self._last_id, sequence)
            for sequence, start in enumerate(range(0, len(data) + 1, CHUNK_BYTES))
        ]

    def _forget_old(self, now_s: float) -> None:
        """Each text is forgotten once, so that this costs the same however much is said."""
        while self._sent_s:
            oldest = next(iter(self._sent_s))
            recent = now_s - self._sent_s[oldest] < _REPEAT_S
            if recent and len(self._sent_s) < _MOST_REMEMBERED:
                return
            del self._sent_s[oldest]

    def _is_news(self, same: tuple[str | None, str], now_s: float) -> bool:
        last = next(reversed(self._sent_s))
        return same != last or now_s - self._sent_s[same] >= _NEWS_REPEAT_S


@dataclass(frozen=True, slots=True, kw_only=True)
class HeardText:
    """A whole text of one speaker. severity: MAV_SEVERITY in a word."""

    severity: str
    text: str


class HeardTexts:
    """STATUSTEXT messages to texts: the chunks of one speaker joined."""

    def __init__(self) -> None:
        self._text_id = 0
        self._severity = 0
        self._chunks: list[str] = []

    def hear(self, message: Message) -> list[HeardText]:
        """The texts that this chunk completes; one whose end is lost ends where another begins."""
        done = []
        if self._chunks and message.id != self._text_id:
            done += self.rest()
        self._text_id, self._severity = message.id, message.severity
        self._chunks.append(message.text)
        if message.id == 0 or len(message.text) < CHUNK_BYTES:
            done += self.rest()
        return done

    def rest(self) -> list[HeardText]:
        """What has been heard of a text whose end is missing."""
        shown = "".join(char if char.isprintable() else " " for char in "".join(self._chunks))
        text = " ".join(shown.split())
        self._chunks = []
        return [HeardText(severity=_severity_word(self._severity), text=text)] if text else []


def _severity_word(severity: int) -> str:
    return _SEVERITIES[severity] if severity < len(_SEVERITIES) else f"severity {severity}"


def _chunk(severity: Severity, data: bytes, text_id: int, sequence: int) -> Message:
    return create("STATUSTEXT", severity=int(severity), text=data, id=text_id, chunk_seq=sequence)

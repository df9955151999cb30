"""A sender's clock as its packets tell it: what is late, what is ahead, what is another clock.

Pure steps: a stamp and the time of its arrival in, a `Reading` out.

The clock's line is where its packets would be if none were delayed. A packet may arrive later than
on the line, in order; one that is older than the last is late. One that is ahead of the line, or
late for long enough while nothing on the line arrives, belongs to another clock: that of a sender
that has restarted, once it has run on by itself. A single packet never moves the line there.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

AHEAD_S = 0.5
"""Delays do not put a packet ahead of the line, but for the first ones, which set it. What is taken
hides its elders for as long as it is ahead: no longer than a position may be old."""
FOREIGN_S = 5.0
"""No link is so late when a line begins that the packets after it are farther ahead."""
_CONFIRMED_S = 0.3
"""So long another clock must run on, with nothing of the old one in between. PX4 sends 100 stamps
in that time, ArduPilot 30; a restart is silent for as long or longer (measured: 0.3 s, 1.2 s)."""
_RATE_S = 0.5
"""By how much a clock may advance more or less than ours between two packets: their delays."""


class Reading(enum.Enum):
    """What a stamp tells."""

    CURRENT = "no older than the last"
    LATE = "older than the last, or ahead: not to be taken"
    FOREIGN = "so far ahead that it is of another clock: not to be taken"
    RESTARTED = "the clock is another one now"


@dataclass(frozen=True, slots=True, kw_only=True)
class _Other:
    """Packets that are not on the line, one after the other."""

    since_s: float
    stamp_s: float
    arrived_s: float


class SourceClock:
    """Follows one clock.

    round_s: after which the stamps begin anew at 0. behind_s: how much older than the last a stamp
    may be, where several modules stamp.
    """

    def __init__(self, *, round_s: float = math.inf, behind_s: float = 0.0) -> None:
        self._round_s = round_s
        self._behind_s = behind_s
        self._last: tuple[float, float] | None = None
        """The newest stamp, and when it arrived."""
        self._delay_s = 0.0
        """How much later than on the line that was."""
        self._other: _Other | None = None

    def reset(self) -> None:
        """Forgets the clock."""
        self._last = self._other = None

    def read(self, stamp_s: float, now_s: float) -> Reading:
        """Takes a stamp that has arrived now."""
        if self._last is None:
            self._begin(stamp_s, now_s)
            return Reading.CURRENT
        passed_s, lead_s = self._compared(*self._last, stamp_s, now_s)
        if passed_s >= -self._behind_s and lead_s <= AHEAD_S:
            self._other = None
            if passed_s >= 0.0:
                self._last = stamp_s, now_s
                self._delay_s = max(0.0, -lead_s)
            return Reading.CURRENT
        caught_up = passed_s >= 0.0 and lead_s <= FOREIGN_S
        if self._is_confirmed(stamp_s, now_s):
            self._begin(stamp_s, now_s)
            return Reading.CURRENT if caught_up else Reading.RESTARTED
        return Reading.FOREIGN if lead_s > FOREIGN_S else Reading.LATE

    def is_ahead(self, stamp_s: float, now_s: float) -> bool:
        """Whether a stamp that has arrived now is ahead of the line; it is not taken."""
        if self._last is None:
            return False
        return self._compared(*self._last, stamp_s, now_s)[1] > AHEAD_S

    def passed_s(self, before_s: float, after_s: float) -> float:
        """The time from one stamp to another: negative when the other one is older."""
        passed_s = after_s - before_s
        if self._round_s == math.inf:
            return passed_s
        return (passed_s + 0.5 * self._round_s) % self._round_s - 0.5 * self._round_s

    def _compared(
        self, last_s: float, arrived_s: float, stamp_s: float, now_s: float
    ) -> tuple[float, float]:
        """The time since the newest stamp, and how far the stamp is ahead of the line."""
        passed_s = self.passed_s(last_s, stamp_s)
        return passed_s, passed_s - (now_s - arrived_s) - self._delay_s

    def _begin(self, stamp_s: float, now_s: float) -> None:
        self._last, self._delay_s, self._other = (stamp_s, now_s), 0.0, None

    def _is_confirmed(self, stamp_s: float, now_s: float) -> bool:
        """Whether this and those before it run on as a clock does."""
        other = self._other
        if other is not None:
            passed_s, elapsed_s = self.passed_s(other.stamp_s, stamp_s), now_s - other.arrived_s
            if passed_s < -self._behind_s or abs(passed_s - elapsed_s) > _RATE_S + self._behind_s:
                other = None
        since_s = now_s if other is None else other.since_s
        self._other = _Other(since_s=since_s, stamp_s=stamp_s, arrived_s=now_s)
        return now_s - since_s >= _CONFIRMED_S

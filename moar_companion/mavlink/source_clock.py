"""Clock of a sender, from the stamps of its packets: detects late packets, jumps and restarts.

Pure steps: a stamp and the time of its arrival in, a `Reading` out.

The clock's line is the arrival of its packets without delay. A packet may arrive after the line, in
order; a packet older than the last one is late. Packets ahead of the line, or late for some time
while none on the line arrives, belong to another clock. Once that clock has advanced by itself, it
is the clock of a restarted sender. A single packet never moves the line to it. A clock that
advances far behind the line, while packets on the line arrive, is another sender's.
"""

from __future__ import annotations

import enum
import math
from typing import NamedTuple

AHEAD_S = 0.5
"""Greatest accepted lead over the line. Only the first packets, which set the line, make later ones
lead. An accepted packet hides older ones for its lead: no longer than a position may be old."""
FOREIGN_S = 5.0
"""Lead or lag that no link's delay explains: the packet belongs to another clock."""
_CONFIRMED_S = 0.3
"""Time for which another clock must advance without a packet of the old one. PX4 sends 100 stamps
in that time, ArduPilot 30; a restart is silent for as long or longer (measured: 0.3 s, 1.2 s)."""
_BESIDE_S = 2.0
"""Time for which a clock must advance beside the line: a frozen one has fallen back by then."""
_BESIDE_GAP_S = 12.0
"""Greatest interval of a clock that runs beside: TIMESYNC of an ArduPilot without streams, 10 s."""
_DRIFT = 1e-3
"""Greatest difference of two clocks' rates; NTP slews one by half of that."""
_RATE_S = 0.5
"""Greatest difference of advance to the companion's clock between two packets, by their delays."""


class Reading(enum.Enum):
    """Meaning of a stamp."""

    CURRENT = "no older than the last"
    LATE = "older than the last, or ahead: not to be taken"
    FOREIGN = "of another clock, far ahead or running on far behind: not to be taken"
    RESTARTED = "the clock is another one now"


class _Other(NamedTuple):
    """Sequence of packets off the line.

    first_s, first_stamp_s: its beginning. since_s: the first of them after the last packet on the
    line; None if the last packet was on the line.
    """

    first_s: float
    first_stamp_s: float
    since_s: float | None
    stamp_s: float
    arrived_s: float


class SourceClock:
    """Tracker of one clock.

    round_s: wrap of the stamps. behind_s: greatest lag of a stamp behind the last one, for senders
    with several modules.
    """

    def __init__(self, *, round_s: float = math.inf, behind_s: float = 0.0) -> None:
        self._round_s = round_s
        self._behind_s = behind_s
        self._last: tuple[float, float] | None = None
        """Newest stamp, and the time of its arrival."""
        self._delay_s = 0.0
        """Delay of that arrival behind the line."""
        self._other: _Other | None = None

    def reset(self) -> None:
        """Resets the clock to unknown."""
        self._last = self._other = None

    def read(self, stamp_s: float, now_s: float) -> Reading:
        """Takes a stamp that has arrived now."""
        if self._last is None:
            self._begin(stamp_s, now_s)
            return Reading.CURRENT
        passed_s, lead_s = self._compared(*self._last, stamp_s, now_s)
        if passed_s >= -self._behind_s and lead_s <= AHEAD_S:
            if self._other is not None:
                self._other = self._other._replace(since_s=None)
            if passed_s >= 0.0:
                self._last = stamp_s, now_s
                self._delay_s = max(0.0, -lead_s)
            return Reading.CURRENT
        caught_up = passed_s >= 0.0 and lead_s <= FOREIGN_S
        since_s = self._advanced(stamp_s, now_s)
        if now_s - since_s >= _CONFIRMED_S:
            self._begin(stamp_s, now_s)
            return Reading.CURRENT if caught_up else Reading.RESTARTED
        beside = lead_s < -FOREIGN_S and self._runs_beside(stamp_s, now_s)
        return Reading.FOREIGN if beside or lead_s > FOREIGN_S else Reading.LATE

    def is_ahead(self, stamp_s: float, now_s: float) -> bool:
        """Returns True if a stamp that arrives now is ahead of the line; does not take it."""
        if self._last is None:
            return False
        return self._compared(*self._last, stamp_s, now_s)[1] > AHEAD_S

    def passed_s(self, before_s: float, after_s: float) -> float:
        """Time from one stamp to another: negative if the other one is older."""
        passed_s = after_s - before_s
        if self._round_s == math.inf:
            return passed_s
        return (passed_s + 0.5 * self._round_s) % self._round_s - 0.5 * self._round_s

    def _compared(
        self, last_s: float, arrived_s: float, stamp_s: float, now_s: float
    ) -> tuple[float, float]:
        """Time since the newest stamp, and lead of the stamp over the line."""
        passed_s = self.passed_s(last_s, stamp_s)
        return passed_s, passed_s - (now_s - arrived_s) - self._delay_s

    def _begin(self, stamp_s: float, now_s: float) -> None:
        self._last, self._delay_s, self._other = (stamp_s, now_s), 0.0, None

    def _advanced(self, stamp_s: float, now_s: float) -> float:
        """Takes a stamp off the line. Returns the time since which only such stamps advance."""
        first_s, first_stamp_s, since_s = now_s, stamp_s, now_s
        other = self._other
        if other is not None:
            passed_s, elapsed_s = self.passed_s(other.stamp_s, stamp_s), now_s - other.arrived_s
            apart_s = abs(passed_s - elapsed_s)
            if passed_s >= -self._behind_s and apart_s <= _RATE_S + self._behind_s:
                if elapsed_s <= _BESIDE_GAP_S:
                    first_s, first_stamp_s = other.first_s, other.first_stamp_s
                since_s = now_s if other.since_s is None else other.since_s
        self._other = _Other(
            first_s=first_s,
            first_stamp_s=first_stamp_s,
            since_s=since_s,
            stamp_s=stamp_s,
            arrived_s=now_s,
        )
        return since_s

    def _runs_beside(self, stamp_s: float, now_s: float) -> bool:
        """Returns True if the stamps off the line have advanced beside it for long enough."""
        other = self._other
        if other is None or now_s - other.first_s < _BESIDE_S:
            return False
        advance_s = self.passed_s(other.first_stamp_s, stamp_s)
        elapsed_s = now_s - other.first_s
        return abs(advance_s - elapsed_s) <= _RATE_S + _DRIFT * elapsed_s

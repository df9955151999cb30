"""How late the autopilot's words are: TIMESYNC requests to it, and how long its answers take.

An answer waits in the same queues as telemetry, so that a link that falls behind shows itself,
whatever the autopilot's clock does: a simulator's may run at any speed. No I/O.
Source: https://mavlink.io/en/services/timesync.html.
"""

from __future__ import annotations

import math
from collections import deque

from .dialect import Message, create, mavlink

_TIMESYNC = int(mavlink.MAVLINK_MSG_ID_TIMESYNC)
_PERIOD_S = 0.125
_ANSWERS = 2
"""One late answer may have been the autopilot's own idleness."""
_LOST_S = 3.0
"""Of 24 questions one is answered, even on a link that loses 30 % each way: but for one time in
10^7."""
_WAITING = 480
"""Requests that may still be answered: a minute's."""


class RoundTrips:
    """Asks the autopilot now and then, and remembers how long the last answers took."""

    def __init__(self) -> None:
        self._asked_s: deque[tuple[int, float]] = deque(maxlen=_WAITING)
        """Their ts1, and when."""
        self._last_s: deque[float] = deque(maxlen=_ANSWERS)
        self.shortest_s = math.inf
        """Of all answers so far."""
        self._due_s = -math.inf

    def least_s(self, now_s: float) -> float | None:
        """The shorter of the last two; None while fewer were answered.

        Once answers were heard, what is not answered for long is under way for that long.
        """
        if len(self._last_s) < _ANSWERS:
            return None
        least_s = min(self._last_s)
        waited_s = now_s - self._asked_s[0][1] if self._asked_s else 0.0
        return max(least_s, waited_s) if waited_s >= _LOST_S else least_s

    def next_request(self, target: tuple[int, int], now_s: float) -> Message | None:
        """The request that is due now, to this system and component."""
        if now_s < self._due_s:
            return None
        self._due_s = now_s + _PERIOD_S
        stamp = max(1, int(now_s * 1e9))
        self._asked_s.append((stamp, now_s))
        return create(
            "TIMESYNC", tc1=0, ts1=stamp, target_system=target[0], target_component=target[1]
        )

    def hear(self, message: Message, now_s: float) -> None:
        """Takes a message of the autopilot; answers come in the order of their requests."""
        if message.get_msgId() != _TIMESYNC or message.tc1 == 0:
            return
        asked_s = next((time_s for stamp, time_s in self._asked_s if stamp == message.ts1), None)
        if asked_s is None:
            return
        while self._asked_s and self._asked_s[0][1] <= asked_s:
            self._asked_s.popleft()
        self._last_s.append(now_s - asked_s)
        self.shortest_s = min(self.shortest_s, now_s - asked_s)

"""Delay of the autopilot's messages: TIMESYNC requests and the round-trip times of the answers.

An answer waits in the same queues as telemetry, so that it shows a link that falls behind. The
autopilot's clock has no influence: a simulator's may run at any speed. No I/O.
Source: https://mavlink.io/en/services/timesync.html.
"""

from __future__ import annotations

import math
from collections import deque

from .dialect import Message, create, mavlink

_TIMESYNC = int(mavlink.MAVLINK_MSG_ID_TIMESYNC)
_PERIOD_S = 0.125
_ANSWERS = 2
"""Answers of which the shortest counts: one may be late for the autopilot's own delay."""
_LOST_S = 3.0
"""Time for 24 requests: on a link that loses 30 % each way, one of them is answered except for one
time in 10^7."""
_WAITING = 480
"""Requests that may still be answered: one minute of them."""


class TimesyncRtt:
    """Sends periodic TIMESYNC requests and keeps the round-trip times of the last answers."""

    def __init__(self) -> None:
        self._asked_s: deque[tuple[int, float]] = deque(maxlen=_WAITING)
        """ts1 and time of the open requests."""
        self._last_s: deque[float] = deque(maxlen=_ANSWERS)
        self.shortest_s = math.inf
        """Shortest round trip so far."""
        self._due_s = -math.inf

    def least_s(self, now_s: float) -> float | None:
        """Shorter of the last two round trips; None before two answers.

        A request unanswered for 3 s or more counts with its waiting time.
        """
        if len(self._last_s) < _ANSWERS:
            return None
        least_s = min(self._last_s)
        waited_s = now_s - self._asked_s[0][1] if self._asked_s else 0.0
        return max(least_s, waited_s) if waited_s >= _LOST_S else least_s

    def next_request(self, target: tuple[int, int], now_s: float) -> Message | None:
        """Request that is due now, to this system and component; None if none is due."""
        if now_s < self._due_s:
            return None
        self._due_s = now_s + _PERIOD_S
        stamp = max(1, int(now_s * 1e9))
        self._asked_s.append((stamp, now_s))
        return create(
            "TIMESYNC", tc1=0, ts1=stamp, target_system=target[0], target_component=target[1]
        )

    def handle(self, message: Message, now_s: float) -> None:
        """Takes a message of the autopilot; answers arrive in the order of their requests."""
        if message.get_msgId() != _TIMESYNC or message.tc1 == 0:
            return
        asked_s = next((time_s for stamp, time_s in self._asked_s if stamp == message.ts1), None)
        if asked_s is None:
            return
        while self._asked_s and self._asked_s[0][1] <= asked_s:
            self._asked_s.popleft()
        self._last_s.append(now_s - asked_s)
        self.shortest_s = min(self.shortest_s, now_s - asked_s)

"""Rate limits of commands and answers: token buckets, by sender and link.

Pure: the time is an argument. Memory and cost are bounded for any number of senders.
"""

from __future__ import annotations

from collections.abc import Hashable

from .commands import Sender

_MOST_KEYS = 64
"""Limit of keys per bucket; beyond it the key unused longest is dropped and starts again."""


class RateLimit:
    """Token bucket per key: `burst` at once, `rate_hz` in the long run."""

    def __init__(self, *, burst: int, rate_hz: float) -> None:
        self._burst = float(burst)
        self._rate_hz = rate_hz
        self._left: dict[Hashable, tuple[float, float]] = {}
        """Tokens left and the time of that count, by key; the key unused longest first."""

    def allows(self, key: Hashable, now_s: float) -> bool:
        """Returns True if one more is within the limit now, and counts it."""
        left, since_s = self._left.pop(key, (self._burst, now_s))
        left = min(self._burst, left + max(0.0, now_s - since_s) * self._rate_hz)
        allowed = left >= 1.0
        if len(self._left) >= _MOST_KEYS:
            del self._left[next(iter(self._left))]
        self._left[key] = (left - allowed, now_s)
        return allowed


class SenderLimit:
    """Limit for each sender, and one for all senders of a link together.

    A sender beyond its own limit uses nothing of its link's.
    """

    def __init__(self, *, burst: int, rate_hz: float, link_burst: int, link_rate_hz: float) -> None:
        self._senders = RateLimit(burst=burst, rate_hz=rate_hz)
        self._links = RateLimit(burst=link_burst, rate_hz=link_rate_hz)

    def allows(self, sender: Sender, now_s: float) -> bool:
        """Returns True if one more of this sender is within both limits now, and counts it."""
        return self._senders.allows(sender, now_s) and self._links.allows(sender.link, now_s)

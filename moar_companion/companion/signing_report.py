"""Texts about packets that signed links have refused: count and reason. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ..mavlink.signing import SigningRefusal
from ..texts import service_texts
from ..texts.text_format import plural, seconds

_PERIOD_S = 30.0
"""Time between two texts of one reason, which leaves room for other texts."""

_AHEAD_S = 60.0
"""Tolerance for new senders: with the reference less than this ahead of our clock, the sender's
clock is wrong."""
_REMEDY = "set this computer's clock; where it is right delete signing.json, and restart"


class SigningReport:
    """Counts reported so far, and the times of the reports."""

    def __init__(self) -> None:
        self._reported = dict.fromkeys(SigningRefusal, 0)
        self._reported_s = dict.fromkeys(SigningRefusal, -math.inf)

    def texts(
        self,
        refused: Mapping[str, Mapping[SigningRefusal, int]],
        behind_s: Mapping[str, Mapping[int, float]],
        now_s: float,
        *,
        ahead_s: float = 0.0,
    ) -> list[str]:
        """Returns the texts due now. refused: by link and reason, since the start.

        behind_s: delay of the clocks of senders refused for that, by link and system id.
        ahead_s: lead of the reference they are judged by over this computer's clock.
        """
        texts = []
        for reason in SigningRefusal:
            count = sum(counts[reason] for counts in refused.values())
            if count > self._reported[reason] and now_s - self._reported_s[reason] >= _PERIOD_S:
                number = count - self._reported[reason]
                words = service_texts.PACKETS_REFUSED(
                    large_count=number, plural=plural(number), refusal=reason.value
                )
                if reason is SigningRefusal.OLD and any(behind_s.values()):
                    slowest = _slowest(behind_s)
                    words = f"{slowest} ({words})"
                    if ahead_s > _AHEAD_S:
                        words = f"{_ahead(ahead_s)} ({_REMEDY}; {slowest})"
                texts.append(words)
                self._reported[reason], self._reported_s[reason] = count, now_s
        return texts


def _slowest(behind_s: Mapping[str, Mapping[int, float]]) -> str:
    """Text about the signer that is farthest behind."""
    most_s, system_id = max(
        (late_s, system_id) for link in behind_s.values() for system_id, late_s in link.items()
    )
    return service_texts.SIGNER_BEHIND(id=system_id, s=seconds(most_s))


def _ahead(ahead_s: float) -> str:
    """Returns the lead of the kept time stamps over the computer's clock, in few words."""
    minutes = ahead_s / 60.0
    amount = f"{minutes:.0f} min"
    if minutes >= 120.0:
        amount = f"{minutes / 60.0:.1f} h" if minutes < 2880.0 else f"{minutes / 1440.0:.0f} d"
    return service_texts.SIGNING_AHEAD(time=amount)

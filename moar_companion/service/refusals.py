"""Texts about packets that signed links have refused: how many, and why. Pure."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ..mavlink.signing import Refusal

_PERIOD_S = 30.0
"""A link that refuses all tells it so often: a pilot sees it, and other texts beside it."""


class Refusals:
    """What has been told, and when."""

    def __init__(self) -> None:
        self._told = dict.fromkeys(Refusal, 0)
        self._told_s = dict.fromkeys(Refusal, -math.inf)

    def texts(self, refused: Mapping[str, Mapping[Refusal, int]], now_s: float) -> list[str]:
        """What is to be told now. refused: by link and reason, since the start."""
        texts = []
        for reason in Refusal:
            count = sum(counts[reason] for counts in refused.values())
            if count > self._told[reason] and now_s - self._told_s[reason] >= _PERIOD_S:
                number = count - self._told[reason]
                plural = "" if number == 1 else "s"
                texts.append(f"{number} packet{plural} refused: {reason.value}")
                self._told[reason], self._told_s[reason] = count, now_s
        return texts

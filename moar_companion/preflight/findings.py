"""What a look before the flight finds: one line each, with how to mend it."""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import dataclass


class Level(enum.IntEnum):
    """How much a finding matters, the least first."""

    OK = 0
    NOTE = 1
    """Good to know."""
    WARNING = 2
    """May be flown with, by somebody who knows what it means."""
    NO_GO = 3
    """Must be mended before the flight."""

    def __str__(self) -> str:
        return self.name.lower().replace("_", "-")

    @classmethod
    def of_risk(cls, risk: float) -> Level:
        """The level of a risk in [0, 1], as the risk indices have them."""
        if risk <= 0.0:
            return cls.OK
        if risk >= 1.0:
            return cls.NO_GO
        return cls.NOTE if risk < _WORRYING_RISK else cls.WARNING


_WORRYING_RISK = 0.5
"""Half way from where an input begins to count to its worst."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """What was looked at, what was found there, and what to do about it."""

    level: Level
    subject: str
    text: str
    remedy: str = ""

    def __str__(self) -> str:
        return f"{self.subject}: {self.explanation}"

    @property
    def explanation(self) -> str:
        """What was found and how to mend it."""
        return f"{self.text}; {self.remedy}" if self.remedy else self.text


def worst(findings: Iterable[Finding]) -> Level:
    """The greatest level among findings; OK without any."""
    return max((finding.level for finding in findings), default=Level.OK)

"""Findings of the preflight checks: one line each, with a remedy."""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import dataclass


class Level(enum.IntEnum):
    """Severity of a finding, the least first."""

    OK = 0
    NOTE = 1
    """Good to know."""
    WARNING = 2
    """The flight is possible for an operator who understands the finding."""
    NO_GO = 3
    """Must be fixed before the flight."""

    def __str__(self) -> str:
        return self.name.lower().replace("_", "-")

    @classmethod
    def of_risk(cls, risk: float) -> Level:
        """Level of a risk in [0, 1], as the risk indices have them."""
        if risk <= 0.0:
            return cls.OK
        if risk >= 1.0:
            return cls.NO_GO
        return cls.NOTE if risk < _WORRYING_RISK else cls.WARNING


_WORRYING_RISK = 0.5
"""Middle between the value at which an input begins to count and its worst value."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """Result of one check: subject, text and remedy."""

    level: Level
    subject: str
    text: str
    remedy: str = ""

    def __str__(self) -> str:
        return f"{self.subject}: {self.explanation}"

    @property
    def explanation(self) -> str:
        """Text and remedy."""
        return f"{self.text}; {self.remedy}" if self.remedy else self.text


def worst(findings: Iterable[Finding]) -> Level:
    """Returns the greatest level among findings; OK without any."""
    return max((finding.level for finding in findings), default=Level.OK)

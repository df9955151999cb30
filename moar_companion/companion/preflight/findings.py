"""Findings of the preflight checks: one line each, with a remedy."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from ...mavlink.autopilots.parameter_rules import Level

__all__ = ["Finding", "Level", "worst"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """Result of one check: subject, text and remedy; a grave warning stands in the last line."""

    level: Level
    subject: str
    text: str
    remedy: str = ""
    closing: str = ""
    """Words about it in the last line."""

    def __str__(self) -> str:
        return f"{self.subject}: {self.explanation}"

    @property
    def explanation(self) -> str:
        """Text and remedy."""
        return f"{self.text}; {self.remedy}" if self.remedy else self.text


def worst(findings: Iterable[Finding]) -> Level:
    """Returns the greatest level among findings; OK without any."""
    return max((finding.level for finding in findings), default=Level.OK)

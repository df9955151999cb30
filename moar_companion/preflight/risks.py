"""Reasons of the service against an inspection: risk indices, and its supervisor's limits. Pure.

Inputs: the indices and the causes as the service has them, the findings on the batteries.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ..risk import IndexReport, RiskEstimate
from ..safety.condition_types import Causes
from .battery_check import CHARGE
from .findings import Finding, Level

_INDICES = (
    # The lean, the main measure of wind, is valid in the air only.
    ("wind", "wait for calmer air", Level.NOTE, ("wind",)),
    (
        "communication",
        "bring the ground station nearer, or see below why it is not heard",
        Level.WARNING,
        (),
    ),
    (
        "localization",
        "wait for a better fix, away from what hides the sky",
        Level.NO_GO,
        ("uncertainty", "gnss", "localization"),
    ),
    ("battery", CHARGE, Level.NO_GO, ("battery_critical", "battery_reserve")),
)
"""Each index with its remedy, its level without data, and the causes for which the service
refuses an inspection at any value of the index."""
_UNTOLD = "the autopilot has to tell it: set it up there, or look at the link's rates"


def risk_findings(
    estimate: RiskEstimate, causes: Causes, batteries: Iterable[Finding]
) -> Iterator[Finding]:
    """Yields a finding for each index, and for each limit passed. batteries: `battery_findings`."""
    misread = next((item.remedy for item in batteries if item.remedy not in ("", CHARGE)), None)
    for name, usual, unknown, limits in _INDICES:
        other = misread if name == "battery" else None  # charging does not help
        remedy = other or usual
        yield _index(name, estimate, unknown, remedy, other or _UNTOLD)
        for cause in limits:
            words = getattr(causes, cause)
            if words is not None:
                yield Finding(
                    level=Level.NO_GO,
                    subject=cause.replace("_", " "),
                    text=f"{words}: no inspection is flown so",
                    remedy=remedy,
                )


def _index(name: str, estimate: RiskEstimate, unknown: Level, remedy: str, untold: str) -> Finding:
    """Returns the finding of an index's target, with its inputs or the last value that holds it.

    unknown, untold: the level and the remedy without data.
    """
    report: IndexReport = getattr(estimate.report, name)
    if report.value is None:
        index, more = getattr(estimate.indices, name), " any more" if report.ever_known else ""
        text = f"nothing that tells of it is heard{more}, and it counts as {index:.2f}"
        level, remedy = max(unknown, Level.of_risk(index) if more else unknown), untold
    else:
        level = Level.of_risk(report.target)
        if report.held and report.cause is not None:
            told = f"held at the last word: {estimate.last_known[name][report.cause].phrase}"
        else:
            told = ", ".join(
                item.phrase
                for item in report.inputs
                if item.risk is not None and (item.risk or item.value)
            )
        text = f"{report.target:.2f} ({told})"
    remedy = remedy if level >= Level.WARNING else ""
    return Finding(level=level, subject=f"{name} risk", text=text, remedy=remedy)

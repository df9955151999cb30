"""Reasons of the service against an inspection: risk indices, limits, and the held wind. Pure.

Inputs: the indices and the causes as the service has them, the findings on the batteries.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from ...mavlink.autopilots.parameter_names import Parameters
from ...risk import IndexReport, RiskEstimate
from ...risk.holding import held_wind_mps, lowered_limit_mps, tilt_limit
from ...settings.config import Supervision
from ...settings.vehicle import Vehicle
from ...types import AutopilotKind
from .battery_check import CHARGE
from .findings import Finding, Level

_INDICES = (
    # The lean, the main measure of wind, is valid in the air only.
    ("wind", "wait for calmer air", Level.NOTE, ("wind",)),
    (
        "communication",
        "bring the ground station nearer; if it is not received, see below",
        Level.WARNING,
        (),
    ),
    (
        "localization",
        "wait for a better fix, with a free view of the sky",
        Level.NO_GO,
        ("uncertainty", "gnss", "localization"),
    ),
    ("battery", CHARGE, Level.NO_GO, ("battery_critical", "battery_reserve")),
)
"""Each index with its remedy, its level without data, and the causes for which the service
refuses an inspection at any value of the index."""
_UNREPORTED = "set up the autopilot to report it, or check the link's message rates"


def risk_findings(
    estimate: RiskEstimate, causes: Mapping[str, str], batteries: Iterable[Finding]
) -> Iterator[Finding]:
    """Yields a finding for each index, and for each limit passed. batteries: `battery_findings`."""
    misread = next((item.remedy for item in batteries if item.remedy not in ("", CHARGE)), None)
    for name, usual, unknown, limits in _INDICES:
        other = misread if name == "battery" else None  # charging does not help
        remedy = other or usual
        yield _index(name, estimate, unknown, remedy, other or _UNREPORTED)
        for cause in limits:
            words = causes.get(cause)
            if words is not None:
                yield Finding(
                    level=Level.NO_GO,
                    subject=cause.replace("_", " "),
                    text=f"{words}: no inspection starts",
                    remedy=remedy,
                )


def _index(
    name: str, estimate: RiskEstimate, unknown: Level, remedy: str, unreported: str
) -> Finding:
    """Returns the finding of an index's target, with its inputs or the last value that holds it.

    unknown, unreported: the level and the remedy without data.
    """
    report: IndexReport = getattr(estimate.report, name)
    if report.value is None:
        index, more = getattr(estimate.indices, name), " any more" if report.ever_known else ""
        text = f"no input is received{more}, the risk counts as {index:.2f}"
        level, remedy = max(unknown, Level.of_risk(index) if more else unknown), unreported
    else:
        level = Level.of_risk(report.target)
        if report.held and report.cause is not None:
            words = f"held at the last value: {estimate.last_known[name][report.cause].phrase}"
        else:
            words = ", ".join(
                item.phrase
                for item in report.inputs
                if item.risk is not None and (item.risk or item.value)
            )
        text = f"{report.target:.2f} ({words})"
    remedy = remedy if level >= Level.WARNING else ""
    return Finding(level=level, subject=f"{name} risk", text=text, remedy=remedy)


def held_wind_finding(
    kind: AutopilotKind,
    parameters: Parameters,
    vehicle: Vehicle,
    limits: Supervision,
) -> Finding:
    """Returns a finding on the wind that the aircraft can hold, by drag and lean.

    It names the key and the parameter of the lean's limit.
    """
    limit_rad, source = tilt_limit(kind, parameters, vehicle.risk)
    held_mps = held_wind_mps(vehicle.risk, limit_rad)
    allowed_mps = lowered_limit_mps(limits.wind_limit_mps, held_mps)
    text = f"holds in {held_mps:.1f} m/s, by {source} and risk.drag_per_s"
    if vehicle.risk.drag_is_usual:
        text += " (the default, not measured)"
    if allowed_mps >= limits.wind_limit_mps:
        return Finding(level=Level.OK, subject="wind", text=text)
    return Finding(
        level=Level.NOTE,
        subject="wind",
        text=f"{text}: the companion holds at {allowed_mps:.1f} m/s, before "
        f"supervision.wind_limit_mps ({limits.wind_limit_mps:g})",
    )

"""Wind that the aircraft can hold, against the wind limit of the flight. Pure."""

from __future__ import annotations

from collections.abc import Mapping

from ..config import Supervision
from ..risk.holding import MARGIN, held_wind_mps, tilt_limit
from ..types import AutopilotKind
from ..vehicle import Vehicle
from .findings import Finding, Level


def held_wind_finding(
    kind: AutopilotKind,
    parameters: Mapping[str, float | None],
    vehicle: Vehicle,
    limits: Supervision,
) -> Finding:
    """Returns a finding by drag and lean, with the key and the parameter that they come from."""
    limit_rad, source = tilt_limit(kind, parameters, vehicle.risk)
    held_mps = held_wind_mps(vehicle.risk, limit_rad)
    allowed_mps = MARGIN * held_mps
    text = f"holds in {held_mps:.1f} m/s, by {source} and risk.drag_per_s"
    if vehicle.risk.drag_is_usual:
        text += " (the default, not measured)"
    if allowed_mps >= limits.wind_limit_mps:
        return Finding(level=Level.OK, subject="wind", text=text)
    return Finding(
        level=Level.NOTE,
        subject="wind",
        text=f"{text}: it holds at {allowed_mps:.1f} m/s, before supervision.wind_limit_mps "
        f"({limits.wind_limit_mps:g})",
    )

"""Checks of the autopilot and the ground station: identity, mode, reception. Pure.

Inputs: `CheckInputs`, limits, time; outputs: texts, None without a fault. `link_age` has the ages
of the link, `autopilot_failsafe` the failsafes.
"""

from __future__ import annotations

from ..config import Supervision
from ..telemetry import Telemetry
from ..text_format import seconds
from .check_inputs import CheckInputs


def autopilot_identity(seen: CheckInputs) -> str | None:
    """Text where not exactly one autopilot, of the expected kind, is received."""
    autopilot = seen.telemetry.autopilot
    if autopilot is None:
        return "no autopilot is received"
    if seen.conflict is not None:
        return seen.conflict
    if seen.expected not in (None, autopilot.kind):
        return f"autopilot {autopilot.kind}, file {seen.expected}"
    return None if autopilot.multirotor else "the vehicle is no multirotor"


def mode_left(seen: CheckInputs, *, landing: bool) -> str | None:
    """Text for a mode that is not ours. landing: the companion has requested the landing."""
    autopilot = seen.telemetry.autopilot
    if not seen.in_control or autopilot is None or seen.landing is not landing:
        return None
    # The mode may have been left and given back between two cycles.
    return seen.faults.pilot if autopilot.ours else f"autopilot in {autopilot.mode}"


def ground_link(telemetry: Telemetry, limits: Supervision, now_s: float) -> str | None:
    """Text for a ground station that was received once and has sent nothing for too long."""
    received = telemetry.ground_station
    if received is None or now_s - received.received_s <= limits.ground_link_lost_s:
        return None
    return f"no ground station for {seconds(now_s - received.received_s)} s"

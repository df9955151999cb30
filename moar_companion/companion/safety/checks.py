"""Checks of the autopilot's identity and modes, of plans, sensor and computer. Pure.

Inputs: observations, limits, time; outputs: texts with the value, None without a fault. Those of
the position are in `position_checks`, of energy and wind in `energy_checks`, of the link in
`link_age`, of the autopilot's failsafes in `autopilot_failsafe`; `conditions` calls them all.
"""

from __future__ import annotations

from ...mavlink.telemetry import LandedState, Telemetry
from ...risk.wind import strongest
from ...settings.config import Supervision
from ...texts.text_format import exceeds, limit_text, listed, reason_chars, seconds
from ..estimation.landed_state import LANDED_TIMEOUT_S, airborne
from . import energy_checks
from .check_inputs import ROUTE_MAX_AGE_S, CheckInputs

_MB = 1e6
_GROUNDED = "not in the air"


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


def not_flying(seen: CheckInputs, now_s: float) -> str | None:
    """Text, before control, for an aircraft that is not in the air, lands or takes off."""
    landed = seen.telemetry.landed
    if seen.in_control or airborne(seen.telemetry, now_s):
        return None
    known = landed is not None and now_s - landed.received_s <= LANDED_TIMEOUT_S
    words = {LandedState.LANDING: "landing", LandedState.TAKEOFF: "taking off"}
    return words.get(landed.state, _GROUNDED) if landed is not None and known else _GROUNDED


def parameter_unknown(seen: CheckInputs) -> str | None:
    """Text for parameters that the autopilot does not report, without which none is flown."""
    names = seen.parameters_unknown
    return listed("unread", names, reason_chars("rejected")) if names else None


def ground_link(telemetry: Telemetry, limits: Supervision, now_s: float) -> str | None:
    """Text for an operator's ground station that has sent nothing for too long."""
    received = telemetry.ground_station
    if received is None or now_s - received.received_s <= limits.ground_link_lost_s:
        return None
    return f"no ground station for {seconds(now_s - received.received_s)} s"


def plan(seen: CheckInputs, limit_s: float) -> str | None:
    """Text for a new plan that is awaited for too long."""
    awaited_s = seen.plan_awaited_s
    return exceeds("no new plan for", awaited_s, limit_s, "s")


def perception(seen: CheckInputs, now_s: float) -> str | None:
    """Text for a lost, late, blinded or unread sensor, or an obstacle that the maps lack."""
    settings, health = seen.sensing, seen.sensor_health
    if settings.sensor is None:
        return None
    if health.refusal is not None:
        return f"lidar data {health.refusal.value}"
    if health.received_s is None or health.scan_s is None:
        return "no data of the lidar is received"
    silent_s, age_s = now_s - health.received_s, now_s - health.scan_s
    text = exceeds("lidar silent for", silent_s, settings.timeout_s, "s")
    text = text or exceeds("lidar scan age", age_s, settings.late_s, "s")
    if text is None and health.returns < settings.least_returns:
        text = f"lidar blinded, {health.returns:.0%} returns < {settings.least_returns:.0%}"
    return text or exceeds("obstacle unmapped for", seen.unmapped_s, settings.timeout_s, "s")


def unmonitored(seen: CheckInputs, now_s: float) -> str | None:
    """Text, in the air, for what is not reported, or not known."""
    if not seen.in_control and not airborne(seen.telemetry, now_s):
        return None
    missing = [
        name
        for name, known in (
            ("wind", strongest(seen.risk.report.wind.inputs) is not None),
            ("battery", energy_checks.battery_monitored(seen, now_s)),
            ("position accuracy", seen.risk.position_accuracy_known),
            ("uploaded fence", not seen.fence_silent),
            ("ground station", seen.telemetry.ground_station is not None),
            (
                "escape route",
                seen.escape_route is not None and seen.escape_route.age_s <= ROUTE_MAX_AGE_S,
            ),
        )
        if not known
    ]
    return listed("unknown", missing, reason_chars("over")) if missing else None


def free(what: str, left: float | None, limit_mb: float) -> str | None:
    """Text for too little memory or disk space; None also where it is not known."""
    if left is None or left >= limit_mb * _MB:
        return None
    return f"{what} {left / _MB:.0f} MB < {limit_text(limit_mb)}"

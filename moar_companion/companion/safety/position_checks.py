"""Checks of the position: its age, its accuracy, and the aircraft's place in the site. Pure.

Inputs: `CheckInputs`, limits, time; outputs: texts with the value, None without a fault.
"""

from __future__ import annotations

import math

from ...mavlink.telemetry import Telemetry
from ...planner.site import Margin
from ...risk import RiskEstimate
from ...settings.config import Supervision
from ...texts.text_format import (
    compass,
    digits_above,
    distance,
    exceeds,
    limit_text,
    reason_chars,
    with_name,
)
from . import link_age
from .check_inputs import CheckInputs
from .uncertainty_growth import AHEAD_S

_READ_LATE_S = 0.2
"""Wait for reading above which late data is caused by the companion, not by the network."""
LINE_OFF_M = 6.0
"""Greatest offset of the line: PX4's estimates were off by up to 1.7 m, a GPS that was pushed by
4.5 m. Beyond it the wrong wires may have been matched."""
_LINE_FITS_S = 2.0
ATTITUDE_TIMEOUT_S = 1.0
"""ATTITUDE comes at 100 Hz, at 10 Hz on a slow link."""
_HOVER_MPS = 1.0
"""Greatest speed at which a hold is offered: an aircraft in full flight would return to the hold
once it gets the mode. ArduPilot may be in GUIDED already, on another flight."""
_OFF_M = 0.5
"""In recordings of flights the local position, by its origin, is near the global one: within 0.11 m
(PX4) or 0.03 m (ArduPilot), height included. After receiver recovery PX4 reported
0.73 m for 0.24 s, and once 56 m for one message."""


def position(seen: CheckInputs, limits: Supervision, now_s: float) -> str | None:
    """Text for a missing position, or one that is too old."""
    if seen.telemetry.local_position is None:
        return "no local position is received"
    under_way_s = link_age.delay_s(seen.telemetry.link, seen.position_late_s)
    age_s = now_s - seen.position_moved_s + under_way_s
    if seen.host.read_late_s > _READ_LATE_S:
        return exceeds("position read late", age_s, limits.position_timeout_s, "s")
    return exceeds("position age", age_s, limits.position_timeout_s, "s")


def attitude(telemetry: Telemetry, now_s: float) -> str | None:
    """Text for a missing attitude, or one that is too old."""
    attitude = telemetry.attitude
    known = attitude is not None and now_s - attitude.received_s <= ATTITUDE_TIMEOUT_S
    return None if known else "the attitude is unknown"


def position_jump(seen: CheckInputs, limits: Supervision) -> str | None:
    """Text for position jumps that add up to more than is permitted here."""
    limit_m = min(limits.jump_limit_m, round(seen.jump_margin_m, 1))
    return exceeds("the position jumped", seen.jumped_m, limit_m, "m")


def origin_moved(seen: CheckInputs, limits: Supervision) -> str | None:
    """Text for an origin that has moved by more than is permitted here."""
    limit_m = min(limits.jump_limit_m, round(seen.origin_margin_m, 1))
    return exceeds("the origin moved", seen.origin_moved_m, limit_m, "m")


def position_disagreement(seen: CheckInputs) -> str | None:
    """Text for two reports of one place that differ."""
    return exceeds("global position off", seen.global_off_m, _OFF_M, "m") or exceeds(
        "home position off", seen.home_off_m, _OFF_M, "m"
    )


def line(seen: CheckInputs, now_s: float) -> str | None:
    """Text for a line that is too far from its place by the autopilot, or that fits nowhere."""
    if seen.line.seen_s is None:
        return None
    since_s = seen.line.contradicted_s
    off = exceeds("line off by", math.hypot(*seen.line.offset_m), LINE_OFF_M, "m")
    return off or exceeds(
        "wires off the line for", 0.0 if since_s is None else now_s - since_s, _LINE_FITS_S, "s"
    )


def uncertainty(seen: CheckInputs, limits: Supervision) -> str | None:
    """Text for a position that is too uncertain."""
    limit_m = limits.position_uncertainty_limit_m
    return exceeds("uncertainty", seen.risk.position_uncertainty_m, limit_m, "m")


def uncertainty_grows(seen: CheckInputs, limits: Supervision) -> str | None:
    """Text for a position that will be too uncertain soon; an escape route goes on until it is."""
    known_m, soon_m = seen.risk.position_uncertainty_m or 0.0, seen.uncertainty_soon_m
    limit_m = limits.position_uncertainty_limit_m
    if seen.escaping or soon_m is None or not known_m <= limit_m < soon_m:
        return None
    return f"uncertainty grows: {distance(soon_m)} m in {AHEAD_S:.0f} s"


def error_reach(seen: CheckInputs) -> str | None:
    """Text for an obstacle within the position's error, as it is at the end of the forecast."""
    soon_m = seen.uncertainty_soon_m
    if not seen.in_control or soon_m is None or seen.error_hits is None:
        return None
    pattern = f"{distance(soon_m)} m error would hit {{}}"
    return with_name(pattern, seen.error_hits, reason_chars("rejected"))


def widening_m(risk: RiskEstimate, margin: Margin) -> float:
    """Obstacle inflation: position uncertainty above the margin's position error, in metres."""
    return max(0.0, (risk.position_uncertainty_m or 0.0) - margin.position_m)


def off_path(seen: CheckInputs, limit_m: float) -> str | None:
    """Text for an aircraft that is farther from its setpoint than the vehicle's limit."""
    return exceeds("off the path", seen.error_m, limit_m, "m") if seen.in_control else None


def no_progress(seen: CheckInputs) -> str | None:
    """Text for a setpoint that does not move although a path is flown."""
    if not seen.stopped:
        return None
    error = "" if seen.error_m is None else f", {distance(seen.error_m)} m from setpoint"
    return f"no progress{error}"


def obstacle(seen: CheckInputs) -> str | None:
    """Text for a hull that is nearer to an obstacle than keep-out and uncertainty allow."""
    least_m = seen.widening_m
    if seen.room_m is None or seen.room_m >= least_m:
        return None
    words = f"{distance(least_m - seen.room_m)} m too close to an obstacle"
    known_m = seen.risk.position_uncertainty_m
    return f"{words} (position uncertainty {known_m:.1f} m)" if known_m and least_m else words


def off_plane(seen: CheckInputs, limits: Supervision) -> str | None:
    """Text for an aircraft beside the plane before control, with side and distance."""
    if seen.pose is None or seen.in_control:
        return None  # the flight continues, and the escape route stays open
    beside_m, limit_m = seen.pose.position_m[1], limits.plane_tolerance_m
    if abs(beside_m) <= limit_m:
        return None
    side = f"{_side(beside_m, seen.azimuth_rad)} of plane"
    shown, limit = digits_above(abs(beside_m), limit_m), limit_text(limit_m)
    return f"over {limit} m {side}" if shown is None else f"{shown} m {side} > {limit}"


def _side(beside_m: float, azimuth_rad: float | None) -> str:
    """Side of the plane by compass; without azimuth left or right of +x. beside_m: y, to left."""
    if azimuth_rad is None:
        return "left" if beside_m > 0.0 else "right"
    return compass(azimuth_rad - math.copysign(0.5 * math.pi, beside_m))


def not_hovering(seen: CheckInputs) -> str | None:
    """Text for an aircraft that moves before control."""
    if seen.pose is None or seen.in_control:
        return None
    words = exceeds("moving at", math.hypot(*seen.pose.velocity_mps), _HOVER_MPS, "m/s")
    return None if words is None else f"{words}, hover"

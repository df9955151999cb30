"""Checks of wind, batteries and the remaining flight time. Pure.

Inputs: `CheckInputs`, limits, time; outputs: texts with the value, None without a fault.
"""

from __future__ import annotations

from ...mavlink.telemetry import Battery
from ...risk.holding import lowered_limit_mps
from ...risk.power import BATTERY_MAX_AGE_S, is_powered
from ...risk.wind import USUAL_DRAG, strongest
from ...texts.text_format import distance, exceeds, seconds
from ...types import Mission
from .check_inputs import CheckInputs, EscapeRoute

_SATURATED_OFF_M = 1.5
"""Error beyond which the aircraft cannot return, with tilt or motors at their limits. In calm air
PX4 deviates by 1.15 m."""
_CRITICAL = 3
_FAILED = 5
"""MAV_BATTERY_CHARGE_STATE: critical, emergency, failed."""
_NONE_LEFT_S = 0.5
"""Least time in a text; a shorter one would appear as 0 s."""
_SOON_S = 60.0
"""Lead time of the warning before the aircraft has to leave."""


def wind(seen: CheckInputs, limit_mps: float) -> str | None:
    """Text for a wind above the limit, or near what the aircraft can hold."""
    item = strongest(tuple(seen.risk.last_known.get("wind", {}).values()))
    if item is None:
        return None
    if seen.held_wind_mps is not None:
        limit_mps = lowered_limit_mps(limit_mps, seen.held_wind_mps)
    words = exceeds(item.name, item.value, limit_mps, item.unit)
    if words and item.remark == USUAL_DRAG:
        return f"wind {item.value:.1f} m/s, drag not measured ({words})"
    return f"{words} ({item.remark})" if words and item.remark else words


def control_saturated(seen: CheckInputs) -> str | None:
    """Text for an aircraft that drifts in wind, or is off its setpoint with saturated control."""
    if seen.drifted_m is not None:
        return f"wind too strong, drifting {max(1.0, seen.drifted_m):.0f} m"
    off_m = seen.error_m
    if not (seen.in_control and seen.saturated) or off_m is None or off_m <= _SATURATED_OFF_M:
        return None
    return f"wind too strong, {distance(off_m)} m off path"


def battery_critical(seen: CheckInputs) -> str | None:
    """Text for a battery that the autopilot calls critical or worse."""
    for number, battery in sorted(seen.telemetry.batteries.items()):
        state: float | None = battery.charge_state if is_powered(battery) else None
        if state is None:
            state = _reported_before(seen, number, "charge state")
        if state is not None and _CRITICAL <= state <= _FAILED:
            return f"battery {number} is critical"
    return None


def battery_reserve(seen: CheckInputs, reserve: float) -> str | None:
    """Text for a battery with no more than `reserve` left, a fraction."""
    for number, battery in sorted(seen.telemetry.batteries.items()):
        remaining = battery.remaining if is_powered(battery) else None
        if remaining is None:
            remaining = _reported_before(seen, number, "remaining")
        if remaining is not None and remaining <= reserve:
            return f"battery {number} at {remaining:.0%} <= {reserve:.0%}"
    return None


def battery_silent(seen: CheckInputs, now_s: float) -> str | None:
    """Text for a battery that does not report its charge any more."""
    for number, battery in sorted(seen.telemetry.batteries.items()):
        powered, age_s = is_powered(battery), now_s - battery.received_s
        if powered and age_s > BATTERY_MAX_AGE_S and _reports_charge(battery):
            return f"battery {number} is silent for {seconds(age_s)} s"
        last = _reported_before(seen, number, "remaining")
        if last is not None and (battery.remaining is None or not powered):
            return f"battery {number} reports no charge (was {last:.0%})"
    return None


def battery_monitored(seen: CheckInputs, now_s: float) -> bool:
    """True if a battery reports its charge, and none has ceased to."""
    batteries = seen.telemetry.batteries.values()
    reports_it = any(is_powered(battery) and _reports_charge(battery) for battery in batteries)
    return reports_it and battery_silent(seen, now_s) is None


def _reported_before(seen: CheckInputs, number: int, what: str) -> float | None:
    """Last reported value of a battery that the risk estimate keeps; None if there is none."""
    last = seen.risk.last_known.get("battery", {}).get(f"battery {number} {what}")
    return None if last is None else last.value


def _reports_charge(battery: Battery) -> bool:
    """True if it reports its charge; a summary only repeats an earlier charge state."""
    reported = battery.charge_state is not None and not battery.summary
    return battery.remaining is not None or reported


def energy_left(seen: CheckInputs, mission: Mission) -> str | None:
    """Text where an exit or an evacuation would leave too little flight time."""
    words = _too_little_left(seen.escape_route, mission)
    return seen.misread if words and seen.misread and not seen.in_control else words


def _too_little_left(route: EscapeRoute | None, mission: Mission) -> str | None:
    if route is None or route.mission is not mission:
        return None
    if route.flown_left_s is not None:
        return f"{_left(route.flown_left_s, Mission.EXIT)} (the {mission.value} takes less)"
    if route.left_s is None or route.left_s > route.reserve_s:
        return None
    words = _left(route.left_s, mission)
    return f"{words} <= {seconds(route.reserve_s)}" if words.endswith(" s") else words


def energy_low_soon(route: EscapeRoute | None) -> str | None:
    """Text where the better escape route is due within a minute."""
    if route is None or route.left_s is None or not 0.0 < route.left_s - route.reserve_s <= _SOON_S:
        return None
    words = _left(route.left_s, route.mission)
    return f"{words}, due at {seconds(route.reserve_s)}" if words.endswith(" s") else words


def _left(left_s: float, mission: Mission) -> str:
    left = f"{seconds(left_s)} s" if left_s > _NONE_LEFT_S else "no flight time"
    return f"{mission.value} leaves {left}"

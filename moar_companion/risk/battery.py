"""Battery risk BR (paper, Section IV-C (d)): what is left, and the way home.

Inputs for each battery: the fraction left, the voltage of a cell, the autopilot's own warning, the
flight time left on arrival at home. Each is judged by itself, so the worst battery decides.
"""

from __future__ import annotations

import math

from ..types import Battery, Telemetry
from ..vehicle import RiskModel
from .inputs import InputReport, measured

BATTERY_MAX_AGE_S = 15.0
"""BATTERY_STATUS comes at 0.5 Hz, on a slow link once in 12 s. In 15 s a multirotor spends about a
hundredth of its charge."""
POSITION_MAX_AGE_S = 0.5
"""LOCAL_POSITION_NED comes at 10 Hz or more: 5 periods."""
_FLIGHT_VOLTAGE_MIN_V = 5.0
"""Below, the autopilot is fed by USB and claims a full battery; two empty cells have 6 V."""
_STATE_OK = 1
_STATE_LOW = 2
_STATE_UNHEALTHY = 6
"""MAV_BATTERY_CHARGE_STATE: 3 critical, 4 emergency, 5 failed; 0 and 7 (charging) say nothing."""
_LOW_RISK = 0.8
"""Low asks for the way home, not yet for haste at any price: Eq. 9 leaves nothing of the safety
weight at a risk of 1."""


def inputs(
    telemetry: Telemetry, now_s: float, model: RiskModel, cruise_mps: float
) -> tuple[InputReport, ...]:
    """The normalised inputs of the battery risk; cruise_mps: speed of the way home."""
    home_s = _time_home_s(telemetry, now_s, cruise_mps)
    return tuple(
        report
        for number, battery in sorted(telemetry.batteries.items())
        for report in _battery(number, battery, now_s, model, home_s)
    )


def _battery(
    number: int, battery: Battery, now_s: float, model: RiskModel, home_s: float | None
) -> tuple[InputReport, ...]:
    voltage_v = battery.voltage_v
    powered = voltage_v is None or voltage_v >= _FLIGHT_VOLTAGE_MIN_V
    remaining = battery.remaining if powered else None
    cell_v = None
    if voltage_v is not None and powered and model.cells is not None:
        cell_v = voltage_v / model.cells
    margin_s = None
    if remaining is not None and home_s is not None:
        margin_s = remaining * model.endurance_s - home_s
    state = battery.charge_state if powered else None
    if state == _STATE_OK and remaining is None and cell_v is None:
        state = None  # "not low" alone does not say how much is left
    readings = (
        ("remaining", remaining, "", model.battery_remaining.fraction),
        ("cell voltage", cell_v, "V", model.cell_voltage_v.fraction),
        ("charge state", _warning(state), "", float),
        ("left at home", margin_s, "s", model.home_margin_s.fraction),
    )
    return tuple(
        measured(
            f"battery {number} {name}",
            value,
            unit,
            received_s=battery.received_s,
            now_s=now_s,
            max_age_s=BATTERY_MAX_AGE_S,
            risk=risk,
        )
        for name, value, unit, risk in readings
    )


def _warning(state: int | None) -> float | None:
    """The risk of the autopilot's word on the battery; None where it says nothing."""
    if state is None or not _STATE_OK <= state <= _STATE_UNHEALTHY:
        return None
    if state == _STATE_OK:
        return 0.0
    return _LOW_RISK if state == _STATE_LOW else 1.0


def _time_home_s(telemetry: Telemetry, now_s: float, cruise_mps: float) -> float | None:
    """The flight time to home along a straight line; None where either end is unknown."""
    home, local = telemetry.home, telemetry.local_position
    if home is None or local is None or now_s - local.received_s > POSITION_MAX_AGE_S:
        return None
    distance_m = math.dist(home.position_ned_m, local.position_ned_m)
    return distance_m / cruise_mps if math.isfinite(distance_m) else None

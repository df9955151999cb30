"""Battery risk BR (paper, Section IV-C (d)): remaining energy against the energy still needed.

Inputs for each battery: the fraction left, the voltage of a cell, the autopilot's warning, the
flight time left on arrival at home. Each is rated by itself, so the worst battery decides. Inputs
of all together: the flight time left after the mission, after an exit and after an evacuation, by
the measured power (`power`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from ..mavlink.telemetry import Battery, Telemetry
from ..settings.risk_model import RiskModel
from .input_reports import InputReport, source_at, source_of
from .power import (
    BATTERY_MAX_AGE_S,
    Demands,
    Meter,
    PowerModel,
    cell_v,
    is_powered,
    metered,
    on_the_ground,
)

POSITION_MAX_AGE_S = 0.5
"""Maximum age of LOCAL_POSITION_NED: 5 periods at 10 Hz or more."""
_STATE_OK, _STATE_LOW = 1, 2
WARNINGS = {2: "low", 3: "critical", 4: "emergency", 5: "failed", 6: "unhealthy"}
"""MAV_BATTERY_CHARGE_STATE; 1 is ok, 0 and 7 (charging) carry no warning."""
_LOW_RISK = 0.8
"""Risk of a low battery: it calls for a return, not for speed at any cost. At a risk of 1 Eq. 9
leaves nothing of the safety weight."""
_S_PER_H = 3600.0
_TITLE = "battery "


def remember(meter: Meter, telemetry: Telemetry, now_s: float, power: PowerModel) -> Meter:
    """Meter of the batteries, updated by this telemetry."""
    return metered(meter, telemetry, now_s, power)


def inputs(
    telemetry: Telemetry,
    now_s: float,
    model: RiskModel,
    meter: Meter,
    power: PowerModel,
    cruise_mps: float,
    demands: Demands | None,
) -> tuple[InputReport, ...]:
    """Normalised inputs of the battery risk; `meter` includes this telemetry.

    cruise_mps: speed of the return. demands: None without a plan.
    """
    home_s = _time_home_s(telemetry, now_s, cruise_mps)
    each = tuple(
        report
        for number, battery in sorted(telemetry.batteries.items())
        for report in _battery(number, battery, now_s, model, meter, power, home_s)
    )
    needs = Demands() if demands is None else demands
    source = source_at(meter.received_s, now_s, BATTERY_MAX_AGE_S)
    return each + tuple(
        source.input_report(
            f"flight time left after {name}",
            meter.left_after_s(power, need_wh),
            "s",
            model.home_margin_s.fraction,
            applies=demands is not None and flown,
        )
        for name, need_wh, flown in (
            ("mission", needs.finish_wh, needs.flown),
            ("exit", needs.exit_wh, True),
            ("evacuation", needs.evacuation_wh, True),
        )
    )


def still_there(
    last_known: Mapping[str, InputReport], telemetry: Telemetry
) -> Mapping[str, InputReport]:
    """Last known reports, without the batteries that were removed on the ground."""
    if not on_the_ground(telemetry):
        return last_known
    titles = tuple(f"{_TITLE}{number} " for number in telemetry.batteries)
    return {
        name: report
        for name, report in last_known.items()
        if name.startswith(titles) or not name.startswith(_TITLE)
    }


def _battery(
    number: int,
    battery: Battery,
    now_s: float,
    model: RiskModel,
    meter: Meter,
    power: PowerModel,
    home_s: float | None,
) -> tuple[InputReport, ...]:
    powered = is_powered(battery)
    remaining = battery.remaining if powered else None
    volts = cell_v(battery, power, meter.mean_current_a.get(number))
    margin_s = None
    if remaining is not None and home_s is not None:
        flight_s = remaining * power.capacity_wh / (meter.factor * power.hover_w) * _S_PER_H
        margin_s = flight_s - home_s * power.cruise_w / power.hover_w
    state = battery.charge_state if powered else None
    only_ok = state == _STATE_OK and remaining is None and volts is None
    if only_ok or state not in (_STATE_OK, *WARNINGS):
        state = None  # "not low" alone does not give the remaining charge
    source = source_of(battery, now_s, BATTERY_MAX_AGE_S)
    title = f"{_TITLE}{number}"
    return (
        source.input_report(
            f"{title} remaining", remaining, "of its charge", model.battery_remaining.fraction
        ),
        source.input_report(f"{title} cell voltage", volts, "V", model.cell_voltage_v.fraction),
        source.input_report(
            f"{title} charge state", state, "", _warning, remark=WARNINGS.get(state or 0, "ok")
        ),
        source.input_report(
            f"{title} flight time left at home", margin_s, "s", model.home_margin_s.fraction
        ),
    )


def _warning(state: float) -> float:
    """Risk of the charge state that the autopilot reports."""
    if state == _STATE_OK:
        return 0.0
    return _LOW_RISK if state == _STATE_LOW else 1.0


def _time_home_s(telemetry: Telemetry, now_s: float, cruise_mps: float) -> float | None:
    """Flight time to home along a straight line; None if either end is unknown."""
    home, local = telemetry.home, telemetry.local_position
    if home is None or local is None or now_s - local.received_s > POSITION_MAX_AGE_S:
        return None
    distance_m = math.dist(home.position_ned_m, local.position_ned_m)
    return distance_m / cruise_mps if math.isfinite(distance_m) else None

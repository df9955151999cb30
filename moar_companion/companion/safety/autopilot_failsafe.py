"""Autopilot failsafes: the ones that are reported, and the one that has taken the mode. Pure.

ArduPilot reports system_status 5 for any failsafe, also for one without an action in which GUIDED
continues (ArduCopter 4.6.3, Copter::any_failsafe_triggered). The mode decides about control.
"""

from __future__ import annotations

from ...mavlink.autopilots import profile
from ...mavlink.telemetry import AutopilotStatus, Failsafe, Telemetry
from ...risk.power import is_powered
from ...texts.text_format import listed, reason_chars

_LOW, _FAILED = 2, 5
"""MAV_BATTERY_CHARGE_STATE: low, critical, emergency, failed."""
_BATTERY = "battery"
"""The battery's name in `Readiness.unhealthy`."""
_WITH_MODE_S = 2.5
"""Maximum time from a failsafe to the mode that it chose: two heartbeats, one may be lost."""
_WITHOUT_POSITION = frozenset({Failsafe.ESTIMATOR, Failsafe.DEAD_RECKONING})


def took_mode(autopilot: AutopilotStatus | None) -> bool:
    """True if a failsafe, not a pilot, has chosen a mode that is not ours.

    ArduPilot reports a failsafe also in a mode that the pilot has chosen. There only a return, a
    landing or a stop counts as the failsafe's.
    """
    if autopilot is None or not autopilot.failsafe or autopilot.ours:
        return False
    return profile(autopilot.kind).failsafe_flies or autopilot.homeward


def taken_mode(telemetry: Telemetry) -> str | None:
    """Text with the source of the mode that `took_mode` reports; None: it reports none.

    On ArduPilot a failsafe stays reported in a mode that a pilot or operator orders later. A
    failsafe chose the mode only if it began, or was reported again, with that mode or after.
    """
    autopilot = telemetry.autopilot
    if autopilot is None or not took_mode(autopilot):
        return None
    begun_s, mode_s = autopilot.failsafe_since_s, autopilot.mode_since_s
    signs_s = (*telemetry.failsafes_reported.values(), begun_s)
    if (
        not profile(autopilot.kind).failsafe_flies
        and mode_s is not None
        and not any(sign_s is None or sign_s >= mode_s - _WITH_MODE_S for sign_s in signs_s)
    ):
        return f"autopilot in {autopilot.mode}"
    return f"failsafe chose {autopilot.mode}"


def reported(telemetry: Telemetry) -> frozenset[Failsafe] | None:
    """Returns the active failsafes that have not taken the mode; None: there is none.

    Empty where texts, charge states, sensor health and estimator do not identify one.
    """
    autopilot = telemetry.autopilot
    if autopilot is None or not autopilot.failsafe or took_mode(autopilot):
        return None
    found, readiness = set(telemetry.failsafes_reported), telemetry.readiness
    charges = (item.charge_state for item in telemetry.batteries.values() if is_powered(item))
    if any(charge is not None and _LOW <= charge <= _FAILED for charge in charges):
        found.add(Failsafe.BATTERY)
    if readiness is not None:
        if _BATTERY in readiness.unhealthy:
            found.add(Failsafe.BATTERY)
        if readiness.remote_control_ok is False:
            found.add(Failsafe.REMOTE_CONTROL)
    if telemetry.estimator is not None and not telemetry.estimator.horizontal_position_ok:
        found.add(Failsafe.ESTIMATOR)
    return frozenset(found)


def battery_failsafe(telemetry: Telemetry) -> str | None:
    """Reason to leave because of the battery's failsafe; None: there is none."""
    found = reported(telemetry)
    return "autopilot battery failsafe" if found and Failsafe.BATTERY in found else None


def holding_failsafe(telemetry: Telemetry, *, escaping: bool) -> str | None:
    """Reason to hold because of another failsafe, or one of unknown cause; None: there is none.

    escaping: an exit or evacuation is flown. It continues, unless the position is in doubt.
    """
    found = reported(telemetry)
    if found is None:
        return None
    others = found - {Failsafe.BATTERY}
    if escaping:
        others &= _WITHOUT_POSITION
    elif not found:
        return "autopilot failsafe, cause unknown"
    if not others:
        return None
    return listed("failsafe", sorted(item.value for item in others), reason_chars("rejected"))

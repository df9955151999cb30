"""Failsafe exposure: autopilot failsafes, and the obstacles that they would hit from here.

Inputs: the autopilot's parameters and home, received links, the aircraft's place, its batteries,
the time. Outputs: the failsafes that count now, and a reason to leave the place. The aircraft must
leave before a battery's action that would hit an obstacle. It must also leave after a maximum stay
where an action without a forecast would hit one. Pure.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...mavlink.autopilots import profile
from ...mavlink.autopilots.failsafe_actions import (
    BATTERY,
    NO_FAILSAFES,
    AutopilotAction,
    FailsafeAction,
    Failsafes,
    Trigger,
)
from ...mavlink.autopilots.parameter_names import Parameters
from ...mavlink.telemetry import Telemetry
from ...planner.free_distance import FreeDistance
from ...risk.power import Meter, PowerModel, is_powered
from ...settings.config import Supervision
from ...texts import pilot_texts
from ...texts.text_format import reason_chars, seconds, with_name
from ...types import AutopilotKind, Vector
from ..estimation.pose import home_moved
from .failsafe_paths import STAYS, Hit, failsafe_hit

_NEAR_VOLTAGE = 1.03
"""Factor on a voltage threshold: a lithium cell sags by 0.1 V (3 %) when a multirotor climbs."""
_UNKNOWN_LEAVING_S = 60.0
"""Time to leave where no escape route is known: that of the longest exit of the shipped sites."""
_CHARS = reason_chars("evacuating")
_OVER_S = 2.0
"""A shorter time without exposure, as between two cells, does not end an exposure."""


_FALL_S, _FALL = 5.0, 0.03
"""Least fall of the charge within this time that counts as faster than the forecast by power: ten
times that of a flight of 15 minutes, and more than a report's rounding."""
_FALLS_FOR_S = 2.0
"""Least time of reports from which a fall is forecast."""


class Exposed(NamedTuple):
    """An action that would hit an obstacle from the aircraft's place.

    forecast: the time until the action is known, not only a bound of it.
    """

    action: FailsafeAction
    hit: Hit
    forecast: bool


class FailsafeExposure:
    """Keeps the autopilot's failsafes, and the time since one without a forecast would hit."""

    def __init__(self, limits: Supervision, power: PowerModel) -> None:
        self._limits = limits
        self._power = power
        self._reported: tuple[object, ...] = ()
        self._all = NO_FAILSAFES
        self.known = False
        """True once all parameters were received, or requested often enough."""
        self._received: frozenset[Trigger] = frozenset()
        self._exposed: tuple[Exposed, ...] = ()
        self._charges: tuple[tuple[float, float], ...] = ()
        """Times and least charges of the last seconds, the oldest first."""
        self._since_s: float | None = None
        self._seen_s = self._noted_s = -math.inf
        self.failsafes = NO_FAILSAFES
        """Failsafes that move the aircraft; RC loss counts only once RC was received."""

    @property
    def enabled(self) -> Failsafes:
        """All failsafes that the autopilot has enabled, also those by which it stays."""
        return self._all

    def take_settings(self, limits: Supervision, power: PowerModel) -> None:
        """Takes the settings in force."""
        self._limits, self._power = limits, power

    def learn(
        self,
        kind: AutopilotKind,
        parameters: Parameters,
        home_m: Vector | None,
        telemetry: Telemetry,
    ) -> bool:
        """Takes parameters and home, (x, y, z) in the site's frame; returns True if any is new."""
        received = self._received | received_links(kind, telemetry)
        names = profile(kind).failsafe_parameters
        reported = (kind, received, *(parameters.get(name, "") for name in names))
        before_m = self._all.home_m
        moved = home_moved(home_m, before_m)
        if reported == self._reported and not moved:
            return False
        self._reported, self._received = reported, received
        found = profile(kind).failsafes(parameters)
        self.known = found is not None
        if found is None:
            return False
        self._all = replace(found, home_m=home_m if moved else before_m)
        self.failsafes = moving(self._all, received)
        return True

    def update(
        self,
        place_m: Vector | None,
        reach: FreeDistance | None,
        telemetry: Telemetry,
        meter: Meter,
        now_s: float,
    ) -> None:
        """Updates the obstacles that actions would hit from here; no update at unknown places."""
        charge = _least_charge(telemetry)
        recent = tuple(item for item in self._charges if now_s - item[0] <= _FALL_S)
        self._charges = recent if charge is None else (*recent, (now_s, charge))
        if place_m is None or reach is None:
            return
        place = np.array([[place_m[0], place_m[2]]])
        found = []
        for item in self.failsafes.actions:
            hit = failsafe_hit(replace(self.failsafes, actions=(item,)), reach, place)
            if hit is not None:
                times_s = self._times_s(item, telemetry, meter)
                forecast = bool(times_s) and None not in times_s
                found.append(Exposed(action=item, hit=hit[1], forecast=forecast))
        self._exposed = tuple(found)
        if not all(item.forecast for item in found):
            self._since_s = now_s if self._since_s is None else self._since_s
            self._seen_s = now_s
        elif now_s - self._seen_s > _OVER_S:
            self._since_s = None

    def end(self) -> None:
        """Clears the exposure after a flight."""
        self._exposed, self._since_s, self._seen_s = (), None, -math.inf
        self._charges = ()

    def reason(
        self,
        telemetry: Telemetry,
        meter: Meter,
        *,
        leaving_s: float | None,
        limit_s: float,
        from_s: float,
        now_s: float,
    ) -> str | None:
        """Reason to leave, as text with the value; None while the aircraft may stay.

        leaving_s: to the last exposed place of the escape route; None: unknown. limit_s: maximum
        stay where an action has no forecast, counted from `from_s` at the earliest.
        """
        battery = self._battery_reason(telemetry, meter, leaving_s)
        if battery is not None:
            return battery
        stayed_s = self._stayed_s(from_s, now_s)
        if stayed_s is None or stayed_s <= limit_s:
            return None
        trigger, obstacle = self._where()
        pattern = f"{trigger} hits {{}}: {seconds(stayed_s)} s"
        return f"{with_name(pattern, obstacle, _CHARS)} ({limit_s:.0f})"

    def note(self, limit_s: float, from_s: float, now_s: float) -> str | None:
        """Warning text, once, halfway to the limit; None at other times."""
        stayed_s = self._stayed_s(from_s, now_s)
        if stayed_s is None or not 0.5 * limit_s <= stayed_s <= limit_s or self._noted_s >= from_s:
            return None
        self._noted_s = now_s
        trigger, obstacle = self._where()
        left_s = seconds(limit_s - stayed_s)
        return pilot_texts.EXPOSED(trigger=trigger, obstacle=obstacle, s=left_s)

    def next_battery_action(
        self, telemetry: Telemetry, meter: Meter
    ) -> tuple[FailsafeAction, float] | None:
        """The battery's next action that moves the aircraft, and the time until it, if forecast.

        Where the charge falls much faster than by the power, it is taken to go on so.
        """
        times_s = [
            (action, left_s)
            for action in self.failsafes.of(BATTERY).actions
            for left_s in (*self._times_s(action, telemetry, meter), self._falls_in_s(action))
            if left_s is not None
        ]
        return min(times_s, key=lambda item: item[1], default=None)

    def _falls_in_s(self, action: FailsafeAction) -> float | None:
        """Time until an action's charge, by the fall of the last seconds; None: no fast fall.

        It counts if it lasts in both halves of that time, at the lesser rate: the voltage, and with
        it a charge that is read from it, dips once in a climb.
        """
        if action.charge is None or not self._charges:
            return None
        (first_s, first), (last_s, last) = self._charges[0], self._charges[-1]
        half_s = 0.5 * (last_s - first_s)
        middle = next(charge for time_s, charge in self._charges if time_s >= first_s + half_s)
        fall = min(first - middle, middle - last)
        if 2.0 * half_s < _FALLS_FOR_S or first - last < _FALL or fall <= 0.0:
            return None
        return max(0.0, last - action.charge) * half_s / fall

    def _stayed_s(self, from_s: float, now_s: float) -> float | None:
        return None if self._since_s is None else now_s - max(self._since_s, from_s)

    def _where(self) -> tuple[str, str]:
        """Trigger and obstacle of the first action without a forecast, for texts."""
        unforeseen = next((item for item in self._exposed if not item.forecast), None)
        if unforeseen is None:
            return "failsafe", "obstacle"
        return unforeseen.action.trigger.noun, unforeseen.hit.obstacle

    def _times_s(
        self, action: FailsafeAction, telemetry: Telemetry, meter: Meter
    ) -> list[float | None]:
        """Flight times until an action, or until an earlier battery action ends our control.

        After a hold on a low battery, no controller moves the aircraft before the critical action.
        """
        if action.trigger not in BATTERY:
            return []
        return [
            time_s
            for item in self._all.of(BATTERY).actions
            if item.action is not AutopilotAction.NONE
            for time_s in _times_s(item, telemetry, meter, self._power)
        ]

    def _battery_reason(
        self, telemetry: Telemetry, meter: Meter, leaving_s: float | None
    ) -> str | None:
        """Text for a battery action that comes too soon to leave in time; None if there is none."""
        here = {
            item.action.trigger: item for item in self._exposed if item.action.trigger in BATTERY
        }
        if not here and not leaving_s:
            return None
        if leaving_s is None:
            leaving_s = _UNKNOWN_LEAVING_S
        for action in self.failsafes.of(BATTERY).actions:
            left_s = _soonest_s(self._times_s(action, telemetry, meter))
            hits = action.trigger in here or leaving_s > 0.0
            if left_s is None or not hits:
                continue
            if left_s - leaving_s >= self._limits.exposure_reserve_s:
                continue
            words = f"{action.action.noun} in {seconds(left_s)} s"
            if action.trigger in here:
                return with_name(f"{words} hits {{}}", here[action.trigger].hit.obstacle, _CHARS)
            needed_s = leaving_s + self._limits.exposure_reserve_s
            left, needed = seconds(math.floor(left_s)), seconds(math.ceil(needed_s))
            return f"battery {action.action.noun} {left} s < {needed}"
        return None


def moving(failsafes: Failsafes, received: frozenset[Trigger]) -> Failsafes:
    """Returns the failsafes that move the aircraft; RC loss only if RC was ever received.

    A ground station always counts: the autopilot may receive one that is not forwarded to us.
    """
    return replace(
        failsafes,
        actions=tuple(
            item
            for item in failsafes.actions
            if item.action not in STAYS
            and (item.trigger in received or item.trigger is not Trigger.RC_LOSS)
        ),
    )


def received_links(kind: AutopilotKind, telemetry: Telemetry) -> frozenset[Trigger]:
    """The links that the autopilot is known to receive, by the trigger of their loss."""
    readiness, remote = telemetry.readiness, telemetry.remote_control
    if profile(kind).channels_without_receiver and readiness is not None:
        remote = None if readiness.remote_control_ok is None else remote
    return frozenset() if remote is None else frozenset({Trigger.RC_LOSS})


def _least_charge(telemetry: Telemetry) -> float | None:
    """The least charge that a battery reports, a fraction."""
    batteries = telemetry.batteries.values()
    return min(
        (item.remaining for item in batteries if item.remaining is not None and is_powered(item)),
        default=None,
    )


def _soonest_s(times_s: Iterable[float | None]) -> float | None:
    """The earliest time with a forecast; None where there is none."""
    return min((time_s for time_s in times_s if time_s is not None), default=None)


def _times_s(
    action: FailsafeAction, telemetry: Telemetry, meter: Meter, power: PowerModel
) -> list[float | None]:
    """Flight times until the thresholds of a battery's action; None: cannot be forecast."""
    times_s: list[float | None] = []
    if action.charge is not None:
        times_s.append(meter.until_reported_s(power, action.charge))
    if action.voltage_v is not None:
        times_s.append(_until_voltage_s(action.voltage_v, telemetry, meter, power))
    return times_s


def _until_voltage_s(
    voltage_v: float, telemetry: Telemetry, meter: Meter, power: PowerModel
) -> float | None:
    """Flight time until a pack's voltage; None without the number of cells, until it is near."""
    volts = [
        battery.voltage_v
        for battery in telemetry.batteries.values()
        if battery.voltage_v is not None and is_powered(battery)
    ]
    if volts and min(volts) <= _NEAR_VOLTAGE * voltage_v:
        return 0.0
    if power.cells is None:
        return None
    return meter.until_s(power, 1.0 - power.cell_voltage_v.fraction(voltage_v / power.cells))

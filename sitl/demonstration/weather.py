"""A scenario's wind and battery on a real autopilot's simulator, if that simulates them.

The fake autopilot applies its scenario itself; here the operator applies it by parameters.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Final

from pymavlink.dialects.v20 import all as mavlink

from sitl.scenario import Scenario

from .operator import Operator

_PERIOD_S: Final = 1.0
_IN_AIR: Final = int(mavlink.MAV_LANDED_STATE_IN_AIR)
_WIND: Final = {"wind_mps": "SIM_WIND_SPD", "wind_from_deg": "SIM_WIND_DIR"}
"""ArduPilot's; PX4's own simulator has no wind in v1.17."""
_PLAYED: Final = frozenset({"wind_mps", "wind_from_deg", "battery_percent"})


@dataclass(slots=True, kw_only=True)
class Weather:
    """Conditions over the scenario's time; others than wind and battery are left out."""

    scenario: Scenario
    autopilot: str
    speed: float
    next_s: float = 0.0
    _start_s: float = field(default_factory=time.monotonic)
    _took_off_s: float | None = None
    _sent: dict[str, float] = field(default_factory=dict)
    _playing: bool = False

    @property
    def left_out(self) -> tuple[str, ...]:
        """Names of the conditions that this simulator does not support."""
        named = {name for change in self.scenario.changes for name in change.targets}
        cannot = set(_WIND) if self.autopilot == "px4" else set()
        return tuple(sorted((named - _PLAYED) | (named & cannot)))

    def play(self, operator: Operator) -> None:
        """Have the operator make the changes that are due; made to be called often."""
        real_s = time.monotonic()
        if self._playing or real_s < self.next_s or not operator.autopilot_received:
            return
        self.next_s = real_s + _PERIOD_S / self.speed
        now_s = (real_s - self._start_s) * self.speed
        if operator.landed_state == _IN_AIR and self._took_off_s is None:
            self._took_off_s = now_s
        self._playing = True  # the operator, while it waits for an answer, calls this again
        try:
            for name, value in self._conditions(now_s).items():
                self._send(operator, name, value)
        finally:
            self._playing = False

    def _send(self, operator: Operator, name: str, value: float) -> None:
        value = float(round(value, 1) if name == "wind_mps" else round(value))
        if name in self.left_out or self._sent.get(name) == value:
            return
        self._sent[name] = value
        if name == "battery_percent":
            set_battery(operator, self.autopilot, value)
        else:
            operator.set_parameter(_WIND[name], value)

    def _conditions(self, now_s: float) -> dict[str, float]:
        values: dict[str, float] = {}
        for change in self.scenario.changes:
            start_s = change.at_s
            if change.after_takeoff:
                if self._took_off_s is None:
                    continue
                start_s += self._took_off_s
            if now_s < start_s:
                continue
            share = 1.0 if change.over_s <= 0.0 else min(1.0, (now_s - start_s) / change.over_s)
            for name in _PLAYED & change.targets.keys():
                before = values.get(name, 100.0 if name == "battery_percent" else 0.0)
                values[name] = before + (float(change.targets[name]) - before) * share
        return values


def set_battery(operator: Operator, autopilot: str, percent: float) -> None:
    """Set the charge of the simulator's battery, from now on."""
    if autopilot == "px4":
        operator.set_parameter("SIM_BAT_MIN_PCT", percent)
        operator.set_parameter("SIM_BAT_DRAIN", 1.0)
    else:
        operator.command("the battery", mavlink.MAV_CMD_BATTERY_RESET, 1, percent)

"""ArduPilot's battery monitor: consumed charge, and the failsafes of its voltage.

A level counts once the voltage was below it for BATT_LOW_TIMER, and stays until BATTERY_RESET or a
restart. The remaining charge is computed from the consumed charge, not from the voltage; a charge
that was replaced in flight counts as known.
"""

from enum import IntEnum
from typing import Final

from sitl.battery import Battery
from sitl.parameters import Parameters

_PERIOD_S: Final = 0.1


class Charge(IntEnum):
    """MAV_BATTERY_CHARGE_STATE as ArduPilot uses it."""

    OK = 1
    LOW = 2
    CRITICAL = 3


_LEVELS: Final = (
    (Charge.LOW, "BATT_LOW_VOLT", "BATT_LOW_MAH"),
    (Charge.CRITICAL, "BATT_CRT_VOLT", "BATT_CRT_MAH"),
)


class BatteryMonitor:
    """Checks the battery ten times a second."""

    def __init__(self, battery: Battery, parameters: Parameters) -> None:
        """Start with nothing consumed."""
        self._battery = battery
        self._parameters = parameters
        self.consumed_mah = self.consumed_wh = 0.0
        self.charge = Charge.OK
        self._replacements = battery.replacements
        self._below_s: dict[Charge, float] = {}
        self._wait_s = 0.0

    @property
    def present(self) -> bool:
        """True if there is a monitor."""
        return self._parameters.value("BATT_MONITOR") != 0

    def step(self, dt: float) -> Charge | None:
        """Advance; return a level that has just been reached."""
        self._wait_s += dt
        if self._wait_s < _PERIOD_S or not self.present:
            return None
        elapsed_s, self._wait_s = self._wait_s, 0.0
        if self._battery.replacements != self._replacements:
            self._replacements = self._battery.replacements
            self._know(self._battery.fraction)
        used_mah = self._battery.current_a * elapsed_s / 3.6
        self.consumed_mah += used_mah
        self.consumed_wh += used_mah / 1000.0 * self._battery.voltage_v
        level = self._level(elapsed_s)
        if level <= self.charge:
            return None
        self.charge = level
        return level

    def reset(self, percent: float) -> None:
        """Set the charge, and clear the failsafes."""
        self._know(percent / 100.0)
        self._below_s.clear()
        self.charge = Charge.OK

    def refusals(self) -> list[str]:
        """Return the reasons that forbid arming; empty when there are none."""
        low_v = self._parameters.value("BATT_LOW_VOLT")
        found = []
        if self.present and self._battery.voltage_v < low_v:
            found.append("Battery 1 low voltage failsafe")
        if self.charge > Charge.OK:
            found.append("Battery failsafe")
        return found

    def _know(self, fraction: float) -> None:
        self.consumed_mah = self._parameters.value("BATT_CAPACITY") * (1.0 - fraction)
        self.consumed_wh = self.consumed_mah / 1000.0 * self._battery.voltage_v

    def _level(self, dt: float) -> Charge:
        value = self._parameters.value
        remaining_mah = value("BATT_CAPACITY") - self.consumed_mah
        reached = Charge.OK
        for charge, voltage, mah in _LEVELS:
            if 0.0 < self._battery.voltage_v < value(voltage):
                below_s = self._below_s[charge] = self._below_s.get(charge, -dt) + dt
                if below_s > value("BATT_LOW_TIMER"):
                    reached = charge
            else:
                self._below_s.pop(charge, None)
            if remaining_mah < value(mah):
                reached = charge
        return reached

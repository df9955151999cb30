"""The battery: energy that drains while the motors are armed, and a voltage that sags.

    voltage = cells * (empty + (full - empty) * fraction) - current * resistance

Measured on PX4 v1.17.0: 16.2 V at 100 %, 14.4 V at 0 % for four cells. The battery drains only
while armed, and is full again after disarming.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class BatteryOptions:
    """The pack."""

    capacity_wh: float = 90.0
    cells: int = 4
    cell_full_v: float = 4.05
    cell_empty_v: float = 3.60
    resistance_ohm: float = 0.004
    initial_fraction: float = 1.0
    refills_when_disarmed: bool = True
    reports_current: bool = False
    """PX4's simulated battery has no current sensor: it reports -1 A, sent as -100 cA."""


class Battery:
    """Energy and voltage of one pack."""

    __slots__ = ("_load_a", "current_a", "forced_voltage_v", "fraction", "options", "replacements")

    def __init__(self, options: BatteryOptions) -> None:
        """Start with the initial charge."""
        self.options = options
        self.fraction = options.initial_fraction
        self.replacements = 0
        """Number of replacements of the charge."""
        self.forced_voltage_v: float | None = None
        """Voltage at the connector, independent of the charge; None: it follows from the charge."""
        self.current_a = 0.0
        self._load_a = 0.0

    def step(self, dt: float, power_w: float, drain_factor: float, *, armed: bool) -> None:
        """Take `power_w` for `dt` seconds; the factor speeds up the loss of charge.

        A current sensor measures that; the voltage does not sag by it.
        """
        self._load_a = power_w / max(self.open_circuit_v, 1.0) if armed else 0.0
        self.current_a = self._load_a * drain_factor
        if armed:
            used_wh = power_w * dt / 3600.0 * drain_factor
            self.fraction = max(0.0, self.fraction - used_wh / self.options.capacity_wh)

    def replace(self, fraction: float) -> None:
        """Use another charge from now on."""
        self.fraction = fraction
        self.replacements += 1

    def refill(self) -> None:
        """Restore the initial charge, as PX4's simulated battery does after disarming."""
        self.fraction = self.options.initial_fraction

    @property
    def open_circuit_v(self) -> float:
        """Voltage without load."""
        o = self.options
        return o.cells * (o.cell_empty_v + (o.cell_full_v - o.cell_empty_v) * self.fraction)

    @property
    def voltage_v(self) -> float:
        """Voltage at the connector, under load."""
        if self.forced_voltage_v is not None:
            return self.forced_voltage_v
        return self.open_circuit_v - self._load_a * self.options.resistance_ohm

"""Cells of the batteries: their voltage, and check of the vehicle file's number of them. Pure."""

from __future__ import annotations

from ...mavlink.telemetry import Battery, Telemetry
from .model import PowerModel

_CELL_V = (3.0, 4.4)
"""Voltage range of an intact lithium cell."""
USB_MAX_V = 5.5
"""Highest voltage of USB, by its type C; of other USB 5.25 V. With it an autopilot reports a full
battery."""
_FLIGHT_VOLTAGE_MIN_V = 5.3
"""Least voltage of a battery whose report counts in flight: two cells may have it under load."""


def is_powered(battery: Battery) -> bool:
    """Returns True if this battery powers the autopilot, so that its report is meaningful."""
    return battery.voltage_v is None or battery.voltage_v >= _FLIGHT_VOLTAGE_MIN_V


def is_of_cells(voltage_v: float, cells: int) -> bool:
    """Returns True if a battery of this many intact lithium cells may have this voltage."""
    least_v, most_v = _CELL_V
    return least_v <= voltage_v / cells <= most_v


def cell_v(battery: Battery, model: PowerModel, mean_current_a: float | None) -> float | None:
    """Voltage of a cell at the mean load, so that a short peak does not mean an empty battery.

    None without the number of cells. mean_current_a: of the last seconds.
    """
    if battery.voltage_v is None or model.cells is None or not is_powered(battery):
        return None
    sag_v = 0.0
    if battery.current_a is not None and mean_current_a is not None:
        sag_v = model.cell_resistance_ohm * (battery.current_a - mean_current_a)
    return battery.voltage_v / model.cells + sag_v


def misread(telemetry: Telemetry, cells: int | None) -> str | None:
    """Text of a mismatch for operators; None if all batteries fit, or none reports.

    With the wrong number an empty battery appears full, or a full one empty.
    """
    if cells is None:
        return None
    for number, battery in sorted(telemetry.batteries.items()):
        if battery.voltage_v is None or not is_powered(battery):
            continue
        reported = battery.cells
        fits = is_of_cells(battery.voltage_v, cells)
        if not fits or reported not in (None, cells):
            has = f"{reported}S" if fits else f"{battery.voltage_v:.1f} V"
            return f"battery {number}: {has}, not {cells}S (risk.cells of the vehicle file)"
    return None

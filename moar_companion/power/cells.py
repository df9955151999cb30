"""Check of the vehicle file's number of cells against the batteries: telemetry in, text out."""

from __future__ import annotations

from ..telemetry import Telemetry
from .meter import is_powered

CELL_V = (3.0, 4.4)
"""Voltage range of an intact lithium cell."""


def misread(telemetry: Telemetry, cells: int | None) -> str | None:
    """Text of a mismatch for people; None if all batteries fit, or none reports.

    With the wrong number an empty battery appears full, or a full one empty.
    """
    if cells is None:
        return None
    for number, battery in sorted(telemetry.batteries.items()):
        if battery.voltage_v is None or not is_powered(battery):
            continue
        told = battery.cells
        least_v, most_v = CELL_V
        fits = least_v <= battery.voltage_v / cells <= most_v
        if not fits or told not in (None, cells):
            has = f"{told}S" if fits else f"{battery.voltage_v:.1f} V"
            return f"battery {number}: {has}, not {cells}S (risk.cells of the vehicle file)"
    return None

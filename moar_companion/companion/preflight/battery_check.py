"""Check of the batteries against the vehicle file: received data in, findings out. Pure."""

from __future__ import annotations

from ...mavlink.telemetry import Battery, Telemetry
from ...risk.power.cells import USB_MAX_V, is_of_cells, is_powered
from ...settings.risk_model import RiskModel
from .findings import Finding, Level

_FEW_CELLS = (1, 2)
"""Numbers of cells whose empty battery may have the voltage of USB."""
_HIGH_CHARGE = 0.8
_HIGH_CELL_V = 4.0
"""Voltage of a lithium-polymer cell at rest at about that charge."""
CHARGE = "charge it"
"""Remedy of a battery that has no other fault."""


def battery_findings(telemetry: Telemetry, model: RiskModel) -> list[Finding]:
    """Returns a finding for each battery; one with another remedy than `CHARGE` is misread."""
    if not telemetry.batteries:
        return [
            Finding(
                level=Level.NO_GO,
                subject="battery",
                text="not reported by the autopilot",
                remedy="set up its battery monitor: an empty battery would not be detected",
            )
        ]
    batteries = sorted(telemetry.batteries.items())
    beside = any(_reports_voltage(battery) for _, battery in batteries)
    return [
        _battery(f"battery {number}", battery, model)
        if _reports_voltage(battery)
        else _silent(f"battery {number}", beside=beside)
        for number, battery in batteries
    ]


def _reports_voltage(battery: Battery) -> bool:
    return battery.remaining is not None or battery.voltage_v is not None


def _silent(subject: str, *, beside: bool) -> Finding:
    """Returns the finding of a battery without data; beside: another battery has data.

    The other battery may supply the aircraft alone, as where a monitor is set up for a pack that is
    not fitted.
    """
    return Finding(
        level=Level.WARNING if beside else Level.NO_GO,
        subject=subject,
        text="charge and voltage unknown: an empty battery would not be detected",
        remedy="set up its battery monitor, or switch the monitor off if there is no such battery",
    )


def _battery(subject: str, battery: Battery, model: RiskModel) -> Finding:
    remaining, voltage_v, cells = battery.remaining, battery.voltage_v, model.cells
    reported = battery.cells
    charge = "charge unknown" if remaining is None else f"{remaining:.0%}"
    risk = 0.0 if remaining is None else model.battery_remaining.fraction(remaining)
    if voltage_v is None:
        return _charged(subject, f"{charge}, voltage unknown", risk, Level.NOTE)
    text = f"{charge}, {voltage_v:.1f} V"
    if not is_powered(battery) or (voltage_v <= USB_MAX_V and cells not in _FEW_CELLS):
        return Finding(
            level=Level.WARNING,
            subject=subject,
            text=f"{text}: the autopilot is powered by USB, the charge is not that of a battery",
            remedy="connect the flight battery",
        )
    if cells is None:
        why = "" if reported is None else f", which is {reported}"
        text = f"{text}; the voltage is not judged without risk.cells in the vehicle file{why}"
        return _charged(subject, text, risk, Level.NOTE)
    if reported is not None and reported != cells:
        return Finding(
            level=Level.NO_GO,
            subject=subject,
            text=f"{text}: it reports the voltages of {reported} cells, the vehicle file has "
            f"{cells}",
            remedy="correct risk.cells in the vehicle file: with a wrong number an empty battery "
            "counts as full, or a full one as empty",
        )
    cell_v = voltage_v / cells
    text = f"{text}, {cell_v:.2f} V a cell"
    if not is_of_cells(voltage_v, cells):
        return Finding(
            level=Level.NO_GO,
            subject=subject,
            text=f"{text} with {cells} cells, which is impossible",
            remedy="correct risk.cells in the vehicle file, or the autopilot's voltage divider",
        )
    if remaining is not None and _contradictory(remaining, cell_v, model):
        return Finding(
            level=Level.WARNING,
            subject=subject,
            text=f"{text} with {cells} cells, which is not the voltage of that charge",
            remedy="risk.cells or the charge is wrong: correct the vehicle file, or the "
            "autopilot's battery monitor",
        )
    return _charged(subject, text, max(risk, model.cell_voltage_v.fraction(cell_v)), Level.OK)


def _charged(subject: str, text: str, risk: float, least: Level) -> Finding:
    """Returns the finding of a battery with correct readings, by the risk of its charge."""
    level = max(least, Level.of_risk(risk))
    remedy = CHARGE if level >= Level.WARNING else ""
    return Finding(level=level, subject=subject, text=text, remedy=remedy)


def _contradictory(remaining: float, cell_v: float, model: RiskModel) -> bool:
    """True if the charge is high and the voltage of a cell is not, or the reverse."""
    if remaining > _HIGH_CHARGE:
        return model.cell_voltage_v.fraction(cell_v) > 0.0
    charge_risk = model.battery_remaining.fraction(remaining)
    return cell_v > _HIGH_CELL_V and Level.of_risk(charge_risk) >= Level.WARNING

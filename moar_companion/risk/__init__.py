"""Risk: telemetry to the paper's four risk indices, each with an explanation. Pure.

In: `Telemetry`, the thresholds of the vehicle file, the time. Out: `RiskReport`; the power of a
flight and the energy left (`power`). Read first: `indices`, `wind`, `power.meter`.
"""

from __future__ import annotations

from .indices import IndexReport, RiskEstimate, RiskReport, update
from .input_reports import InputReport

__all__ = ["IndexReport", "InputReport", "RiskEstimate", "RiskReport", "update"]

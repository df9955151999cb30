"""Risk: Telemetry -> RiskIndices, pure. See `indices.update`."""

from __future__ import annotations

from .indices import IndexReport, RiskEstimate, RiskReport, update
from .input_reports import InputReport

__all__ = ["IndexReport", "InputReport", "RiskEstimate", "RiskReport", "update"]

"""Causes of the risk indices and their effect on the weights, as text and JSON. Pure.

    wind 0.71: wind from tilt 9.2 m/s, 0.1 s old -> 0.71
    k_S 0.33 -> 0.45 (wind +0.13, battery -0.01), k_T 0.33 -> 0.18 (wind -0.14), k_E 0.33 -> 0.37
    calibrated: k_S 0.33 -> 0.61 (wind +0.28), k_T 0.33 -> 0.19 (wind -0.14), k_E 0.33 -> 0.19 ...

An index follows its worst input, rising fast and falling slowly; the text names its target while it
moves. The effect of a risk on a weight is the change of the weight without that risk, the others
being equal (Eq. 9, or `adaptation`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from ..planner.adaptation import Adaptation
from ..settings.vehicle import AdaptationKind
from ..types import RiskIndices, Weights
from .indices import IndexReport, RiskEstimate
from .input_reports import InputReport, read

_SYMBOLS = {"safety": "k_S", "time": "k_T", "energy": "k_E"}
_TOLD = 0.005
"""Least change of an index or a weight in the text, which has two decimals."""


class WeightsReason(NamedTuple):
    """Weights before and after their adaptation. by_risk: effect by index and weight."""

    adaptation: Adaptation
    adjusted: Weights
    by_risk: Mapping[str, Mapping[str, float]]

    @classmethod
    def of(cls, adaptation: Adaptation, risk: RiskIndices) -> WeightsReason:
        """Effect of the indices on weights by an adaptation."""
        adjusted, values = adaptation.weights(risk), risk.as_dict()
        by_risk: dict[str, dict[str, float]] = {}
        for name, value in values.items():
            without = adaptation.weights(replace(risk, **{name: 0.0})) if value else adjusted
            by_risk[name] = {
                "safety": adjusted.safety - without.safety,
                "time": adjusted.time - without.time,
                "energy": adjusted.energy - without.energy,
            }
        return cls(adaptation=adaptation, adjusted=adjusted, by_risk=by_risk)

    def words(self) -> str:
        """Text: `k_S 0.33 -> 0.45 (wind +0.13), k_T ...`; an adaptation other than Eq. 9."""
        words = ", ".join(self._words_of(weight, symbol) for weight, symbol in _SYMBOLS.items())
        if self.adaptation.kind is AdaptationKind.PAPER:
            return words
        return f"{self.adaptation.words}: {words}"

    def _words_of(self, weight: str, symbol: str) -> str:
        base, adjusted = getattr(self.adaptation.base, weight), getattr(self.adjusted, weight)
        shown = [
            f"{name} {changes[weight]:+.2f}"
            for name, changes in self.by_risk.items()
            if abs(changes[weight]) >= _TOLD
        ]
        reason = f" ({', '.join(shown)})" if shown else ""
        return f"{symbol} {base:.2f} -> {adjusted:.2f}{reason}"

    def to_dict(self) -> dict[str, Any]:
        """Returns a dict for JSON."""
        return {
            "adaptation": self.adaptation.to_dict(),
            "base": {weight: getattr(self.adaptation.base, weight) for weight in _SYMBOLS},
            "adjusted": {weight: getattr(self.adjusted, weight) for weight in _SYMBOLS},
            "by_risk": {name: dict(changes) for name, changes in self.by_risk.items()},
            "words": self.words(),
        }


def index_words(name: str, value: float, report: IndexReport) -> str:
    """Text of an index and the input that decides it, or that none does."""
    words = f"{name} {value:.2f}"
    if value < report.target - _TOLD:
        words += f", rising to {report.target:.2f}"
    elif value > report.target + _TOLD:
        words += f", falling to {report.target:.2f}"
    if report.target < _TOLD:
        return f"{words}: no input raises it"
    if report.held:
        words += ", held at the last value"
    if report.reported is None:
        nothing = "nothing is measured any more" if report.ever_known else "nothing was measured"
        return f"{words}: {nothing}"
    return f"{words}: {input_words(report.reported)}"


def rise_words(name: str, report: IndexReport) -> str:
    """Text of an index's target and its cause: `wind to 0.71: wind from tilt 9.2 m/s`."""
    why = "no input of it" if report.reported is None else report.reported.phrase
    return f"{name} to {report.target:.2f}: {why}"


def input_words(item: InputReport) -> str:
    """Text `wind from tilt 9.2 m/s, 0.1 s old -> 0.71`; without the risk if it is unknown now."""
    words = item.phrase
    if item.age_s is not None and item.age_s != item.value:  # of a silence the age is the value
        words += f", {item.age_s:.1f} s old"
    return words if item.risk is None else f"{words} -> {item.risk:.2f}"


def index_dict(name: str, value: float, report: IndexReport) -> dict[str, Any]:
    """An index and its inputs as a dict for JSON."""
    return {
        "value": value,
        "target": report.target,
        "known": report.value is not None,
        "worst": report.worst,
        "cause": report.cause,
        "held": report.held,
        "words": index_words(name, value, report),
        "inputs": [
            {
                "name": input_name,
                "value": value,
                "unit": unit,
                "reading": read(value, unit),
                "age_s": age_s,
                "risk": risk,
                "known": risk is not None,
            }
            for input_name, value, unit, age_s, risk, _, _, _ in report.inputs
        ],
    }


def risk_dict(estimate: RiskEstimate) -> dict[str, Any]:
    """All indices and their inputs as a dict for JSON."""
    return {
        name: index_dict(name, value, getattr(estimate.report, name))
        for name, value in estimate.indices.as_dict().items()
    }

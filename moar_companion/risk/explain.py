"""Causes of the risk indices and their effect on the weights, as text and in the status. Pure.

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

from ..planner.adaptation import Adaptation
from ..settings.vehicle import AdaptationKind
from ..status_values import (
    AdaptationEntry,
    ByWeight,
    IndexEntry,
    InputEntry,
    RiskSection,
    WeightChanges,
    WeightsSection,
)
from ..types import RiskIndices, Weights
from .indices import IndexReport, RiskEstimate
from .input_reports import InputReport

_SYMBOLS = {"safety": "k_S", "time": "k_T", "energy": "k_E"}
_TOLD = 0.005
"""Least change of an index or a weight in the text, which has two decimals."""


def weights_section(adaptation: Adaptation, risk: RiskIndices) -> WeightsSection:
    """Effect of the indices on weights by an adaptation."""
    adjusted = adaptation.weights(risk)
    by_risk = {}
    for name, value in risk.as_dict().items():
        without = adaptation.weights(replace(risk, **{name: 0.0})) if value else adjusted
        by_risk[name] = ByWeight(
            safety=adjusted.safety - without.safety,
            time=adjusted.time - without.time,
            energy=adjusted.energy - without.energy,
        )
    words = ", ".join(
        _weight_words(weight, symbol, adaptation.base, adjusted, by_risk)
        for weight, symbol in _SYMBOLS.items()
    )
    if adaptation.kind is not AdaptationKind.PAPER:
        words = f"{adaptation.words}: {words}"
    return WeightsSection(
        adaptation=AdaptationEntry(
            kind=adaptation.kind.value, calibrated=adaptation.calibration is not None
        ),
        base=_by_weight(adaptation.base),
        adjusted=_by_weight(adjusted),
        by_risk=WeightChanges(**by_risk),
        words=words,
    )


def _by_weight(weights: Weights) -> ByWeight:
    return ByWeight(safety=weights.safety, time=weights.time, energy=weights.energy)


def _weight_words(
    weight: str, symbol: str, base: Weights, adjusted: Weights, by_risk: Mapping[str, ByWeight]
) -> str:
    changes = {name: getattr(change, weight) for name, change in by_risk.items()}
    shown = [f"{name} {change:+.2f}" for name, change in changes.items() if abs(change) >= _TOLD]
    reason = f" ({', '.join(shown)})" if shown else ""
    return f"{symbol} {getattr(base, weight):.2f} -> {getattr(adjusted, weight):.2f}{reason}"


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


def index_entry(name: str, value: float, report: IndexReport) -> IndexEntry:
    """An index and its inputs for the status."""
    return IndexEntry(
        value=value,
        target=report.target,
        known=report.value is not None,
        worst=report.worst,
        cause=report.cause,
        held=report.held,
        words=index_words(name, value, report),
        inputs=tuple(
            InputEntry(
                name=item.name,
                value=item.value,
                unit=item.unit,
                reading=item.reading,
                age_s=item.age_s,
                risk=item.risk,
                known=item.known,
            )
            for item in report.inputs
        ),
    )


def risk_section(estimate: RiskEstimate) -> RiskSection:
    """All indices and their inputs for the status."""
    entries = {
        name: index_entry(name, value, getattr(estimate.report, name))
        for name, value in estimate.indices.as_dict().items()
    }
    return RiskSection(**entries)

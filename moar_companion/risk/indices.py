"""The four risk indices: telemetry and time -> RiskIndices (paper, Section IV-C).

`update` is a pure step. Each index is the worst of its inputs, followed fast upwards and slowly
downwards. Missing is unknown, never 0, and never lowers a risk:

- an input keeps the last risk it was known to have; only its own fresh measurement lowers it;
- an index without any fresh input stays at its last value or rises to `RiskModel.unknown`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from ..types import RiskIndices, Telemetry
from ..vehicle import RiskModel
from . import battery, communication, localization, wind
from .communication import CommunicationMemory
from .inputs import InputReport
from .localization import LocalizationMemory
from .wind import WindMemory

RISE_S = 0.5
"""Time constant upwards: a single bad packet at 10 Hz moves an index by 18 % of the way, a fault
is followed within a second."""
FALL_S = 5.0
"""Time constant downwards: longer than the lulls between gusts and the gaps of a fading radio, so
that plans do not alternate with them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IndexReport:
    """An index as measured now: value is the worst risk of its known inputs, None without any.

    ever_known: whether any of its inputs was known since the start.
    """

    value: float | None = None
    inputs: tuple[InputReport, ...] = ()
    ever_known: bool = False

    @property
    def worst(self) -> str | None:
        """The name of the input that decides the value; None where none is known."""
        known = [report for report in self.inputs if report.risk is not None]
        return max(known, key=lambda report: report.risk or 0.0).name if known else None


@dataclass(frozen=True, slots=True, kw_only=True)
class RiskReport:
    """What the four indices are made of."""

    wind: IndexReport = field(default_factory=IndexReport)
    communication: IndexReport = field(default_factory=IndexReport)
    localization: IndexReport = field(default_factory=IndexReport)
    battery: IndexReport = field(default_factory=IndexReport)


@dataclass(frozen=True, slots=True, kw_only=True)
class RiskEstimate:
    """The indices, what they are made of, and what the next `update` has to remember."""

    indices: RiskIndices
    report: RiskReport = field(default_factory=RiskReport)
    updated_s: float | None = None
    last_risks: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    """By index and input: the last known risk; never changed in place."""
    wind: WindMemory = field(default_factory=WindMemory)
    communication: CommunicationMemory = field(default_factory=CommunicationMemory)
    localization: LocalizationMemory = field(default_factory=LocalizationMemory)

    @classmethod
    def unknown(cls, model: RiskModel) -> RiskEstimate:
        """The estimate before anything was heard: every index is `model.unknown`."""
        return cls(
            indices=RiskIndices(
                wind=model.unknown,
                communication=model.unknown,
                localization=model.unknown,
                battery=model.unknown,
            )
        )


def update(
    estimate: RiskEstimate,
    telemetry: Telemetry,
    now_s: float,
    *,
    model: RiskModel,
    cruise_mps: float,
) -> RiskEstimate:
    """The estimate after a look at the telemetry at `now_s`; made to be called at about 10 Hz.

    cruise_mps: the speed at which the aircraft would fly home, positive.
    """
    memory_wind = wind.remember(estimate.wind, telemetry)
    memory_communication = communication.remember(estimate.communication, telemetry)
    memory_localization = localization.remember(estimate.localization, telemetry)
    inputs = {
        "wind": wind.inputs(telemetry, now_s, model, memory_wind),
        "communication": communication.inputs(telemetry, now_s, model, memory_communication),
        "localization": localization.inputs(telemetry, now_s, model, memory_localization),
        "battery": battery.inputs(telemetry, now_s, model, cruise_mps),
    }
    last_risks = {
        name: _last_risks(estimate.last_risks.get(name, {}), reports)
        for name, reports in inputs.items()
    }
    report = {name: _report(reports, last_risks[name]) for name, reports in inputs.items()}
    elapsed_s = 0.0 if estimate.updated_s is None else max(0.0, now_s - estimate.updated_s)
    before = estimate.indices.as_dict()
    after = {
        name: _follow(before[name], index, last_risks[name], elapsed_s, model.unknown)
        for name, index in report.items()
    }
    return RiskEstimate(
        indices=RiskIndices(**after),
        report=RiskReport(**report),
        updated_s=now_s,
        last_risks=last_risks,
        wind=memory_wind,
        communication=memory_communication,
        localization=memory_localization,
    )


def _last_risks(
    before: Mapping[str, float], reports: tuple[InputReport, ...]
) -> Mapping[str, float]:
    """The last known risk of every input that was ever known."""
    return {
        **before,
        **{report.name: report.risk for report in reports if report.risk is not None},
    }


def _report(reports: tuple[InputReport, ...], last_risks: Mapping[str, float]) -> IndexReport:
    return IndexReport(
        value=max((report.risk for report in reports if report.risk is not None), default=None),
        inputs=reports,
        ever_known=bool(last_risks),
    )


def _follow(
    index: float,
    report: IndexReport,
    last_risks: Mapping[str, float],
    elapsed_s: float,
    unknown: float,
) -> float:
    """The index after `elapsed_s`: first order towards the worst last risk of its inputs."""
    worst = max(last_risks.values(), default=unknown)
    if report.value is None:
        worst = index = max(index, unknown, worst)
    time_constant_s = RISE_S if worst > index else FALL_S
    return index + (worst - index) * -math.expm1(-elapsed_s / time_constant_s)

"""The four risk indices: telemetry and time -> RiskIndices (paper, Section IV-C).

`update` is a pure step. Each index follows the worst of its inputs, fast upwards and slowly
downwards. A missing input is unknown, never 0, and never lowers a risk:

- an input keeps its last report with a known risk until its next fresh measurement;
- an index without any fresh input stays at its last value or rises to `RiskModel.unknown`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from operator import attrgetter
from typing import NamedTuple

from ..mavlink.telemetry import Telemetry
from ..settings.risk_model import RiskModel
from ..settings.vehicle import Power
from ..types import RiskIndices
from . import battery, communication, localization, wind
from .communication import CommunicationMemory
from .input_reports import InputReport
from .localization import (
    BY_LINE,
    ESTIMATOR_ACCURACY,
    ESTIMATOR_HEIGHT_ACCURACY,
    ODOMETRY_ACCURACY,
    ODOMETRY_HEIGHT_ACCURACY,
    OFF_LINE,
    LocalizationMemory,
    PlaceByLine,
)
from .power import Demands, Meter, PowerModel
from .receivers import RECEIVER_ACCURACY
from .wind import WindMemory

RISE_S = 0.5
"""Time constant upwards: a single bad packet at 10 Hz moves an index by 18 % of the distance. A
fault raises it within a second."""
FALL_S = 5.0
"""Time constant downwards: longer than the lulls between gusts and the gaps of a fading radio, so
that plans do not alternate with them."""

_RISK_OF = attrgetter("risk")
_ESTIMATOR = (ESTIMATOR_ACCURACY, ODOMETRY_ACCURACY)
_LEVEL = (*_ESTIMATOR, RECEIVER_ACCURACY)
"""Inputs of the localization risk that report a level accuracy."""


class IndexReport(NamedTuple):
    """An index as measured now: value is the worst risk of its known inputs, None without any.

    worst: input that decides the value. target: value to which the index moves. reported: last
    report of the input that decides the target, with its present age; None if no input decides.
    held: True if that input's risk is unknown now and its last report is held. ever_known: True
    once any input was known. A named tuple for speed: forty are made a second.
    """

    value: float | None = None
    worst: str | None = None
    inputs: tuple[InputReport, ...] = ()
    target: float = 0.0
    reported: InputReport | None = None
    held: bool = False
    ever_known: bool = False

    @property
    def cause(self) -> str | None:
        """Name of the input that decides the target; None if none does."""
        return None if self.reported is None else self.reported.name


@dataclass(frozen=True, slots=True, kw_only=True)
class RiskReport:
    """Reports of the four indices."""

    wind: IndexReport = field(default_factory=IndexReport)
    communication: IndexReport = field(default_factory=IndexReport)
    localization: IndexReport = field(default_factory=IndexReport)
    battery: IndexReport = field(default_factory=IndexReport)


@dataclass(frozen=True, kw_only=True)
class RiskEstimate:
    """Indices, their reports, and the memory for the next `update`.

    Without slots: it is made ten times a second, and what follows from it is computed once.
    """

    indices: RiskIndices
    report: RiskReport = field(default_factory=RiskReport)
    updated_s: float | None = None
    last_known: Mapping[str, Mapping[str, InputReport]] = field(default_factory=dict)
    """Last report with a known risk, by index and input; never changed in place."""
    wind: WindMemory = field(default_factory=WindMemory)
    communication: CommunicationMemory = field(default_factory=CommunicationMemory)
    localization: LocalizationMemory = field(default_factory=LocalizationMemory)
    meter: Meter = field(default_factory=Meter)
    """Meter of the batteries."""

    @cached_property
    def position_uncertainty_m(self) -> float | None:
        """Position uncertainty: the greatest of `position_accuracies`; None without one.

        The way to the place by the line that is not flown yet is added.
        """
        worst_m = max((item.value or 0.0 for item in self.position_accuracies), default=None)
        if worst_m is None or not self._known_now((OFF_LINE,)):
            return worst_m
        return worst_m + (self.last_known["localization"][OFF_LINE].value or 0.0)

    @cached_property
    def position_accuracies(self) -> tuple[InputReport, ...]:
        """Last reports of the position's accuracy that count.

        By the line, while its wires show the place; else the estimator's, else the receiver's.

        Each source's last value counts. While the estimator reports nothing, the receiver counts,
        too. The plane is vertical: level and height accuracy count, and the worse applies to all
        directions, across the plane, too. For height only the estimator counts (ArduPilot reports
        none): height is barometric, which the receiver's v_acc does not describe.
        """
        reported = self.last_known.get("localization", {})
        autopilot = self._autopilot_accuracies(reported)
        return (reported[BY_LINE],) if self._known_now((BY_LINE,)) else autopilot

    def _autopilot_accuracies(self, reported: Mapping[str, InputReport]) -> tuple[InputReport, ...]:
        level = _ESTIMATOR if self._known_now(_ESTIMATOR) else _LEVEL
        sources = (*level, ESTIMATOR_HEIGHT_ACCURACY, ODOMETRY_HEIGHT_ACCURACY)
        return tuple(reported[name] for name in sources if name in reported)

    @cached_property
    def position_accuracy_known(self) -> bool:
        """True if the estimator or a receiver reports its accuracy now."""
        return self._known_now(_LEVEL)

    def _known_now(self, names: tuple[str, ...]) -> bool:
        return any(item.known and item.name in names for item in self.report.localization.inputs)

    @classmethod
    def unknown(cls, model: RiskModel) -> RiskEstimate:
        """Estimate before any telemetry: every index is `model.unknown`."""
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
    tracking_error_m: float | None = None,
    by_line: PlaceByLine | None = None,
    power: PowerModel | None = None,
    demands: Demands | None = None,
) -> RiskEstimate:
    """Estimate updated by the telemetry at `now_s`; designed for calls at about 10 Hz.

    cruise_mps: speed of a return, positive. by_line: None without a sensor of the line.
    power: None for that of a vehicle file without one.
    demands: energy still to be flown; None without a plan.
    """
    if power is None:
        power = PowerModel.made(Power(), model, cruise_mps, cruise_mps, cruise_mps)
    meter = battery.remember(estimate.meter, telemetry, now_s, power)
    memory_wind = wind.remember(estimate.wind, telemetry, model)
    memory_communication = communication.remember(estimate.communication, telemetry, model)
    memory_localization = localization.remember(estimate.localization, telemetry, model)
    inputs = {
        "wind": wind.inputs(telemetry, now_s, model, memory_wind, tracking_error_m),
        "communication": communication.inputs(telemetry, now_s, model, memory_communication),
        "localization": localization.inputs(telemetry, now_s, model, memory_localization, by_line),
        "battery": battery.inputs(telemetry, now_s, model, meter, power, cruise_mps, demands),
    }
    reported_before = {name: estimate.last_known.get(name, {}) for name in inputs}
    reported_before["battery"] = battery.still_there(reported_before["battery"], telemetry)
    last_known = {
        name: _last_known(reported_before[name], reports) for name, reports in inputs.items()
    }
    counted = last_known
    if localization.better_by_line(inputs["localization"]):
        # What is kept has the risk that counts without the line.
        beside = partial(localization.beside_line, model=model)
        inputs["localization"] = tuple(map(beside, inputs["localization"]))
        kept = last_known["localization"].items()
        counted = {**last_known, "localization": {name: beside(item) for name, item in kept}}
    before = estimate.indices.as_dict()
    report = {
        name: _report(reports, counted[name], before[name], model.unknown, now_s)
        for name, reports in inputs.items()
    }
    elapsed_s = 0.0 if estimate.updated_s is None else max(0.0, now_s - estimate.updated_s)
    after = {name: _follow(before[name], index, elapsed_s) for name, index in report.items()}
    return RiskEstimate(
        indices=RiskIndices(**after),
        report=RiskReport(**report),
        updated_s=now_s,
        last_known=last_known,
        wind=memory_wind,
        communication=memory_communication,
        localization=memory_localization,
        meter=meter,
    )


def _last_known(
    before: Mapping[str, InputReport], reports: tuple[InputReport, ...]
) -> Mapping[str, InputReport]:
    """Last known report of every input that was ever known, and still applies."""
    after = {**before}
    for report in reports:
        if report.risk is not None:
            after[report.name] = report
        elif not report.applies:
            after.pop(report.name, None)
    return after


def _report(
    reports: tuple[InputReport, ...],
    last_known: Mapping[str, InputReport],
    index: float,
    unknown: float,
    now_s: float,
) -> IndexReport:
    """Report of an index with the present value `index`, and its target."""
    known = [report for report in reports if report.risk is not None]
    worst = max(known, key=_RISK_OF, default=None)
    cause = max(last_known.values(), key=_RISK_OF, default=None)
    target = unknown if cause is None else cause.risk or 0.0
    least = 0.0 if worst is not None else max(index, unknown)
    reported = cause if target >= least else None
    held = reported is not None and reported not in reports
    if held and reported is not None and reported.received_s is not None:
        reported = reported._replace(age_s=max(0.0, now_s - reported.received_s), risk=None)
    return IndexReport(
        value=None if worst is None else worst.risk,
        worst=None if worst is None else worst.name,
        inputs=reports,
        target=max(target, least),
        reported=reported,
        held=held,
        ever_known=cause is not None,
    )


def _follow(index: float, report: IndexReport, elapsed_s: float) -> float:
    """Index after `elapsed_s`: first order towards its target; at once without known inputs."""
    target = report.target
    if report.value is None:
        return target
    time_constant_s = RISE_S if target > index else FALL_S
    return index + (target - index) * -math.expm1(-elapsed_s / time_constant_s)

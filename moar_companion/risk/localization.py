"""Localization risk LR (paper, Section IV-C (c)): satellites and their dilution of precision.

Inputs: the receivers' fix, satellites, dilution, accuracy and running clocks; the estimator's
accuracy, innovations, resets and horizontal position flag; the strength of the magnetic field,
which changes near conductors and steel.

The strength does not depend on the attitude, so that its change needs no simultaneous attitude. The
compass innovation, the difference of heading and field direction, shows a field that only turns.
The direction computed here from field and attitude would repeat that, later and less precisely. If
the estimator accepts a false field, the heading turns with it, and only the strength shows it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from ..mavlink.telemetry import LandedState, MagneticField, Odometry, Telemetry
from ..settings.risk_model import RiskModel
from .input_reports import YES_OR_NO, InputReport, certain, source_at, source_of
from .receivers import (
    RECEIVER_ACCURACY,
    Memories,
    ReceiverMemory,
    positive,
    receiver_inputs,
)

_ESTIMATOR_MAX_AGE_S = 3.0
"""Maximum age of ESTIMATOR_STATUS (PX4: 1 Hz), EKF_STATUS_REPORT and ODOMETRY (5 Hz): 3 periods
at 1 Hz."""
ESTIMATOR_ACCURACY = "estimator accuracy"
ESTIMATOR_HEIGHT_ACCURACY = "estimator height accuracy"
ODOMETRY_ACCURACY = "odometry accuracy"
ODOMETRY_HEIGHT_ACCURACY = "odometry height accuracy"
BY_LINE, OFF_LINE = "place by the line", "pose off the line's place"
LINE_MAX_AGE_S = 1.0
"""Maximum age of a report of the perception: it comes at least five times a second."""
_RESETS_S = 10.0
"""Time for which a reset counts: the same as the supervisor's for a jump."""
_CLOCK_BACK_S = 1.0
"""Least step back of the autopilot's clock that means a restart: packets overtake by less."""
_FIELD_MAX_AGE_S = 3.0
"""Maximum age of HIGHRES_IMU (PX4: 50 Hz) and RAW_IMU (requested at 2 Hz); a slow link has less."""
_FIELD_MIN_GAUSS = 0.01
"""Least plausible field of a magnetometer: the earth's weakest field has 0.2 gauss."""
_FIELD_MEAN_S = 300.0
"""Time constant of the mean: an approach to a line is shorter, an inspection little longer."""
_FIELD_KNOWN_S = 5.0
"""Least duration of a valid mean."""
_FIELD_SETTLED_S = 30.0
"""Time in the air until the mean is settled; before, it contains the steel around the pad."""
_FIELD_CHANGED = 0.2
"""Fraction of the time that counts while a change is a risk. Small, so that a line's field does not
become usual; not 0, as the earlier mean may be that of steel under a hover."""


class PlaceByLine(NamedTuple):
    """Place that the line's wires show. received_s: of the report.

    uncertainty_m: of the place; None while nothing is known of it. off_m: from there to the pose
    that is flown with now, which follows it.
    """

    received_s: float
    uncertainty_m: float | None
    off_m: float
    wires: int


class FieldMean(NamedTuple):
    """Mean strength of the magnetic field since `since_s`, or over the last minutes.

    The mean restarts at each take-off and landing. In the air a change that is a risk becomes usual
    slowly: a fifth of its duration counts. grounded: True for the mean on the ground.
    """

    since_s: float
    received_s: float
    mean_gauss: float
    grounded: bool = False

    def read(self, latest: MagneticField, model: RiskModel) -> FieldMean:
        """Mean updated by a measurement."""
        elapsed_s = latest.received_s - self.received_s
        if elapsed_s <= 0.0:
            return self
        settled = not self.grounded and self.received_s - self.since_s >= _FIELD_SETTLED_S
        change = abs(latest.strength_gauss / self.mean_gauss - 1.0)
        if settled and model.magnetic_change.fraction(change) > 0.0:
            elapsed_s *= _FIELD_CHANGED
        known_s = self.received_s - self.since_s + elapsed_s
        share = elapsed_s / min(known_s, _FIELD_MEAN_S + elapsed_s)
        mean_gauss = (1.0 - share) * self.mean_gauss + share * latest.strength_gauss
        since_s = latest.received_s - known_s
        return self._replace(since_s=since_s, received_s=latest.received_s, mean_gauss=mean_gauss)

    def change(self, latest: MagneticField) -> float | None:
        """Difference of a measurement from the mean, as a fraction of it; None: too early."""
        if self.received_s - self.since_s < _FIELD_KNOWN_S:
            return None
        return abs(latest.strength_gauss / self.mean_gauss - 1.0)


class Resets(NamedTuple):
    """Times at which the estimator's reset counter changed, over the last seconds."""

    counter: int
    changed_s: tuple[float, ...] = ()

    def read(self, latest: Odometry) -> Resets:
        """Resets updated by an odometry message; several at once count as one."""
        if latest.reset_counter == self.counter:
            return self
        changed_s = (*self.changed_s, latest.received_s)
        return Resets(counter=latest.reset_counter, changed_s=_recent(changed_s, latest.received_s))

    def count(self, latest: Odometry) -> int:
        """Number of recent resets at the time of this message."""
        return len(_recent(self.changed_s, latest.received_s))


def _recent(times_s: tuple[float, ...], now_s: float) -> tuple[float, ...]:
    return tuple(time_s for time_s in times_s if now_s - time_s < _RESETS_S)


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalizationMemory:
    """Memory of the receivers, the estimator's resets and the magnetic field."""

    receivers: Memories = field(default=(ReceiverMemory(), ReceiverMemory()))
    resets: Resets | None = None
    boot_s: float = -math.inf
    """Time of the autopilot's own clock."""
    field_mean: FieldMean | None = None


def remember(
    memory: LocalizationMemory, telemetry: Telemetry, model: RiskModel
) -> LocalizationMemory:
    """Memory updated by the telemetry."""
    first, second = memory.receivers
    position, boot_s = telemetry.local_position, memory.boot_s
    if position is not None and math.isfinite(position.boot_s):
        boot_s = position.boot_s
    restarted = boot_s < memory.boot_s - _CLOCK_BACK_S  # then the counter restarts
    return LocalizationMemory(
        receivers=(first.read(telemetry.gnss), second.read(telemetry.second_gnss)),
        resets=_resets(None if restarted else memory.resets, telemetry.odometry),
        boot_s=boot_s,
        field_mean=_field_mean(memory.field_mean, telemetry, model),
    )


def _resets(before: Resets | None, latest: Odometry | None) -> Resets | None:
    if latest is None:  # counted resets stay
        return before
    return Resets(counter=latest.reset_counter) if before is None else before.read(latest)


def _field_mean(
    before: FieldMean | None, telemetry: Telemetry, model: RiskModel
) -> FieldMean | None:
    latest, landed = telemetry.magnetic_field, telemetry.landed
    if latest is None or not _FIELD_MIN_GAUSS < latest.strength_gauss < math.inf:
        return before
    grounded = before is not None and before.grounded
    if landed is not None:
        grounded = landed.state is LandedState.ON_GROUND
    if before is not None and before.grounded is grounded:
        return before.read(latest, model)
    return FieldMean(
        since_s=latest.received_s,
        received_s=latest.received_s,
        mean_gauss=latest.strength_gauss,
        grounded=grounded,
    )


def inputs(
    telemetry: Telemetry,
    now_s: float,
    model: RiskModel,
    memory: LocalizationMemory,
    by_line: PlaceByLine | None = None,
) -> tuple[InputReport, ...]:
    """Normalised inputs of the localization risk; `memory` includes this telemetry.

    by_line: None without a sensor that sees the line.
    """
    estimator, odometry, resets = telemetry.estimator, telemetry.odometry, memory.resets
    receivers = receiver_inputs(telemetry, memory.receivers, now_s, model)
    better = by_line is not None and _is_better(by_line, telemetry, receivers)
    level, height = model.horizontal_accuracy_m, model.vertical_accuracy_m
    magnetic, mean = telemetry.magnetic_field, memory.field_mean
    estimated = source_of(estimator, now_s, _ESTIMATOR_MAX_AGE_S)
    tracked = source_of(odometry, now_s, _ESTIMATOR_MAX_AGE_S)
    position = (
        *receivers,
        estimated.input_report(
            ESTIMATOR_ACCURACY,
            None if estimator is None else positive(estimator.horizontal_accuracy_m),
            "m",
            level.fraction,
        ),
        estimated.input_report(
            "estimator without position",
            None if estimator is None else float(not estimator.horizontal_position_ok),
            YES_OR_NO,
            certain,
        ),
        *(
            estimated.input_report(
                f"{source} innovation",
                None if estimator is None else getattr(estimator, f"{source}_innovation"),
                "of what is accepted",
                model.innovation.fraction,
            )
            for source in ("velocity", "position", "height", "compass")
        ),
        tracked.input_report(
            ODOMETRY_ACCURACY,
            None if odometry is None else positive(odometry.horizontal_accuracy_m),
            "m",
            level.fraction,
        ),
    )
    # A height, an estimator without resets and a steady field do not prove a position.
    alone = not any(report.known for report in position)
    return (
        *position,
        *(() if by_line is None else _by_line(by_line, now_s, model, counts=better)),
        estimated.input_report(
            ESTIMATOR_HEIGHT_ACCURACY,
            None if alone or estimator is None else positive(estimator.vertical_accuracy_m),
            "m",
            height.fraction,
        ),
        tracked.input_report(
            ODOMETRY_HEIGHT_ACCURACY,
            None if alone or odometry is None else positive(odometry.vertical_accuracy_m),
            "m",
            height.fraction,
        ),
        tracked.input_report(
            "position resets",
            None if alone or odometry is None or resets is None else resets.count(odometry),
            "",
            model.position_resets.fraction,
        ),
        source_of(magnetic, now_s, _FIELD_MAX_AGE_S).input_report(
            "magnetic field change",
            None if alone or magnetic is None or mean is None else mean.change(magnetic),
            "of its mean",
            model.magnetic_change.fraction,
        ),
    )


def better_by_line(inputs: Iterable[InputReport]) -> bool:
    """True while the place by the line counts: it is better than the autopilot's own."""
    return any(each.known and each.name == BY_LINE for each in inputs)


def beside_line(report: InputReport, model: RiskModel) -> InputReport:
    """A report as it counts while the place by the line is better.

    The autopilot's accuracies count from the middle of their ranges on: near their ends the
    autopilot itself gives its position up.
    """
    spans = {
        ESTIMATOR_ACCURACY: model.horizontal_accuracy_m,
        ODOMETRY_ACCURACY: model.horizontal_accuracy_m,
        ESTIMATOR_HEIGHT_ACCURACY: model.vertical_accuracy_m,
        ODOMETRY_HEIGHT_ACCURACY: model.vertical_accuracy_m,
    }
    span = spans.get(report.name)
    if span is None or report.value is None or not report.known:
        return report
    return report._replace(risk=span.second_half.fraction(report.value))


def _is_better(
    place: PlaceByLine, telemetry: Telemetry, receivers: tuple[InputReport, ...]
) -> bool:
    """True if the place by the line is known better than the autopilot's own.

    The receiver's accuracy counts where the estimator reports none.
    """
    sources = [each for each in (telemetry.estimator, telemetry.odometry) if each is not None]
    level = [positive(each.horizontal_accuracy_m) for each in sources]
    if not any(level):
        level = [each.value for each in receivers if each.name == RECEIVER_ACCURACY]
    height = [positive(each.vertical_accuracy_m) for each in sources]
    worst_m = max((each for each in (*level, *height) if each is not None), default=math.inf)
    return place.uncertainty_m is not None and place.uncertainty_m < worst_m


def _by_line(
    place: PlaceByLine, now_s: float, model: RiskModel, *, counts: bool
) -> tuple[InputReport, ...]:
    """Reports of the place by the line; out of its sight the autopilot's is better again."""
    source, risk = source_of(place, now_s, LINE_MAX_AGE_S), model.horizontal_accuracy_m.fraction
    wires = f"by {place.wires} wires"
    known_m = place.uncertainty_m if counts else None
    return (
        source.input_report(BY_LINE, known_m, "m", risk, applies=counts, remark=wires),
        source_at(now_s, now_s, LINE_MAX_AGE_S).input_report(OFF_LINE, place.off_m, "m", risk),
    )

"""Localization risk LR (paper, Section IV-C (c)): satellites and their dilution of precision.

Inputs: the receiver's fix, satellites, HDOP and accuracy, the estimator's accuracy and its own
word on its horizontal position, and whether the receiver's clock still runs: autopilots go on
repeating a dead receiver's last good values for seconds.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..types import Telemetry
from ..vehicle import RiskModel
from .inputs import InputReport, certain, measured

GNSS_MAX_AGE_S = 3.0
"""GPS_RAW_INT comes at 5 to 8 Hz, at 1 Hz while PX4's receiver is silent: 3 periods."""
ESTIMATOR_MAX_AGE_S = 3.0
"""ESTIMATOR_STATUS comes at 1 Hz (PX4), EKF_STATUS_REPORT at 5 Hz: 3 periods."""
FROZEN_S = 1.5
"""A receiver measures at least once a second; ArduPilot repeats a dead one for 4 s."""
_FIX_3D = 3
"""GPS_FIX_TYPE_3D_FIX; better fixes have greater numbers."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LocalizationMemory:
    """The receiver's clock, and when it was first received with that reading."""

    receiver_s: float | None = None
    since_s: float = 0.0


def remember(memory: LocalizationMemory, telemetry: Telemetry) -> LocalizationMemory:
    """The memory with the latest reading of the receiver's clock."""
    gnss = telemetry.gnss
    if gnss is None or gnss.receiver_s == memory.receiver_s:
        return memory
    return LocalizationMemory(receiver_s=gnss.receiver_s, since_s=gnss.received_s)


def inputs(
    telemetry: Telemetry, now_s: float, model: RiskModel, memory: LocalizationMemory
) -> tuple[InputReport, ...]:
    """The normalised inputs of the localization risk; `memory` includes this telemetry."""
    gnss, estimator = telemetry.gnss, telemetry.estimator
    gnss_s = None if gnss is None else gnss.received_s
    estimator_s = None if estimator is None else estimator.received_s
    frozen_s = None
    if gnss is not None and gnss.receiver_s is not None:
        frozen_s = gnss.received_s - memory.since_s
    return (
        measured(
            "fix type",
            None if gnss is None else gnss.fix_type,
            "",
            received_s=gnss_s,
            now_s=now_s,
            max_age_s=GNSS_MAX_AGE_S,
            risk=lambda fix_type: certain(fix_type < _FIX_3D),
        ),
        measured(
            "satellites",
            None if gnss is None else gnss.satellites,
            "",
            received_s=gnss_s,
            now_s=now_s,
            max_age_s=GNSS_MAX_AGE_S,
            risk=model.satellites.fraction,
        ),
        measured(
            "hdop",
            None if gnss is None else _positive(gnss.hdop),
            "",
            received_s=gnss_s,
            now_s=now_s,
            max_age_s=GNSS_MAX_AGE_S,
            risk=model.hdop.fraction,
        ),
        measured(
            "receiver accuracy",
            None if gnss is None else _positive(gnss.horizontal_accuracy_m),
            "m",
            received_s=gnss_s,
            now_s=now_s,
            max_age_s=GNSS_MAX_AGE_S,
            risk=model.horizontal_accuracy_m.fraction,
        ),
        measured(
            "receiver clock stopped",
            frozen_s,
            "s",
            received_s=gnss_s,
            now_s=now_s,
            max_age_s=GNSS_MAX_AGE_S,
            risk=lambda stopped_s: certain(stopped_s > FROZEN_S),
        ),
        measured(
            "estimator accuracy",
            None if estimator is None else _positive(estimator.horizontal_accuracy_m),
            "m",
            received_s=estimator_s,
            now_s=now_s,
            max_age_s=ESTIMATOR_MAX_AGE_S,
            risk=model.horizontal_accuracy_m.fraction,
        ),
        measured(
            "estimator without position",
            None if estimator is None else float(not estimator.horizontal_position_ok),
            "",
            received_s=estimator_s,
            now_s=now_s,
            max_age_s=ESTIMATOR_MAX_AGE_S,
            risk=certain,
        ),
    )


def _positive(value: float | None) -> float | None:
    """An accuracy or dilution; 0 is how receivers say that they do not know."""
    return value if value is not None and value > 0.0 else None

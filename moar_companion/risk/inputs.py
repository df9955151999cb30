"""One measured input of a risk index, and when it counts.

Risk is judged only from what was measured recently. An input that was never heard, says
"unknown", or is older than its source allows has no risk (`None`), never a risk of 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class InputReport:
    """An input as last heard: what it said, how long ago, and the risk that follows.

    age_s: None where the source was never heard. risk: in [0, 1], None where it is unknown now.
    """

    name: str
    value: float | None
    unit: str
    age_s: float | None
    risk: float | None


def measured(
    name: str,
    value: float | None,
    unit: str,
    *,
    received_s: float | None,
    now_s: float,
    max_age_s: float,
    risk: Callable[[float], float],
) -> InputReport:
    """The report of a value received at `received_s`; its risk counts up to `max_age_s` later.

    `received_s` is None where the source was never heard; a value that is not finite is None.
    """
    if value is not None and not math.isfinite(value):
        value = None
    age_s = None if received_s is None else max(0.0, now_s - received_s)
    fresh = age_s is not None and age_s <= max_age_s
    return InputReport(
        name=name,
        value=value,
        unit=unit,
        age_s=age_s,
        risk=risk(value) if fresh and value is not None else None,
    )


def certain(bad: float) -> float:
    """The risk of a yes-or-no input: 1 where something is wrong (`bad` not 0), else 0."""
    return 0.0 if bad == 0.0 else 1.0


def at_least_unknown_alone(
    risk: Callable[[float], float], others: tuple[InputReport, ...], unknown: float
) -> Callable[[float], float]:
    """The risk of an input that can tell trouble, but not by itself that all is well.

    At least `unknown` as long as none of the `others` is known.
    """
    if any(other.risk is not None for other in others):
        return risk
    return lambda value: max(unknown, risk(value))

"""One measured input of a risk index, and when it counts.

Risk is judged only from what was measured recently. An input that was never heard, says
"unknown", or is older than its source allows has no risk (`None`), never a risk of 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

YES_OR_NO = "yes or no"
"""The unit of what is so (1) or is not (0)."""
_OF = "of "


def read(value: float | None, unit: str) -> str:
    """A value for a person: angles in degrees, fractions in percent, counts as they are."""
    if value is None:
        return "unknown"
    if unit == "":
        return f"{value:.0f}" if float(value).is_integer() else f"{value:.2f}"
    if unit.startswith(_OF):
        return f"{value:.0%}"
    if unit == "rad":
        return f"{math.degrees(value):.1f}°"
    if unit == YES_OR_NO:
        return "yes" if value else "no"
    return f"{value:.2f} V" if unit == "V" else f"{value:.1f} {unit}"


class InputReport(NamedTuple):
    """An input as last heard: what it said, how long ago, and the risk that follows.

    age_s: None where the source was never heard. risk: in [0, 1], None where it is unknown now.
    applies: whether it could say anything now. What does not apply (the tracking error of an
    aircraft that others fly) is not missing: its last risk is forgotten, and nothing is held.
    unit: `YES_OR_NO` and `of ...`, of a fraction, among them. remark: what the value is worth, or
    means. heard_s: when the source was last heard. A named tuple, for some hundreds are made a
    second.
    """

    name: str
    value: float | None
    unit: str
    age_s: float | None
    risk: float | None
    applies: bool = True
    remark: str = ""
    heard_s: float | None = None

    @property
    def known(self) -> bool:
        """Whether it counts now."""
        return self.risk is not None

    @property
    def reading(self) -> str:
        """The value for a person."""
        return read(self.value, self.unit)

    @property
    def phrase(self) -> str:
        """What was said, in words: `motor output 93% of its range`; the name where nothing was."""
        if self.value is None:
            return self.name
        if self.unit == YES_OR_NO:
            return f"{self.name}: {self.reading}"
        whole = f" {self.unit}" if self.unit.startswith(_OF) else ""
        remark = f" ({self.remark})" if self.remark else ""
        return f"{self.name} {self.reading}{whole}{remark}"


class Source(NamedTuple):
    """When a source was last heard. age_s: None where it never was. fresh: whether that counts."""

    age_s: float | None
    fresh: bool
    heard_s: float | None

    def says(
        self,
        name: str,
        value: float | None,
        unit: str,
        risk: Callable[[float], float],
        *,
        applies: bool = True,
        remark: str = "",
    ) -> InputReport:
        """The report of a value that it told; one that is not finite is None."""
        age_s, fresh, heard_s = self
        if value is not None and not math.isfinite(value):
            value = None
        counts = risk(value) if fresh and value is not None else None
        # Past its own __new__, which takes as long again.
        told = (name, value, unit, age_s, counts, applies, remark, heard_s)
        return tuple.__new__(InputReport, told)


_NEVER = Source(None, fresh=False, heard_s=None)


class _Sample(Protocol):
    @property
    def received_s(self) -> float: ...


def heard(sample: _Sample | None, now_s: float, max_age_s: float) -> Source:
    """The source of a sample; what it says counts for `max_age_s`."""
    return heard_at(None if sample is None else sample.received_s, now_s, max_age_s)


def heard_at(received_s: float | None, now_s: float, max_age_s: float) -> Source:
    """The source that was last heard then; None: never."""
    if received_s is None:
        return _NEVER
    age_s = max(0.0, now_s - received_s)
    return Source(age_s, age_s <= max_age_s, received_s)


def certain(bad: float) -> float:
    """The risk of a yes-or-no input: 1 where something is wrong (`bad` not 0), else 0."""
    return 0.0 if bad == 0.0 else 1.0

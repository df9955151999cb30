"""One measured input of a risk index, and the conditions under which it counts.

Only recent measurements give a risk. An input that was never received, is "unknown", or is older
than its source allows has no risk (`None`), never a risk of 0.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple, Protocol

YES_OR_NO = "yes or no"
"""Unit of an input that is true (1) or false (0)."""
_OF = "of "


def read(value: float | None, unit: str) -> str:
    """Value as a text: angles in degrees, fractions in percent, counts unchanged."""
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
    """An input as last received: its value, its age, and the resulting risk.

    age_s: None if the source was never received. risk: in [0, 1], None if unknown now. applies:
    False if the input has no meaning now, as the tracking error while the companion does not fly
    the aircraft. Such an input is not missing: its last risk is dropped, and nothing is held.
    unit: also `YES_OR_NO`, and `of ...` for a fraction. remark: reliability or meaning of the
    value. received_s: time of the source's last message. A named tuple for speed: some hundreds are
    made a second.
    """

    name: str
    value: float | None
    unit: str
    age_s: float | None
    risk: float | None
    applies: bool = True
    remark: str = ""
    received_s: float | None = None

    @property
    def known(self) -> bool:
        """True if the input counts now."""
        return self.risk is not None

    @property
    def reading(self) -> str:
        """The value as a text."""
        return read(self.value, self.unit)

    @property
    def phrase(self) -> str:
        """Text of name and value: `motor output 93% of its range`; the name without a value."""
        if self.value is None:
            return self.name
        if self.unit == YES_OR_NO:
            return f"{self.name}: {self.reading}"
        whole = f" {self.unit}" if self.unit.startswith(_OF) else ""
        remark = f" ({self.remark})" if self.remark else ""
        return f"{self.name} {self.reading}{whole}{remark}"


class Source(NamedTuple):
    """Last reception of a source. age_s: None if never received. fresh: True if it counts."""

    age_s: float | None
    fresh: bool
    received_s: float | None

    def input_report(
        self,
        name: str,
        value: float | None,
        unit: str,
        risk: Callable[[float], float],
        *,
        applies: bool = True,
        remark: str = "",
    ) -> InputReport:
        """Report of a value of this source; a value that is not finite is None."""
        age_s, fresh, received_s = self
        if value is not None and not math.isfinite(value):
            value = None
        counts = risk(value) if fresh and value is not None else None
        # Bypasses the class's own __new__, which doubles the time.
        values = (name, value, unit, age_s, counts, applies, remark, received_s)
        return tuple.__new__(InputReport, values)


_NEVER = Source(None, fresh=False, received_s=None)


class _Sample(Protocol):
    @property
    def received_s(self) -> float: ...


def source_of(sample: _Sample | None, now_s: float, max_age_s: float) -> Source:
    """Source of a sample, which counts for `max_age_s`."""
    return source_at(None if sample is None else sample.received_s, now_s, max_age_s)


def source_at(received_s: float | None, now_s: float, max_age_s: float) -> Source:
    """Source last received at `received_s`; None: never."""
    if received_s is None:
        return _NEVER
    age_s = max(0.0, now_s - received_s)
    return Source(age_s, age_s <= max_age_s, received_s)


def certain(bad: float) -> float:
    """Risk of a yes-or-no input: 1 for a fault (`bad` not 0), otherwise 0."""
    return 0.0 if bad == 0.0 else 1.0

"""Values to plot: NAMED_VALUE_FLOAT and NAMED_VALUE_INT of one table. No I/O.

In: values by name; None, NaN and infinity are unknown, and are not sent. Out: messages.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ..dialect import Message
from ..translate_outgoing import is_sendable, named_value_message


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedValue:
    """A value to plot. whole: it goes out as NAMED_VALUE_INT."""

    name: str
    unit: str
    about: str
    whole: bool = False


NAMED_VALUES: Mapping[str, NamedValue] = {
    value.name: value
    for value in (
        NamedValue(name="RISK_WIND", unit="", about="wind risk, 0 to 1"),
        NamedValue(name="RISK_COMM", unit="", about="communication risk, 0 to 1"),
        NamedValue(name="RISK_LOC", unit="", about="localization risk, 0 to 1"),
        NamedValue(name="RISK_BATT", unit="", about="battery risk, 0 to 1"),
        NamedValue(name="K_SAFETY", unit="", about="weight of safety, k_S"),
        NamedValue(name="K_TIME", unit="", about="weight of time, k_T"),
        NamedValue(name="K_ENERGY", unit="", about="weight of energy, k_E"),
        NamedValue(
            name="RESERVE_S",
            unit="s",
            about="flight time left after the better escape route is flown",
        ),
        NamedValue(name="CLEARANCE", unit="m", about="from the hull to the nearest obstacle"),
        NamedValue(name="TO_GO", unit="m", about="along the path to its end, landing leg included"),
        NamedValue(
            name="M_STATE",
            unit="",
            about="mission state as custom_mode of the heartbeat",
            whole=True,
        ),
        NamedValue(
            name="M_TARGET",
            unit="",
            about="number of the target that is flown to, from 0, as param2 of its order",
            whole=True,
        ),
        NamedValue(
            name="CONDITION",
            unit="",
            about="number of the gravest condition that acts (see Conditions); 0: none",
            whole=True,
        ),
    )
}
"""All of them, by name."""


class NamedValues:
    """The latest values, as messages."""

    def __init__(self) -> None:
        self._values: dict[str, float] = {}

    def take(self, values: Mapping[str, float | None]) -> None:
        """Takes all values that are known now, by name."""
        self._values = {
            name: value
            for name, value in values.items()
            if value is not None and is_sendable(value)
        }

    def floats(self, now_s: float) -> list[Message]:
        """NAMED_VALUE_FLOAT of each known value."""
        return self._messages(now_s, whole=False)

    def integers(self, now_s: float) -> list[Message]:
        """NAMED_VALUE_INT of each known value."""
        return self._messages(now_s, whole=True)

    def _messages(self, now_s: float, *, whole: bool) -> list[Message]:
        return [
            named_value_message(name, value, now_s, whole=whole)
            for name, value in self._values.items()
            if NAMED_VALUES[name].whole is whole
        ]

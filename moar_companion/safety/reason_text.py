"""Numbers in reasons, as text: a value above its limit, a distance, a compass point. Pure."""

from __future__ import annotations

import math

_COMPASS = (
    "north",
    "north-east",
    "east",
    "south-east",
    "south",
    "south-west",
    "west",
    "north-west",
)
_WHOLE = 100.0
"""From this value on decimals are omitted."""
_MOST_SHOWN = 99_999.0
_MOST_DIGITS = 2


def exceeds(what: str, value: float | None, limit: float, unit: str) -> str | None:
    """Text for a value above its limit: `wind 12.3 m/s > 10`; None where it is not above.

    Enough digits are shown that both differ; `wind over 10 m/s` where that takes too many.
    """
    if value is None or value <= limit:
        return None
    shown = digits_above(value, limit)
    words = ("over", f"{limit:g}", unit) if shown is None else (shown, unit, ">", f"{limit:g}")
    return " ".join(filter(None, (what, *words)))


def digits_above(value: float, limit: float) -> str | None:
    """A value above its limit, with enough digits that both differ; None where too many."""
    value = min(value, _MOST_SHOWN)
    if value >= _WHOLE and round(value) > limit:
        return f"{value:.0f}"
    digits = range(1, _MOST_DIGITS + 1)
    return next((f"{value:.{n}f}" for n in digits if round(value, n) > limit), None)


def distance(value_m: float) -> str:
    """A distance above 0 as text, never 0.0."""
    return digits_above(value_m, 0.0) or "0.01"


def compass(towards_rad: float) -> str:
    """The nearest of the eight compass points to a direction from north, as text."""
    return _COMPASS[round(towards_rad / (math.tau / len(_COMPASS))) % len(_COMPASS)]

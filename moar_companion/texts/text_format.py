"""Format of texts for pilots: one STATUSTEXT each, numbers with their limits, names cut to fit.

Inputs: reasons, values, names; outputs: texts. Details in parentheses are for the record: a pilot
does not receive them. Pure.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

TEXT_CHARS = 50
"""Characters of one STATUSTEXT without chunks."""
PREFIX = "MOAR: "
_NAME_CHARS = 16
_CUT = ".."
_DETAIL = re.compile(r"\s*\([^()]*\)")
_MACHINE_WORD = re.compile(r"(?<=[a-z])_(?=[a-z])")
"""Underscore as in `at_target`; parameters, as GF_MAX_HOR_DIST, keep theirs."""
_COMPASS = ("N", "NE", "E", "SE", "S", "SW", "W", "NW")
_WHOLE = 100.0
"""From this value on decimals are omitted."""
_MOST_SHOWN = 99_999.0
_MOST_DIGITS = 2


def pilot_text(reason: str, action: str = "") -> str:
    """Text for pilots that fits into one chunk: `MOAR: wind 12.3 m/s > 10, holding`.

    reason: the fault with value and limit; details in parentheses are left out. action: of the
    companion.
    """
    tail = f", {action}" if action else ""
    return f"{PREFIX}{_shortened(reason, reason_chars(action))}{tail}"


def reason_chars(action: str) -> int:
    """Characters of a reason that is sent with this action."""
    return TEXT_CHARS - len(PREFIX) - (len(action) + 2 if action else 0)


def without_details(reason: str) -> str:
    """The part of a reason that a pilot receives."""
    before = ""
    while before != reason:  # details may be nested
        before, reason = reason, _DETAIL.sub("", reason)
    return reason


def _shortened(reason: str, room: int) -> str:
    """Text without details. Of a text that is too long, cuts words, then clauses, then characters.

    The companion's own texts all fit: only a text of another source is cut.
    """
    words = _MACHINE_WORD.sub(" ", without_details(reason)).split()
    if len(" ".join(words)) > room:
        words = [short_name(word) for word in words]
    text = " ".join(words)
    for separator in (", ", " "):
        while len(text) > room and separator in text:
            text = text.rpartition(separator)[0].rstrip(",;:")
    return text[:room]


def printable(text: str) -> str:
    """External text on one line: control characters, which steer a terminal, become blanks.

    What is no character, as in the name of a file, is shown by its number.
    """
    shown = text.encode(errors="backslashreplace").decode()
    return "".join(char if char.isprintable() else " " for char in shown)


def short_name(name: str, most: int = _NAME_CHARS) -> str:
    """Name of a target or an obstacle, cut to at most 16 characters to leave room for the rest."""
    most = min(most, _NAME_CHARS)
    return name if len(name) <= most else name[: max(0, most - len(_CUT))].rstrip() + _CUT


def with_name(pattern: str, name: str, most: int) -> str:
    """Text with a name in place of `{}`, which is cut so that the text has at most `most`."""
    return pattern.format(short_name(name, most - len(pattern.format(""))))


def listed(what: str, names: Sequence[str], most: int) -> str:
    """Text of names: `unknown: wind, battery and 3 more (…)`, in at most `most` characters."""
    for count in range(len(names), 0, -1):
        shown, others = ", ".join(names[:count]), names[count:]
        text = f"{what}: {shown} and {len(others)} more" if others else f"{what}: {shown}"
        if len(text) <= most or count == 1:
            return f"{text} ({', '.join(others)})" if others else text
    return what


def exceeds(what: str, value: float | None, limit: float, unit: str) -> str | None:
    """Text for a value above its limit: `wind 12.3 m/s > 10`; None where it is not above.

    Enough digits are shown that both differ; `wind over 10 m/s` where that takes too many.
    """
    if value is None or value <= limit:
        return None
    least = limit_text(limit)
    shown = digits_above(value, max(limit, float(least)))
    words = ("over", least, unit) if shown is None else (shown, unit, ">", least)
    return " ".join(filter(None, (what, *words)))


def digits_above(value: float, limit: float) -> str | None:
    """A value above its limit, with enough digits that both differ; None where too many."""
    value = min(value, _MOST_SHOWN)
    if value >= _WHOLE and round(value) > limit:
        return f"{value:.0f}"
    digits = range(1, _MOST_DIGITS + 1)
    return next((f"{value:.{n}f}" for n in digits if round(value, n) > limit), None)


def limit_text(limit: float) -> str:
    """A limit as text, in at most five characters above 0.001."""
    return f"{limit:.0f}" if limit >= _WHOLE else f"{limit:.3g}"


def distance(value_m: float) -> str:
    """A distance above 0 as text, never 0.0; in at most five characters."""
    return digits_above(value_m, 0.0) or "0.01"


def coordinate(value: float, digits: int = 1) -> str:
    """A coordinate or a fraction as text; 0 without decimals and sign."""
    shown = f"{value:.{digits}f}"
    return shown if float(shown) else "0"


def seconds(value_s: float) -> str:
    """A time in whole seconds as text, in at most four characters."""
    return f"{min(value_s, 9_999.0):.0f}"


def compass(towards_rad: float) -> str:
    """The nearest of the eight compass points to a direction from north, as N, NE, and so on."""
    return _COMPASS[round(towards_rad / (math.tau / len(_COMPASS))) % len(_COMPASS)]


def plural(count: int) -> str:
    """Ending of a noun after a number."""
    return "" if count == 1 else "s"

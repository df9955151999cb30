"""Form of a text for pilots: its pattern, its actions, and the fields that vary in it. Pure.

The texts themselves: `pilot_texts`, `service_texts`.
"""

from __future__ import annotations

import string
from collections.abc import Mapping
from dataclasses import dataclass

from .text_format import pilot_text, reason_chars, short_name

NAMES = frozenset({"target", "obstacle", "conductor", "host"})
"""Fields that are cut to the available room."""
FIELDS: Mapping[str, tuple[str, str]] = {
    "mission": ("inspection", "evacuation"),
    "escape": ("exit", "evacuation"),
    "target": ("splice-1", "M" * 100),
    "obstacle": ("tower", "M" * 100),
    "conductor": ("right-middle", "M" * 100),
    "host": ("192.168.1.20", "255.255.255.255"),
    "fence": ("FENCE_RADIUS 50 m", "GF_MAX_HOR_DIST 10000 m"),
    "mode": ("POSCTL", "LOITER_ALT_QLAND"),
    "own_mode": ("OFFBOARD", "OFFBOARD"),
    "state": ("holding", "planning"),
    "before": ("flying inspection", "landing leg of the evacuation"),
    "order": ("release", "release"),
    "kind": ("mode", "position"),
    "risk": ("wind", "communication"),
    "path": ("path 1.4 m outward", "path 9999 m outward"),
    "trigger": ("RC loss", "companion loss"),
    "link": ("RC loss", "GPS loss"),
    "reaction": ("return", "motor stop"),
    "way": ("fly SE", "descend"),
    "fault": ("disk full", "error 9999"),
    "refusal": ("unsigned", "wrong signature"),
    "refused": (
        "LIM_WIND is 200, must be at most 100",
        "WGT_INSP_ENERGY is 0, must be at least 0",
    ),
    "result": ("denied", "temporarily rejected"),
    "time": ("26 d", "99999 d"),
    "fraction": ("0.92", "1.00"),
    "parameter": ("SAFE_RADIUS 8", "GUID_LAND_HEIGHT 0.0125"),
    "value": ("7", "-3.4e+38"),
    "index": ("7", "65535"),
    "number": ("2", "65535"),
    "id": ("42", "255"),
    "other_id": ("7", "255"),
    "parts": ("12", "9999"),
    "total": ("64", "9999"),
    "count": ("9", "99"),
    "large_count": ("812", "999999999"),
    "s": ("12", "9999"),
    "m": ("3.4", "99999"),
    "far_m": ("3.4", "999"),
    "side": ("E", "NW"),
    "most_m": ("60", "999"),
    "outside_m": ("71", "99999"),
    "low_m": ("1.2", "99999"),
    "wire": ("3", "999"),
    "x_m": ("9.2", "-99999.9"),
    "z_m": ("18.3", "-99999.9"),
    "least_m": ("2", "99999"),
    "limit": ("60", "99999"),
    "degrees": ("4.2", "180"),
    "quantity": ("0.4 m/s > 0.25", "99.99 dps > 0.123"),
    "plural": ("s", "s"),
}
"""Fields of the texts: an example and the longest value of each."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PilotText:
    """A text. pattern: the reason, with FIELDS in braces. actions: that are sent with it.

    meaning, remedy: for the table; remedy: what the pilot or operator can do.
    """

    pattern: str
    actions: tuple[str, ...] = ("",)
    meaning: str
    remedy: str = "-"

    def __call__(self, *, detail: str = "", **values: object) -> str:
        """The reason. A name is cut so that every action fits. detail: for the record only."""
        shown = {field: str(value) for field, value in values.items()}
        room = min(map(reason_chars, self.actions))
        for field in NAMES & shown.keys():
            rest = self.pattern.format(**(shown | {field: ""}))
            shown[field] = short_name(shown[field], room - len(rest))
        reason = self.pattern.format(**shown)
        return f"{reason} ({detail})" if detail else reason

    @property
    def fields(self) -> list[str]:
        """Names of the variable fields."""
        return [field for _, field, _, _ in string.Formatter().parse(self.pattern) if field]

    @property
    def example(self) -> str:
        """The text as it is sent, with example values and the first of its actions."""
        return pilot_text(
            self(**{field: FIELDS[field][0] for field in self.fields}), self.actions[0]
        )

    @property
    def longest(self) -> str:
        """The reason with the longest values."""
        return self(**{field: FIELDS[field][1] for field in self.fields})

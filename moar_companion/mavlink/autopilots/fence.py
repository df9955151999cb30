"""The autopilot's own fence as one value, in metres from home and in degrees. Pure.

The file of each autopilot reads its limits from its parameters; the uploaded areas are MAVLink's.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from ...texts.text_format import limit_text
from ..telemetry import FenceItem

_POLYGON_INCLUSION, _POLYGON_EXCLUSION, _CIRCLE_INCLUSION, _CIRCLE_EXCLUSION = range(5001, 5005)
"""MAV_CMD_NAV_FENCE_*; 5000 is a return point, which limits nothing."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limit:
    """Limit set by a parameter, in metres from home."""

    parameter: str
    value_m: float

    def __str__(self) -> str:
        return f"{self.parameter} {limit_text(self.value_m)} m"


@dataclass(frozen=True, slots=True, kw_only=True)
class Area:
    """Uploaded polygon or circle. inclusion: the aircraft must stay inside; otherwise outside.

    vertices_deg: (latitude, longitude) of each; of a circle only its centre. radius_m: of a
    circle; None for a polygon.
    """

    name: str
    inclusion: bool
    vertices_deg: tuple[tuple[float, float], ...]
    radius_m: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Fence:
    """All limits in force. union: one of the inclusion areas is enough.

    margin_m: distance that the autopilot keeps from its fence (FENCE_MARGIN). action: as a text.
    overrules_land: True if the autopilot overrides a LAND ordered outside. source_gnss: parameter
    that makes the receiver's position count instead of the estimator's; empty otherwise.
    """

    circle: Limit | None = None
    ceiling: Limit | None = None
    floor: Limit | None = None
    areas: tuple[Area, ...] = ()
    union: bool = False
    margin_m: float = 0.0
    action: str = "nothing"
    overrules_land: bool = False
    source_gnss: str = ""

    @property
    def about_home(self) -> bool:
        """True if the fence's position depends on home."""
        return any((self.circle, self.ceiling, self.floor))

    @property
    def names(self) -> tuple[str, ...]:
        """Texts of all limits; empty without a fence."""
        limits = [str(limit) for limit in (self.circle, self.ceiling, self.floor) if limit]
        return (*limits, *(area.name for area in self.areas))


def limit(values: Mapping[str, float], name: str, *, on: float) -> Limit | None:
    """Limit with a parameter's value; None if it is off."""
    return Limit(parameter=name, value_m=values[name]) if on else None


def areas_of(items: Iterable[FenceItem]) -> tuple[Area, ...]:
    """Areas of the items of an uploaded fence.

    A polygon's vertices follow each other, each with their number (param1). An incomplete polygon
    has the vertices that are present.
    """
    areas: list[Area] = []
    waiting = list(items)
    while waiting:
        item = waiting.pop(0)
        number = len(areas) + 1
        vertices = [(item.latitude_deg, item.longitude_deg)]
        if item.command in (_CIRCLE_INCLUSION, _CIRCLE_EXCLUSION):
            inclusion = item.command == _CIRCLE_INCLUSION
            areas.append(
                Area(
                    name=f"{_word(inclusion)} circle {number}",
                    inclusion=inclusion,
                    vertices_deg=tuple(vertices),
                    radius_m=item.parameter if math.isfinite(item.parameter) else 0.0,
                )
            )
        elif item.command in (_POLYGON_INCLUSION, _POLYGON_EXCLUSION):
            inclusion = item.command == _POLYGON_INCLUSION
            while len(vertices) < item.parameter and waiting:
                if waiting[0].command != item.command:
                    break
                vertex = waiting.pop(0)
                vertices.append((vertex.latitude_deg, vertex.longitude_deg))
            areas.append(
                Area(
                    name=f"{_word(inclusion)} polygon {number}",
                    inclusion=inclusion,
                    vertices_deg=tuple(vertices),
                )
            )
    return tuple(areas)


def _word(inclusion: bool) -> str:
    return "inclusion" if inclusion else "exclusion"

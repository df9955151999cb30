"""The autopilot's own fence: its parameters and the uploaded areas as one value. Pure.

Inputs: parameters by name, the items of the uploaded fence. Output: a `Fence`, in metres from home
and in degrees.

Sources: PX4 v1.17, `navigator/geofence.cpp` (Geofence::checkPointAgainstAllGeofences; the distances
count from home, 0 switches a limit off, areas always count) and `geofence_params.c`; ArduPilot
Copter-4.6.3, `AC_Fence.cpp` (var_info, check) and `AC_PolyFence_loader.cpp` (breached).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from ..telemetry import FenceItem
from ..types import AutopilotKind

_ALTITUDE_MAX, _CIRCLE, _AREAS, _ALTITUDE_MIN = 1, 2, 4, 8
"""Bits of FENCE_TYPE."""
_INCLUSION_UNION = 2
"""Bit of FENCE_OPTIONS: the union of the inclusion areas counts."""
_POLYGON_INCLUSION, _POLYGON_EXCLUSION, _CIRCLE_INCLUSION, _CIRCLE_EXCLUSION = range(5001, 5005)
"""MAV_CMD_NAV_FENCE_*; 5000 is a return point, which limits nothing."""
_HOLD = 2
"""Value of GF_ACTION."""

_PARAMETERS = {
    AutopilotKind.PX4: ("GF_ACTION", "GF_MAX_HOR_DIST", "GF_MAX_VER_DIST", "GF_SOURCE"),
    AutopilotKind.ARDUPILOT: (
        "FENCE_ACTION",
        "FENCE_ALT_MAX",
        "FENCE_ALT_MIN",
        "FENCE_AUTOENABLE",
        "FENCE_ENABLE",
        "FENCE_MARGIN",
        "FENCE_OPTIONS",
        "FENCE_RADIUS",
        "FENCE_TYPE",
    ),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Limit:
    """Limit set by a parameter, in metres from home."""

    parameter: str
    value_m: float

    def __str__(self) -> str:
        return f"{self.parameter} {self.value_m:g} m"


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

    margin_m: distance that the autopilot keeps from its fence (FENCE_MARGIN). action: for people.
    overrules_land: True if the autopilot overrides a LAND ordered outside.
    source_gnss: True if the receiver's position counts, not the estimator's (GF_SOURCE 1).
    untold: parameters that the autopilot never reported, except the action: their limits are
    unknown.
    """

    circle: Limit | None = None
    ceiling: Limit | None = None
    floor: Limit | None = None
    areas: tuple[Area, ...] = ()
    union: bool = False
    margin_m: float = 0.0
    action: str = "nothing"
    overrules_land: bool = False
    source_gnss: bool = False
    untold: tuple[str, ...] = ()

    @property
    def assumption(self) -> str | None:
        """Text of the unknown parameters; None if all were reported."""
        if not self.untold:
            return None
        count, names = len(self.untold), ", ".join(self.untold)
        what = "parameter" if count == 1 else "parameters"
        return f"{count} fence {what} not told ({names}), taken as none"

    @property
    def about_home(self) -> bool:
        """True if the fence's position depends on home."""
        return any((self.circle, self.ceiling, self.floor))

    @property
    def names(self) -> tuple[str, ...]:
        """Texts of all limits; empty without a fence."""
        limits = [str(limit) for limit in (self.circle, self.ceiling, self.floor) if limit]
        return (*limits, *(area.name for area in self.areas))


_PX4_ACTIONS = {0: "nothing", 1: "warn", 2: "hold", 3: "return", 4: "terminate", 5: "land"}
_ARDUPILOT_ACTIONS = {
    0: "report",
    1: "return or land",
    2: "land",
    3: "smart return or return or land",
    4: "brake or land",
    5: "smart return or land",
}


def fence_parameters(kind: AutopilotKind) -> tuple[str, ...]:
    """Names of the parameters of an autopilot's fence."""
    return _PARAMETERS.get(kind, ())


def fence_of(
    kind: AutopilotKind,
    parameters: Mapping[str, float | None],
    items: Iterable[FenceItem],
    *,
    enabled: bool = False,
) -> Fence | None:
    """Fence of an autopilot; None of an unknown kind, and while a parameter is awaited.

    parameters: None as a value means never reported. enabled: True if SYS_STATUS reports a fence.
    ArduPilot's RC switch, mission items and DO_FENCE_ENABLE change no parameter
    (AC_Fence::enable). A fence that they disable still counts while a parameter enables it.
    """
    names = fence_parameters(kind)
    if not names or any(name not in parameters for name in names):
        return None
    untold = tuple(
        name for name in names if parameters[name] is None and not name.endswith("_ACTION")
    )
    values = {name: parameters[name] or 0.0 for name in names}
    if kind is AutopilotKind.PX4:
        return _px4(values, areas_of(items), untold)
    return _ardupilot(values, areas_of(items), untold, enabled=enabled)


def _px4(values: Mapping[str, float], areas: tuple[Area, ...], untold: tuple[str, ...]) -> Fence:
    action = int(values["GF_ACTION"])
    return Fence(
        circle=_limit(values, "GF_MAX_HOR_DIST", on=values["GF_MAX_HOR_DIST"] > 0.0),
        ceiling=_limit(values, "GF_MAX_VER_DIST", on=values["GF_MAX_VER_DIST"] > 0.0),
        areas=areas,
        action=_PX4_ACTIONS.get(action, "warn"),
        overrules_land=action == _HOLD,
        source_gnss=values["GF_SOURCE"] == 1.0,
        untold=untold,
    )


def _ardupilot(
    values: Mapping[str, float], areas: tuple[Area, ...], untold: tuple[str, ...], *, enabled: bool
) -> Fence:
    if not (enabled or values["FENCE_ENABLE"] or values["FENCE_AUTOENABLE"]):
        return Fence(untold=untold)
    chosen = int(values["FENCE_TYPE"])
    return Fence(
        circle=_limit(values, "FENCE_RADIUS", on=chosen & _CIRCLE),
        ceiling=_limit(values, "FENCE_ALT_MAX", on=chosen & _ALTITUDE_MAX),
        floor=_limit(values, "FENCE_ALT_MIN", on=chosen & _ALTITUDE_MIN),
        areas=areas if chosen & _AREAS else (),
        union=bool(int(values["FENCE_OPTIONS"]) & _INCLUSION_UNION),
        margin_m=max(0.0, values["FENCE_MARGIN"]),
        action=_ARDUPILOT_ACTIONS.get(int(values["FENCE_ACTION"]), "return or land"),
        untold=untold,
    )


def _limit(values: Mapping[str, float], name: str, *, on: float) -> Limit | None:
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

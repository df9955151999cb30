"""ArduCopter's own fence: heights, a circle around home, and uploaded areas.

As in the source of ArduCopter 4.6: a breach is reported once, and again 20 m farther out. It does
not change HEARTBEAT.system_status, and any mode can be selected after it. The least height counts
once it was exceeded by FENCE_MARGIN, and not in a landing. FENCE_AUTOENABLE counts as 3 does: the
fence is active while armed.
"""

from dataclasses import dataclass
from typing import Final

from sitl.ardupilot.modes import Mode
from sitl.fence_areas import FenceAreas
from sitl.parameters import Parameters

MAX_ALTITUDE, CIRCLE, AREAS, MIN_ALTITUDE = 1, 2, 4, 8
"""Bits of FENCE_TYPE."""
_NAMES: Final = {
    MAX_ALTITUDE: "Max Alt",
    CIRCLE: "Circle",
    AREAS: "Polygon",
    MIN_ALTITUDE: "Min Alt",
}
_UNION: Final = 2
"""Bit of FENCE_OPTIONS: one inclusion area is enough."""
_ACTIONS: Final = {2: Mode.LAND, 3: Mode.SMART_RTL, 4: Mode.BRAKE, 5: Mode.SMART_RTL}
_PERIOD_S: Final = 0.3
_BACKUP_M: Final = 20.0
_GIVE_UP_M: Final = 100.0
"""Distance outside from which the vehicle lands, for any FENCE_ACTION."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BreachChange:
    """Text to send, and the mode to fly now (FENCE_ACTION); None keeps the mode."""

    text: str
    mode: Mode | None = None


class Fence:
    """Checks the place three times a second."""

    def __init__(self, parameters: Parameters, areas: FenceAreas | None = None) -> None:
        """Start without a breach."""
        self._parameters = parameters
        self._areas = areas or FenceAreas()
        self._switched: bool | None = None
        """On or off by a command, independent of the parameters; None: never switched."""
        self._floor_on = False
        """True: the least height counts."""
        self._backup_m: dict[int, float] = {}
        """Excess at which the next breach is reported, by breached fence."""
        self._wait_s = 0.0

    @property
    def enabled(self) -> bool:
        """True if there is a fence."""
        if self._switched is not None:
            return self._switched
        value = self._parameters.value
        return value("FENCE_ENABLE") != 0 or value("FENCE_AUTOENABLE") != 0

    def switch(self, *, on: bool) -> None:
        """DO_FENCE_ENABLE, as an RC switch or a mission item: no parameter is changed."""
        self._switched = on

    @property
    def breached(self) -> bool:
        """True if the vehicle is outside."""
        return bool(self._backup_m)

    def forbids(
        self, height_m: float, from_home_m: float, on_map: tuple[float, float] | None = None
    ) -> bool:
        """Return True if a target is outside: GUIDED refuses it. on_map: latitude, longitude."""
        excesses = self._excesses(height_m, from_home_m, on_map)
        return any(excess_m > 0.0 for excess_m in excesses.values())

    def step(
        self,
        dt: float,
        height_m: float,
        from_home_m: float,
        on_map: tuple[float, float] | None = None,
        *,
        landing: bool = False,
    ) -> BreachChange | None:
        """Advance; None when nothing has changed."""
        value = self._parameters.value
        reached = height_m >= value("FENCE_ALT_MIN") + value("FENCE_MARGIN")
        self._floor_on = (self._floor_on or reached) and not landing
        self._wait_s += dt
        if self._wait_s < _PERIOD_S:
            return None
        self._wait_s = 0.0
        was_breached = self.breached
        excesses = self._excesses(height_m, from_home_m, on_map)
        outside = {fence: excess_m for fence, excess_m in excesses.items() if excess_m >= 0.0}
        new = [fence for fence in outside if outside[fence] >= self._backup_m.get(fence, 0.0)]
        self._backup_m = {fence: self._backup_m.get(fence, 0.0) for fence in outside}
        self._backup_m |= {fence: outside[fence] + _BACKUP_M for fence in new}
        if new:
            names = " and ".join(_NAMES[fence] for fence in new)
            return BreachChange(
                text=f"{names} fence{'s' if len(new) > 1 else ''} breached",
                mode=self._action(max(outside[fence] for fence in new)),
            )
        return BreachChange(text="Fence breach cleared") if was_breached and not outside else None

    def _action(self, excess_m: float) -> Mode | None:
        action = int(self._parameters.value("FENCE_ACTION"))
        if not action:
            return None
        return Mode.LAND if excess_m > _GIVE_UP_M else _ACTIONS.get(action, Mode.RTL)

    def _excesses(
        self, height_m: float, from_home_m: float, on_map: tuple[float, float] | None
    ) -> dict[int, float]:
        """Return the excess of a place by fence in use, metres; negative inside."""
        if not self.enabled:
            return {}
        value = self._parameters.value
        chosen = int(value("FENCE_TYPE"))
        excesses = {
            MAX_ALTITUDE: height_m - value("FENCE_ALT_MAX"),
            CIRCLE: from_home_m - value("FENCE_RADIUS"),
        }
        if self._floor_on:
            excesses[MIN_ALTITUDE] = value("FENCE_ALT_MIN") - height_m
        if on_map is not None:
            union = bool(int(value("FENCE_OPTIONS")) & _UNION)
            excesses[AREAS] = 1.0 if self._areas.outside(*on_map, union=union) else -1.0
        return {fence: excess_m for fence, excess_m in excesses.items() if chosen & fence}

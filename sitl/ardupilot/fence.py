"""ArduCopter's own fence: a height, and a circle around home.

As in the source of ArduCopter 4.6: a breach is told once, and again 20 m farther out; it does not
touch HEARTBEAT.system_status, and any mode can be had again after it. Polygons are not known here.
"""

from dataclasses import dataclass
from typing import Final

from sitl.ardupilot.modes import Mode
from sitl.parameters import Parameters

MAX_ALTITUDE, CIRCLE = 1, 2
"""Bits of FENCE_TYPE."""
_LIMITS: Final = {MAX_ALTITUDE: "FENCE_ALT_MAX", CIRCLE: "FENCE_RADIUS"}
_NAMES: Final = {MAX_ALTITUDE: "Max Alt", CIRCLE: "Circle"}
_ACTIONS: Final = {2: Mode.LAND, 3: Mode.SMART_RTL, 4: Mode.BRAKE, 5: Mode.SMART_RTL}
_PERIOD_S: Final = 0.3
_BACKUP_M: Final = 20.0
_GIVE_UP_M: Final = 100.0
"""Farther out than this it lands, whatever was wished."""


@dataclass(frozen=True, slots=True, kw_only=True)
class News:
    """What there is to say, and the mode to fly now (FENCE_ACTION); None leaves it as it is."""

    text: str
    mode: Mode | None = None


class Fence:
    """Looks at the place three times a second."""

    def __init__(self, parameters: Parameters) -> None:
        """Nothing is breached."""
        self._parameters = parameters
        self._backup_m: dict[int, float] = {}
        """By breached fence: where the next breach is told."""
        self._wait_s = 0.0

    @property
    def enabled(self) -> bool:
        """Whether there is a fence."""
        return self._parameters.value("FENCE_ENABLE") != 0

    @property
    def breached(self) -> bool:
        """Whether the vehicle is outside."""
        return bool(self._backup_m)

    def forbids(self, height_m: float, from_home_m: float) -> bool:
        """Whether a target is outside: GUIDED takes none there."""
        return any(excess_m > 0.0 for excess_m in self._excesses(height_m, from_home_m).values())

    def step(self, dt: float, height_m: float, from_home_m: float) -> News | None:
        """Advance; None when nothing has changed."""
        self._wait_s += dt
        if self._wait_s < _PERIOD_S:
            return None
        self._wait_s = 0.0
        was_breached = self.breached
        excesses = self._excesses(height_m, from_home_m)
        outside = {fence: excess_m for fence, excess_m in excesses.items() if excess_m >= 0.0}
        new = [fence for fence in outside if outside[fence] >= self._backup_m.get(fence, 0.0)]
        self._backup_m = {fence: self._backup_m.get(fence, 0.0) for fence in outside}
        self._backup_m |= {fence: outside[fence] + _BACKUP_M for fence in new}
        if new:
            names = " and ".join(_NAMES[fence] for fence in new)
            return News(
                text=f"{names} fence{'s' if len(new) > 1 else ''} breached",
                mode=self._action(max(outside[fence] for fence in new)),
            )
        return News(text="Fence breach cleared") if was_breached and not outside else None

    def _action(self, excess_m: float) -> Mode | None:
        action = int(self._parameters.value("FENCE_ACTION"))
        if not action:
            return None
        return Mode.LAND if excess_m > _GIVE_UP_M else _ACTIONS.get(action, Mode.RTL)

    def _excesses(self, height_m: float, from_home_m: float) -> dict[int, float]:
        """Return by fence in use how far outside a place is, metres; negative inside."""
        if not self.enabled:
            return {}
        chosen = int(self._parameters.value("FENCE_TYPE"))
        places = {MAX_ALTITUDE: height_m, CIRCLE: from_home_m}
        return {
            fence: places[fence] - self._parameters.value(limit)
            for fence, limit in _LIMITS.items()
            if chosen & fence
        }

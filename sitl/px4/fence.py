"""PX4's geofence: a circle and a height about home, and uploaded areas.

As in the source of v1.17 (`navigator/geofence.cpp`, `failsafe.cpp`): a hold, a return and a landing
last until the mode is changed. As recorded (r_fence): 0.1 s after the breach the failsafe's mode
with system_status 5. A mode that is ordered outside is flown for 3.1 s, then overruled, LAND too.
Texts are sent twice, 2.1 s apart.
"""

from typing import Final

from sitl.fence_areas import FenceAreas
from sitl.parameters import Parameters
from sitl.px4.navigation import Navigation

_PERIOD_US: Final = 100_000
_AGAIN_US: Final = 2_100_000
_TIMES: Final = 2
"""Number of reports of a breach, in a minute and a half outside."""
_ORDERED_US: Final = 3_100_000
"""Time for which a mode that was ordered outside is not overruled."""
NONE, WARN, HOLD, RETURN, TERMINATE, LAND = range(6)
"""GF_ACTION."""


class Geofence:
    """Checks the place ten times a second; `action` is the due one, by GF_ACTION."""

    def __init__(self, parameters: Parameters, navigation: Navigation, areas: FenceAreas) -> None:
        """Start without a breach."""
        self._parameters = parameters
        self._navigation = navigation
        self._areas = areas
        self.action = NONE
        self._due_us = 0
        self._reported_us: list[int] = []
        self._ordered_us: int | None = None

    def note_mode(self, now_us: int) -> None:
        """Clear the due action: a mode was ordered."""
        if self.action:
            self._ordered_us = now_us
        self.action = NONE

    def step(self, now_us: int) -> list[str]:
        """Check the place; return the texts to send."""
        if now_us < self._due_us:
            return []
        self._due_us = now_us + _PERIOD_US
        breaches = self._breaches()
        chosen = int(self._parameters.value("GF_ACTION"))
        if not breaches or chosen == NONE:
            self._reported_us, self._ordered_us = [], None
            if chosen == NONE or self.action == WARN:
                self.action = NONE
            return []
        if self._ordered_us is None or now_us - self._ordered_us >= _ORDERED_US:
            self.action = chosen
        if len(self._reported_us) == _TIMES or (
            self._reported_us and now_us - self._reported_us[-1] < _AGAIN_US
        ):
            return []
        self._reported_us.append(now_us)
        return [f"Geofence: {words}" for words in breaches]

    def _breaches(self) -> list[str]:
        nav, value = self._navigation, self._parameters.value
        level_m, height_m = value("GF_MAX_HOR_DIST"), value("GF_MAX_VER_DIST")
        found = []
        if level_m > 0.0 and nav.distance_to_home_m() >= level_m:
            found.append("exceeding maximum distance to Home")
        if height_m > 0.0 and nav.home_z - nav.z >= height_m:
            found.append("exceeding maximum altitude above Home")
        if self._areas.outside(nav.estimator.latitude_deg, nav.estimator.longitude_deg):
            found.append("approaching or outside geofence")
        return found

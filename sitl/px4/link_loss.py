"""Lost links as causes of PX4's failsafes: the pilot's sticks and the ground station.

After PX4 v1.17.0's Failsafe::checkStateAndMode: the action for a loss continues when the link is
back, until a mode is selected. A mode that was selected meanwhile is flown until the next loss of
the link.
"""

from typing import Final

from sitl.parameters import Parameters
from sitl.px4.modes import Mode

_EXCEPTED: Final = {Mode.MISSION: 1, Mode.HOLD: 2, Mode.TAKEOFF: 2, Mode.OFFBOARD: 4}
"""Bits of COM_RCL_EXCEPT and COM_DLL_EXCEPT."""
_NO_MANUAL_CONTROL: Final = 4
"""COM_RC_IN_MODE."""


class LinkLoss:
    """One link: `due` from its loss until a mode is chosen."""

    def __init__(self) -> None:
        """Start with the link present."""
        self.due = False
        self._overruled = False

    def step(self, *, lost: bool) -> None:
        """Update the link; lost: and no exception applies."""
        if not lost:
            self._overruled = False
        elif not self._overruled:
            self.due = True

    def overrule(self) -> None:
        """Note that the pilot has chosen a mode."""
        self._overruled = self._overruled or self.due
        self.due = False


class LinkLosses:
    """Both links of an armed vehicle."""

    def __init__(self, parameters: Parameters) -> None:
        """Start with both links present."""
        self._parameters = parameters
        self.sticks = LinkLoss()
        self.ground_station = LinkLoss()
        self._needs_sticks = False

    def arm(self) -> None:
        """Begin a flight. Missing sticks count as lost once they were present in this flight."""
        self.sticks, self.ground_station = LinkLoss(), LinkLoss()
        self._needs_sticks = False

    def step(self, intended: Mode, *, sticks: bool, ground_station: bool) -> None:
        """Update both links, by the intended mode. sticks, ground_station: True if present."""
        value = self._parameters.value
        bit = _EXCEPTED.get(intended, 0)
        self._needs_sticks = self._needs_sticks or sticks
        self.sticks.step(
            lost=not sticks
            and self._needs_sticks
            and value("COM_RC_IN_MODE") != _NO_MANUAL_CONTROL
            and not int(value("COM_RCL_EXCEPT")) & bit
        )
        self.ground_station.step(
            lost=not ground_station
            and value("NAV_DLL_ACT") > 0
            and intended is not Mode.LAND
            and not int(value("COM_DLL_EXCEPT")) & bit
        )

    def overrule(self) -> None:
        """Note that the pilot has chosen a mode."""
        self.sticks.overrule()
        self.ground_station.overrule()

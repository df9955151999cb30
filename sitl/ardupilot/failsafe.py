"""ArduPilot's failsafes: the action of each, as pure functions of flags and parameters.

Each acts once, when its cause appears; after that any mode can be selected, GUIDED too. Measured
on ArduCopter 4.6.3.
"""

from dataclasses import dataclass
from typing import Final, Literal

from sitl.ardupilot.modes import Mode

_CONTINUE_GUIDED: Final = 1 << 2
_CONTINUE_LANDING: Final = 1 << 3
_CONTINUE_PILOTED: Final = 1 << 4
_PILOTED: Final = frozenset({Mode.STABILIZE, Mode.ALT_HOLD, Mode.LOITER, Mode.POSHOLD})
_RADIO: Final = {
    1: Mode.RTL, 2: Mode.RTL, 3: Mode.LAND, 4: Mode.SMART_RTL, 5: Mode.SMART_RTL, 6: Mode.RTL,
    7: Mode.BRAKE,
}  # fmt: skip
_GROUND_STATION: Final = {
    1: Mode.RTL, 2: Mode.RTL, 3: Mode.SMART_RTL, 4: Mode.SMART_RTL, 5: Mode.LAND, 6: Mode.RTL,
    7: Mode.BRAKE,
}  # fmt: skip
TERMINATE: Final = "terminate"
"""The motors stop."""
Reaction = Mode | Literal["terminate"] | None
_ACTIONS: Final[dict[int, Reaction]] = {
    1: Mode.LAND, 2: Mode.RTL, 3: Mode.SMART_RTL, 4: Mode.SMART_RTL, 5: TERMINATE, 6: Mode.RTL,
    7: Mode.BRAKE,
}  # fmt: skip
"""At a battery level, and in dead reckoning (events.cpp, do_failsafe_action)."""
_EKF: Final = {2: Mode.ALT_HOLD}
"""Any other value lands (ekf_check.cpp, failsafe_ekf_event)."""
_EKF_ALWAYS: Final = 3


@dataclass(slots=True, kw_only=True)
class Failsafes:
    """Active failsafes; each ends with its cause. `BatteryMonitor` has the battery's."""

    radio: bool = False
    ground_station: bool = False
    estimator: bool = False
    dead_reckoning: bool = False

    def any(self) -> bool:
        """Return True if one of them is active."""
        return self.radio or self.ground_station or self.estimator or self.dead_reckoning


def on_radio(action: int, options: int, mode: Mode) -> Mode | None:
    """Return the mode to fly when the remote control is lost (FS_THR_ENABLE, FS_OPTIONS)."""
    if mode is Mode.GUIDED and options & _CONTINUE_GUIDED:
        return None
    if mode is Mode.LAND and options & _CONTINUE_LANDING:
        return None
    return _RADIO.get(action)


def on_ground_station(action: int, options: int, mode: Mode) -> Mode | None:
    """Return the mode to fly when the ground station is lost (FS_GCS_ENABLE, FS_OPTIONS)."""
    if mode in _PILOTED and options & _CONTINUE_PILOTED:
        return None
    if mode is Mode.LAND and options & _CONTINUE_LANDING:
        return None
    return _GROUND_STATION.get(action)


def on_battery(action: int, options: int, mode: Mode) -> Reaction:
    """Return the reaction at a battery level (BATT_FS_LOW_ACT or BATT_FS_CRT_ACT)."""
    if mode is Mode.LAND and options & _CONTINUE_LANDING:
        return None
    return _ACTIONS.get(action)


def on_dead_reckoning(action: int, mode: Mode) -> Reaction:
    """Return the reaction when the position follows from the wind alone (FS_DR_ENABLE)."""
    return _ACTIONS.get(action) if mode.value.needs_position else None


def on_estimator(action: int, mode: Mode) -> Mode | None:
    """Return the mode to fly when the position is lost (FS_EKF_ACTION)."""
    if mode is Mode.LAND or not (mode.value.needs_position or action == _EKF_ALWAYS):
        return None
    return _EKF.get(action, Mode.LAND)

"""PX4's failsafes: which action is due, as a pure function of flags.

Precedence is severity: the most severe action wins. Measured on PX4 v1.17.0; parameter values
COM_OBL_RC_ACT: 0 position, 1 altitude, without sticks by NAV_RCL_ACT, 3 return, 4 land, 5 hold;
COM_LOW_BAT_ACT: 0 warn, 2 land, 3 return at critical and land at emergency. NAV_RCL_ACT and
NAV_DLL_ACT: 1 hold, 2 return, 3 land; their stops of the motors, 5 and 6, are not imitated.
"""

from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from sitl.parameters import Parameters
from sitl.px4 import fence
from sitl.px4.modes import AUTO_MODES, Mode

_SEVERITY: Final = (
    Mode.POSCTL,
    Mode.ALTCTL,
    Mode.MANUAL,
    Mode.HOLD,
    Mode.RTL,
    Mode.LAND,
    Mode.DESCEND,
)
_FENCE: Final = {fence.HOLD: Mode.HOLD, fence.RETURN: Mode.RTL, fence.LAND: Mode.LAND}
_OFFBOARD_LOSS: Final = {3: Mode.RTL, 4: Mode.LAND, 5: Mode.HOLD}
_LINK_LOSS: Final = {1: Mode.HOLD, 2: Mode.RTL, 3: Mode.LAND}


class Charge(IntEnum):
    """BATTERY_STATUS.charge_state as PX4 judges it."""

    OK = 1
    LOW = 2
    CRITICAL = 3
    EMERGENCY = 4


_CHARGE_LIMITS: Final = {
    "BAT_LOW_THR": Charge.LOW,
    "BAT_CRIT_THR": Charge.CRITICAL,
    "BAT_EMERGEN_THR": Charge.EMERGENCY,
}


def charge_of(fraction: float, parameters: Parameters) -> Charge:
    """Return the charge state of what is left in the battery, 0 to 1."""
    passed = [level for name, level in _CHARGE_LIMITS.items() if fraction < parameters.value(name)]
    return passed[-1] if passed else Charge.OK


class Cause(IntEnum):
    """Cause: the numbers of PX4's events; PX4 reports those below 0 without a cause."""

    OFFBOARD_LOST = -1
    POSITION_LOST = -2
    FENCE_BREACHED = -3
    STICKS_LOST = 1
    GROUND_STATION_LOST = 2
    BATTERY_CRITICAL = 4
    BATTERY_EMERGENCY = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Flags:
    """Inputs of the failsafes."""

    mode: Mode
    stream_alive: bool
    position_valid: bool
    sticks: bool
    charge: Charge
    overridden_charge: Charge
    """Battery levels up to this one were overridden by a mode request."""
    offboard_action: int
    battery_action: int
    sticks_action: int
    sticks_lost: bool = False
    """The pilot's input was lost, and no mode was chosen since (`LinkLoss`)."""
    ground_station_lost: bool = False
    ground_station_action: int = 0
    fence_action: int = fence.NONE
    """Action of the breached fence, as GF_ACTION."""


_CHARGE_CAUSES: Final = {
    Charge.CRITICAL: Cause.BATTERY_CRITICAL,
    Charge.EMERGENCY: Cause.BATTERY_EMERGENCY,
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Action:
    """A due action: its mode, a delay (PX4 first holds for COM_FAIL_ACT_T), and its cause."""

    mode: Mode
    delayed: bool
    cause: Cause


def due(flags: Flags) -> Action | None:
    """Return the most severe action that is due, or None."""
    found = [
        action
        for action in (
            _offboard(flags),
            _link(flags, Cause.STICKS_LOST),
            _link(flags, Cause.GROUND_STATION_LOST),
            _position(flags),
            _battery(flags),
            _fence(flags),
        )
        if action is not None
    ]
    if not found:
        return None
    worst = max(found, key=lambda action: _SEVERITY.index(action.mode))
    if not flags.position_valid and worst.mode in AUTO_MODES:
        return Action(mode=Mode.DESCEND, delayed=worst.delayed, cause=worst.cause)
    return worst


def _offboard(flags: Flags) -> Action | None:
    if flags.mode is not Mode.OFFBOARD:
        return None
    if not flags.position_valid:
        # Setpoints of a position need one: the action on a lost stream falls back to a descent, and
        # the modes of the sticks to ALTCTL.
        descends = flags.offboard_action in _OFFBOARD_LOSS
        mode = Mode.DESCEND if descends else Mode.ALTCTL
        return Action(mode=mode, delayed=False, cause=Cause.POSITION_LOST)
    if flags.stream_alive:
        return None
    if flags.sticks and flags.offboard_action in (0, 1):
        mode = Mode.POSCTL if flags.offboard_action == 0 else Mode.ALTCTL
    elif flags.offboard_action in (0, 1):
        mode = _sticks_lost(flags)
    else:
        mode = _OFFBOARD_LOSS.get(flags.offboard_action, Mode.RTL)
    return Action(mode=mode, delayed=False, cause=Cause.OFFBOARD_LOST)


def _link(flags: Flags, cause: Cause) -> Action | None:
    """Return the action for a lost link; LAND and RTL do not change to RTL."""
    lost, number = {
        Cause.STICKS_LOST: (flags.sticks_lost, flags.sticks_action),
        Cause.GROUND_STATION_LOST: (flags.ground_station_lost, flags.ground_station_action),
    }[cause]
    mode = _LINK_LOSS.get(number)
    if not lost or mode is None:
        return None
    if mode is Mode.RTL and flags.mode in (Mode.LAND, Mode.RTL):
        return None
    return Action(mode=mode, delayed=mode is not Mode.HOLD, cause=cause)


def _sticks_lost(flags: Flags) -> Mode:
    return _LINK_LOSS.get(flags.sticks_action, Mode.RTL)


def _position(flags: Flags) -> Action | None:
    if flags.position_valid:
        return None
    if flags.mode is Mode.POSCTL:
        return Action(mode=Mode.ALTCTL, delayed=False, cause=Cause.POSITION_LOST)
    if flags.mode in AUTO_MODES:
        return Action(mode=Mode.DESCEND, delayed=False, cause=Cause.POSITION_LOST)
    return None


def _fence(flags: Flags) -> Action | None:
    mode = _FENCE.get(flags.fence_action)
    return None if mode is None else Action(mode=mode, delayed=False, cause=Cause.FENCE_BREACHED)


def _battery(flags: Flags) -> Action | None:
    if flags.charge <= flags.overridden_charge or flags.charge < Charge.CRITICAL:
        return None
    if flags.battery_action == 0:
        return None
    returns = flags.battery_action == 3 and flags.charge is Charge.CRITICAL
    mode = Mode.RTL if returns else Mode.LAND
    if flags.mode is mode or (flags.mode is Mode.LAND and mode is Mode.RTL):
        return None
    return Action(mode=mode, delayed=True, cause=_CHARGE_CAUSES[flags.charge])

"""PX4: its failsafe actions in OFFBOARD, by its parameters.

Sources: PX4 v1.17, `src/modules/commander/failsafe/failsafe.cpp` (fromNavDllOrRclActParam,
fromBatteryWarningActParam, fromOffboardLossActParam, checkModeFallback), `framework.cpp`
(getSelectedAction), `HealthAndArmingChecks/checks/offboardCheck.cpp`, `navigator/rtl.cpp`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from .failsafe_actions import Action, FailsafeAction, Trigger

DEFAULTS = {
    "BAT_CRIT_THR": 0.07,
    "BAT_EMERGEN_THR": 0.05,
    "COM_DLL_EXCEPT": 0.0,
    "COM_LOW_BAT_ACT": 0.0,
    "COM_OBL_RC_ACT": 0.0,
    "COM_RCL_EXCEPT": 0.0,
    "NAV_ACC_RAD": 2.0,
    "NAV_DLL_ACT": 0.0,
    "NAV_RCL_ACT": 2.0,
    "RTL_CONE_ANG": 45.0,
    "RTL_MIN_DIST": 10.0,
    "RTL_RETURN_ALT": 30.0,
    "RTL_TYPE": 0.0,
}
"""Parameters and their defaults in v1.17; RTL_RETURN_ALT from `init.d/rc.mc_defaults`."""
_DRIFT_M = 4.5
"""Drift after the loss of GPS in OFFBOARD until landing; measured on v1.17."""
_OFFBOARD_BIT = 4
"""Bit of COM_RCL_EXCEPT and COM_DLL_EXCEPT."""
_OFFBOARD_LOSS = {
    0: (None, "position mode; without sticks by NAV_RCL_ACT"),
    1: (None, "altitude mode; without sticks by NAV_RCL_ACT"),
    2: (None, "stabilized mode; without sticks by NAV_RCL_ACT"),
    3: (Action.RETURN, "return"),
    4: (Action.LAND, "land"),
    5: (Action.HOLD, "hold"),
    6: (Action.FALL, "terminate"),
    7: (Action.FALL, "disarm"),
}
"""COM_OBL_RC_ACT: the resulting action (None: that of NAV_RCL_ACT), and PX4's name for it."""
_UNKNOWN = (Action.RETURN, "not known here, taken for a return")
_LINK_LOSS = {
    0: Action.NONE,
    1: Action.HOLD,
    2: Action.RETURN,
    3: Action.LAND,
    5: Action.FALL,
    6: Action.FALL,
}
"""NAV_RCL_ACT, NAV_DLL_ACT; any other value means no action."""
_BATTERY = {
    1: (Action.RETURN, Action.RETURN),
    2: (Action.LAND, Action.LAND),
    3: (Action.RETURN, Action.LAND),
}
"""COM_LOW_BAT_ACT: at BAT_CRIT_THR, at BAT_EMERGEN_THR; at BAT_LOW_THR PX4 only warns."""


def offboard_loss(value: Mapping[str, float]) -> tuple[Action, str]:
    """Action of PX4 without setpoints and sticks, and PX4's name of COM_OBL_RC_ACT's value."""
    action, word = _OFFBOARD_LOSS.get(int(value["COM_OBL_RC_ACT"]), _UNKNOWN)
    if action is None:
        action = _LINK_LOSS.get(int(value["NAV_RCL_ACT"]), Action.RETURN)
    return (Action.RETURN if action is Action.NONE else action), word


@dataclass(frozen=True, slots=True, kw_only=True)
class Return:
    """PX4's return (RTL_TYPE 0, no rally points): up, level, down; heights above home.

    As in PX4's `calculate_return_alt_from_cone_half_angle`.
    """

    altitude_m: float
    cone_rad: float
    """Half angle of the cone over home below which a near return stays; 0: no cone."""
    least_m: float
    """Distance to home up to which a return is near."""
    arrived_m: float

    @classmethod
    def of(cls, value: Mapping[str, float]) -> Return | None:
        """Return by the values of the parameters; None if it leads elsewhere than home."""
        if value["RTL_TYPE"]:
            return None
        return cls(
            altitude_m=value["RTL_RETURN_ALT"],
            cone_rad=math.radians(value["RTL_CONE_ANG"]),
            least_m=value["RTL_MIN_DIST"],
            arrived_m=value["NAV_ACC_RAD"],
        )

    def height_m(self, height_m: float, distance_m: float) -> float:
        """Height of the level part, from a height and a level distance to home."""
        if self.cone_rad <= 0.0:
            return max(height_m, self.altitude_m)
        if distance_m <= self.arrived_m:
            return max(height_m, 2.0 * distance_m)
        climbs_m = self.altitude_m
        if distance_m <= self.least_m:
            cone_rad = min(max(self.cone_rad, math.radians(1.0)), math.radians(89.0))
            climbs_m = min(climbs_m, distance_m / math.tan(cone_rad))
        return max(height_m, climbs_m, 2.0 * self.arrived_m)


def actions(value: Mapping[str, float]) -> Iterator[FailsafeAction]:
    """Yields PX4's failsafe actions in OFFBOARD, by the values of all parameters of DEFAULTS."""
    home = Return.of(value)
    battery = int(value["COM_LOW_BAT_ACT"])
    for trigger, threshold, action in zip(
        (Trigger.CRITICAL_BATTERY, Trigger.EMERGENCY_BATTERY),
        ("BAT_CRIT_THR", "BAT_EMERGEN_THR"),
        _BATTERY.get(battery, (Action.NONE, Action.NONE)),
        strict=True,
    ):
        yield FailsafeAction(
            trigger=trigger,
            action=action,
            setting=f"COM_LOW_BAT_ACT {battery}",
            remedy="COM_LOW_BAT_ACT 0",
            charge=value[threshold],
            home=home,
        )
    for trigger, name, excepts in (
        (Trigger.RC_LOSS, "NAV_RCL_ACT", "COM_RCL_EXCEPT"),
        (Trigger.GCS_LOSS, "NAV_DLL_ACT", "COM_DLL_EXCEPT"),
    ):
        if int(value[excepts]) & _OFFBOARD_BIT:
            continue
        yield FailsafeAction(
            trigger=trigger,
            action=_LINK_LOSS.get(int(value[name]), Action.NONE),
            setting=f"{name} {value[name]:g}",
            remedy=f"{name} 1 (hold), or {excepts} {int(value[excepts]) | _OFFBOARD_BIT}",
            home=home,
        )
    offboard = f"COM_OBL_RC_ACT {value['COM_OBL_RC_ACT']:g}"
    lost, _ = offboard_loss(value)
    # Position setpoints need a position: without one the offboard-loss action runs. An action that
    # needs a position, too, falls back to a descent. ALTCTL without sticks is a descent as well.
    yield FailsafeAction(
        trigger=Trigger.GPS_LOSS,
        action=Action.FALL if lost is Action.FALL else Action.DESCEND,
        setting=offboard,
        drift_m=_DRIFT_M,
    )
    yield FailsafeAction(
        trigger=Trigger.COMPANION_LOSS,
        action=lost,
        setting=offboard,
        remedy="COM_OBL_RC_ACT 5 (hold)",
        home=home,
    )

"""Rules by which `check` judges PX4's parameters that decide its reaction to failures.

Sources: PX4 v1.17, "Safety configuration (failsafes)" and the parameters' descriptions; its
reaction to a companion failure, as measured.
"""

from __future__ import annotations

from .failsafe_actions import AutopilotAction
from .parameter_rules import (
    CLIMBING,
    CLIMBS,
    FALLING,
    UNTIL_IT_FALLS,
    Case,
    Level,
    Rule,
    Verdict,
    bits,
    choice,
    excepted,
    excepts_us,
    shown,
    speed_limits,
    switch,
    time_on_last_setpoint,
)


def _forwarding(value: float, case: Case) -> Verdict:
    if not value and case.ground_station_received:
        return Level.OK, "0, but a ground station is received"
    return (Level.OK if value else Level.WARNING), f"{value:g}"


def _critical_battery(value: float, case: Case) -> Verdict:
    full = case.battery_full
    words = f"{value:.0%}, where the companion's battery risk is full at {full:.0%}"
    return (Level.OK if value < full else Level.WARNING), words


_THEREFORE = {AutopilotAction.RETURN: f", {CLIMBS}", AutopilotAction.FALL: ": the aircraft falls"}


def _companion_loss(value: float, case: Case) -> Verdict:
    action = case.loss.action
    word = _OFFBOARD_LOSS.get(int(value), "unknown value, taken as a return")
    level = Level.WARNING if action is AutopilotAction.RETURN else Level.OK
    if case.loss.objection_anywhere is not None:
        level = case.objection
    return level, f"{value:g} ({word}{_THEREFORE.get(action, '')})"


_OFFBOARD_LOSS = {
    0: "position mode; without sticks by NAV_RCL_ACT",
    1: "altitude mode; without sticks by NAV_RCL_ACT",
    2: "stabilized mode; without sticks by NAV_RCL_ACT",
    3: "return",
    4: "land",
    5: "hold",
    6: "terminate",
    7: "disarm",
}
"""COM_OBL_RC_ACT, by PX4's names."""
_LINK_LOSS = {
    1: (Level.OK, "hold"),
    2: (Level.WARNING, CLIMBING),
    3: (Level.OK, "land"),
    5: (Level.NO_GO, FALLING),
    6: (Level.NO_GO, FALLING),
}

RULES = (
    Rule(
        parameter="COM_OF_LOSS_T",
        judge=time_on_last_setpoint,
        meaning="time for which PX4 keeps the last setpoint after a companion failure",
        remedy="set 0.5",
    ),
    Rule(
        parameter="COM_OBL_RC_ACT",
        judge=_companion_loss,
        meaning="PX4's action after a companion failure",
        remedy="set 5 (hold)",
        unknown=Level.NO_GO,
    ),
    Rule(
        parameter="COM_RC_OVERRIDE",
        judge=bits(
            0b10,
            clear=(Level.WARNING, "not in OFFBOARD, where only the mode switch takes over"),
            is_set=(Level.OK, "in OFFBOARD, too"),
        ),
        meaning="take-over by the sticks",
        remedy="set 3",
    ),
    excepts_us("COM_RCL_EXCEPT", "remote control", "OFFBOARD"),
    Rule(
        parameter="NAV_RCL_ACT",
        judge=excepted(choice(_LINK_LOSS), ("COM_RCL_EXCEPT", 2), "not in OFFBOARD"),
        meaning="PX4's action when the remote control is lost",
        remedy="set 1 (hold) or 3 (land)",
        unknown=Level.NO_GO,
    ),
    excepts_us("COM_DLL_EXCEPT", "ground station", "OFFBOARD"),
    Rule(
        parameter="NAV_DLL_ACT",
        judge=excepted(
            choice({**_LINK_LOSS, 0: (Level.OK, "nothing")}),
            ("COM_DLL_EXCEPT", 2),
            "not in OFFBOARD",
        ),
        meaning="PX4's action when the ground station is lost",
        remedy="set 1 (hold), 3 (land) or 0 (nothing)",
        unknown=Level.NO_GO,
    ),
    Rule(
        parameter="GF_ACTION",
        judge=choice(
            {
                0: (Level.OK, "nothing"),
                1: (Level.OK, "a warning"),
                2: (Level.OK, "hold"),
                3: (Level.WARNING, CLIMBING),
                4: (Level.NO_GO, FALLING),
                5: (Level.OK, "land"),
            }
        ),
        meaning="PX4's action at its fence",
        remedy="set 2 (hold)",
        unknown=Level.NO_GO,
    ),
    Rule(
        parameter="COM_LOW_BAT_ACT",
        judge=choice(
            {
                0: (Level.NOTE, f"a warning: {UNTIL_IT_FALLS}"),
                1: (Level.NOTE, CLIMBING),
                2: (Level.OK, "land"),
                3: (Level.NOTE, f"{CLIMBING}; land when nearly empty"),
            }
        ),
        meaning="PX4's action at BAT_CRIT_THR: order the exit before",
        remedy="set 2 (land) or 0 (a warning)",
    ),
    Rule(
        parameter="COM_FLTT_LOW_ACT",
        judge=choice(
            {
                0: (Level.OK, "nothing"),
                1: (Level.OK, "a warning"),
                3: (Level.WARNING, CLIMBING),
            }
        ),
        meaning="PX4's action when the remaining flight time is that of its return",
        remedy="set 1 (a warning)",
        unknown=Level.NOTE,
    ),
    Rule(
        parameter="COM_FLT_TIME_MAX",
        judge=lambda value, _: (
            (Level.OK, "off") if value < 0.0 else (Level.WARNING, f"{value:g} s, then {CLIMBING}")
        ),
        meaning="the flight time after which PX4 returns",
        remedy="set -1 (off), or land before",
        unknown=Level.NOTE,
    ),
    Rule(
        parameter="COM_WIND_MAX_ACT",
        judge=choice(
            {
                0: (Level.OK, "nothing"),
                1: (Level.OK, "a warning"),
                2: (Level.OK, "hold"),
                3: (Level.WARNING, CLIMBING),
                4: (Level.WARNING, FALLING),
                5: (Level.OK, "land"),
            }
        ),
        meaning="PX4's action in more wind than COM_WIND_MAX, if that is above 0",
        remedy="set 2 (hold)",
        unknown=Level.NOTE,
    ),
    Rule(
        parameter="BAT_LOW_THR",
        judge=lambda value, case: (
            Level.WARNING if value <= (case.parameters.get("BAT_CRIT_THR") or 0.0) else Level.OK,
            f"{value:.0%}",
        ),
        meaning="the charge at which PX4 warns",
        remedy="set it above BAT_CRIT_THR",
    ),
    Rule(
        parameter="BAT_CRIT_THR",
        judge=_critical_battery,
        meaning="the charge at which PX4 takes control of the aircraft",
        remedy="set it lower, or risk.battery_remaining of the vehicle file higher",
    ),
    Rule(
        parameter="RTL_RETURN_ALT",
        judge=shown("m"),
        meaning="the height above home to which every return climbs first",
        unknown=Level.NOTE,
    ),
    *speed_limits("PX4", ("MPC_XY_VEL_MAX", "MPC_Z_VEL_MAX_UP", "MPC_Z_VEL_MAX_DN")),
    Rule(
        parameter="MAV_1_FORWARD",
        judge=_forwarding,
        meaning="forwarding of messages between ground station and companion on TELEM2",
        remedy="set 1",
        unknown=Level.NOTE,
    ),
    Rule(
        parameter="EKF2_DRAG_CTRL",
        judge=switch(off=Level.NOTE),
        meaning="PX4's wind estimate; without it the companion estimates the wind from the lean",
        unknown=Level.NOTE,
    ),
)
"""In the order of the report."""

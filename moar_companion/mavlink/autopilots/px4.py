"""PX4: its modes, messages, failsafes, fence, frame and flight, and the rules of check.

Names of parameters and their ranges: v1.14 to v1.17, and v1.18.0-beta1 (`param_translation.cpp`).

Sources: PX4 v1.17, "Safety configuration (failsafes)" and the parameters' descriptions;
`px4_custom_mode.h`; `geo.h` (CONSTANTS_RADIUS_OF_EARTH);
`src/modules/commander/failsafe/failsafe.cpp` (fromNavDllOrRclActParam,
fromBatteryWarningActParam, fromOffboardLossActParam, checkModeFallback), `framework.cpp`
(getSelectedAction), `HealthAndArmingChecks/checks/offboardCheck.cpp`, `navigator/rtl.cpp`;
`navigator/geofence.cpp` (Geofence::checkPointAgainstAllGeofences; the distances count from home, 0
switches a limit off, areas always count) and `geofence_params.c`; measurements.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from ...types import PX4, GeodeticPoint, Vector
from .failsafe_actions import AutopilotAction, FailsafeAction, Trigger
from .fence import Area, Fence, limit
from .offboard_loss import SOFT_MPS2, OffboardLoss
from .parameter_names import Name, Parameter, Parameters, ParameterTable, keys
from .parameter_rules import (
    CLIMBING,
    CLIMBS,
    FALLS,
    LANDS,
    NOTHING,
    RETURNS,
    UNTIL_IT_FALLS,
    Case,
    Level,
    Reaction,
    Rule,
    Verdict,
    excepted,
    excepts_us,
    landing_speed,
    reaction,
    shown,
    speed_limits,
    switch,
    time_on_last_setpoint,
)
from .profile import Profile

NAME = "PX4"

_ACTION = Parameter("COM_OBL_RC_ACT", 0.0)  # as the actions below
_WITHOUT_STICKS = Parameter("NAV_RCL_ACT", 2.0)
_RETURN = (
    # A return that climbs higher passes over some obstacles and hits others.
    Parameter("NAV_ACC_RAD", 2.0),
    Parameter("RTL_CONE_ANG", 45.0),
    Parameter("RTL_MIN_DIST", 10.0),
    Parameter("RTL_RETURN_ALT", 30.0),  # of `init.d/rc.mc_defaults`
    Parameter("RTL_TYPE", 0.0),
)
_LOSS = (
    _ACTION,
    Parameter("MPC_ACC_HOR", 3.0, 2.0),  # the softest braking of its range
    # By their ranges they may be almost 0: the aircraft would stop after minutes.
    Parameter("MPC_XY_P", 0.95),
    Parameter("MPC_Z_P", 1.0),
    _WITHOUT_STICKS,
    *_RETURN,
)
"""Parameters of the flight after an offboard loss, with the defaults of v1.17."""
_FAILSAFES = (
    Parameter("BAT_CRIT_THR", 0.07, 0.5),  # the earliest of their ranges
    Parameter("BAT_EMERGEN_THR", 0.05, 0.5),
    Parameter("COM_DLL_EXCEPT", 0.0, 0.0, (Name("COM_DLL_EXCEPT", (1, 16, 0)),), 0.0),  # no
    Parameter("COM_RCL_EXCEPT", 0.0, 0.0),  # exception: each loss acts
    # Actions: a landing and a return hit different obstacles, none is the worst one.
    Parameter("COM_LOW_BAT_ACT", 0.0),
    _ACTION,
    Parameter("NAV_DLL_ACT", 0.0),
    _WITHOUT_STICKS,
    *_RETURN,
)
_FENCE = (
    Parameter("GF_ACTION", 2.0, 2.0),  # the hold, which overrides a LAND outside
    # The limits themselves: one nearer than any value that is assumed would be crossed.
    Parameter("GF_MAX_HOR_DIST", 0.0),
    Parameter("GF_MAX_VER_DIST", 0.0),
    Parameter("GF_SOURCE", 0.0, 1.0),  # the receiver's position, which has more error
)
_HOLDING = (
    # The least lean and the weakest motors of their ranges: the least wind that is held.
    Parameter("MPC_TILTMAX_AIR", 45.0, 20.0),
    Parameter("MPC_THR_HOVER", 0.5, 0.8),
)
_STICKS = "COM_RC_OVERRIDE"
_CHECKED = (
    # Read by `check` alone, which judges no value that is not reported. Other unit and meaning:
    # the judge distinguishes them by the name.
    Parameter("MAN_OVERRIDE_SPD", 1.0, None, (Name("MAN_OVERRIDE_SPD", (1, 18, 0)), Name(_STICKS))),
)
_LANDING_MPS = 0.7
"""Default of MPC_LAND_SPEED, with which the energy of a landing is forecast."""
_DRIFT_M = 4.5
"""Drift after the loss of GPS in OFFBOARD until landing; measured on v1.17."""
_STICKS_BIT = 2
"""Bit of COM_RC_OVERRIDE: in OFFBOARD."""
_OFFBOARD_BIT = 4
"""Bit of COM_RCL_EXCEPT and COM_DLL_EXCEPT."""
_OFFBOARD_LOSS: dict[int, tuple[AutopilotAction | None, str]] = {
    0: (None, "position mode; without sticks by NAV_RCL_ACT"),
    1: (None, "altitude mode; without sticks by NAV_RCL_ACT"),
    2: (None, "stabilized mode; without sticks by NAV_RCL_ACT"),
    3: (AutopilotAction.RETURN, "return"),
    4: (AutopilotAction.LAND, "land"),
    5: (AutopilotAction.HOLD, "hold"),
    6: (AutopilotAction.FALL, "terminate"),
    7: (AutopilotAction.FALL, "disarm"),
}
"""COM_OBL_RC_ACT, by PX4's names; None: a mode with sticks, and without them NAV_RCL_ACT."""
_UNKNOWN_LOSS = (AutopilotAction.RETURN, "unknown value, taken as a return")
_WARNS = Reaction(AutopilotAction.NONE, "a warning")
_HOLDS = Reaction(AutopilotAction.HOLD, "hold")
_RC_LOSS = {1: _HOLDS, 2: RETURNS, 3: LANDS, 5: FALLS, 6: FALLS}
"""NAV_RCL_ACT. Any other value means no action, but a return after an offboard loss."""
_GCS_LOSS = {0: NOTHING, **_RC_LOSS}
"""NAV_DLL_ACT; any other value means no action."""
_LOW_BATTERY = {
    0: Reaction(AutopilotAction.NONE, f"a warning: {UNTIL_IT_FALLS}"),
    1: RETURNS,
    2: LANDS,
    3: Reaction(AutopilotAction.RETURN, f"{CLIMBING}; land when nearly empty"),
}
"""COM_LOW_BAT_ACT: the reaction at BAT_CRIT_THR, and at BAT_EMERGEN_THR, where 3 lands. At
BAT_LOW_THR PX4 only warns."""
_LANDS_WHEN_NEARLY_EMPTY = 3
_FENCE_REACTIONS = {
    0: (NOTHING, "nothing"),
    1: (_WARNS, "warn"),
    2: (_HOLDS, "hold"),
    3: (RETURNS, "return"),
    4: (FALLS, "terminate"),
    5: (LANDS, "land"),
}
"""GF_ACTION: the reaction, and the fence's text."""
_LIMIT_REACTIONS = {value: row for value, (row, _) in _FENCE_REACTIONS.items()}
"""GF_ACTION, COM_WIND_MAX_ACT; and of these 0, 1 and 3 COM_FLTT_LOW_ACT."""
_OVERSHOOT = 1.2
"""Factor of v / MPC_XY_P: the controller's integral contains the drag of the flight."""
_SWITCH_S2PM = 0.1
"""Term of v^2 that COM_OBL_RC_ACT adds: it brakes from the velocity at its start."""
_HARD_MPS2 = 3.0
"""Default of MPC_ACC_HOR: v^2 / 2a is longer with a lower value."""
_FENCE_HOLD = 2
_RADIUS_M = 6_371_000.0
_MAIN_MODES = {
    1: "MANUAL",
    2: "ALTCTL",
    3: "POSCTL",
    4: "AUTO",
    5: "ACRO",
    6: "OFFBOARD",
    7: "STABILIZED",
    8: "RATTITUDE",
    10: "TERMINATION",
    11: "ALTITUDE_CRUISE",
}
_AUTO_MODES = {
    1: "READY",
    2: "TAKEOFF",
    3: "HOLD",
    4: "MISSION",
    5: "RTL",
    6: "LAND",
    8: "FOLLOW_TARGET",
    9: "PRECLAND",
    10: "VTOL_TAKEOFF",
}
_POSCTL_MODES = {1: "ORBIT", 2: "POSCTL_SLOW"}
_OFFBOARD = (6, 0)
_LAND = (4, 6)


def _mode_numbers(custom_mode: int) -> tuple[int, int]:
    """Main and sub mode."""
    return custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF


def mode_name(custom_mode: int) -> str | None:
    """Name of a mode as QGroundControl shows it; None if unknown."""
    main, sub = _mode_numbers(custom_mode)
    if main == 4:
        return _AUTO_MODES.get(sub)
    if main == 3 and sub:
        return _POSCTL_MODES.get(sub)
    return _MAIN_MODES.get(main)


def to_local_ned(point: GeodeticPoint, origin: GeodeticPoint) -> Vector:
    """Position about an origin: an azimuthal equidistant projection on a sphere."""
    latitude, latitude_0 = math.radians(point.latitude_deg), math.radians(origin.latitude_deg)
    down_m = origin.altitude_amsl_m - point.altitude_amsl_m
    difference = math.radians(origin.east_deg(point.longitude_deg))
    # The sine of the half angle keeps full precision over metres, where an arccosine loses it.
    north = math.sin(latitude - latitude_0) + (
        2.0 * math.sin(latitude_0) * math.cos(latitude) * math.sin(0.5 * difference) ** 2
    )
    east = math.cos(latitude) * math.sin(difference)
    sine = math.hypot(north, east)
    if sine == 0.0:
        return 0.0, 0.0, down_m
    factor = _RADIUS_M * math.asin(min(1.0, sine)) / sine
    return north * factor, east * factor, down_m


@dataclass(frozen=True, slots=True, kw_only=True)
class Px4Return:
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
    def of(cls, value: Mapping[str, float]) -> Px4Return | None:
        """Return by the values of the parameters; None for a return to a place other than home."""
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


def _loss_action(value: Mapping[str, float]) -> AutopilotAction:
    """Action without setpoints and sticks."""
    action, _ = _OFFBOARD_LOSS.get(int(value["COM_OBL_RC_ACT"]), _UNKNOWN_LOSS)
    if action is None:
        return _RC_LOSS.get(int(value["NAV_RCL_ACT"]), RETURNS).action
    return action


def _loss(value: Mapping[str, float], _: Parameters) -> OffboardLoss:
    """Offboard loss: PX4 holds the last point with its velocity as feed-forward.

    It comes to rest v / MPC_XY_P beyond; where COM_OF_LOSS_T ends before that, it brakes at
    MPC_ACC_HOR. A bound over flights of the fake PX4 (`tests/safety/test_offboard_loss.py`).
    """
    brakes_mps2 = max(SOFT_MPS2, min(_HARD_MPS2, value["MPC_ACC_HOR"]))
    gain_per_s = max(0.1, min(value["MPC_XY_P"], value["MPC_Z_P"]))
    return OffboardLoss(
        kind=PX4,
        name=NAME,
        action=_loss_action(value),
        remedy="set COM_OBL_RC_ACT 5",
        timeout_s=None,
        stopping_s=_OVERSHOOT / gain_per_s,
        stopping_s2pm=_SWITCH_S2PM + 0.5 / brakes_mps2 - 0.5 / _HARD_MPS2,
        home=Px4Return.of(value),
        unknown_return="RTL_TYPE is not 0",
    )


def _fence(values: Mapping[str, float], areas: tuple[Area, ...], _enabled: bool) -> Fence:
    action = int(values["GF_ACTION"])
    return Fence(
        circle=limit(values, "GF_MAX_HOR_DIST", on=values["GF_MAX_HOR_DIST"] > 0.0),
        ceiling=limit(values, "GF_MAX_VER_DIST", on=values["GF_MAX_VER_DIST"] > 0.0),
        areas=areas,
        action=_FENCE_REACTIONS.get(action, _FENCE_REACTIONS[1])[1],
        overrules_land=action == _FENCE_HOLD,
        source_gnss="GF_SOURCE" if values["GF_SOURCE"] == 1.0 else "",
    )


def _actions(value: Mapping[str, float]) -> Iterator[FailsafeAction]:
    """Yields PX4's failsafe actions in OFFBOARD, by the values of all of _FAILSAFES."""
    home = Px4Return.of(value)
    battery = int(value["COM_LOW_BAT_ACT"])
    critical = _LOW_BATTERY.get(battery, NOTHING).action
    emergency = AutopilotAction.LAND if battery == _LANDS_WHEN_NEARLY_EMPTY else critical
    for trigger, threshold, action in (
        (Trigger.CRITICAL_BATTERY, "BAT_CRIT_THR", critical),
        (Trigger.EMERGENCY_BATTERY, "BAT_EMERGEN_THR", emergency),
    ):
        yield FailsafeAction(
            trigger=trigger,
            action=action,
            setting=f"COM_LOW_BAT_ACT {battery}",
            remedy="COM_LOW_BAT_ACT 0",
            charge=value[threshold],
            home=home,
        )
    for trigger, name, excepts, table in (
        (Trigger.RC_LOSS, "NAV_RCL_ACT", "COM_RCL_EXCEPT", _RC_LOSS),
        (Trigger.GCS_LOSS, "NAV_DLL_ACT", "COM_DLL_EXCEPT", _GCS_LOSS),
    ):
        if int(value[excepts]) & _OFFBOARD_BIT:
            continue
        yield FailsafeAction(
            trigger=trigger,
            action=table.get(int(value[name]), NOTHING).action,
            setting=f"{name} {value[name]:g}",
            remedy=f"{name} 1 (hold), or {excepts} {int(value[excepts]) | _OFFBOARD_BIT}",
            home=home,
        )
    offboard = f"COM_OBL_RC_ACT {value['COM_OBL_RC_ACT']:g}"
    lost = _loss_action(value)
    # Position setpoints need a position: without one the offboard-loss action runs. An action that
    # needs a position, too, falls back to a descent. ALTCTL without sticks is a descent as well.
    yield FailsafeAction(
        trigger=Trigger.GPS_LOSS,
        action=AutopilotAction.FALL if lost is AutopilotAction.FALL else AutopilotAction.DESCEND,
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
    _, word = _OFFBOARD_LOSS.get(int(value), _UNKNOWN_LOSS)
    level = Level.WARNING if action is AutopilotAction.RETURN else Level.OK
    if case.loss.objection_anywhere is not None:
        level = case.objection
    return level, f"{value:g} ({word}{_THEREFORE.get(action, '')})"


def _by_bits(case: Case) -> bool:
    """True before v1.18, where a mask has the modes in which the sticks take over."""
    return case.parameters.called("MAN_OVERRIDE_SPD").name == _STICKS


def _take_over(value: float, case: Case) -> Verdict:
    if int(value) & _STICKS_BIT if _by_bits(case) else value >= 0.0:
        return Level.OK, f"{value:g} (in OFFBOARD, too)"
    words = "not in OFFBOARD, where only the mode switch takes over"
    return Level.WARNING, f"{value:g} ({words})"


_RULES = (
    Rule(
        parameter="COM_OF_LOSS_T",
        judge=time_on_last_setpoint,
        meaning="time for which PX4 keeps the last setpoint after a companion failure",
        remedy="set 0.5",
        advised=0.5,
        unknown=Level.NO_GO,
    ),
    Rule(
        parameter="COM_OBL_RC_ACT",
        judge=_companion_loss,
        meaning="PX4's action after a companion failure",
        remedy="set 5 (hold)",
        advised=5,
        unknown=Level.NO_GO,
    ),
    Rule(
        parameter="MAN_OVERRIDE_SPD",
        judge=_take_over,
        meaning="take-over by the sticks",
        remedy=lambda case: "set 3" if _by_bits(case) else "set 1",
        advised=lambda _, case: 3 if _by_bits(case) else 1,
    ),
    excepts_us("COM_RCL_EXCEPT", "remote control", "OFFBOARD"),
    Rule(
        parameter="NAV_RCL_ACT",
        judge=excepted(reaction(_RC_LOSS), ("COM_RCL_EXCEPT", 2), "not in OFFBOARD"),
        meaning="PX4's action when the remote control is lost",
        remedy="set 1 (hold) or 3 (land)",
        advised=1,
        unknown=Level.NO_GO,
    ),
    excepts_us("COM_DLL_EXCEPT", "ground station", "OFFBOARD"),
    Rule(
        parameter="NAV_DLL_ACT",
        judge=excepted(reaction(_GCS_LOSS), ("COM_DLL_EXCEPT", 2), "not in OFFBOARD"),
        meaning="PX4's action when the ground station is lost",
        remedy="set 1 (hold), 3 (land) or 0 (nothing)",
        advised=1,
        unknown=Level.NO_GO,
    ),
    Rule(
        parameter="GF_ACTION",
        judge=reaction(_LIMIT_REACTIONS),
        meaning="PX4's action at its fence",
        remedy="set 2 (hold)",
        advised=2,
        unknown=Level.NO_GO,
    ),
    Rule(
        parameter="COM_LOW_BAT_ACT",
        judge=reaction(_LOW_BATTERY, none=Level.NOTE, returns=Level.NOTE),
        meaning="PX4's action at BAT_CRIT_THR: order the exit before",
        remedy="set 2 (land) or 0 (a warning)",
    ),
    Rule(
        parameter="COM_FLTT_LOW_ACT",
        judge=reaction({value: _LIMIT_REACTIONS[value] for value in (0, 1, 3)}),
        meaning="PX4's action when the remaining flight time is that of its return",
        remedy="set 1 (a warning)",
        advised=1,
        unknown=Level.NOTE,
    ),
    Rule(
        parameter="COM_FLT_TIME_MAX",
        judge=lambda value, _: (
            (Level.OK, "off") if value < 0.0 else (Level.WARNING, f"{value:g} s, then {CLIMBING}")
        ),
        meaning="the flight time after which PX4 returns",
        remedy="set -1 (off), or land before",
        advised=-1,
        unknown=Level.NOTE,
    ),
    Rule(
        parameter="COM_WIND_MAX_ACT",
        judge=reaction(_LIMIT_REACTIONS, falls=Level.WARNING),
        meaning="PX4's action in more wind than COM_WIND_MAX, if that is above 0",
        remedy="set 2 (hold)",
        advised=2,
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
    Rule(
        parameter="MPC_LAND_SPEED",
        judge=landing_speed(_LANDING_MPS),
        meaning="the speed of PX4's landing",
        remedy="set 0.7, or land with more charge",
        advised=0.7,
    ),
    *speed_limits("PX4", ("MPC_XY_VEL_MAX", "MPC_Z_VEL_MAX_UP", "MPC_Z_VEL_MAX_DN")),
    Rule(
        parameter="MAV_1_FORWARD",
        judge=_forwarding,
        meaning="forwarding of messages between ground station and companion on TELEM2",
        remedy="set 1",
        advised=1,
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

PROFILE = Profile(
    kind=PX4,
    name=NAME,
    mav_autopilot=12,
    measured_releases=((1, 17), (1, 18)),
    newest_release=(1, 18),
    oldest_release=(1, 14),
    mode_name=mode_name,
    mode_enums={},
    is_own_mode=lambda custom_mode: _mode_numbers(custom_mode) == _OFFBOARD,
    own_mode="OFFBOARD",
    own_mode_numbers=_OFFBOARD,
    land_mode="LAND",
    land_mode_numbers=_LAND,
    armed_in_mode_request=True,
    homeward_modes=frozenset({"RTL", "LAND", "PRECLAND", "TERMINATION"}),
    follow_up_modes={"TAKEOFF": "HOLD"},
    streams_by_itself=True,
    line_share=0.5,  # of MAV_1_RATE and MAV_2_RATE 0, their default
    rates_hz={
        "ODOMETRY": 5.0,
        "ESTIMATOR_STATUS": 1.0,
        "WIND_COV": 2.0,
        "HIGHRES_IMU": 2.0,
        "LINK_NODE_STATUS": 1.0,
        # It refuses another rate of its heartbeat, 1 Hz, but accepts one of CURRENT_MODE, at which
        # it looks for a change; an unchanged mode comes twice a second.
        "CURRENT_MODE": 20.0,
    },
    integers_bytewise=True,
    rssi_max=100,  # the percentage of its receivers' drivers
    channels_without_receiver=False,
    summary_is_battery_0=False,
    better_gnss_taken=True,  # by accuracy (SENS_GPS_MASK)
    gnss_switch=None,
    gnss_switch_better=frozenset(),
    gnss_primary=None,
    motor_range=("PWM_MAIN_MIN1", "PWM_MAIN_MAX1"),
    unused_pulse_us=900.0,
    failsafe_flies=True,
    failsafe_texts=(),
    innovation_limit=math.inf,
    to_local_ned=to_local_ned,
    projection_known=True,
    home_by_projection=False,  # home keeps its local position from when it was set
    # v1.17 (SIH), which reported errors of 0.03 to 0.2 m; the greatest one was in height. From the
    # true position to the setpoint 2.48 m in calm air; in gusts the measured tracking error counts.
    position_error_m=1.4,
    tracking_error_m=1.15,
    stray_s2=0.58,
    landing_mps=_LANDING_MPS,
    landed_hover_s=5.0,  # the motors stop after 8 s
    speed_parameters=("MPC_XY_CRUISE", "MPC_Z_V_AUTO_UP", "MPC_Z_V_AUTO_DN"),
    cells_parameter="BAT1_N_CELLS",
    capacity_parameter="BAT1_CAPACITY",
    tilt_limits=("MPC_TILTMAX_AIR",),
    hover_thrust="MPC_THR_HOVER",
    parameters=ParameterTable((*_LOSS, *_FAILSAFES, *_FENCE, *_HOLDING, *_CHECKED)),
    loss_parameters=keys(_LOSS),
    read_loss=_loss,
    failsafe_parameters=keys(_FAILSAFES),
    read_failsafes=_actions,
    fence_parameters=keys(_FENCE),
    read_fence=_fence,
    rules=_RULES,
)

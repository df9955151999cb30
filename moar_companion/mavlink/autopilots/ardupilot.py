"""ArduCopter: its modes, failsafes, fence, frame and flight, and the rules of check.

Names and units of parameters: the parameters' descriptions and ranges of 4.6.3; ArduPilot's page
"Parameter Name Changes" and the conversion tables in its source for 4.7. PSC_JERK_* had a name in
4.7.0 that 4.7.1 changed again.

Sources: manual of ArduCopter 4.6, "Failsafes" and the parameters' descriptions; source of 4.6.3,
`ArduCopter/mode.h`, `events.cpp` (failsafe_radio_on_event, failsafe_gcs_on_event,
handle_battery_failsafe, failsafe_deadreckon_check, do_failsafe_action), `ekf_check.cpp`
(failsafe_ekf_event), `mode_rtl.cpp` (compute_return_target), `fence.cpp`; `AP_BattMonitor.cpp`;
`AC_Fence.cpp` (var_info, check), `AC_PolyFence_loader.cpp` (breached); `AP_Common/Location.h`
(LOCATION_SCALING_FACTOR); measurements.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from ...types import ARDUPILOT, GeodeticPoint, Vector
from ..telemetry import Failsafe
from .failsafe_actions import AutopilotAction, FailsafeAction, Trigger
from .fence import Area, Fence, limit
from .offboard_loss import SOFT_MPS2, OffboardLoss
from .parameter_names import Name, Parameter, Parameters, ParameterTable, Release, keys
from .parameter_rules import (
    CLIMBING,
    FALLS,
    LANDS,
    NOTHING,
    RETURNS,
    UNTIL_IT_FALLS,
    Case,
    Judge,
    Level,
    Reaction,
    Rule,
    Verdict,
    bits,
    cell_voltage,
    choice,
    excepted,
    excepts_us,
    follows_setpoints,
    landing_speed,
    reaction,
    shown,
    speed_limits,
    switch,
    time_on_last_setpoint,
    volts_a_cell,
    where_zero,
)
from .profile import FailsafeText, Profile

NAME = "ArduPilot"

_4_7: Release = (4, 7, 0)


def _renamed(name: str, before: str, scale: float) -> tuple[Name, ...]:
    """Names of a parameter that 4.7 renamed. scale: of its unit before, in today's."""
    return Name(name, _4_7), Name(before, scale=scale)


_CM, _CDEG = 0.01, 0.01
"""Units before 4.7: cm, cm/s, cm/s^2, and hundredths of a degree."""
_LOSS = (
    # Any value may be set, up to 5 s by its range: the aircraft would fly on so long.
    Parameter("GUID_TIMEOUT", 3.0),
    # The softest braking and shaping that their ranges allow. Setpoints of most vehicle files
    # accelerate more than that.
    Parameter("WP_ACC", 2.5, 0.5, _renamed("WP_ACC", "WPNAV_ACCEL", _CM), forbids=True),
    Parameter("WP_ACC_Z", 1.0, 0.5, _renamed("WP_ACC_Z", "WPNAV_ACCEL_Z", _CM), forbids=True),
    Parameter(
        "PSC_NE_JERK",
        5.0,
        1.0,
        (Name("PSC_NE_JERK", (4, 7, 1)), Name("PSC_JERK_NE", _4_7), Name("PSC_JERK_XY")),
    ),
    Parameter(
        "PSC_D_JERK",
        5.0,
        1.0,
        (Name("PSC_D_JERK", (4, 7, 1)), Name("PSC_JERK_D", _4_7), Name("PSC_JERK_Z")),
    ),
)
"""Parameters of the flight after an offboard loss, with the defaults of 4.6."""
_FAILSAFES = (
    # Thresholds: in the worst case the action comes at once, and no inspection could begin.
    Parameter("BATT_CAPACITY", 3300.0),
    Parameter("BATT_CRT_MAH", 0.0),
    Parameter("BATT_CRT_VOLT", 0.0),
    Parameter("BATT_LOW_MAH", 0.0),
    Parameter("BATT_LOW_VOLT", 10.5),
    # Actions: a landing and a return hit different obstacles, none is the worst one.
    Parameter("BATT_FS_CRT_ACT", 0.0),
    Parameter("BATT_FS_LOW_ACT", 0.0),
    Parameter("FS_DR_ENABLE", 2.0),
    Parameter("FS_GCS_ENABLE", 0.0),
    Parameter("FS_THR_ENABLE", 1.0),
    # With a wind estimate dead reckoning has a failsafe of its own, beside the estimator's.
    Parameter("EK3_DRAG_BCOEF_X", 0.0, 2.0),
    Parameter("EK3_DRAG_MCOEF", 0.0, 1.0),
    Parameter("FS_EKF_ACTION", 1.0, 1.0),  # the descent, which hits more than a drift
    Parameter("FS_OPTIONS", 16.0, 0.0),  # no bit: each loss acts in GUIDED
    # A return that climbs higher passes over some obstacles and hits others.
    Parameter("RTL_ALT_M", 15.0, None, _renamed("RTL_ALT_M", "RTL_ALT", _CM)),
    Parameter("RTL_CLIMB_MIN_M", 0.0, None, _renamed("RTL_CLIMB_MIN_M", "RTL_CLIMB_MIN", _CM)),
    Parameter("RTL_CONE_SLOPE", 3.0),
)
_FENCE = (
    Parameter("FENCE_ACTION", 1.0, 1.0),  # for texts alone: the fence is kept for every action
    # The limits themselves: one nearer than any value that is assumed would be crossed.
    Parameter("FENCE_ALT_MAX", 100.0),
    Parameter("FENCE_ALT_MIN", -10.0),
    Parameter("FENCE_RADIUS", 300.0),
    Parameter("FENCE_AUTOENABLE", 0.0, 1.0, (Name("FENCE_AUTOENABLE", (4, 6, 0)),), 0.0),  # on
    Parameter("FENCE_ENABLE", 0.0, 1.0),  # on
    Parameter("FENCE_MARGIN", 2.0, 10.0),  # the greatest of their ranges
    Parameter("FENCE_MARGIN_XY", 0.0, 50.0, (Name("FENCE_MARGIN_XY", _4_7),), 0.0),
    Parameter("FENCE_OPTIONS", 0.0, 0.0),  # no union: all inclusion areas have to be kept
    Parameter("FENCE_TYPE", 7.0, 15.0),  # all kinds of limits
)
_HOLDING = (
    # The least lean and the weakest motors of their ranges: the least wind that is held.
    Parameter("PSC_ANGLE_MAX", 0.0, 10.0),
    Parameter("ATC_ANGLE_MAX", 30.0, 10.0, _renamed("ATC_ANGLE_MAX", "ANGLE_MAX", _CDEG)),
    Parameter("MOT_THST_HOVER", 0.35, 0.6875),
)
_CHECKED = (
    # Read by `check` alone, which judges no value that is not reported.
    Parameter("LAND_SPD_MS", 0.5, None, _renamed("LAND_SPD_MS", "LAND_SPEED", _CM)),
    Parameter("WP_SPD", 10.0, None, _renamed("WP_SPD", "WPNAV_SPEED", _CM)),
    Parameter("WP_SPD_UP", 2.5, None, _renamed("WP_SPD_UP", "WPNAV_SPEED_UP", _CM)),
    Parameter("WP_SPD_DN", 1.5, None, _renamed("WP_SPD_DN", "WPNAV_SPEED_DN", _CM)),
)
_RC_IN_GUIDED = 1 << 2
"""Bit of FS_OPTIONS: GUIDED continues without the remote control. The GCS has no such bit."""
_BRAKES = Reaction(AutopilotAction.HOLD, "brake, or land")
_SMART_RETURN = Reaction(AutopilotAction.RETURN, f"smart return, or {CLIMBING}")
_SMART_RETURN_OR_LAND = Reaction(AutopilotAction.LAND, "smart return on the flown path, or land")
"""A smart return counts as its fallback: ArduPilot does not report if it has a path (SRTL_POINTS, a
full buffer), and on that path it cuts corners by SRTL_ACCURACY, 2 m."""
_LANDING_SEQUENCE = Reaction(AutopilotAction.RETURN, f"landing sequence, or {CLIMBING}")
_ACTIONS = {
    0: NOTHING,
    1: LANDS,
    2: RETURNS,
    3: _SMART_RETURN,
    4: _SMART_RETURN_OR_LAND,
    5: FALLS,
    6: _LANDING_SEQUENCE,
    7: _BRAKES,
}
"""FailsafeAction: of the battery and of dead reckoning."""
_RADIO = {
    0: NOTHING,
    1: RETURNS,
    2: RETURNS,
    3: LANDS,
    4: _SMART_RETURN,
    5: _SMART_RETURN_OR_LAND,
    6: _LANDING_SEQUENCE,
    7: _BRAKES,
}
"""FS_THR_ENABLE; any other value lands."""
_GROUND_STATION = {**_RADIO, 3: _SMART_RETURN, 4: _SMART_RETURN_OR_LAND, 5: LANDS}
"""FS_GCS_ENABLE; any other value returns."""
_LANDING_MPS = 0.5
"""Default of LAND_SPD_MS, with which the energy of a landing is forecast."""
_DRIFT_M = 5.3
"""Drift after the loss of GPS until the estimator failsafe has landed; measured on 4.6.3."""
_DRAG = {"EK3_DRAG_BCOEF_X": 1.0, "EK3_DRAG_BCOEF_Y": 1.0, "EK3_DRAG_MCOEF": 0.001}
"""Greatest values without effect (NavEKF3_core::SampleDragData). If all are 0 ArduPilot estimates
no wind. The flight does not ask for BCOEF_Y, which is set together with BCOEF_X."""
_ESTIMATOR: dict[int, tuple[AutopilotAction, Verdict]] = {
    0: (AutopilotAction.DESCEND, (Level.NO_GO, "land; in later releases a report only")),
    1: (AutopilotAction.DESCEND, (Level.OK, "land")),
    2: (AutopilotAction.DRIFT, (Level.WARNING, "altitude hold, which drifts with the wind")),
    3: (AutopilotAction.DESCEND, (Level.OK, "land")),
}
"""FS_EKF_ACTION; any other value lands."""
_LEAST_HEIGHT_M = 0.3
"""Least height of a return, RTL_ALT_MIN."""
_LEAST_SLOPE = 0.5
"""Least slope of the cone, RTL_MIN_CONE_SLOPE: none below it."""
_DETECTION_S = 0.4
"""0.1 s until ArduPilot detects missing setpoints; the rest is the shaper's jerk."""
_SHAPING_S = 0.5
"""Time in which the default jerk reaches the acceleration. Each further second of a lower jerk
adds _SHAPED s to the stop."""
_SHAPED = 1.1
_LEVEL = 0.5
"""Fraction of WP_ACC with which ArduPilot brakes in a tail wind."""
_ALTITUDE_MAX, _CIRCLE, _AREAS, _ALTITUDE_MIN = 1, 2, 4, 8
"""Bits of FENCE_TYPE."""
_INCLUSION_UNION = 2
"""Bit of FENCE_OPTIONS: the union of the inclusion areas counts."""
_FENCE_REACTIONS = {
    0: (Reaction(AutopilotAction.NONE, "a report only"), "report"),
    1: (RETURNS, "return or land"),
    2: (LANDS, "land"),
    3: (_SMART_RETURN, "smart return or return or land"),
    4: (_BRAKES, "brake or land"),
    5: (_SMART_RETURN_OR_LAND, "smart return or land"),
}
"""FENCE_ACTION: the reaction, and the fence's text."""
_RADIUS_M = 6_378_100.0
_GUIDED, _LAND = 4, 9
_MODES = {
    0: "STABILIZE",
    1: "ACRO",
    2: "ALT_HOLD",
    3: "AUTO",
    _GUIDED: "GUIDED",
    5: "LOITER",
    6: "RTL",
    7: "CIRCLE",
    _LAND: "LAND",
    11: "DRIFT",
    13: "SPORT",
    14: "FLIP",
    15: "AUTOTUNE",
    16: "POSHOLD",
    17: "BRAKE",
    18: "THROW",
    19: "AVOID_ADSB",
    20: "GUIDED_NOGPS",
    21: "SMART_RTL",
    22: "FLOWHOLD",
    23: "FOLLOW",
    24: "ZIGZAG",
    25: "SYSTEMID",
    26: "AUTOROTATE",
    27: "AUTO_RTL",
    28: "TURTLE",
}
"""Names of the custom modes of a copter."""
_FAILSAFE_TEXTS = (
    FailsafeText(
        failsafe=Failsafe.BATTERY,
        begins=re.compile(r"Battery (\d+ is (low|critical)|Failsafe)"),
        lasts_s=math.inf,  # a battery does not recover
    ),
    FailsafeText(
        failsafe=Failsafe.REMOTE_CONTROL,
        begins=re.compile(r"Radio Failsafe(?! Cleared)"),
        ends="Radio Failsafe Cleared",
        lasts_s=60.0,
    ),
    FailsafeText(
        failsafe=Failsafe.GROUND_STATION,
        begins=re.compile(r"GCS Failsafe(?! Cleared)"),
        ends="GCS Failsafe Cleared",
        lasts_s=60.0,
    ),
    FailsafeText(
        failsafe=Failsafe.ESTIMATOR,
        begins=re.compile(r"EKF (variance|Failsafe(?! Cleared))"),
        ends="EKF Failsafe Cleared",
        lasts_s=5.0,  # it ends 1 s after its cause
    ),
    FailsafeText(
        failsafe=Failsafe.DEAD_RECKONING,
        begins=re.compile(r"Dead Reckoning started"),
        ends="Dead Reckoning stopped",
        lasts_s=5.0,
    ),
    FailsafeText(
        failsafe=Failsafe.FENCE,
        begins=re.compile(r".*[Ff]ence breached"),
        lasts_s=60.0,
    ),
)
"""Texts of events.cpp, ekf_check.cpp, fence.cpp, AP_BattMonitor.cpp. The first is longer than one
chunk: its first chunk identifies it."""


def to_local_ned(point: GeodeticPoint, origin: GeodeticPoint) -> Vector:
    """Position about an origin: angles times a radius and the cosine of the mean latitude."""
    latitude, latitude_0 = math.radians(point.latitude_deg), math.radians(origin.latitude_deg)
    scale = math.cos(0.5 * (latitude + latitude_0))
    return (
        (latitude - latitude_0) * _RADIUS_M,
        math.radians(origin.east_deg(point.longitude_deg)) * scale * _RADIUS_M,
        origin.altitude_amsl_m - point.altitude_amsl_m,
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class ArduPilotReturn:
    """ArduPilot's return (no rally points, no terrain): up, level, down; heights above home."""

    altitude_m: float
    climb_m: float
    slope: float
    """Slope of the cone over home below which a near return stays."""

    @classmethod
    def of(cls, value: Mapping[str, float]) -> ArduPilotReturn:
        """Return by the values of the parameters."""
        return cls(
            altitude_m=value["RTL_ALT_M"],
            climb_m=max(0.0, value["RTL_CLIMB_MIN_M"]),
            slope=value["RTL_CONE_SLOPE"],
        )

    def height_m(self, height_m: float, distance_m: float) -> float:
        """Height of the level part, from a height and a level distance to home."""
        least_m = max(_LEAST_HEIGHT_M, height_m + self.climb_m)
        top_m = max(self.altitude_m, least_m)
        if self.slope >= _LEAST_SLOPE:
            top_m = min(top_m, max(distance_m * self.slope, least_m))
        return top_m


def _actions(value: Mapping[str, float]) -> Iterator[FailsafeAction]:
    """Yields ArduPilot's failsafe actions in GUIDED, by the values of all of _FAILSAFES."""
    home = ArduPilotReturn.of(value)
    capacity_mah = value["BATT_CAPACITY"]
    for trigger, stage in ((Trigger.LOW_BATTERY, "LOW"), (Trigger.CRITICAL_BATTERY, "CRT")):
        name, volts, left_mah = (f"BATT_FS_{stage}_ACT", f"BATT_{stage}_VOLT", f"BATT_{stage}_MAH")
        thresholds = value[volts] > 0.0 or value[left_mah] > 0.0
        yield FailsafeAction(
            trigger=trigger,
            action=_ACTIONS.get(int(value[name]) if thresholds else 0, NOTHING).action,
            setting=f"{name} {value[name]:g}",
            remedy=f"{name} 0 (nothing)",
            charge=min(1.0, value[left_mah] / capacity_mah)
            if value[left_mah] > 0.0 and capacity_mah > 0.0
            else None,
            voltage_v=value[volts] if value[volts] > 0.0 else None,
            home=home,
        )
    if not int(value["FS_OPTIONS"]) & _RC_IN_GUIDED:
        yield FailsafeAction(
            trigger=Trigger.RC_LOSS,
            action=_RADIO.get(int(value["FS_THR_ENABLE"]), LANDS).action,
            setting=f"FS_THR_ENABLE {value['FS_THR_ENABLE']:g}",
            remedy=f"FS_OPTIONS {int(value['FS_OPTIONS']) | _RC_IN_GUIDED}, "
            "or FS_THR_ENABLE 7 (brake)",
            home=home,
        )
    yield FailsafeAction(
        trigger=Trigger.GCS_LOSS,
        action=_GROUND_STATION.get(int(value["FS_GCS_ENABLE"]), RETURNS).action,
        setting=f"FS_GCS_ENABLE {value['FS_GCS_ENABLE']:g}",
        remedy="FS_GCS_ENABLE 7 (brake)",
        home=home,
    )
    if any(value.get(name, 0.0) > least for name, least in _DRAG.items()):
        # Dead reckoning needs a wind estimate, which a copter has only by its drag.
        yield FailsafeAction(
            trigger=Trigger.GPS_LOSS,
            action=_ACTIONS.get(int(value["FS_DR_ENABLE"]), NOTHING).action,
            setting=f"FS_DR_ENABLE {value['FS_DR_ENABLE']:g}",
            remedy="FS_DR_ENABLE 0",
            home=home,
        )
    yield FailsafeAction(
        trigger=Trigger.GPS_LOSS,
        action=_ESTIMATOR.get(int(value["FS_EKF_ACTION"]), _ESTIMATOR[1])[0],
        setting=f"FS_EKF_ACTION {value['FS_EKF_ACTION']:g}",
        drift_m=_DRIFT_M,
    )
    yield FailsafeAction(
        trigger=Trigger.COMPANION_LOSS, action=AutopilotAction.HOLD, setting="GUID_TIMEOUT"
    )


def _loss(value: Mapping[str, float], parameters: Parameters) -> OffboardLoss:
    """Offboard loss: ArduPilot moves the last point on at its velocity for GUID_TIMEOUT.

    Then it brakes at WP_ACC or WP_ACC_Z, as its jerk allows. A bound over flights of the
    fake ArduPilot (`tests/safety/test_offboard_loss.py`).
    """
    timeout_s = max(0.0, value["GUID_TIMEOUT"])
    level_mps2 = max(SOFT_MPS2, value["WP_ACC"])
    upright_mps2 = max(SOFT_MPS2, value["WP_ACC_Z"])
    shaping_s = max(
        level_mps2 / max(SOFT_MPS2, value["PSC_NE_JERK"]),
        upright_mps2 / max(SOFT_MPS2, value["PSC_D_JERK"]),
    )
    return OffboardLoss(
        kind=ARDUPILOT,
        name=NAME,
        action=AutopilotAction.HOLD,
        remedy="set GUID_TIMEOUT 0.5",
        timeout_s=timeout_s,
        timeout_parameter="GUID_TIMEOUT",
        stopping_s=timeout_s + _DETECTION_S + max(0.0, _SHAPED * (shaping_s - _SHAPING_S)),
        stopping_s2pm=max(0.5 / (_LEVEL * level_mps2), 0.5 / upright_mps2),
        follows_mps2=min(level_mps2, upright_mps2),
        follows_parameters=parameters.shown(("WP_ACC", "WP_ACC_Z")),
        follows_unit_mps2=parameters.called("WP_ACC").scale,
    )


def _fence(values: Mapping[str, float], areas: tuple[Area, ...], enabled: bool) -> Fence:
    """Fence. ArduPilot's RC switch, mission items and DO_FENCE_ENABLE change no parameter.

    (AC_Fence::enable.) A fence that they disable still counts while a parameter enables it.
    """
    if not (enabled or values["FENCE_ENABLE"] or values["FENCE_AUTOENABLE"]):
        return Fence()
    chosen = int(values["FENCE_TYPE"])
    return Fence(
        circle=limit(values, "FENCE_RADIUS", on=chosen & _CIRCLE),
        ceiling=limit(values, "FENCE_ALT_MAX", on=chosen & _ALTITUDE_MAX),
        floor=limit(values, "FENCE_ALT_MIN", on=chosen & _ALTITUDE_MIN),
        areas=areas if chosen & _AREAS else (),
        union=bool(int(values["FENCE_OPTIONS"]) & _INCLUSION_UNION),
        margin_m=max(0.0, values["FENCE_MARGIN"], values["FENCE_MARGIN_XY"]),
        action=_FENCE_REACTIONS.get(int(values["FENCE_ACTION"]), _FENCE_REACTIONS[1])[1],
    )


def _variance(value: float, _: Case) -> Verdict:
    if value <= 0.0:
        return Level.NO_GO, f"{value:g} (off)"
    return (Level.OK if value <= 1.0 else Level.WARNING), f"{value:g}"


def _battery_action(table: Mapping[int, Reaction], stage: str) -> Judge:
    """Judges a battery's action; warns if its stage has no threshold: it then has no effect."""
    return where_zero(
        reaction(table, none=Level.NOTE, returns=Level.NOTE),
        (f"BATT_{stage}_VOLT", f"BATT_{stage}_MAH"),
        lambda level: max(level, Level.WARNING),
        "without effect",
    )


_FLIES_ON = "nothing, ArduPilot flies on for FS_DR_TIMEOUT"
_RULES = (
    Rule(
        parameter="GUID_TIMEOUT",
        judge=time_on_last_setpoint,
        meaning="time for which ArduPilot follows the last setpoint after a companion failure",
        remedy="set 0.5",
        advised=0.5,
        unknown=Level.NO_GO,
    ),
    Rule(
        parameter="GUID_OPTIONS",
        judge=bits(
            0b110000,
            clear=(Level.OK, "both are held"),
            is_set=(Level.NO_GO, "not held, by bit 4 or 5"),
        ),
        meaning="hold of position and velocity in GUIDED",
        remedy="clear bits 4 and 5",
        advised=lambda value, _: int(value) & ~0b110000,
        unknown=Level.NO_GO,
    ),
    excepts_us("FS_OPTIONS", "remote control", "GUIDED"),
    Rule(
        parameter="FS_THR_ENABLE",
        judge=excepted(reaction(_RADIO, none=Level.WARNING), ("FS_OPTIONS", 2), "not in GUIDED"),
        meaning="ArduPilot's action when the remote control is lost",
        remedy="set 3 (land) or 7 (brake, or land)",
        advised=7,
    ),
    Rule(
        parameter="FS_GCS_ENABLE",
        judge=reaction(_GROUND_STATION),
        meaning="ArduPilot's action when the ground station is lost",
        remedy="set 5 (land), 7 (brake, or land) or 0 (nothing)",
        advised=7,
    ),
    Rule(
        parameter="FS_EKF_ACTION",
        judge=choice({value: verdict for value, (_, verdict) in _ESTIMATOR.items()}),
        meaning="ArduPilot's action when its position is lost",
        remedy="set 1 (land)",
        advised=1,
        unknown=Level.NO_GO,
    ),
    Rule(
        parameter="FS_EKF_THRESH",
        judge=_variance,
        meaning="variance of the estimator at which that action starts",
        remedy="set 0.8",
        advised=0.8,
        unknown=Level.NO_GO,
    ),
    Rule(
        parameter="FS_DR_ENABLE",
        judge=where_zero(
            reaction(
                {**_ACTIONS, 0: Reaction(AutopilotAction.NONE, _FLIES_ON)}, none=Level.WARNING
            ),
            tuple(_DRAG),
            lambda level: min(level, Level.NOTE),
            "without effect",
        ),
        meaning="ArduPilot's action with GPS lost, when its position estimate uses the wind alone",
        remedy="set 1 (land)",
        advised=1,
        unknown=Level.NO_GO,
    ),
    Rule(
        parameter="FENCE_ENABLE",
        judge=bits(1, clear=(Level.OK, "off"), is_set=(Level.OK, "on")),
        meaning="ArduPilot's fence",
    ),
    Rule(
        parameter="FENCE_ACTION",
        judge=where_zero(
            reaction({value: row for value, (row, _) in _FENCE_REACTIONS.items()}),
            ("FENCE_ENABLE",),
            lambda level: min(level, Level.NOTE),
            "once the fence is on",
        ),
        meaning="ArduPilot's action at its fence",
        remedy="set 4 (brake, or land)",
        advised=4,
    ),
    Rule(
        parameter="BATT_MONITOR",
        judge=switch(off=Level.NO_GO),
        meaning="the battery monitor's type; 0 is none",
        remedy="set up the battery monitor",
        unknown=Level.NO_GO,
    ),
    Rule(
        parameter="BATT_FS_LOW_ACT",
        judge=_battery_action(_ACTIONS, "LOW"),
        meaning="ArduPilot's action on a low battery",
        remedy="set 1 (land) or 0 (nothing), and BATT_LOW_VOLT or BATT_LOW_MAH",
        unknown=Level.NO_GO,
    ),
    Rule(
        parameter="BATT_FS_CRT_ACT",
        judge=_battery_action(
            {**_ACTIONS, 0: Reaction(AutopilotAction.NONE, f"nothing: {UNTIL_IT_FALLS}")}, "CRT"
        ),
        meaning="ArduPilot's action on a critical battery",
        remedy="set 1 (land) or 0 (nothing), and BATT_CRT_VOLT or BATT_CRT_MAH",
        unknown=Level.NO_GO,
    ),
    Rule(
        parameter="BATT_LOW_VOLT",
        judge=cell_voltage(3.3),
        meaning="the voltage of a low battery",
        remedy="set 3.5 V a cell",
        advised=volts_a_cell(3.5),
    ),
    Rule(
        parameter="BATT_CRT_VOLT",
        judge=cell_voltage(3.1),
        meaning="the voltage of a critical battery",
        remedy="set 3.3 V a cell",
        advised=volts_a_cell(3.3),
    ),
    *(
        Rule(
            parameter=name,
            judge=shown("mAh"),
            meaning=f"the charge of a {stage} battery; 0 is none",
        )
        for name, stage in (("BATT_LOW_MAH", "low"), ("BATT_CRT_MAH", "critical"))
    ),
    Rule(
        parameter="RTL_ALT_M",
        judge=shown("m"),
        meaning="the height above home to which every return climbs first",
        unknown=Level.NOTE,
    ),
    Rule(
        parameter="LAND_SPD_MS",
        judge=landing_speed(_LANDING_MPS),
        meaning="the speed of ArduPilot's landing",
        remedy="set 0.5, or land with more charge",
        advised=0.5,
    ),
    *speed_limits("ArduPilot", ("WP_SPD", "WP_SPD_UP", "WP_SPD_DN"), unknown=Level.NOTE),
    *follows_setpoints("ArduPilot", (("WP_ACC", "level"), ("WP_ACC_Z", "up and down"))),
    *(
        Rule(
            parameter=name,
            judge=switch(off=Level.NOTE),
            meaning="drag for ArduPilot's wind estimate; without it the companion estimates it",
            unknown=Level.NOTE,
        )
        for name in _DRAG
    ),
)
"""In the order of the report."""

PROFILE = Profile(
    kind=ARDUPILOT,
    name=NAME,
    mav_autopilot=3,
    measured_releases=((4, 6),),
    newest_release=(4, 7),
    oldest_release=(4, 3),
    mode_name=_MODES.get,
    mode_enums={
        1: "PLANE_MODE",  # fixed wing
        **dict.fromkeys(range(19, 26), "PLANE_MODE"),  # VTOL
        10: "ROVER_MODE",
        11: "ROVER_MODE",  # boat
        12: "SUB_MODE",
    },
    is_own_mode=lambda custom_mode: custom_mode == _GUIDED,
    own_mode="GUIDED",
    own_mode_numbers=(_GUIDED, 0),
    land_mode="LAND",
    land_mode_numbers=(_LAND, 0),
    armed_in_mode_request=False,
    homeward_modes=frozenset({"RTL", "LAND", "BRAKE", "SMART_RTL", "AUTO_RTL", "AVOID_ADSB"}),
    follow_up_modes={},
    streams_by_itself=False,
    line_share=0.8,
    rates_hz={
        "BATTERY_STATUS": 1.0,
        "EKF_STATUS_REPORT": 2.0,
        "WIND": 2.0,
        "RAW_IMU": 2.0,
        "GPS_GLOBAL_ORIGIN": 0.2,
        "HEARTBEAT": 20.0,
    },
    integers_bytewise=False,
    rssi_max=255,
    channels_without_receiver=True,
    summary_is_battery_0=True,
    better_gnss_taken=False,
    gnss_switch="GPS_AUTO_SWITCH",
    gnss_switch_better=frozenset({1.0, 2.0}),  # the best one, or a mean in which it weighs more
    gnss_primary="GPS_PRIMARY",
    motor_range=("MOT_PWM_MIN", "MOT_PWM_MAX"),
    unused_pulse_us=0.0,
    failsafe_flies=False,
    failsafe_texts=_FAILSAFE_TEXTS,
    innovation_limit=0.8,  # FS_EKF_THRESH; above it the flags stay good
    to_local_ned=to_local_ned,
    projection_known=True,
    home_by_projection=True,
    # 4.6.3 (SITL): from the true position to the setpoint 1.0 m in calm air; in gusts the measured
    # tracking error counts.
    position_error_m=0.5,
    tracking_error_m=0.9,
    stray_s2=0.0,
    landing_mps=_LANDING_MPS,
    landed_hover_s=1.0,  # the motors stop after 3 s
    speed_parameters=("WP_SPD", "WP_SPD_UP", "WP_SPD_DN"),
    cells_parameter=None,
    capacity_parameter="BATT_CAPACITY",
    tilt_limits=("PSC_ANGLE_MAX", "ATC_ANGLE_MAX"),  # AC_PosControl: 0 means the second
    hover_thrust="MOT_THST_HOVER",
    parameters=ParameterTable((*_LOSS, *_FAILSAFES, *_FENCE, *_HOLDING, *_CHECKED)),
    loss_parameters=keys(_LOSS),
    read_loss=_loss,
    failsafe_parameters=keys(_FAILSAFES),
    read_failsafes=_actions,
    fence_parameters=keys(_FENCE),
    read_fence=_fence,
    rules=_RULES,
)

"""ArduCopter: its failsafe actions in GUIDED, by its parameters.

Sources: ArduCopter 4.6.3, `ArduCopter/events.cpp` (failsafe_radio_on_event,
failsafe_gcs_on_event, handle_battery_failsafe, failsafe_deadreckon_check, do_failsafe_action),
`ekf_check.cpp` (failsafe_ekf_event), `mode_rtl.cpp` (compute_return_target).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from .failsafe_actions import Action, FailsafeAction, Trigger

DEFAULTS = {
    "BATT_CAPACITY": 3300.0,
    "BATT_CRT_MAH": 0.0,
    "BATT_CRT_VOLT": 0.0,
    "BATT_FS_CRT_ACT": 0.0,
    "BATT_FS_LOW_ACT": 0.0,
    "BATT_LOW_MAH": 0.0,
    "BATT_LOW_VOLT": 10.5,
    "EK3_DRAG_BCOEF_X": 0.0,
    "EK3_DRAG_MCOEF": 0.0,
    "FS_DR_ENABLE": 2.0,
    "FS_EKF_ACTION": 1.0,
    "FS_GCS_ENABLE": 0.0,
    "FS_OPTIONS": 16.0,
    "FS_THR_ENABLE": 1.0,
    "RTL_ALT": 1500.0,
    "RTL_CLIMB_MIN": 0.0,
    "RTL_CONE_SLOPE": 3.0,
}
"""Parameters and their defaults in 4.6.3."""
_RC_IN_GUIDED = 1 << 2
"""Bit of FS_OPTIONS: GUIDED continues without the remote control. The GCS has no such bit."""
_ACTIONS = {
    0: Action.NONE,
    1: Action.LAND,
    2: Action.RETURN,
    3: Action.RETURN,
    4: Action.LAND,
    5: Action.FALL,
    6: Action.RETURN,
    7: Action.HOLD,
}
"""FailsafeAction: of the battery and of dead reckoning. A smart return (3, 4) counts as its
fallback: ArduPilot does not report if it has a path (SRTL_POINTS, a full buffer), and on that path
it cuts corners by SRTL_ACCURACY, 2 m."""
_RADIO = {
    0: Action.NONE,
    1: Action.RETURN,
    2: Action.RETURN,
    3: Action.LAND,
    4: Action.RETURN,
    5: Action.LAND,
    6: Action.RETURN,
    7: Action.HOLD,
}
"""FS_THR_ENABLE; any other value lands."""
_GROUND_STATION = {**_RADIO, 3: Action.RETURN, 4: Action.LAND}
"""FS_GCS_ENABLE; any other value returns."""
_DRIFT_M = 5.3
"""Drift after the loss of GPS until the estimator failsafe has landed; measured on 4.6.3."""
_ESTIMATOR = {2: Action.DRIFT}
"""FS_EKF_ACTION: ALT_HOLD keeps the height and drifts; any other value lands."""
_LEAST_HEIGHT_M = 0.3
"""Least height of a return, RTL_ALT_MIN."""
_LEAST_SLOPE = 0.5
"""Least slope of the cone, RTL_MIN_CONE_SLOPE: none below it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Return:
    """ArduPilot's return (no rally points, no terrain): up, level, down; heights above home."""

    altitude_m: float
    climb_m: float
    slope: float
    """Slope of the cone over home below which a near return stays."""

    @classmethod
    def of(cls, value: Mapping[str, float]) -> Return:
        """Return by the values of the parameters."""
        return cls(
            altitude_m=0.01 * value["RTL_ALT"],
            climb_m=0.01 * max(0.0, value["RTL_CLIMB_MIN"]),
            slope=value["RTL_CONE_SLOPE"],
        )

    def height_m(self, height_m: float, distance_m: float) -> float:
        """Height of the level part, from a height and a level distance to home."""
        least_m = max(_LEAST_HEIGHT_M, height_m + self.climb_m)
        top_m = max(self.altitude_m, least_m)
        if self.slope >= _LEAST_SLOPE:
            top_m = min(top_m, max(distance_m * self.slope, least_m))
        return top_m


def actions(value: Mapping[str, float]) -> Iterator[FailsafeAction]:
    """Yields ArduPilot's failsafe actions in GUIDED, by the values of all of DEFAULTS."""
    home = Return.of(value)
    capacity_mah = value["BATT_CAPACITY"]
    for trigger, stage in ((Trigger.LOW_BATTERY, "LOW"), (Trigger.CRITICAL_BATTERY, "CRT")):
        name, volts, left_mah = (f"BATT_FS_{stage}_ACT", f"BATT_{stage}_VOLT", f"BATT_{stage}_MAH")
        thresholds = value[volts] > 0.0 or value[left_mah] > 0.0
        yield FailsafeAction(
            trigger=trigger,
            action=_ACTIONS.get(int(value[name]), Action.NONE) if thresholds else Action.NONE,
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
            action=_RADIO.get(int(value["FS_THR_ENABLE"]), Action.LAND),
            setting=f"FS_THR_ENABLE {value['FS_THR_ENABLE']:g}",
            remedy=f"FS_OPTIONS {int(value['FS_OPTIONS']) | _RC_IN_GUIDED}, "
            "or FS_THR_ENABLE 7 (brake)",
            home=home,
        )
    yield FailsafeAction(
        trigger=Trigger.GCS_LOSS,
        action=_GROUND_STATION.get(int(value["FS_GCS_ENABLE"]), Action.RETURN),
        setting=f"FS_GCS_ENABLE {value['FS_GCS_ENABLE']:g}",
        remedy="FS_GCS_ENABLE 7 (brake)",
        home=home,
    )
    if value["EK3_DRAG_BCOEF_X"] > 0.0 or value["EK3_DRAG_MCOEF"] > 0.0:
        # Dead reckoning needs a wind estimate, which a copter has only by its drag.
        yield FailsafeAction(
            trigger=Trigger.GPS_LOSS,
            action=_ACTIONS.get(int(value["FS_DR_ENABLE"]), Action.NONE),
            setting=f"FS_DR_ENABLE {value['FS_DR_ENABLE']:g}",
            remedy="FS_DR_ENABLE 0",
            home=home,
        )
    down = _ESTIMATOR.get(int(value["FS_EKF_ACTION"]), Action.DESCEND)
    yield FailsafeAction(
        trigger=Trigger.GPS_LOSS,
        action=down,
        setting=f"FS_EKF_ACTION {value['FS_EKF_ACTION']:g}",
        drift_m=_DRIFT_M,
    )
    yield FailsafeAction(trigger=Trigger.COMPANION_LOSS, action=Action.HOLD, setting="GUID_TIMEOUT")

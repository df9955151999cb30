"""Rules by which `check` judges ArduCopter's parameters that decide its reaction to failures.

Sources: ArduCopter 4.6, "Failsafes" and the parameters' descriptions; its reaction to a companion
failure, as measured.
"""

from __future__ import annotations

from .parameter_rules import (
    CLIMBING,
    FALLING,
    UNTIL_IT_FALLS,
    Case,
    Judge,
    Level,
    Rule,
    Verdict,
    bits,
    cell_voltage,
    choice,
    excepted,
    excepts_us,
    follows_setpoints,
    shown,
    speed_limits,
    switch,
    time_on_last_setpoint,
    where_zero,
)


def _variance(value: float, _: Case) -> Verdict:
    if value <= 0.0:
        return Level.NO_GO, f"{value:g} (off)"
    return (Level.OK if value <= 1.0 else Level.WARNING), f"{value:g}"


_BACK = "smart return on the flown path, or land"
_PERHAPS_BACK = f"smart return, or {CLIMBING}"
_LINK_LOSS = {
    1: (Level.WARNING, CLIMBING),
    5: (Level.OK, "land"),
    6: (Level.WARNING, f"landing sequence, or {CLIMBING}"),
    7: (Level.OK, "brake, or land"),
}
_BATTERY = {
    1: (Level.OK, "land"),
    2: (Level.NOTE, CLIMBING),
    3: (Level.NOTE, _PERHAPS_BACK),
    4: (Level.OK, _BACK),
    5: (Level.NO_GO, FALLING),
    6: (Level.NOTE, f"landing sequence, or {CLIMBING}"),
    7: (Level.OK, "brake, or land"),
}


def _where_it_happens(judge: Judge, stage: str) -> Judge:
    """Warns if a battery stage has no threshold: its action has no effect."""
    return where_zero(
        judge,
        (f"BATT_{stage}_VOLT", f"BATT_{stage}_MAH"),
        lambda level: max(level, Level.WARNING),
        "without effect",
    )


RULES = (
    Rule(
        parameter="GUID_TIMEOUT",
        judge=time_on_last_setpoint,
        meaning="time for which ArduPilot follows the last setpoint after a companion failure",
        remedy="set 0.5",
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
        unknown=Level.NO_GO,
    ),
    excepts_us("FS_OPTIONS", "remote control", "GUIDED"),
    Rule(
        parameter="FS_THR_ENABLE",
        judge=excepted(
            choice(
                {
                    **_LINK_LOSS,
                    0: (Level.WARNING, "nothing"),
                    2: (Level.WARNING, CLIMBING),
                    3: (Level.OK, "land"),
                    4: (Level.WARNING, _PERHAPS_BACK),
                    5: (Level.OK, _BACK),
                }
            ),
            ("FS_OPTIONS", 2),
            "not in GUIDED",
        ),
        meaning="ArduPilot's action when the remote control is lost",
        remedy="set 3 (land) or 7 (brake, or land)",
    ),
    Rule(
        parameter="FS_GCS_ENABLE",
        judge=choice(
            {
                **_LINK_LOSS,
                0: (Level.OK, "nothing"),
                2: (Level.WARNING, CLIMBING),
                3: (Level.WARNING, _PERHAPS_BACK),
                4: (Level.OK, _BACK),
            }
        ),
        meaning="ArduPilot's action when the ground station is lost",
        remedy="set 5 (land), 7 (brake, or land) or 0 (nothing)",
    ),
    Rule(
        parameter="FS_EKF_ACTION",
        judge=choice(
            {
                0: (Level.NO_GO, "a report only"),
                1: (Level.OK, "land"),
                2: (Level.WARNING, "altitude hold, which drifts with the wind"),
                3: (Level.OK, "land"),
            }
        ),
        meaning="ArduPilot's action when its position is lost",
        remedy="set 1 (land)",
        unknown=Level.NO_GO,
    ),
    Rule(
        parameter="FS_EKF_THRESH",
        judge=_variance,
        meaning="variance of the estimator at which that action starts",
        remedy="set 0.8",
        unknown=Level.NO_GO,
    ),
    Rule(
        parameter="FS_DR_ENABLE",
        judge=choice(
            {
                0: (Level.WARNING, "nothing, ArduPilot flies on for FS_DR_TIMEOUT"),
                1: (Level.OK, "land"),
                2: (Level.WARNING, CLIMBING),
                3: (Level.WARNING, _PERHAPS_BACK),
                4: (Level.OK, _BACK),
                6: _LINK_LOSS[6],
            }
        ),
        meaning="ArduPilot's action with GPS lost, when its position estimate uses the wind alone",
        remedy="set 1 (land)",
    ),
    Rule(
        parameter="FENCE_ENABLE",
        judge=bits(1, clear=(Level.OK, "off"), is_set=(Level.OK, "on")),
        meaning="ArduPilot's fence",
    ),
    Rule(
        parameter="FENCE_ACTION",
        judge=where_zero(
            choice(
                {
                    0: (Level.OK, "a report only"),
                    1: (Level.WARNING, CLIMBING),
                    2: (Level.OK, "land"),
                    3: (Level.WARNING, _PERHAPS_BACK),
                    4: (Level.OK, "brake, or land"),
                    5: (Level.OK, _BACK),
                }
            ),
            ("FENCE_ENABLE",),
            lambda level: min(level, Level.NOTE),
            "once the fence is on",
        ),
        meaning="ArduPilot's action at its fence",
        remedy="set 4 (brake, or land)",
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
        judge=_where_it_happens(choice({**_BATTERY, 0: (Level.NOTE, "nothing")}), "LOW"),
        meaning="ArduPilot's action on a low battery",
        remedy="set 1 (land) or 0 (nothing), and BATT_LOW_VOLT or BATT_LOW_MAH",
        unknown=Level.NO_GO,
    ),
    Rule(
        parameter="BATT_FS_CRT_ACT",
        judge=_where_it_happens(
            choice({**_BATTERY, 0: (Level.NOTE, f"nothing: {UNTIL_IT_FALLS}")}),
            "CRT",
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
    ),
    Rule(
        parameter="BATT_CRT_VOLT",
        judge=cell_voltage(3.1),
        meaning="the voltage of a critical battery",
        remedy="set 3.3 V a cell",
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
        parameter="RTL_ALT",
        judge=shown("m", scale=0.01),
        meaning="the height above home to which every return climbs first",
        unknown=Level.NOTE,
    ),
    *speed_limits(
        "ArduPilot",
        ("WPNAV_SPEED", "WPNAV_SPEED_UP", "WPNAV_SPEED_DN"),
        scale=0.01,
        unknown=Level.NOTE,
    ),
    *follows_setpoints(
        "ArduPilot", (("WPNAV_ACCEL", "level"), ("WPNAV_ACCEL_Z", "up and down")), 0.01
    ),
    *(
        Rule(
            parameter=name,
            judge=switch(off=Level.NOTE),
            meaning="drag for ArduPilot's wind estimate; without it the companion estimates it",
            unknown=Level.NOTE,
        )
        for name in ("EK3_DRAG_BCOEF_X", "EK3_DRAG_BCOEF_Y", "EK3_DRAG_MCOEF")
    ),
)
"""In the order of the report."""

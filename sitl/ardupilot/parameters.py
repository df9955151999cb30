"""Simulated parameters of ArduPilot.

Values travel as their number. Names, types and defaults read from ArduCopter 4.6.3; GPS and radio
are healthy by default in its simulation, and so they are here. Names and units from 4.7 on: as
ArduPilot's page "Parameter Name Changes" and the conversion tables of its source have them; 4.7.1
changed two of them again.
"""

from collections.abc import Mapping
from functools import partial
from operator import mul
from typing import Final

from sitl import sim_parameters
from sitl.parameters import INT8, INT16, INT32, REAL32, Firmware, Parameter, Parameters

USES_GPS_AFTER_S: Final = 41.6
"""From a start to "EKF3 is using GPS", as measured."""
_ARDUPILOT: Final[dict[int, dict[str, float]]] = {
    REAL32: {
        "ATC_SLEW_YAW": 6000.0, "BATT_ARM_VOLT": 0.0, "BATT_CRT_MAH": 0.0, "BATT_CRT_VOLT": 0.0,
        "BATT_LOW_MAH": 0.0, "BATT_LOW_VOLT": 10.5, "EK3_DRAG_BCOEF_X": 0.0,
        "EK3_DRAG_BCOEF_Y": 0.0, "EK3_DRAG_MCOEF": 0.0, "EK3_DRAG_M_NSE": 0.5,
        "FENCE_ALT_MAX": 100.0, "FENCE_ALT_MIN": -10.0, "FENCE_MARGIN": 2.0,
        "FENCE_RADIUS": 300.0, "FS_EKF_THRESH": 0.8,
        "FS_DR_TIMEOUT": 30.0, "FS_GCS_TIMEOUT": 5.0, "GUID_TIMEOUT": 3.0, "INS_ACCOFFS_X": 0.001,
        "LOIT_ACC_MAX": 500.0, "LOIT_ANG_MAX": 0.0, "LOIT_BRK_ACCEL": 250.0,
        "LOIT_BRK_DELAY": 1.0, "LOIT_SPEED": 1250.0, "MOT_SPIN_ARM": 0.1, "MOT_SPIN_MAX": 0.95,
        "MOT_SPIN_MIN": 0.15, "MOT_SPOOL_TIME": 0.5, "MOT_THST_EXPO": 0.65,
        "MOT_THST_HOVER": 0.39, "PILOT_Y_RATE": 202.5, "PSC_ANGLE_MAX": 0.0,
        "PSC_JERK_XY": 5.0, "PSC_JERK_Z": 5.0,
        "PSC_POSXY_P": 1.0, "PSC_POSZ_P": 1.0, "PSC_VELXY_D": 0.25, "PSC_VELXY_I": 1.0,
        "PSC_VELXY_P": 2.0, "PSC_VELZ_P": 5.0, "RC_OVERRIDE_TIME": 3.0, "RTL_CONE_SLOPE": 3.0,
        "WPNAV_ACCEL": 250.0, "WPNAV_ACCEL_Z": 100.0, "WPNAV_JERK": 1.0, "WPNAV_SPEED": 1000.0,
        "WPNAV_SPEED_DN": 150.0, "WPNAV_SPEED_UP": 250.0,
    },
    INT32: {
        "ARMING_CHECK": 1, "BATT_CAPACITY": 3300, "BATT_SERIAL_NUM": -1, "FS_OPTIONS": 16,
        "GUID_OPTIONS": 0, "RTL_ALT": 1500, "RTL_LOIT_TIME": 5000, "SERIAL1_BAUD": 57,
        "STAT_FLTTIME": 0, "STAT_RUNTIME": 61,
    },
    INT16: {
        "ANGLE_MAX": 3000, "FENCE_OPTIONS": 0, "FORMAT_VERSION": 120, "FS_THR_VALUE": 975,
        "LAND_ALT_LOW": 1000,
        "LAND_SPEED": 50, "LAND_SPEED_HIGH": 0, "MOT_PWM_MAX": 2000, "MOT_PWM_MIN": 1000,
        "PILOT_ACCEL_Z": 250, "PILOT_SPEED_DN": 0, "PILOT_SPEED_UP": 250, "RC3_MAX": 2000,
        "RC3_MIN": 1000, "RTL_ALT_FINAL": 0, "RTL_CLIMB_MIN": 0, "RTL_SPEED": 0,
        "SERVO1_FUNCTION": 33,
        "SERVO2_FUNCTION": 34, "SERVO3_FUNCTION": 35, "SERVO4_FUNCTION": 36, "SR1_EXTRA1": 0,
        "SYSID_MYGCS": 255, "SYSID_THISMAV": 1,
    },
    INT8: {
        "BATT_FS_CRT_ACT": 0, "BATT_FS_LOW_ACT": 0, "BATT_FS_VOLTSRC": 0, "BATT_LOW_TIMER": 10,
        "BATT_MONITOR": 4, "DISARM_DELAY": 10, "EK3_ENABLE": 1, "EK3_SRC1_POSXY": 3,
        "EK3_SRC1_VELXY": 3, "FENCE_ACTION": 1, "FENCE_AUTOENABLE": 0, "FENCE_ENABLE": 0,
        "FENCE_TYPE": 7, "FLTMODE1": 7, "FLTMODE2": 9,
        "FLTMODE3": 6, "FLTMODE4": 3, "FLTMODE5": 5, "FLTMODE6": 0, "FLTMODE_CH": 5,
        "FRAME_CLASS": 1, "FRAME_TYPE": 0, "FS_DR_ENABLE": 2, "FS_EKF_ACTION": 1,
        "FS_GCS_ENABLE": 0,
        "FS_THR_ENABLE": 1, "GPS1_TYPE": 1, "RSSI_TYPE": 0, "SERIAL1_PROTOCOL": 2,
        "SYSID_ENFORCE": 0, "TELEM_DELAY": 0, "WP_YAW_BEHAVIOR": 2,
    },
}  # fmt: skip
_SIMULATION: Final = (
    Parameter(name="SIM_BOOT_S", default=USES_GPS_AFTER_S, minimum=8.0, maximum=600.0),
    Parameter(name="SIM_RC_FAIL", default=0, type=INT8, minimum=0, maximum=1),
)
"""SIM_BOOT_S is the time from the next start until GPS is used; SIM_RC_FAIL 1 stops the RC."""


FIRMWARE: Final = (4, 6, 3)
_4_7: Final = (4, 7, 0)
_4_7_1: Final = (4, 7, 1)
_SAME: Final = 1.0
_CENTI: Final = 100.0
_RENAMED: Final[dict[str, tuple[str, float]]] = {
    "ANGLE_MAX": ("ATC_ANGLE_MAX", _CENTI), "ATC_SLEW_YAW": ("ATC_RATE_WPY_MAX", _CENTI),
    "LAND_ALT_LOW": ("LAND_ALT_LOW_M", _CENTI), "LAND_SPEED": ("LAND_SPD_MS", _CENTI),
    "LAND_SPEED_HIGH": ("LAND_SPD_HIGH_MS", _CENTI), "LOIT_ACC_MAX": ("LOIT_ACC_MAX_M", _CENTI),
    "LOIT_BRK_ACCEL": ("LOIT_BRK_ACC_M", _CENTI), "LOIT_SPEED": ("LOIT_SPEED_MS", _CENTI),
    "PILOT_ACCEL_Z": ("PILOT_ACC_Z", _CENTI), "PILOT_SPEED_DN": ("PILOT_SPD_DN", _CENTI),
    "PILOT_SPEED_UP": ("PILOT_SPD_UP", _CENTI), "PSC_JERK_XY": ("PSC_JERK_NE", _SAME),
    "PSC_JERK_Z": ("PSC_JERK_D", _SAME), "PSC_POSXY_P": ("PSC_NE_POS_P", _SAME),
    "PSC_POSZ_P": ("PSC_D_POS_P", _SAME), "PSC_VELXY_D": ("PSC_NE_VEL_D", _SAME),
    "PSC_VELXY_I": ("PSC_NE_VEL_I", _SAME), "PSC_VELXY_P": ("PSC_NE_VEL_P", _SAME),
    "PSC_VELZ_P": ("PSC_D_VEL_P", _SAME), "RTL_ALT": ("RTL_ALT_M", _CENTI),
    "RTL_ALT_FINAL": ("RTL_ALT_FINAL_M", _CENTI), "RTL_CLIMB_MIN": ("RTL_CLIMB_MIN_M", _CENTI),
    "RTL_SPEED": ("RTL_SPEED_MS", _CENTI), "SR1_EXTRA1": ("MAV2_EXTRA1", _SAME),
    "SYSID_ENFORCE": ("MAV_OPTIONS", _SAME), "SYSID_MYGCS": ("MAV_GCS_SYSID", _SAME),
    "SYSID_THISMAV": ("MAV_SYSID", _SAME), "TELEM_DELAY": ("MAV_TELEM_DELAY", _SAME),
    "WPNAV_ACCEL": ("WP_ACC", _CENTI), "WPNAV_ACCEL_Z": ("WP_ACC_Z", _CENTI),
    "WPNAV_JERK": ("WP_JERK", _SAME), "WPNAV_SPEED": ("WP_SPD", _CENTI),
    "WPNAV_SPEED_DN": ("WP_SPD_DN", _CENTI), "WPNAV_SPEED_UP": ("WP_SPD_UP", _CENTI),
}  # fmt: skip
"""Name from 4.7 on, and the number of the old units in its unit."""
_RENAMED_4_7_1: Final = {
    "PSC_JERK_XY": ("PSC_NE_JERK", _SAME), "PSC_JERK_Z": ("PSC_D_JERK", _SAME),
}  # fmt: skip


def parameters(values: Mapping[str, float], firmware: Firmware = FIRMWARE) -> Parameters:
    """Return ArduPilot's parameters by the names of a firmware, some of them replaced."""
    renamed = dict(_RENAMED if firmware >= _4_7 else {})
    renamed.update(_RENAMED_4_7_1 if firmware >= _4_7_1 else {})
    table = [Parameter(name="FENCE_MARGIN_XY", default=0.0)] if firmware >= _4_7 else []
    for kind, defaults in _ARDUPILOT.items():
        for name, default in defaults.items():
            called, unit = renamed.get(name, (name, _SAME))
            table.append(
                Parameter(
                    name=called, default=default / unit, type=kind if unit == _SAME else REAL32
                )
            )
    return Parameters(
        [*table, *_SIMULATION, *sim_parameters.TABLE],
        values,
        bytewise=False,
        firmware=firmware,
        renamed={name: (called, partial(mul, unit)) for name, (called, unit) in renamed.items()},
    )

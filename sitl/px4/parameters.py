"""Simulated parameters of PX4.

Values travel in PX4's bytewise encoding. Defaults read from PX4 v1.17.0, except MAV_1_FORWARD: both
links of its simulation forward, while the second telemetry port of a real board (value 0) does not.
"""

from collections.abc import Mapping
from typing import Final

from sitl import sim_parameters
from sitl.parameters import INT32, REAL32, Firmware, Parameter, Parameters, Read

_PX4: Final[dict[str, float]] = {
    "BAT1_CAPACITY": -1.0, "BAT1_N_CELLS": 4, "BAT1_R_INTERNAL": -1.0, "BAT1_SOURCE": 0,
    "BAT1_V_CHARGED": 4.05, "BAT1_V_EMPTY": 3.6, "BAT_AVRG_CURRENT": 15.0,
    "BAT_CRIT_THR": 0.07, "BAT_EMERGEN_THR": 0.05, "BAT_LOW_THR": 0.15,
    "CAL_ACC0_ID": 1310988, "CAL_BARO0_ID": 6620172, "CAL_GYRO0_ID": 1310988,
    "CAL_MAG0_ID": 197388, "CBRK_FLIGHTTERM": 121212, "CBRK_IO_SAFETY": 22027,
    "CBRK_SUPPLY_CHK": 0, "CBRK_USB_CHK": 197848, "COM_ARM_WO_GPS": 1,
    "COM_DISARM_LAND": 2.0, "COM_DISARM_PRFLT": 10.0, "COM_DLL_EXCEPT": 0,
    "COM_DL_LOSS_T": 10,
    "COM_FAIL_ACT_T": 5.0, "COM_LOW_BAT_ACT": 3, "COM_OBC_LOSS_T": 5.0,
    "COM_OBL_RC_ACT": 0, "COM_OF_LOSS_T": 1.0,
    "COM_POS_FS_EPH": 5.0, "COM_RC_IN_MODE": 1, "COM_RC_LOSS_T": 0.5, "COM_RC_OVERRIDE": 1,
    "COM_RCL_EXCEPT": 0, "COM_RC_STICK_OV": 30.0, "COM_SPOOLUP_TIME": 1.0, "COM_TAKEOFF_ACT": 0,
    "COM_WIND_MAX": -1.0, "COM_WIND_WARN": -1.0, "EKF2_BCOEF_X": 100.0, "EKF2_BCOEF_Y": 100.0,
    "EKF2_DRAG_CTRL": 0, "EKF2_DRAG_NOISE": 2.5, "EKF2_GPS_CHECK": 2047, "EKF2_GPS_CTRL": 7,
    "EKF2_HGT_REF": 1, "EKF2_MCOEF": 0.15, "GF_ACTION": 2, "GF_MAX_HOR_DIST": 0.0,
    "GF_MAX_VER_DIST": 0.0, "GF_SOURCE": 0, "LNDMC_TRIG_TIME": 1.0, "LNDMC_XY_VEL_MAX": 1.5,
    "LNDMC_Z_VEL_MAX": 0.25, "MAV_0_FORWARD": 1, "MAV_1_FORWARD": 1, "MAV_COMP_ID": 1,
    "MAV_FWDEXTSP": 1, "MAV_PROTO_VER": 2, "MAV_SIK_RADIO_ID": 0, "MAV_SYS_ID": 1,
    "MAV_TYPE": 2, "MIS_TAKEOFF_ALT": 2.5, "MPC_ACC_DOWN_MAX": 3.0, "MPC_ACC_HOR": 3.0,
    "MPC_ACC_HOR_MAX": 5.0, "MPC_ACC_UP_MAX": 4.0, "MPC_LAND_ALT1": 10.0,
    "MPC_LAND_ALT2": 5.0, "MPC_LAND_ALT3": 1.0, "MPC_LAND_CRWL": 0.3, "MPC_LAND_SPEED": 0.7,
    "MPC_MAN_TILT_MAX": 35.0, "MPC_MAN_Y_MAX": 150.0, "MPC_THR_HOVER": 0.5,
    "MPC_THR_MAX": 1.0, "MPC_THR_MIN": 0.12, "MPC_TILTMAX_AIR": 45.0, "MPC_TILTMAX_LND": 12.0,
    "MPC_TKO_RAMP_T": 3.0, "MPC_TKO_SPEED": 1.5, "MPC_VEL_MANUAL": 10.0, "MPC_XY_CRUISE": 5.0,
    "MPC_XY_P": 0.95, "MPC_XY_TRAJ_P": 0.5, "MPC_XY_VEL_D_ACC": 0.2, "MPC_XY_VEL_I_ACC": 0.4,
    "MPC_XY_VEL_MAX": 12.0, "MPC_XY_VEL_P_ACC": 1.8, "MPC_Z_P": 1.0, "MPC_Z_VEL_I_ACC": 2.0,
    "MPC_Z_VEL_MAX_DN": 1.5, "MPC_Z_VEL_MAX_UP": 3.0, "MPC_Z_VEL_P_ACC": 4.0,
    "MPC_Z_V_AUTO_DN": 1.5, "MPC_Z_V_AUTO_UP": 3.0, "NAV_ACC_RAD": 2.0, "NAV_DLL_ACT": 0,
    "NAV_MC_ALT_RAD": 0.8, "NAV_RCL_ACT": 2, "RTL_CONE_ANG": 45, "RTL_DESCEND_ALT": 10.0,
    "RTL_LAND_DELAY": 0.0, "RTL_MIN_DIST": 10.0, "RTL_RETURN_ALT": 30.0, "RTL_TYPE": 0,
    "SYS_AUTOSTART": 10040, "SYS_HAS_GPS": 1,
}  # fmt: skip
_LIMITS: Final[dict[str, tuple[float, float]]] = {
    "COM_OF_LOSS_T": (0.0, 60.0),
    "COM_OBL_RC_ACT": (0, 8),
    "COM_LOW_BAT_ACT": (0, 3),
    "COM_RC_OVERRIDE": (0, 3),
    "EKF2_DRAG_CTRL": (0, 1),
    "MAV_0_FORWARD": (0, 1),
    "MAV_1_FORWARD": (0, 1),
}


FIRMWARE: Final = (1, 17, 0)
_1_18: Final = (1, 18, 0)
_OVERRIDES: Final = 3.0
_STICKS_1_18: Final[dict[str, Read]] = {
    "COM_RC_OVERRIDE": ("MAN_OVERRIDE_SPD", lambda speed: _OVERRIDES if speed >= 0.0 else 0.0),
    "COM_RC_STICK_OV": ("MAN_OVERRIDE_SPD", lambda _: _PX4["COM_RC_STICK_OV"]),
}
"""1.18 compares the speed of the sticks, and has one parameter for all modes; a negative one
switches the take-over off. The fake compares their deflection in every release."""


def parameters(values: Mapping[str, float], firmware: Firmware = FIRMWARE) -> Parameters:
    """Return PX4's parameters by the names of a firmware, some of them replaced."""
    renamed = _STICKS_1_18 if firmware >= _1_18 else {}
    table = [
        Parameter(
            name=name,
            default=default,
            type=INT32 if isinstance(default, int) else REAL32,
            minimum=low,
            maximum=high,
        )
        for name, default in _PX4.items()
        if name not in renamed
        for low, high in [_LIMITS.get(name, (-2147483648.0, 2147483647.0))]
    ]
    if renamed:
        table.append(Parameter(name="MAN_OVERRIDE_SPD", default=1.0, minimum=-1.0, maximum=10.0))
    return Parameters(
        [*table, *sim_parameters.TABLE],
        values,
        bytewise=True,
        firmware=firmware,
        renamed=renamed,
    )

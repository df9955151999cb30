"""PX4's parameters that matter here, and those of the simulation (SIM_...).

Values travel as PARAM_VALUE in PX4's bytewise encoding: an int32 is put into the float's bytes
unchanged. Defaults read from PX4 v1.17.0, but for MAV_1_FORWARD: both links of its simulation
forward, while the second telemetry port of a real board (value 0) does not.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

INT32: Final = 6
REAL32: Final = 9
NAME_LENGTH: Final = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Parameter:
    """One parameter: its type is that of its default."""

    name: str
    default: float
    minimum: float = -2147483648.0
    maximum: float = 2147483647.0

    @property
    def type(self) -> int:
        """MAV_PARAM_TYPE: INT32 or REAL32."""
        return INT32 if isinstance(self.default, int) else REAL32


_PX4: Final[dict[str, float]] = {
    "BAT1_CAPACITY": -1.0, "BAT1_N_CELLS": 4, "BAT1_R_INTERNAL": -1.0, "BAT1_SOURCE": 0,
    "BAT1_V_CHARGED": 4.05, "BAT1_V_EMPTY": 3.6, "BAT_AVRG_CURRENT": 15.0,
    "BAT_CRIT_THR": 0.07, "BAT_EMERGEN_THR": 0.05, "BAT_LOW_THR": 0.15,
    "CAL_ACC0_ID": 1310988, "CAL_BARO0_ID": 6620172, "CAL_GYRO0_ID": 1310988,
    "CAL_MAG0_ID": 197388, "CBRK_FLIGHTTERM": 121212, "CBRK_IO_SAFETY": 22027,
    "CBRK_SUPPLY_CHK": 0, "CBRK_USB_CHK": 197848, "COM_ARM_WO_GPS": 1,
    "COM_DISARM_LAND": 2.0, "COM_DISARM_PRFLT": 10.0, "COM_DL_LOSS_T": 10,
    "COM_FAIL_ACT_T": 5.0, "COM_LOW_BAT_ACT": 3, "COM_OBL_RC_ACT": 0, "COM_OF_LOSS_T": 1.0,
    "COM_POS_FS_EPH": 5.0, "COM_RC_IN_MODE": 1, "COM_RC_LOSS_T": 0.5, "COM_RC_OVERRIDE": 1,
    "COM_RC_STICK_OV": 30.0, "COM_SPOOLUP_TIME": 1.0, "COM_TAKEOFF_ACT": 0,
    "COM_WIND_MAX": -1.0, "COM_WIND_WARN": -1.0, "EKF2_BCOEF_X": 100.0, "EKF2_BCOEF_Y": 100.0,
    "EKF2_DRAG_CTRL": 0, "EKF2_DRAG_NOISE": 2.5, "EKF2_GPS_CHECK": 2047, "EKF2_GPS_CTRL": 7,
    "EKF2_HGT_REF": 1, "EKF2_MCOEF": 0.15, "GF_ACTION": 2, "GF_MAX_HOR_DIST": 0.0,
    "GF_MAX_VER_DIST": 0.0, "LNDMC_TRIG_TIME": 1.0, "LNDMC_XY_VEL_MAX": 1.5,
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
SIMULATION: Final = (
    Parameter(name="SIM_BATT_DRAIN", default=1.0, minimum=0.0, maximum=1000.0),
    Parameter(name="SIM_BATT_PCT", default=100.0, minimum=0.0, maximum=100.0),
    Parameter(name="SIM_GPS_HDOP", default=0.7, minimum=0.3, maximum=99.0),
    Parameter(name="SIM_GPS_MODE", default=0, minimum=0, maximum=2),
    Parameter(name="SIM_GPS_NOISE", default=1.0, minimum=0.0, maximum=100.0),
    Parameter(name="SIM_GPS_SATS", default=10, minimum=0, maximum=60),
    Parameter(name="SIM_LINK_LOSS", default=0.0, minimum=0.0, maximum=100.0),
    Parameter(name="SIM_LINK_NOISE", default=45.0, minimum=0.0, maximum=254.0),
    Parameter(name="SIM_LINK_RSSI", default=-1.0, minimum=-1.0, maximum=254.0),
    Parameter(name="SIM_WIND_DIR", default=0.0, minimum=-360.0, maximum=360.0),
    Parameter(name="SIM_WIND_GUST", default=0.0, minimum=0.0, maximum=20.0),
    Parameter(name="SIM_WIND_SPD", default=0.0, minimum=0.0, maximum=60.0),
)
"""SIM_WIND_DIR is where the wind comes from, degrees; SIM_LINK_RSSI -1 means no radio."""


class Parameters:
    """All parameters with their values, in PX4's (alphabetical) order."""

    def __init__(self, values: Mapping[str, float] | None = None) -> None:
        """Start from the defaults, some replaced."""
        table = [
            Parameter(name=name, default=default, minimum=low, maximum=high)
            for name, default in _PX4.items()
            for low, high in [_LIMITS.get(name, (-2147483648.0, 2147483647.0))]
        ]
        table.extend(SIMULATION)
        table.sort(key=lambda parameter: parameter.name)
        self.table = tuple(table)
        self.index = {parameter.name: i for i, parameter in enumerate(table)}
        self.values: dict[str, float] = {p.name: p.default for p in table}
        for name, value in (values or {}).items():
            self.set(name, value)

    def value(self, name: str) -> float:
        """Return a value; `KeyError` when there is no such parameter."""
        return self.values[name]

    def set(self, name: str, value: float) -> float:
        """Set a value, rounded for an integer; `KeyError` unknown, `ValueError` out of range."""
        parameter = self.table[self.index[name]]
        if not parameter.minimum <= value <= parameter.maximum:
            raise ValueError(
                f"{name}: {value:g} is not between {parameter.minimum:g} and {parameter.maximum:g}"
            )
        stored = round(value) if parameter.type == INT32 else float(value)
        self.values[name] = stored
        return stored

    def encoded(self, name: str) -> tuple[float, int]:
        """Return (param_value, param_type) as they travel."""
        return encode(self.values[name], self.table[self.index[name]].type)


def encode(value: float, param_type: int) -> tuple[float, int]:
    """Encode a value PX4's way; an int32 keeps its bytes inside the float."""
    if param_type == INT32:
        return struct.unpack("<f", struct.pack("<i", int(value)))[0], param_type
    return float(value), param_type


def decode(param_value: float, param_type: int) -> float:
    """Undo `encode`; types other than INT32 are taken as numbers."""
    if param_type == INT32:
        return int(struct.unpack("<i", struct.pack("<f", param_value))[0])
    return param_value

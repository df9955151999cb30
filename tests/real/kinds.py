"""The aircraft of the scenarios, and the parameters that cause trouble on each of them.

The user has built the real autopilots; an environment variable has the path of each. Trouble is
caused by parameters, as a ground station sets them; None where a simulator cannot do it.
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass
from pathlib import Path

BASE = {
    "px4": {
        "COM_OBL_RC_ACT": 5,
        "COM_OF_LOSS_T": 0.5,
        "COM_DL_LOSS_T": 10,
        "COM_RC_LOSS_T": 1.0,
        "COM_OBC_LOSS_T": 5.0,
        "COM_RC_OVERRIDE": 3,
        "NAV_RCL_ACT": 1,
    },
    "ardupilot": {"GUID_TIMEOUT": 0.5, "FS_THR_ENABLE": 7},
}
"""Parameters that the README requires before a flight.

PX4's three other timeouts are those of its startup script (init.d-posix/rcS) at speed 1; the script
multiplies them by the simulator's speed.
"""
LOW_PERCENT, CRITICAL_PERCENT = 13.0, 6.0
"""PX4 calls 15 % low and 7 % critical; ArduPilot by `battery_thresholds`."""
CROSSING_PERCENT = 0.5
"""ArduPilot acts on a threshold that is crossed, and BATTERY_RESET crosses none: 2 s of flight."""
VARIABLES = {
    "real-px4": "MOAR_PX4_BUILD",
    "real-ardupilot": "MOAR_ARDUPILOT_BINARY",
    "real-ardupilot-4.7": "MOAR_ARDUPILOT_47_BINARY",
}


@dataclass(frozen=True)
class Kind:
    """autopilot: "px4" or "ardupilot"; real: not the fake.

    release: firmware with other names of parameters than the first one flown; "" for that one.
    """

    autopilot: str
    real: bool
    release: str = ""

    @property
    def name(self):
        release = f"-{self.release}" if self.release else ""
        return f"{'real' if self.real else 'fake'}-{self.autopilot}{release}"

    @property
    def path(self):
        """Path of the real autopilot; None without one, or for a fake one."""
        text = os.environ.get(VARIABLES[self.name]) if self.real else None
        return Path(text).resolve() if text else None

    @property
    def missing(self):
        """Reason why this kind cannot be flown here; None if it can."""
        if self.real and self.path is None:
            return f"{VARIABLES[self.name]} is not set"
        return None

    def wind(self, speed_mps, from_deg):
        """Parameters of a wind; PX4's simulator has the vector towards which it blows."""
        if self.real and self.autopilot == "px4":
            towards = math.radians(from_deg + 180.0)
            return {
                "SIH_WIND_N": speed_mps * math.cos(towards),
                "SIH_WIND_E": speed_mps * math.sin(towards),
            }
        return {"SIM_WIND_DIR": from_deg, "SIM_WIND_SPD": speed_mps}

    def battery_thresholds(self, *, critical, acts=True):
        """Parameters before the flight that make `LOW_PERCENT` low, or `CRITICAL_PERCENT` critical.

        acts: True if the autopilot lands at critical.
        """
        if self.autopilot == "px4":
            return {"COM_LOW_BAT_ACT": 2 if acts else 0}
        return {
            "BATT_LOW_TIMER": 2,
            "BATT_FS_CRT_ACT": int(acts),
            "BATT_LOW_MAH": 429,
            "BATT_CRT_MAH": 198 if critical else 0,
        }

    def gps(self, found):
        """Parameters of a receiver with or without a fix."""
        if not self.real:
            return {"SIM_GPS_MODE": 0 if found else 1}
        if self.autopilot == "px4":
            return {"SIM_GPS_USED": 10 if found else 0}
        if self.release:
            return {"SIM_GPS1_ENABLE": int(found)}
        return {"SIM_GPS_DISABLE": 0 if found else 1}

    def gps_offset(self, north_deg, east_deg, up_m):
        """Parameters of a receiver that reports a place beside the true one (ArduPilot)."""
        name = "SIM_GPS1_GLTCH" if self.release else "SIM_GPS_GLITCH"
        return {f"{name}_X": north_deg, f"{name}_Y": east_deg, f"{name}_Z": up_m}


KINDS = {
    kind.name: kind
    for kind in (
        Kind("px4", real=False),
        Kind("ardupilot", real=False),
        Kind("px4", real=True),
        Kind("ardupilot", real=True),
        Kind("ardupilot", real=True, release="4.7"),
    )
}

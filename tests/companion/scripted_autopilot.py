"""An autopilot of a few scripted messages: it reports its attributes, at their usual rates.

All messages are raw pymavlink.
"""

from __future__ import annotations

import math

from pymavlink.dialects.v20 import all as mavlink

from moar_companion.mavlink.autopilots import kind_of, profile

from ..mavlink.peer import Peer

POSCTL, OFFBOARD, AUTO_HOLD, AUTO_RTL = 0x00030000, 0x00060000, 0x03040000, 0x05040000
GUIDED, LOITER, RTL, BRAKE = 4, 5, 6, 17
"""ArduCopter's."""
STANDBY, ACTIVE, CRITICAL = 3, 4, 5
ARMED, DISARMED = 209, 81
PARAMETERS = {
    "COM_OBL_RC_ACT": 5.0,
    "FENCE_ACTION": 1.0,
    "FENCE_ALT_MAX": 100.0,
    "FENCE_ALT_MIN": -10.0,
    "FENCE_AUTOENABLE": 0.0,
    "FENCE_ENABLE": 0.0,
    "FENCE_MARGIN": 2.0,
    "FENCE_OPTIONS": 0.0,
    "FENCE_RADIUS": 300.0,
    "FENCE_TYPE": 7.0,
    "GF_ACTION": 2.0,
    "GF_MAX_HOR_DIST": 0.0,
    "GF_MAX_VER_DIST": 0.0,
    "GF_SOURCE": 0.0,
    "GUID_TIMEOUT": 0.5,
    "MPC_ACC_HOR": 3.0,
    "MPC_XY_P": 0.95,
    "MPC_Z_P": 1.0,
    "NAV_ACC_RAD": 2.0,
    "NAV_RCL_ACT": 2.0,
    "PSC_JERK_XY": 5.0,
    "PSC_JERK_Z": 5.0,
    "RTL_CONE_ANG": 45.0,
    "RTL_MIN_DIST": 10.0,
    "RTL_RETURN_ALT": 30.0,
    "RTL_TYPE": 0.0,
    "WPNAV_ACCEL": 250.0,
    "WPNAV_ACCEL_Z": 100.0,
}
"""Parameters of the autopilot: as the manual asks for, else as by default."""


def _defaults(known):
    """Defaults of all parameters of a flight, as the measured release names them."""
    names = {
        key: known.parameters.names(key, known.assumed_release)[0]
        for key in known.flight_parameters
    }
    defaults = known.parameters.defaults
    return {name.name: defaults[key] / name.scale for key, name in names.items()}


class ScriptedAutopilot:
    """State of an autopilot as it reports it; a test changes it by its attributes."""

    def __init__(self, autopilot, *, origin, position_ned_m, wind_mps=None, fence_items=0):
        self.autopilot, self.origin = Peer(1, 1), origin
        self.position_ned_m = position_ned_m
        self.kind, self.vehicle_type = autopilot, mavlink.MAV_TYPE_QUADROTOR
        px4 = autopilot == mavlink.MAV_AUTOPILOT_PX4
        self.ours = OFFBOARD if px4 else GUIDED
        self.mode, self.system_status = AUTO_HOLD if px4 else LOITER, ACTIVE
        self.velocity_ned_mps = (0.0, 0.0, 0.0)
        """As the autopilot reports it."""
        self.yaw_rad, self.yaw_rate_radps = 0.3, 0.0
        """Progress likewise: the nose does not follow the setpoints."""
        self.armed, self.landed_state = True, 2
        self.estimate_off_ned_m = (0.0, 0.0, 0.0)
        """Distance of the estimator's frame from the one in which `position_ned_m` is."""
        self.behind_ned_m = (0.0, 0.0, 0.0)
        """Offset of the aircraft from its setpoint."""
        self.boot_s = 100.0
        self.reset_counter = None
        """Reset counter of ODOMETRY; None where the autopilot sends none."""
        self.position_boot_s = None
        """Frozen clock of LOCAL_POSITION_NED; None while the clock runs."""
        self.parameters = {**_defaults(profile(kind_of(autopilot))), **PARAMETERS}
        self.fence_items = fence_items
        """Number of fence items that the autopilot reports; it sends none."""
        self.battery_percent, self.charge_state = 90, 1
        self.fix_type, self.receiver_accuracy_m = 3, 0.9
        self.accuracy_m, self.wind_mps = None, wind_mps
        """Accuracy of the estimator, and wind; None where the autopilot does not report them."""
        self.height_accuracy_m = 0.3
        """Height accuracy of the estimator, reported with the other."""
        self.late_s = 0.0
        """Transmission delay of the autopilot's packets."""
        self.mute = set()
        """Types of messages that the autopilot does not send."""
        self._count = 0

    def set(self, **changes):
        """Changes the autopilot's reports from now on."""
        for name, value in changes.items():
            assert hasattr(self, name), name
            setattr(self, name, value)
        return self

    def set_ours(self, key, value):
        """Sets a parameter by its key and in our unit, before it is reported."""
        known = profile(kind_of(self.kind))
        name = known.parameters.names(key, known.assumed_release)[0]
        self.parameters[name.name] = value / name.scale

    def _autopilot_messages(self):
        boot_ms = round(self.boot_s * 1000)
        said = []
        if self._count % 50 == 0:
            said.append(self._heartbeat())
            latitude, longitude, altitude = self.origin
            said.append(
                mavlink.MAVLink_gps_global_origin_message(
                    round(latitude * 1e7), round(longitude * 1e7), round(altitude * 1e3)
                )
            )
            said += self._status_messages()
        if self._count % 10 == 0:
            said.append(mavlink.MAVLink_extended_sys_state_message(0, self.landed_state))
        if self._count % 2 == 0:
            said.append(
                mavlink.MAVLink_attitude_message(
                    boot_ms, 0, 0, self.yaw_rad, 0, 0, self.yaw_rate_radps
                )
            )
            position_boot_s = self.boot_s if self.position_boot_s is None else self.position_boot_s
            estimate = map(sum, zip(self.position_ned_m, self.estimate_off_ned_m, strict=True))
            said.append(
                mavlink.MAVLink_local_position_ned_message(
                    round(position_boot_s * 1000), *estimate, *self.velocity_ned_mps
                )
            )
            if self.reset_counter is not None:
                said.append(self._odometry())
        return [
            self.autopilot.pack(message) for message in said if message.get_type() not in self.mute
        ]

    def _heartbeat(self):
        return mavlink.MAVLink_heartbeat_message(
            self.vehicle_type,
            self.kind,
            ARMED if self.armed else DISARMED,
            self.mode,
            self.system_status,
            3,
        )

    def _odometry(self):
        """ODOMETRY as PX4 fills it, without the pose, which the tests do not read."""
        unknown = [math.nan] * 21
        return mavlink.MAVLink_odometry_message(
            round(self.boot_s * 1e6),
            *(1, 1),
            *(0.0, 0.0, 0.0),
            [1.0, 0.0, 0.0, 0.0],
            *(0.0,) * 6,
            unknown,
            unknown,
            self.reset_counter,
            8,
        )

    def _status_messages(self):
        """Messages of receiver, estimator, battery and ground station, with the test's values."""
        said = [
            mavlink.MAVLink_gps_raw_int_message(
                round(self.boot_s * 1e6),
                self.fix_type,
                0,
                0,
                0,
                90,
                150,
                0,
                0,
                12,
                0,
                round(self.receiver_accuracy_m * 1000),
                1500,
            ),
            mavlink.MAVLink_battery_status_message(
                0,
                0,
                0,
                0,
                [16000, *[65535] * 9],
                -1,
                -1,
                -1,
                self.battery_percent,
                charge_state=self.charge_state,
            ),
        ]
        if self.accuracy_m is not None:
            zeros = (0.1,) * 6
            said.append(
                mavlink.MAVLink_estimator_status_message(
                    round(self.boot_s * 1e6),
                    0x37F,
                    *zeros,
                    self.accuracy_m,
                    self.height_accuracy_m,
                )
            )
        if self.wind_mps is not None:
            zeros = (0.0,) * 5
            said.append(
                mavlink.MAVLink_wind_cov_message(
                    round(self.boot_s * 1e6), self.wind_mps, 0.0, 0.0, *zeros
                )
            )
        return said

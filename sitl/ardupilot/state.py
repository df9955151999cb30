"""Inputs of the telemetry of an ArduPilot vehicle, beside the world itself."""

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True, kw_only=True)
class GuidedTarget:
    """Target of GUIDED, as POSITION_TARGET_LOCAL_NED shows it; None where it is not used.

    position_ned_m    (3,)  metres from the EKF origin
    velocity_ned_mps  (3,)
    """

    position_ned_m: tuple[float, float, float] | None
    velocity_ned_mps: tuple[float, float, float] | None
    yaw_rad: float | None


class State(Protocol):
    """The vehicle's own estimates and decisions."""

    @property
    def armed(self) -> bool:
        """True when the motors may turn."""

    @property
    def custom_mode(self) -> int:
        """ArduCopter's number of the flight mode."""

    @property
    def system_status(self) -> int:
        """MAV_STATE: 1 boot, 3 standby, 4 active, 5 critical (a failsafe acts)."""

    @property
    def landed_state(self) -> int:
        """MAV_LANDED_STATE."""

    @property
    def guided_target(self) -> GuidedTarget | None:
        """The target in use; None when the mode is not GUIDED."""

    @property
    def desired_attitude_rad(self) -> tuple[float, float, float]:
        """Roll, pitch, yaw that the attitude control works towards."""

    @property
    def ekf_flags(self) -> int:
        """EKF_STATUS_REPORT.flags."""

    @property
    def position_known(self) -> bool:
        """True while the estimator has a position: LOCAL_POSITION_NED and WIND flow."""

    @property
    def position_ned_m(self) -> tuple[float, float, float]:
        """The estimate, metres from the EKF origin, in ArduPilot's own projection."""

    @property
    def origin(self) -> tuple[float, float, float] | None:
        """The EKF origin: latitude and longitude in degrees, altitude AMSL in metres."""

    @property
    def home(self) -> tuple[float, float, float] | None:
        """Home, as the origin is given; None until it is set."""

    @property
    def wind_from(self) -> tuple[float, float] | None:
        """The estimated wind: speed in m/s, direction in degrees it comes from; None unknown."""

    @property
    def battery_charge_state(self) -> int:
        """MAV_BATTERY_CHARGE_STATE: 1 ok, 2 low, 3 critical."""

    @property
    def battery_consumed_mah(self) -> float:
        """Charge that the monitor has counted; battery_remaining is 1 - this / BATT_CAPACITY."""

    @property
    def battery_consumed_wh(self) -> float:
        """The energy that the monitor has counted."""

    @property
    def ready_to_arm(self) -> bool:
        """True when the pre-arm checks of the present mode pass."""

    @property
    def fence_enabled(self) -> bool:
        """True if there is a fence."""

    @property
    def fence_breached(self) -> bool:
        """True if the vehicle is outside its fence."""

    @property
    def channels_us(self) -> tuple[int, ...]:
        """The eight channels of the remote control; the last ones while it is lost."""

    @property
    def remote_control_lost(self) -> bool:
        """True if the receiver was received before and is silent now."""

    @property
    def rssi(self) -> int:
        """RC_CHANNELS.rssi, 255 unknown."""

    @property
    def return_place(self) -> tuple[float, float, float] | None:
        """Target of RTL, as the origin is given; None in other modes and during the landing."""

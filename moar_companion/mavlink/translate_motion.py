"""Position, attitude and wind of the aircraft: messages to `Telemetry`. Pure.

Part of `translate`, which names the sources.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from ..types import GeodeticPoint, Vector
from .dialect import Message, mavlink
from .telemetry import (
    Attitude,
    GlobalPosition,
    Home,
    Landed,
    LandedState,
    LocalOrigin,
    LocalPosition,
    Odometry,
    Telemetry,
    Wind,
)

_LANDED_STATES = {state.value: state for state in LandedState}
_LOCAL_FRAMES = {
    int(mavlink.MAV_FRAME_LOCAL_NED),
    int(mavlink.MAV_FRAME_LOCAL_ENU),
    int(mavlink.MAV_FRAME_LOCAL_FRD),
    int(mavlink.MAV_FRAME_LOCAL_FLU),
}
_X, _Y, _Z = 0, 6, 11
"""Indices of these variances in the upper right triangle of a 6 x 6 covariance matrix."""


def _attitude(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    roll, pitch, yaw = message.roll, message.pitch, message.yaw
    if not math.isfinite(roll + pitch + yaw):
        return telemetry
    rate_radps = message.yawspeed
    turn_rate_radps = math.hypot(message.rollspeed, message.pitchspeed, rate_radps)
    attitude = Attitude(
        received_s=now_s,
        roll_rad=roll,
        pitch_rad=pitch,
        yaw_rad=yaw,
        boot_s=message.time_boot_ms * 1e-3,
        yaw_rate_radps=rate_radps if math.isfinite(rate_radps) else None,
        turn_rate_radps=turn_rate_radps if math.isfinite(turn_rate_radps) else None,
    )
    return replace(telemetry, attitude=attitude)


def _local_position(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    position = (message.x, message.y, message.z)
    velocity = (message.vx, message.vy, message.vz)
    if not math.isfinite(sum(position) + sum(velocity)):
        return telemetry
    return replace(
        telemetry,
        local_position=LocalPosition(
            received_s=now_s,
            boot_s=message.time_boot_ms * 1e-3,
            position_ned_m=position,
            velocity_ned_mps=velocity,
        ),
    )


def _odometry(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    if message.frame_id not in _LOCAL_FRAMES or message.quality < 0:
        return replace(telemetry, odometry=None)
    variances_m2 = message.pose_covariance
    return replace(
        telemetry,
        odometry=Odometry(
            received_s=now_s,
            reset_counter=message.reset_counter,
            horizontal_accuracy_m=_deviation_m(variances_m2[_X] + variances_m2[_Y]),
            vertical_accuracy_m=_deviation_m(variances_m2[_Z]),
        ),
    )


def _deviation_m(variance_m2: float) -> float | None:
    """Standard deviation; None for NaN or 0, an odometry's values for unknown."""
    known = math.isfinite(variance_m2) and variance_m2 > 0.0
    return math.sqrt(variance_m2) if known else None


def _local_origin(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    point = _point(message.latitude, message.longitude, message.altitude)
    if point is None:
        return telemetry
    return replace(telemetry, local_origin=LocalOrigin(received_s=now_s, point=point))


def _home(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    point = _point(message.latitude, message.longitude, message.altitude)
    position = (message.x, message.y, message.z)
    if point is None or not math.isfinite(sum(position)):
        return telemetry
    home = Home(received_s=now_s, point=point, position_ned_m=position)
    return replace(telemetry, home=home)


def _global_position(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    point = _point(message.lat, message.lon, message.alt)
    if point is None:
        return telemetry
    position = GlobalPosition(received_s=now_s, point=point, boot_s=message.time_boot_ms * 1e-3)
    return replace(telemetry, global_position=position)


def _point(latitude_e7: int, longitude_e7: int, altitude_mm: int) -> GeodeticPoint | None:
    """Point in degrees and metres; None for 0, 0, which ArduPilot sends without a position."""
    if (latitude_e7 == 0 and longitude_e7 == 0) or abs(latitude_e7) > 900_000_000:
        return None
    return GeodeticPoint(
        latitude_deg=latitude_e7 * 1e-7,
        longitude_deg=longitude_e7 * 1e-7,
        altitude_amsl_m=altitude_mm * 1e-3,
    )


def _landed(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    state = _LANDED_STATES.get(message.landed_state)
    landed = None if state is None else Landed(received_s=now_s, state=state)
    return replace(telemetry, landed=landed)


def _wind_cov(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    north, east, down = message.wind_x, message.wind_y, message.wind_z
    if not math.isfinite(north + east):
        return replace(telemetry, wind=None)
    # Multirotor estimators do not estimate vertical wind.
    velocity = (north, east, down if math.isfinite(down) else 0.0)
    return with_wind(telemetry, now_s, velocity, message.var_horiz)


def with_wind(
    telemetry: Telemetry, now_s: float, velocity_ned_mps: Vector, variance_m2ps2: float
) -> Telemetry:
    """Telemetry with PX4's wind.

    variance_m2ps2: sum of the variances north and east; 0: unknown. Zero wind without a variance is
    no estimate.
    """
    reported = math.isfinite(variance_m2ps2) and variance_m2ps2 > 0.0
    if not reported and not any(velocity_ned_mps[:2]):
        return replace(telemetry, wind=None)
    wind = Wind(
        received_s=now_s,
        velocity_ned_mps=velocity_ned_mps,
        deviation_mps=math.sqrt(0.5 * variance_m2ps2) if reported else None,
    )
    return replace(telemetry, wind=wind)


def _wind(telemetry: Telemetry, message: Message, now_s: float) -> Telemetry:
    speed, direction_deg, down = message.speed, message.direction, message.speed_z
    unknown = speed == 0.0 and abs(direction_deg) >= 179.99
    if unknown or not math.isfinite(speed + direction_deg):
        return replace(telemetry, wind=None)
    # ArduPilot reports the direction from which the wind blows.
    towards_rad = math.radians(direction_deg) + math.pi
    velocity = (
        speed * math.cos(towards_rad),
        speed * math.sin(towards_rad),
        down if math.isfinite(down) else 0.0,
    )
    return replace(telemetry, wind=Wind(received_s=now_s, velocity_ned_mps=velocity))


TRANSLATORS: dict[int, Callable[[Telemetry, Message, float], Telemetry]] = {
    mavlink.MAVLINK_MSG_ID_ATTITUDE: _attitude,
    mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: _local_position,
    mavlink.MAVLINK_MSG_ID_ODOMETRY: _odometry,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: _global_position,
    mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN: _local_origin,
    mavlink.MAVLINK_MSG_ID_HOME_POSITION: _home,
    mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: _landed,
    mavlink.MAVLINK_MSG_ID_WIND_COV: _wind_cov,
    mavlink.MAVLINK_MSG_ID_WIND: _wind,
}

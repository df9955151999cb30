"""Readings of instruments on board, for any autopilot: attitude, heading, acceleration, air."""

import math

from sitl.quadrotor import GRAVITY_MPS2, Quadrotor

Vector = tuple[float, float, float]


def quaternion(roll: float, pitch: float, yaw: float) -> tuple[float, float, float, float]:
    """Return w, x, y, z of roll, pitch, yaw."""
    sin_r, cos_r = math.sin(roll / 2), math.cos(roll / 2)
    sin_p, cos_p = math.sin(pitch / 2), math.cos(pitch / 2)
    sin_y, cos_y = math.sin(yaw / 2), math.cos(yaw / 2)
    return (
        cos_r * cos_p * cos_y + sin_r * sin_p * sin_y,
        sin_r * cos_p * cos_y - cos_r * sin_p * sin_y,
        cos_r * sin_p * cos_y + sin_r * cos_p * sin_y,
        cos_r * cos_p * sin_y - sin_r * sin_p * cos_y,
    )


def heading_cdeg(yaw_rad: float) -> int:
    """Return the compass heading in hundredths of a degree, 0 to 35999."""
    return int(math.degrees(yaw_rad) % 360.0 * 100) % 36000


def to_body(quad: Quadrotor, n: float, e: float, d: float) -> Vector:
    """Return a vector of the world (north, east, down) in the body's axes."""
    sin_r, cos_r = math.sin(quad.roll), math.cos(quad.roll)
    sin_p, cos_p = math.sin(quad.pitch), math.cos(quad.pitch)
    true_yaw = quad.true_yaw
    sin_y, cos_y = math.sin(true_yaw), math.cos(true_yaw)
    forward, right = n * cos_y + e * sin_y, -n * sin_y + e * cos_y
    down = forward * sin_p + d * cos_p
    return (
        forward * cos_p - d * sin_p,
        right * cos_r + down * sin_r,
        -right * sin_r + down * cos_r,
    )


def body_acceleration(quad: Quadrotor) -> Vector:
    """Return the specific force in the body's axes (m/s²): drag along x and y, thrust along z."""
    return to_body(quad, quad.acc_n, quad.acc_e, quad.acc_d - GRAVITY_MPS2)


def pressure_hpa(altitude_m: float) -> float:
    """Return the standard atmosphere's pressure."""
    result: float = 1013.25 * (1.0 - altitude_m / 44330.77) ** 5.2559
    return result

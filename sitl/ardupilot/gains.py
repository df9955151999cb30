"""ArduPilot's gains and limits, from its parameters (centimetres, centidegrees there)."""

import math
from typing import Final

from sitl.ardupilot.shaper import Limits
from sitl.control import Gains
from sitl.parameters import Parameters

_INTEGRAL_Z_PER_S2: Final = 1.0
"""ArduPilot integrates the acceleration's error instead."""
_THRUST_MIN, _THRUST_MAX = 0.05, 0.95


def gains(parameters: Parameters) -> Gains:
    """Read the gains of the position control; after each change of a parameter."""
    value = parameters.value
    return Gains(
        position_xy=value("PSC_POSXY_P"),
        position_z=value("PSC_POSZ_P"),
        velocity_xy=value("PSC_VELXY_P"),
        velocity_z=value("PSC_VELZ_P"),
        integral_xy=value("PSC_VELXY_I"),
        integral_z=_INTEGRAL_Z_PER_S2,
        derivative_xy=value("PSC_VELXY_D"),
        speed_mps=value("WPNAV_SPEED") / 100.0,
        up_mps=value("WPNAV_SPEED_UP") / 100.0,
        down_mps=value("WPNAV_SPEED_DN") / 100.0,
        tilt_rad=math.radians(value("ANGLE_MAX") / 100.0),
        thrust_min=_THRUST_MIN,
        thrust_max=_THRUST_MAX,
        braking_mps2=value("WPNAV_ACCEL") / 100.0,
    )


def horizontal_limits(parameters: Parameters) -> Limits:
    """Read the limits of horizontal targets."""
    value = parameters.value
    return Limits(
        speed_mps=value("WPNAV_SPEED") / 100.0,
        back_mps=value("WPNAV_SPEED") / 100.0,
        acceleration_mps2=value("WPNAV_ACCEL") / 100.0,
        jerk_mps3=value("PSC_JERK_XY"),
    )


def vertical_limits(parameters: Parameters) -> Limits:
    """Read the limits of vertical targets; down is the axis."""
    value = parameters.value
    return Limits(
        speed_mps=value("WPNAV_SPEED_DN") / 100.0,
        back_mps=value("WPNAV_SPEED_UP") / 100.0,
        acceleration_mps2=value("WPNAV_ACCEL_Z") / 100.0,
        jerk_mps3=value("PSC_JERK_Z"),
    )

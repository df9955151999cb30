"""PX4's gains and limits of the position control, from its MPC_ parameters."""

import math

from sitl.control import Gains
from sitl.parameters import Parameters


def gains(parameters: Parameters) -> Gains:
    """Read the gains; after each change of a parameter."""
    value = parameters.value
    return Gains(
        position_xy=value("MPC_XY_P"),
        position_z=value("MPC_Z_P"),
        velocity_xy=value("MPC_XY_VEL_P_ACC"),
        velocity_z=value("MPC_Z_VEL_P_ACC"),
        integral_xy=value("MPC_XY_VEL_I_ACC"),
        integral_z=value("MPC_Z_VEL_I_ACC"),
        derivative_xy=value("MPC_XY_VEL_D_ACC"),
        speed_mps=value("MPC_XY_VEL_MAX"),
        up_mps=value("MPC_Z_VEL_MAX_UP"),
        down_mps=value("MPC_Z_VEL_MAX_DN"),
        tilt_rad=math.radians(value("MPC_TILTMAX_AIR")),
        thrust_min=value("MPC_THR_MIN"),
        thrust_max=value("MPC_THR_MAX"),
    )

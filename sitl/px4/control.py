"""PX4's multicopter position control: setpoints in, attitude and thrust out.

    velocity wish = P_xy (position setpoint - position) + velocity setpoint     (feed-forward)
    acceleration  = P_v (velocity wish - velocity) + I - D acceleration + feed-forward

The velocity wish is limited only by MPC_XY_VEL_MAX and MPC_Z_VEL_MAX_*: a far position with a
small feed-forward is flown fast, as measured on PX4 v1.17.0.
"""

import math
from typing import Final

from sitl.px4.navigation import Navigation
from sitl.px4.offboard import NAN, Setpoint
from sitl.px4.parameters import Parameters
from sitl.quadrotor import GRAVITY_MPS2, Quadrotor

_INTEGRAL_LIMIT_MPS2: Final = 8.0
_isfinite = math.isfinite


class Target:
    """What the flight task wants in this tick; NaN in an axis means no wish."""

    __slots__ = (
        "ax",
        "ay",
        "az",
        "pitch",
        "roll",
        "thrust",
        "up_limit",
        "vx",
        "vy",
        "vz",
        "x",
        "y",
        "yaw",
        "yaw_rate",
        "z",
    )

    def __init__(self) -> None:
        """Want nothing."""
        self.clear()

    def clear(self) -> None:
        """Forget everything."""
        self.x = self.y = self.z = NAN
        self.vx = self.vy = self.vz = NAN
        self.ax = self.ay = self.az = NAN
        self.yaw = self.yaw_rate = NAN
        self.roll = self.pitch = self.thrust = NAN
        self.up_limit = math.inf

    def take(self, setpoint: Setpoint) -> None:
        """Copy an offboard setpoint."""
        self.clear()
        self.x, self.y, self.z = setpoint.position_ned_m
        self.vx, self.vy, self.vz = setpoint.velocity_ned_mps
        self.ax, self.ay, self.az = setpoint.acceleration_ned_mps2
        self.yaw, self.yaw_rate = setpoint.yaw_rad, setpoint.yaw_rate_radps


class PositionControl:
    """The cascade; keeps what it wished for, for POSITION_TARGET_LOCAL_NED and ATTITUDE_TARGET."""

    def __init__(self, parameters: Parameters, quad: Quadrotor, drift_radps: float) -> None:
        """`drift_radps` is how the heading drifts when nobody asks for one."""
        self._quad = quad
        self._drift_radps = drift_radps
        self.target = Target()
        self.wish_vx = self.wish_vy = self.wish_vz = NAN
        self.wish_ax = self.wish_ay = self.wish_az = 0.0
        self.yaw_wish = quad.yaw
        self._ix = self._iy = self._iz = 0.0
        self.refresh(parameters)

    def refresh(self, parameters: Parameters) -> None:
        """Take the parameters' values; after each change."""
        value = parameters.value
        self._p_xy, self._p_z = value("MPC_XY_P"), value("MPC_Z_P")
        self._pv_xy, self._pv_z = value("MPC_XY_VEL_P_ACC"), value("MPC_Z_VEL_P_ACC")
        self._iv_xy, self._iv_z = value("MPC_XY_VEL_I_ACC"), value("MPC_Z_VEL_I_ACC")
        self._dv_xy = value("MPC_XY_VEL_D_ACC")
        self._v_max = value("MPC_XY_VEL_MAX")
        self._up_max, self._down_max = value("MPC_Z_VEL_MAX_UP"), value("MPC_Z_VEL_MAX_DN")
        self._tilt_max = math.radians(value("MPC_TILTMAX_AIR"))
        self._hover = self._quad.airframe.hover_thrust
        self._thrust_min, self._thrust_max = value("MPC_THR_MIN"), value("MPC_THR_MAX")

    def reset(self) -> None:
        """Forget the integrals, on the ground."""
        self._ix = self._iy = self._iz = 0.0

    def idle(self, *, spinning: bool) -> None:
        """Leave the motors at idle, or stopped."""
        self.reset()
        demand = self._quad.demand
        demand.roll_rad = demand.pitch_rad = demand.thrust = 0.0
        demand.yaw_rad = self._quad.yaw
        demand.yaw_rate_radps = None
        demand.spinning = spinning
        self.yaw_wish = self._quad.yaw
        self.wish_vx = self.wish_vy = self.wish_vz = NAN
        self.wish_ax = self.wish_ay = 0.0
        self.wish_az = 100.0

    def run(self, dt: float, nav: Navigation) -> None:
        """Write the airframe's demand for the target."""
        target, quad, estimator = self.target, self._quad, nav.estimator
        demand = quad.demand
        demand.spinning = True
        self._heading(dt, target)
        if _isfinite(target.roll):
            demand.roll_rad, demand.pitch_rad = target.roll, target.pitch
            self._ix = self._iy = 0.0
            ax = ay = 0.0
        else:
            ax, ay = self._horizontal(dt, target, nav)
            yaw = quad.yaw
            cos_y, sin_y = math.cos(yaw), math.sin(yaw)
            forward = ax * cos_y + ay * sin_y
            right = -ax * sin_y + ay * cos_y
            tilt_acc = math.hypot(forward, right)
            limit = GRAVITY_MPS2 * math.tan(self._tilt_max)
            if tilt_acc > limit:
                forward *= limit / tilt_acc
                right *= limit / tilt_acc
            demand.pitch_rad = -math.atan2(forward, GRAVITY_MPS2)
            demand.roll_rad = math.atan2(right, math.hypot(GRAVITY_MPS2, forward))
        self.wish_ax, self.wish_ay = ax, ay
        if _isfinite(target.thrust):
            demand.thrust = target.thrust
            return
        wish = target.vz if _isfinite(target.vz) else NAN
        if _isfinite(target.z):
            wish = self._p_z * (target.z - nav.z) + (wish if _isfinite(wish) else 0.0)
        az = target.az if _isfinite(target.az) else 0.0
        if _isfinite(wish):
            wish = max(-min(self._up_max, target.up_limit), min(self._down_max, wish))
            error = wish - estimator.vd
            self._iz += self._iv_z * error * dt
            self._iz = max(-GRAVITY_MPS2, min(GRAVITY_MPS2, self._iz))
            az += self._pv_z * error + self._iz
        self.wish_vz, self.wish_az = wish, az
        upright = math.cos(demand.roll_rad) * math.cos(demand.pitch_rad)
        thrust = (GRAVITY_MPS2 - az) / GRAVITY_MPS2 * self._hover / max(upright, 0.5)
        demand.thrust = max(self._thrust_min, min(self._thrust_max, thrust))

    def _horizontal(self, dt: float, target: Target, nav: Navigation) -> tuple[float, float]:
        quad, estimator = self._quad, nav.estimator
        vx, vy = target.vx, target.vy
        if _isfinite(target.x) and _isfinite(target.y):
            px = self._p_xy * (target.x - nav.x)
            py = self._p_xy * (target.y - nav.y)
            vx = px + (vx if _isfinite(vx) else 0.0)
            vy = py + (vy if _isfinite(vy) else 0.0)
        speed = math.hypot(vx, vy)
        if speed > self._v_max:
            vx *= self._v_max / speed
            vy *= self._v_max / speed
        ax = target.ax if _isfinite(target.ax) else 0.0
        ay = target.ay if _isfinite(target.ay) else 0.0
        if _isfinite(vx):
            error = vx - estimator.vn
            self._ix += self._iv_xy * error * dt
            self._ix = max(-_INTEGRAL_LIMIT_MPS2, min(_INTEGRAL_LIMIT_MPS2, self._ix))
            ax += self._pv_xy * error + self._ix - self._dv_xy * quad.acc_n
        if _isfinite(vy):
            error = vy - estimator.ve
            self._iy += self._iv_xy * error * dt
            self._iy = max(-_INTEGRAL_LIMIT_MPS2, min(_INTEGRAL_LIMIT_MPS2, self._iy))
            ay += self._pv_xy * error + self._iy - self._dv_xy * quad.acc_e
        self.wish_vx, self.wish_vy = vx, vy
        return ax, ay

    def _heading(self, dt: float, target: Target) -> None:
        demand = self._quad.demand
        if _isfinite(target.yaw):
            self.yaw_wish = target.yaw
            demand.yaw_rad, demand.yaw_rate_radps = target.yaw, None
        elif _isfinite(target.yaw_rate):
            self.yaw_wish = self._quad.yaw
            demand.yaw_rate_radps = target.yaw_rate
        else:
            self.yaw_wish += self._drift_radps * dt
            demand.yaw_rad, demand.yaw_rate_radps = self.yaw_wish, None

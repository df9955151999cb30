"""Multicopter position control: setpoints in, attitude and thrust out.

    velocity wish = P_xy (position setpoint - position) + velocity setpoint     (feed-forward)
    acceleration  = P_v (velocity wish - velocity) + I - D acceleration + feed-forward

The velocity wish is limited only by the gains' speeds: a far position with a small feed-forward is
flown fast. PX4 hands it raw setpoints (measured on v1.17.0), ArduPilot shaped ones. While the lean
is at its limit I grows no more in its direction, as in ArduPilot (AC_PID_2D); PX4 even unwinds it.
"""

import math
from dataclasses import dataclass
from typing import Final, Protocol

from sitl.position_estimate import Estimator
from sitl.quadrotor import GRAVITY_MPS2, Quadrotor

NAN: Final = math.nan
_INTEGRAL_LIMIT_MPS2: Final = 8.0
_isfinite = math.isfinite


class Place(Protocol):
    """Estimated position of the vehicle in its local frame, and its velocity."""

    @property
    def x(self) -> float:
        """Metres north."""

    @property
    def y(self) -> float:
        """Metres east."""

    @property
    def z(self) -> float:
        """Metres down."""

    @property
    def estimator(self) -> Estimator:
        """The estimate, of which the velocity is used here."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Gains:
    """Gains (1/s, 1/s^2, none) and limits of the control."""

    position_xy: float
    position_z: float
    velocity_xy: float
    velocity_z: float
    integral_xy: float
    integral_z: float
    derivative_xy: float
    speed_mps: float
    up_mps: float
    down_mps: float
    tilt_rad: float
    thrust_min: float
    thrust_max: float
    braking_mps2: float = math.inf
    """Deceleration before a far position, which limits the speed towards it."""

    @property
    def lean_mps2(self) -> float:
        """The acceleration at the limit of the lean."""
        return GRAVITY_MPS2 * math.tan(self.tilt_rad)


class Target:
    """Demand of the flight task in this tick; NaN in an axis means none."""

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
        """Start without a demand."""
        self.clear()

    def clear(self) -> None:
        """Clear all axes."""
        self.x = self.y = self.z = NAN
        self.vx = self.vy = self.vz = NAN
        self.ax = self.ay = self.az = NAN
        self.yaw = self.yaw_rate = NAN
        self.roll = self.pitch = self.thrust = NAN
        self.up_limit = math.inf


class PositionControl:
    """The cascade; keeps its wishes, for POSITION_TARGET_LOCAL_NED and ATTITUDE_TARGET."""

    def __init__(self, gains: Gains, quad: Quadrotor, drift_radps: float) -> None:
        """`drift_radps`: drift of the heading while none is commanded."""
        self.gains = gains
        self._quad = quad
        self._drift_radps = drift_radps
        self.target = Target()
        self.wish_vx = self.wish_vy = self.wish_vz = NAN
        self.wish_ax = self.wish_ay = self.wish_az = 0.0
        self.yaw_wish = quad.yaw
        self._ix = self._iy = self._iz = 0.0

    def reset(self) -> None:
        """Clear the integrals, on the ground."""
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

    def run(self, dt: float, place: Place) -> None:
        """Write the airframe's demand for the target."""
        target, quad, estimator, gains = self.target, self._quad, place.estimator, self.gains
        demand = quad.demand
        demand.spinning = True
        self._heading(dt, target)
        if _isfinite(target.roll):
            demand.roll_rad, demand.pitch_rad = target.roll, target.pitch
            self._ix = self._iy = 0.0
            ax = ay = 0.0
        else:
            ax, ay = self._horizontal(dt, target, place)
            yaw = quad.yaw
            cos_y, sin_y = math.cos(yaw), math.sin(yaw)
            forward = ax * cos_y + ay * sin_y
            right = -ax * sin_y + ay * cos_y
            tilt_acc = math.hypot(forward, right)
            limit = gains.lean_mps2
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
            wish = gains.position_z * (target.z - place.z) + (wish if _isfinite(wish) else 0.0)
        az = target.az if _isfinite(target.az) else 0.0
        if _isfinite(wish):
            wish = max(-min(gains.up_mps, target.up_limit), min(gains.down_mps, wish))
            error = wish - estimator.vd
            self._iz += gains.integral_z * error * dt
            self._iz = max(-GRAVITY_MPS2, min(GRAVITY_MPS2, self._iz))
            az += gains.velocity_z * error + self._iz
        self.wish_vz, self.wish_az = wish, az
        upright = math.cos(demand.roll_rad) * math.cos(demand.pitch_rad)
        thrust = (GRAVITY_MPS2 - az) / GRAVITY_MPS2 * quad.airframe.hover_thrust / max(upright, 0.5)
        demand.thrust = max(gains.thrust_min, min(gains.thrust_max, thrust))

    def _horizontal(self, dt: float, target: Target, place: Place) -> tuple[float, float]:
        quad, estimator, gains = self._quad, place.estimator, self.gains
        vx, vy = target.vx, target.vy
        if _isfinite(target.x) and _isfinite(target.y):
            px, py = target.x - place.x, target.y - place.y
            gain = _gain(math.hypot(px, py), gains.position_xy, gains.braking_mps2)
            px *= gain
            py *= gain
            vx = px + (vx if _isfinite(vx) else 0.0)
            vy = py + (vy if _isfinite(vy) else 0.0)
        speed = math.hypot(vx, vy)
        if speed > gains.speed_mps:
            vx *= gains.speed_mps / speed
            vy *= gains.speed_mps / speed
        ax = target.ax if _isfinite(target.ax) else 0.0
        ay = target.ay if _isfinite(target.ay) else 0.0
        ix, iy = self._ix, self._iy
        if _isfinite(vx):
            error = vx - estimator.vn
            self._ix += gains.integral_xy * error * dt
            self._ix = max(-_INTEGRAL_LIMIT_MPS2, min(_INTEGRAL_LIMIT_MPS2, self._ix))
            ax += gains.velocity_xy * error + self._ix - gains.derivative_xy * quad.acc_n
        if _isfinite(vy):
            error = vy - estimator.ve
            self._iy += gains.integral_xy * error * dt
            self._iy = max(-_INTEGRAL_LIMIT_MPS2, min(_INTEGRAL_LIMIT_MPS2, self._iy))
            ay += gains.velocity_xy * error + self._iy - gains.derivative_xy * quad.acc_e
        self.wish_vx, self.wish_vy = vx, vy
        before, after = math.hypot(ix, iy), math.hypot(self._ix, self._iy)
        outwards = (self._ix - ix) * ax + (self._iy - iy) * ay > 0.0
        if outwards and after > before and math.hypot(ax, ay) > gains.lean_mps2:
            self._ix *= before / after
            self._iy *= before / after
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


def _gain(distance_m: float, gain_per_s: float, braking_mps2: float) -> float:
    """Speed per distance: the gain; far away, what can still be braked (sqrt_controller)."""
    if distance_m * gain_per_s**2 <= braking_mps2:
        return gain_per_s
    linear_m = braking_mps2 / gain_per_s**2
    return math.sqrt(2.0 * braking_mps2 * (distance_m - 0.5 * linear_m)) / distance_m

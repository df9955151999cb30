"""A quadrotor in the air: attitude dynamics, thrust, drag against the moving air, ground.

Inputs: an attitude and thrust demand, the wind. Outputs: the true state. Plain floats, because
this runs a hundred times per simulated second.

    motion      a = g + T R(roll, pitch, yaw) (0, 0, -1) - (k_d + k_q |v - wind|) (v - wind)
    attitude    angular rate follows P (demand - attitude) with a lag, rates limited

Measured on PX4 v1.17.0's built-in quadrotor with a linear drag of 0.3 per second: tilt 7 deg in
5 m/s of wind, 24 deg in 15 m/s, 37 deg in 25 m/s. That is k_d = 0.3, k_q = 0. ArduPilot's has both.
"""

import math
from dataclasses import dataclass

GRAVITY_MPS2 = 9.80665
_CONTACT_M = 0.005
"""Height below which the legs touch the ground."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Airframe:
    """Capabilities of the aircraft."""

    mass_kg: float = 2.0
    drag_per_s: float = 0.30
    drag_per_m: float = 0.0
    hover_thrust: float = 0.5
    hover_power_w: float = 320.0
    idle_power_w: float = 12.0
    attitude_gain_per_s: float = 6.5
    yaw_gain_per_s: float = 2.8
    rate_lag_s: float = 0.05
    thrust_lag_s: float = 0.04
    max_rate_radps: float = 3.8
    max_yaw_rate_radps: float = 1.0
    motors: int = 4


@dataclass(slots=True, kw_only=True)
class Demand:
    """Demand of the autopilot; thrust 0 to 1, hover at `Airframe.hover_thrust`."""

    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rad: float = 0.0
    yaw_rate_radps: float | None = None
    thrust: float = 0.0
    spinning: bool = False


def wrap_pi(angle_rad: float) -> float:
    """Return the angle in (-pi, pi]."""
    return math.remainder(angle_rad, math.tau)


class Quadrotor:
    """The true state of the aircraft, metres from home (north, east, down), WGS84 truth frame.

    yaw is the heading as the autopilot estimates it: the true one and heading_error_rad.
    """

    __slots__ = (
        "acc_d",
        "acc_e",
        "acc_n",
        "airframe",
        "d",
        "demand",
        "e",
        "heading_error_rad",
        "n",
        "on_ground",
        "pitch",
        "pitch_acc",
        "pitch_rate",
        "roll",
        "roll_acc",
        "roll_rate",
        "thrust",
        "vd",
        "ve",
        "vn",
        "yaw",
        "yaw_acc",
        "yaw_rate",
    )

    def __init__(self, airframe: Airframe, yaw_rad: float) -> None:
        """Stand on the ground at home."""
        self.airframe = airframe
        self.demand = Demand(yaw_rad=yaw_rad)
        self.n = self.e = self.d = 0.0
        self.vn = self.ve = self.vd = 0.0
        self.acc_n = self.acc_e = self.acc_d = 0.0
        self.roll = self.pitch = 0.0
        self.yaw = wrap_pi(yaw_rad)
        self.heading_error_rad = 0.0
        self.roll_rate = self.pitch_rate = self.yaw_rate = 0.0
        self.roll_acc = self.pitch_acc = self.yaw_acc = 0.0
        self.thrust = 0.0
        self.on_ground = True

    def step(
        self,
        dt: float,
        wind_n: float,
        wind_e: float,
        wind_d: float,
        drag_per_s: float | None = None,
    ) -> None:
        """Advance by `dt` seconds in the given wind (m/s, direction it blows to).

        drag_per_s: in place of the airframe's.
        """
        frame, demand = self.airframe, self.demand
        target = demand.thrust if demand.spinning else 0.0
        self.thrust += (target - self.thrust) * min(1.0, dt / frame.thrust_lag_s)
        self._turn(dt, frame, demand)
        sin_r, cos_r = math.sin(self.roll), math.cos(self.roll)
        sin_p, cos_p = math.sin(self.pitch), math.cos(self.pitch)
        true_yaw = self.true_yaw
        sin_y, cos_y = math.sin(true_yaw), math.cos(true_yaw)
        lift = self.thrust / frame.hover_thrust * GRAVITY_MPS2
        air_n, air_e, air_d = self.vn - wind_n, self.ve - wind_e, self.vd - wind_d
        drag = frame.drag_per_s if drag_per_s is None else drag_per_s
        if frame.drag_per_m:
            drag += frame.drag_per_m * math.hypot(air_n, air_e, air_d)
        acc_n = -lift * (cos_r * sin_p * cos_y + sin_r * sin_y) - drag * air_n
        acc_e = -lift * (cos_r * sin_p * sin_y - sin_r * cos_y) - drag * air_e
        acc_d = GRAVITY_MPS2 - lift * cos_r * cos_p - drag * air_d
        if self.d >= -_CONTACT_M and acc_d > -0.05 and self.vd >= -0.05:
            self._rest()
            return
        self.on_ground = False
        self.acc_n, self.acc_e, self.acc_d = acc_n, acc_e, acc_d
        self.vn += acc_n * dt
        self.ve += acc_e * dt
        self.vd += acc_d * dt
        self.n += self.vn * dt
        self.e += self.ve * dt
        self.d += self.vd * dt
        if self.d > 0.0:
            self.d = 0.0
            self.vd = min(0.0, self.vd)

    def _turn(self, dt: float, frame: Airframe, demand: Demand) -> None:
        if self.on_ground or not demand.spinning:
            rate_r = rate_p = rate_y = 0.0
        else:
            limit = frame.max_rate_radps
            gain = frame.attitude_gain_per_s
            rate_r = max(-limit, min(limit, gain * (demand.roll_rad - self.roll)))
            rate_p = max(-limit, min(limit, gain * (demand.pitch_rad - self.pitch)))
            if demand.yaw_rate_radps is None:
                rate_y = frame.yaw_gain_per_s * wrap_pi(demand.yaw_rad - self.yaw)
            else:
                rate_y = demand.yaw_rate_radps
            limit = frame.max_yaw_rate_radps
            rate_y = max(-limit, min(limit, rate_y))
        lag = 1.0 / max(dt, frame.rate_lag_s)
        self.roll_acc = (rate_r - self.roll_rate) * lag
        self.pitch_acc = (rate_p - self.pitch_rate) * lag
        self.yaw_acc = (rate_y - self.yaw_rate) * lag
        self.roll_rate += self.roll_acc * dt
        self.pitch_rate += self.pitch_acc * dt
        self.yaw_rate += self.yaw_acc * dt
        self.roll += self.roll_rate * dt
        self.pitch += self.pitch_rate * dt
        self.yaw = wrap_pi(self.yaw + self.yaw_rate * dt)

    def _rest(self) -> None:
        self.on_ground = True
        self.vn = self.ve = self.vd = 0.0
        self.acc_n = self.acc_e = self.acc_d = 0.0
        self.d = 0.0
        self.roll *= 0.9
        self.pitch *= 0.9

    @property
    def true_yaw(self) -> float:
        """The true heading."""
        return wrap_pi(self.yaw - self.heading_error_rad)

    def mislead(self, heading_error_rad: float) -> None:
        """Change the error of the estimated heading; the true one stays."""
        self.yaw = wrap_pi(self.yaw + heading_error_rad - self.heading_error_rad)
        self.heading_error_rad = heading_error_rad

    @property
    def height_m(self) -> float:
        """Height above the flat ground at home."""
        return -self.d

    def power_w(self) -> float:
        """Electric power: actuator-disc like, thrust to the power 1.5, plus the electronics."""
        frame = self.airframe
        share = max(0.0, self.thrust / frame.hover_thrust)
        return frame.idle_power_w + frame.hover_power_w * share * math.sqrt(share)

    def motor_outputs(self) -> tuple[float, float, float, float]:
        """Return four outputs 0 to 1: front right, rear left, front left, rear right."""
        if not self.demand.spinning:
            return 0.0, 0.0, 0.0, 0.0
        t = max(self.thrust, 0.03)
        r, p, y = self.roll_acc * 0.004, self.pitch_acc * 0.004, self.yaw_acc * 0.004
        return (
            max(0.0, min(1.0, t - r + p + y)),
            max(0.0, min(1.0, t + r - p + y)),
            max(0.0, min(1.0, t + r + p - y)),
            max(0.0, min(1.0, t - r - p - y)),
        )

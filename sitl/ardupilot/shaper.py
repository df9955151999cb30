"""ArduPilot's shaping of targets: a request becomes a path of limited jerk.

    velocity wish      = sqrt_controller(position error) + requested velocity
    acceleration wish  = sqrt_controller(velocity wish - velocity), limited in size and in jerk

After AP_Math/control.cpp (shape_pos_vel_accel). With 2.5 m/s^2 and 5 m/s^3 its gain is 1 per
second. A constant position with velocity v settles v times 1 s beyond it, and a jump of 30 m is
flown at 6.7 m/s, as measured on ArduCopter 4.6.3.

Vectors are complex numbers: north and east, or down alone.
"""

import math
from dataclasses import dataclass
from typing import Final

_BRAKING_SHARE: Final = 0.5
"""Part of the acceleration for stopping; the rest is kept for corners."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Speeds (`back_mps`: against the axis, where that differs), acceleration and jerk."""

    speed_mps: float
    back_mps: float
    acceleration_mps2: float
    jerk_mps3: float

    @property
    def leash_m(self) -> float:
        """Greatest distance of the shaped position from the vehicle."""
        return self.speed_mps**2 / (2.0 * self.acceleration_mps2) + self.acceleration_mps2 / 2.0


class Shaper:
    """The shaped position and its rates."""

    __slots__ = ("acceleration", "position", "velocity")

    def __init__(self) -> None:
        """Start at the origin, at rest."""
        self.restart(0.0, 0.0)

    def restart(self, position: complex, velocity: complex) -> None:
        """Begin from the vehicle's position and velocity."""
        self.position = complex(position)
        self.velocity = complex(velocity)
        self.acceleration = 0j

    def step(
        self, dt: float, limits: Limits, actual: complex, goal: complex | None, velocity: complex
    ) -> None:
        """Move towards a goal that moves; `goal` None: only the velocity counts."""
        wish = velocity
        if goal is not None:
            wish += _square_root(
                goal - self.position,
                gain=0.5 * limits.jerk_mps3 / limits.acceleration_mps2,
                limit=_BRAKING_SHARE * limits.acceleration_mps2,
            )
        wish = _shortened(wish, limits.speed_mps if wish.real > 0.0 else limits.back_mps)
        target = _square_root(
            wish - self.velocity,
            gain=limits.jerk_mps3 / limits.acceleration_mps2,
            limit=limits.jerk_mps3,
        )
        target = _shortened(target, limits.acceleration_mps2)
        self.acceleration += _shortened(target - self.acceleration, limits.jerk_mps3 * dt)
        self.position += self.velocity * dt + 0.5 * self.acceleration * dt * dt
        self.velocity += self.acceleration * dt
        self.position = actual + _shortened(self.position - actual, limits.leash_m)


def _square_root(error: complex, *, gain: float, limit: float) -> complex:
    """Return gain times the error, and for large errors the rate that `limit` can still stop."""
    size = abs(error)
    linear = limit / gain**2
    if size <= linear:
        return gain * error
    return error / size * math.sqrt(2.0 * limit * (size - 0.5 * linear))


def _shortened(vector: complex, limit: float) -> complex:
    size = abs(vector)
    return vector if size <= limit else vector * (limit / size)

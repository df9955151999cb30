"""Linear drag of a multirotor, estimated in flight from its speed and lean. Pure.

    b - q |u| u = k v + c,    c: a random walk, of the wind

b: deceleration by the air; v: velocity over ground; u: velocity through the air; k, q: of `drag`, q
as the vehicle file has it. Recursive least squares (a Kalman filter of k, c north and east): a
hover gives c, every change of the velocity k. The noise follows the residual of the fit, so that
gusts make k less certain and not wrong.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..settings.risk_model import RiskModel
from .braking import WINDOW_S, Braking
from .drag import Level, air_velocity_mps

LEAST_PER_S, GREATEST_PER_S = 0.05, 1.5
"""Range of plausible drag: recorded quadrotors have 0.2 to 0.3, PX4's simulated one 1.0."""
_PRIOR_PER_S = 0.4
"""Standard error of the vehicle file's drag before the flight's estimate."""
_KNOWN = 0.15
"""Greatest relative standard error at which the drag of the flight is used."""
_NOISE_MPS2, _WALK_MPS2 = 0.1, 0.05
"""Least noise of a window, and least walk of the wind's deceleration in a second."""
_NOISE_S = 20.0
"""Time constant of the mean residual."""
_GREATEST = 100.0
"""Greatest plausible speed in m/s and deceleration in m/s^2 of a multirotor."""
_PERIOD_S = 0.5 * WINDOW_S
"""Least time between two windows that count: half of each is new."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class DragLearning:
    """Estimate of the drag from a flight.

    state: (3,), k and c; covariance: (3, 3); None before the first window. left_m2ps4: mean square
    of the residual.
    """

    state: NDArray[np.float64] | None = None
    covariance: NDArray[np.float64] | None = None
    time_s: float = -math.inf
    left_m2ps4: float = _NOISE_MPS2**2

    @property
    def error_per_s(self) -> float:
        """Standard error of the drag."""
        return _PRIOR_PER_S if self.covariance is None else math.sqrt(self.covariance[0, 0])

    @property
    def wind_ne_mps2(self) -> Level:
        """Deceleration of an aircraft at rest by the wind, c; 0 before the first window."""
        return (0.0, 0.0) if self.state is None else (float(self.state[1]), float(self.state[2]))

    def drag_per_s(self, model: RiskModel) -> float:
        """Best estimate of the drag."""
        return model.drag_per_s if self.state is None else float(self.state[0])

    def known(self, model: RiskModel) -> bool:
        """Returns True if the flight's drag is known well enough to replace the vehicle file's."""
        return self.error_per_s <= _KNOWN * self.drag_per_s(model)

    def used(self, model: RiskModel) -> RiskModel:
        """Model with the flight's drag, once it is known, less its error: more estimated wind."""
        if not self.known(model):
            return model
        drag_per_s = max(LEAST_PER_S, self.drag_per_s(model) - self.error_per_s)
        return replace(model, drag_per_s=drag_per_s)

    def range_per_s(self, model: RiskModel) -> Level:
        """Least and greatest possible drag: two standard errors."""
        drag, error = self.drag_per_s(model), 2.0 * self.error_per_s
        return max(LEAST_PER_S, drag - error), min(GREATEST_PER_S, drag + error)

    def then(self, air: Braking, model: RiskModel) -> DragLearning:
        """Estimate updated by a window; unchanged if the window mostly repeats the last one."""
        elapsed_s = air.time_s - self.time_s
        greatest = max(map(abs, (*air.velocity_ne_mps, *air.deceleration_ne_mps2)))
        if elapsed_s < _PERIOD_S or not greatest <= _GREATEST:
            return self
        predicted = np.array(_linear_mps2(air, self.used(model)))
        if self.state is None or self.covariance is None:
            wind = predicted - model.drag_per_s * np.array(air.velocity_ne_mps)
            first = np.diag([_PRIOR_PER_S**2, 1.0, 1.0])
            state = np.array([model.drag_per_s, *wind])
            return replace(self, state=state, covariance=first, time_s=air.time_s)
        noise = max(_NOISE_MPS2**2, self.left_m2ps4)
        walk = max(_WALK_MPS2**2, 0.2 * self.left_m2ps4) * min(elapsed_s, _NOISE_S)
        covariance = self.covariance + np.diag([0.0, walk, walk])
        north, east = air.velocity_ne_mps
        seen = np.array([[north, 1.0, 0.0], [east, 0.0, 1.0]])
        off = predicted - seen @ self.state
        spread = seen @ covariance @ seen.T + noise * np.eye(2)
        gain = covariance @ seen.T @ np.linalg.inv(spread)
        state = self.state + gain @ off
        state[0] = min(GREATEST_PER_S, max(LEAST_PER_S, state[0]))
        left = predicted - seen @ state
        part = min(1.0, elapsed_s / _NOISE_S)
        covariance = covariance - gain @ seen @ covariance
        return DragLearning(
            state=state,
            covariance=0.5 * (covariance + covariance.T),
            time_s=air.time_s,
            left_m2ps4=(1.0 - part) * self.left_m2ps4 + part * float(left @ left),
        )


def apart_from_own_motion(air: Braking, learning: DragLearning, model: RiskModel) -> Level:
    """Deceleration without the part that a drag other than the model's causes by the own motion.

    The selected drag is the possible one that brings the result nearest to the expected one: by the
    model's drag and c, which a hover gives within seconds. So a hover's deceleration stays
    unchanged, and the wind that it gave stays, too.
    """
    (north, east), (b_north, b_east) = air.velocity_ne_mps, air.deceleration_ne_mps2
    square = north * north + east * east
    if not square > 0.0:
        return air.deceleration_ne_mps2
    linear_north, linear_east = _linear_mps2(air, model)
    c_north, c_east = learning.wind_ne_mps2
    along = (linear_north - c_north) * north + (linear_east - c_east) * east
    least, greatest = learning.range_per_s(model)
    more = min(greatest, max(least, along / square)) - model.drag_per_s
    return b_north - more * north, b_east - more * east


def _linear_mps2(air: Braking, model: RiskModel) -> Level:
    """Deceleration less that by the quadratic drag."""
    (b_north, b_east), q = air.deceleration_ne_mps2, model.drag_per_m
    u_north, u_east = air_velocity_mps(air.deceleration_ne_mps2, model)
    factor = q * math.hypot(u_north, u_east)
    return b_north - factor * u_north, b_east - factor * u_east

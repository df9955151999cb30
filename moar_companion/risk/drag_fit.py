"""Fit of a multirotor's drag to a flight: deceleration by speed -> k and q of `drag`. Pure.

Robust least squares, together with the mean wind of the flight. A hover gives the wind, a straight
leg the drag at its speed; legs at two speeds or both ways give both and the curvature.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from ..mavlink.telemetry import Telemetry
from ..settings.risk_model import RiskModel
from .braking import WINDOW_S, AirSample, Braking, braking, extended
from .drag import Level

_SPEED_MIN_MPS = 3.0
"""Least range of speeds in the flight: a calm hover's wind of 0.3 m/s is then a tenth."""
_COUNT_MIN = 10
"""Least number of windows, so 15 s in the air."""
_WIND_MAX_MPS = 4.0
"""Greatest mean wind: in more wind, gusts and the error of the wind falsify the drag."""
_RESIDUAL_MAX_MPS2 = 0.8
"""Greatest residual: two flights recorded in a light breeze leave 0.5, a hover in changing wind
2."""
_LEAST, _GREATEST = (1e-3, 0.0, -30.0, -30.0), (10.0, 10.0, 30.0, 30.0)
"""Bounds of the fit: k, q, and the wind north and east."""
_OUTLIER_MPS2 = 0.3
"""Residual above which a gust is likelier than noise: a tenth of the lean in 10 m/s."""
_QUADRATIC_SCALE_PER_M = 0.03
"""Scale of the prior on the quadratic drag around the default: the distance to ArduPilot's
simulated quadrotor, the most curved one known. One speed cannot separate the two drags."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DragFit:
    """Drags, mean wind, and quality of the fit.

    wind_ne_mps: direction towards which it blew. residual_mps2: root mean square. span_mps: range
    of the windows' velocities. seconds: duration of all windows.
    """

    drag_per_s: float
    drag_per_m: float
    wind_ne_mps: Level
    residual_mps2: float
    span_mps: float
    seconds: float


class DragFlight:
    """Collects windows of a flight, one after the other."""

    def __init__(self) -> None:
        self._samples: tuple[AirSample, ...] = ()
        self._windows: list[Braking] = []
        self._model = RiskModel()

    def take(self, telemetry: Telemetry) -> None:
        """Takes the telemetry after a packet, or every tenth of a second."""
        self._samples = extended(self._samples, telemetry)
        last_s = self._windows[-1].time_s if self._windows else -math.inf
        if self._samples and self._samples[-1].attitude_s >= last_s + WINDOW_S:
            window = braking(self._samples, self._model.drag_per_s)
            if window is not None:
                self._windows.append(window)

    def fit(self) -> DragFit | str:
        """Returns the drag, or the reason why the flight does not suffice."""
        return fit_drag(self._windows)


def fit_drag(windows: Sequence[Braking]) -> DragFit | str:
    """Returns the drag that fits these windows best, or the reason why they do not suffice."""
    seconds = WINDOW_S * len(windows)
    if len(windows) < _COUNT_MIN:
        return f"{seconds:.0f} s in the air with attitude and velocity: too short to measure drag"
    velocity = np.array([window.velocity_ne_mps for window in windows])
    deceleration = np.array([window.deceleration_ne_mps2 for window in windows])
    span_mps = float(np.linalg.norm(np.ptp(velocity, axis=0)))
    if span_mps < _SPEED_MIN_MPS:
        return (
            f"speeds within {span_mps:.1f} m/s of each other: "
            f"drag takes {_SPEED_MIN_MPS:g} m/s to measure"
        )
    usual = RiskModel()

    def explained(x: NDArray[np.float64]) -> NDArray[np.float64]:
        air = velocity - x[2:]
        speed = np.linalg.norm(air, axis=1, keepdims=True)
        braked: NDArray[np.float64] = (x[0] + x[1] * speed) * air
        return braked

    def residuals(x: NDArray[np.float64]) -> NDArray[np.float64]:
        errors = (explained(x) - deceleration).ravel() / _OUTLIER_MPS2
        prior = (x[1] - usual.drag_per_m) / _QUADRATIC_SCALE_PER_M
        return np.append(errors, prior)

    found = least_squares(
        residuals,
        np.array([usual.drag_per_s, usual.drag_per_m, 0.0, 0.0]),
        bounds=(_LEAST, _GREATEST),
        loss="soft_l1",
    )
    k, q, wind_north, wind_east = (float(value) for value in found.x)
    errors = explained(found.x) - deceleration
    residual_mps2 = float(np.sqrt(np.mean(np.sum(errors * errors, axis=1))))
    wind_mps = math.hypot(wind_north, wind_east)
    if residual_mps2 > _RESIDUAL_MAX_MPS2:
        return (
            f"a steady wind leaves {residual_mps2:.1f} m/s2 unexplained: "
            "drag takes calm air to measure"
        )
    if wind_mps > _WIND_MAX_MPS:
        return f"wind of {wind_mps:.1f} m/s: drag takes less than {_WIND_MAX_MPS:g} m/s to measure"
    return DragFit(
        drag_per_s=k,
        drag_per_m=q,
        wind_ne_mps=(wind_north, wind_east),
        residual_mps2=residual_mps2,
        span_mps=span_mps,
        seconds=seconds,
    )

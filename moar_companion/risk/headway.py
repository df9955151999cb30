"""Headway: greatest speed over ground in wind for an aircraft at its lean limit. Pure.

    |v - w| <= u,    (k + q u) u = g tan(limit)

v, w: the aircraft's and the wind's velocity over ground, both level; u: the airspeed at which the
drag equals the acceleration of the lean; k, q: of `drag`; limit: `RiskModel.tilt_rad.high`.
Inputs: the steps of a path, the mean wind. Outputs: times.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import numpy.typing as npt

from ..vehicle import Vehicle
from .braking import GRAVITY_MPS2
from .drag import Level, air_velocity_mps

FloatArray = npt.NDArray[np.floating[Any]]


def least_s(steps_m: FloatArray, wind_mps: Level, vehicle: Vehicle) -> FloatArray:
    """Least durations (n,) of steps (n, 3), up last; at most those at v_MIN.

    wind_mps: level, towards which it blows, along the first two axes of the steps.
    """
    lean_mps2 = GRAVITY_MPS2 * math.tan(vehicle.risk.tilt_rad.high)
    u_mps, _ = air_velocity_mps((lean_mps2, 0.0), vehicle.risk)
    level_m = steps_m[:, :2]
    square, along = (level_m**2).sum(axis=1), level_m @ np.array(wind_mps)
    # The greatest of the rates 1 / t at which |step / t - w| = u, if there is one.
    root = along**2 + square * (u_mps**2 - math.hypot(*wind_mps) ** 2)
    rate = np.where(root >= 0.0, along + np.sqrt(np.abs(root)), 0.0)
    slowest_s = np.sqrt((steps_m**2).sum(axis=1)) / vehicle.speed.min_mps
    against_s: FloatArray = np.where(square > 0.0, slowest_s, 0.0)
    np.divide(square, rate, out=against_s, where=rate > 0.0)
    return np.asarray(np.minimum(against_s, slowest_s))

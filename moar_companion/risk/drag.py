"""Drag of a multirotor: deceleration by the air from the airspeed, and the inverse. Pure.

    b = (k + q |u|) u,    u = v - w

b: deceleration; u: velocity through the air; v, w: the aircraft's velocity and the wind's over
ground; k: `RiskModel.drag_per_s`, of the propellers; q: `RiskModel.drag_per_m`, of the body. All
vectors are level: north, east.
"""

from __future__ import annotations

import math

from ..settings.risk_model import RiskModel

Level = tuple[float, float]


def deceleration_mps2(air_ne_mps: Level, model: RiskModel) -> Level:
    """Deceleration by the air at this velocity through the air."""
    factor = model.drag_per_s + model.drag_per_m * math.hypot(*air_ne_mps)
    return factor * air_ne_mps[0], factor * air_ne_mps[1]


def air_velocity_mps(deceleration_ne_mps2: Level, model: RiskModel) -> Level:
    """Velocity through the air that causes this deceleration."""
    k, q = model.drag_per_s, model.drag_per_m
    # The root of q u^2 + k u = b, in the form that is valid for q = 0.
    factor = 2.0 / (k + math.sqrt(k * k + 4.0 * q * math.hypot(*deceleration_ne_mps2)))
    return factor * deceleration_ne_mps2[0], factor * deceleration_ne_mps2[1]

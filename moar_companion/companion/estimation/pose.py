"""Pose of the aircraft, jumps of its estimate, and setpoints: values in the site's frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ...types import Vector

_HOME_MOVES_M = 1.0
"""A home that moves by less than this keeps its route."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """Aircraft in the site's frame (x, y, z); its heading from north."""

    position_m: Vector
    velocity_mps: Vector
    yaw_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Jump:
    """Step of a reset estimator: the aircraft has not moved, its reported pose has."""

    step_m: Vector = (0.0, 0.0, 0.0)
    origin_step_m: Vector = (0.0, 0.0, 0.0)
    """Part of the step that the origin caused; in the local frame nothing moves by it."""
    turn_rad: float = 0.0
    """Step of the heading, to the right."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setpoint:
    """Setpoint: position and velocity in the site's frame, heading from north."""

    position_m: Vector
    velocity_mps: Vector
    yaw_rad: float


def home_moved(home_m: Vector | None, before_m: Vector | None, by_m: float = _HOME_MOVES_M) -> bool:
    """True if a home becomes known, or moves by more than `by_m`."""
    if home_m is None:
        return False
    return before_m is None or math.dist(home_m, before_m) > by_m

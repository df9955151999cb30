"""Where the aircraft is, and where it is told to be: values in the site's frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..types import Vector

_HOME_MOVES_M = 1.0
"""Nearer to where it was a home leads home by the same way."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Pose:
    """The aircraft in the site's frame (x, y, z); its heading from north."""

    position_m: Vector
    velocity_mps: Vector
    yaw_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Jump:
    """What the estimator was reset by: the aircraft is where it was, and told to be elsewhere."""

    step_m: Vector = (0.0, 0.0, 0.0)
    origin_step_m: Vector = (0.0, 0.0, 0.0)
    """What of the step is the origin's: in the local frame nothing has moved by that."""
    turn_rad: float = 0.0
    """Of the heading, to the right."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setpoint:
    """What is sent: position and velocity in the site's frame, heading from north."""

    position_m: Vector
    velocity_mps: Vector
    yaw_rad: float


def home_moved(home_m: Vector | None, before_m: Vector | None, by_m: float = _HOME_MOVES_M) -> bool:
    """Whether a home is known that was not before, or has moved by more than so much."""
    if home_m is None:
        return False
    return before_m is None or math.dist(home_m, before_m) > by_m

"""Where the aircraft is, and where it is told to be: values in the site's frame."""

from __future__ import annotations

from dataclasses import dataclass

from ..types import Vector


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
    turn_rad: float = 0.0
    """Of the heading, to the right."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Setpoint:
    """What is sent: position and velocity in the site's frame, heading from north."""

    position_m: Vector
    velocity_mps: Vector
    yaw_rad: float

"""What a wind does to a flight: an aircraft that is blown off takes its setpoint along on a leash.

Then it is drawn back no faster than it flies, until it has come to rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from ..types import Vector
from ..vehicle import Vehicle
from .motion import Pose

_DRAWN_S = 1.0
"""Both autopilots fly to a point at its distance over this: MPC_XY_P 0.95/s, PSC_POSXY_P 1/s."""
_RESTS_MPS, _RESTS_S = 0.5, 1.0
"""Slower for so long near its setpoint, an aircraft that was blown off holds again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """What a wind has done to the flight.

    from_m: where the setpoint was when the aircraft began to take it along; None while it holds.
    moved_to_m: where the aircraft is that has just moved it. carried: it stands where it was taken.
    lowest_m: the height from which it was taken, and below which it is taken nowhere that is too
    low. returns: it comes back by a recovery leg. rested_s: how long the aircraft is at rest.
    """

    from_m: Vector | None = None
    moved_to_m: Vector | None = None
    carried: bool = False
    lowest_m: float = math.inf
    returns: bool = False
    rested_s: float = 0.0

    def leash_m(self, vehicle: Vehicle) -> float:
        """How far the setpoint may be from the aircraft."""
        guidance = vehicle.guidance
        longest_m = max(guidance.leash_m, guidance.off_path_m)
        if self.from_m is None:
            return longest_m
        drawn_m = vehicle.speed.horizontal_mps * _DRAWN_S
        return min(longest_m, max(guidance.tracking_slow_m, drawn_m))

    def after(self, error_m: float, leash_m: float, pose: Pose, step_s: float) -> Drift:
        """The same a step later, in which the aircraft has not moved its setpoint."""
        rests = error_m <= leash_m and math.hypot(*pose.velocity_mps) <= _RESTS_MPS
        rested_s = self.rested_s + step_s if rests else 0.0
        over = self.from_m is None or rested_s >= _RESTS_S
        from_m = None if over else self.from_m
        return replace(self, from_m=from_m, moved_to_m=None, rested_s=rested_s)

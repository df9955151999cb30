"""The wind leash: the setpoint follows an aircraft in strong wind, at a maximum distance.

The distance then limits the speed of the return to the flight speed, until the aircraft rests.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from ...settings.vehicle import Vehicle
from ...types import Vector
from ..estimation.pose import Pose

_DRAWN_S = 1.0
"""Both autopilots approach a point at its distance over this: MPC_XY_P 0.95/s, PSC_POSXY_P 1/s."""
_RESTS_MPS, _RESTS_S = 0.5, 1.0
"""Maximum speed, and minimum time at it near the setpoint, after which the aircraft holds again."""


@dataclass(frozen=True, slots=True, kw_only=True)
class WindLeash:
    """Displacement of the setpoint by wind.

    from_m: the setpoint's place before the displacement; None while the aircraft holds.
    moved_to_m: the aircraft's position if it has just moved the setpoint. carried: the setpoint
    rests where the displacement left it. lowest_m: minimum setpoint height before displacements; a
    displaced setpoint may be this low. recovers: the flight returns by a recovery leg.
    rested_s: time for which the aircraft is at rest.
    """

    from_m: Vector | None = None
    moved_to_m: Vector | None = None
    carried: bool = False
    lowest_m: float = math.inf
    recovers: bool = False
    rested_s: float = 0.0

    def leash_m(self, vehicle: Vehicle) -> float:
        """Maximum distance from the setpoint to the aircraft, in metres."""
        guidance = vehicle.guidance
        longest_m = max(guidance.leash_m, guidance.off_path_m)
        if self.from_m is None:
            return longest_m
        drawn_m = vehicle.speed.horizontal_mps * _DRAWN_S
        return min(longest_m, max(guidance.tracking_slow_m, drawn_m))

    def pulled(self, place_m: Vector, pose: Pose, *, drifts: bool) -> WindLeash:
        """Returns the state after the aircraft has moved the setpoint from a place.

        drifts: by wind, beyond the leash; otherwise an obstacle was seen between the two.
        """
        return WindLeash(
            from_m=place_m if drifts and self.from_m is None else self.from_m,
            moved_to_m=pose.position_m,
            carried=True,
            lowest_m=min(self.lowest_m, place_m[2]),
        )

    def after(self, error_m: float, leash_m: float, pose: Pose, step_s: float) -> WindLeash:
        """Returns the state after a step without a displacement."""
        rests = error_m <= leash_m and math.hypot(*pose.velocity_mps) <= _RESTS_MPS
        rested_s = self.rested_s + step_s if rests else 0.0
        over = self.from_m is None or rested_s >= _RESTS_S
        from_m = None if over else self.from_m
        return replace(self, from_m=from_m, moved_to_m=None, rested_s=rested_s)

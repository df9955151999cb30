"""The tracker: reference of the aircraft on its trajectory, and the setpoint for it.

Progress follows the aircraft and not a clock. When the aircraft falls behind, the reference slows
down; when the aircraft is too far off, the reference stops. A gust delays the aircraft, and the
aircraft keeps its path. Inputs: the reference, the aircraft's position, the time step; output: the
next reference. In strong wind the setpoint follows the aircraft instead, on a leash.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...settings.vehicle import Guidance, Vehicle
from ...types import Vector
from ..estimation.pose import Pose
from .trajectory import FloatArray, Trajectory

_STAND_STILL = 2.0
"""Factor by which an error may brake the reference harder than its trajectory does."""
_ARRIVED_M = 0.005
_DRAWN_S = 1.0
"""Both autopilots approach a point at its distance over this: MPC_XY_P 0.95/s, PSC_POSXY_P 1/s."""
_RESTS_MPS, _RESTS_S = 0.5, 1.0
"""Maximum speed, and minimum time at it near the setpoint, after which the aircraft holds again."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Reference:
    """One instant of the trajectory that is followed.

    stop_m: distance at which the reference comes to rest; None: the end. offset_m, (3,), leads from
    the trajectory to the setpoint; it fades, and the reference waits for it. It is not zero only
    after the trajectory was moved under the setpoint.
    """

    trajectory: Trajectory
    distance_m: float = 0.0
    speed_mps: float = 0.0
    stop_m: float | None = None
    offset_m: FloatArray
    offset_rate_mps: FloatArray

    @classmethod
    def start(cls, trajectory: Trajectory, setpoint_m: Vector) -> Reference:
        """The reference at the start of a trajectory while the setpoint has not reached it."""
        return cls(
            trajectory=trajectory,
            offset_m=np.array(setpoint_m) - trajectory.position_m[0],
            offset_rate_mps=np.zeros(3),
        )

    def stopped_at(self, setpoint_m: Vector) -> Reference:
        """The reference at rest where it is on its trajectory, the setpoint at another place."""
        return replace(
            self,
            speed_mps=0.0,
            stop_m=self.distance_m,
            offset_m=np.array(setpoint_m) - self.trajectory.at(self.distance_m)[0],
            offset_rate_mps=np.zeros(3),
        )

    @cached_property
    def sample(self) -> tuple[FloatArray, FloatArray, float]:
        """Position (3,), direction (3,) and greatest speed of the trajectory here."""
        return self.trajectory.at(self.distance_m)

    @cached_property
    def position_m(self) -> FloatArray:
        """Position of the setpoint, (3,)."""
        return self.sample[0] + self.offset_m

    @cached_property
    def velocity_mps(self) -> FloatArray:
        """Velocity of the setpoint, (3,)."""
        return self.speed_mps * self.sample[1] + self.offset_rate_mps

    @property
    def arrived(self) -> bool:
        """True at the end of the trajectory."""
        return self.distance_m >= self.trajectory.length_m - _ARRIVED_M

    def stopping_m(self, acceleration_mps2: float) -> float:
        """The distance along the trajectory at which the reference can stop."""
        return self.distance_m + self.speed_mps**2 / (2.0 * acceleration_mps2)

    def braked(self, acceleration_mps2: float) -> Reference:
        """The reference that comes to rest as soon as the acceleration allows."""
        stop_m = min(self.stopping_m(acceleration_mps2), self.trajectory.length_m)
        return replace(self, stop_m=stop_m)


def advanced(
    reference: Reference,
    aircraft_m: Vector,
    guidance: Guidance,
    fade_mps: float,
    step_s: float,
    pace: float = 1.0,
) -> Reference:
    """The reference after `step_s`; `fade_mps` is the rate at which an offset may fade.

    pace: the part of the trajectory's speed that is allowed.
    """
    offset = _faded(reference, fade_mps, step_s)
    trajectory, speed = reference.trajectory, reference.speed_mps
    _, _, allowed = reference.sample
    end_m = trajectory.length_m
    if reference.stop_m is not None:
        end_m = reference.stop_m
        left_m = max(0.0, end_m - reference.distance_m)
        allowed = min(allowed, math.sqrt(2.0 * guidance.acceleration_mps2 * left_m))
    error_m = math.dist(reference.position_m, aircraft_m)
    room = guidance.tracking_hold_m - guidance.tracking_slow_m
    allowed *= pace * min(1.0, max(0.0, (guidance.tracking_hold_m - error_m) / room))
    if offset.offset_m.any():
        allowed = 0.0
    step_mps = guidance.acceleration_mps2 * step_s
    speed = min(speed + step_mps, max(allowed, speed - _STAND_STILL * step_mps))
    return replace(
        offset,
        distance_m=min(reference.distance_m + speed * step_s, end_m),
        speed_mps=speed,
    )


def _faded(reference: Reference, fade_mps: float, step_s: float) -> Reference:
    """The reference with its offset shortened by one step."""
    offset = reference.offset_m
    length = float(np.sqrt(offset @ offset))
    step = fade_mps * step_s
    if length <= step:
        return replace(reference, offset_m=np.zeros(3), offset_rate_mps=np.zeros(3))
    return replace(
        reference,
        offset_m=offset * (1.0 - step / length),
        offset_rate_mps=offset * (-fade_mps / length),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class WindLeash:
    """Displacement of the setpoint by wind: it follows the aircraft at a maximum distance.

    The distance then limits the speed of the return to the flight speed, until the aircraft rests.

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

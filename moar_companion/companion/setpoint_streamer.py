"""Setpoint streamer: sends the setpoints that the gate passes, and keeps the last one."""

from __future__ import annotations

import math
from dataclasses import astuple, replace
from typing import NamedTuple

from ..mavlink.session import Session
from ..planner.site import Margin
from ..settings.config import Supervision
from ..settings.vehicle import Vehicle
from ..texts.text_format import distance
from ..types import Vector
from .estimation.plane_to_local import PlaneToLocal
from .estimation.pose import Jump, Setpoint
from .estimation.pose_tracker import FOLLOWS_MPS
from .guidance.path_follower import PathFollower
from .safety.setpoint_gate import Refusal, motion_refusal

_ROUNDING_M = 1e-6


class SetpointRefusal(NamedTuple):
    """A setpoint that was not sent, why, and when.

    narrow: only the margin, or the position's uncertainty, forbids it. rest: the setpoint sent
    instead, the last one at rest; None if that is forbidden too, and the stream has to end.
    """

    why: Refusal
    narrow: bool
    rest: Setpoint | None
    time_s: float


class _Speeds(NamedTuple):
    """Limits of a setpoint's speed, and of its move over to a path."""

    greatest_mps: float
    least_mps: float


class SetpointStreamer:
    """Checks every setpoint, sends it, and keeps the last one.

    sudden_m: depth in a keep-out at which it may rest before an obstacle that was seen late.
    """

    def __init__(
        self,
        session: Session,
        vehicle: Vehicle,
        limits: Supervision,
        margin: Margin,
        sudden_m: float,
    ) -> None:
        self._sudden_m = sudden_m
        self._session = session
        self._last: Setpoint | None = None
        self._permitted = _Speeds(0.0, 0.0)
        """Limits of the next setpoint: greater than the vehicle's while it slows down to these."""
        self.take_settings(vehicle, limits, margin)
        self.widened_m = 0.0
        """Current inflation of obstacles."""
        self._last_ned_m: Vector = (0.0, 0.0, 0.0)
        """Position of the last setpoint in the autopilot's frame."""
        self._last_s = -math.inf
        self._jumped_m: Vector = (0.0, 0.0, 0.0)
        """Jump of the estimate since a setpoint last moved."""
        self._unsent_last: tuple[Setpoint, float] | None = None
        """Last setpoint at rest of a cycle whose output was not sent, and the cycle's time."""
        self.last_refusal: SetpointRefusal | None = None

    def take_settings(self, vehicle: Vehicle, limits: Supervision, margin: Margin) -> None:
        """Takes the settings in force; the present setpoint may be faster, and slows down."""
        self._vehicle, self._limits, self._margin = vehicle, limits, margin
        self._speeds = _Speeds(max(astuple(vehicle.speed)), vehicle.speed.min_mps)
        before = self._speeds if self._last is None else self._permitted
        self._permitted = _Speeds(*map(max, self._speeds, before))

    def send(
        self, setpoint: Setpoint, flight: PathFollower, plane: PlaneToLocal, now_s: float
    ) -> SetpointRefusal | None:
        """Sends a flight's setpoint of the site's frame, or returns the reason for its refusal.

        After a refusal the last setpoint is sent at rest: as a hold, if it passes the checks. If it
        fails, for whatever reason (a jump, a seen obstacle, another fence), it is sent too, as the
        end of the stream. The aircraft is where that setpoint was accepted, and without it the
        autopilot would fly on with the velocity of that setpoint.
        """
        # Inside the margin a setpoint is only narrow: a small jump of the estimate may cause it.
        margin_m = flight.path.volume.site.margin.total_m
        misplaced = self._place_refusal(setpoint, flight, -margin_m)
        why = misplaced or self._motion_refusal(setpoint, flight, plane, now_s)
        narrow = not why and bool(self._place_refusal(setpoint, flight, self.widened_m))
        if misplaced is not None and flight.seen_late:
            narrow, why = True, Refusal("no room here, an obstacle is seen")
        elif narrow:
            cause, needed_m = "margin", margin_m
            if self.widened_m:
                cause, needed_m = "uncertainty", self._margin.position_m + self.widened_m
            why = Refusal(f"no room here, {cause} {distance(needed_m)} m", needed_m, unit="m")
        if why is None:
            self._pass(setpoint, plane.position_to_ned(setpoint.position_m), plane, now_s)
            return None
        rest = self.rest(flight, plane, now_s)
        if rest is None and self._rest is not None:
            self._pass(self._rest, self._last_ned_m, plane, now_s)
        self.last_refusal = SetpointRefusal(why=why, narrow=narrow, rest=rest, time_s=now_s)
        return self.last_refusal

    def rest(self, flight: PathFollower, plane: PlaneToLocal, now_s: float) -> Setpoint | None:
        """Sends the last setpoint's position, at rest; None if that must not be sent."""
        rest = self._rest
        if rest is None:
            return None
        if self._place_refusal(rest, flight, self.widened_m) is not None:
            return None
        self._pass(rest, self._last_ned_m, plane, now_s)
        return rest

    def send_last_setpoint(self, flight: PathFollower, plane: PlaneToLocal, now_s: float) -> None:
        """Sends the last setpoint at rest; keeps it until the cycle's output is sent."""
        rest = self.rest(flight, plane, now_s)
        self._unsent_last = None if rest is None else (rest, now_s)

    def note_sent(self) -> None:
        """Notes that the output of the last cycle was sent."""
        self._unsent_last = None

    def resend_last_setpoint(self, plane: PlaneToLocal, now_s: float) -> None:
        """Sends the pending last setpoint again, while the aircraft is still near its position."""
        if self._unsent_last is None:
            return
        last_setpoint, said_s = self._unsent_last
        if said_s < now_s <= said_s + self._limits.position_timeout_s:
            self._pass(last_setpoint, plane.position_to_ned(last_setpoint.position_m), plane, now_s)

    @property
    def _rest(self) -> Setpoint | None:
        return None if self._last is None else replace(self._last, velocity_mps=(0.0, 0.0, 0.0))

    def shift(self, jump: Jump, plane: PlaneToLocal | None) -> None:
        """Shifts the last setpoint by a jump of the estimate.

        In the autopilot's frame, by the part that is not the origin's.
        """
        if plane is not None:
            own_m = _plus(jump.step_m, jump.origin_step_m, -1.0)
            self._last_ned_m = _plus(self._last_ned_m, plane.velocity_to_ned(own_m))
        if self._last is not None:
            self._jumped_m = _plus(self._jumped_m, jump.step_m)
            self._last = _shifted(self._last, jump)
        if self._unsent_last is not None:
            self._unsent_last = (_shifted(self._unsent_last[0], jump), self._unsent_last[1])

    def end(self) -> None:
        """Ends the stream: there is no last setpoint any more."""
        self._last = None
        self._jumped_m = (0.0, 0.0, 0.0)

    def _place_refusal(
        self, setpoint: Setpoint, flight: PathFollower, widened_m: float
    ) -> Refusal | None:
        """Reason why a setpoint's position is forbidden; widened_m: inflation of obstacles.

        At rest, a position is allowed if only a jump, no greater than the margin, has put it there.
        It may be outside a leg's corridor or the workspace, but not inside an obstacle's keep-out.
        The aircraft is at that position.
        """
        tolerance_m = self._limits.plane_tolerance_m
        refused = flight.refusal(setpoint, tolerance_m, widened_m, self._sudden_m)
        jumped = 0.0 < math.hypot(*self._jumped_m) <= self._margin.total_m
        at_rest = not any(setpoint.velocity_mps)
        near = abs(setpoint.position_m[1]) <= tolerance_m
        if (
            refused is not None
            and jumped
            and at_rest
            and near
            and flight.path.volume.keeps_clear(setpoint.position_m)
        ):
            return None
        return refused

    def _motion_refusal(
        self, setpoint: Setpoint, flight: PathFollower, plane: PlaneToLocal, now_s: float
    ) -> Refusal | None:
        """Reason why a setpoint must not follow the last one, or begin the stream.

        The vehicle's limits apply in the world and in the autopilot's frame, also when the map
        between the two moves; not to the slow move by which it follows the line.
        """
        last, drifting_at_m = self._last, flight.drifting_at_m

        def refusal(
            before_m: Vector, after_m: Vector, drifting_at_m: Vector | None
        ) -> Refusal | None:
            return motion_refusal(
                None if last is None else (before_m, last.velocity_mps),
                (after_m, setpoint.velocity_mps),
                now_s - self._last_s,
                greatest_mps=self._permitted.greatest_mps,
                least_mps=self._permitted.least_mps,
                acceleration_mps2=self._vehicle.guidance.acceleration_mps2,
                drifting_at_m=drifting_at_m,
            )

        before_m = setpoint.position_m if last is None else last.position_m
        refused = refusal(before_m, setpoint.position_m, drifting_at_m)
        after_ned_m = plane.position_to_ned(setpoint.position_m)
        if refused is not None or drifting_at_m is not None:
            return refused
        before_ned_m = plane.position_to_ned(before_m)
        followed_m = FOLLOWS_MPS * (now_s - self._last_s) + _ROUNDING_M
        if math.dist(before_ned_m, self._last_ned_m) > followed_m:
            before_ned_m = self._last_ned_m
        refused = refusal(before_ned_m, after_ned_m, None)
        return None if refused is None else refused._replace(reason=f"NED {refused.reason}")

    def _pass(
        self, setpoint: Setpoint, place_ned_m: Vector, plane: PlaneToLocal, now_s: float
    ) -> None:
        """Sends SET_POSITION_TARGET_LOCAL_NED. place_ned_m: the setpoint's in the local frame."""
        self._last, self._last_s, self._last_ned_m = setpoint, now_s, place_ned_m
        if math.hypot(*setpoint.velocity_mps) <= self._speeds.greatest_mps:
            self._permitted = self._speeds
        if any(setpoint.velocity_mps):
            self._jumped_m = (0.0, 0.0, 0.0)
        self._session.send_setpoint(
            place_ned_m,
            plane.velocity_to_ned(setpoint.velocity_mps),
            setpoint.yaw_rad,
            now_s,
        )


def _shifted(setpoint: Setpoint, jump: Jump) -> Setpoint:
    """Returns the same place and heading in an estimate that has jumped."""
    yaw_rad = math.remainder(setpoint.yaw_rad + jump.turn_rad, math.tau)
    return replace(setpoint, position_m=_plus(setpoint.position_m, jump.step_m), yaw_rad=yaw_rad)


def _plus(one_m: Vector, other_m: Vector, times: float = 1.0) -> Vector:
    x_m, y_m, z_m = (one + times * other for one, other in zip(one_m, other_m, strict=True))
    return x_m, y_m, z_m

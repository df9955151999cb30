"""Pose tracker: pose of the aircraft and jumps of its estimate; telemetry in, values out.

With a lidar the pose is in the line's frame: to the autopilot's estimate the offset is added that
the wires show (`perception/line_offset`). What is sent to the autopilot has it taken off again.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

from ...mavlink.telemetry import Attitude, Telemetry
from ...perception.perception_report import LineOffset
from ...planner.site import PlanePoint, Site
from ...types import AutopilotKind, GeodeticPoint, Vector
from .frame_agreement import FrameAgreement
from .landed_state import grounded
from .plane_to_local import PlaneToLocal
from .pose import Jump, Pose

_JUMP_M = 0.5
"""A position farther than this from the velocity's prediction has jumped: the estimator was
reset. In flight PX4's own estimate wanders by centimetres."""
_RESET_JUMP_M = 0.1
"""Least step of a jump with a reported reset of the estimator. In PX4's recordings the position
moves by up to 0.02 m when only the heading is reset."""
_RESET_WITHIN_S = 0.3
"""Time between a position step and the report of the reset: ODOMETRY comes at 5 Hz or more."""
_JUMPS_WITHIN_S = 10.0
_TURN_RAD = 0.1
"""Step of the heading beyond the turn rate's prediction that means a reset. In recordings of both
autopilots up to 0.05 rad of a turn are left; when its receiver was back, PX4's heading was reset by
0.43."""
_TURN_WITHIN_S = 0.2
"""ATTITUDE comes at 20 Hz or more, on a slow link at 10: over longer times rates are too coarse."""
FOLLOWS_MPS = 0.3
"""Greatest speed of the offset in flight: that of a drift. Setpoints move with it."""
_SLOWLY_M = 0.5
"""Greatest change of the offset that is followed slowly."""
_WINDOW_S = 5.0
"""Length of a window; the latest two count. PX4's simulator clock is 1 % slow: 0.1 s in both."""
_MOST_JUMPS = 100
"""Maximum number of jumps kept, of an estimator that jumps continuously."""


class PoseTracker:
    """Reads telemetry for a companion on a site.

    kind: the autopilot whose projection its local frame has; None: taken from its heartbeat.
    Keeps the map between the two frames, and the time when the position last advanced. Jumps,
    origin and times are those of the estimate; what is offered is in the line's frame.
    """

    def __init__(self, site: Site | None, kind: AutopilotKind | None) -> None:
        self._site = site
        self._kind = kind
        self._plane: PlaneToLocal | None = None
        self._plane_of: tuple[GeodeticPoint, AutopilotKind] | None = None
        self._telemetry: Telemetry | None = None
        self._pose: Pose | None = None
        self._attitude: Attitude | None = None
        self._home_m: Vector | None = None
        self.agreement = FrameAgreement()
        """Agreement of the local position with its origin, the global one, and home."""
        self._position_boot_s = -math.inf
        self._position_moved_s = -math.inf
        self._position_late_s = 0.0
        self._clock_ahead_s = math.inf
        """Lead of our clock over the position's clock, when the fastest position arrived."""
        self._recent_ahead_s = (math.inf, math.inf)
        """Lead of our clock in the window before the present one, and in the present one."""
        self._window_s = -math.inf
        """Start of the present window."""
        self._jumps: deque[tuple[float, float]] = deque(maxlen=_MOST_JUMPS)
        self.jumped_by_m: Vector = (0.0, 0.0, 0.0)
        """Sum of the estimate's jumps."""
        self.offset_m: PlanePoint = (0.0, 0.0)
        """Offset (x, z) of the line's frame that is added to the estimate."""
        self._by_line = False
        """True while the line shows where the aircraft is, whatever the estimate does."""
        self._shown: tuple[PlaneToLocal | None, Pose | None, Vector | None] = (None, None, None)
        """Map, pose and home in the line's frame."""
        self._reset_counter: int | None = None
        self._reset_s = -math.inf
        self._step: tuple[float, Vector] | None = None
        """Time and size of the last position step that the velocity does not explain."""

    def take_site(self, site: Site) -> None:
        """Takes the site; the next update gives the pose on it, also by the same telemetry."""
        self._site, self._plane, self._pose, self._telemetry = site, None, None, None
        self._show()

    @property
    def plane(self) -> PlaneToLocal | None:
        """Map from the site's frame to the autopilot's."""
        return self._shown[0]

    @property
    def pose(self) -> Pose | None:
        """Pose of the aircraft in the site's frame; None while that is unknown."""
        return self._shown[1]

    @property
    def home_m(self) -> Vector | None:
        """Home of the autopilot in the site's frame; None while that is unknown."""
        return self._shown[2]

    @property
    def estimate(self) -> Pose | None:
        """Pose by the autopilot alone, in the site's frame as surveyed."""
        return self._pose

    def follow_line(
        self, line: LineOffset, step_s: float, *, fresh: bool, at_once: bool
    ) -> Jump | None:
        """Moves the offset to where the line shows it; returns the jump of the pose by it.

        In flight a small change is followed slowly. A larger one is taken as a jump of the site's
        frame: nothing moves in the autopilot's. fresh: the line is seen now; otherwise the last
        offset stays.
        """
        self._by_line = fresh
        if not fresh:
            return None
        away_m = self._away_m(line)
        length_m = math.hypot(*away_m)
        if not length_m:
            return None
        whole = at_once or length_m > _SLOWLY_M
        share = 1.0 if whole else min(1.0, FOLLOWS_MPS * step_s / length_m)
        self._move_offset(share * away_m[0], share * away_m[1])
        self._show()
        step_m = (away_m[0], 0.0, away_m[1])
        return Jump(step_m=step_m, origin_step_m=step_m) if whole else None

    def lag_m(self, line: LineOffset) -> float:
        """Distance from the offset to where the line shows it."""
        return math.hypot(*self._away_m(line))

    def _away_m(self, line: LineOffset) -> PlanePoint:
        missed = _difference(self.jumped_by_m, line.jumped_m)
        return (
            line.offset_m[0] - missed[0] - self.offset_m[0],
            line.offset_m[1] - missed[2] - self.offset_m[1],
        )

    def _move_offset(self, x_m: float, z_m: float) -> None:
        self.offset_m = self.offset_m[0] + x_m, self.offset_m[1] + z_m

    def _show(self) -> None:
        """Makes map, pose and home in the line's frame."""
        (x_m, z_m), plane, pose, home_m = self.offset_m, self._plane, self._pose, self._home_m
        if x_m or z_m:
            step_m = (x_m, 0.0, z_m)
            plane = None if plane is None else plane.moved(x_m, z_m)
            pose = None if pose is None else replace(pose, position_m=_sum(pose.position_m, step_m))
            home_m = None if home_m is None else _sum(home_m, step_m)
        self._shown = plane, pose, home_m

    def update(self, telemetry: Telemetry) -> Jump | None:
        """Takes new telemetry. Returns the jump of position and heading, if there was one."""
        if telemetry is self._telemetry:
            return None
        self._telemetry = telemetry
        before, self._attitude = self._attitude, telemetry.attitude
        turn_rad = _reset_turn_rad(before, self._attitude)
        if telemetry.autopilot is not None:
            kind = self._kind or telemetry.autopilot.kind
            self.agreement.update(telemetry, kind, grounded=grounded(telemetry))
        origin_step_m = self._update_origin(telemetry)
        step_m = self._update_position(telemetry, origin_step_m)
        own_m = (0.0, 0.0, 0.0) if step_m is None else step_m
        whole_m = _sum(origin_step_m, own_m)
        self.jumped_by_m = _sum(self.jumped_by_m, whole_m)
        if self._by_line and any(whole_m):
            # The line stays where it is: the estimate moves in it, and what is sent with it.
            self._move_offset(-whole_m[0], -whole_m[2])
            whole_m = (0.0, whole_m[1], 0.0)
            origin_step_m = (-own_m[0], origin_step_m[1], -own_m[2])
        self._show()
        if not any(whole_m) and not any(origin_step_m) and not turn_rad:
            return None
        return Jump(step_m=whole_m, origin_step_m=origin_step_m, turn_rad=turn_rad)

    def _update_origin(self, telemetry: Telemetry) -> Vector:
        """Updates the map. Returns the aircraft's jump in the site's frame that it causes."""
        before, self._plane = self._plane, self._plane_to_local(telemetry)
        still, origin = (0.0, 0.0, 0.0), telemetry.local_origin
        if before is self._plane or before is None or self._plane is None:
            return still
        if self._pose is None or origin is None:
            return still
        old_m = self._pose.position_m
        new_m = self._plane.position_from_ned(before.position_to_ned(old_m))
        step_m = _difference(new_m, old_m)
        self._note_jump(origin.received_s, step_m)
        return step_m

    def _update_position(self, telemetry: Telemetry, origin_step_m: Vector) -> Vector | None:
        """Updates the pose. Returns the jump of the estimate, if there was one."""
        before, boot_before_s = self._pose, self._position_boot_s
        position = telemetry.local_position
        if position is not None and position.boot_s != self._position_boot_s:
            # A failed estimator may repeat its last message: only its own clock reveals that.
            ahead_s = position.received_s - position.boot_s
            restarted = position.boot_s < self._position_boot_s
            self._clock_ahead_s = ahead_s if restarted else min(self._clock_ahead_s, ahead_s)
            self._position_late_s = ahead_s - self._clock_ahead_s
            before_s, recent_s = self._recent_ahead_s
            if restarted or position.received_s - self._window_s > _WINDOW_S:
                self._window_s = position.received_s
                before_s, recent_s = math.inf if restarted else recent_s, math.inf
            self._recent_ahead_s = before_s, min(recent_s, ahead_s)
            self._position_boot_s = position.boot_s
            self._position_moved_s = position.received_s
        self._pose = self._pose_of(telemetry)
        home = telemetry.home
        if home is not None and self._plane is not None:
            self._home_m = self._plane.position_from_ned(home.position_ned_m)
        self._detect_reset(telemetry)
        if before is None or self._pose is None or position is None:
            return None
        carried = replace(before, position_m=_sum(before.position_m, origin_step_m))
        step_m = _unexplained(carried, self._pose, self._position_boot_s - boot_before_s)
        if math.hypot(*step_m) > _RESET_JUMP_M:
            self._step = (position.received_s, step_m)
        return self._jump()

    @property
    def position_moved_s(self) -> float:
        """Time when the position, by its own clock, last advanced."""
        return self._position_moved_s

    @property
    def position_late_s(self) -> float:
        """Delay of the last position relative to the fastest one, by its own clock.

        Both clocks are taken to run equally fast.
        """
        return self._position_late_s

    def received_s(self, boot_s: float) -> float | None:
        """Time on our clock at which the autopilot's clock was at `boot_s`; None while unknown.

        As for the fastest position of the last ten seconds: a delay on the link does not count, and
        clocks that run apart do not either.
        """
        ahead_s = min(self._recent_ahead_s)
        return boot_s + ahead_s if math.isfinite(ahead_s) else None

    def jumped_m(self, now_s: float) -> float:
        """Total length of the position's jumps within the last 10 s, there and back."""
        return sum(
            length_m for time_s, length_m in self._jumps if now_s - time_s <= _JUMPS_WITHIN_S
        )

    def _detect_reset(self, telemetry: Telemetry) -> None:
        odometry = telemetry.odometry
        if odometry is None or odometry.reset_counter == self._reset_counter:
            return
        if self._reset_counter is not None:
            self._reset_s = odometry.received_s
        self._reset_counter = odometry.reset_counter

    def _jump(self) -> Vector | None:
        """Returns the last step if it is long enough for a jump, or if a reset accompanied it."""
        if self._step is None:
            return None
        step_s, step_m = self._step
        length_m = math.hypot(*step_m)
        if length_m <= _JUMP_M and abs(step_s - self._reset_s) > _RESET_WITHIN_S:
            return None
        self._step = None
        self._note_jump(step_s, step_m)
        return step_m

    def _note_jump(self, time_s: float, step_m: Vector) -> None:
        """Notes a jump; by the line, which shows the others, that across the plane alone."""
        length_m = abs(step_m[1]) if self._by_line else math.hypot(*step_m)
        if length_m:
            self._jumps.append((time_s, length_m))

    def _plane_to_local(self, telemetry: Telemetry) -> PlaneToLocal | None:
        """Returns the map; makes a new one when the estimator's origin moves."""
        origin, autopilot = telemetry.local_origin, telemetry.autopilot
        if self._site is None or origin is None or autopilot is None:
            return None
        plane_of = (origin.point, self._kind or autopilot.kind)
        if self._plane is None or self._plane_of != plane_of:
            self._plane_of = plane_of
            return PlaneToLocal.between(self._site.frame, *plane_of)
        return self._plane

    def _pose_of(self, telemetry: Telemetry) -> Pose | None:
        plane, position, attitude = self._plane, telemetry.local_position, telemetry.attitude
        if plane is None or position is None or attitude is None:
            return None
        return Pose(
            position_m=plane.position_from_ned(position.position_ned_m),
            velocity_mps=plane.velocity_from_ned(position.velocity_ned_mps),
            yaw_rad=attitude.yaw_rad,
        )


def _unexplained(before: Pose, now: Pose, elapsed_s: float) -> Vector:
    """Part of a step in position that the velocities do not explain."""
    step = _difference(now.position_m, before.position_m)
    moved = [
        0.5 * (new + old) * max(0.0, elapsed_s)
        for new, old in zip(now.velocity_mps, before.velocity_mps, strict=True)
    ]
    x_m, y_m, z_m = (whole - part for whole, part in zip(step, moved, strict=True))
    return x_m, y_m, z_m


def _sum(one_m: Vector, other_m: Vector) -> Vector:
    x_m, y_m, z_m = (one + other for one, other in zip(one_m, other_m, strict=True))
    return x_m, y_m, z_m


def _difference(after_m: Vector, before_m: Vector) -> Vector:
    x_m, y_m, z_m = (after - before for after, before in zip(after_m, before_m, strict=True))
    return x_m, y_m, z_m


def _reset_turn_rad(before: Attitude | None, now: Attitude | None) -> float:
    """Step in heading that the turn rates do not explain; 0 without one."""
    if before is None or now is None or before.boot_s is None or now.boot_s is None:
        return 0.0
    if before.yaw_rate_radps is None or now.yaw_rate_radps is None:
        return 0.0
    elapsed_s = now.boot_s - before.boot_s
    if not 0.0 < elapsed_s <= _TURN_WITHIN_S:
        return 0.0
    turned_rad = 0.5 * (before.yaw_rate_radps + now.yaw_rate_radps) * elapsed_s
    turn_rad = math.remainder(now.yaw_rad - before.yaw_rad - turned_rad, math.tau)
    return turn_rad if abs(turn_rad) > _TURN_RAD else 0.0

"""Where the aircraft is, and what stands against flying it: telemetry in, values out."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..config import Supervision
from ..frames import PlaneToLocal
from ..planner.maps import Maps
from ..site import Site
from ..types import AutopilotKind, GeodeticPoint, LandedState, Telemetry, Vector
from .flight import Pose

_ATTITUDE_TIMEOUT_S = 1.0
"""ATTITUDE comes at 100 Hz, at 10 Hz on a slow link."""
_LANDED_TIMEOUT_S = 5.0
"""EXTENDED_SYS_STATE comes at 5 Hz; on a slow link at less than 1 Hz."""
_JUMP_M = 0.5
"""A position that is farther than this from where the velocity leads has jumped: the estimator
was reset, or its origin moved. In flight PX4's own estimate wanders by centimetres."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """What a companion that plans needs to know of its site."""

    site: Site
    maps: Maps


class Surroundings:
    """Reads telemetry for a companion on a site.

    kind: the autopilot whose projection its local frame has; None: taken from its heartbeat.
    Remembers the map between the two frames, and when the position last moved on.
    """

    def __init__(self, site: Site | None, kind: AutopilotKind | None, limits: Supervision) -> None:
        self._site = site
        self._kind = kind
        self._limits = limits
        self._plane: PlaneToLocal | None = None
        self._plane_of: tuple[GeodeticPoint, AutopilotKind] | None = None
        self._looked_at: Telemetry | None = None
        self._pose: Pose | None = None
        self._position_boot_s = -math.inf
        self._position_moved_s = -math.inf

    @property
    def plane(self) -> PlaneToLocal | None:
        """The map from the site's frame to the autopilot's."""
        return self._plane

    @property
    def pose(self) -> Pose | None:
        """The aircraft in the site's frame; None while that is unknown."""
        return self._pose

    def look(self, telemetry: Telemetry) -> Vector | None:
        """Take in new telemetry. Returns how far the position jumped, if it did."""
        if telemetry is self._looked_at:
            return None
        self._looked_at = telemetry
        before, boot_before_s = self._pose, self._position_boot_s
        position = telemetry.local_position
        if position is not None and position.boot_s != self._position_boot_s:
            # A dead estimator may repeat its last words: only its own clock shows that it lives.
            self._position_boot_s = position.boot_s
            self._position_moved_s = position.received_s
        self._plane = self._plane_to_local(telemetry)
        self._pose = self._pose_of(telemetry)
        if before is None or self._pose is None:
            return None
        elapsed_s = self._position_boot_s - boot_before_s
        return _jump(before, self._pose, elapsed_s)

    def obstruction(
        self, telemetry: Telemetry, *, control_allowed: bool, now_s: float
    ) -> str | None:
        """Why nothing may be streamed now; None when nothing stands against it."""
        autopilot, attitude = telemetry.autopilot, telemetry.attitude
        if autopilot is None:
            return "no autopilot is heard"
        if not control_allowed:
            return "two autopilots are heard"
        if now_s - autopilot.received_s > self._limits.heartbeat_timeout_s:
            return f"no heartbeat of the autopilot for {now_s - autopilot.received_s:.1f} s"
        if telemetry.local_position is None:
            return "no local position is heard"
        if now_s - self._position_moved_s > self._limits.position_timeout_s:
            return f"the position is {now_s - self._position_moved_s:.1f} s old"
        if attitude is None or now_s - attitude.received_s > _ATTITUDE_TIMEOUT_S:
            return "the attitude is unknown"
        if self._pose is None:
            return "the origin of the local frame is unknown"
        return None

    def reluctance(self) -> str | None:
        """Why nothing may be begun now, though what is flown may go on."""
        limit_m = self._limits.plane_tolerance_m
        if self._pose is None or abs(self._pose.position_m[1]) <= limit_m:
            return None
        return f"{abs(self._pose.position_m[1]):.1f} m from the plane, more than {limit_m:g} m"

    def _plane_to_local(self, telemetry: Telemetry) -> PlaneToLocal | None:
        """The map, made anew when the estimator's origin moves."""
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


def _jump(before: Pose, now: Pose, elapsed_s: float) -> Vector | None:
    """What of a step in position the velocities do not explain; None when it is small."""
    step = [new - old for new, old in zip(now.position_m, before.position_m, strict=True)]
    moved = [
        0.5 * (new + old) * max(0.0, elapsed_s)
        for new, old in zip(now.velocity_mps, before.velocity_mps, strict=True)
    ]
    x_m, y_m, z_m = (whole - part for whole, part in zip(step, moved, strict=True))
    return (x_m, y_m, z_m) if math.hypot(x_m, y_m, z_m) > _JUMP_M else None


def airborne(telemetry: Telemetry, now_s: float) -> bool:
    """Armed, and known to be in the air; not while it takes off."""
    autopilot, landed = telemetry.autopilot, telemetry.landed
    return (
        autopilot is not None
        and autopilot.armed
        and landed is not None
        and now_s - landed.received_s <= _LANDED_TIMEOUT_S
        and landed.state in {LandedState.IN_AIR, LandedState.LANDING}
    )


def grounded(telemetry: Telemetry) -> bool:
    """Disarmed, or known to be on the ground; unknown is neither."""
    autopilot, landed = telemetry.autopilot, telemetry.landed
    if autopilot is not None and not autopilot.armed:
        return True
    return landed is not None and landed.state is LandedState.ON_GROUND

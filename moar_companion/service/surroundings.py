"""Where the aircraft is, and what stands against flying it: telemetry in, values out."""

from __future__ import annotations

from ..config import Supervision
from ..frames import PlaneToLocal
from ..site import Site
from ..types import AutopilotKind, GeodeticPoint, LandedState, Telemetry
from .flight import Pose


class Surroundings:
    """Reads telemetry for a companion on a site; keeps the map between the two frames.

    kind: the autopilot whose projection its local frame has; None: taken from its heartbeat.
    """

    def __init__(self, site: Site | None, kind: AutopilotKind | None, limits: Supervision) -> None:
        self._site = site
        self._kind = kind
        self._limits = limits
        self._plane: PlaneToLocal | None = None
        self._plane_of: tuple[GeodeticPoint, AutopilotKind] | None = None

    def plane(self, telemetry: Telemetry) -> PlaneToLocal | None:
        """The map from the site's frame to the autopilot's, made anew when its origin moves."""
        origin, autopilot = telemetry.local_origin, telemetry.autopilot
        if self._site is None or origin is None or autopilot is None:
            return None
        plane_of = (origin.point, self._kind or autopilot.kind)
        if self._plane_of != plane_of:
            self._plane = PlaneToLocal.between(self._site.frame, *plane_of)
            self._plane_of = plane_of
        return self._plane

    def pose(self, telemetry: Telemetry) -> Pose | None:
        """The aircraft in the site's frame; None while that is unknown."""
        plane = self.plane(telemetry)
        position, attitude = telemetry.local_position, telemetry.attitude
        if plane is None or position is None or attitude is None:
            return None
        return Pose(
            position_m=plane.position_from_ned(position.position_ned_m),
            velocity_mps=plane.velocity_from_ned(position.velocity_ned_mps),
            yaw_rad=attitude.yaw_rad,
        )

    def obstruction(
        self, telemetry: Telemetry, *, control_allowed: bool, now_s: float
    ) -> str | None:
        """Why nothing may be streamed now; None when nothing stands against it."""
        autopilot, position = telemetry.autopilot, telemetry.local_position
        if autopilot is None:
            return "no autopilot is heard"
        if not control_allowed:
            return "two autopilots are heard"
        if now_s - autopilot.received_s > self._limits.heartbeat_timeout_s:
            return f"no heartbeat of the autopilot for {now_s - autopilot.received_s:.1f} s"
        if position is None:
            return "no local position is heard"
        if now_s - position.received_s > self._limits.position_timeout_s:
            return f"the position is {now_s - position.received_s:.1f} s old"
        if self.pose(telemetry) is None:
            return "the origin of the local frame, or the attitude, is unknown"
        return None

    def reluctance(self, telemetry: Telemetry) -> str | None:
        """Why nothing may be begun now, though what is flown may go on."""
        pose = self.pose(telemetry)
        limit_m = self._limits.plane_tolerance_m
        if pose is None or abs(pose.position_m[1]) <= limit_m:
            return None
        return f"{abs(pose.position_m[1]):.1f} m from the plane, more than {limit_m:g} m"


def airborne(telemetry: Telemetry) -> bool:
    """Armed, and in the air by EXTENDED_SYS_STATE; not while it takes off."""
    autopilot = telemetry.autopilot
    return (
        autopilot is not None
        and autopilot.armed
        and telemetry.landed_state in {LandedState.IN_AIR, LandedState.LANDING}
    )

"""Frame agreement: local position, global position and home of an autopilot against each other."""

from __future__ import annotations

import math

from ...mavlink.autopilots import profile
from ...mavlink.telemetry import GlobalPosition, Home, LocalOrigin, Telemetry
from ...types import UNKNOWN, AutopilotKind, GeodeticPoint

_COMPARABLE_S = 0.3
"""Maximum difference of the stamps of local and global position. GLOBAL_POSITION_INT comes at 5 Hz
or more; the local position is extrapolated by its velocity over this time."""


class FrameAgreement:
    """Tracks the origin, and compares the local position with other reports.

    Only the origin, which a message reports, gives the local position a place in the world. That
    place is compared with the global position, and with home where the autopilot derives both its
    coordinates from one another. The origin moved in none of 31 recordings of both autopilots.
    """

    def __init__(self) -> None:
        self.global_off_m: float | None = None
        """Distance from the local position, by its origin, to the global one, when last compared.

        None before that. Silence of either changes nothing."""
        self.home_off_m: float | None = None
        """Distance of home's two coordinates; None, too, where the autopilot keeps them apart."""
        self.origin_moved_m = 0.0
        """Move of the origin since the flight began, or since it was last accepted."""
        self._kind = UNKNOWN
        self._accepted: GeodeticPoint | None = None
        self._origin: GeodeticPoint | None = None
        self._compared: GlobalPosition | None = None
        self._home_compared: tuple[Home | None, LocalOrigin] | None = None

    def update(self, telemetry: Telemetry, kind: AutopilotKind, *, grounded: bool) -> None:
        """Takes new telemetry. grounded: no flight has begun, any origin is accepted."""
        origin, self._kind = telemetry.local_origin, kind
        self._origin = None if origin is None else origin.point
        if origin is None:
            self._accepted = None
            return
        if self._accepted is None or grounded:
            self._accepted = origin.point
        self.origin_moved_m = self._distance_m(origin.point, self._accepted, (0.0, 0.0, 0.0))
        if not profile(kind).projection_known:
            return
        self._compare_global(telemetry, origin.point)
        self._compare_home(telemetry.home, origin)

    def accept_origin(self) -> None:
        """Accepts the present origin: the operator was informed of its move before the order."""
        self._accepted, self.origin_moved_m = self._origin, 0.0

    def _compare_global(self, telemetry: Telemetry, origin: GeodeticPoint) -> None:
        local, other = telemetry.local_position, telemetry.global_position
        if local is None or other is None or other.boot_s is None or other is self._compared:
            return
        self._compared = other
        ahead_s = other.boot_s - local.boot_s
        if abs(ahead_s) > _COMPARABLE_S:
            return
        north_m, east_m, down_m = (
            place_m + ahead_s * speed_mps
            for place_m, speed_mps in zip(local.position_ned_m, local.velocity_ned_mps, strict=True)
        )
        self.global_off_m = self._distance_m(other.point, origin, (north_m, east_m, down_m))

    def _compare_home(self, home: Home | None, origin: LocalOrigin) -> None:
        """Compares home's two coordinates where the autopilot derives one from the other.

        In recordings ArduPilot's differ by less than 1 mm; PX4's, whose local home keeps its value
        from when home was set, by up to 0.8 m level and 1.4 m in height.
        """
        if home is None or not profile(self._kind).home_by_projection:
            return
        if self._home_compared != (home, origin):
            self._home_compared = home, origin
            self.home_off_m = self._distance_m(home.point, origin.point, home.position_ned_m)

    def _distance_m(
        self, point: GeodeticPoint, origin: GeodeticPoint, local_m: tuple[float, float, float]
    ) -> float:
        """Distance between a point in the world and one in the local frame at an origin."""
        return math.dist(profile(self._kind).to_local_ned(point, origin), local_m)

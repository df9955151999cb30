"""Reports of the perception to the companion. Values."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..planner.site import PlanePoint, Polygon
from ..types import Vector
from .lidar_scan import PacketFault


@dataclass(frozen=True, slots=True, kw_only=True)
class SeenConductor:
    """A confirmed conductor in the plane of the site, tracked from scan to scan.

    name: constant while the conductor is tracked, as `seen-1`. deviation_m: standard deviation of
    its place. seen_s: time of the last scan with a sighting.
    """

    name: str
    position_m: PlanePoint
    deviation_m: float
    sightings: int
    seen_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorHealth:
    """State of the sensor.

    scan_s: time of the last point of the newest whole scan; None before the first. received_s: time
    of the newest packet; None before the first. returns: share of that scan's beams with an echo
    farther than 1 m; nearer echoes are of the hull or of a cover. refused: number of damaged
    packets and of packets of another sensor. refusal: most frequent reason, while all packets are
    refused; None otherwise. late: number of scans and sets that were dropped for lack of poses, or
    of possible times. A sensor that measures single points has 1 as returns.
    """

    scan_s: float | None = None
    received_s: float | None = None
    returns: float = 0.0
    refused: int = 0
    late: int = 0
    refusal: PacketFault | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LineOffset:
    """Offset of the line's frame: added to the autopilot's estimate it gives the place by the line.

    covariance_m2: of x, of x with z, of z. jumped_m: sum of the estimate's jumps that it includes.
    seen_s: time of the last scan whose wires gave it, None while nothing is known of it; wires:
    their number. contradicted_s: time since which scans contradict it; None: they do not.
    turned_rad: error by which the autopilot's heading turns what is seen, counterclockwise from
    above. The true heading is the autopilot's (clockwise) plus this angle.
    """

    offset_m: PlanePoint = (0.0, 0.0)
    covariance_m2: tuple[float, float, float] = (math.inf, 0.0, math.inf)
    jumped_m: Vector = (0.0, 0.0, 0.0)
    seen_s: float | None = None
    wires: int = 0
    contradicted_s: float | None = None
    turned_rad: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PerceptionReport:
    """Present conductors and obstacles. time_s: of the report, on the companion's clock.

    began_s: time of the first report of the same process; a restarted process has lost earlier
    tracks. solids: other obstacles in the plane without the ground and without keep-outs. Places
    are in the line's frame: the estimate's, to which line.offset_m is added.
    """

    time_s: float
    began_s: float = 0.0
    health: SensorHealth = SensorHealth()
    conductors: tuple[SeenConductor, ...] = ()
    solids: tuple[Polygon, ...] = ()
    line: LineOffset = LineOffset()

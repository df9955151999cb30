"""The margin of a vehicle: kept from obstacles in addition to their keep-outs.

The distance kept from an obstacle is the vehicle's radius, the obstacle's own keep-out
(electrical distance, sway), and this margin.
"""

from __future__ import annotations

from .config import Supervision
from .site import Margin, Site
from .types import AutopilotKind
from .vehicle import Vehicle

SEEN = {
    AutopilotKind.PX4: Margin(position_m=1.4, tracking_m=1.15),
    AutopilotKind.ARDUPILOT: Margin(position_m=0.5, tracking_m=0.9),
}
"""Measured in flights with a common GNSS receiver and a barometer: PX4 v1.17 (SIH), which reported
0.03 to 0.2 m; ArduCopter 4.6.3 (SITL). Position: the greatest error, for PX4 in height; tracking:
the limit that 95 % of every flight kept to. From the true position to the setpoint: 2.48 m and 1.0
m in calm air; in gusts the measured tracking error counts."""


def seen_margin(kind: AutopilotKind | None) -> Margin:
    """Margin measured for an autopilot; for an unknown one, PX4's, which is greater."""
    return SEEN.get(kind or AutopilotKind.UNKNOWN, SEEN[AutopilotKind.PX4])


def margin_of(vehicle: Vehicle, supervision: Supervision) -> Margin:
    """Margin that a vehicle is flown with: as configured, else as measured for its autopilot."""
    seen = seen_margin(vehicle.autopilot)
    position_m, tracking_m = supervision.position_uncertainty_m, vehicle.guidance.tracking_margin_m
    return Margin(
        position_m=seen.position_m if position_m is None else position_m,
        tracking_m=seen.tracking_m if tracking_m is None else tracking_m,
    )


def flown_site(site: Site, vehicle: Vehicle, supervision: Supervision) -> Site:
    """The site as a vehicle flies it: beyond every keep-out its margin is kept."""
    return site.flown_with(margin_of(vehicle, supervision))

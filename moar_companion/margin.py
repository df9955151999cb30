"""The margin for a vehicle: what distances from obstacles allow for, beyond their keep-outs.

What is kept from an obstacle is the vehicle's radius, the obstacle's own keep-out (electrical
distance, sway), and this margin.
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
"""In flights with a common GNSS receiver and a barometer: PX4 v1.17 (SIH), where it told 0.03 to
0.2 m; ArduCopter 4.6.3 (SITL). Of the position the greatest error, of PX4 in height; of tracking
what 95 % of every flight kept to. From the true place to the setpoint they came to 2.48 m and 1.0 m
in calm air; in gusts the tracking error that is seen counts."""


def seen_margin(kind: AutopilotKind | None) -> Margin:
    """What an autopilot was seen to need; of one that is not known, what the worse one needs."""
    return SEEN.get(kind or AutopilotKind.UNKNOWN, SEEN[AutopilotKind.PX4])


def margin_of(vehicle: Vehicle, supervision: Supervision) -> Margin:
    """What a vehicle is flown with: as configured, else as its autopilot was seen to need."""
    seen = seen_margin(vehicle.autopilot)
    position_m, tracking_m = supervision.position_uncertainty_m, vehicle.guidance.tracking_margin_m
    return Margin(
        position_m=seen.position_m if position_m is None else position_m,
        tracking_m=seen.tracking_m if tracking_m is None else tracking_m,
    )


def flown_site(site: Site, vehicle: Vehicle, supervision: Supervision) -> Site:
    """The site as a vehicle flies it: beyond every keep-out its margin is kept."""
    return site.flown_with(margin_of(vehicle, supervision))

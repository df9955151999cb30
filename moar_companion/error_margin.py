"""The margin of a vehicle: kept from obstacles in addition to their keep-outs.

The distance kept from an obstacle is the vehicle's radius, the obstacle's own keep-out
(electrical distance, sway), and this margin.
"""

from __future__ import annotations

from .autopilots import profile
from .config import Supervision
from .site import Margin, Site
from .types import AutopilotKind
from .vehicle import Vehicle


def seen_margin(kind: AutopilotKind | None) -> Margin:
    """Margin measured for an autopilot; for an unknown one the greatest."""
    seen = profile(kind)
    return Margin(position_m=seen.position_error_m, tracking_m=seen.tracking_error_m)


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

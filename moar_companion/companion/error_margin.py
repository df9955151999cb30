"""The margin of a vehicle: its distance from obstacles in addition to their keep-outs.

The distance from an obstacle is the vehicle's radius, the obstacle's own keep-out (electrical
distance, sway), and this margin.
"""

from __future__ import annotations

import math
from dataclasses import fields, replace

from ..mavlink.autopilots import profile
from ..planner.site import Margin, Site
from ..settings.config import CompanionConfig, Supervision
from ..settings.vehicle import SpeedLimits, Vehicle
from ..types import AutopilotKind


def measured_margin(kind: AutopilotKind | None) -> Margin:
    """Margin measured for an autopilot; for an unknown one the greatest."""
    measured = profile(kind)
    return Margin(position_m=measured.position_error_m, tracking_m=measured.tracking_error_m)


def margin_of(vehicle: Vehicle, supervision: Supervision) -> Margin:
    """Margin that a vehicle is flown with: as configured, else as measured for its autopilot."""
    measured = measured_margin(vehicle.autopilot)
    position_m, tracking_m = supervision.position_uncertainty_m, vehicle.guidance.tracking_margin_m
    return Margin(
        position_m=measured.position_m if position_m is None else position_m,
        tracking_m=measured.tracking_m if tracking_m is None else tracking_m,
    )


def flown_site(site: Site, vehicle: Vehicle, supervision: Supervision) -> Site:
    """The site as a vehicle flies it: beyond every keep-out its margin is kept."""
    return site.flown_with(margin_of(vehicle, supervision))


_REACTION_S = 0.8
"""Time from a conductor's first echo to a braking setpoint: five scans of 0.1 s, maps, a plan."""


def sight_speed_mps(vehicle: Vehicle, config: CompanionConfig) -> float:
    """Speed from which the aircraft stops before the margin of an unknown conductor.

    By `perception.sight_m`, less hull, keep-out and margin, after the reaction time.
    """
    settings = config.perception
    kept_m = vehicle.radius_m + settings.keep_out_m + margin_of(vehicle, config.supervision).total_m
    room_m = max(0.0, settings.sight_m - kept_m)
    coasted_mps = vehicle.guidance.acceleration_mps2 * _REACTION_S
    gained_m2ps2 = 2.0 * vehicle.guidance.acceleration_mps2 * room_m
    return math.sqrt(coasted_mps**2 + gained_m2ps2) - coasted_mps


def sighted(vehicle: Vehicle, config: CompanionConfig) -> Vehicle:
    """The vehicle as flown with a sensor: its speeds are limited, not below v_MIN."""
    if config.perception.sensor is None:
        return vehicle
    speed = vehicle.speed
    most_mps = max(speed.min_mps, sight_speed_mps(vehicle, config))
    limited = {item.name: min(getattr(speed, item.name), most_mps) for item in fields(speed)}
    return replace(vehicle, speed=SpeedLimits(**limited))

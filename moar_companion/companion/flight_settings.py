"""Settings in force: those that a ground station has changed, and when they count. Pure.

Inputs: parameters, the settings in force. Outputs: the settings that count at once, and those that
wait for maps: the maps are made of sizes, distances and speeds, and a path is flown by the settings
of its maps.
"""

from __future__ import annotations

from dataclasses import replace

from ..settings.config import CompanionConfig
from ..settings.flight_parameters import FlightParameters
from ..settings.vehicle import Vehicle
from .error_margin import sighted


def settings_of(
    parameters: FlightParameters, config: CompanionConfig
) -> tuple[CompanionConfig, Vehicle]:
    """The configuration and the vehicle with the values of parameters, as they are flown."""
    config, vehicle = parameters.apply(config)
    return config, sighted(vehicle, config)


def at_once(wanted: Vehicle, in_force: Vehicle) -> Vehicle:
    """The wanted vehicle, but with all that maps and paths are made of as in force."""
    guidance = replace(
        wanted.guidance,
        acceleration_mps2=in_force.guidance.acceleration_mps2,
        tracking_margin_m=in_force.guidance.tracking_margin_m,
        recovery_m=in_force.guidance.recovery_m,
        landing_height_m=in_force.guidance.landing_height_m,
    )
    return replace(
        wanted,
        radius_m=in_force.radius_m,
        safety=in_force.safety,
        speed=in_force.speed,
        guidance=guidance,
    )


def need_maps(wanted: Vehicle, in_force: Vehicle) -> bool:
    """True if other maps have to be made for the wanted vehicle."""
    return at_once(wanted, in_force) != wanted

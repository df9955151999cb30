"""Settings of a flight: those in force, and those that a ground station has set. Pure.

Maps are made of sizes, distances and speeds, and a path is flown by the settings of its maps. So
what a ground station sets counts at once where it needs no other maps, else with these
(`settings_change`).
"""

from __future__ import annotations

from dataclasses import replace

from ..settings.config import CompanionConfig
from ..settings.flight_parameters import FlightParameters, ParameterError
from ..settings.vehicle import Vehicle
from .error_margin import sighted


class FlightSettings:
    """The parameters in force, and those for which maps are being made.

    None throughout where a companion has no parameters.
    """

    def __init__(self, parameters: FlightParameters | None) -> None:
        self.in_force = parameters
        """Those that are flown, and kept for the next process."""
        self.wanted = parameters
        """All that were set."""
        self.asked: FlightParameters | None = None
        """Those of the maps that are being made; None while none are."""
        self.restores = False
        """True after refused maps, until the planner has maps for the settings in force again."""
        self._since: dict[str, None] = {}
        """Names of those that came into force since the maps were requested."""

    def ask(self) -> None:
        """Notes the request of maps for all that were set."""
        if self.asked is None and not self.restores:
            self.asked, self._since = self.wanted, {}

    def alone(self, name: str, value: float) -> FlightParameters | None:
        """Those in force with one more; None where that is valid beside other new ones only."""
        assert self.in_force is not None
        try:
            return self.in_force.with_value(name, value)
        except ParameterError:
            return None

    def put(self, parameters: FlightParameters) -> None:
        """Puts parameters that need no other maps into force."""
        before, self.in_force = self.in_force, parameters
        if self.asked is not None and before is not None:
            changed = parameters.differing(before)
            new = (name for name in changed if self.asked.value(name) == before.value(name))
            self._since |= dict.fromkeys(new)

    def put_asked(self) -> None:
        """Puts those of the new maps into force, with what came into force meanwhile."""
        asked, self.asked, self.restores = self.asked, None, False
        if asked is not None and self.in_force is not None:
            self.in_force = asked.with_values_of(self._since, self.in_force) or asked

    def waiting(self) -> str:
        """First of those that wait for maps and are still wanted, with its value; else empty."""
        if self.asked is None or self.in_force is None or self.wanted is None:
            return ""
        waiting = self.asked.differing(self.in_force)
        wanted = set(self.wanted.differing(self.in_force))
        name = next((name for name in waiting if name in wanted), None)
        return "" if name is None else f"{name} {self.asked.value(name):.3g}"


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

"""A flight in lockstep whose settings a ground station changes by parameters."""

from __future__ import annotations

from moar_companion.companion.mission_snapshot import MissionSnapshot
from moar_companion.companion.planning.planner_set import PlannerSet
from moar_companion.companion.planning.site_maps import SiteMaps
from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.dialect import create
from moar_companion.planner.planner import Planner
from moar_companion.service.recording.calls import RecordedCompanion
from moar_companion.settings.config import CompanionConfig, shipped_configs
from moar_companion.settings.flight_parameters import FlightParameters, flight_parameters
from moar_companion.settings.vehicle import Vehicle, VehicleFile

from ..packets import decoded
from .lockstep import Lockstep, as_simulated
from .operator import Manner

REAL32, INT32 = 9, 6


class ParameterFlight(Lockstep):
    """The flight, and the ground station's packets of the parameter protocol.

    stored: values of the vehicle that were set before the start.
    """

    def __init__(self, *, vehicle="x500", manner=Manner.PX4, stored=None, **options) -> None:
        file = VehicleFile.load(shipped_configs() / "vehicles" / f"{vehicle}.yaml")
        flown = as_simulated(Vehicle.of(file), manner)
        changed = {"autopilot": flown.autopilot, "risk": flown.risk}
        self.vehicle_file = file.model_copy(update=changed)
        self.station = Codec(system_id=255, component_id=190)
        of_files = FlightParameters.of(
            self.vehicle_file, CompanionConfig(vehicle=shipped_configs())
        )
        self.parameters, _ = of_files.with_stored(stored or {})
        config, flown = self.parameters.apply(CompanionConfig(vehicle=shipped_configs()))
        options.setdefault("supervision", config.supervision)
        self.kept = []
        """Parameters that a service would have stored, in order."""
        super().__init__(vehicle=flown, manner=manner, **options)

    def step(self) -> None:
        super().step()
        parameters = self.companion.parameters
        if not self.kept or self.kept[-1] is not parameters:
            self.kept.append(parameters)

    def new_companion(self, before: MissionSnapshot | None = None) -> RecordedCompanion:
        return RecordedCompanion(
            self.config,
            self.vehicle,
            SiteMaps(site=self.flown_site, maps=self.planner.maps),
            before=before,
            parameters=self.parameters,
        )

    def with_planner(self) -> ParameterFlight:
        """Itself with a planner of its own, since copies share theirs, and settings change it."""
        self.planner = Planner(self.flown_site, self.vehicle, clock=lambda: 0.0)
        self.planners = PlannerSet(self.planner)
        return self

    def set(self, **values: float) -> None:
        """The ground station sets parameters, each by its name, in this order."""
        for name, value in values.items():
            integer = flight_parameters()[name].is_integer
            bytewise = integer and self.operator.manner is Manner.PX4
            sent = value * 2.0**-149 if bytewise else value  # a small integer by its bytes
            message = create(
                "PARAM_SET",
                target_system=1,
                target_component=195,
                param_id=name.encode(),
                param_value=sent,
                param_type=INT32 if integer else REAL32,
            )
            self.handle(self.station.encode(message))

    def sent(self, kind: str) -> list:
        """Messages of a kind that the companion has sent."""
        packets = [decoded(packet) for _, packet in self.to_autopilot]
        return [message for message in packets if message.get_type() == kind]

    def noted(self, kind: str) -> list[dict]:
        """Data of the decisions of a kind."""
        return [item.data for item in self.decisions if item.kind == kind]

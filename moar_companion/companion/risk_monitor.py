"""Risk monitor of a flight: the current risk indices, and contingency plans kept ready."""

from __future__ import annotations

import math
from collections import deque

from ..mavlink.autopilots.parameter_names import Parameters
from ..mavlink.telemetry import Telemetry
from ..planner.site import Site
from ..risk import RiskEstimate, update
from ..risk.holding import held_wind_mps, is_saturated, tilt_limit
from ..risk.localization import PlaceByLine
from ..risk.power import PowerModel
from ..risk.wind import MOTOR_OUTPUT
from ..settings.vehicle import Vehicle
from ..status_values import EnergySection
from ..types import Vector
from .contingency.contingency_planner import ContingencyInputs, ContingencyPlanner
from .estimation.landed_state import grounded
from .guidance.flight_volume import FlightVolume
from .planning.plan_jobs import PlanAnswer, PlanJob
from .safety.check_inputs import EscapeRoute
from .safety.uncertainty_growth import UncertaintyGrowth


class RiskMonitor:
    """Risks by telemetry and by the path still to be flown, once it has a site."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._power = PowerModel.of(vehicle)
        self.risk = RiskEstimate.unknown(vehicle.risk)
        """Current risk indices."""
        self.held_wind_mps: float | None = None
        """Wind in which the aircraft can hold; None before an autopilot is received."""
        self.saturated = False
        """True while lean or motors are at their limits."""
        self.contingencies: ContingencyPlanner | None = None
        """Contingency plans; None without a site."""
        self._answers: deque[PlanAnswer] = deque()
        """Answers to jobs of contingencies, for the next cycle."""
        self._growths: dict[str, UncertaintyGrowth] = {}
        """Growth of the position's uncertainty, by the name of its report."""
        self._judged_s = -math.inf
        self.accuracies: tuple[object, ...] = ()
        """Reports of position accuracy that were last noted."""

    def take_site(self, site: Site) -> None:
        """Takes the site of the contingency plans."""
        self.contingencies = ContingencyPlanner(site, self._vehicle, self._power)

    def take_vehicle(self, vehicle: Vehicle) -> None:
        """Takes the vehicle with the settings in force."""
        self._vehicle, self._power = vehicle, PowerModel.of(vehicle)
        if self.contingencies is not None:
            self.contingencies.take_vehicle(vehicle, self._power)

    @property
    def energy_forecast(self) -> EnergySection | None:
        """Battery energy left, and demand of the remaining flight; None without a site."""
        return (
            None
            if self.contingencies is None
            else self.contingencies.energy_forecast(self.risk.meter)
        )

    @property
    def escape_route(self) -> EscapeRoute | None:
        """The better escape route, and the flight time left after it; None while unknown."""
        if self.contingencies is None:
            return None
        return self.contingencies.escape_route(self.risk.meter)

    @property
    def fitting_stops(self) -> int | None:
        """Number of the task's stops for which the energy suffices; None: for all, or unknown."""
        return None if self.contingencies is None else self.contingencies.fitting_stops

    def uncertainty_m(self, ahead_s: float) -> float | None:
        """The position's uncertainty after a time, at its last growth; None: never reported.

        A source that is silent is taken to go on growing.
        """
        until_s = self._judged_s + ahead_s
        return max((growth.at_m(until_s) for growth in self._growths.values()), default=None)

    def note_accuracy(self, telemetry: Telemetry) -> bool:
        """Takes reports of position accuracy; True if one is new: the next setpoint needs it."""
        before = self.accuracies
        self.accuracies = (
            telemetry.gnss,
            telemetry.second_gnss,
            telemetry.estimator,
            telemetry.odometry,
        )
        return self.accuracies != before

    def contingency_jobs(self) -> list[PlanJob]:
        """Planning jobs of contingencies since the last call; none without a site."""
        return [] if self.contingencies is None else self.contingencies.jobs()

    def contingency_answered(self, answer: PlanAnswer) -> None:
        """Takes the answer to a contingency's job, for the next cycle."""
        self._answers.append(answer)

    def take_answers(self, volume: FlightVolume | None) -> None:
        """Gives the answers since the last cycle; one that is no longer awaited is dropped."""
        while self._answers:
            answer = self._answers.popleft()
            if self.contingencies is not None:
                self.contingencies.answered(answer, volume)

    def keep_escape_routes(
        self,
        telemetry: Telemetry,
        scene: ContingencyInputs | None,
        place_m: Vector | None,
        now_s: float,
    ) -> None:
        """Updates the contingency plans. scene: None if nothing can be planned; place_m: aircraft.

        A flight continues until the aircraft is known to be on the ground or disarmed.
        """
        if self.contingencies is None:
            return
        if grounded(telemetry):
            self.contingencies.end()
        elif scene is None:
            self.contingencies.wait(place_m, now_s)
        else:
            self.contingencies.update(scene, now_s)

    def judge(
        self,
        telemetry: Telemetry,
        parameters: Parameters,
        tracking_error_m: float | None,
        by_line: PlaceByLine | None,
        now_s: float,
    ) -> None:
        """Updates the risks. tracking_error_m: None while the companion does not fly."""
        self.risk = update(
            self.risk,
            telemetry,
            now_s,
            model=self._vehicle.risk,
            cruise_mps=self._vehicle.speed.horizontal_mps,
            tracking_error_m=tracking_error_m,
            by_line=by_line,
            power=self._power,
            demands=None if self.contingencies is None else self.contingencies.demands,
        )
        self._judged_s = now_s
        self._growths = {
            item.name: self._growths.get(item.name, UncertaintyGrowth()).followed(
                item.value, item.received_s
            )
            for item in self.risk.position_accuracies
            if item.value is not None and item.received_s is not None
        }
        autopilot, model = telemetry.autopilot, self._vehicle.risk
        if autopilot is None:
            return
        limit_rad, _ = tilt_limit(autopilot.kind, parameters, model)
        self.held_wind_mps = held_wind_mps(self.risk.wind.learning.used(model), limit_rad)
        inputs = self.risk.report.wind.inputs
        output = next(
            (item.value for item in inputs if item.name == MOTOR_OUTPUT and item.known), None
        )
        self.saturated = is_saturated(telemetry, output, limit_rad, model)

"""The contingency planner: escape routes from the site, and the remaining flight.

While the aircraft is in the air on a site, an exit and an evacuation from its position are kept
planned. Their time and energy include the landing leg and the landing. The rest of an inspection,
from stop to stop, and the escape routes behind it are planned, too; where the energy does not
suffice for all stops, also those behind the earlier stops (`fitting_stops`). One plan is requested
at a time, at lower priority than active plans. A known route stays valid until a newer one exists;
the flight back to its start is then a part of it. Inputs: pose, active flight, risks, time; plan
answers. Outputs: plan jobs, `Demands`, the better escape route, and the stops that fit.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...mavlink.autopilots.failsafe_actions import BATTERY, NO_FAILSAFES, Failsafes
from ...planner.adaptation import Adaptation
from ...planner.plan_values import PlanRequest
from ...planner.plane_fence import PlaneFence
from ...planner.site import Site
from ...risk.power import Demands, Meter, PowerModel, landing_s
from ...risk.power.model import S_PER_H
from ...settings.risk_model import RiskModel
from ...settings.vehicle import Vehicle
from ...status_values import EnergySection, RouteEntry, RoutePoint
from ...types import Mission, RiskIndices, Vector
from ..estimation.pose import Pose
from ..guidance.flight_volume import FlightVolume
from ..guidance.path_follower import PathFollower
from ..guidance.plan_path import flown
from ..guidance.trajectory import FloatArray
from ..mission.values import MissionStatus
from ..mission_states import MissionState
from ..planning.plan_jobs import PlanAnswer, PlanJob
from ..safety.check_inputs import EscapeRoute
from ..safety.failsafe_paths import exposed_places
from .route_cost import (
    RouteCost,
    better_of,
    energy_wh_of,
    least_in_wind_s,
    straight_s,
)

_ROUND_S = 2.0
"""Time between two rounds of requests: at 5 m/s the aircraft moves 10 m."""
_ANSWER_TIMEOUT_S = 5.0
"""Timeout of an answer, as for active plans; then the next plan is requested."""
_FASTEST_MPS = 100.0
"""A velocity estimate above this is wrong: then the plan begins at rest."""
_TIGHT_FOR_S = 10.0
_TURN = 1e-3
"""Least change of the direction at a corner of a route, as a length of the unit circle."""
"""Time for which the energy must not suffice for a stop: a gust or a step of the charge passes."""
_ESCAPE_MISSIONS = (Mission.EXIT, Mission.EVACUATION)
_FLOWN = frozenset({MissionState.FLYING, MissionState.AT_TARGET, MissionState.LANDING_LEG})


class _Question(NamedTuple):
    """A route to be planned. origin: a target's name; None for the aircraft's position."""

    origin: str | None
    mission: Mission
    goal: str | None = None


class _Asked(NamedTuple):
    question: _Question
    job: PlanJob
    start_m: Vector
    asked_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class ContingencyInputs:
    """Inputs of contingency planning: the aircraft in the air, and its active flight.

    reserve: fraction of the charge at which the exit begins, so that no stop may be left for it.
    pace: flown fraction of the planned speed. meter: of the batteries.
    fence: of the autopilot, as far as it cuts the site.
    wind_mps: the mean wind over ground, in the site's frame; None where it is unknown. model: the
    vehicle's, with the drag of the wind estimate.
    """

    pose: Pose
    status: MissionStatus
    flight: PathFollower | None
    volume: FlightVolume
    risk: RiskIndices
    widening_m: float
    fence: PlaneFence | None
    failsafes: Failsafes
    pace: float
    meter: Meter
    reserve: float
    wind_mps: Vector | None
    model: RiskModel


class ContingencyPlanner:
    """Keeps the latest answers, and requests new ones, one at a time."""

    def __init__(self, site: Site, vehicle: Vehicle, power: PowerModel) -> None:
        self._site = site
        self._vehicle = vehicle
        self._power = power
        self._outwards = [mission for mission in _ESCAPE_MISSIONS if site.landing_m.get(mission)]
        self._next_job_id = 1
        self._jobs: list[PlanJob] = []
        self._asked: _Asked | None = None
        self._queue: list[_Question] = []
        self._due_s = -math.inf
        self._routes: dict[_Question, RouteCost | None] = {}
        """Routes of the last answers, of those with a plan; None where no answer had one."""
        self._paths: dict[_Question, tuple[RoutePoint, ...]] = {}
        """Their corners, from where each was requested."""
        self._now_s = -math.inf
        self._failsafes = NO_FAILSAFES
        """Battery failsafes, which make a place exposed."""
        self._wind_mps: Vector | None = None
        """Last known wind in the air."""
        self._in_wind = vehicle
        """The vehicle with the drag of the wind estimate."""
        self.demands: Demands | None = None
        """Energy demand of the remaining flight; None on the ground."""
        self._finish: RouteCost | None = None
        """Rest of the mission and the better escape route behind it; None: none, or unknown."""
        self._out: dict[Mission, RouteCost | None] = {}
        """The escape routes; of an active one the remaining part."""
        self._flown: Mission | None = None
        self.better: Mission | None = None
        """The escape route that takes less energy, or is active; None while there is none."""
        self.fitting_stops: int | None = None
        """Number of the active task's stops, from the next one on, for which the energy suffices,
        with the way out, if it has not sufficed for all for some time; at least 1. None: for all,
        or unknown."""
        self._tight_s: float | None = None
        """Time since which the energy does not suffice for all stops; None: it does, or unknown."""

    def take_vehicle(self, vehicle: Vehicle, power: PowerModel) -> None:
        """Takes the vehicle with the settings in force; the next routes are planned for it."""
        self._vehicle, self._power = vehicle, power
        self._in_wind = replace(vehicle, risk=self._in_wind.risk)

    def update(self, scene: ContingencyInputs, now_s: float) -> None:
        """Updates the remaining flight, and requests the next plan."""
        self._now_s = now_s
        self._wind_mps = scene.wind_mps or self._wind_mps
        self._in_wind = replace(self._vehicle, risk=scene.model)
        self._failsafes = scene.failsafes.of(BATTERY)
        questions = tuple(self._questions(scene))
        self._routes = {
            question: route
            for question, route in self._routes.items()
            if question.origin is None or question in questions
        }
        self._ask_next(scene, questions, now_s)
        self._sum_up(scene)

    def wait(self, here_m: Vector | None, now_s: float) -> None:
        """Keeps the known routes while no plan is possible; here_m: None where unknown."""
        self._now_s = now_s
        demands = Demands() if self.demands is None else self.demands
        if here_m is not None:
            self._out, self._flown = self._escape_routes(here_m), None
            self.better = better_of(self._out, self.better)
            demands = self._with_escape_routes(demands)
        self.demands = demands

    def end(self) -> None:
        """Clears all routes on the ground."""
        self._asked, self.demands, self._finish, self.better = None, None, None, None
        self._queue, self._routes, self._out, self._due_s = [], {}, {}, -math.inf
        self._flown, self._wind_mps = None, None
        self.fitting_stops, self._tight_s = None, None

    def energy_forecast(self, meter: Meter) -> EnergySection:
        """Energy left, and demand of each route."""

        def outcome(route: RouteCost | None) -> RouteEntry | None:
            return None if route is None else route.outcome(meter, self._power, self._now_s)

        def out(mission: Mission) -> RouteEntry | None:
            entry, question = outcome(self._out.get(mission)), _Question(None, mission)
            if entry is None or self._routes.get(question) is None:
                return entry
            return replace(entry, path=self._paths[question])

        return EnergySection(
            left_wh=meter.left_wh,
            flight_s=meter.flight_s(self._power),
            factor=meter.factor,
            source=meter.source,
            finish=outcome(self._finish),
            exit=out(Mission.EXIT),
            evacuation=out(Mission.EVACUATION),
            better=self.better,
        )

    def escape_route(self, meter: Meter) -> EscapeRoute | None:
        """The better escape route, and the flight time left after it; None while unknown."""
        route = None if self.better is None else self._out.get(self.better)
        if self.better is None or route is None:
            return None
        exit_instead = self._flown is Mission.EXIT and self.better is not Mission.EXIT
        flown = self._out[Mission.EXIT] if exit_instead else None
        flown_left_s = meter.left_after_s(self._power, energy_wh_of(flown))
        if flown_left_s is not None and flown_left_s > self._power.reserve_s:
            flown_left_s = None
        return EscapeRoute(
            mission=self.better,
            left_s=meter.left_after_s(self._power, route.energy_wh),
            reserve_s=self._power.reserve_s,
            age_s=self._now_s - route.asked_s,
            flown_left_s=flown_left_s,
            exposed_s=route.exposed_s,
        )

    def jobs(self) -> list[PlanJob]:
        """Planning jobs since the last call."""
        jobs, self._jobs = self._jobs, []
        return jobs

    def answered(self, answer: PlanAnswer, volume: FlightVolume | None) -> None:
        """Takes the answer to a job; one that is no longer awaited is dropped."""
        asked = self._asked
        if asked is None or asked.job.job_id != answer.job_id or volume is None:
            return
        self._asked = None
        measured = self._measured(asked, answer, volume)
        if measured is None:
            self._routes.setdefault(asked.question, None)
        else:
            self._routes[asked.question], self._paths[asked.question] = measured

    def _questions(self, scene: ContingencyInputs) -> Iterator[_Question]:
        """Routes to be planned: the escape routes first."""
        task, flight = scene.status.task, scene.flight
        if flight is None or not flight.on_leg:  # outside the workspace no plan is possible
            yield from (_Question(None, mission) for mission in self._outwards)
        if task is not None and task.stops:
            for stop, following in itertools.pairwise(task.stops):
                yield _Question(stop, Mission.INSPECTION, following)
            last = task.stops[-1:] if self._tight_s is None else reversed(task.stops)
            yield from (_Question(stop, mission) for stop in last for mission in self._outwards)

    def _ask_next(
        self, scene: ContingencyInputs, questions: tuple[_Question, ...], now_s: float
    ) -> None:
        if self._asked is not None and now_s - self._asked.asked_s < _ANSWER_TIMEOUT_S:
            return
        self._queue = [question for question in self._queue if question in questions]
        if not self._queue and now_s >= self._due_s:
            self._queue, self._due_s = list(questions), now_s + _ROUND_S
        self._asked = None
        if not self._queue:
            return
        question = self._queue.pop(0)
        x_m, _, z_m = scene.pose.position_m
        vx_mps, _, vz_mps = scene.pose.velocity_mps
        if not math.hypot(vx_mps, vz_mps) <= _FASTEST_MPS:
            vx_mps = vz_mps = 0.0
        if question.origin is not None:
            (x_m, z_m), (vx_mps, vz_mps) = self._site.target(question.origin).position_m, (0.0, 0.0)
        adaptation = Adaptation.of(self._vehicle, question.mission)
        job = PlanJob(
            job_id=self._next_job_id,
            request=PlanRequest(
                mission=question.mission,
                target=question.goal,
                start_m=(x_m, z_m),
                velocity_mps=(vx_mps, vz_mps),
                weights=adaptation.weights(scene.risk),
                risk=scene.risk,
                adaptation=adaptation,
            ),
            widening_m=scene.widening_m,
            fence=scene.fence,
            failsafes=scene.failsafes,
        )
        self._asked = _Asked(question=question, job=job, start_m=(x_m, 0.0, z_m), asked_s=now_s)
        self._next_job_id += 1
        self._jobs.append(job)

    def _measured(
        self, asked: _Asked, answer: PlanAnswer, volume: FlightVolume
    ) -> tuple[RouteCost, tuple[RoutePoint, ...]] | None:
        """The route of an answer and its corners; None without a plan."""
        plan = answer.plan
        if plan is None:
            return None
        path = flown(plan, asked.start_m, answer.escape_m, volume.leg_speeds_mps)
        trajectory = volume.widened(answer.reach).trajectory(path)
        speed_mps = math.hypot(*asked.job.request.velocity_mps)
        rest = trajectory.rest(0.0, speed_mps, self._vehicle.guidance.acceleration_mps2)
        route = self._exposed(self._route_cost(*rest, asked.asked_s), *rest, volume)
        if not asked.question.mission.visits_targets:
            route = route.then(self._landing(volume))
        return route, _corners(np.concatenate([[asked.start_m], rest[0][1:]]))

    def _route_cost(
        self, position_m: FloatArray, duration_s: FloatArray, asked_s: float
    ) -> RouteCost:
        """Route through points (n, 3) in times (n - 1,), longer where the wind slows the flight."""
        if self._wind_mps is not None:
            steps_m = np.diff(position_m, axis=0)
            against_s = least_in_wind_s(steps_m, self._wind_mps[:2], self._in_wind)
            duration_s = np.maximum(duration_s, against_s)
        return RouteCost(
            duration_s=float(duration_s.sum()),
            energy_wh=self._power.path_wh(position_m, duration_s),
            asked_s=asked_s,
        )

    def _exposed(
        self, route: RouteCost, position_m: FloatArray, duration_s: FloatArray, volume: FlightVolume
    ) -> RouteCost:
        """The route with its exposed time, by its points (n, 3) and the times (n - 1,) between."""
        if not self._failsafes.actions:
            return route
        exposed = exposed_places(self._failsafes, volume.maps.reach, position_m[:, ::2])
        last = int(np.flatnonzero(exposed)[-1]) if exposed.any() else 0
        return replace(route, exposed_s=float(duration_s[:last].sum()))

    def _landing(self, volume: FlightVolume) -> RouteCost:
        height_m, kind = self._vehicle.guidance.landing_height_m, volume.loss.kind
        return RouteCost(
            duration_s=landing_s(height_m, kind),
            energy_wh=self._power.landing_wh(height_m, kind),
            asked_s=self._now_s,
        )

    def _escape_routes(self, here_m: Vector) -> dict[Mission, RouteCost | None]:
        """The escape routes from here: flight back to their starts, then as last planned."""
        routes: dict[Mission, RouteCost | None] = {}
        for mission in _ESCAPE_MISSIONS:
            question = _Question(None, mission)
            route = self._routes.get(question)
            if route is not None:
                start = self._paths[question][0]
                start_m = (start.x_m, start.y_m, start.z_m)
                route = self._straight(here_m, start_m).then(route)
            routes[mission] = route
        return routes

    def _straight(self, here_m: Vector, there_m: Vector) -> RouteCost:
        """The straight route from here to there, at full speed."""
        duration_s = np.array([straight_s(here_m, there_m, self._power)])
        return self._route_cost(np.array([here_m, there_m]), duration_s, self._now_s)

    def _sum_up(self, scene: ContingencyInputs) -> None:
        status, task, flight = scene.status, scene.status.task, scene.flight
        ordered = task is not None and (status.state in _FLOWN or task.flown)
        self._flown = task.mission if task is not None and ordered else None
        self._finish = None if self._flown is None else self._ahead(scene, scene.pace)
        self._fit(scene)
        self._out = self._escape_routes(scene.pose.position_m)
        if self._flown in self._out:
            planned = self._out[self._flown]
            self._finish = self._out[self._flown] = self._finish or planned
            self.better = self._flown
            if self._flown is Mission.EXIT and flight is not None and not flight.on_leg:
                full_pace = self._ahead(scene, 1.0) or planned
                self.better = self._instead_of_exit(full_pace, scene.meter)
        else:
            self.better = better_of(self._out, self.better)
        self.demands = self._with_escape_routes(
            Demands(flown=ordered, finish_wh=energy_wh_of(self._finish))
        )

    def _fit(self, scene: ContingencyInputs) -> None:
        """Updates `fitting_stops`."""
        self.fitting_stops = None
        task = scene.status.task
        count = 0 if task is None or self._flown is None else len(task.stops)
        if count < 2 or self._fits(scene, count) is not False:
            self._tight_s = None
            return
        if self._tight_s is None:
            self._tight_s = self._now_s
        if self._now_s - self._tight_s < _TIGHT_FOR_S:
            return
        while count > 1:
            count -= 1
            fits = self._fits(scene, count)
            if fits is None:
                return
            if fits or count == 1:
                self.fitting_stops = count
                return

    def _fits(self, scene: ContingencyInputs, count: int) -> bool | None:
        """True if the energy suffices for the next `count` stops and the way out; None: unknown.

        The charge at the last of them is above that of the exit, and the way out leaves the
        reserve.
        """
        task, flight = scene.status.task, self._active(scene, scene.pace)
        if task is None or flight is None:
            return None
        stops = task.stops[:count]
        visits, out = self._visits(stops, flight, scene.pace), self._way_out(stops[-1])
        if visits is None or out is None:
            return None
        until_s = scene.meter.until_s(self._power, scene.reserve)
        left_s = scene.meter.left_after_s(self._power, visits.then(out).energy_wh)
        if until_s is None or left_s is None:
            return None
        visits_s = visits.energy_wh / self._power.hover_w * S_PER_H
        return until_s > visits_s and left_s > self._power.reserve_s

    def _instead_of_exit(self, full_pace: RouteCost | None, meter: Meter) -> Mission | None:
        """The active exit; where it takes too much, an evacuation that takes clearly less.

        The supervisor permits no change from evacuation to exit. full_pace: the exit at the speed
        of an evacuation.
        """
        left_s = meter.left_after_s(self._power, energy_wh_of(full_pace))
        if left_s is None or left_s > self._power.reserve_s:
            return Mission.EXIT
        return better_of({**self._out, Mission.EXIT: full_pace}, Mission.EXIT)

    def _with_escape_routes(self, demands: Demands) -> Demands:
        return replace(
            demands,
            exit_wh=energy_wh_of(self._out[Mission.EXIT]),
            evacuation_wh=energy_wh_of(self._out[Mission.EVACUATION]),
        )

    def _active(self, scene: ContingencyInputs, pace: float) -> RouteCost | None:
        """The rest of the active plan; None without one, or where the flight was braked."""
        task, flight = scene.status.task, scene.flight
        if task is None or flight is None:
            return None
        if flight.braked and not flight.on_leg and not task.flown:
            return None
        position_m, duration_s = flight.path.rest()
        rest = self._route_cost(position_m, duration_s / pace, self._now_s)
        return self._exposed(rest, position_m, duration_s / pace, scene.volume)

    def _ahead(self, scene: ContingencyInputs, pace: float) -> RouteCost | None:
        """The rest of the flight; None where a part is unknown, or the flight was braked."""
        task, rest = scene.status.task, self._active(scene, pace)
        if task is None or rest is None:
            return None
        if task.mission in _ESCAPE_MISSIONS:
            return rest.then(self._landing(scene.volume))
        if task.done:
            return None
        visits, out = self._visits(task.stops, rest, pace), self._way_out(task.stops[-1])
        return None if visits is None or out is None else visits.then(out)

    def _visits(self, stops: tuple[str, ...], rest: RouteCost, pace: float) -> RouteCost | None:
        """Stays at stops and the legs between them, from the rest of the active plan to the first.

        None where a leg is unknown.
        """
        total = rest
        for stop in stops:
            hold_s = self._site.target(stop).hold_s
            hold_wh = self._power.hover_wh(hold_s)
            total = total.then(replace(rest, duration_s=hold_s, energy_wh=hold_wh, exposed_s=0.0))
        for stop, following in itertools.pairwise(stops):
            route = self._routes.get(_Question(stop, Mission.INSPECTION, following))
            if route is None:
                return None
            total = total.then(route.paced(pace))
        return total

    def _way_out(self, stop: str) -> RouteCost | None:
        """The better escape route from a stop; None where one is unknown, or none has a path."""
        behind = [_Question(stop, mission) for mission in self._outwards]
        if any(question not in self._routes for question in behind):
            return None
        out = {question.mission: self._routes[question] for question in behind}
        best = better_of(out, None)
        return None if best is None else out[best]


def _corners(position_m: FloatArray) -> tuple[RoutePoint, ...]:
    """The points (n, 3) of a route at which it begins, turns or ends."""
    step_m = np.diff(position_m, axis=0)
    length_m = np.sqrt((step_m**2).sum(axis=1))
    moves = length_m > 0.0
    points_m = np.concatenate([position_m[:1], position_m[1:][moves]])
    direction = step_m[moves] / length_m[moves, None]
    turns = np.sqrt((np.diff(direction, axis=0) ** 2).sum(axis=1)) > _TURN
    kept = np.concatenate([[True], turns, [True]])[: len(points_m)]
    return tuple(RoutePoint(x_m=x, y_m=y, z_m=z) for x, y, z in points_m[kept].tolist())

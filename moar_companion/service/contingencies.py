"""Contingencies, always ready: the ways out of the site, and what is still to be flown.

While the aircraft is in the air on a site, an exit and an evacuation from where it is are kept
planned, with time and energy, the landing leg and the landing included; likewise the rest of an
inspection, from target to target, and the ways out behind it. One plan is asked for at a time, in a
lane of its own behind those that are flown. A way that is known stays so until there is a newer
one: until then the flight back to where it begins is a part of it. Inputs: where the aircraft is,
what it flies, the risks, the time; plan answers. Outputs: plan jobs, `Demands`, and the better way
out.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..autopilots.failsafe_actions import BATTERY, NO_FAILSAFES, Failsafes
from ..guidance.trajectory import FloatArray
from ..mission.states import MissionState
from ..mission.values import MissionStatus, Task
from ..planner.fence import PlaneFence
from ..planner.plan import PlanRequest
from ..power import Demands, Meter, PowerModel, landing_s
from ..risk.headway import least_s
from ..site import Site
from ..types import Mission, RiskIndices, Vector
from ..vehicle import RiskModel, Vehicle
from .airspace import Airspace
from .causes import WayOut
from .flight import Flight
from .jobs import PlanAnswer, PlanJob
from .motion import Pose
from .paths import flown
from .ways import Way, better_of, energy_wh_of

_ROUND_S = 2.0
"""Between two rounds of questions: at 5 m/s the aircraft has moved 10 m, which is 2 s of flight."""
_ANSWER_TIMEOUT_S = 5.0
"""As long as for the plans that are flown, after which another one is asked for."""
_FASTEST_MPS = 100.0
"""What tells to fly faster is mistaken: then it is planned from rest."""
_WAYS_OUT = (Mission.EXIT, Mission.EVACUATION)
_FLOWN = frozenset({MissionState.FLYING, MissionState.AT_TARGET, MissionState.LANDING_LEG})


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What a way would take of the batteries, as measured, and the flight time left after it.

    age_s: since it was asked for; of several parts, of the oldest.
    """

    duration_s: float
    energy_wh: float
    left_s: float | None
    age_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Outlook:
    """What is left, and how it lasts, for people; None is unknown, or that there is no such way.

    left_wh and energies are real where the vehicle file has the capacity, else to scale. factor:
    measured power over that of the file, by its source.
    """

    left_wh: float | None
    flight_s: float | None
    factor: float
    source: str
    finish: Outcome | None
    exit: Outcome | None
    evacuation: Outcome | None
    better: Mission | None


@dataclass(frozen=True, slots=True)
class _Question:
    """A way to be planned. origin: a target's name; None for where the aircraft is."""

    origin: str | None
    mission: Mission
    goal: str | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Asked:
    question: _Question
    job: PlanJob
    start_m: Vector
    asked_s: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """What contingencies are planned from: the aircraft in the air, and what it flies.

    pace: the part of its planned speed at which that is flown. meter: of the batteries.
    fence: of the autopilot, as far as it cuts the site.
    wind_mps: the mean wind over ground, in the site's frame; None where it is unknown. model: the
    vehicle's, with the drag by which that is told.
    """

    pose: Pose
    status: MissionStatus
    flight: Flight | None
    airspace: Airspace
    risk: RiskIndices
    widening_m: float
    fence: PlaneFence | None
    failsafes: Failsafes
    pace: float
    meter: Meter
    wind_mps: Vector | None
    model: RiskModel


class Contingencies:
    """Keeps the answers, and asks for them anew, one at a time."""

    def __init__(self, site: Site, vehicle: Vehicle, power: PowerModel) -> None:
        self._site = site
        self._vehicle = vehicle
        self._power = power
        self._outwards = [mission for mission in _WAYS_OUT if site.landing_m.get(mission)]
        self._numbers = itertools.count(1)
        self._jobs: list[PlanJob] = []
        self._asked: _Asked | None = None
        self._queue: list[_Question] = []
        self._due_s = -math.inf
        self._ways: dict[_Question, Way | None] = {}
        """By the last answer with a plan; None where none had one."""
        self._starts: dict[_Question, Vector] = {}
        """Where they begin."""
        self._now_s = -math.inf
        self._failsafes = NO_FAILSAFES
        """On which places count as exposed."""
        self._wind_mps: Vector | None = None
        """As last known in the air."""
        self._in_wind = vehicle
        """The vehicle with the drag by which the wind is told."""
        self.demands: Demands | None = None
        """What is still to be flown; None on the ground."""
        self._finish: Way | None = None
        """The mission, and the better way out behind it; None while none is flown, or unknown."""
        self._out: dict[Mission, Way | None] = {}
        """The ways out; one that is flown, from where it has come to."""
        self._flown: Mission | None = None
        """What is flown."""
        self.better: Mission | None = None
        """The way out that takes less, or that is flown; None while there is none."""

    def look(self, scene: Scene, now_s: float) -> None:
        """See what is to be flown now."""
        self._now_s = now_s
        self._wind_mps = scene.wind_mps or self._wind_mps
        self._in_wind = replace(self._vehicle, risk=scene.model)
        self._failsafes = scene.failsafes.of(BATTERY)
        questions = tuple(self._questions(scene))
        self._ways = {
            question: way
            for question, way in self._ways.items()
            if question.origin is None or question in questions
        }
        self._ask_next(scene, questions, now_s)
        self._sum_up(scene)

    def wait(self, here_m: Vector | None, now_s: float) -> None:
        """Where nothing can be planned, what was known stays; here_m: None where unknown."""
        self._now_s = now_s
        demands = Demands() if self.demands is None else self.demands
        if here_m is not None:
            self._out, self._flown = self._ways_out(here_m), None
            self.better = better_of(self._out, self.better)
            demands = self._with_ways_out(demands)
        self.demands = demands

    def end(self) -> None:
        """On the ground there is nothing to be flown."""
        self._asked, self.demands, self._finish, self.better = None, None, None, None
        self._queue, self._ways, self._out, self._due_s = [], {}, {}, -math.inf
        self._flown, self._wind_mps = None, None

    def outlook(self, meter: Meter) -> Outlook:
        """How what is left lasts."""

        def outcome(way: Way | None) -> Outcome | None:
            if way is None:
                return None
            return Outcome(
                duration_s=way.duration_s,
                energy_wh=meter.factor * way.energy_wh,
                left_s=meter.left_after_s(self._power, way.energy_wh),
                age_s=self._now_s - way.asked_s,
            )

        return Outlook(
            left_wh=meter.left_wh,
            flight_s=meter.flight_s(self._power),
            factor=meter.factor,
            source=meter.source,
            finish=outcome(self._finish),
            exit=outcome(self._out.get(Mission.EXIT)),
            evacuation=outcome(self._out.get(Mission.EVACUATION)),
            better=self.better,
        )

    def way_out(self, meter: Meter) -> WayOut | None:
        """The better way out, and what would be left after it; None while none is known."""
        way = None if self.better is None else self._out.get(self.better)
        if self.better is None or way is None:
            return None
        exit_instead = self._flown is Mission.EXIT and self.better is not Mission.EXIT
        flown = self._out[Mission.EXIT] if exit_instead else None
        flown_left_s = meter.left_after_s(self._power, energy_wh_of(flown))
        if flown_left_s is not None and flown_left_s > self._power.reserve_s:
            flown_left_s = None
        return WayOut(
            mission=self.better,
            left_s=meter.left_after_s(self._power, way.energy_wh),
            reserve_s=self._power.reserve_s,
            age_s=self._now_s - way.asked_s,
            flown_left_s=flown_left_s,
            exposed_s=way.exposed_s,
        )

    def jobs(self) -> list[PlanJob]:
        """Planning jobs since the last call."""
        jobs, self._jobs = self._jobs, []
        return jobs

    def answered(self, answer: PlanAnswer, airspace: Airspace | None) -> None:
        """Take the answer to a job; one that is no longer awaited is dropped."""
        asked = self._asked
        if asked is None or asked.job.job_id != answer.job_id or airspace is None:
            return
        self._asked = None
        way = self._measured(asked, answer, airspace)
        if way is None:
            self._ways.setdefault(asked.question, None)
        else:
            self._ways[asked.question], self._starts[asked.question] = way, asked.start_m

    def _questions(self, scene: Scene) -> Iterator[_Question]:
        """What has to be known: the ways out first."""
        task, flight = scene.status.task, scene.flight
        if flight is None or not flight.on_leg:  # outside the workspace nothing can be planned
            yield from (_Question(None, mission) for mission in self._outwards)
        if task is not None and task.stops:
            for stop, following in itertools.pairwise(task.stops):
                yield _Question(stop, Mission.INSPECTION, following)
            yield from (_Question(task.stops[-1], mission) for mission in self._outwards)

    def _ask_next(self, scene: Scene, questions: tuple[_Question, ...], now_s: float) -> None:
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
        job = PlanJob(
            job_id=next(self._numbers),
            request=PlanRequest(
                mission=question.mission,
                target=question.goal,
                start_m=(x_m, z_m),
                velocity_mps=(vx_mps, vz_mps),
                weights=self._vehicle.weights[question.mission].adjusted(scene.risk),
                risk=scene.risk,
            ),
            widening_m=scene.widening_m,
            fence=scene.fence,
            failsafes=scene.failsafes,
        )
        self._asked = _Asked(question=question, job=job, start_m=(x_m, 0.0, z_m), asked_s=now_s)
        self._jobs.append(job)

    def _measured(self, asked: _Asked, answer: PlanAnswer, airspace: Airspace) -> Way | None:
        plan = answer.plan
        if plan is None:
            return None
        path = flown(plan, asked.start_m, answer.escape_m, airspace.leg_speeds_mps)
        trajectory = airspace.widened(answer.reach).trajectory(path)
        speed_mps = math.hypot(*asked.job.request.velocity_mps)
        rest = trajectory.rest(0.0, speed_mps, self._vehicle.guidance.acceleration_mps2)
        way = self._exposed(self._way(*rest, asked.asked_s), *rest, airspace)
        return (
            way
            if asked.question.mission is Mission.INSPECTION
            else way.then(self._landing(airspace))
        )

    def _way(self, position_m: FloatArray, duration_s: FloatArray, asked_s: float) -> Way:
        """What points (n, 3) in times (n - 1,) take, where the wind lets it be as fast."""
        if self._wind_mps is not None:
            steps_m = np.diff(position_m, axis=0)
            against_s = least_s(steps_m, self._wind_mps[:2], self._in_wind)
            duration_s = np.maximum(duration_s, against_s)
        return Way(
            duration_s=float(duration_s.sum()),
            energy_wh=self._power.path_wh(position_m, duration_s),
            asked_s=asked_s,
        )

    def _exposed(
        self, way: Way, position_m: FloatArray, duration_s: FloatArray, airspace: Airspace
    ) -> Way:
        """The way with its exposed time, by its points (n, 3) and the times (n - 1,) between."""
        if not self._failsafes.actions:
            return way
        exposed = self._failsafes.exposed(airspace.maps.reach, position_m[:, ::2])
        last = int(np.flatnonzero(exposed)[-1]) if exposed.any() else 0
        return replace(way, exposed_s=float(duration_s[:last].sum()))

    def _landing(self, airspace: Airspace) -> Way:
        height_m, kind = self._vehicle.guidance.landing_height_m, airspace.loss.kind
        return Way(
            duration_s=landing_s(height_m, kind),
            energy_wh=self._power.landing_wh(height_m, kind),
            asked_s=self._now_s,
        )

    def _ways_out(self, here_m: Vector) -> dict[Mission, Way | None]:
        """The ways out from here: as last planned, behind the flight back to where they begin."""
        ways: dict[Mission, Way | None] = {}
        for mission in _WAYS_OUT:
            question = _Question(None, mission)
            way = self._ways.get(question)
            if way is not None:
                way = self._straight(here_m, self._starts[question]).then(way)
            ways[mission] = way
        return ways

    def _straight(self, here_m: Vector, there_m: Vector) -> Way:
        """The straight way from here to there, at full speed."""
        x_m, y_m, up_m = (there - here for here, there in zip(here_m, there_m, strict=True))
        power = self._power
        upward_mps = power.climb_mps if up_m > 0.0 else power.descent_mps
        seconds = max(math.hypot(x_m, y_m) / power.cruise_mps, abs(up_m) / upward_mps)
        ends, duration_s = np.array([here_m, there_m]), np.array([seconds])
        return self._way(ends, duration_s, self._now_s)

    def _sum_up(self, scene: Scene) -> None:
        status, task, flight = scene.status, scene.status.task, scene.flight
        ordered = task is not None and (status.state in _FLOWN or task.flown)
        self._flown = task.mission if task is not None and ordered else None
        self._finish = None if self._flown is None else self._ahead(scene, scene.pace)
        self._out = self._ways_out(scene.pose.position_m)
        if self._flown in self._out:
            planned = self._out[self._flown]
            self._finish = self._out[self._flown] = self._finish or planned
            self.better = self._flown
            if self._flown is Mission.EXIT and flight is not None and not flight.on_leg:
                full_pace = self._ahead(scene, 1.0) or planned
                self.better = self._instead_of_exit(full_pace, scene.meter)
        else:
            self.better = better_of(self._out, self.better)
        self.demands = self._with_ways_out(
            Demands(flown=ordered, finish_wh=energy_wh_of(self._finish))
        )

    def _instead_of_exit(self, full_pace: Way | None, meter: Meter) -> Mission | None:
        """The exit that is flown; where it takes too much, an evacuation that takes clearly less.

        The other way round the supervisor would not have it. full_pace: the exit as fast as the
        evacuation would be.
        """
        left_s = meter.left_after_s(self._power, energy_wh_of(full_pace))
        if left_s is None or left_s > self._power.reserve_s:
            return Mission.EXIT
        return better_of({**self._out, Mission.EXIT: full_pace}, Mission.EXIT)

    def _with_ways_out(self, demands: Demands) -> Demands:
        return replace(
            demands,
            exit_wh=energy_wh_of(self._out[Mission.EXIT]),
            evacuation_wh=energy_wh_of(self._out[Mission.EVACUATION]),
        )

    def _ahead(self, scene: Scene, pace: float) -> Way | None:
        """What is ahead of the flight; None where a part is unknown, or where it was braked."""
        task, flight = scene.status.task, scene.flight
        if task is None or flight is None:
            return None
        if flight.braked and not flight.on_leg and not task.flown:
            return None
        position_m, duration_s = flight.rest()
        rest = self._way(position_m, duration_s / pace, self._now_s)
        rest = self._exposed(rest, position_m, duration_s / pace, scene.airspace)
        return self._rest(task, rest, self._landing(scene.airspace), pace)

    def _rest(self, task: Task, rest: Way, landing: Way, pace: float) -> Way | None:
        """A task's rest, from that of the plan that is flown; None where a part is unknown."""
        if task.mission in _WAYS_OUT:
            return rest.then(landing)
        if task.done:
            return None
        total = rest
        for stop in task.stops:
            dwell_s = self._site.target(stop).dwell_s
            dwell_wh = self._power.hover_wh(dwell_s)
            total = total.then(replace(rest, duration_s=dwell_s, energy_wh=dwell_wh))
        for stop, following in itertools.pairwise(task.stops):
            way = self._ways.get(_Question(stop, Mission.INSPECTION, following))
            if way is None:
                return None
            total = total.then(way.paced(pace))
        behind = [_Question(task.stops[-1], mission) for mission in self._outwards]
        if any(question not in self._ways for question in behind):
            return None
        out = {question.mission: self._ways[question] for question in behind}
        best = better_of(out, None)
        way = None if best is None else out[best]
        return None if way is None else total.then(way)

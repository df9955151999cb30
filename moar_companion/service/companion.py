"""The companion: one machine without I/O. Bytes and time in, bytes out.

    bytes -> session -> telemetry -> pose, risk indices -> weights -> plan job
    plan answer -> flight -> setpoint -> gate -> session -> bytes

The shell feeds it with `receive` and `plan_answered`, lets it think with `tick` at the setpoint
rate, and carries away `data_to_send`, `plan_jobs` and `decisions`. It never waits and has no clock;
the same inputs at the same times give the same outputs, byte for byte.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Any

from ..config import Authority, CompanionConfig
from ..frames import PlaneToLocal
from ..mavlink.commands import CommandCancelled, CommandResult, MissionCommand, PauseContinue
from ..mavlink.identity import AutopilotConflict, AutopilotRestarted
from ..mavlink.session import Event, Session, Severity, SystemStatus
from ..mission import machine
from ..mission.machine import (
    IN_CONTROL,
    STREAMING,
    Answer,
    Do,
    Effect,
    MissionState,
    MissionStatus,
    Order,
    Say,
    Seek,
    Situation,
    Step,
    Task,
    Verdict,
)
from ..mission.replanning import replan_reason
from ..planner.maps import Maps
from ..planner.plan import PlanRequest
from ..risk import RiskEstimate, update
from ..site import Site
from ..types import Mission, RiskIndices, Telemetry, Weights
from ..vehicle import Vehicle
from .flight import Adoption, Flight, Junction, Pose, Setpoint
from .jobs import PlanAnswer, PlanJob
from .orders import RESULTS, OrderBook, Refused, understood
from .surroundings import Surroundings, airborne

_RISK_PERIOD_S = 0.1
_REPORT_PERIOD_S = 0.5
_ENGAGE_AFTER_S = 1.2
"""PX4 gives OFFBOARD to a stream that has run for a second."""
_OFF_PATH_FOR_S = 1.0
"""An aircraft that is off its path for so long will not be back by itself."""
_LONGEST_STEP_S = 0.1
"""After a longer pause of the shell the reference moves on as if only this had passed."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """Something the companion decided, for the record: its kind and data fit for JSON."""

    time_s: float
    kind: str
    data: dict[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ground:
    """What a companion that plans needs to know of its site."""

    site: Site
    maps: Maps


@dataclass(frozen=True, kw_only=True, eq=False)
class _Awaited:
    """A plan that was asked for, where it begins, and whether it is the mission's first."""

    job: PlanJob
    junction: Junction
    first: bool


class Companion:
    """The machine. ground: None without a site: then telemetry and risk only."""

    def __init__(self, config: CompanionConfig, vehicle: Vehicle, ground: Ground | None) -> None:
        self._config = config
        self._vehicle = vehicle
        self._ground = ground
        self._session = Session(
            links={link.url: link.role for link in config.links},
            system_id=config.system_id,
            component_id=config.component_id,
        )
        self._status = MissionStatus()
        self._risk = RiskEstimate.unknown(vehicle.risk)
        self._flight: Flight | None = None
        self._awaited: _Awaited | None = None
        site = None if ground is None else ground.site
        self._surroundings = Surroundings(site, vehicle.autopilot, config.supervision)
        self._orders = OrderBook()
        self._job_ids = itertools.count(1)
        self._jobs: list[PlanJob] = []
        self._decisions: list[Decision] = []
        self._fault: str | None = None
        self._thought_s: float | None = None
        self._risk_due_s = -math.inf
        self._report_due_s = -math.inf
        self._planned_s = -math.inf
        self._planned_risk = RiskIndices()
        self._near_path_s = -math.inf
        self._engaged_s = -math.inf

    @property
    def telemetry(self) -> Telemetry:
        """The last word of every source."""
        return self._session.telemetry

    @property
    def status(self) -> MissionStatus:
        """Where the mission stands."""
        return self._status

    @property
    def risk(self) -> RiskEstimate:
        """The risk indices and what they are made of."""
        return self._risk

    @property
    def weights(self) -> Weights:
        """The weights of the present mission under the present risks (Eq. 9)."""
        task = self._status.sought or self._status.task
        mission = Mission.INSPECTION if task is None else task.mission
        return self._vehicle.weights[mission].adjusted(self._risk.indices)

    # In

    def receive(self, link: str, data: bytes, now_s: float) -> None:
        """Takes bytes from a link, split anywhere."""
        self._session.receive(link, data, now_s)

    def shut_down(self, now_s: float) -> None:
        """The process is about to end: what is streamed ends at rest."""
        if self._status.state in STREAMING:
            self._send_farewell(now_s)

    def plan_answered(self, answer: PlanAnswer, now_s: float) -> None:
        """Takes the answer to a job; one that is no longer awaited is dropped."""
        awaited = self._awaited
        if awaited is None or awaited.job.job_id != answer.job_id:
            return
        self._awaited = None
        if answer.plan is None:
            if awaited.first:
                self._carry_out(machine.unplanned(self._status, answer.reason, now_s), now_s)
            else:
                self._session.send_text(Severity.NOTICE, f"Replan: {answer.reason}", now_s)
            return
        adopted = self._adopt(awaited, answer, now_s)
        if not awaited.first:
            return
        if adopted is not Adoption.TOO_LATE:
            self._near_path_s = now_s
            step = machine.planned(self._status, now_s)
            self._carry_out(step, now_s)
        elif self._status.sought is not None:
            self._ask(self._status.sought, now_s, first=True)

    def tick(self, now_s: float) -> None:
        """Think: what was heard, what it means, what is to be streamed now."""
        step_s = min(_LONGEST_STEP_S, 0.0 if self._thought_s is None else now_s - self._thought_s)
        self._thought_s = now_s
        for event in self._session.events_received():
            self._handle(event, now_s)
        if now_s >= self._risk_due_s:
            self._risk_due_s = now_s + _RISK_PERIOD_S
            self._risk = update(
                self._risk,
                self.telemetry,
                now_s,
                model=self._vehicle.risk,
                cruise_mps=self._vehicle.speed.horizontal_mps,
            )
        self._carry_out(
            machine.tick(
                self._status,
                self._situation(now_s),
                ready_timeout_s=self._config.supervision.ready_timeout_s,
                resume=self._config.resume,
                now_s=now_s,
            ),
            now_s,
        )
        self._fault = None
        for command in self._orders.in_progress(now_s):
            self._session.answer(command, CommandResult.IN_PROGRESS)
        self._replan(now_s)
        self._stream(now_s, step_s)
        self._engage(now_s)
        streaming = self._status.state in STREAMING
        self._session.tick(now_s, SystemStatus.ACTIVE if streaming else SystemStatus.STANDBY)
        if now_s >= self._report_due_s:
            self._report_due_s = now_s + _REPORT_PERIOD_S
            self._report(now_s)

    # Out

    def data_to_send(self) -> list[tuple[str, bytes]]:
        """Packets since the last call, each with its link's URL."""
        return self._session.data_to_send()

    def packets_heard(self) -> list[tuple[float, bytes]]:
        """Whole packets that arrived since the last call, with their times, for the record."""
        return self._session.packets_heard()

    def plan_jobs(self) -> list[PlanJob]:
        """Planning jobs since the last call. Only the newest one's answer is awaited."""
        jobs, self._jobs = self._jobs, []
        return jobs

    def decisions(self) -> list[Decision]:
        """What was decided since the last call."""
        decisions, self._decisions = self._decisions, []
        return decisions

    # What is heard

    def _handle(self, event: Event, now_s: float) -> None:
        if isinstance(event, MissionCommand | PauseContinue):
            self._handle_order(event, now_s)
        elif isinstance(event, CommandCancelled):
            order_id = self._orders.withdraw(event.command)
            if order_id is not None:
                self._carry_out(machine.withdrawn(self._status, order_id, now_s), now_s)
        elif isinstance(event, AutopilotRestarted):
            self._fault = "the autopilot restarted"
        elif isinstance(event, AutopilotConflict):
            text = f"Two autopilots, none is controlled: {event.autopilot}, {event.other}"
            self._session.send_text(Severity.ERROR, text, now_s)
            self._record("text", now_s, text=text)

    def _handle_order(self, command: MissionCommand | PauseContinue, now_s: float) -> None:
        order_id = self._orders.enter(command, now_s)
        site = None if self._ground is None else self._ground.site
        order = understood(command, site, self._config.authority)
        self._record("order", now_s, order=_words(order), sender=command.sender.system_id)
        if isinstance(order, Refused):
            answer = Answer(order_id, Verdict.DENIED, order.reason)
            self._carry_out((self._status, (answer,)), now_s)
        else:
            world = self._situation(now_s)
            step = machine.command(self._status, order, order_id, world, now_s)
            self._carry_out(step, now_s)

    # What it means

    def _pose(self) -> Pose | None:
        return self._surroundings.pose(self.telemetry)

    def _situation(self, now_s: float) -> Situation:
        telemetry, flight = self.telemetry, self._flight
        autopilot, pose = telemetry.autopilot, self._pose()
        return Situation(
            obstruction=self._fault
            or self._surroundings.obstruction(
                telemetry, control_allowed=self._session.control_allowed, now_s=now_s
            ),
            reluctance=self._surroundings.reluctance(telemetry),
            airborne=airborne(telemetry),
            mode_ours=autopilot is not None and autopilot.ours,
            autopilot_failsafe=autopilot is not None and autopilot.failsafe,
            on_leg=flight is not None and flight.on_leg,
            arrived=flight is not None and flight.arrived,
            dwell_s=self._dwell_s(),
            astray=flight is not None
            and pose is not None
            and flight.error_m(pose) > self._vehicle.guidance.tracking_hold_m,
        )

    def _dwell_s(self) -> float:
        """How long to stay at the present target."""
        task = self._status.task
        if self._ground is None or task is None or not task.stops:
            return 0.0
        return self._ground.site.target(task.stops[0]).dwell_s

    # What follows

    def _carry_out(self, step: Step, now_s: float) -> None:
        before = self._status.state
        self._status, effects = step
        if self._status.state is not before:
            self._record("state", now_s, state=self._status.state.value, before=before.value)
        for effect in effects:
            self._carry_out_one(effect, now_s)
        if self._status.sought is None:
            if self._status.state not in STREAMING:
                self._flight = None
                self._awaited = None
            elif self._awaited is not None and self._awaited.first:
                # Taken back: its plan must not be flown when it comes.
                self._awaited = None

    def _carry_out_one(self, effect: Effect, now_s: float) -> None:
        match effect:
            case Seek(task):
                if task == self._status.task and self._flight and self._flight.resume_leg():
                    self._carry_out(machine.planned(self._status, now_s), now_s)
                else:
                    self._ask(task, now_s, first=True)
            case Answer(order_id, verdict, reason):
                self._answer(order_id, verdict, reason, now_s)
            case Say(text, serious):
                severity = Severity.WARNING if serious else Severity.NOTICE
                self._session.send_text(severity, text, now_s)
                self._record("text", now_s, text=text)
            case Do.BRAKE:
                self._awaited = None
                if self._flight is not None:
                    self._flight.brake()
            case Do.FAREWELL:
                self._send_farewell(now_s)
            case Do.LAND:
                if self._config.authority is Authority.ENGAGE:
                    self._session.request_land()

    def _answer(self, order_id: int, verdict: Verdict, reason: str, now_s: float) -> None:
        self._session.answer(self._orders.close(order_id), RESULTS[verdict])
        self._record("answer", now_s, verdict=verdict.value, reason=reason)
        if verdict is not Verdict.ACCEPTED and reason:
            self._session.send_text(Severity.WARNING, f"MOAR {verdict.value}: {reason}", now_s)

    def _ask(self, task: Task, now_s: float, *, first: bool, recover: bool = False) -> bool:
        """Ask the planner for a task's plan, from where it can be joined; whether it was asked."""
        pose = self._pose()
        if pose is None or self._ground is None:
            return False
        if self._flight is None:
            self._flight = Flight(self._ground.site, self._vehicle, self._ground.maps, pose)
        junction = self._flight.junction_at(pose) if recover else self._flight.junction()
        if not first and junction.at_end:
            return False
        (x_m, _, z_m), (vx_mps, _, vz_mps) = junction.position_m, junction.velocity_mps
        risk = self._risk.indices
        job = PlanJob(
            job_id=next(self._job_ids),
            request=PlanRequest(
                mission=task.mission,
                target=task.goal,
                start_m=(x_m, z_m),
                velocity_mps=(vx_mps, vz_mps),
                weights=self._vehicle.weights[task.mission].adjusted(risk),
                risk=risk,
            ),
        )
        self._awaited = _Awaited(job=job, junction=junction, first=first)
        self._jobs.append(job)
        self._planned_s, self._planned_risk = now_s, risk
        return True

    def _adopt(self, awaited: _Awaited, answer: PlanAnswer, now_s: float) -> Adoption:
        """Fly the plan if it can still be joined; for the record, say so."""
        flight, plan = self._flight, answer.plan
        if flight is None or plan is None:
            return Adoption.TOO_LATE
        adoption = flight.adopt(plan, awaited.junction, answer.escape_end_m)
        if adoption is Adoption.NEW_PATH:
            self._record("plan", now_s, first=awaited.first, plan=plan.to_dict())
        return adoption

    def _replan(self, now_s: float) -> None:
        """Ask for a new plan when there is a reason, while a path is flown."""
        flight, task = self._flight, self._status.task
        if (
            self._status.state is not MissionState.FLYING
            or flight is None
            or task is None
            or self._awaited is not None
        ):
            return
        pose = self._pose()
        if pose is None:
            return
        if flight.error_m(pose) <= self._vehicle.guidance.off_path_m:
            self._near_path_s = now_s
        elif now_s - self._near_path_s >= _OFF_PATH_FOR_S:
            self._near_path_s = now_s
            self._record("replan", now_s, reason=f"{flight.error_m(pose):.1f} m off the path")
            self._ask(task, now_s, first=False, recover=True)
            return
        reason = replan_reason(
            self._config.replanning,
            planned_risk=self._planned_risk,
            risk=self._risk.indices,
            age_s=now_s - self._planned_s,
        )
        if reason is not None and self._ask(task, now_s, first=False):
            self._record("replan", now_s, reason=reason)

    def _stream(self, now_s: float, step_s: float) -> None:
        """Send the setpoint of this instant, if one may be sent."""
        flight, pose, plane = self._flight, self._pose(), self._surroundings.plane(self.telemetry)
        if self._status.state not in STREAMING or not flight or not pose or not plane:
            return
        if self._status.state in IN_CONTROL:
            flight.advance(pose, step_s)
        setpoint = flight.setpoint(pose, plane, step_s)
        refused = flight.refusal(setpoint, self._config.supervision.plane_tolerance_m)
        if refused is not None:
            # Nothing more is streamed in this tick; the next one lets go.
            self._fault = refused
            return
        self._send_setpoint(setpoint, plane, now_s)

    def _send_farewell(self, now_s: float) -> None:
        """The last setpoint before silence is at rest where the last one was."""
        flight, pose, plane = self._flight, self._pose(), self._surroundings.plane(self.telemetry)
        if flight and pose and plane:
            setpoint = flight.setpoint(pose, plane, 0.0)
            self._send_setpoint(replace(setpoint, velocity_mps=(0.0, 0.0, 0.0)), plane, now_s)

    def _send_setpoint(self, setpoint: Setpoint, plane: PlaneToLocal, now_s: float) -> None:
        self._session.send_setpoint(
            plane.position_to_ned(setpoint.position_m),
            plane.velocity_to_ned(setpoint.velocity_mps),
            setpoint.yaw_rad,
            now_s,
        )

    def _engage(self, now_s: float) -> None:
        """Under `engage`: ask once for the mode, when the stream has run long enough."""
        status = self._status
        if (
            self._config.authority is Authority.ENGAGE
            and status.state is MissionState.READY
            and self._engaged_s < status.since_s <= now_s - _ENGAGE_AFTER_S
        ):
            self._engaged_s = now_s
            self._session.request_own_mode()

    # What people see

    def _report(self, now_s: float) -> None:
        """Risk indices and weights for ground stations; the state of things for the record."""
        indices, weights = self._risk.indices, self.weights
        for name, value in (
            ("RISK_WIND", indices.wind),
            ("RISK_COMM", indices.communication),
            ("RISK_LOC", indices.localization),
            ("RISK_BATT", indices.battery),
            ("K_SAFETY", weights.safety),
            ("K_TIME", weights.time),
            ("K_ENERGY", weights.energy),
        ):
            self._session.send_named_value(name, value, now_s)
        pose = self._pose()
        self._record(
            "status",
            now_s,
            state=self._status.state.value,
            risk=indices.as_dict(),
            weights={
                "safety": weights.safety,
                "time": weights.time,
                "energy": weights.energy,
            },
            position_m=None if pose is None else list(pose.position_m),
        )

    def _record(self, kind: str, now_s: float, **data: Any) -> None:
        self._decisions.append(Decision(time_s=now_s, kind=kind, data=data))


def _words(order: Task | Order | Refused) -> str:
    """An order for the record."""
    if isinstance(order, Task):
        return " ".join([order.mission.value, *order.stops])
    return order.reason if isinstance(order, Refused) else order.value

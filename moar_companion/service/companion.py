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
from ..mavlink.commands import (
    Command,
    CommandCancelled,
    CommandResult,
    MissionCommand,
    PauseContinue,
)
from ..mavlink.identity import AutopilotRestarted
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
from ..types import LandedState, Mission, RiskIndices, Telemetry, Weights
from ..vehicle import Vehicle
from .flight import Adoption, Flight, Junction, Pose, Setpoint
from .jobs import PlanAnswer, PlanJob

_RISK_PERIOD_S = 0.1
_REPORT_PERIOD_S = 0.5
_IN_PROGRESS_AFTER_S = 0.2
"""An order that is still being planned after this is answered IN_PROGRESS (contract)."""
_ENGAGE_AFTER_S = 1.2
"""PX4 gives OFFBOARD to a stream that has run for a second."""
_OFF_PATH_FOR_S = 1.0
"""An aircraft that is off its path for so long will not be back by itself."""
_LONGEST_STEP_S = 0.1
"""After a longer pause of the shell the reference moves on as if only this had passed."""

_RESULTS = {
    Verdict.ACCEPTED: CommandResult.ACCEPTED,
    Verdict.TEMPORARILY_REJECTED: CommandResult.TEMPORARILY_REJECTED,
    Verdict.DENIED: CommandResult.DENIED,
    Verdict.FAILED: CommandResult.FAILED,
    Verdict.CANCELLED: CommandResult.CANCELLED,
}


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


@dataclass(frozen=True, slots=True, kw_only=True)
class _OpenOrder:
    """An operator's command that has no final answer yet."""

    command: Command
    received_s: float
    progress_told: bool = False


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
        self._plane: tuple[object, PlaneToLocal] | None = None
        self._flight: Flight | None = None
        self._awaited: _Awaited | None = None
        self._orders: dict[int, _OpenOrder] = {}
        self._order_ids = itertools.count(1)
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
            step = machine.planned(self._status, self._situation(now_s), now_s)
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
        self._tell_progress(now_s)
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
            for order_id, order in list(self._orders.items()):
                if order.command == event.command:
                    del self._orders[order_id]
                    self._carry_out(machine.withdrawn(self._status, order_id, now_s), now_s)
        elif isinstance(event, AutopilotRestarted):
            self._fault = "the autopilot restarted"

    def _handle_order(self, command: MissionCommand | PauseContinue, now_s: float) -> None:
        order_id = next(self._order_ids)
        self._orders[order_id] = _OpenOrder(command=command, received_s=now_s)
        order = self._understood(command)
        self._record("order", now_s, order=str(order), sender=command.sender.system_id)
        if isinstance(order, str) and not isinstance(order, Order):
            self._carry_out((self._status, (Answer(order_id, Verdict.DENIED, order),)), now_s)
            return
        self._carry_out(
            machine.command(self._status, order, order_id, self._situation(now_s), now_s), now_s
        )

    def _understood(self, command: MissionCommand | PauseContinue) -> Task | Order | str:
        """What a command orders; a text why it cannot be."""
        if isinstance(command, PauseContinue):
            return Order.HOLD if command.pause else Order.CONTINUE
        if not isinstance(command.mission, Mission):
            return Order(command.mission)
        if self._ground is None:
            return "no site is loaded"
        if self._config.authority is Authority.OBSERVE:
            return "the authority is observe"
        site, index = self._ground.site, command.index
        if command.mission is Mission.INSPECTION:
            names = tuple(target.name for target in site.targets)
            if not names or (index is not None and index >= len(names)):
                return f"no target {index or 0}: the site has {len(names)}"
            return Task(mission=command.mission, stops=names if index is None else (names[index],))
        landings = site.landing_m.get(command.mission, ())
        if not landings or (index is not None and index >= len(landings)):
            return f"no landing point {index or 0}: the site has {len(landings)}"
        return Task(mission=command.mission, landing=index)

    # What it means

    def _situation(self, now_s: float) -> Situation:
        telemetry = self.telemetry
        autopilot = telemetry.autopilot
        pose = self._pose()
        flight = self._flight
        task = self._status.task
        dwell_s = 0.0
        if self._ground is not None and task is not None and task.stops:
            dwell_s = next(
                target.dwell_s
                for target in self._ground.site.targets
                if target.name == task.stops[0]
            )
        reluctance = None
        if pose is not None:
            off_m = abs(pose.position_m[1])
            tolerance_m = self._config.supervision.plane_tolerance_m
            if off_m > tolerance_m:
                reluctance = f"{off_m:.1f} m from the plane, more than {tolerance_m:g} m"
        return Situation(
            obstruction=self._obstruction(pose, now_s),
            reluctance=reluctance,
            airborne=autopilot is not None
            and autopilot.armed
            and telemetry.landed_state in {LandedState.IN_AIR, LandedState.LANDING},
            mode_ours=autopilot is not None and autopilot.ours,
            autopilot_failsafe=autopilot is not None and autopilot.failsafe,
            on_leg=flight is not None and flight.on_leg,
            arrived=flight is not None and flight.arrived,
            dwell_s=dwell_s,
        )

    def _obstruction(self, pose: Pose | None, now_s: float) -> str | None:
        """Why nothing may be streamed now."""
        if self._fault is not None:
            return self._fault
        telemetry, limits = self.telemetry, self._config.supervision
        autopilot, position = telemetry.autopilot, telemetry.local_position
        if autopilot is None:
            return "no autopilot is heard"
        if not self._session.control_allowed:
            return "two autopilots are heard"
        if now_s - autopilot.received_s > limits.heartbeat_timeout_s:
            return f"no heartbeat of the autopilot for {now_s - autopilot.received_s:.1f} s"
        if position is None:
            return "no local position is heard"
        if now_s - position.received_s > limits.position_timeout_s:
            return f"the position is {now_s - position.received_s:.1f} s old"
        if pose is None:
            return "the origin of the local frame, or the attitude, is unknown"
        return None

    def _plane_to_local(self) -> PlaneToLocal | None:
        """The map from the site's frame to the autopilot's, made anew when its origin moves."""
        origin, autopilot = self.telemetry.local_origin, self.telemetry.autopilot
        if self._ground is None or origin is None or autopilot is None:
            return None
        kind = self._vehicle.autopilot or autopilot.kind
        if self._plane is None or self._plane[0] != (origin.point, kind):
            frame = self._ground.site.frame
            self._plane = ((origin.point, kind), PlaneToLocal.between(frame, origin.point, kind))
        return self._plane[1]

    def _pose(self) -> Pose | None:
        """The aircraft in the site's frame; None while that is unknown."""
        plane = self._plane_to_local()
        position, attitude = self.telemetry.local_position, self.telemetry.attitude
        if plane is None or position is None or attitude is None:
            return None
        return Pose(
            position_m=plane.position_from_ned(position.position_ned_m),
            velocity_mps=plane.velocity_from_ned(position.velocity_ned_mps),
            yaw_rad=attitude.yaw_rad,
        )

    # What follows

    def _carry_out(self, step: Step, now_s: float) -> None:
        before = self._status.state
        self._status, effects = step
        if self._status.state is not before:
            self._record("state", now_s, state=self._status.state.value, before=before.value)
        for effect in effects:
            self._carry_out_one(effect, now_s)
        if self._status.state not in STREAMING and self._status.sought is None:
            self._flight = None
            self._awaited = None

    def _carry_out_one(self, effect: Effect, now_s: float) -> None:
        match effect:
            case Seek(task):
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
        order = self._orders.pop(order_id)
        self._session.answer(order.command, _RESULTS[verdict])
        self._record("answer", now_s, verdict=verdict.value, reason=reason)
        if verdict is not Verdict.ACCEPTED and reason:
            self._session.send_text(Severity.WARNING, f"MOAR {verdict.value}: {reason}", now_s)

    def _tell_progress(self, now_s: float) -> None:
        for order_id, order in self._orders.items():
            if not order.progress_told and now_s - order.received_s > _IN_PROGRESS_AFTER_S:
                self._session.answer(order.command, CommandResult.IN_PROGRESS)
                self._orders[order_id] = replace(order, progress_told=True)

    def _ask(self, task: Task, now_s: float, *, first: bool, recover: bool = False) -> None:
        """Ask the planner for a task's plan, from where it can be joined."""
        pose = self._pose()
        if pose is None or self._ground is None:
            return
        if self._flight is None:
            self._flight = Flight(self._ground.site, self._vehicle, self._ground.maps, pose)
        junction = self._flight.junction_at(pose) if recover else self._flight.junction()
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
        if reason is not None:
            self._record("replan", now_s, reason=reason)
            self._ask(task, now_s, first=False)

    def _stream(self, now_s: float, step_s: float) -> None:
        """Send the setpoint of this instant, if one may be sent."""
        flight, pose, plane = self._flight, self._pose(), self._plane_to_local()
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
        flight, pose, plane = self._flight, self._pose(), self._plane_to_local()
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

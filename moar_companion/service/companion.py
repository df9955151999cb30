"""The companion: one machine without I/O. Bytes and time in, bytes out.

    bytes -> session -> telemetry -> pose, risk indices -> weights -> plan job
    plan answer -> flight -> setpoint -> gate -> session -> bytes

The shell feeds it with `receive` and `plan_answered`, lets it think with `tick` at the setpoint
rate, and carries away `data_to_send`, `plan_jobs` and `decisions`. It never waits and has no clock;
the same inputs at the same times give the same outputs, byte for byte.
"""

from __future__ import annotations

import math

from ..config import Authority, CompanionConfig
from ..mavlink.commands import (
    Command,
    CommandCancelled,
    CommandResult,
    DeniedCommand,
    MissionCommand,
    PauseContinue,
)
from ..mavlink.identity import AutopilotConflict, AutopilotRestarted
from ..mavlink.session import CommandAnswered, Session, Severity, SystemStatus
from ..mission import machine
from ..mission.machine import (
    IN_CONTROL,
    STREAMING,
    Answer,
    Do,
    Effect,
    MissionState,
    MissionStatus,
    Say,
    Seek,
    Situation,
    Step,
    Task,
    Verdict,
)
from ..mission.replanning import replan_reason
from ..risk import RiskEstimate, update
from ..types import Mission, Telemetry, Weights
from ..vehicle import Vehicle
from .flight import Adoption, Flight
from .jobs import PlanAnswer, PlanJob
from .orders import RESULTS, OrderBook, Refused, understood, words
from .planning import Awaited, PlanDesk
from .reports import Decision, Reports
from .stream import Engaging, Stream
from .surroundings import Ground, Surroundings, airborne, grounded

_RISK_PERIOD_S = 0.1
_REPORT_PERIOD_S = 0.5
_OFF_PATH_FOR_S = 1.0
"""An aircraft that is off its path for so long will not be back by itself."""
_LONGEST_STEP_S = 0.1
"""After a longer pause of the shell the reference moves on as if only this had passed."""


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
        self._reports = Reports(self._session)
        self._setpoints = Stream(self._session)
        self._engaging = Engaging(config.authority)
        self._status = MissionStatus()
        self._risk = RiskEstimate.unknown(vehicle.risk)
        self._flight: Flight | None = None
        self._plans = PlanDesk()
        site = None if ground is None else ground.site
        self._surroundings = Surroundings(site, vehicle.autopilot, config.supervision)
        self._orders = OrderBook()
        self._orders_heard: list[MissionCommand | PauseContinue] = []
        self._fault: str | None = None
        self._parting = True
        self._thought_s: float | None = None
        self._risk_due_s = -math.inf
        self._report_due_s = -math.inf
        self._near_path_s = -math.inf
        self._landing_requested = False

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
        """The process is about to end: what is streamed ends at rest, if it still may."""
        self._hear(now_s)
        world = self._situation(now_s)
        if (
            self._status.state in STREAMING
            and world.obstruction is None
            and not world.autopilot_failsafe
            and (world.mode_ours or self._status.state is MissionState.READY)
        ):
            self._setpoints.send_farewell(self._surroundings.plane, now_s)

    def plan_answered(self, answer: PlanAnswer, now_s: float) -> None:
        """Takes the answer to a job; one that is no longer awaited is dropped."""
        self._hear(now_s)
        self._plan_answered(answer, now_s)

    def _plan_answered(self, answer: PlanAnswer, now_s: float) -> None:
        awaited = self._plans.taken(answer)
        if awaited is None:
            return
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
        elif self._status.sought is not None and self._flight is not None:
            # The planner is slower than the flight: it begins where that can be at rest.
            self._flight.brake()
            self._ask(self._status.sought, now_s, first=True)

    def tick(self, now_s: float) -> None:
        """Think: what was heard, what it means, what is to be streamed now."""
        paused_s = 0.0 if self._thought_s is None else now_s - self._thought_s
        self._thought_s = now_s
        if paused_s > self._config.supervision.position_timeout_s:
            # What has arrived meanwhile is old, and the autopilot may have given up on us.
            self._let_go(f"thinking paused for {paused_s:.1f} s", parting=False)
        self._hear(now_s)
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
        self._fault, self._parting = None, True
        orders, self._orders_heard = self._orders_heard, []
        for order in orders:
            self._handle_order(order, now_s)
        self._give_up_waiting(now_s)
        for command in self._orders.in_progress(now_s):
            self._session.answer(command, CommandResult.IN_PROGRESS)
        self._replan(now_s)
        self._stream(now_s, min(_LONGEST_STEP_S, paused_s))
        self._engaging.look(self._status, grounded=grounded(self.telemetry))
        if self._engaging.is_due(self.telemetry.autopilot, self._status, now_s):
            self._session.request_own_mode()
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
        return self._plans.jobs()

    def decisions(self) -> list[Decision]:
        """What was decided since the last call."""
        return self._reports.decisions()

    # What is heard

    def _hear(self, now_s: float) -> None:
        """Take in telemetry and events.

        Orders wait for the next thought, until what ends our control has been looked at.
        """
        jump_m = self._surroundings.look(self.telemetry)
        if jump_m is not None and self._flight is not None:
            self._flight.shift(jump_m)
            self._setpoints.shift(jump_m)
            self._reports.record("jump", now_s, jump_m=list(jump_m))
        for event in self._session.events_received():
            match event:
                case MissionCommand() | PauseContinue():
                    self._orders_heard.append(event)
                case CommandCancelled(command=command):
                    self._withdraw(command, now_s)
                case DeniedCommand(reason=reason):
                    self._tell_why(Verdict.DENIED, reason, now_s)
                case CommandAnswered(result=result) if result != CommandResult.ACCEPTED:
                    text = "MOAR: the autopilot refused the mode"
                    self._reports.say(Severity.WARNING, text, now_s)
                case AutopilotRestarted():
                    self._let_go("the autopilot restarted", parting=False)
                case AutopilotConflict(autopilot=autopilot, other=other):
                    text = f"MOAR: two autopilots, no control: {autopilot}, {other}"
                    self._reports.say(Severity.ERROR, text, now_s)

    def _withdraw(self, command: Command, now_s: float) -> None:
        """An operator took an order back, which has been acknowledged."""
        self._orders_heard = [order for order in self._orders_heard if order != command]
        order_id = self._orders.withdraw(command)
        if order_id is not None:
            self._carry_out(machine.withdrawn(self._status, order_id, now_s), now_s)

    def _let_go(self, fault: str, *, parting: bool) -> None:
        """The next look at the mission ends the stream."""
        self._fault, self._parting = fault, parting

    def _handle_order(self, command: MissionCommand | PauseContinue, now_s: float) -> None:
        order_id = self._orders.enter(command, now_s)
        site = None if self._ground is None else self._ground.site
        order = understood(command, site, self._config.authority)
        self._reports.record("order", now_s, order=words(order), sender=command.sender.system_id)
        if isinstance(order, Refused):
            answer = Answer(order_id, Verdict.DENIED, order.reason)
            self._carry_out((self._status, (answer,)), now_s)
        else:
            world = self._situation(now_s)
            step = machine.command(self._status, order, order_id, world, now_s)
            self._carry_out(step, now_s)
            if self._status.order_id == order_id:
                self._engaging.note_order(self.telemetry.autopilot)

    # What it means

    def _situation(self, now_s: float) -> Situation:
        telemetry, flight = self.telemetry, self._flight
        autopilot, guidance = telemetry.autopilot, self._vehicle.guidance
        pose = self._surroundings.pose
        error_m = math.inf if flight is None or pose is None else flight.error_m(pose)
        mode_ours = autopilot is not None and autopilot.ours
        return Situation(
            obstruction=self._fault
            or self._surroundings.obstruction(
                telemetry, control_allowed=self._session.control_allowed, now_s=now_s
            ),
            parting=self._parting and mode_ours,
            reluctance=self._surroundings.reluctance(),
            airborne=airborne(telemetry, now_s),
            grounded=grounded(telemetry),
            mode_ours=mode_ours,
            mode_heard_s=-math.inf if autopilot is None else autopilot.received_s,
            autopilot_failsafe=autopilot is not None and autopilot.failsafe,
            landing_requested=self._landing_requested,
            on_leg=flight is not None and flight.on_leg,
            arrived=flight is not None and flight.arrived and error_m <= guidance.tracking_slow_m,
            dwell_s=self._dwell_s(),
            astray=flight is not None and error_m > guidance.tracking_hold_m,
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
            self._reports.record(
                "state", now_s, state=self._status.state.value, before=before.value
            )
        for effect in effects:
            self._carry_out_one(effect, now_s)
        if self._status.state is not MissionState.HOLDING:
            self._landing_requested = False
        if self._status.sought is None:
            if self._status.state not in STREAMING:
                self._flight = None
                self._plans.forget()
            elif self._plans.awaited is not None and self._plans.awaited.first:
                # Taken back: its plan must not be flown when it comes.
                self._plans.forget()

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
                self._reports.say(severity, text, now_s)
            case Do.BRAKE:
                self._plans.forget()
                if self._flight is not None:
                    self._flight.brake()
            case Do.FAREWELL:
                self._setpoints.send_farewell(self._surroundings.plane, now_s)
            case Do.LAND:
                if self._config.authority is Authority.ENGAGE:
                    self._landing_requested = self._session.request_land()

    def _answer(self, order_id: int, verdict: Verdict, reason: str, now_s: float) -> None:
        self._session.answer(self._orders.close(order_id), RESULTS[verdict])
        self._reports.record("answer", now_s, verdict=verdict.value, reason=reason)
        if reason:
            self._tell_why(verdict, reason, now_s)

    def _tell_why(self, verdict: Verdict, reason: str, now_s: float) -> None:
        """An acknowledgement has no words: the reason goes to people as a text."""
        self._reports.say(Severity.WARNING, f"MOAR {verdict.value}: {reason}", now_s)

    def _ask(self, task: Task, now_s: float, *, first: bool, recover: bool = False) -> bool:
        """Ask the planner for a task's plan, from where it can be joined; whether it was asked."""
        pose = self._surroundings.pose
        if pose is None or self._ground is None:
            return False
        if self._flight is None:
            self._flight = Flight(self._ground.site, self._vehicle, self._ground.maps, pose)
        junction = self._flight.junction_at(pose) if recover else self._flight.junction()
        if not first and junction.at_end:
            return False
        risk = self._risk.indices
        weights = self._vehicle.weights[task.mission].adjusted(risk)
        self._plans.ask(task, junction, weights, risk, first=first, now_s=now_s)
        return True

    def _adopt(self, awaited: Awaited, answer: PlanAnswer, now_s: float) -> Adoption:
        """Fly the plan if it can still be joined; for the record, say so."""
        flight, plan = self._flight, answer.plan
        if flight is None or plan is None:
            return Adoption.TOO_LATE
        adoption = flight.adopt(plan, awaited.junction, answer.escape_end_m)
        if adoption is Adoption.NEW_PATH:
            self._reports.record("plan", now_s, first=awaited.first, plan=plan.to_dict())
        return adoption

    def _give_up_waiting(self, now_s: float) -> None:
        """A plan that does not come is none."""
        silence = self._plans.overdue(now_s)
        if silence is not None:
            self._plan_answered(silence, now_s)

    def _replan(self, now_s: float) -> None:
        """Ask for a new plan when there is a reason, while a path is flown."""
        flight, task = self._flight, self._status.task
        if (
            self._status.state is not MissionState.FLYING
            or flight is None
            or task is None
            or self._plans.awaited is not None
        ):
            return
        pose = self._surroundings.pose
        if pose is None:
            return
        if flight.error_m(pose) <= self._vehicle.guidance.off_path_m:
            self._near_path_s = now_s
        elif now_s - self._near_path_s >= _OFF_PATH_FOR_S:
            self._near_path_s = now_s
            self._reports.record(
                "replan", now_s, reason=f"{flight.error_m(pose):.1f} m off the path"
            )
            self._ask(task, now_s, first=False, recover=True)
            return
        reason = replan_reason(
            self._config.replanning,
            planned_risk=self._plans.asked_risk,
            risk=self._risk.indices,
            age_s=now_s - self._plans.asked_s,
        )
        if reason is not None and self._ask(task, now_s, first=False):
            self._reports.record("replan", now_s, reason=reason)

    def _stream(self, now_s: float, step_s: float) -> None:
        """Send the setpoint of this instant, if one may be sent."""
        flight, pose, plane = self._flight, self._surroundings.pose, self._surroundings.plane
        if self._status.state not in STREAMING or not flight or not pose or not plane:
            return
        if self._status.state in IN_CONTROL:
            flight.advance(pose, step_s)
        # The nose turns only once the aircraft follows: else it would be swung round then.
        setpoint = flight.setpoint(pose, plane, step_s if self._status.state in IN_CONTROL else 0)
        refused = flight.refusal(setpoint, self._config.supervision.plane_tolerance_m)
        if refused is not None:
            self._let_go(refused, parting=True)
            return
        self._setpoints.send(setpoint, plane, now_s)

    # What people see

    def _report(self, now_s: float) -> None:
        """Risk indices and weights for ground stations; the state of things for the record."""
        indices, weights, pose = self._risk.indices, self.weights, self._surroundings.pose
        self._reports.send_values(indices, weights, now_s)
        self._reports.record_status(
            self._status.state.value,
            indices,
            weights,
            None if pose is None else pose.position_m,
            now_s,
        )

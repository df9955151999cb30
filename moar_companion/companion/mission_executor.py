"""The mission executor: executes the decisions of the mission machine and the supervisor.

Inputs: orders, answers of the planner, state of aircraft and computer, time.
Outputs: plan jobs, setpoints, answers to orders, texts for people.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace

from ..config import CompanionConfig
from ..contingency.contingency_planner import Scene
from ..estimation.pose import Jump
from ..estimation.pose_tracker import Ground, PoseTracker
from ..guidance.splice import Adoption
from ..margin import margin_of
from ..mavlink.commands import Command, MissionCommand, PauseContinue
from ..mavlink.session import Session, Severity
from ..mission import state_machine
from ..mission.values import (
    Answer,
    Do,
    Effect,
    MissionStatus,
    OverrideConditions,
    Say,
    Seek,
    Situation,
    Step,
    Task,
    Verdict,
)
from ..mission_states import IN_CONTROL, STREAMING, MissionState
from ..planning.plan_jobs import PlanAnswer
from ..power.cells import misread
from ..risk import RiskEstimate
from ..safety.check_inputs import CheckInputs, EscapeRoute, Host
from ..safety.condition_types import Action
from ..safety.position_checks import widening_m
from ..safety.supervisor import Ruling
from ..telemetry import LandedState
from ..types import Mission
from ..vehicle import Vehicle
from .faults import Faults
from .mission_snapshot import MissionSnapshot
from .mode_requester import ModeRequester
from .operator_commands import OperatorCommands, Refused, understood, words
from .plan_requests import Awaited
from .reports import Reports
from .risk_monitor import RiskMonitor
from .route_manager import RouteManager
from .safety_monitor import SafetyMonitor
from .setpoint_streamer import SetpointStreamer
from .wind_recovery import WindRecovery

_ON_THE_WAY = (MissionState.FLYING, MissionState.LANDING_LEG)
_SLOW_PACE = 0.5
"""Fraction of the planned speed while a condition demands SLOW."""


class MissionExecutor:
    """Holds the mission status and executes the mission.

    ground: None without a site. before: memory of the previous process.
    """

    def __init__(
        self,
        config: CompanionConfig,
        vehicle: Vehicle,
        ground: Ground | None,
        *,
        session: Session,
        pose_tracker: PoseTracker,
        orders: OperatorCommands,
        reports: Reports,
        safety_monitor: SafetyMonitor,
        before: MissionSnapshot | None,
    ) -> None:
        self._config = config
        self._vehicle = vehicle
        self._margin = margin_of(vehicle, config.supervision)
        self._ground = ground
        self._session = session
        self._pose_tracker = pose_tracker
        self._orders = orders
        self._reports = reports
        self.routes = RouteManager(ground, vehicle, config, reports, self._margin)
        self.setpoints = SetpointStreamer(session, vehicle, config.supervision, self._margin)
        pilot_may_fly = before is not None and before.state is not MissionState.IDLE
        self.mode_requester = ModeRequester(
            config.authority, session, reports, pilot_flies=pilot_may_fly
        )
        self._recovery = WindRecovery(reports)
        self._safety_monitor = safety_monitor
        site = None if ground is None else ground.site
        self.status = state_machine.restarted(None if before is None else before.rest(site))
        """Mission status: state, task and request."""
        self.untouched = True
        """True until the first change of the status by an order, a plan or a transition."""
        self._paths_changed = False
        """True if a search that found no path may find one now."""
        self.risk_monitor = RiskMonitor(ground, vehicle)
        """The present risk indices, and the escape routes."""
        self.host = Host()
        """Free resources of the computer."""
        self.faults = Faults()
        """Faults since the last cycle."""

    @property
    def risk(self) -> RiskEstimate:
        """The present risk indices."""
        return self.risk_monitor.risk

    @property
    def ruling(self) -> Ruling:
        """Permitted action, and the conditions against a flight."""
        return self._safety_monitor.ruling

    @property
    def tracking_error_m(self) -> float | None:
        """Distance from our setpoint to the aircraft; infinite where its pose is unknown.

        None while the companion is not in control.
        """
        flight, pose = self.routes.flight, self._pose_tracker.pose
        if flight is None or self.status.state not in IN_CONTROL:
            return None
        return math.inf if pose is None else flight.error_m(pose)

    @property
    def _follows(self) -> bool:
        """True while the autopilot is in the mode in which it follows our setpoints."""
        autopilot = self._session.telemetry.autopilot
        return autopilot is not None and autopilot.ours

    @property
    def _escapes(self) -> bool:
        """True while an exit or evacuation is flown."""
        task = self.status.task
        in_control = self.status.state in IN_CONTROL
        return in_control and task is not None and task.mission is not Mission.INSPECTION

    @property
    def _pace(self) -> float:
        """Fraction of the planned speed that is flown."""
        return _SLOW_PACE if self.ruling.action is Action.SLOW else 1.0

    # The stages of a cycle, in this order

    def look_ahead(self, now_s: float) -> None:
        """Updates the remaining flight, and the obstacles that autopilot failsafes would hit."""
        telemetry, pose = self._session.telemetry, self._pose_tracker.pose
        place_m = None if pose is None else pose.position_m
        self.risk_monitor.keep_escape_routes(telemetry, self._scene(), place_m, now_s)
        volume = self.routes.volume
        if self.status.state in IN_CONTROL and volume is not None:
            watch, meter = self.routes.watch, self.risk.meter
            watch.look(place_m, volume.maps.reach, telemetry, meter, now_s)
            note = watch.note(self._exposure_limit_s, self.status.since_s, now_s)
            if note is not None and not self._escapes:
                self._reports.say(Severity.NOTICE, note, now_s)

    def assess_risk(self, now_s: float) -> None:
        """Updates the risk indices from telemetry and the remaining flight."""
        session = self._session
        self.risk_monitor.judge(
            session.telemetry, session.requests.parameters, self.tracking_error_m, now_s
        )

    def rule(self, now_s: float) -> None:
        """Steps the supervisor, once a cycle, with the checks of everything observed."""
        self.setpoints.widened_m = widening_m(self.risk, self._margin)
        error_m = None if self._escapes else self.tracking_error_m
        self._paths_changed = self.routes.look(self.risk, error_m, now_s)
        self._safety_monitor.rule(self._check_inputs(now_s), now_s)
        self.faults.forget()

    def transition(self, now_s: float) -> None:
        """Steps the mission machine; before plans and orders, so that a release comes first."""
        step = state_machine.tick(
            self.status,
            self._situation(now_s),
            paths_changed=self._paths_changed,
            ready_timeout_s=self._config.supervision.ready_timeout_s,
            resume=self._config.resume,
            now_s=now_s,
        )
        self._carry_out(step, now_s)

    def take_plan(self, answer: PlanAnswer, now_s: float) -> None:
        """Takes the answer to a job; one that is no longer awaited is dropped."""
        awaited = self.routes.taken(answer)
        if awaited is None:
            return
        ordered = self.status.order_id is not None
        answer = self.routes.checked_for_offboard_loss(awaited, answer, now_s, ordered=ordered)
        if answer.plan is None:
            self._go_without(awaited, answer, now_s)
            return
        adopted = self.routes.adopt(awaited, answer, self.risk, now_s)
        if not awaited.first:
            return
        if adopted is not Adoption.TOO_LATE:
            step = state_machine.planned(self.status, self._situation(now_s), now_s)
            self._carry_out(step, now_s)
        elif self.status.sought is not None and self.routes.flight is not None:
            # The planner is slower than the flight: the next plan begins at a stop point.
            self.routes.brake()
            self._seek(self.status.sought, now_s)

    def withdraw(self, command: Command, now_s: float) -> None:
        """Withdraws an order that an operator cancelled after its acknowledgement."""
        order_id = self._orders.withdraw(command)
        if order_id is not None:
            self._carry_out(state_machine.withdrawn(self.status, order_id, now_s), now_s)

    def order(self, command: MissionCommand | PauseContinue, now_s: float) -> None:
        """Executes, or refuses, an order."""
        order_id = self._orders.enter(command, now_s)
        site = None if self._ground is None else self._ground.site
        order = understood(command, site, self._config.authority)
        self._reports.record("order", now_s, order=words(order), sender=command.sender.system_id)
        if isinstance(order, Refused):
            answer = Answer(order_id, Verdict.DENIED, order.reason)
            self._carry_out((self.status, (answer,)), now_s)
        else:
            world, before = self._situation(now_s), self.status.state
            status, effects = state_machine.command(self.status, order, order_id, world, now_s)
            if not command.permitted:
                # A sender without permission may stop the aircraft, but overrules no condition.
                effects = tuple(
                    item for item in effects if not isinstance(item, OverrideConditions)
                )
            self._carry_out((status, effects), now_s)
            # The task may be flown already: the rest of a landing leg needs no plan.
            if status.order_id == order_id:
                self.mode_requester.note_order(self._session.telemetry.autopilot, before, now_s)

    def route(self, now_s: float) -> None:
        """Requests a better plan, or a recovery leg, where one is due."""
        self._orders.tell_progress(now_s)
        pose, task = self._pose_tracker.pose, self.status.task
        if self.status.state in _ON_THE_WAY and task is not None and pose is not None:
            self.routes.replan(task, pose, self.risk.indices, now_s)
        width_m = self.routes.inflation.lasting_m
        self._recovery.act(self.routes.flight, pose, self.status, self.ruling, width_m, now_s)

    def follow(self, now_s: float, step_s: float) -> None:
        """Flies on along the route and sends the gated setpoint. step_s: since the last cycle."""
        self._stream(now_s, step_s)
        engaged = self.status.state in STREAMING or self.status.state is MissionState.PLANNING
        telemetry = self._session.telemetry
        known = self.status.known if self.status.order_id is not None else ()
        station = telemetry.ground_station
        self._safety_monitor.tell(station, now_s, streaming=engaged, known=known)
        at_end = self.routes.arrived(self._pose_tracker.pose, now_s)
        self.mode_requester.act(self.status, telemetry, at_end=at_end, now_s=now_s)

    def shift(self, jump: Jump, now_s: float) -> None:
        """Moves setpoint and flight with a position or heading that jumped."""
        self.setpoints.shift(jump, self._pose_tracker.plane)
        if self.routes.flight is not None:
            self.routes.flight.shift(jump)
            self._reports.record("jump", now_s, jump_m=list(jump.step_m), turn_rad=jump.turn_rad)

    def shut_down(self, now_s: float) -> None:
        """Ends the setpoint stream at rest, if still permitted, before the process ends."""
        if (
            self.status.state in STREAMING
            and self.ruling.action is not Action.RELEASE
            and (self._follows or self.status.state is MissionState.READY)
        ):
            self._send_last_setpoint(now_s)

    def take_contingency(self, answer: PlanAnswer) -> None:
        """Takes the answer to a contingency's job; one that is no longer awaited is dropped."""
        if self.risk_monitor.ways is not None:
            self.risk_monitor.ways.answered(answer, self.routes.volume)

    def _go_without(self, awaited: Awaited, answer: PlanAnswer, now_s: float) -> None:
        """Handles a missing plan: an order is denied, another request stays pending for room."""
        reason = self.routes.inflation.explained(answer)
        if answer.detail:
            self._reports.record("no_plan", now_s, reason=reason, detail=answer.detail)
        ordered = awaited.first and self.status.order_id is not None
        no_room = answer.too_wide and not ordered and self.ruling.action <= Action.HOLD
        if no_room:
            self.routes.inflation.note_no_room(awaited, reason)
        if awaited.first:
            waits = no_room or (answer.would_collide and not ordered)
            step = state_machine.unplanned(
                self.status, reason, now_s, waits=waits, failed=answer.failed
            )
            self._carry_out(step, now_s)
        elif not no_room:
            self._reports.say(Severity.NOTICE, reason, now_s, action="path kept")
            if self.routes.braked:
                self._carry_out(state_machine.blocked(self.status, now_s), now_s)

    # Inputs of the mission machine

    @property
    def _exposure_limit_s(self) -> float:
        """Maximum stay where a failsafe without a forecast would hit an obstacle, dwell added."""
        return self._config.supervision.exposure_limit_s + self._dwell_s

    @property
    def _dwell_s(self) -> float:
        """Time to stay at the present target."""
        task = self.status.task
        return 0.0 if self._ground is None or task is None else self._ground.dwell_s(task.stops)

    def _exposure(self, escape_route: EscapeRoute | None, now_s: float) -> str | None:
        """Reason to leave before an autopilot failsafe acts; None if there is none."""
        return self.routes.watch.reason(
            self._session.telemetry,
            self.risk.meter,
            leaving_s=None if escape_route is None else escape_route.exposed_s,
            limit_s=self._exposure_limit_s,
            from_s=self.status.since_s,
            now_s=now_s,
        )

    def _scene(self) -> Scene | None:
        """Inputs of contingency planning; None where no plan is possible."""
        pose, volume = self._pose_tracker.pose, self.routes.volume
        landed = self._session.telemetry.landed
        if pose is None or volume is None:
            return None
        if landed is not None and landed.state is not LandedState.IN_AIR:
            return None  # the aircraft takes off or lands
        plane, spread = self._pose_tracker.plane, self.risk.wind.spread
        beside = abs(pose.position_m[1]) > self._config.supervision.plane_tolerance_m
        if beside and self.status.state not in STREAMING:
            return None  # the pilot or autopilot flies it elsewhere
        return Scene(
            pose=pose,
            status=self.status,
            flight=self.routes.flight,
            volume=volume,
            risk=self.risk.indices,
            widening_m=self.routes.inflation.lasting_m,
            fence=self.routes.fence,
            failsafes=self.routes.watch.failsafes,
            pace=self._pace,
            meter=self.risk.meter,
            wind_mps=None
            if plane is None or spread is None
            else plane.velocity_from_ned((*spread.mean_ne_mps, 0.0)),
            model=self.risk.wind.learning.used(self._vehicle.risk),
        )

    def _situation(self, now_s: float) -> Situation:
        """Inputs of the mission machine; changes nothing."""
        autopilot, guidance = self._session.telemetry.autopilot, self._vehicle.guidance
        flight, pose = self.routes.flight, self._pose_tracker.pose
        error_m = math.inf if flight is None or pose is None else flight.error_m(pose)
        return Situation(
            ruling=self.ruling,
            mode_ours=self._follows,
            mode_heard_s=-math.inf if autopilot is None else autopilot.received_s,
            on_leg=flight is not None and flight.on_leg,
            arrived=self.routes.arrived(pose, now_s),
            dwell_s=self._dwell_s,
            astray=flight is not None and error_m > guidance.tracking_hold_m,
        )

    def _check_inputs(self, now_s: float) -> CheckInputs:
        """Inputs of the supervisor's checks."""
        flight, pose, ground = self.routes.flight, self._pose_tracker.pose, self._ground
        telemetry, ways = self._session.telemetry, self.risk_monitor.ways
        escape_route = None if ways is None else ways.escape_route(self.risk.meter)
        room_m = None
        if ground is not None and pose is not None:
            room_m = ground.room_m(pose, self._vehicle.radius_m)
        agreement, jumped_m = self._pose_tracker.agreement, self._pose_tracker.jumped_m(now_s)
        return CheckInputs(
            telemetry=telemetry,
            risk=self.risk,
            conflict=self._session.conflict,
            expected=self._vehicle.autopilot,
            pose=pose,
            position_moved_s=self._pose_tracker.position_moved_s,
            position_late_s=self._pose_tracker.position_late_s,
            jumped_m=jumped_m,
            jump_margin_m=self._jump_margin_m(room_m, jumped_m),
            origin_moved_m=agreement.origin_moved_m,
            origin_margin_m=self._jump_margin_m(room_m, agreement.origin_moved_m),
            global_off_m=agreement.global_off_m,
            home_off_m=agreement.home_off_m,
            room_m=room_m,
            widening_m=widening_m(self.risk, self._margin),
            in_control=self.status.state in IN_CONTROL,
            escaping=self._escapes,
            landing=self.mode_requester.is_landing(telemetry.autopilot, now_s),
            azimuth_rad=None if ground is None else math.radians(ground.site.frame.azimuth_deg),
            misread=misread(telemetry, self._vehicle.risk.cells),
            error_m=flight.error_m(pose) if flight is not None and pose is not None else None,
            drifted_m=flight.drifted_m(pose) if flight is not None and pose is not None else None,
            saturated=self.risk_monitor.saturated,
            held_wind_mps=self.risk_monitor.held_wind_mps,
            stands=flight is not None and flight.stands and self.status.state in _ON_THE_WAY,
            strays=flight.strays(pose) if flight is not None and pose is not None else None,
            plan_awaited_s=self.routes.awaited_for_s(now_s),
            fence_silent=self._session.requests.fence_silent,
            escape_route=escape_route,
            exposure=self._exposure(escape_route, now_s),
            host=self.host,
            faults=replace(
                self.faults.causes,
                offboard_loss_unknown=self.routes.not_ready_reason,
                autopilot_fence=self.routes.fence_objection(pose),
                offboard_loss_collision=self.routes.objection,
                no_clearance=self.faults.causes.no_clearance or self.routes.inflation.no_room,
            ),
        )

    def _jump_margin_m(self, room_m: float | None, jumped_m: float) -> float:
        """Permitted position error, here and before a jump of `jumped_m`.

        room_m: from the aircraft's hull to the nearest keep-out.
        """
        if room_m is None:
            return math.inf
        spare_m = room_m - self._margin.tracking_m - jumped_m
        return max(0.0, self._margin.position_m + min(0.0, room_m) + max(0.0, spare_m))

    # Effects

    def _carry_out(self, step: Step, now_s: float) -> None:
        """Takes the new status and carries out each effect once, in order."""
        self._take(step[0], now_s)
        effects = deque(step[1])
        while effects:
            effects.extendleft(reversed(self._carry_out_one(effects.popleft(), now_s)))
        if self.status.sought is None:
            if self.status.state not in STREAMING:
                self.routes.end()
            else:
                self.routes.forget_first()

    def _take(self, status: MissionStatus, now_s: float) -> None:
        before, self.status = self.status, status
        if status != before:
            self.untouched = False
        if status.state is not before.state:
            before_word = before.state.value
            self._reports.record("state", now_s, state=status.state.value, before=before_word)

    def _carry_out_one(self, effect: Effect, now_s: float) -> tuple[Effect, ...]:
        """Carries out an effect; returns the effects of the transition that it leads to."""
        match effect:
            case Seek(task):
                if self.routes.resume(task, self._pose_tracker.pose):
                    # The rest of a landing leg needs no plan.
                    status, effects = state_machine.planned(
                        self.status, self._situation(now_s), now_s
                    )
                    self._take(status, now_s)
                    return effects
                self._seek(task, now_s)
            case Answer(order_id, verdict, reason):
                self._orders.answer(order_id, verdict, reason, now_s)
            case Say(text, action, serious, news, condition):
                severity = Severity.WARNING if serious else Severity.NOTICE
                self._reports.say(severity, text, now_s, action=action, news=news)
                if condition:
                    self._safety_monitor.note_told(condition)
            case Do.BRAKE:
                self.routes.brake()
            case OverrideConditions(known):
                self._safety_monitor.override(known)
                if "origin_moved" in known:
                    self._pose_tracker.agreement.accept_origin()
                self.mode_requester.forget_landing()
            case Do.SEND_LAST_SETPOINT:
                self._send_last_setpoint(now_s)
            case Do.LAND:
                self.mode_requester.note_landing()
        return ()

    def _seek(self, task: Task, now_s: float) -> None:
        """Requests a task's first plan."""
        self.routes.ask(task, self._pose_tracker.pose, self.risk.indices, now_s, first=True)

    def _stream(self, now_s: float, step_s: float) -> None:
        """Sends this instant's setpoint; a refusal is a fault for the next cycle's checks.

        Where another setpoint was sent instead, the flight stops there, and replans from there.
        """
        flight, pose = self.routes.flight, self._pose_tracker.pose
        plane = self._pose_tracker.plane
        if self.status.state not in STREAMING or not flight or not pose or not plane:
            if plane is not None and self._follows and self.ruling.last_setpoint:
                self.setpoints.resend_last_setpoint(plane, now_s)
            self.setpoints.end()
            return
        in_control = self.status.state in IN_CONTROL
        if in_control:
            holds = self.status.state is MissionState.HOLDING
            flight.advance(pose, step_s, self._pace, holds=holds)
        # The heading turns only in control: else the aircraft would swing round at engagement.
        setpoint = flight.setpoint(pose, plane, step_s if in_control else 0)
        refused = self.setpoints.send(setpoint, flight, plane, now_s)
        if refused is None:
            return
        self.faults.note_refusal(refused)
        if refused.rest is not None:
            self.routes.stand(refused.rest.position_m)
            if self.status.sought is not None:
                self._seek(self.status.sought, now_s)

    def _send_last_setpoint(self, now_s: float) -> None:
        """Sends the last setpoint before the stream ends: the previous place, at rest."""
        flight, plane = self.routes.flight, self._pose_tracker.plane
        if flight is not None and plane is not None:
            self.setpoints.send_last_setpoint(flight, plane, now_s)

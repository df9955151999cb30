"""The mission executor: executes the decisions of the mission machine and the supervisor.

Inputs: orders, answers of the planner, state of aircraft and computer, time. Outputs: plan jobs,
setpoints, answers to orders, texts for operators.
"""

from __future__ import annotations

from collections import deque

from ..mavlink.received_commands import Accepted
from ..mavlink.session import Session, Severity
from ..risk import RiskEstimate
from ..risk.receivers import trouble
from ..settings.config import Authority, CompanionConfig
from ..settings.vehicle import Vehicle
from ..texts import service_texts
from .cycle_inputs import ON_THE_WAY, CycleInputs, Faults, escapes
from .error_margin import margin_of
from .estimation.pose import Jump
from .estimation.pose_tracker import PoseTracker, SiteMaps
from .guidance.splice import Adoption
from .mission import state_machine
from .mission.values import (
    Answer,
    Effect,
    FlightEffect,
    MissionStatus,
    Order,
    OverrideConditions,
    RequestPlan,
    SendText,
    Situation,
    Step,
    Task,
    Verdict,
)
from .mission_snapshot import MissionSnapshot
from .mission_states import IN_CONTROL, STREAMING, MissionState
from .mode_requester import ModeRequester
from .operator_commands import OperatorCommands, Refused, understood, words
from .plan_requests import Awaited
from .planning.plan_jobs import PlanAnswer
from .refuge import Refuge
from .reports import Reports
from .risk_monitor import RiskMonitor
from .route_manager import RouteManager
from .safety.check_inputs import Host
from .safety.condition_types import Action
from .safety.position_checks import widening_m
from .safety.supervisor import Ruling
from .safety_monitor import SafetyMonitor
from .seen_obstacles import SeenObstacles
from .setpoint_streamer import SetpointStreamer
from .wind_recovery import WindRecovery

_SLOW_PACE = 0.5
"""Fraction of the planned speed while a condition demands SLOW."""


class MissionExecutor:
    """Holds the mission status and executes the mission. before: memory of the previous process.

    Before `take_ground` there is no site: telemetry and risk only.
    """

    def __init__(
        self,
        config: CompanionConfig,
        vehicle: Vehicle,
        *,
        session: Session,
        pose_tracker: PoseTracker,
        orders: OperatorCommands,
        reports: Reports,
        safety_monitor: SafetyMonitor,
        before: MissionSnapshot | None,
        seen_obstacles: SeenObstacles,
    ) -> None:
        self._config = config
        self._vehicle = vehicle
        self._margin = margin_of(vehicle, config.supervision)
        self._session = session
        self._pose_tracker = pose_tracker
        self._orders = orders
        self._reports = reports
        self.routes = RouteManager(vehicle, config, reports, self._margin)
        self.setpoints = SetpointStreamer(
            session, vehicle, config.supervision, self._margin, config.perception.keep_out_m
        )
        pilot_may_fly = before is not None and before.state is not MissionState.IDLE
        self.mode_requester = ModeRequester(
            config.authority, session, reports, pilot_flies=pilot_may_fly
        )
        self._recovery = WindRecovery(reports)
        self._safety_monitor = safety_monitor
        self.status = MissionStatus()
        """Mission status: state, task and request."""
        self.status_changed = False
        """True from the first change of the status by an order, a plan or a transition."""
        self._withdrawn: deque[int] = deque()
        """Numbers of orders that were cancelled since the last transition."""
        self._paths_changed = False
        """True if a search that found no path may find one now."""
        self.risk_monitor = RiskMonitor(vehicle)
        """The present risk indices, and the escape routes."""
        self._refuge = Refuge(vehicle, config.supervision, self.risk_monitor, reports)
        self._inputs = CycleInputs(
            vehicle,
            config.supervision,
            self._margin,
            session=session,
            pose_tracker=pose_tracker,
            routes=self.routes,
            risk_monitor=self.risk_monitor,
            mode_requester=self.mode_requester,
            seen_obstacles=seen_obstacles,
            refuge=self._refuge,
        )
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
    def _pace(self) -> float:
        """Fraction of the planned speed that is flown."""
        return _SLOW_PACE if self.ruling.action is Action.SLOW else 1.0

    def take_ground(self, site_maps: SiteMaps, before: MissionSnapshot | None) -> None:
        """Takes the site, whose planner is ready, and the rest of the previous process's task.

        Under `observe` nothing is flown, also no rest.
        """
        self.routes.limits.take_ground(site_maps)
        self.risk_monitor.take_site(site_maps.site)
        flies = self._config.authority is not Authority.OBSERVE
        if flies and not self.status_changed and before is not None:
            self.status = state_machine.restarted(before.rest(site_maps.site))

    # The stages of a cycle, in this order

    def look_ahead(self, now_s: float) -> None:
        """Updates the remaining flight, and the obstacles that autopilot failsafes would hit."""
        telemetry, pose = self._session.telemetry, self._pose_tracker.pose
        place_m = None if pose is None else pose.position_m
        scene = self._inputs.scene(self.status, self._pace)
        self.risk_monitor.keep_escape_routes(telemetry, scene, place_m, now_s)
        volume = self.routes.limits.volume
        if self.status.state in IN_CONTROL and volume is not None:
            watch, meter = self.routes.limits.watch, self.risk.meter
            watch.update(place_m, volume.maps.reach, telemetry, meter, now_s)
            landing, route = (
                watch.next_battery_action(telemetry, meter),
                self.risk_monitor.escape_route,
            )
            leaving_s = None if route is None else route.exposed_s
            blind = trouble(telemetry, self.risk.localization.receivers, now_s) is not None
            flight = self.routes.flight
            self._refuge.look(
                volume,
                watch.failsafes,
                place_m,
                landing,
                leaving_s,
                now_s,
                blind=blind,
                leaves=flight is not None and flight.leaves,
            )
            limit_s = self._inputs.exposure_limit_s(self.status)
            note = watch.note(limit_s, self.status.since_s, now_s)
            if note is not None and not escapes(self.status):
                self._reports.send_text(Severity.NOTICE, note, now_s)

    def assess_risk(self, now_s: float) -> None:
        """Updates the risk indices from telemetry and the remaining flight."""
        session, error_m = self._session, self._inputs.tracking_error_m(self.status)
        self.risk_monitor.judge(session.telemetry, session.requests.parameters, error_m, now_s)

    def rule(self, now_s: float) -> None:
        """Steps the supervisor, once a cycle, with the checks of everything observed."""
        self.setpoints.widened_m = widening_m(self.risk, self._margin)
        tracking_error_m = self._inputs.tracking_error_m(self.status)
        error_m = None if escapes(self.status) else tracking_error_m
        self._paths_changed |= self.routes.update_inflation(self.risk, error_m, now_s)
        faults = self.faults.causes
        seen = self._inputs.check_inputs(self.status, self.host, faults, now_s)
        self._safety_monitor.rule(seen, now_s)
        self.faults.forget()

    def transition(self, now_s: float) -> None:
        """Steps the mission machine: with cancelled orders, the planner's answer, the ruling.

        A failed search comes before the ruling, which may require the next escape route at once.
        """
        while self._withdrawn:
            step = state_machine.withdrawn(self.status, self._withdrawn.popleft(), now_s)
            self._carry_out(step, now_s)
        taken = self.routes.taken(now_s)
        if taken is not None:
            self._take_plan(*taken, now_s)
        step = state_machine.tick(
            self.status,
            self._situation(now_s),
            paths_changed=self._paths_changed,
            ready_timeout_s=self._config.supervision.ready_timeout_s,
            resume=self._config.resume,
            now_s=now_s,
        )
        self._paths_changed = False
        self._carry_out(step, now_s)

    def _take_plan(self, awaited: Awaited, answer: PlanAnswer, now_s: float) -> None:
        """Adopts an awaited plan, or handles its absence."""
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
        elif self.status.requested is not None and self.routes.flight is not None:
            # The planner is slower than the flight: the next plan begins at a stop point.
            self.routes.brake()
            self._carry_out((self.status, self._request_plan(self.status.requested, now_s)), now_s)

    def withdraw(self, order_id: int) -> None:
        """Takes an order that its operator cancelled, for the next transition."""
        self._withdrawn.append(order_id)

    def order(self, command: Accepted, now_s: float) -> None:
        """Executes, or refuses, an order."""
        order_id = command.number
        self._session.commands.note_executed(command, now_s)
        site = None if self.routes.limits.site_maps is None else self.routes.limits.site_maps.site
        order = understood(command, site, self._config.authority)
        self._reports.record("order", now_s, order=words(order), sender=command.sender.system_id)
        if isinstance(order, Refused):
            answer = Answer(order_id, Verdict.DENIED, order.reason)
            self._carry_out((self.status, (answer,)), now_s)
        else:
            if order is Order.HOLD:
                self._recovery.note_hold(self.routes.flight)
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
        pose, task = self._pose_tracker.pose, self.status.task
        if self.status.state in ON_THE_WAY and task is not None and pose is not None:
            self.routes.replan(task, pose, self.risk.indices, now_s)
        width_m = self.routes.inflation.lasting_m
        self._recovery.act(self.routes.flight, pose, self.status, self.ruling, width_m, now_s)
        failsafes = self.routes.limits.watch.failsafes
        due, flight = self.mode_requester.landing_due, self.routes.flight
        self._refuge.act(flight, failsafes, self.status, self.ruling, now_s, landing_due=due)

    def follow(self, now_s: float, step_s: float) -> None:
        """Flies on along the route and sends the gated setpoint. step_s: since the last cycle."""
        self._stream(now_s, step_s)
        engaged = self.status.state in STREAMING or self.status.state is MissionState.PLANNING
        telemetry = self._session.telemetry
        known = self.status.known if self.status.order_id is not None else ()
        stations = telemetry.ground_stations.values()
        self._safety_monitor.report(stations, now_s, streaming=engaged, known=known)
        at_end = self.routes.arrived(self._pose_tracker.pose, now_s)
        self.mode_requester.act(self.status, telemetry, at_end=at_end, now_s=now_s)

    def shift(self, jump: Jump, now_s: float) -> None:
        """Moves setpoint and flight with a position or heading that jumped."""
        self.setpoints.shift(jump, self._pose_tracker.plane)
        if self.routes.flight is not None:
            self.routes.flight.shift(jump)
            self._reports.record("jump", now_s, jump_m=list(jump.step_m), turn_rad=jump.turn_rad)

    def take_maps(self, site_maps: SiteMaps, now_s: float) -> None:
        """Takes maps of the site with other obstacles."""
        self.routes.learn_maps(site_maps, now_s)
        self._paths_changed = True

    def shut_down(self, now_s: float) -> None:
        """Ends the setpoint stream at rest, if still permitted, before the process ends.

        A text reports that control ends.
        """
        if self.status.state not in STREAMING:
            return
        action = MissionState.RELEASED.words
        self._reports.send_text(
            Severity.WARNING, service_texts.SERVICE_ENDS(), now_s, action=action, is_new=True
        )
        if self.ruling.action is not Action.RELEASE and (
            self._inputs.mode_ours or self.status.state is MissionState.READY
        ):
            self._send_last_setpoint(now_s)

    def _go_without(self, awaited: Awaited, answer: PlanAnswer, now_s: float) -> None:
        """Handles an answer without a plan: denies an order, keeps the path, or brakes.

        A request without an order stays pending if less inflation would leave room.
        """
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
        elif not no_room and not self.routes.note_no_detour():
            self._reports.send_text(Severity.NOTICE, reason, now_s, action="path kept")
            if self.routes.braked:
                self._carry_out(state_machine.blocked(self.status, now_s), now_s)

    def _situation(self, now_s: float) -> Situation:
        return self._inputs.situation(self.status, self.ruling, now_s)

    # Effects

    def _carry_out(self, step: Step, now_s: float) -> None:
        """Takes the new status and carries out each effect once, in order."""
        self._take(step[0], now_s)
        effects = deque(step[1])
        while effects:
            effects.extendleft(reversed(self._carry_out_one(effects.popleft(), now_s)))
        if self.status.requested is None:
            if self.status.state not in STREAMING:
                self.routes.end()
            else:
                self.routes.forget_first()

    def _take(self, status: MissionStatus, now_s: float) -> None:
        before, self.status = self.status, status
        self.status_changed = self.status_changed or status != before
        if status.state is not before.state:
            before_word = before.state.value
            self._reports.record("state", now_s, state=status.state.value, before=before_word)

    def _carry_out_one(self, effect: Effect, now_s: float) -> tuple[Effect, ...]:
        """Carries out an effect; returns the effects of the transition that it leads to."""
        match effect:
            case RequestPlan(task):
                if self.routes.resume(task, self._pose_tracker.pose):
                    # The rest of a landing leg needs no plan.
                    status, effects = state_machine.planned(
                        self.status, self._situation(now_s), now_s
                    )
                    self._take(status, now_s)
                    return effects
                return self._request_plan(task, now_s)
            case Answer(order_id, verdict, reason):
                self._orders.answer(order_id, verdict, reason, now_s)
            case SendText(text, action, serious, is_new, condition):
                severity = Severity.WARNING if serious else Severity.NOTICE
                self._reports.send_text(severity, text, now_s, action=action, is_new=is_new)
                if condition:
                    self._safety_monitor.note_reported(condition)
            case FlightEffect.BRAKE:
                self.routes.brake()
            case OverrideConditions(known):
                self._safety_monitor.override(known)
                if "origin_moved" in known:
                    self._pose_tracker.agreement.accept_origin()
                self.mode_requester.forget_landing()
            case FlightEffect.SEND_LAST_SETPOINT:
                self._send_last_setpoint(now_s)
            case FlightEffect.LAND:
                self.mode_requester.note_landing()
        return ()

    def _request_plan(self, task: Task, now_s: float) -> tuple[Effect, ...]:
        """Requests a task's first plan; returns the effects where that is impossible."""
        pose, risk = self._pose_tracker.pose, self.risk.indices
        reason = self.routes.ask(task, pose, risk, now_s, first=True)
        if reason is None:
            return ()
        status, effects = state_machine.unplanned(self.status, reason, now_s, failed=True)
        self._take(status, now_s)
        return effects

    def _stream(self, now_s: float, step_s: float) -> None:
        """Sends this instant's setpoint; a refusal is a fault for the next cycle's checks.

        Where another setpoint was sent instead, the flight stops there, and replans from there.
        """
        flight, pose = self.routes.flight, self._pose_tracker.pose
        plane = self._pose_tracker.plane
        if self.status.state not in STREAMING or not flight or not pose or not plane:
            if plane is not None and self._inputs.mode_ours and self.ruling.last_setpoint:
                self.setpoints.resend_last_setpoint(plane, now_s)
            self.setpoints.end()
            return
        in_control = self.status.state in IN_CONTROL
        if in_control:
            holds = self.status.state is MissionState.HOLDING
            flight.advance(pose, step_s, self._pace, holds=holds)
        else:
            # The pilot may turn the aircraft until engagement, which must cause no turn.
            flight.take_heading(pose)
        setpoint = flight.setpoint(pose, plane, step_s if in_control else 0.0)
        refused = self.setpoints.send(setpoint, flight, plane, now_s)
        if refused is None:
            return
        self.faults.note_refusal(refused)
        if refused.rest is not None:
            self.routes.stop_at(refused.rest.position_m)
            if self.status.requested is not None:
                effects = self._request_plan(self.status.requested, now_s)
                self._carry_out((self.status, effects), now_s)

    def _send_last_setpoint(self, now_s: float) -> None:
        """Sends the last setpoint before the stream ends: the previous place, at rest."""
        flight, plane = self.routes.flight, self._pose_tracker.plane
        if flight is not None and plane is not None:
            self.setpoints.send_last_setpoint(flight, plane, now_s)

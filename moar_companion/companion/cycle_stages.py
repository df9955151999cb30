"""The stages of a cycle, from received data to packets: `run` names them in their order.

Each reads the state of the machine and changes it; decisions are
made by pure functions and step machines of the packages beside this module.
"""

from __future__ import annotations

from collections import deque

from ..mavlink.autopilots import profile
from ..mavlink.commands import CommandCancelled, DeniedCommand
from ..mavlink.component.parameter_server import ParameterSet
from ..mavlink.identity import AutopilotFound, AutopilotRestarted
from ..mavlink.received_commands import Accepted
from ..mavlink.session import Event, Severity
from ..mavlink.telemetry_receiver import ModeLeft
from ..risk.receivers import trouble
from ..settings.config import Authority
from ..texts import service_texts
from . import settings_change
from .cycle_inputs import (
    ON_THE_WAY,
    check_inputs,
    escapes,
    exposure_limit_s,
    line_is_seen,
    place_by_line,
    scene,
    situation,
    tracking_error_m,
)
from .cycle_state import CycleState
from .estimation.landed_state import grounded
from .estimation.pose import Jump
from .guidance.splice import Adoption
from .mission import state_machine
from .mission.values import (
    Answer,
    Effect,
    FlightEffect,
    LeaveOut,
    MissionStatus,
    Order,
    OverrideConditions,
    RequestPlan,
    SendText,
    Step,
    Task,
    Verdict,
)
from .mission_states import ENGAGED, IN_CONTROL, STREAMING, MissionState
from .operator_commands import Refused, understood, words
from .plan_requests import Awaited
from .planning.plan_jobs import PlanAnswer
from .planning.site_maps import SiteMaps
from .published_state import publish, system_status
from .safety.condition_types import Action
from .safety.position_checks import widening_m

_RISK_PERIOD_S = 0.1
_REPORT_PERIOD_S = 0.5
_LONGEST_STEP_S = 0.1
"""Maximum time step of the reference, also after a longer stall of the shell."""


def run(state: CycleState, now_s: float) -> None:
    """Runs one cycle, from received events to this instant's setpoint."""
    step_s = 0.0 if state.cycle_s is None else min(_LONGEST_STEP_S, now_s - state.cycle_s)
    if state.cycle_s is None:
        state.orders.await_autopilot(now_s)
    _observe(state, now_s, step_s)
    if state.is_last_cycle:
        state.is_last_cycle = False
        _rule(state, now_s)
        _shut_down(state, now_s)
        return
    state.cycle_s = now_s
    state.risk_monitor.take_answers(state.routes.limits.volume)
    risk_due = now_s >= state.risk_due_s
    if risk_due:
        state.risk_due_s = now_s + _RISK_PERIOD_S
        _look_ahead(state, now_s)
    if state.risk_monitor.note_accuracy(state.telemetry) or risk_due:
        _assess_risk(state, now_s)
    _rule(state, now_s)
    _transition(state, now_s)
    _route(state, now_s)
    _follow(state, now_s, step_s)
    _inspect(state, now_s)
    _emit(state, now_s)


def take_ground(state: CycleState, site_maps: SiteMaps) -> None:
    """Takes the site, whose planner is ready, and the rest of the previous process's task.

    Under `observe` nothing is flown, also no rest.
    """
    before = state.start_report.before
    state.pose_tracker.take_site(site_maps.site)
    state.seen_obstacles.take_site(site_maps.site)
    state.routes.limits.take_ground(site_maps)
    state.risk_monitor.take_site(site_maps.site)
    settings_change.settle(state)
    flies = state.config.authority is not Authority.OBSERVE
    if flies and not state.status_changed and before is not None:
        state.status = state_machine.restarted(before.rest(site_maps.site))


def _observe(state: CycleState, now_s: float, step_s: float) -> None:
    """Takes telemetry and events.

    Orders wait for `_transition`, until the checks that end our control have run.
    """
    paused_s = 0.0 if state.followed_s is None else now_s - state.followed_s
    state.faults.note_pause(paused_s, state.config.supervision.position_timeout_s)
    jump = state.pose_tracker.update(state.telemetry)
    state.seen_obstacles.note_pose(state.telemetry, state.pose_tracker, jump)
    engaged = state.status.state in ENGAGED
    followed = state.pose_tracker.follow_line(
        state.seen_obstacles.line, step_s, fresh=line_is_seen(state, now_s), at_once=not engaged
    )
    if followed is not None:
        state.seen_obstacles.shift(followed)
    settings_change.take_maps(state, now_s)
    state.seen_obstacles.update(now_s, on_ground=grounded(state.telemetry))
    settings_change.note_request(state, now_s)
    jumps = tuple(each for each in (jump, followed) if each is not None)
    for event in (*jumps, *state.session.events_received()):
        _take_event(state, event, now_s)
    routes = state.routes
    routes.limits.learn(state.session, state.pose_tracker, routes.flight, now_s)


def _take_event(state: CycleState, event: Event | Jump, now_s: float) -> None:
    match event:
        case Jump():
            _shift(state, event, now_s)
        case CommandCancelled(command=command):
            state.withdrawn.append(command.number)
        case DeniedCommand(reason=reason):
            state.orders.report_reason(event, Verdict.DENIED, reason, now_s)
        case AutopilotFound(autopilot=autopilot):
            state.orders.await_autopilot(now_s)
            state.session.requests.want_all_of(profile(autopilot.kind))
        case ModeLeft(mode=mode):
            state.faults.note_mode_left(mode)
        case ParameterSet():
            settings_change.take_parameter(state, event, now_s)
        case AutopilotRestarted():
            state.faults.note_restart()
        case _:
            state.reports.report_event(event, now_s)


def _shift(state: CycleState, jump: Jump, now_s: float) -> None:
    """Moves setpoint and flight with a position or heading that jumped."""
    state.setpoints.shift(jump, state.pose_tracker.plane)
    if state.routes.flight is not None:
        state.routes.flight.shift(jump)
        state.reports.record("jump", now_s, jump_m=list(jump.step_m), turn_rad=jump.turn_rad)


def _look_ahead(state: CycleState, now_s: float) -> None:
    """Updates the remaining flight, and the obstacles that autopilot failsafes would hit."""
    telemetry, pose = state.telemetry, state.pose
    place_m = None if pose is None else pose.position_m
    state.risk_monitor.keep_escape_routes(telemetry, scene(state), place_m, now_s)
    volume = state.routes.limits.volume
    if state.status.state in IN_CONTROL and volume is not None:
        watch, meter = state.routes.limits.watch, state.risk.meter
        watch.update(place_m, volume.maps.reach, telemetry, meter, now_s)
        route, flight = state.risk_monitor.escape_route, state.routes.flight
        state.refuge.look(
            volume,
            watch.failsafes,
            place_m,
            watch.next_battery_action(telemetry, meter),
            None if route is None else route.exposed_s,
            now_s,
            blind=trouble(telemetry, state.risk.localization.receivers, now_s) is not None,
            leaves=flight is not None and flight.leaves,
        )
        limit_s = exposure_limit_s(state)
        note = watch.note(limit_s, state.status.since_s, now_s)
        if note is not None and not escapes(state.status):
            state.reports.send_text(Severity.NOTICE, note, now_s)


def _assess_risk(state: CycleState, now_s: float) -> None:
    """Updates the risk indices from telemetry and the remaining flight."""
    session, error_m = state.session, tracking_error_m(state)
    parameters, by_line = session.requests.parameters, place_by_line(state, now_s)
    state.risk_monitor.judge(session.telemetry, parameters, error_m, by_line, now_s)


def _rule(state: CycleState, now_s: float) -> None:
    """Steps the supervisor, once a cycle, with the checks of everything observed."""
    state.setpoints.widened_m = widening_m(state.risk, state.margin)
    error_m = None if escapes(state.status) else tracking_error_m(state)
    state.paths_changed |= state.routes.update_inflation(state.risk, error_m, now_s)
    state.safety_monitor.rule(check_inputs(state, now_s), now_s)
    state.faults.forget()


def _transition(state: CycleState, now_s: float) -> None:
    """Steps the mission machine: cancelled orders, the planner's answer, the ruling, new orders.

    A failed search comes before the ruling, which may require the next escape route at once.
    """
    while state.withdrawn:
        step = state_machine.withdrawn(state.status, state.withdrawn.popleft(), now_s)
        _carry_out(state, step, now_s)
    taken = state.routes.taken(now_s)
    if taken is not None:
        _take_plan(state, *taken, now_s)
    step = state_machine.tick(
        state.status,
        situation(state, now_s),
        paths_changed=state.paths_changed,
        ready_timeout_s=state.config.supervision.ready_timeout_s,
        resume=state.config.resume,
        on_failure=state.config.inspection.on_failure,
        now_s=now_s,
    )
    state.paths_changed = False
    _carry_out(state, step, now_s)
    fitting = state.risk_monitor.fitting_stops
    _carry_out(state, state_machine.shortened(state.status, fitting), now_s)
    _report(state, now_s)
    unread = state.routes.limits.not_ready_reason is not None
    unknown = state.session.autopilot is None or unread
    for command in state.orders.due(now_s, unknown=unknown and state.site is not None):
        _order(state, command, now_s)
        state.start_report.note_order(command)
    state.orders.report_progress(now_s)


def _take_plan(state: CycleState, awaited: Awaited, answer: PlanAnswer, now_s: float) -> None:
    """Adopts an awaited plan, or handles its absence."""
    ordered = state.status.order_id is not None
    answer = state.routes.checked_for_offboard_loss(awaited, answer, now_s, ordered=ordered)
    if answer.plan is None:
        _go_without(state, awaited, answer, now_s)
        return
    adopted = state.routes.adopt(awaited, answer, state.risk, now_s)
    if not awaited.first:
        return
    if adopted is not Adoption.TOO_LATE:
        if answer.stops:
            state.reports.record("tour", now_s, stops=list(answer.stops))
        world = situation(state, now_s)
        step = state_machine.planned(state.status, world, now_s, stops=answer.stops)
        _carry_out(state, step, now_s)
    elif state.status.requested is not None and state.routes.flight is not None:
        # The planner is slower than the flight: the next plan begins at a stop point.
        state.routes.brake()
        _carry_out(
            state, (state.status, _request_plan(state, state.status.requested, now_s)), now_s
        )


def _go_without(state: CycleState, awaited: Awaited, answer: PlanAnswer, now_s: float) -> None:
    """Handles an answer without a plan: denies an order, keeps the path, or brakes.

    A request without an order stays pending if less inflation would leave room.
    """
    reason = state.routes.inflation.explained(answer)
    if answer.detail:
        state.reports.record("no_plan", now_s, reason=reason, detail=answer.detail)
    ordered = awaited.first and state.status.order_id is not None
    no_room = answer.too_wide and not ordered and state.ruling.action <= Action.HOLD
    if no_room:
        state.routes.inflation.note_no_room(awaited, reason)
    if awaited.first:
        waits = no_room or (answer.would_collide and not ordered)
        step = state_machine.unplanned(
            state.status, reason, now_s, waits=waits, failed=answer.failed
        )
        _carry_out(state, step, now_s)
    elif not no_room and not state.routes.note_no_detour():
        state.reports.send_text(Severity.NOTICE, reason, now_s, action="path kept")
        if state.routes.braked:
            _carry_out(state, state_machine.blocked(state.status, now_s), now_s)


def _report(state: CycleState, now_s: float) -> None:
    """Reports file faults, a restart, and a wrong number of cells."""
    state.reports.report_file_faults(state.host.file_faults, state.telemetry, now_s)
    if state.orders.planner_awaited:
        if grounded(state.telemetry):
            state.start_report.drop_task()
        return
    may_continue = not state.status_changed and state.status.task is not None
    cells = None if state.status.state in STREAMING else state.vehicle.risk.cells
    texts = state.start_report.texts(state.telemetry, cells, now_s, may_continue=may_continue)
    for text in texts:
        state.reports.send_text(Severity.WARNING, text, now_s)


def _order(state: CycleState, command: Accepted, now_s: float) -> None:
    """Executes, or refuses, an order."""
    order_id = command.number
    state.session.commands.note_executed(command, now_s)
    order = understood(command, state.site, state.config.authority)
    state.reports.record("order", now_s, order=words(order), sender=command.sender.system_id)
    if isinstance(order, Refused):
        answer = Answer(order_id, Verdict.DENIED, order.reason)
        _carry_out(state, (state.status, (answer,)), now_s)
    else:
        if order is Order.HOLD:
            state.recovery.note_hold(state.routes.flight)
        world, before = situation(state, now_s), state.status.state
        status, effects = state_machine.command(state.status, order, order_id, world, now_s)
        if not command.permitted:
            # A sender without permission may stop the aircraft, but overrules no condition.
            effects = tuple(item for item in effects if not isinstance(item, OverrideConditions))
        _carry_out(state, (status, effects), now_s)
        if isinstance(order, Task) and status.order_id == order_id:
            state.inspector.begin()
        # The task may be flown already: the rest of a landing leg needs no plan.
        if status.order_id == order_id:
            state.mode_requester.note_order(state.telemetry.autopilot, before, now_s)


# Effects of a transition


def _carry_out(state: CycleState, step: Step, now_s: float) -> None:
    """Takes the new status and carries out each effect once, in order."""
    _take(state, step[0], now_s)
    effects = deque(step[1])
    while effects:
        effects.extendleft(reversed(_carry_out_one(state, effects.popleft(), now_s)))
    if state.status.requested is None:
        if state.status.state not in STREAMING:
            state.routes.end()
        else:
            state.routes.forget_first()


def _take(state: CycleState, status: MissionStatus, now_s: float) -> None:
    before, state.status = state.status, status
    state.status_changed = state.status_changed or status != before
    if status.state is not before.state:
        before_word = before.state.value
        state.reports.record("state", now_s, state=status.state.value, before=before_word)


def _carry_out_one(state: CycleState, effect: Effect, now_s: float) -> tuple[Effect, ...]:
    """Carries out an effect; returns the effects of the transition that it leads to."""
    match effect:
        case RequestPlan(task):
            if state.routes.resume(task, state.pose):
                # The rest of a landing leg needs no plan.
                status, effects = state_machine.planned(
                    state.status, situation(state, now_s), now_s
                )
                _take(state, status, now_s)
                return effects
            return _request_plan(state, task, now_s)
        case Answer(order_id, verdict, reason):
            state.orders.answer(order_id, verdict, reason, now_s)
        case SendText(text, action, serious, is_new, condition):
            severity = Severity.WARNING if serious else Severity.NOTICE
            state.reports.send_text(severity, text, now_s, action=action, is_new=is_new)
            if condition:
                state.safety_monitor.note_reported(condition)
        case LeaveOut(stops, reason):
            state.reports.record("left_out", now_s, stops=list(stops), reason=reason)
            state.inspector.leave_out(stops)
        case FlightEffect.BRAKE:
            state.routes.brake()
        case OverrideConditions(known):
            state.safety_monitor.override(known)
            if "origin_moved" in known:
                state.pose_tracker.agreement.accept_origin()
            state.mode_requester.forget_landing()
        case FlightEffect.SEND_LAST_SETPOINT:
            _send_last_setpoint(state, now_s)
        case FlightEffect.LAND:
            state.mode_requester.note_landing()
    return ()


def _request_plan(state: CycleState, task: Task, now_s: float) -> tuple[Effect, ...]:
    """Requests a task's first plan; returns the effects where that is impossible."""
    pose, risk = state.pose, state.risk.indices
    reason = state.routes.ask(task, pose, risk, now_s, first=True)
    if reason is None:
        return ()
    status, effects = state_machine.unplanned(state.status, reason, now_s, failed=True)
    _take(state, status, now_s)
    return effects


# Route, setpoint, output


def _route(state: CycleState, now_s: float) -> None:
    """Requests a better plan, or a recovery leg, where one is due."""
    pose, task = state.pose, state.status.task
    if state.status.state in ON_THE_WAY and task is not None and pose is not None:
        state.routes.replan(task, pose, state.risk.indices, now_s)
    width_m = state.routes.inflation.lasting_m
    state.recovery.act(state.routes.flight, pose, state.status, state.ruling, width_m, now_s)
    failsafes = state.routes.limits.watch.failsafes
    due, flight = state.mode_requester.landing_due, state.routes.flight
    state.refuge.act(flight, failsafes, state.status, state.ruling, now_s, landing_due=due)


def _follow(state: CycleState, now_s: float, step_s: float) -> None:
    """Flies on along the route and sends the gated setpoint. step_s: since the last cycle."""
    _stream(state, now_s, step_s)
    engaged = state.status.state in ENGAGED
    telemetry = state.telemetry
    known = state.status.known if state.status.order_id is not None else ()
    stations = telemetry.ground_stations.values()
    state.safety_monitor.report(stations, now_s, streaming=engaged, known=known)
    at_end = state.routes.arrived(state.pose, now_s)
    state.mode_requester.act(state.status, telemetry, at_end=at_end, now_s=now_s)


def _inspect(state: CycleState, now_s: float) -> None:
    """Captures the view at which the flight is, or ends its capture."""
    flight, pose = state.routes.flight, state.pose
    error_m = None if flight is None or pose is None else flight.error_m(pose)
    plane = state.pose_tracker.plane
    state.inspector.act(
        state.status,
        state.site,
        pose,
        plane,
        error_m,
        state.risk,
        now_s,
        position_error_m=state.margin.position_m,
    )


def _stream(state: CycleState, now_s: float, step_s: float) -> None:
    """Sends this instant's setpoint; a refusal is a fault for the next cycle's checks.

    Where another setpoint was sent instead, the flight stops there, and replans from there.
    """
    flight, pose = state.routes.flight, state.pose
    plane = state.pose_tracker.plane
    if state.status.state not in STREAMING or not flight or not pose or not plane:
        if plane is not None and state.mode_ours and state.ruling.last_setpoint:
            state.setpoints.resend_last_setpoint(plane, now_s)
        state.setpoints.end()
        return
    in_control = state.status.state in IN_CONTROL
    if in_control:
        holds = state.status.state is MissionState.HOLDING
        flight.advance(pose, step_s, state.pace, holds=holds)
    else:
        # The pilot may turn the aircraft until engagement, which must cause no turn.
        flight.take_heading(pose)
    setpoint = flight.setpoint(pose, plane, step_s if in_control else 0.0)
    refused = state.setpoints.send(setpoint, flight, plane, now_s)
    if refused is None:
        return
    state.faults.note_refusal(refused)
    if refused.rest is not None:
        state.routes.stop_at(refused.rest.position_m)
        if state.status.requested is not None:
            effects = _request_plan(state, state.status.requested, now_s)
            _carry_out(state, (state.status, effects), now_s)


def _send_last_setpoint(state: CycleState, now_s: float) -> None:
    """Sends the last setpoint before the stream ends: the previous place, at rest."""
    flight, plane = state.routes.flight, state.pose_tracker.plane
    if flight is not None and plane is not None:
        state.setpoints.send_last_setpoint(flight, plane, now_s)


def _shut_down(state: CycleState, now_s: float) -> None:
    """Ends the setpoint stream at rest, if still permitted, before the process ends.

    A text reports that control ends. Open orders get their final answer.
    """
    if state.status.state in STREAMING:
        _end_control(state, now_s)
    state.inspector.leave(now_s)
    state.session.send_payload(now_s)
    state.orders.end(now_s)


def _end_control(state: CycleState, now_s: float) -> None:
    action = MissionState.RELEASED.words
    state.reports.send_text(
        Severity.WARNING, service_texts.SERVICE_ENDS(), now_s, action=action, is_new=True
    )
    if state.ruling.action is not Action.RELEASE and (
        state.mode_ours or state.status.state is MissionState.READY
    ):
        _send_last_setpoint(state, now_s)


def _emit(state: CycleState, now_s: float) -> None:
    """Sends heartbeat and requests; each half second what is published, and records the status."""
    mission = state.status.state
    state.session.tick(now_s, system_status(state), custom_mode=mission.number)
    if now_s < state.report_due_s:
        return
    state.report_due_s = now_s + _REPORT_PERIOD_S
    publish(state)
    offset_m = state.pose_tracker.offset_m
    state.reports.record_status(
        mission, state.risk.indices, state.weights, state.pose, offset_m, now_s
    )
    state.reports.report_refusals(state.session.signing, now_s)

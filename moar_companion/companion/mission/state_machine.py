"""The mission machine: transitions between the states of a mission.

A pure step machine: `command`, `planned`, `unplanned` and `tick` take the present status and an
event, and return the next status with the effects that the companion carries out. The supervisor's
ruling on the flight is a part of the situation.

    idle -> planning -> ready -> flying -> at_target | landing_leg -> holding
    in control, and a pilot takes the mode:        -> overridden
    streaming, and failsafe, stale data or fault:  -> released
    in control, and the supervisor requires it:    -> holding, or an exit, or an evacuation
"""

from __future__ import annotations

from dataclasses import replace

from ...settings.config import OnFailure
from ...texts import pilot_texts, service_texts
from ...texts.text_format import limit_text
from ..mission_states import ENGAGED, IN_CONTROL, STREAMING, MissionState
from ..safety.condition_types import Action
from ..safety.supervisor import Acting, Ruling
from .state_changes import answer_cancelled, answer_rejected, end_stream, enter, entered
from .supervised import ESCAPE_MISSIONS, complies_with, is_escape_for, supervised
from .values import (
    Answer,
    FlightEffect,
    LeaveOut,
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

_CONTINUED = set(MissionState) - STREAMING | {MissionState.HOLDING}
"""States whose task may be continued by an operator's order."""

_INTERRUPTED = IN_CONTROL - {MissionState.HOLDING}
"""Flights that may be resumed after a pilot's takeover; a hold by an operator may not."""

_CONTROL_ENDED = {MissionState.OVERRIDDEN, MissionState.RELEASED}

_WAITING = {MissionState.IDLE, MissionState.RELEASED}
"""States in which a task waits for an operator's order until the landing."""

_CROSSED_S = 0.5
"""Time after an event within which an order counts as sent before its operator received the
event."""

_ARRIVED = SendText(pilot_texts.ABOVE_LANDING_POINT(), MissionState.HOLDING.words)

_AGAIN_S = 2.0
"""Time until the next search for an escape route without a path; the situation may have changed."""

_OUTWARD = tuple(Task(mission=mission) for mission in ESCAPE_MISSIONS[Action.EXIT])


def restarted(rest: Task | None) -> MissionStatus:
    """Status at the start of a process. rest: task left by the process before, for a `continue`."""
    return MissionStatus(task=rest)


def engages(status: MissionStatus, now_s: float, *, mode_ours: bool) -> bool:
    """True in the cycle in which control begins: the mode is given to an offered flight.

    Not in the cycle of the offer itself, whose ruling was made without control.
    """
    return status.state is MissionState.READY and mode_ours and status.since_s < now_s


def command(
    status: MissionStatus, order: Task | Order, order_id: int, world: Situation, now_s: float
) -> Step:
    """Carries out an operator's order."""
    if isinstance(order, Task):
        return _requested(status, order, order_id, world, now_s)
    if order is Order.CONTINUE:
        may_continue = status.hold_ordered or status.state in _CONTINUED
        if status.task is None or not may_continue:
            ended = status.task is None and status.landed
            reason = pilot_texts.LANDING_ENDED() if ended else pilot_texts.NOTHING_HELD()
            return answer_rejected(status, order_id, reason)
        if status.task.done:
            return answer_rejected(status, order_id, pilot_texts.NOTHING_LEFT())
        return _requested(status, status.task, order_id, world, now_s)
    done = Answer(order_id, Verdict.ACCEPTED)
    replaced, status = answer_cancelled(status), replace(status, order_id=None)
    if order is Order.HOLD and status.state in IN_CONTROL:
        held, effects = enter(replace(status, resumes=False), MissionState.HOLDING, now_s)
        return held, (
            *replaced,
            *effects,
            FlightEffect.BRAKE,
            OverrideConditions(_known(world, now_s)),
            done,
        )
    if order is Order.HOLD and status.state is MissionState.READY:
        # The mode may have been given and not yet received: the stream must not end.
        ready = replace(status, hold_ordered=True, requested=None)
        return ready, (*replaced, FlightEffect.BRAKE, done, SendText(pilot_texts.READY_TO_HOLD()))
    if status.state in ENGAGED:
        rest = MissionState.IDLE if order is Order.HOLD else MissionState.RELEASED
        reason = pilot_texts.ON_COMMAND(order=order.value)
        silent, effects = end_stream(status, rest, reason, now_s, last_setpoint=True)
        return silent, (*replaced, *effects, done)
    if status.state is MissionState.OVERRIDDEN:
        # The task that a returned mode would resume is dropped.
        dropped = replace(status, task=None)
        if order is Order.RELEASE:
            dropped, effects = enter(dropped, MissionState.RELEASED, now_s)
            return dropped, (*effects, done)
        return dropped, (done,)
    if order is Order.RELEASE:
        return replace(status, task=None, by_condition=False), (done,)
    return answer_rejected(status, order_id, pilot_texts.NOTHING_FLOWN())


def planned(
    status: MissionStatus, world: Situation, now_s: float, *, stops: tuple[str, ...] = ()
) -> Step:
    """Takes the plan of `requested`; it begins at the aircraft's place at the request.

    stops: of `requested`, in the order in which they are visited; () for its own order.
    """
    requested = status.requested
    if requested is None:
        return status, ()
    if stops:
        requested = replace(requested, stops=stops)
    in_control = status.state in IN_CONTROL
    ruling = world.ruling.apart_from(status.known)
    if ruling.leading is not None and ruling.action is Action.RELEASE:
        return _released(status, ruling, ruling.leading, world, now_s)
    if status.state is MissionState.PLANNING and (unfit := _unfit(requested, world)):
        idle, effects = enter(status, MissionState.IDLE, now_s)
        order_id = status.order_id
        return idle, effects if order_id is None else (
            *effects,
            *answer_rejected(idle, order_id, unfit)[1],
        )
    found = replace(status, task=requested, hold_ordered=False, resumes=False)
    found, effects = enter(
        replace(found, no_path=status.no_path - {requested}),
        MissionState.FLYING if in_control else MissionState.READY,
        now_s,
    )
    if status.order_id is None:
        return found, effects
    return found, (
        *effects,
        OverrideConditions(status.known),
        Answer(status.order_id, Verdict.ACCEPTED),
    )


def unplanned(
    status: MissionStatus, reason: str, now_s: float, *, waits: bool = False, failed: bool = False
) -> Step:
    """Handles a missing plan of `requested`: a flight continues or holds, planning ends in idle.

    waits: a condition reports the same; when it clears, the search for a task that no operator has
    ordered repeats. failed: the planner has failed, rather than found no path. For a while no plan
    is requested, except to continue an escape route that was begun.
    """
    requested = status.requested
    if requested is None:
        return status, ()
    answers = () if status.order_id is None else (Answer(status.order_id, Verdict.DENIED, reason),)
    if status.state is MissionState.PLANNING:
        idle, effects = enter(status, MissionState.IDLE, now_s)
        return idle, (*effects, *answers)
    if status.order_id is not None:
        return replace(status, requested=None, order_id=None), answers
    if not requested.mission.visits_targets and not waits:
        text = SendText(reason, f"no {requested.mission.value}", serious=True, is_new=False)
        inspects = status.task is not None and status.task.mission.visits_targets
        failed_tasks = _OUTWARD if failed and inspects else (requested,)
        return replace(status, requested=None).without(*failed_tasks, now_s=now_s), (text,)
    moves = status.state in {MissionState.FLYING, MissionState.LANDING_LEG}
    brake = (FlightEffect.BRAKE,) if moves else ()
    held = entered(status, MissionState.HOLDING, now_s)
    text = SendText(reason, MissionState.HOLDING.words, serious=True)
    return replace(held, task=requested, resumes=waits), (*brake, text)


def blocked(status: MissionStatus, now_s: float) -> Step:
    """Notes that the flown task has no path on from here: another escape route may have one."""
    return status if status.task is None else status.without(status.task, now_s=now_s), ()


def shortened(status: MissionStatus, fitting: int | None) -> Step:
    """Leaves out the last stops of an inspection for which the energy no longer suffices.

    fitting: number of the stops that stay, from the next one on; None: all.
    """
    task, state = status.task, status.state
    if fitting is None or task is None or status.requested is not None:
        return status, ()
    left_out = task.stops[fitting:]
    if not left_out or state not in {MissionState.FLYING, MissionState.AT_TARGET}:
        return status, ()
    text = pilot_texts.NO_ENERGY_FOR(target=left_out[0])
    if len(left_out) > 1:
        text = pilot_texts.NO_ENERGY_FOR_MORE(target=left_out[0], count=len(left_out) - 1)
    shorter = replace(status, task=replace(task, stops=task.stops[:fitting]))
    return shorter, (SendText(text, "left out", serious=True), LeaveOut(left_out, "energy"))


def withdrawn(status: MissionStatus, order_id: int, now_s: float) -> Step:
    """Drops an order that the operator cancelled while its plan was awaited."""
    if status.order_id != order_id:
        return status, ()
    if status.state is MissionState.PLANNING:
        return enter(status, MissionState.IDLE, now_s)
    return replace(status, requested=None, order_id=None), ()


def tick(
    status: MissionStatus,
    world: Situation,
    *,
    paths_changed: bool = False,
    ready_timeout_s: float,
    resume: bool,
    on_failure: OnFailure = OnFailure.HOLD,
    now_s: float,
) -> Step:
    """Runs one cycle; conditions that end our control come first.

    paths_changed: a search that found no path may find one now. on_failure: of a view.
    """
    state, ruling = status.state, world.ruling
    rested = status.requested is None and now_s - status.no_path_s >= _AGAIN_S
    if status.no_path and (paths_changed or rested):
        status = replace(status, no_path=frozenset())
    if status.order_id is not None:
        # The operator had received these conditions before the order: the request does not fail for
        # them.
        status = replace(status, known=status.known & ruling.names)
        ruling = ruling.apart_from(status.known)
    if state in _WAITING and status.task is not None and ruling.acts("ground"):
        return replace(status, task=None, landed=True), ()
    if state is MissionState.OVERRIDDEN:
        return _overridden(status, world, resume=resume, now_s=now_s)
    if state not in ENGAGED:
        return status, ()
    leading = ruling.leading
    if leading is not None and ruling.action is Action.RELEASE:
        return _released(status, ruling, leading, world, now_s)
    given = engages(status, now_s, mode_ours=world.mode_ours)
    if state in IN_CONTROL or given:
        step = supervised(status, ruling, now_s, on_leg=world.on_leg)
        if step is not None:
            return step
    elif ruling.action >= Action.HOLD and not complies_with(status, ruling.action):
        idle, effects = end_stream(
            status, MissionState.IDLE, ruling.reason, now_s, last_setpoint=True
        )
        rest = None if status.hold_ordered else status.task
        return replace(idle, task=rest), effects
    return _onward(status, world, ready_timeout_s, on_failure, now_s)


def _released(
    status: MissionStatus, ruling: Ruling, leading: Acting, world: Situation, now_s: float
) -> Step:
    """Ends control for the supervisor; a last setpoint at rest while the mode is still ours.

    The rest of the task is kept for an operator after a passing cause, and for a pilot's takeover.
    """
    row, task = leading.condition, status.task
    if row.passing and ruling.passing:
        keeps = not status.hold_ordered
    else:
        keeps = row.rest is MissionState.OVERRIDDEN and status.state in _INTERRUPTED
    rest = task if keeps and task is not None and not task.done else None
    silent, effects = end_stream(
        status,
        row.rest,
        leading.reason,
        now_s,
        last_setpoint=ruling.last_setpoint and world.mode_ours,
        rest=rest,
    )
    landed = row.rest is MissionState.IDLE and task is not None
    if rest is not None and row.passing:
        effects = (*effects, SendText(service_texts.CONTINUE_POSSIBLE()))
    return replace(silent, landed=landed, by_condition=True), effects


def _onward(
    status: MissionStatus,
    world: Situation,
    ready_timeout_s: float,
    on_failure: OnFailure,
    now_s: float,
) -> Step:
    """Takes the next step of the mission while no condition is against it."""
    state, task = status.state, status.task
    if state is MissionState.READY:
        if engages(status, now_s, mode_ours=world.mode_ours):
            given = MissionState.HOLDING if status.hold_ordered else MissionState.FLYING
            return enter(replace(status, hold_ordered=False), given, now_s, keep_requested=True)
        # Only a mode received after the deadline counts: it may have been given before that.
        late = world.mode_received_s - status.since_s >= ready_timeout_s
        if late or world.tracking_lost:
            reason = pilot_texts.PLACE_LEFT()
            if late:
                reason = pilot_texts.MODE_NOT_GIVEN(limit=limit_text(ready_timeout_s))
            idle, effects = end_stream(status, MissionState.IDLE, reason, now_s, last_setpoint=True)
            return replace(idle, task=None if status.hold_ordered else status.task), effects
    elif state is MissionState.FLYING and world.on_leg:
        return enter(status, MissionState.LANDING_LEG, now_s, keep_requested=True)
    elif state is MissionState.LANDING_LEG and not world.on_leg:
        return enter(status, MissionState.FLYING, now_s, keep_requested=True)
    elif state is MissionState.FLYING and world.arrived and task is not None:
        if task.mission.visits_targets:
            return enter(status, MissionState.AT_TARGET, now_s, keep_requested=True)
        return _landed_above(status, now_s)
    elif state is MissionState.LANDING_LEG and world.arrived:
        return _landed_above(status, now_s)
    elif state is MissionState.AT_TARGET and task is not None and status.requested is None:
        if world.view_failed is not None:
            return _without_view(status, task, world.view_failed, world, on_failure, now_s)
        if world.view_pending or now_s - status.since_s < world.dwell_s:
            return status, ()
        rest = replace(task, stops=task.stops[1:])
        return _to_next(status, rest, world.views_missing, now_s)
    return status, ()


def _to_next(status: MissionStatus, rest: Task, missing: int, now_s: float) -> Step:
    """Requests the plan to the next target; after the last holds. missing: stops not done."""
    if not rest.done:
        return replace(status, requested=rest), (RequestPlan(rest),)
    held = entered(status, MissionState.HOLDING, now_s)
    words = pilot_texts.STOPS_MISSING(count=missing) if missing else pilot_texts.EVERY_TARGET_DONE()
    text = SendText(words, MissionState.HOLDING.words, serious=missing > 0)
    return replace(held, task=rest), (text,)


def _without_view(
    status: MissionStatus,
    task: Task,
    reason: str,
    world: Situation,
    on_failure: OnFailure,
    now_s: float,
) -> Step:
    """Leaves a view out that could not be captured, or holds there for an operator."""
    if on_failure is OnFailure.HOLD:
        held = entered(status, MissionState.HOLDING, now_s)
        return held, (SendText(reason, MissionState.HOLDING.words, serious=True),)
    skips = on_failure is OnFailure.SKIP
    others = tuple(stop for stop in task.stops[1:] if skips and stop in world.view_others)
    rest = replace(task, stops=tuple(stop for stop in task.stops[1:] if stop not in others))
    action = "target skipped" if skips else "view skipped"
    text = SendText(reason, action, serious=True)
    left_out = (LeaveOut(others, reason),) if others else ()
    after, effects = _to_next(status, rest, world.views_missing + len(others), now_s)
    return after, (text, *left_out, *effects)


def _landed_above(status: MissionStatus, now_s: float) -> Step:
    """Ends the landing leg: only the autopilot's landing is left."""
    held = entered(status, MissionState.HOLDING, now_s, keep_requested=True)
    task = None if held.task is None else replace(held.task, flown=True)
    return replace(held, task=task), (_ARRIVED, FlightEffect.LAND)


def _overridden(status: MissionStatus, world: Situation, *, resume: bool, now_s: float) -> Step:
    """Sends nothing while a pilot flies, unless the mode is given back and `resume` is set.

    A condition that would have ended our control ends the resumption, also if overridden.
    """
    gravest, task = next(iter(world.ruling.conditions), None), status.task
    if gravest is not None and gravest.condition.action is Action.RELEASE:
        return _released(status, world.ruling, gravest, world, now_s)
    if resume and world.mode_ours and task is not None and not task.done:
        return _requested(status, task, None, world, now_s)
    return status, ()


def _requested(
    status: MissionStatus, task: Task, order_id: int | None, world: Situation, now_s: float
) -> Step:
    """Requests a task's plan, if it could be flown; in control the flight continues meanwhile."""
    obstruction = world.ruling.against(task.mission)
    if obstruction is not None:
        return status, () if order_id is None else answer_rejected(status, order_id, obstruction)[1]
    crossed = status.state in _CONTROL_ENDED and now_s - status.since_s < _CROSSED_S
    if crossed and order_id is not None:
        return answer_rejected(status, order_id, pilot_texts.JUST_RELEASED())
    known = _known(world, now_s)
    newer = world.ruling.apart_from(known)
    if (
        order_id is not None
        and newer.action >= Action.HOLD
        and not is_escape_for(task, newer.action)
    ):
        return answer_rejected(status, order_id, f"{newer.reason} (just begun)")
    effects = answer_cancelled(status)
    if status.state not in STREAMING:
        status = replace(status, state=MissionState.PLANNING, since_s=now_s)
        effects = (*effects, SendText(pilot_texts.PLANNING(mission=task.mission.value)))
    requested = replace(status, requested=task, order_id=order_id, known=known)
    return requested, (*effects, RequestPlan(task))


def _known(world: Situation, now_s: float) -> frozenset[str]:
    """Conditions that an operator has received at this time."""
    return world.ruling.names_since(now_s - _CROSSED_S)


def _unfit(task: Task, world: Situation) -> str | None:
    """Reason why a found plan cannot begin from where the aircraft is now."""
    return pilot_texts.PLACE_LEFT() if world.tracking_lost else world.ruling.against(task.mission)

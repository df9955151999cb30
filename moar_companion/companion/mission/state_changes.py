"""Changes of state with their effects: to a state, to a state without a stream, and answers. Pure.

Inputs: the present status and the new state; outputs: the next status, and the effects that every
change of that kind has. `state_machine` decides which change is due.
"""

from __future__ import annotations

from dataclasses import replace

from ...texts import pilot_texts
from ..mission_states import STREAMING, MissionState
from .values import Answer, Effect, FlightEffect, MissionStatus, SendText, Step, Task, Verdict


def enter(
    status: MissionStatus, state: MissionState, now_s: float, *, keep_requested: bool = False
) -> Step:
    """Enters a state and reports it; drops the awaited plan, unless kept."""
    after = entered(status, state, now_s, keep_requested=keep_requested)
    return after, (SendText(state_words(state, status.task)),)


def entered(
    status: MissionStatus, state: MissionState, now_s: float, *, keep_requested: bool = False
) -> MissionStatus:
    """Enters a state; drops the awaited plan, unless kept."""
    after = replace(status, state=state, since_s=now_s, by_condition=False)
    return after if keep_requested else replace(after, requested=None, order_id=None)


def end_stream(
    status: MissionStatus,
    state: MissionState,
    reason: str,
    now_s: float,
    *,
    last_setpoint: bool = False,
    rest: Task | None = None,
) -> Step:
    """Ends the stream; an open order fails. rest: task that an operator may continue.

    With `last_setpoint` one at rest is sent, if there was a stream. Without it nothing
    more is sent: the autopilot has left our control, or our data on the aircraft is not reliable.
    """
    last = (FlightEffect.SEND_LAST_SETPOINT,) if last_setpoint and status.state in STREAMING else ()
    silent = MissionStatus(state=state, since_s=now_s, task=rest)
    text = SendText(reason, state.words, serious=state is not MissionState.IDLE)
    return silent, (*last, *answer_failed(status, reason), text)


def state_words(state: MissionState, task: Task | None) -> str:
    """Text of a state: `flying inspection to splice-inner`, `at target splice-inner`."""
    if task is None or state in {MissionState.IDLE, MissionState.RELEASED}:
        return pilot_texts.STATE(state=state.words)
    goal, mission = task.stops[0] if task.stops else "", task.mission.value
    if state is MissionState.AT_TARGET and goal:
        return pilot_texts.AT_TARGET(target=goal)
    if state is MissionState.LANDING_LEG:
        return pilot_texts.LANDING_LEG(escape=mission)
    if state is MissionState.READY:
        return pilot_texts.READY(mission=mission)
    if state is MissionState.FLYING and goal:
        return pilot_texts.FLYING_TO_TARGET(mission=mission, target=goal)
    return pilot_texts.STATE_OF_MISSION(state=state.words, mission=mission)


def answer_rejected(status: MissionStatus, order_id: int, reason: str) -> Step:
    """Answers an order that cannot be carried out now."""
    return status, (Answer(order_id, Verdict.TEMPORARILY_REJECTED, reason),)


def answer_failed(status: MissionStatus, reason: str) -> tuple[Effect, ...]:
    """Answers an open order that the supervisor forbids."""
    return () if status.order_id is None else (Answer(status.order_id, Verdict.FAILED, reason),)


def answer_cancelled(status: MissionStatus) -> tuple[Effect, ...]:
    """Answers an open order that a newer one replaces."""
    if status.order_id is None:
        return ()
    return (Answer(status.order_id, Verdict.CANCELLED, pilot_texts.REPLACED()),)

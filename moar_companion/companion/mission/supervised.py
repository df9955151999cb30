"""Effect of the supervisor's action on a flight in control: a hold, an escape, a resumed task.

Inputs: the mission status and the ruling. Outputs: the next status, with effects. Pure.
"""

from __future__ import annotations

from dataclasses import replace

from ...texts import pilot_texts
from ...types import Mission
from ..mission_states import MissionState
from ..safety.condition_types import Action
from ..safety.supervisor import Ruling
from .state_changes import answer_failed, entered
from .values import FlightEffect, MissionStatus, RequestPlan, SendText, Step, Task

_HELD_S = 1.0
"""Minimum hold before a flight resumes by itself: as long as any condition that holds."""
ESCAPE_MISSIONS = {
    Action.EXIT: (Mission.EXIT, Mission.EVACUATION),
    Action.EVACUATION: (Mission.EVACUATION,),
}
"""Missions for the supervisor's actions, in the order of the search for a plan."""
_ACTION_TEXTS = {Mission.EXIT: "exiting", Mission.EVACUATION: "evacuating"}
"""Texts for the companion's action in these missions."""


def supervised(status: MissionStatus, ruling: Ruling, now_s: float, *, on_leg: bool) -> Step | None:
    """Applies the supervisor's action to a flight in control; None if there is nothing to do."""
    if ruling.action in {Action.HOLD, Action.LEAVE}:
        return _braked(status, ruling, now_s, resumes=True)
    if ruling.action in ESCAPE_MISSIONS:
        return _escape(status, ruling, now_s, on_leg=on_leg)
    task = status.task
    if not status.resumes or status.requested is not None or task is None or task in status.no_path:
        return None
    if now_s - status.since_s < _HELD_S:
        return None
    text = SendText(
        pilot_texts.RESUMING(mission=task.mission.value), is_new=status.no_path_s < status.since_s
    )
    return replace(status, requested=task), (text, RequestPlan(task))


def complies_with(status: MissionStatus, action: Action) -> bool:
    """True if the flown or requested task is the escape that `action` requires, or a graver one."""
    task = status.requested or status.task
    return task is not None and is_escape_for(task, action)


def is_escape_for(task: Task, action: Action) -> bool:
    """True if a task is the escape that an action requires, or a graver one."""
    return not task.flown and task.mission in ESCAPE_MISSIONS.get(action, ())


def _braked(status: MissionStatus, ruling: Ruling, now_s: float, *, resumes: bool) -> Step:
    """Holds here; a task that an operator has held meanwhile, or that is done, does not resume."""
    failed = answer_failed(status, ruling.reason)
    if status.state is MissionState.HOLDING:
        if status.requested is None:
            return replace(status, resumes=resumes and status.resumes), ()
        resumes = resumes and status.resumes
        held = replace(status, requested=None, order_id=None, resumes=resumes)
        return held, (*failed, FlightEffect.BRAKE)
    left = status.task is not None and not status.task.done
    resumes = resumes and left and not status.hold_ordered
    status = replace(status, resumes=resumes, hold_ordered=False)
    held = entered(status, MissionState.HOLDING, now_s)
    leaves = ruling.action is Action.LEAVE
    action = ruling.action.words if leaves else MissionState.HOLDING.words
    text = SendText(ruling.reason, action, serious=True, condition=ruling.name)
    return held, (*failed, FlightEffect.BRAKE, text)


def _escape(status: MissionStatus, ruling: Ruling, now_s: float, *, on_leg: bool) -> Step | None:
    """Searches for the required escape route, if it is not flown already, or the next best.

    Without one, an active escape continues; any other flight holds. A landing leg is flown to its
    end, also from a hold on it.
    """
    task, holds = status.task, status.state is MissionState.HOLDING
    if task is None or task.flown:
        return None
    keeps_hold = status.requested is None and (holds or task in status.no_path)
    lands = status.state is MissionState.LANDING_LEG and status.requested is None
    if (lands or complies_with(status, ruling.action)) and not keeps_hold:
        return None
    choices = [
        choice
        for mission in (*ESCAPE_MISSIONS[ruling.action], Mission.EXIT)  # instead of a hold
        for choice in (task, Task(mission=mission))
        if choice.mission is mission and choice not in status.no_path
    ]
    if on_leg and not task.mission.visits_targets and task not in status.no_path:
        choices.insert(0, task)
    if not choices:
        if not task.mission.visits_targets and not holds:
            return None
        return _braked(status, ruling, now_s, resumes=False)
    wanted = choices[0]
    if status.order_id is None and wanted == (status.requested or (None if holds else task)):
        return None
    requested = replace(status, requested=wanted, order_id=None)
    action = _ACTION_TEXTS[wanted.mission]
    text = SendText(ruling.reason, action, serious=True, is_new=False, condition=ruling.name)
    return requested, (*answer_failed(status, ruling.reason), text, RequestPlan(wanted))

"""The mission machine: the states of the contract and what moves between them.

A pure step machine: `command`, `planned`, `unplanned` and `tick` take the present status and what
happened, and return the next status with the effects that the companion carries out.

    idle -> planning -> ready -> flying -> at_target | landing_leg -> holding
    in control, and a pilot takes the mode:        -> overridden
    streaming, and failsafe, stale data or fault:  -> released
"""

from __future__ import annotations

import enum
from dataclasses import dataclass, replace

from ..types import Mission


class MissionState(str, enum.Enum):
    """What the companion is doing, in the words of the contract."""

    IDLE = "idle"
    PLANNING = "planning"
    READY = "ready"
    FLYING = "flying"
    AT_TARGET = "at_target"
    LANDING_LEG = "landing_leg"
    HOLDING = "holding"
    OVERRIDDEN = "overridden"
    RELEASED = "released"


IN_CONTROL = frozenset(
    {
        MissionState.FLYING,
        MissionState.AT_TARGET,
        MissionState.LANDING_LEG,
        MissionState.HOLDING,
    }
)
"""The autopilot follows our setpoints."""

STREAMING = IN_CONTROL | {MissionState.READY}
"""Setpoints are sent."""

_INTERRUPTED = IN_CONTROL - {MissionState.HOLDING}
"""What a pilot interrupts here may be resumed; what an operator held is not."""

_CROSSED_S = 0.5
"""An order that comes so soon after we let go was given before its sender knew."""


class Order(str, enum.Enum):
    """What an operator may order besides the three missions."""

    HOLD = "hold"
    CONTINUE = "continue"
    RELEASE = "release"


class Verdict(enum.Enum):
    """How an order ends; the words of MAV_RESULT."""

    ACCEPTED = "accepted"
    TEMPORARILY_REJECTED = "temporarily rejected"
    DENIED = "denied"
    FAILED = "failed"
    CANCELLED = "cancelled"


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """A mission with what is left of it. stops: targets still to visit, the next one first."""

    mission: Mission
    stops: tuple[str, ...] = ()
    landing: int | None = None
    """The index of the landing point of an exit or evacuation; None for any."""
    flown: bool = False
    """An exit or evacuation that has ended above its landing point."""

    @property
    def goal(self) -> str | int | None:
        """What the planner is asked for."""
        return self.stops[0] if self.mission is Mission.INSPECTION else self.landing

    @property
    def done(self) -> bool:
        """Whether nothing of it is left to fly."""
        return self.flown or (self.mission is Mission.INSPECTION and not self.stops)


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionStatus:
    """Where the machine stands."""

    state: MissionState = MissionState.IDLE
    since_s: float = 0.0
    task: Task | None = None
    """What is flown or held; while overridden, what a pilot interrupted."""
    sought: Task | None = None
    """The task whose first plan is awaited."""
    order_id: int | None = None
    """The operator's order that `sought` answers; None for a next target."""
    failsafe_known: bool = False
    """The autopilot was already in failsafe when an operator ordered this."""
    held: bool = False
    """A hold was ordered while ready: when the mode is given, the place is held."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """What the machine must know of the world at one instant."""

    obstruction: str | None
    """Why nothing may be streamed now (no position, link lost, ...); None when all is well."""
    reluctance: str | None
    """Why nothing may be begun now (too far from the plane, ...); what is flown goes on."""
    airborne: bool
    """Armed, and known to be in the air."""
    grounded: bool
    """Disarmed, or known to be on the ground."""
    mode_ours: bool
    """The autopilot is in the mode in which it follows our setpoints."""
    mode_heard_s: float
    """When its mode was last heard: once a second, so it may have changed since."""
    autopilot_failsafe: bool
    parting: bool = True
    """Whether a last setpoint at rest does good when the stream ends for an obstruction."""
    landing_requested: bool = False
    """We asked for the landing, so that a mode that is not ours is no pilot's."""
    on_leg: bool = False
    """The reference has entered the landing leg."""
    arrived: bool = False
    """The reference has reached the end of its trajectory."""
    dwell_s: float = 0.0
    """How long to stay at the present target."""
    astray: bool = False
    """The aircraft is not where the setpoint is; it would be drawn there when the mode is given."""


@dataclass(frozen=True, slots=True)
class Seek:
    """Effect: ask the planner for this task's plan."""

    task: Task


@dataclass(frozen=True, slots=True)
class Answer:
    """Effect: answer an operator's order."""

    order_id: int
    verdict: Verdict
    reason: str = ""


@dataclass(frozen=True, slots=True)
class Say:
    """Effect: tell people."""

    text: str
    serious: bool = False


class Do(enum.Enum):
    """Effects without data."""

    BRAKE = "come to rest on the path and stay"
    FAREWELL = "one last setpoint, at rest"
    LAND = "ask for the landing, where the configuration allows"


Effect = Seek | Answer | Say | Do
Step = tuple[MissionStatus, tuple[Effect, ...]]


def command(
    status: MissionStatus, order: Task | Order, order_id: int, world: Situation, now_s: float
) -> Step:
    """An operator's order."""
    if isinstance(order, Task):
        return _sought(status, order, order_id, world, now_s)
    if order is Order.CONTINUE:
        if status.task is None or not (status.held or status.state is MissionState.HOLDING):
            return _rejected(status, order_id, "nothing is held")
        if status.task.done:
            return _rejected(status, order_id, "nothing is left to fly")
        return _sought(status, status.task, order_id, world, now_s)
    done = Answer(order_id, Verdict.ACCEPTED)
    overtaken, status = _cancelled(status), replace(status, order_id=None)
    if order is Order.HOLD and status.state in IN_CONTROL:
        held, effects = _enter(status, MissionState.HOLDING, now_s)
        return held, (*overtaken, *effects, Do.BRAKE, done)
    if order is Order.HOLD and status.state is MissionState.READY:
        # The mode may have been given and not yet heard of: the stream must not end.
        ready = replace(status, held=True, sought=None)
        return ready, (*overtaken, Do.BRAKE, done, Say("MOAR ready to hold"))
    if status.state in STREAMING or status.state is MissionState.PLANNING:
        rest = MissionState.IDLE if order is Order.HOLD else MissionState.RELEASED
        silent, effects = _silenced(status, rest, f"{order.value} on command", now_s, farewell=True)
        return silent, (*overtaken, *effects, done)
    if order is Order.RELEASE:
        return status, (done,)
    return _rejected(status, order_id, "nothing is flown")


def planned(status: MissionStatus, now_s: float) -> Step:
    """The plan of `sought` was found."""
    if status.sought is None:
        return status, ()
    in_control = status.state in IN_CONTROL
    found, effects = _enter(
        replace(status, task=status.sought, held=False),
        MissionState.FLYING if in_control else MissionState.READY,
        now_s,
    )
    answers = () if status.order_id is None else (Answer(status.order_id, Verdict.ACCEPTED),)
    return found, (*effects, *answers)


def unplanned(status: MissionStatus, reason: str, now_s: float) -> Step:
    """There is no plan of `sought`; what is flown goes on, what is not is idle."""
    if status.sought is None:
        return status, ()
    answers = () if status.order_id is None else (Answer(status.order_id, Verdict.DENIED, reason),)
    if status.state is MissionState.PLANNING:
        idle, effects = _enter(status, MissionState.IDLE, now_s)
        return idle, (*effects, *answers)
    if status.state is MissionState.AT_TARGET and status.order_id is None:
        held, effects = _enter(status, MissionState.HOLDING, now_s)
        say = Say(f"No way to {status.sought.goal}: {reason}", serious=True)
        return replace(held, task=status.sought), (*effects, say)
    return replace(status, sought=None, order_id=None), answers


def withdrawn(status: MissionStatus, order_id: int, now_s: float) -> Step:
    """The operator took an order back while its plan was awaited."""
    if status.order_id != order_id:
        return status, ()
    if status.state is MissionState.PLANNING:
        return _enter(status, MissionState.IDLE, now_s)
    return replace(status, sought=None, order_id=None), ()


def tick(
    status: MissionStatus,
    world: Situation,
    *,
    ready_timeout_s: float,
    resume: bool,
    now_s: float,
) -> Step:
    """One look at the world; what ends our control comes first."""
    state = status.state
    if state is MissionState.OVERRIDDEN:
        return _overridden(status, world, resume=resume, now_s=now_s)
    if state not in STREAMING and state is not MissionState.PLANNING:
        return status, ()
    if world.obstruction is not None:
        return _silenced(
            status, MissionState.RELEASED, world.obstruction, now_s, farewell=world.parting
        )
    if world.autopilot_failsafe and not status.failsafe_known:
        return _silenced(status, MissionState.RELEASED, "the autopilot is in failsafe", now_s)
    if world.grounded:
        return _silenced(status, MissionState.IDLE, "on the ground", now_s)
    if status.failsafe_known and not world.autopilot_failsafe:
        status = replace(status, failsafe_known=False)
    if state in IN_CONTROL and not world.mode_ours:
        if world.landing_requested:
            return _silenced(status, MissionState.IDLE, "the autopilot has left our mode", now_s)
        return _silenced(status, MissionState.OVERRIDDEN, "the pilot has control", now_s)
    return _onward(status, world, ready_timeout_s, now_s)


def _onward(status: MissionStatus, world: Situation, ready_timeout_s: float, now_s: float) -> Step:
    """What the mission does next while nothing stands against it."""
    state, task = status.state, status.task
    if state is MissionState.READY:
        if world.mode_ours:
            given = MissionState.HOLDING if status.held else MissionState.FLYING
            return _enter(replace(status, held=False), given, now_s, keep_sought=True)
        # By a mode heard after the deadline: before that it may have been given.
        late = world.mode_heard_s - status.since_s >= ready_timeout_s
        if late or world.astray:
            reason = "the mode was not given" if late else "the aircraft has left its place"
            return _silenced(status, MissionState.IDLE, reason, now_s, farewell=True)
    elif state is MissionState.FLYING and world.on_leg:
        return _enter(status, MissionState.LANDING_LEG, now_s, keep_sought=True)
    elif state is MissionState.FLYING and world.arrived and task is not None:
        if task.mission is Mission.INSPECTION:
            return _enter(status, MissionState.AT_TARGET, now_s, keep_sought=True)
        return _landed_above(status, now_s)
    elif state is MissionState.LANDING_LEG and world.arrived:
        return _landed_above(status, now_s)
    elif state is MissionState.AT_TARGET and task is not None and status.sought is None:
        if now_s - status.since_s < world.dwell_s:
            return status, ()
        rest = replace(task, stops=task.stops[1:])
        if rest.done:
            held, effects = _enter(status, MissionState.HOLDING, now_s)
            return replace(held, task=rest), (*effects, Say("every target is done"))
        return replace(status, sought=rest), (Seek(rest),)
    return status, ()


def _landed_above(status: MissionStatus, now_s: float) -> Step:
    """The landing leg is done: what is left is the autopilot's landing."""
    held, effects = _enter(status, MissionState.HOLDING, now_s, keep_sought=True)
    task = None if held.task is None else replace(held.task, flown=True)
    return replace(held, task=task), (*effects, Do.LAND)


def _overridden(status: MissionStatus, world: Situation, *, resume: bool, now_s: float) -> Step:
    """A pilot flies: silent, unless the mode is given back and `resume` says to go on."""
    if world.autopilot_failsafe:
        return _silenced(status, MissionState.RELEASED, "the autopilot is in failsafe", now_s)
    if world.grounded:
        return _silenced(status, MissionState.IDLE, "on the ground", now_s)
    task = status.task
    if resume and world.mode_ours and task is not None and not task.done:
        return _sought(status, task, None, world, now_s)
    return status, ()


def _sought(
    status: MissionStatus, task: Task, order_id: int | None, world: Situation, now_s: float
) -> Step:
    """Ask for a task's plan, if it could be flown; in control the flight goes on meanwhile."""
    obstruction = world.obstruction or world.reluctance
    if obstruction is None and not world.airborne:
        obstruction = "not in the air"
    if obstruction is not None:
        return status, () if order_id is None else _rejected(status, order_id, obstruction)[1]
    if status.state is MissionState.RELEASED and now_s - status.since_s < _CROSSED_S:
        return status, () if order_id is None else _rejected(status, order_id, "just let go")[1]
    effects = _cancelled(status)
    if status.state not in STREAMING:
        status = replace(status, state=MissionState.PLANNING, since_s=now_s)
        effects = (*effects, Say(f"MOAR planning {task.mission.value}"))
    sought = replace(
        status,
        sought=task,
        order_id=order_id,
        failsafe_known=world.autopilot_failsafe,
    )
    return sought, (*effects, Seek(task))


def _rejected(status: MissionStatus, order_id: int, reason: str) -> Step:
    return status, (Answer(order_id, Verdict.TEMPORARILY_REJECTED, reason),)


def _enter(
    status: MissionStatus, state: MissionState, now_s: float, *, keep_sought: bool = False
) -> Step:
    """A new state; whatever plan was awaited is awaited no more, unless kept."""
    words = "" if status.task is None else f" {status.task.mission.value}"
    entered = replace(status, state=state, since_s=now_s)
    if not keep_sought:
        entered = replace(entered, sought=None, order_id=None)
    return entered, (Say(f"MOAR {state.value}{words}"),)


def _cancelled(status: MissionStatus) -> tuple[Effect, ...]:
    """The answer to an order that another one overtakes."""
    return () if status.order_id is None else (Answer(status.order_id, Verdict.CANCELLED),)


def _silenced(
    status: MissionStatus,
    state: MissionState,
    reason: str,
    now_s: float,
    *,
    farewell: bool = False,
) -> Step:
    """The stream ends; an open order fails.

    With `farewell` a last setpoint at rest is sent, where there was a stream. Without it nothing
    more is sent: the autopilot has left us, or what we know of the aircraft is not to be trusted.
    """
    interrupted = status.task if status.state in _INTERRUPTED else None
    last = (Do.FAREWELL,) if farewell and status.state in STREAMING else ()
    failed = () if status.order_id is None else (Answer(status.order_id, Verdict.FAILED, reason),)
    silent = MissionStatus(state=state, since_s=now_s, task=interrupted)
    say = Say(f"MOAR {state.value}: {reason}", serious=state is not MissionState.IDLE)
    return silent, (*last, *failed, say)

"""What the mission machine speaks of: states, orders, tasks, what it is shown and what it wants.

Values only; `machine` has the steps between them, `supervisor` what may be flown.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field, replace

from ..types import Mission
from .states import MissionState
from .supervisor import Ruling


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
    """The task that is flown or held. While overridden the one that a pilot has interrupted; while
    idle or planning that one, or the rest after a restart: an operator may continue it."""
    sought: Task | None = None
    """The task whose first plan is awaited."""
    order_id: int | None = None
    """The operator's order that `sought` answers; None for what the machine seeks by itself."""
    known: frozenset[str] = frozenset()
    """The conditions of which who gave that order knew, and that have acted ever since."""
    held: bool = False
    """A hold was ordered while ready: when the mode is given, the place is held."""
    goes_on: bool = False
    """The supervisor holds, nobody else: what is held is flown on when nothing is against it."""
    no_way: frozenset[Task] = frozenset()
    """What is not sought as a way out for a while: in vain from here, or the planner failed."""
    no_way_s: float = -math.inf
    """When that was last found."""

    def without(self, *tasks: Task, now_s: float) -> MissionStatus:
        """The same, and these are not sought as ways out for a while."""
        vain = self.no_way.union(tasks)
        return self if vain == self.no_way else replace(self, no_way=vain, no_way_s=now_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """What the machine must know of the world at one instant."""

    ruling: Ruling = field(default_factory=Ruling)
    """What may be flown."""
    mode_ours: bool
    """The autopilot is in the mode in which it follows our setpoints."""
    mode_heard_s: float
    """When its mode was last heard: once a second, so it may have changed since."""
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
    """Effect: tell people. action: what the companion does about it."""

    text: str
    action: str = ""
    serious: bool = False
    news: bool = True
    """Whether it is worth saying again soon."""
    condition: str = ""
    """The name of the condition that it tells of."""


@dataclass(frozen=True, slots=True)
class Overrule:
    """Effect: an operator's order is flown, who knew what the supervisor has against it."""

    known: frozenset[str]
    """The names of those conditions."""


class Do(enum.Enum):
    """Effects without data."""

    BRAKE = "come to rest on the path and stay"
    FAREWELL = "one last setpoint, at rest"
    LAND = "ask for the landing, where the configuration allows"


Effect = Seek | Answer | Say | Overrule | Do
Step = tuple[MissionStatus, tuple[Effect, ...]]

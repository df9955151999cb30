"""Values of the mission machine: orders, tasks, status, situation and effects.

Values only; `state_machine` has the steps between them, `state_changes` the effects that steps
share, `supervisor` the permitted action.
"""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass, field, replace

from ...types import Mission
from ..mission_states import MissionState
from ..safety.supervisor import Ruling


class Order(str, enum.Enum):
    """Operators' orders besides the three missions."""

    HOLD = "hold"
    CONTINUE = "continue"
    RELEASE = "release"


class Verdict(enum.Enum):
    """Result of an order; the terms of MAV_RESULT."""

    ACCEPTED = "accepted"
    TEMPORARILY_REJECTED = "temporarily rejected"
    DENIED = "denied"
    FAILED = "failed"
    CANCELLED = "cancelled"


@dataclass(frozen=True, slots=True, kw_only=True)
class Task:
    """A mission with the part still to fly. stops: targets still to visit, the next one first."""

    mission: Mission
    stops: tuple[str, ...] = ()
    landing: int | None = None
    """Index of the landing point of an exit or evacuation; None for any."""
    flown: bool = False
    """True for an exit or evacuation that has ended above its landing point."""

    @property
    def goal(self) -> str | int | None:
        """Goal for the planner."""
        return self.stops[0] if self.mission.visits_targets else self.landing

    @property
    def done(self) -> bool:
        """True if no part of it is left to fly."""
        return self.flown or (self.mission.visits_targets and not self.stops)


@dataclass(frozen=True, slots=True, kw_only=True)
class MissionStatus:
    """Status of the mission machine."""

    state: MissionState = MissionState.IDLE
    since_s: float = 0.0
    task: Task | None = None
    """Task that is flown or held. While overridden, the task that a pilot has interrupted; while
    released, the one that a passing cause has; while idle or planning either, or the rest after a
    restart: an operator may continue it."""
    requested: Task | None = None
    """Task whose first plan is awaited."""
    order_id: int | None = None
    """Operator's order that `requested` answers; None for a request of the machine itself."""
    known: frozenset[str] = frozenset()
    """Conditions known to the operator of that order, which have acted ever since."""
    hold_ordered: bool = False
    """While ready: an operator has ordered a hold. If the mode is given, the aircraft holds; if the
    offer expires, the task is dropped."""
    resumes: bool = False
    """While holding: the supervisor holds, not an operator. Resumes when no condition acts."""
    no_path: frozenset[Task] = frozenset()
    """Tasks not searched as escape for a while: no path found from here, or the planner failed."""
    no_path_s: float = -math.inf
    """Time when that was last found."""
    landed: bool = False
    """True if the landing has ended the last task."""
    by_condition: bool = False
    """While released: a condition has ended control, and no operator has ordered a release since.
    """

    def without(self, *tasks: Task, now_s: float) -> MissionStatus:
        """Returns the status without these tasks as escape routes for a while."""
        failed_tasks = self.no_path.union(tasks)
        return (
            self
            if failed_tasks == self.no_path
            else replace(self, no_path=failed_tasks, no_path_s=now_s)
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Situation:
    """Inputs of the machine at one instant."""

    ruling: Ruling = field(default_factory=Ruling)
    """Supervisor's ruling on the flight."""
    mode_ours: bool
    """True if the autopilot is in the mode in which it follows our setpoints."""
    mode_received_s: float
    """Time when its mode was last received; it may have changed since."""
    on_leg: bool = False
    """True if the reference has entered the landing leg."""
    arrived: bool = False
    """True if the reference has reached the end of its trajectory."""
    dwell_s: float = 0.0
    """Time to stay at the present target."""
    view_pending: bool = False
    """True while the view at the present target is not captured."""
    view_failed: str | None = None
    """Reason why it could not be captured; None without one."""
    view_others: tuple[str, ...] = ()
    """Stops of the same target, that one included."""
    views_missing: int = 0
    """Stops of the inspection so far that are not done."""
    tracking_lost: bool = False
    """True if the aircraft is off its setpoint; given the mode, it would fly to the setpoint."""


@dataclass(frozen=True, slots=True)
class RequestPlan:
    """Effect: request this task's plan from the planner."""

    task: Task


@dataclass(frozen=True, slots=True)
class Answer:
    """Effect: answer an operator's order."""

    order_id: int
    verdict: Verdict
    reason: str = ""


@dataclass(frozen=True, slots=True)
class SendText:
    """Effect: send a text to operators. action: the companion's action on it."""

    text: str
    action: str = ""
    serious: bool = False
    is_new: bool = True
    """True if a repetition soon after is worth sending."""
    condition: str = ""
    """Name of the condition that it reports."""


@dataclass(frozen=True, slots=True)
class OverrideConditions:
    """Effect: override the conditions known to the operator whose order is flown."""

    known: frozenset[str]
    """Names of those conditions."""


@dataclass(frozen=True, slots=True)
class LeaveOut:
    """Effect: note the stops that are left out, and the reason."""

    stops: tuple[str, ...]
    reason: str


class FlightEffect(enum.Enum):
    """Effects without data."""

    BRAKE = "come to rest on the path and stay"
    SEND_LAST_SETPOINT = "one last setpoint, at rest"
    LAND = "ask for the landing, where the configuration allows"


Effect = RequestPlan | Answer | SendText | OverrideConditions | LeaveOut | FlightEffect
Step = tuple[MissionStatus, tuple[Effect, ...]]

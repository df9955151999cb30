"""Survival: whether what is flown may be, by what becomes of it if the companion dies.

Inputs: the autopilot's parameters and its home, the flight, plans for it. Outputs: reasons to
refuse a plan or to hold, and warnings for people.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ..autopilots.failsafe_actions import LINKS, Failsafes
from ..config import LossCheck, Supervision
from ..guidance.trajectory import FloatArray
from ..mavlink.session import Severity
from ..planner.reach import Reach
from ..types import AutopilotKind, Mission, Vector
from ..vehicle import Vehicle
from .flight import Flight
from .jobs import PlanAnswer
from .loss import Loss
from .motion import home_moved
from .planning import Awaited
from .reports import Reports
from .surroundings import Ground


class Survival:
    """Remembers what the autopilot does without us, and what there is against it.

    limits: what is done about an objection; a way out is only warned about: to stay is no better.
    """

    def __init__(
        self, ground: Ground | None, vehicle: Vehicle, limits: Supervision, reports: Reports
    ) -> None:
        self._ground = ground
        self._vehicle = vehicle
        self._check = limits.loss_action
        self._failsafe_check = limits.failsafe_action
        self._reports = reports
        self._home_m: Vector | None = None
        """In the site's frame, as what is flown was last judged by it."""
        self.loss: Loss | None = None
        """What becomes of a flight that nobody steers; None while that is not known."""
        self.objection: str | None = None
        """Why what is flown or held should not be, by what has changed since it was planned."""

    def learn(
        self,
        kind: AutopilotKind,
        parameters: Mapping[str, float | None],
        home_m: Vector | None,
        flight: Flight | None,
        now_s: float,
    ) -> None:
        """Take in the autopilot's parameters and home, for what is flown, or held, as well.

        Say which of the parameters it never told.
        """
        before, self.loss = self.loss, Loss.told(kind, parameters)
        if self.loss is None:
            return
        if self.loss != before:
            if self.loss.assumption:
                self._reports.say(Severity.WARNING, self.loss.assumption, now_s)
            if flight is not None:
                flight.learn_loss(self.loss)
        elif not home_moved(home_m, self._home_m):
            return
        self._home_m = home_m
        self.objection = None
        if flight is None or flight.mission is None:
            return
        objection = self._objection_to(flight.reach, flight.rests_ahead_m())
        if objection is not None and self._refuses(flight.mission):
            self.objection = objection
        elif objection is not None:
            self._reports.say(Severity.WARNING, objection, now_s)

    def reconsider(self, flight: Flight | None) -> None:
        """Obstacles are less wide, or failsafes others: what the companion's own loss does counts.

        The next plan is judged by all of their width.
        """
        if self.objection is not None and flight is not None:
            self.objection = self._objection_to(None, flight.rests_ahead_m())

    def checked(
        self,
        awaited: Awaited,
        answer: PlanAnswer,
        flight: Flight | None,
        failsafes: Failsafes,
        now_s: float,
        *,
        ordered: bool,
    ) -> PlanAnswer:
        """The answer; without its plan, where the autopilot would hit something if we died on it.

        Then the path that is flown stays, unless to die on that were no better. A first plan that
        no operator has ordered is objected to until something changes.
        """
        plan = answer.plan
        if flight is None or plan is None:
            return answer
        rests_m = flight.rests_m(plan, awaited.junction, answer.escape_m, answer.reach)
        objection = self._objection_to(answer.reach, rests_m)
        if awaited.first:
            by_itself = self._by_itself(failsafes, answer.reach, rests_m)
            refused = self._failsafe_check is LossCheck.REFUSE
            if by_itself is not None and refused and plan.mission is Mission.INSPECTION:
                if not ordered:
                    self.objection = by_itself
                return replace(answer, plan=None, reason=by_itself, deadly=True)
            if by_itself is not None:
                self._reports.say(Severity.NOTICE, by_itself, now_s)
        if objection is None:
            return answer
        if self._refuses(plan.mission):
            if not awaited.first:
                self.objection = self._objection_to(answer.reach, flight.rests_ahead_m())
            elif not ordered:
                self.objection = objection
            return replace(answer, plan=None, reason=objection, deadly=True)
        if awaited.first:
            self._reports.say(Severity.WARNING, objection, now_s)
        return answer

    def _by_itself(
        self, failsafes: Failsafes, reach: Reach | None, rests_m: FloatArray
    ) -> str | None:
        """What the autopilot would hit from some places (n, 2) when a link is lost, in words."""
        if self._ground is None:
            return None
        found = failsafes.of(LINKS).hit(reach or self._ground.maps.reach, rests_m)
        if found is None:
            return None
        action, hit = found
        return f"{action.trigger.value}: {action.action.value} hits {hit.obstacle}"

    def _objection_to(self, reach: Reach | None, rests_m: FloatArray) -> str | None:
        """Why nobody should die at rest at any of some places (n, 2); None when all is well."""
        loss, ground = self.loss, self._ground
        if loss is None or ground is None:
            return None
        lag = loss.lag(self._vehicle.guidance.acceleration_mps2)
        return lag or loss.objection(reach or ground.maps.reach, rests_m, self._home_m)

    def _refuses(self, mission: Mission) -> bool:
        """Whether an objection forbids a mission."""
        return self._check is LossCheck.REFUSE and mission is Mission.INSPECTION

"""The plan desk: which plan is awaited, where it will begin, and since when.

Jobs go out as values and answers come back as values; only the newest job's answer counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..autopilots.failsafe_actions import NO_FAILSAFES, Failsafes
from ..mission.values import Task
from ..planner.fence import PlaneFence
from ..planner.plan import PlanRequest
from ..types import RiskIndices, Weights
from .jobs import PlanAnswer, PlanJob
from .junction import Junction

_ANSWER_TIMEOUT_S = 5.0
"""Plans take milliseconds: a planner that is silent for so long has failed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Awaited:
    """A plan that was asked for: where it begins, and whether it is the mission's first."""

    job: PlanJob
    junction: Junction
    first: bool
    reason: str
    """Why it was asked for."""


class PlanDesk:
    """Asks for plans one at a time."""

    def __init__(self) -> None:
        self._last_id = 0
        self._jobs: list[PlanJob] = []
        self._awaited: Awaited | None = None
        self.asked_s = -math.inf
        self.asked_risk = RiskIndices()
        self.asked_widening_m = 0.0
        self.asked_fence: PlaneFence | None = None
        self.asked_failsafes = NO_FAILSAFES
        """When the last plan was asked for, under which risks, how wide obstacles were, within
        which fence, and with which failsafes."""
        self.wanting_since_s: float | None = None
        """When a new plan of what is flown was first asked for, of which none has come since."""

    @property
    def awaited(self) -> Awaited | None:
        """The plan whose answer is still to come."""
        return self._awaited

    def ask(
        self,
        task: Task,
        junction: Junction,
        weights: Weights,
        risk: RiskIndices,
        widening_m: float,
        fence: PlaneFence | None,
        failsafes: Failsafes,
        narrowed_m: float,
        *,
        first: bool,
        reason: str,
        now_s: float,
    ) -> None:
        """Ask for a task's plan; whatever was awaited is awaited no more."""
        (x_m, _, z_m), (vx_mps, _, vz_mps) = junction.position_m, junction.velocity_mps
        self._last_id += 1
        job = PlanJob(
            job_id=self._last_id,
            request=PlanRequest(
                mission=task.mission,
                target=task.goal,
                start_m=(x_m, z_m),
                velocity_mps=(vx_mps, vz_mps),
                weights=weights,
                risk=risk,
            ),
            widening_m=widening_m,
            fence=fence,
            failsafes=failsafes,
            narrowed_m=narrowed_m,
        )
        self._awaited = Awaited(job=job, junction=junction, first=first, reason=reason)
        if first:
            self.wanting_since_s = None
        elif self.wanting_since_s is None:
            self.wanting_since_s = now_s
        self._jobs.append(job)
        self.asked_s, self.asked_risk = now_s, risk
        self.asked_widening_m, self.asked_fence = widening_m, fence
        self.asked_failsafes = failsafes

    def forget(self) -> None:
        """Nothing is awaited any more."""
        self._awaited = None
        self.wanting_since_s = None

    def taken(self, answer: PlanAnswer) -> Awaited | None:
        """What an answer belongs to; None when it is no longer awaited."""
        awaited = self._awaited
        if awaited is None or awaited.job.job_id != answer.job_id:
            return None
        self._awaited = None
        if answer.plan is not None:
            self.wanting_since_s = None
        return awaited

    def overdue(self, now_s: float) -> PlanAnswer | None:
        """The answer in place of one that has not come in time."""
        if self._awaited is None or now_s - self.asked_s < _ANSWER_TIMEOUT_S:
            return None
        return PlanAnswer(
            job_id=self._awaited.job.job_id,
            plan=None,
            reason="the planner does not answer",
            failed=True,
        )

    def jobs(self) -> list[PlanJob]:
        """Jobs since the last call."""
        jobs, self._jobs = self._jobs, []
        return jobs

"""Plan requests: reasons for a new plan, the awaited one, and for keeping the path that is flown.

Jobs go out as values and answers come back as values; only the newest job's answer counts. A new
plan is due periodically, after a risk has left its dead band, and after obstacles have become wider
or less wide; not too often. The new path has to be better by a margin. Without the margin, noise on
the risks would change between two paths of nearly equal cost every few seconds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from ..mavlink.autopilots.failsafe_actions import NO_FAILSAFES, Failsafes
from ..planner.adaptation import Adaptation
from ..planner.plan_values import PlanRequest
from ..planner.plane_fence import PlaneFence
from ..planner.site import PlanePoint
from ..settings.config import Replanning
from ..settings.vehicle import Vehicle
from ..texts import pilot_texts
from ..texts.text_format import seconds
from ..types import RiskIndices
from .guidance.splice import Splice
from .mission.values import Task
from .planning.plan_jobs import PlanAnswer, PlanJob
from .planning.site_maps import SiteMaps

_ANSWER_TIMEOUT_S = 5.0
"""Plans take milliseconds: a planner without an answer for this long has failed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanBasis:
    """Inputs that a plan is made for; a change of most of them is a reason for the next.

    widening_m: inflation of obstacles. narrowed_m: part of the margin that an escape route may
    give up.
    """

    risk: RiskIndices = field(default_factory=RiskIndices)
    widening_m: float = 0.0
    narrowed_m: float = 0.0
    fence: PlaneFence | None = None
    failsafes: Failsafes = NO_FAILSAFES
    site_maps: SiteMaps | None = None
    vehicle: Vehicle | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Awaited:
    """A requested plan: its start, and if it is the mission's first.

    since_s: time of the first request for it, of which this may be a repetition.
    """

    job: PlanJob
    junction: Splice
    first: bool
    since_s: float
    reason: str
    """Reason for the request."""


def replan_reason(
    policy: Replanning, basis: PlanBasis, risk: RiskIndices, widening_m: float, age_s: float
) -> str | None:
    """Reason to plan again, `age_s` after the last plan; None if there is no reason.

    basis: of the last plan. widening_m: inflation of obstacles now; in steps, so that any change
    counts.
    """
    if age_s < policy.min_interval_s:
        return None
    if widening_m != basis.widening_m:
        return f"obstacles wider by {basis.widening_m:.1f} -> {widening_m:.1f} m"
    before = basis.risk.as_dict()
    for name, value in risk.as_dict().items():
        if abs(value - before[name]) >= policy.risk_change:
            return f"{name} risk {before[name]:.2f} -> {value:.2f}"
    return "time" if age_s >= policy.period_s else None


def stays(policy: Replanning, *, flown_cost: float, new_cost: float) -> bool:
    """True if a path that is still free stays. Costs: J of both from one place, by new weights."""
    return flown_cost - new_cost <= policy.improvement * flown_cost


class PlanRequests:
    """Requests plans one at a time."""

    def __init__(self) -> None:
        self._last_id = 0
        self._jobs: list[PlanJob] = []
        self._awaited: Awaited | None = None
        self._origin_m: PlanePoint | None = None
        """Start of the first plan of the present task."""
        self._answer: PlanAnswer | None = None
        """Its answer, until the mission takes it."""
        self.asked_s = -math.inf
        """Time of the last request; a first plan keeps that of its first request."""
        self.basis = PlanBasis()
        """What it was made for."""
        self.wanting_since_s: float | None = None
        """Time of the first request for a new plan of the current task; None if none is pending."""

    @property
    def awaited(self) -> Awaited | None:
        """Plan whose answer is pending."""
        return self._awaited

    def ask(
        self,
        task: Task,
        junction: Splice,
        adaptation: Adaptation,
        basis: PlanBasis,
        *,
        first: bool,
        reason: str,
        now_s: float,
        in_best_order: bool = False,
    ) -> None:
        """Requests a task's plan; drops the request that was pending.

        in_best_order: the planner puts the task's stops into the best order.

        The task's weights are calibrated from the start of its first plan, so that the same risks
        give the same weights along the whole flight.
        """
        (x_m, _, z_m), (vx_mps, _, vz_mps) = junction.position_m, junction.velocity_mps
        if first:
            self._origin_m = (x_m, z_m)
        self._last_id += 1
        job = PlanJob(
            job_id=self._last_id,
            request=PlanRequest(
                mission=task.mission,
                target=task.goal,
                start_m=(x_m, z_m),
                velocity_mps=(vx_mps, vz_mps),
                weights=adaptation.weights(basis.risk),
                risk=basis.risk,
                adaptation=adaptation,
            ),
            stops=task.stops if in_best_order and len(task.stops) > 1 else (),
            origin_m=self._origin_m,
            widening_m=basis.widening_m,
            fence=basis.fence,
            failsafes=basis.failsafes,
            narrowed_m=basis.narrowed_m,
        )
        if first:
            self.wanting_since_s = None
        elif self.wanting_since_s is None:
            self.wanting_since_s = now_s
        self._awaited = Awaited(
            job=job,
            junction=junction,
            first=first,
            since_s=now_s if self.wanting_since_s is None else self.wanting_since_s,
            reason=reason,
        )
        self._answer = None
        self._jobs.append(job)
        self.asked_s, self.basis = now_s, basis

    def ask_again(self, awaited: Awaited, site_maps: SiteMaps | None, now_s: float) -> None:
        """Repeats a request whose answer is on maps that are no longer the present ones."""
        self._last_id += 1
        job = replace(awaited.job, job_id=self._last_id)
        self._awaited = replace(awaited, job=job)
        self._jobs.append(job)
        self.basis = replace(self.basis, site_maps=site_maps)
        if not awaited.first:  # the time-out of a first plan counts from its first request
            self.wanting_since_s, self.asked_s = awaited.since_s, now_s

    def forget(self) -> None:
        """Drops the pending request."""
        self._awaited = self._answer = None
        self.wanting_since_s = None

    def answered(self, answer: PlanAnswer) -> None:
        """Keeps the answer to the pending request; drops any other. A plan ends the wait for it."""
        if self._awaited is None or self._awaited.job.job_id != answer.job_id:
            return
        self._answer = answer
        if answer.plan is not None:
            self.wanting_since_s = None

    def taken(self, now_s: float) -> tuple[Awaited, PlanAnswer] | None:
        """Ends the pending request: returns it with its answer, a failure if none came in time."""
        awaited, answer = self._awaited, self._answer
        if awaited is not None and answer is None and now_s - self.asked_s >= _ANSWER_TIMEOUT_S:
            answer = PlanAnswer(
                job_id=awaited.job.job_id,
                plan=None,
                reason=pilot_texts.PLANNER_SILENT(s=seconds(_ANSWER_TIMEOUT_S)),
                failed=True,
            )
        if awaited is None or answer is None:
            return None
        self._awaited = self._answer = None
        return awaited, answer

    def jobs(self) -> list[PlanJob]:
        """Returns the jobs since the last call."""
        jobs, self._jobs = self._jobs, []
        return jobs

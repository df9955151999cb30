"""Planning jobs: what the companion asks of the planner, and what comes back.

A job leaves the machine as a value and its answer enters it as another, so that the planner may
run in a thread, in lockstep, or from a recording.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from ..errors import InputError
from ..planner.escape import escape_leg
from ..planner.plan import Plan, PlanRequest, PlanStatus
from ..planner.planner import Planner
from ..planner.reach import Reach
from ..site import PlanePoint
from ..types import Mission
from .planners import Planners


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanJob:
    """A request with the number that its answer carries.

    widening_m: what obstacles are to be avoided by beyond their keep-outs.
    """

    job_id: int
    request: PlanRequest
    widening_m: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanAnswer:
    """The plan of a job, or why there is none.

    escape_end_m: where the plan begins, when the start had to be left by an escape leg first.
    reach: to obstacles as wide as the plan takes them; None: no wider than their keep-outs.
    too_wide: there would be a plan, if they were no wider. failed: the planner has said nothing.
    deadly: there was one, on which nobody should die.
    """

    job_id: int
    plan: Plan | None
    reason: str = ""
    escape_end_m: PlanePoint | None = None
    reach: Reach | None = None
    too_wide: bool = False
    failed: bool = False
    deadly: bool = False


def answer_job(planners: Planners, job: PlanJob) -> PlanAnswer:
    """Plan; from where nothing can be planned, plan from the end of the escape leg."""
    answer = _answer(planners.widened_by(job.widening_m), job)
    if answer.plan is not None or not job.widening_m:
        return answer
    exact = _answer(planners.exact, job)
    return replace(answer, too_wide=exact.plan is not None)


def _answer(planner: Planner, job: PlanJob) -> PlanAnswer:
    request = job.request
    try:
        cell = planner.maps.grid.cell_of(request.start_m)
        lowest_m = planner.site.workspace.min_altitude_m
        escape_end_m = None
        if (
            cell is None
            or planner.maps.occupied[cell]
            or (lowest_m is not None and request.start_m[1] < lowest_m)
        ):
            start_m = (request.start_m[0], request.start_m[1])
            escape_end_m = escape_leg(planner.site, planner.maps, start_m)
        if escape_end_m is None:
            plan = planner.solve(request)
        else:
            plan = planner.plan(
                mission=request.mission,
                target=request.target,
                start=escape_end_m,
                weights=request.weights,
                risk=request.risk,
            )
    except InputError as error:
        return PlanAnswer(job_id=job.job_id, plan=None, reason=str(error))
    if plan.status is not PlanStatus.FOUND:
        return PlanAnswer(job_id=job.job_id, plan=None, reason=plan.reason)
    return PlanAnswer(
        job_id=job.job_id,
        plan=plan,
        escape_end_m=escape_end_m,
        reach=planner.maps.reach if job.widening_m else None,
    )


def preparations(planner: Planner) -> list[Callable[[], None]]:
    """What makes ready whatever is precomputed for the site's goals: one call for each goal.

    The first target and the ways out are the first; no more than can be kept.
    """
    site = planner.site
    targets = [(Mission.INSPECTION, target.name) for target in site.targets]
    ways_out = [(mission, None) for mission in site.landing_m]
    goals = [*targets[:1], *ways_out, *targets[1:]]
    return [partial(_prepare, planner, *goal) for goal in goals[: planner.most_prepared]]


def prepare_for(planners: Planners, job: PlanJob) -> None:
    """Make ready whatever is precomputed for a job's goal, if it is not yet, or no more."""
    if not job.widening_m:
        _prepare(planners.exact, job.request.mission, job.request.target)


def _prepare(planner: Planner, mission: Mission, target: str | int | None) -> None:
    # What is wrong with a goal is said when it is ordered.
    with contextlib.suppress(InputError):
        planner.prepare(mission=mission, target=target)

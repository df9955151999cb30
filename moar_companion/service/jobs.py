"""Planning jobs: what the companion asks of the planner, and what comes back.

A job leaves the machine as a value and its answer enters it as another, so that the planner may
run in a thread, in lockstep, or from a recording.
"""

from __future__ import annotations

import contextlib
from dataclasses import dataclass

from ..errors import InputError
from ..planner.escape import escape_leg
from ..planner.plan import Plan, PlanRequest, PlanStatus
from ..planner.planner import Planner
from ..site import PlanePoint
from ..types import Mission


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanJob:
    """A request with the number that its answer carries."""

    job_id: int
    request: PlanRequest


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanAnswer:
    """The plan of a job, or why there is none.

    escape_end_m: where the plan begins, when the start had to be left by an escape leg first.
    """

    job_id: int
    plan: Plan | None
    reason: str = ""
    escape_end_m: PlanePoint | None = None


def answer_job(planner: Planner, job: PlanJob) -> PlanAnswer:
    """Plan; from where nothing can be planned, plan from the end of the escape leg."""
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
    return PlanAnswer(job_id=job.job_id, plan=plan, escape_end_m=escape_end_m)


def prepare_all(planner: Planner) -> None:
    """Whatever is precomputed for the site's goals, before anyone asks for them."""
    site = planner.site
    goals: list[tuple[Mission, str | None]] = [
        (Mission.INSPECTION, target.name) for target in site.targets
    ]
    goals += [(mission, None) for mission in site.landing_m]
    for mission, target in goals:
        # What is wrong with a goal is said when it is ordered.
        with contextlib.suppress(InputError):
            planner.prepare(mission=mission, target=target)

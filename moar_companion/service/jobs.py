"""Planning jobs: what the companion asks of the planner, and what comes back.

A job leaves the machine as a value and its answer enters it as another, so that the planner may
run in a thread, in lockstep, or from a recording.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

from ..autopilots.failsafe_actions import NO_FAILSAFES, Failsafes
from ..errors import InputError
from ..mavlink.texts import short_name
from ..planner.escape import escape_leg, recovery_leg
from ..planner.fence import PlaneFence
from ..planner.plan import Plan, PlanRequest, PlanStatus
from ..planner.planner import Planner
from ..planner.reach import Reach
from ..site import PlanePoint
from ..types import Mission
from ..vehicle import Vehicle
from .planners import Planners

_REASON_LENGTH = 36
"""Of a text's 50 characters, what is left between "MOAR: " and ", denied"."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanJob:
    """A request with the number that its answer carries.

    widening_m: what obstacles are to be avoided by beyond their keep-outs. fence: of the autopilot,
    as far as it cuts the site. failsafes: what the autopilot does by itself: places from where that
    would hit something cost more.
    """

    job_id: int
    request: PlanRequest
    widening_m: float = 0.0
    fence: PlaneFence | None = None
    failsafes: Failsafes = NO_FAILSAFES


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanAnswer:
    """The plan of a job, or why there is none.

    escape_end_m: where the plan begins, when the start had to be left by an escape leg first.
    reach: to obstacles as wide as the plan takes them; None: no wider than their keep-outs.
    too_wide: there would be a plan, if they were no wider. failed: the planner has said nothing.
    deadly: there was one, on which nobody should die. detail: the reason as a whole sentence, where
    that is too long for a pilot's text.
    """

    job_id: int
    plan: Plan | None
    reason: str = ""
    escape_end_m: PlanePoint | None = None
    reach: Reach | None = None
    too_wide: bool = False
    failed: bool = False
    deadly: bool = False
    detail: str = ""


def answer_job(planners: Planners, job: PlanJob) -> PlanAnswer:
    """Plan; from where nothing can be planned, plan from the end of the escape leg."""
    planners.expose(job.failsafes)
    answer = _answer(planners.widened_by(job.widening_m, job.fence), job)
    if answer.plan is None and job.fence is not None:
        free = _answer(planners.widened_by(job.widening_m), job)
        if free.plan is not None:
            return _fenced_off(answer, free.plan, job.fence)
    if answer.plan is None and job.widening_m:
        exact = _answer(planners.widened_by(0.0, job.fence), job)
        answer = replace(answer, too_wide=exact.plan is not None)
    inspects = job.request.mission is Mission.INSPECTION
    if answer.plan is not None or answer.too_wide or not inspects:
        return answer
    return _crowded(planners.exact, answer, job)


def _crowded(exact: Planner, answer: PlanAnswer, job: PlanJob) -> PlanAnswer:
    """The answer that the margin alone, or a part of it, takes the room that a target needs."""
    margin = exact.site.margin
    parts = {
        f"tracking error {margin.tracking_m:g} m": margin.tracking_m,
        f"position error {margin.position_m:g} m": margin.position_m,
        str(margin): margin.total_m,
    }
    for words, part_m in parts.items():
        if not part_m:
            continue
        freer = Planner(
            exact.site,
            exact.vehicle,
            position_uncertainty_m=-part_m,
            fence=job.fence,
            clock=exact.clock,
        )
        if _answer(freer, job).plan is not None:
            return replace(
                answer,
                reason=f"no way with margin {margin.total_m:.2f} m",
                detail=f"{answer.reason}: the margin of {margin.total_m:g} m beyond keep-outs "
                f"leaves no way; there is one without {words}",
            )
    return answer


def _fenced_off(answer: PlanAnswer, plan: Plan, fence: PlaneFence) -> PlanAnswer:
    """The answer that the fence alone is in the way of a plan."""
    goal_m = plan.waypoints.position_m[-1:]
    all_limits = ", ".join(bound.name for bound in fence.bounds)
    crossed = fence.crossed(goal_m) or fence.crossed(plan.waypoints.position_m) or all_limits
    request = plan.request
    goal = request.target if isinstance(request.target, str) else request.mission.value
    short = f"{goal} outside {crossed}"
    return replace(
        answer,
        reason=short if len(short) <= _REASON_LENGTH else f"outside {crossed}",
        detail=f"no way to {goal} inside the autopilot's fence, {crossed}, "
        f"less {fence.margin_m:g} m ({answer.reason})",
    )


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
            escape_end_m = recovery_leg(
                planner.site, planner.vehicle, planner.maps, start_m, job.widening_m
            ) or escape_leg(planner.site, planner.maps, start_m)
        far_m = planner.site.workspace.outside_m((request.start_m[0], request.start_m[1]))
        if escape_end_m is None and far_m > planner.vehicle.guidance.recovery_m:
            return PlanAnswer(job_id=job.job_id, plan=None, reason=too_far(far_m, planner.vehicle))
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
        reason = f"{error.problem} ({error})"
        if request.mission is not Mission.INSPECTION:
            reason = f"no landing point in sight ({error})"
        return PlanAnswer(job_id=job.job_id, plan=None, reason=reason)
    if plan.status is not PlanStatus.FOUND:
        begins = escape_end_m is None
        reason = f"{_words(planner, request, plan.status, begins=begins)} ({plan.reason})"
        return PlanAnswer(job_id=job.job_id, plan=None, reason=reason)
    return PlanAnswer(
        job_id=job.job_id,
        plan=plan,
        escape_end_m=escape_end_m,
        reach=planner.maps.reach if job.widening_m else None,
    )


def too_far(outside_m: float, vehicle: Vehicle) -> str:
    """Why nothing is flown so far outside the workspace."""
    return f"{outside_m:.0f} m outside > {vehicle.guidance.recovery_m:g}, fly it back"


def _words(planner: Planner, request: PlanRequest, status: PlanStatus, *, begins: bool) -> str:
    """Why there is no plan, for people: of the aircraft, a target by its name, or the way.

    begins: the plan was to begin where the aircraft is.
    """
    x_m, z_m = request.start_m[:2]
    grid = planner.maps.grid
    (left_m, bottom_m), (right_m, top_m) = grid.lower_m, grid.upper_m
    low_m = planner.site.workspace.min_altitude_m
    if begins and grid.cell_of((x_m, z_m)) is None:
        sideways_m, upwards_m = max(left_m - x_m, x_m - right_m), z_m - top_m
        downwards_m = bottom_m - z_m
        off_m = max(sideways_m, upwards_m, downwards_m)
        where = "above" if off_m == upwards_m else "below" if off_m == downwards_m else "beside"
        return f"aircraft {max(off_m, 0.1):.1f} m {where} the workspace"
    if status is PlanStatus.START_OCCUPIED:
        if low_m is not None and z_m < low_m:
            return f"aircraft at {max(z_m, 0.1):.1f} m < {low_m:g}"
        return f"aircraft too near {short_name(planner.maps.reach.nearest((x_m, z_m)))}"
    inspects = request.mission is Mission.INSPECTION
    goal = short_name(str(request.target)) if inspects else request.mission.value
    if status is PlanStatus.UNREACHABLE:
        return f"no free way to {goal}" if inspects else "no free way"
    if status is PlanStatus.OUT_OF_BOUNDS:
        return f"{goal} outside the workspace"
    return f"{goal} too near obstacles" if inspects else "no landing point is in sight"


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
    if not job.widening_m and job.fence is None:
        _prepare(planners.exact, job.request.mission, job.request.target)


def _prepare(planner: Planner, mission: Mission, target: str | int | None) -> None:
    # What is wrong with a goal is said when it is ordered.
    with contextlib.suppress(InputError):
        planner.prepare(mission=mission, target=target)

"""Planning jobs: requests of the companion to the planner, and the answers.

A job leaves the machine as a value, and its answer enters the machine as another. The planner can
therefore run in a thread, in lockstep, or from a recording.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ...errors import InputError
from ...mavlink.autopilots.failsafe_actions import NO_FAILSAFES, Failsafes
from ...planner.blocking_margin import blocking_part
from ...planner.escape import entry_corners, pocket
from ...planner.free_distance import FreeDistance
from ...planner.plan_values import Plan, PlanRequest, PlanStatus
from ...planner.plane_fence import PlaneFence
from ...planner.planner import Planner
from ...planner.regions import obstacle_room_m
from ...planner.site import PlanePoint, Site
from ...planner.tour import best_order
from ...settings.vehicle import Vehicle
from ...texts import pilot_texts
from ...texts.text_format import compass, distance, limit_text
from ...types import Mission
from .planner_set import PlannerSet

_NARROWED = (0.5, 1.0)
"""Fractions of the tracking error that a blocked escape route omits, in this order. A tracking
error is visible in flight, and the setpoint waits for the aircraft. A position error is not visible
in flight: its margin is kept."""
_AWAY_M = 0.5
"""Distance of the sample points that show the direction away from an obstacle."""
_FAR_M = 999.0
"""Greatest distance in a text."""
_MOST_POCKETS = 8
"""Maximum number of tried pockets: free cells from which the goal cannot be reached."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanJob:
    """A request with the number that its answer carries.

    origin_m: start of the calibration of weights; None for the request's own start. widening_m:
    obstacle inflation beyond keep-outs. fence: of the autopilot, as far as it cuts the site.
    failsafes: of the autopilot; cells from which a failsafe would hit an obstacle cost more.
    narrowed_m: part of the margin that an active escape route omits. stops: of an inspection, to be
    visited in the best order; () for the request's target.
    """

    job_id: int
    request: PlanRequest
    stops: tuple[str, ...] = ()
    origin_m: PlanePoint | None = None
    widening_m: float = 0.0
    fence: PlaneFence | None = None
    failsafes: Failsafes = NO_FAILSAFES
    narrowed_m: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanAnswer:
    """The plan of a job, or the reason why there is none.

    escape_m: corners of the escape or recovery leg from the start, the plan's first point last; ()
    where the plan begins at the start. reach: to obstacles with the plan's inflation; None: no
    inflation. too_wide: a plan exists without inflation. failed: the planner gave no usable answer.
    narrowed_m: part of the margin that the plan omits, since no plan keeps the whole margin.
    would_collide: rejected; an offboard loss or link failsafe on this path would hit an obstacle.
    detail: the reason as a whole sentence, where that is too long for a pilot's text. stops: of the
    job, in the best order.
    """

    job_id: int
    plan: Plan | None
    stops: tuple[str, ...] = ()
    reason: str = ""
    escape_m: tuple[PlanePoint, ...] = ()
    reach: FreeDistance | None = None
    narrowed_m: float = 0.0
    too_wide: bool = False
    failed: bool = False
    would_collide: bool = False
    detail: str = ""


def answer_job(planners: PlannerSet, job: PlanJob) -> PlanAnswer:
    """Plans; where the start permits no plan, plans from the end of the escape leg.

    Of several stops the first of the best order is planned. An escape route that the margin blocks
    is planned with a smaller margin; the position error is kept.
    """
    planners.expose(job.failsafes)
    if not job.stops:
        return _planned(planners, job)
    stops = _in_best_order(planners.widened_by(job.widening_m, job.fence), job)
    first = replace(job, request=replace(job.request, target=stops[0]))
    return replace(_planned(planners, first), stops=stops)


def _in_best_order(planner: Planner, job: PlanJob) -> tuple[str, ...]:
    """The stops of a job in the best order from its start, or from the end of the escape leg."""
    request = job.request
    start_m = (request.start_m[0], request.start_m[1])
    if not _may_start(planner, start_m):
        site, vehicle, maps = planner.site, planner.vehicle, planner.maps
        corners_m = entry_corners(site, vehicle, maps, start_m, np.zeros_like(maps.occupied))
        start_m = corners_m[-1] if corners_m else start_m
        request = replace(request, start_m=start_m, velocity_mps=(0.0, 0.0))
    return best_order(planner, request, job.stops)


def _planned(planners: PlannerSet, job: PlanJob) -> PlanAnswer:
    """The answer to a job, by its request."""
    job = _calibrated(planners.exact, job)
    cell = planners.exact.maps.grid.cell_of(job.request.start_m)
    if job.narrowed_m and cell is not None and planners.exact.maps.occupied[cell]:
        # Inside the margin an active route continues, and needs no leg out of the margin.
        going_on = _narrowed(planners, job, job.narrowed_m)
        if going_on is not None and not going_on.escape_m:
            return going_on
    answer = _answer(planners.widened_by(job.widening_m, job.fence), job)
    if answer.plan is not None:
        return answer
    inspects = job.request.mission.visits_targets
    tracking_m = planners.exact.site.margin.tracking_m
    for part in _NARROWED if tracking_m and not inspects else ():
        narrower = _narrowed(planners, job, part * tracking_m)
        if narrower is not None:
            return narrower
    # The search within the fence comes first: a fence that only forces a detour is not the cause.
    if job.widening_m and _answer(planners.widened_by(0.0, job.fence), job).plan is not None:
        return replace(answer, too_wide=True)
    blocked = _blocked_by_margin(planners.exact, answer, job) if inspects else None
    if blocked is None and job.fence is not None:
        free = _answer(planners.widened_by(job.widening_m), job)
        if free.plan is not None:
            return _fenced_off(answer, free.plan, job.fence)
    return blocked or answer


def _calibrated(exact: Planner, job: PlanJob) -> PlanJob:
    """The job with calibrated weights, if it needs them and the goal's table is complete.

    Without the table the first plan would be late; a later plan of the flight is calibrated.
    """
    request = job.request
    if not exact.is_prepared(mission=request.mission, target=request.target):
        return job
    origin_m = request.start_m if job.origin_m is None else job.origin_m
    with contextlib.suppress(InputError):  # the plan itself reports it
        request = exact.calibrated(request, origin_m)
    return replace(job, request=request)


def _narrowed(planners: PlannerSet, job: PlanJob, narrowed_m: float) -> PlanAnswer | None:
    """The answer with the margin reduced by `narrowed_m`; None where that finds no plan either."""
    answer = _answer(planners.widened_by(job.widening_m - narrowed_m, job.fence), job)
    return None if answer.plan is None else replace(answer, narrowed_m=narrowed_m)


def _blocked_by_margin(exact: Planner, answer: PlanAnswer, job: PlanJob) -> PlanAnswer | None:
    """Answer that the margin, or a part of it, blocks a target; None otherwise."""
    part = blocking_part(exact, lambda freer: _answer(freer, job).plan is not None, job.fence)
    if part is None:
        return None
    return replace(
        answer,
        reason=pilot_texts.MARGIN_BLOCKS(m=limit_text(exact.site.margin.total_m)),
        detail=f"{answer.reason}: {part}",
    )


def _fenced_off(answer: PlanAnswer, plan: Plan, fence: PlaneFence) -> PlanAnswer:
    """Answer that only the fence blocks a plan."""
    of_goal = fence.crossed(plan.waypoints.position_m[-1:])
    crossed = of_goal or fence.crossed(plan.waypoints.position_m) or fence.bounds[0].name
    request = plan.request
    goal = request.target if isinstance(request.target, str) else request.mission.value
    reason = pilot_texts.TARGET_FENCED(target=goal, fence=crossed)
    if of_goal is None or not request.mission.visits_targets or goal not in reason:
        reason = pilot_texts.FENCED(fence=crossed)
    return replace(
        answer,
        reason=reason,
        detail=f"no path to {goal} inside the autopilot's fence, {crossed}, "
        f"less {fence.margin_m:g} m ({answer.reason})",
    )


def _answer(planner: Planner, job: PlanJob) -> PlanAnswer:
    request = job.request
    try:
        start_m = (request.start_m[0], request.start_m[1])
        if planner.site.workspace.outside_m(start_m) > planner.vehicle.guidance.recovery_m:
            reason = too_far(planner.site, planner.vehicle, start_m)
            return PlanAnswer(job_id=job.job_id, plan=None, reason=reason)
        plan, escape_m = _plan_with_entry(planner, request, start_m)
    except InputError as error:
        reason = f"{error.problem} ({error})"
        if not request.mission.visits_targets:
            reason = pilot_texts.NO_LANDING_IN_SIGHT(detail=str(error))
        return PlanAnswer(job_id=job.job_id, plan=None, reason=reason)
    if plan.status is not PlanStatus.FOUND:
        words = _words(planner, request, plan.status, begins=not escape_m)
        reason = f"{words} ({plan.reason})"
        return PlanAnswer(job_id=job.job_id, plan=None, reason=reason)
    return PlanAnswer(
        job_id=job.job_id,
        plan=plan,
        escape_m=escape_m,
        reach=planner.maps.reach if planner.maps.position_uncertainty_m else None,
    )


def _plan_with_entry(
    planner: Planner, request: PlanRequest, start_m: PlanePoint
) -> tuple[Plan, tuple[PlanePoint, ...]]:
    """The plan, and the corners of the leg to its start; () where it begins at the request's start.

    The leg is the shortest one to a free cell from which there is a plan.
    """
    maps = planner.maps
    plan: Plan | None = None
    escape_m: tuple[PlanePoint, ...] = ()
    if not _may_start(planner, start_m):
        barred = np.zeros_like(maps.occupied)
        for _ in range(_MOST_POCKETS):
            corners_m = entry_corners(planner.site, planner.vehicle, maps, start_m, barred)
            if not corners_m:
                break
            escape_m = corners_m
            plan = planner.solve(replace(request, start_m=corners_m[-1], velocity_mps=(0.0, 0.0)))
            if plan.status is not PlanStatus.UNREACHABLE:
                break
            barred |= pocket(maps, corners_m[-1])
    return plan or planner.solve(request), escape_m


def _may_start(planner: Planner, start_m: PlanePoint) -> bool:
    """True if a plan may begin at a place: in a free cell, not below the minimum altitude."""
    maps, low_m = planner.maps, planner.site.workspace.floor_at_m(start_m[0])
    cell = maps.grid.cell_of(start_m)
    return cell is not None and not maps.occupied[cell] and (low_m is None or start_m[1] >= low_m)


def too_far(site: Site, vehicle: Vehicle, place_m: PlanePoint) -> str:
    """Reason why no flight begins at a place so far outside the workspace; side by compass."""
    workspace = site.workspace
    ahead, behind = _compass_points(site)
    _, side = _beyond(workspace.lower_m, workspace.upper_m, place_m, (behind, ahead, "", ""))
    far_m = f"{min(workspace.outside_m(place_m), _FAR_M):.0f}"
    most_m = limit_text(vehicle.guidance.recovery_m)
    if not side:
        return pilot_texts.FAR_OUTSIDE(far_m=far_m, most_m=most_m)
    return pilot_texts.FAR_BESIDE(far_m=far_m, most_m=most_m, side=side)


def _compass_points(site: Site) -> tuple[str, str]:
    """Compass points towards +x and -x."""
    azimuth_rad = math.radians(site.frame.azimuth_deg)
    return compass(azimuth_rad), compass(azimuth_rad + math.pi)


def _beyond(
    lower_m: tuple[float, ...],
    upper_m: tuple[float, ...],
    place_m: PlanePoint,
    words: tuple[str, ...],
) -> tuple[float, str]:
    """Greatest distance beyond an edge of a rectangle, and its word.

    words: for a place before it along x, behind it, above it, below it.
    """
    (left_m, bottom_m), (right_m, top_m), (x_m, z_m) = lower_m, upper_m, place_m
    beyond_m = (left_m - x_m, x_m - right_m, z_m - top_m, bottom_m - z_m)
    return max(zip(beyond_m, words, strict=True))


def _words(planner: Planner, request: PlanRequest, status: PlanStatus, *, begins: bool) -> str:
    """Reason why there is no plan, as a text: about aircraft, target by name, or path.

    begins: the plan was to begin at the aircraft.
    """
    if begins and status in {PlanStatus.OUT_OF_BOUNDS, PlanStatus.START_OCCUPIED}:
        place = _words_of_start(planner, (request.start_m[0], request.start_m[1]))
        if place is not None:
            return place
    inspects = request.mission.visits_targets
    if not inspects:
        unreachable = status is PlanStatus.UNREACHABLE
        return pilot_texts.NO_PATH() if unreachable else pilot_texts.NO_LANDING_IN_SIGHT()
    if status is PlanStatus.UNREACHABLE:
        return pilot_texts.NO_PATH_TO_TARGET(target=request.target)
    if status is PlanStatus.OUT_OF_BOUNDS:
        return pilot_texts.TARGET_OUTSIDE(target=request.target)
    return pilot_texts.TARGET_CLOSE(target=request.target)


def _words_of_start(planner: Planner, start_m: PlanePoint) -> str | None:
    """Reason why no plan can begin at a place, with a manual direction; None where a plan can.

    The direction is towards the workspace, or away from the nearest obstacle.
    """
    site, maps = planner.site, planner.maps
    low_m, height_m = site.workspace.floor_at_m(start_m[0]), start_m[1]
    ahead, behind = _compass_points(site)
    if low_m is not None and height_m < low_m:
        return pilot_texts.LOW(low_m=distance(height_m), least_m=limit_text(low_m))
    cell = maps.grid.cell_of(start_m)
    if cell is None:
        ways = (f"fly {ahead}", f"fly {behind}", "descend", "climb")
        off_m, way = _beyond(maps.grid.lower_m, maps.grid.upper_m, start_m, ways)
        return pilot_texts.OUTSIDE(far_m=distance(min(off_m, _FAR_M)), way=way)
    if not maps.occupied[cell]:
        return None
    around_m = np.array(start_m) + _AWAY_M * np.array([(0, 1), (1, 0), (-1, 0), (0, -1)])
    away = ("up", ahead, behind, "down")[int(obstacle_room_m(site, around_m).argmax())]
    return pilot_texts.CLOSE(obstacle=maps.reach.nearest(start_m), way=f"fly {away}")


def preparations(planner: Planner) -> list[Callable[[], None]]:
    """Calls that precompute the data of the site's goals, one call for each goal.

    The first target and the escape routes come first; the number is limited by the cache.
    """
    site = planner.site
    targets = [(Mission.INSPECTION, target.name) for target in site.targets]
    escape_routes = [(mission, None) for mission in site.landing_m]
    goals = [*targets[:1], *escape_routes, *targets[1:]]
    return [partial(_prepare, planner, *goal) for goal in goals[: planner.most_prepared]]


def prepare_for(planners: PlannerSet, job: PlanJob) -> None:
    """Precomputes the data of a job's goal, if it is not available."""
    if not job.widening_m and job.fence is None:
        _prepare(planners.exact, job.request.mission, job.request.target)


def _prepare(planner: Planner, mission: Mission, target: str | int | None) -> None:
    # A fault of a goal is reported when the goal is ordered.
    with contextlib.suppress(InputError):
        planner.prepare(mission=mission, target=target)

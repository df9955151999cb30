"""The route manager: the flight along its plans, and the requests for new plans.

Inputs: task, pose, risks, time. Outputs: plan jobs, and the flight along the adopted plans.
"""

from __future__ import annotations

import math
from dataclasses import replace

from ..planner.adaptation import Adaptation
from ..planner.plan_values import Plan
from ..planner.site import Margin
from ..risk import RiskEstimate
from ..settings.config import CompanionConfig, VisitOrder
from ..settings.vehicle import Vehicle
from ..texts import pilot_texts
from ..texts.text_format import reason_chars, short_name
from ..types import Mission, RiskIndices, Vector
from .estimation.pose import Pose
from .flight_limits import FlightLimits
from .flight_settings import at_once
from .guidance.path_follower import PathFollower
from .guidance.splice import Adoption
from .mission.values import Task
from .plan_inflation import PlanInflation
from .plan_requests import Awaited, PlanBasis, PlanRequests, replan_reason, stays
from .planning.plan_jobs import PlanAnswer, PlanJob
from .planning.site_maps import SiteMaps
from .reports import PlanReports, Reports

_NO_PATH_ROUND = "no path round "
_STANDS_FOR_S = 1.0
"""Time between two attempts to resume when the flight was stopped and no condition holds it."""
_ENDS_AFTER_S = 5.0
"""After this time at the plan's end, which covers a gust or two, a larger error is accepted."""
_OFF_PATH_FOR_S = 1.0
"""After this time off its path the aircraft does not return by itself."""


class RouteManager:
    """An aircraft's route on a site. Before `limits` have a site no plan is possible."""

    def __init__(
        self,
        vehicle: Vehicle,
        config: CompanionConfig,
        reports: Reports,
        margin: Margin,
    ) -> None:
        self.flight: PathFollower | None = None
        """Active or offered flight; None while there is none."""
        self.limits = FlightLimits(vehicle, config, reports)
        """Limits of the flight: maps, and the autopilot's fence, offboard loss, failsafes."""
        self._vehicle = vehicle
        self._config = config
        self._reports = reports
        self._plans = PlanRequests()
        self._near_path_s = -math.inf
        self._under_way_s = -math.inf
        """Last time at which the setpoint was short of the plan's end."""
        self._resumed_s = -math.inf
        """Time of the last resumption along a landing leg."""
        self._plan_reports = PlanReports(vehicle, reports)
        self._no_detour = False
        """True after a search without a plan around the barred path."""
        self.inflation = PlanInflation(vehicle, config.supervision, margin)
        """Obstacle inflation of plans."""
        self._left: PathFollower | None = None
        """The last flight, if it ended on a landing leg."""
        self._planner_busy_s: float | None = None
        """Time since which the planner makes, or has, maps for settings that are not in force; a
        plan would be made on these, so requests wait. None while it does not."""

    def take_settings(self, vehicle: Vehicle, config: CompanionConfig, margin: Margin) -> None:
        """Takes the settings in force: the next plan is made with them."""
        self._vehicle, self._config = vehicle, config
        if self.flight is not None:
            self.flight.take_vehicle(at_once(vehicle, self.flight.path.volume.vehicle))
        self._plan_reports.vehicle = vehicle
        self.limits.take_settings(vehicle, config)
        self.inflation.take_settings(vehicle, config.supervision, margin)

    def note_planner(self, now_s: float, *, busy: bool) -> None:
        """Notes if the planner makes, or has, maps for settings that are not in force."""
        if not busy:
            self._planner_busy_s = None
        elif self._planner_busy_s is None:
            self._planner_busy_s = now_s

    @property
    def braked(self) -> bool:
        """True while the flight comes to rest, or stands, before its plan's end."""
        return self.flight is not None and self.flight.braked

    def adaptation_of(self, mission: Mission) -> Adaptation:
        """The adaptation of a mission's weights: of the flight, if that is of this mission."""
        flight = self.flight
        flown = None if flight is None or flight.mission is not mission else flight.adaptation
        return flown or Adaptation.of(self._vehicle, mission)

    def learn_maps(self, site_maps: SiteMaps, now_s: float, *, for_settings: bool = False) -> None:
        """Takes maps of the site with other obstacles, or for other settings."""
        self.limits.learn_maps(site_maps, self.flight, now_s, for_settings=for_settings)
        self._no_detour = False

    @property
    def barred(self) -> str | None:
        """Reason to hold: the maps bar the path ahead, and no plan avoids it; None without it."""
        obstacle = None
        if self._no_detour and self.flight is not None:
            obstacle = self.flight.barred_by
        if obstacle is None:
            return None
        return _NO_PATH_ROUND + short_name(obstacle, reason_chars("holding") - len(_NO_PATH_ROUND))

    def note_no_detour(self) -> bool:
        """Notes a search that found no plan; brakes and returns True if the maps bar the path."""
        if self.flight is None or self.flight.barred_by is None:
            return False
        self._no_detour = True
        self.flight.brake()
        return True

    def update_inflation(
        self, risk: RiskEstimate, tracking_error_m: float | None, now_s: float
    ) -> bool:
        """Updates the obstacle inflation, as `PlanInflation.update`; returns True if it is less."""
        less_wide = self.inflation.update(risk, tracking_error_m, now_s)
        if less_wide:
            self.limits.offboard_loss.reconsider(self.flight)
        return less_wide

    def plan_jobs(self) -> list[PlanJob]:
        """Planning jobs since the last call. Only the newest one's answer is awaited."""
        return [] if self._planner_busy_s is not None else self._plans.jobs()

    def plan_answered(self, answer: PlanAnswer) -> None:
        """Keeps the answer to the awaited job for `taken`; drops any other."""
        self._plans.answered(answer)

    def taken(self, now_s: float) -> tuple[Awaited, PlanAnswer] | None:
        """The awaited plan with its answer, or with a failure if none came in time; None so far.

        A plan that the present maps bar was made before these: it is requested again.
        """
        taken = self._plans.taken(now_s)
        if taken is None:
            return None
        awaited, answer = taken
        if self._is_barred(awaited, answer):
            self._plans.ask_again(awaited, self.limits.site_maps, now_s)
            return None
        if self._plans.basis.site_maps is not self.limits.site_maps:
            answer = replace(answer, reach=None)  # which lacks obstacles of the present maps
        return awaited, answer

    def _is_barred(self, awaited: Awaited, answer: PlanAnswer) -> bool:
        """True if the maps have changed since a plan was requested, and bar a cell or leg of it."""
        flight, volume, plan = self.flight, self.limits.volume, answer.plan
        if plan is None or flight is None or volume is None:
            return False
        if self._plans.basis.site_maps is self.limits.site_maps:
            return False
        path = replace(flight.path, volume=replace(volume, narrowed_m=answer.narrowed_m))
        return path.bars(plan, awaited.junction, answer.escape_m)

    def ask(
        self,
        task: Task,
        pose: Pose | None,
        risk: RiskIndices,
        now_s: float,
        *,
        first: bool,
        recover: bool = False,
        reason: str = "an order",
    ) -> str | None:
        """Requests a task's plan from the junction; returns the reason where that is impossible.

        recover: from the aircraft's position, off its path. reason: for the record.
        """
        volume = self.limits.volume
        if pose is None:
            return "local origin unknown"
        if volume is None:
            return self.limits.not_ready_reason or pilot_texts.NO_SITE()
        if self.flight is None:
            self.flight = PathFollower(volume, pose)
        junction = self.flight.path.junction_at(pose) if recover else self.flight.path.junction()
        if first:
            self.inflation.forget_no_room()
        elif junction.at_end and not self.flight.braked:
            return "at the plan's end"
        narrowed_m = self.flight.path.volume.narrowed_m
        basis = PlanBasis(
            risk=risk,
            widening_m=self.inflation.of(task.mission),
            narrowed_m=0.0 if task.mission.visits_targets else narrowed_m,
            fence=self.limits.fence,
            failsafes=self.limits.watch.failsafes,
            site_maps=self.limits.site_maps,
            vehicle=self._vehicle,
        )
        self._plans.ask(
            task,
            junction,
            Adaptation.of(self._vehicle, task.mission),
            basis,
            first=first,
            reason=reason,
            now_s=now_s,
            in_best_order=first and self._config.inspection.order is VisitOrder.BEST,
        )
        if not first:
            self._reports.record("replan", now_s, reason=reason)
        return None

    def checked_for_offboard_loss(
        self, awaited: Awaited, answer: PlanAnswer, now_s: float, *, ordered: bool
    ) -> PlanAnswer:
        """The answer; without its plan if offboard loss or a failsafe on it would hit an obstacle.

        ordered: by an operator.
        """
        return self.limits.offboard_loss.checked(
            awaited, answer, self.flight, self.limits.watch.failsafes, now_s, ordered=ordered
        )

    def adopt(
        self, awaited: Awaited, answer: PlanAnswer, estimate: RiskEstimate, now_s: float
    ) -> Adoption:
        """Adopts the plan if it beats the active one and can still be joined; records why."""
        flight, plan = self.flight, answer.plan
        if flight is None or plan is None:
            return Adoption.TOO_LATE
        flown = None
        barred = self.limits.maps_changed and flight.barred_by is not None
        if not (awaited.first or barred) and answer.narrowed_m <= flight.path.volume.narrowed_m:
            flown = flight.rest_of_plan(plan, awaited.junction, answer.reach)
        if flown is not None and self._stays(flown, plan):
            return Adoption.KEPT_PATH
        adoption = flight.adopt(
            plan, awaited.junction, answer.escape_m, answer.reach, answer.narrowed_m
        )
        if adoption is not Adoption.TOO_LATE:
            self.limits.offboard_loss.objection = None
            self._no_detour = False
        if adoption is Adoption.NEW_PATH:
            self._plan_reports.explain(awaited, plan, flown, estimate, now_s)
        if (
            answer.narrowed_m
            and adoption is Adoption.NEW_PATH
            and self.limits.site_maps is not None
        ):
            self._plan_reports.report_narrow(plan, self.limits.site_maps.site, now_s)
        if awaited.first and adoption is not Adoption.TOO_LATE:
            self._near_path_s = self._under_way_s = now_s
        return adoption

    def _stays(self, flown: Plan, plan: Plan) -> bool:
        if flown.cost is None or plan.cost is None:
            return False
        return stays(self._config.replanning, flown_cost=flown.cost.total, new_cost=plan.cost.total)

    def replan(self, task: Task, pose: Pose, risk: RiskIndices, now_s: float) -> None:
        """Requests a new plan when there is a reason, while a path is flown.

        Along a landing leg there is none; a flight braked on one resumes, if permitted.
        """
        flight, awaited = self.flight, self._plans.awaited
        if flight is not None and not flight.arrived:
            self._under_way_s = now_s
        if flight is None or (awaited is not None and awaited.first):
            return
        if self.limits.maps_changed:
            flight.avoid(seen=self.limits.obstacles_seen)
        if now_s - self._resumed_s >= _STANDS_FOR_S and self.resume_leg():
            self._resumed_s = now_s
        if awaited is not None or self._planner_busy_s is not None:
            return
        error_m = flight.error_m(pose)
        if flight.on_leg or error_m <= self._vehicle.guidance.off_path_m:
            self._near_path_s = now_s
        elif now_s - self._near_path_s >= _OFF_PATH_FOR_S:
            self._near_path_s = now_s
            off = f"{error_m:.1f} m off the path"
            self.ask(task, pose, risk, now_s, first=False, recover=True, reason=off)
            return
        age_s = now_s - self._plans.asked_s
        reason: str | None
        known = self._plans.basis.site_maps is self.limits.site_maps
        planned = self._plans.basis.vehicle
        seldom = age_s >= self._config.replanning.min_interval_s
        if (seldom or not known) and self.limits.maps_changed and flight.barred_by is not None:
            reason = "an obstacle bars the path"
        elif seldom and planned is not None and planned is not self._vehicle:
            reason = "settings were changed"
        elif seldom and not known:
            reason = "the maps are others"
        elif flight.braked:
            # The task continues: an escape route has precedence over the cause of the brake.
            reason = "no progress" if age_s >= _STANDS_FOR_S else None
        elif self._plans.basis.fence != self.limits.fence:
            reason = "the autopilot's fence is another"
        elif self._plans.basis.failsafes != self.limits.watch.failsafes:
            reason = "the autopilot's failsafes are others"
        else:
            reason = replan_reason(
                self._config.replanning,
                self._plans.basis,
                risk,
                self.inflation.of(task.mission),
                age_s,
            )
        if reason is not None and (flight.braked or not flight.on_leg):
            self.ask(task, pose, risk, now_s, first=False, reason=reason)

    def arrived(self, pose: Pose | None, now_s: float) -> bool:
        """True if the aircraft is at its plan's end; after a wait a larger error is accepted.

        A constant error, by a steady wind, must not prevent the arrival.
        """
        flight, guidance = self.flight, self._vehicle.guidance
        if flight is None or pose is None or not flight.arrived:
            return False
        waited = now_s - self._under_way_s >= _ENDS_AFTER_S
        return flight.error_m(pose) <= (
            guidance.tracking_hold_m if waited else guidance.tracking_slow_m
        )

    def brake(self) -> None:
        """Brakes to rest on the path; drops an awaited plan."""
        self._plans.forget()
        if self.flight is not None:
            self.flight.brake()

    def stop_at(self, position_m: Vector) -> None:
        """Stops at a place at once; drops an awaited plan."""
        self._plans.forget()
        if self.flight is not None:
            self.flight.stop_at(position_m)

    def awaited_for_s(self, now_s: float) -> float | None:
        """Wait for a new plan of an active inspection, in seconds; None while no plan is awaited.

        While the planner is busy with other settings, one may be due at any time.

        An escape route continues without a new plan: its path was checked, and a stop is no safer.
        """
        awaited, flight = self._plans.awaited, self.flight
        mission = None if flight is None else flight.mission
        if mission is None or not mission.visits_targets or (awaited is not None and awaited.first):
            return None
        since_s = (self._plans.wanting_since_s, self._planner_busy_s)
        return max((now_s - each_s for each_s in since_s if each_s is not None), default=None)

    def resume_leg(self) -> bool:
        """Resumes along the landing leg on which the flight was braked, if it has room.

        Returns False if it was not braked there, or the leg has no room.
        """
        if self.flight is None or not self.flight.resume_leg(self.inflation.needed_m):
            return False
        self._plans.forget()
        self.inflation.forget_no_room()
        return True

    def resume(self, task: Task, pose: Pose | None) -> bool:
        """Resumes a task along the landing leg on which it stopped, or a pilot took over.

        At the leg's end no more flight is needed. If no other plan can be joined before the near
        leg, the active flight serves the task. Returns False where a plan is needed.
        """
        flight, volume = self.flight, self.limits.volume
        left = self._left if flight is None else flight
        if left is None or not left.leads_to(task.mission, task.goal):
            return False
        if flight is not None:
            moves = not (flight.braked or flight.recovers)
            goes_on = moves and (flight.on_leg or flight.path.junction().at_end)
            if self.resume_leg() or goes_on or (flight.on_leg and flight.arrived):
                return True
        if pose is None or volume is None:
            return False
        if flight is not None:
            # The gate compares with the last setpoint, which a wind may hold the aircraft beside.
            last = flight.progress(pose).setpoint
            pose = replace(pose, position_m=last.position_m, yaw_rad=last.yaw_rad)
        resumed = left.resumed_near_leg(volume, pose, self.inflation.needed_m)
        if resumed is not None:
            self._plans.forget()
            self.flight = resumed
        return resumed is not None

    def forget_first(self) -> None:
        """Drops an awaited first plan, so that it is not flown when it comes."""
        if self._plans.awaited is not None and self._plans.awaited.first:
            self._plans.forget()

    def end(self) -> None:
        """Ends the flight."""
        self._no_detour = False
        if self.flight is not None and self.flight.mission is not None:
            self._left = self.flight if self.flight.on_leg else None
        self.flight = None
        self.inflation.forget_no_room()
        self.limits.offboard_loss.objection = None
        self.limits.watch.end()
        self._plans.forget()

"""The course: the flight along its plans, and the plans that are asked for on its way.

Inputs: what is to be flown, where the aircraft is, the risks, the time. Outputs: plan jobs, and the
flight that moves along the plans that were adopted.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..config import CompanionConfig
from ..mavlink.session import Severity
from ..mavlink.texts import short_name
from ..mission.replanning import replan_reason, stays
from ..mission.values import Task
from ..planner.comparison import path_difference
from ..planner.fence import PlaneFence
from ..planner.plan import Plan
from ..planner.regions import narrowest
from ..power import PowerModel
from ..risk import RiskEstimate
from ..risk.explain import WeightsReason, risk_dict
from ..site import Margin
from ..types import AutopilotKind, FenceItem, Mission, RiskIndices, Telemetry, Vector
from ..vehicle import Vehicle
from .airspace import Airspace
from .causes import uncertainty_m, widening_m
from .failsafe_watch import FailsafeWatch
from .fences import FenceWatch, fenced
from .flight import Flight
from .jobs import PlanAnswer, PlanJob
from .junction import Adoption
from .motion import Pose
from .planning import Awaited, PlanDesk
from .reports import Reports
from .surroundings import Ground
from .survival import Survival
from .widening import Widening

_TOLD_EVERY_S = 10.0
"""People are told of a path that a risk has moved no more often; the record has all."""
_RISK_MOVED = 0.05
"""A risk that has changed less since the last path is not told as what has moved it."""
_STANDS_FOR_S = 1.0
"""Between two attempts to go on with an aircraft that was stopped and that nothing holds."""
_ENDS_AFTER_S = 5.0
"""An aircraft that has not come nearer to the end in so long, by a gust or two, will not."""
_OFF_PATH_FOR_S = 1.0
"""An aircraft that is off its path for so long will not be back by itself."""


class Course:
    """An aircraft's way on a site. ground: None without a site, where nothing can be planned."""

    def __init__(
        self,
        ground: Ground | None,
        vehicle: Vehicle,
        config: CompanionConfig,
        reports: Reports,
        margin: Margin,
    ) -> None:
        self.flight: Flight | None = None
        """What is flown or offered; None while nothing is."""
        self._ground = ground
        self._vehicle = vehicle
        self._config = config
        self._margin = margin
        self._reports = reports
        self._plans = PlanDesk()
        self._near_path_s = -math.inf
        self._under_way_s = -math.inf
        """When the setpoint was last short of the plan's end."""
        self._resumed_s = -math.inf
        """When it last went on along a landing leg on which it stood."""
        self._told_s = -math.inf
        self._flown_risk = RiskIndices()
        """Under which the path that is flown was planned."""
        site = None if ground is None else ground.site
        self._fences = FenceWatch(site, config.supervision.fence_margin_m)
        self.fence: PlaneFence | None = None
        """What of the autopilot's fence cuts the site: nothing is planned outside."""
        self.watch = FailsafeWatch(config.supervision, PowerModel.of(vehicle))
        """What the autopilot does by itself."""
        self._survival = Survival(ground, vehicle, config.supervision, reports)
        self._uncertainty_m: float | None = None
        self._needed_m = 0.0
        """What obstacles are to be avoided by now, beyond their keep-outs."""
        self._widening = Widening()
        self._lasting = Widening()
        """The same without the tracking error, which a gust makes and takes back."""
        self._left: Flight | None = None
        """What was flown last, where it ended on a landing leg."""
        self._in_vain: tuple[float, str] | None = None
        """How wide obstacles were when no plan led on, and why none did."""

    @property
    def awaited(self) -> Awaited | None:
        """The plan whose answer is still to come."""
        return self._plans.awaited

    @property
    def braked(self) -> bool:
        """Whether the flight comes to rest, or stands, where no plan has led it."""
        return self.flight is not None and self.flight.braked

    @property
    def reluctance(self) -> str | None:
        """Why nothing may be begun yet; None when what becomes of it without us is known."""
        if not self._survival.loss or not self.watch.known:
            return "autopilot parameters not read yet"
        return None if self._ground is None else self._fences.reluctance

    @property
    def airspace(self) -> Airspace | None:
        """Where the vehicle may fly; None while nothing may be begun."""
        ground, loss = self._ground, self._survival.loss
        if ground is None or loss is None or self._fences.reluctance is not None:
            return None
        return Airspace(
            site=ground.site,
            vehicle=self._vehicle,
            maps=ground.maps,
            loss=loss,
            fence=self._fences.plane,
        )

    def learn_fence(
        self,
        kind: AutopilotKind,
        parameters: Mapping[str, float | None],
        items: tuple[FenceItem, ...] | None,
        home_m: Vector | None,
        now_s: float,
        *,
        enabled: bool,
    ) -> None:
        """Take in the autopilot's fence; say once which of its parameters were never told.

        items: as uploaded; None while that is not known. enabled: whether SYS_STATUS tells of one.
        """
        before, assumption = self._fences.plane, self._fences.assumption
        self._fences.learn(kind, parameters, items, home_m, enabled=enabled)
        plane = self._fences.plane
        if self._fences.assumption and self._fences.assumption != assumption:
            self._reports.say(Severity.WARNING, self._fences.assumption, now_s)
        if self._ground is None or plane == before:
            return
        height_m = self._vehicle.guidance.landing_height_m
        self.fence = fenced(plane, self._ground.site, height_m)
        if self.flight is not None:
            self.flight.learn_fence(plane)

    def fence_objection(self, pose: Pose | None) -> str | None:
        """Why what is flown should not be, by the autopilot's fence as it is now.

        The aircraft itself may be within the margin, where the wind pushes it.
        """
        plane = self._fences.plane
        if plane is None or self.flight is None:
            return None
        if pose is not None:
            place_m = np.array([pose.position_m])[:, ::2]
            crossed = plane.crossed(place_m, plane.margin_m)
            if crossed is not None:
                return f"outside fence {crossed}"
        crossed = self.flight.leaves_fence()
        return None if crossed is None else f"path leaves {crossed}"

    @property
    def widening_m(self) -> float:
        """What obstacles are avoided by beyond their keep-outs in what may be flown.

        Above the limit of the uncertainty nothing is begun: ways out are measured as at the limit.
        """
        limits = self._config.supervision
        most_m = limits.position_uncertainty_limit_m - self._margin.position_m
        return min(self._widening.width_m, max(0.0, most_m))

    def _width_m(self, mission: Mission) -> float:
        """By how much wider obstacles are in a mission's plans: in a way out by what lasts."""
        widening = self._widening if mission is Mission.INSPECTION else self._lasting
        return widening.width_m

    def learn_loss(
        self,
        kind: AutopilotKind,
        parameters: Mapping[str, float | None],
        home_m: Vector | None,
        now_s: float,
    ) -> None:
        """Take in the autopilot's parameters and its home, (x, y, z) in the site's frame."""
        self._survival.learn(kind, parameters, home_m, self.flight, now_s)

    def learn_failsafes(
        self,
        kind: AutopilotKind,
        parameters: Mapping[str, float | None],
        home_m: Vector | None,
        telemetry: Telemetry,
        now_s: float,
    ) -> None:
        """Take in what the autopilot does by itself; later plans avoid where that hits."""
        before = self.watch.untold
        if not self.watch.learn(kind, parameters, home_m, telemetry):
            return
        self._survival.reconsider(self.flight)
        if self.watch.untold != before:
            self._reports.record("failsafes", now_s, taken_as_by_default=list(self.watch.untold))

    @property
    def objection(self) -> str | None:
        """Why what is flown or held should not be, by what the autopilot does without us."""
        return self._survival.objection

    @property
    def no_room(self) -> str | None:
        """Why nothing leads on; None once obstacles are less wide than when that was found.

        Nor above the limit of the uncertainty: then that is why nothing is flown.
        """
        if self._in_vain is None or self._uncertainty_m is None:
            return None
        width_m, reason = self._in_vain
        limit_m = self._config.supervision.position_uncertainty_limit_m
        over = self._widening.width_m < width_m or self._uncertainty_m > limit_m
        return None if over else reason

    def look(self, risk: RiskEstimate, tracking_error_m: float | None, now_s: float) -> bool:
        """Take in how well position and setpoint are kept; whether obstacles are less wide now.

        tracking_error_m: None where others fly, and on a way out, which a gust must not hold up.
        Beyond `tracking_hold_m` the setpoint waits.
        """
        before, most_m = self._widening, self._vehicle.guidance.tracking_hold_m
        self._uncertainty_m = uncertainty_m(risk)
        self._needed_m = widening_m(risk, self._margin)
        strays_m = min(tracking_error_m or 0.0, most_m) - self._margin.tracking_m
        self._widening = before.followed(self._needed_m + max(0.0, strays_m), now_s)
        self._lasting = self._lasting.followed(self._needed_m, now_s)
        less_wide = self._widening.width_m < before.width_m
        if less_wide:
            self._survival.reconsider(self.flight)
        return less_wide

    def plan_jobs(self) -> list[PlanJob]:
        """Planning jobs since the last call. Only the newest one's answer is awaited."""
        return self._plans.jobs()

    def taken(self, answer: PlanAnswer) -> Awaited | None:
        """What an answer belongs to; None when it is no longer awaited."""
        return self._plans.taken(answer)

    def overdue(self, now_s: float) -> PlanAnswer | None:
        """The answer in place of one that has not come in time."""
        return self._plans.overdue(now_s)

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
    ) -> bool:
        """Ask for a task's plan, from where it can be joined; whether it was asked.

        recover: from where the aircraft is, off its path. reason: why, for the record.
        """
        airspace = self.airspace
        if pose is None or airspace is None:
            return False
        if self.flight is None:
            self.flight = Flight(airspace, pose)
        junction = self.flight.junction_at(pose) if recover else self.flight.junction()
        if first:
            self._in_vain = None
        elif junction.at_end and not self.flight.braked:
            return False
        weights = self._vehicle.weights[task.mission].adjusted(risk)
        width_m = self._width_m(task.mission)
        self._plans.ask(
            task,
            junction,
            weights,
            risk,
            width_m,
            self.fence,
            self.watch.failsafes,
            0.0 if task.mission is Mission.INSPECTION else self.flight.narrowed_m,
            first=first,
            reason=reason,
            now_s=now_s,
        )
        if not first:
            self._reports.record("replan", now_s, reason=reason)
        return True

    def survivable(
        self, awaited: Awaited, answer: PlanAnswer, now_s: float, *, ordered: bool
    ) -> PlanAnswer:
        """The answer; without its plan, where nobody should die on it. ordered: by an operator."""
        return self._survival.checked(
            awaited, answer, self.flight, self.watch.failsafes, now_s, ordered=ordered
        )

    def adopt(
        self, awaited: Awaited, answer: PlanAnswer, estimate: RiskEstimate, now_s: float
    ) -> Adoption:
        """Fly the plan if it is better than what is flown, and can still be joined; say why."""
        flight, plan = self.flight, answer.plan
        if flight is None or plan is None:
            return Adoption.TOO_LATE
        flown = None
        if not awaited.first:
            flown = flight.rest_of_plan(plan, awaited.junction, answer.reach)
        if flown is not None and self._stays(flown, plan):
            return Adoption.KEPT_PATH
        adoption = flight.adopt(
            plan, awaited.junction, answer.escape_m, answer.reach, answer.narrowed_m
        )
        if adoption is not Adoption.TOO_LATE:
            self._survival.objection = None
        if adoption is Adoption.NEW_PATH:
            self._explain(awaited, plan, flown, estimate, now_s)
        if answer.narrowed_m and adoption is Adoption.NEW_PATH:
            self._tell_narrow(plan, now_s)
        if awaited.first and adoption is not Adoption.TOO_LATE:
            self._near_path_s = self._under_way_s = now_s
        return adoption

    def _tell_narrow(self, plan: Plan, now_s: float) -> None:
        """Say how near a way out passes that keeps less than the margin."""
        if self._ground is None:
            return
        nearest = narrowest(self._ground.site, self._vehicle, plan.waypoints.position_m)
        if nearest is not None:
            name, clearance_m, needed_m = nearest
            reason = f"{clearance_m:.1f} m to {short_name(name)} < {needed_m:.1f}"
            action = "exiting" if plan.mission is Mission.EXIT else "evacuating"
            self._reports.say(Severity.WARNING, reason, now_s, action=action)

    def _stays(self, flown: Plan, plan: Plan) -> bool:
        if flown.cost is None or plan.cost is None:
            return False
        return stays(self._config.replanning, flown_cost=flown.cost.total, new_cost=plan.cost.total)

    def _explain(
        self,
        awaited: Awaited,
        plan: Plan,
        flown: Plan | None,
        estimate: RiskEstimate,
        now_s: float,
    ) -> None:
        """Put on record why a path is flown; tell people where a risk has moved it."""
        base = self._vehicle.weights[plan.mission]
        difference = None if flown is None else path_difference(flown, plan)
        self._reports.record(
            "plan",
            now_s,
            first=awaited.first,
            plan=plan.to_dict(),
            explanation={
                "reason": awaited.reason,
                "risk": risk_dict(estimate),
                "weights": WeightsReason.of(base, plan.request.risk).to_dict(),
                "path": None if difference is None else difference.to_dict(),
            },
        )
        before, self._flown_risk = self._flown_risk.as_dict(), plan.request.risk
        after = plan.request.risk.as_dict()
        name = max(after, key=lambda name: abs(after[name] - before[name]))
        if (
            difference is not None
            and abs(after[name] - before[name]) >= _RISK_MOVED
            and now_s - self._told_s >= _TOLD_EVERY_S
        ):
            self._told_s = now_s
            change = f"{name} risk {after[name]:.2f} (was {before[name]:.2f})"
            self._reports.say(Severity.INFO, f"{change}, {difference.gist()}", now_s)

    def replan(self, task: Task, pose: Pose, risk: RiskIndices, now_s: float) -> None:
        """Ask for a new plan when there is a reason, while a path is flown.

        Along a landing leg there is none; one on which it was braked is gone on along, if it may.
        """
        flight, awaited = self.flight, self._plans.awaited
        if flight is not None and not flight.arrived:
            self._under_way_s = now_s
        if flight is None or (awaited is not None and awaited.first):
            return
        if now_s - self._resumed_s >= _STANDS_FOR_S and self.resume_leg():
            self._resumed_s = now_s
        if awaited is not None:
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
        if flight.braked:
            # It is to be flown all the same: a way out goes before what has braked it.
            reason = "no progress" if age_s >= _STANDS_FOR_S else None
        elif self._plans.asked_fence != self.fence:
            reason = "the autopilot's fence is another"
        elif self._plans.asked_failsafes != self.watch.failsafes:
            reason = "the autopilot's failsafes are others"
        else:
            reason = replan_reason(
                self._config.replanning,
                planned_risk=self._plans.asked_risk,
                risk=risk,
                planned_widening_m=self._plans.asked_widening_m,
                widening_m=self._width_m(task.mission),
                age_s=age_s,
            )
        if reason is not None and (flight.braked or not flight.on_leg):
            self.ask(task, pose, risk, now_s, first=False, reason=reason)

    def arrived(self, pose: Pose | None, now_s: float) -> bool:
        """Whether the aircraft has come to the end of its plan, or in time as near as it is held.

        An error that stays, by a steady wind, must not keep it there for ever.
        """
        flight, guidance = self.flight, self._vehicle.guidance
        if flight is None or pose is None or not flight.arrived:
            return False
        waited = now_s - self._under_way_s >= _ENDS_AFTER_S
        return flight.error_m(pose) <= (
            guidance.tracking_hold_m if waited else guidance.tracking_slow_m
        )

    def brake(self) -> None:
        """Come to rest on the path; whatever was awaited is awaited no more."""
        self._plans.forget()
        if self.flight is not None:
            self.flight.brake()

    def stand(self, position_m: Vector) -> None:
        """Stay at a place at once; whatever was awaited is awaited no more."""
        self._plans.forget()
        if self.flight is not None:
            self.flight.stand(position_m)

    def awaited_for_s(self, now_s: float) -> float | None:
        """How long a new plan of an inspection in flight is awaited; None while none is.

        A way out goes on without one: its path was checked, and to stay is no better.
        """
        since_s, flight = self._plans.wanting_since_s, self.flight
        inspects = flight is not None and flight.mission is Mission.INSPECTION
        return now_s - since_s if inspects and since_s is not None else None

    def resume_leg(self) -> bool:
        """Go on along the landing leg on which the flight was braked, while it has room.

        False when it was not, or has none.
        """
        if self.flight is None or not self.flight.resume_leg(self._needed_m):
            return False
        self._plans.forget()
        self._in_vain = None
        return True

    def resume(self, task: Task, pose: Pose | None) -> bool:
        """Go on with a task along the landing leg on which it stopped, or was taken over from.

        Where it stands at the leg's end, nothing is left of it; where it is so near the leg that no
        other plan could be joined before, what is flown serves the task.
        """
        flight, airspace = self.flight, self.airspace
        left = self._left if flight is None else flight
        if left is None or not left.serves(task.mission, task.goal):
            return False
        if flight is not None:
            moves = not (flight.braked or flight.returns)
            goes_on = moves and (flight.on_leg or flight.junction().at_end)
            if self.resume_leg() or goes_on or (flight.on_leg and flight.arrived):
                return True
        if pose is None or airspace is None:
            return False
        if flight is not None:
            # The gate compares with the last setpoint, which a wind may hold the aircraft beside.
            last = flight.progress(pose).setpoint
            pose = replace(pose, position_m=last.position_m, yaw_rad=last.yaw_rad)
        taken_up = left.taken_up(airspace, pose, self._needed_m)
        if taken_up is not None:
            self._plans.forget()
            self.flight = taken_up
        return taken_up is not None

    def explained(self, answer: PlanAnswer) -> str:
        """Why there is no plan, with the uncertainty, or tracking, where that is to blame."""
        if not answer.too_wide or self._uncertainty_m is None:
            return answer.reason
        if not self._needed_m:
            return f"no way with this tracking error ({answer.reason})"
        return f"no way with uncertainty {self._uncertainty_m:.1f} m ({answer.reason})"

    def note_no_room(self, awaited: Awaited, reason: str) -> None:
        """No plan leads on with obstacles as wide as they are."""
        self._in_vain = (awaited.job.widening_m, reason)

    def forget_first(self) -> None:
        """A first plan that is awaited must not be flown when it comes."""
        if self._plans.awaited is not None and self._plans.awaited.first:
            self._plans.forget()

    def end(self) -> None:
        """Nothing is flown any more."""
        if self.flight is not None and self.flight.mission is not None:
            self._left = self.flight if self.flight.on_leg else None
        self.flight = None
        self._in_vain = None
        self._survival.objection = None
        self.watch.end()
        self._plans.forget()

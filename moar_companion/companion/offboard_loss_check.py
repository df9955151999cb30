"""Offboard-loss check: refuses or warns of flights that a companion failure would make unsafe.

Inputs: the autopilot's parameters and its home, the flight, plans for it. Outputs: reasons to
refuse a plan or to hold, and warnings for operators.
"""

from __future__ import annotations

import math
from dataclasses import replace

from ..mavlink.autopilots.failsafe_actions import LINKS, FailsafeAction, Failsafes, Trigger
from ..mavlink.autopilots.offboard_loss import OffboardLoss
from ..mavlink.session import Severity
from ..planner.free_distance import FreeDistance
from ..settings.config import LossCheck, Supervision
from ..settings.vehicle import Vehicle
from ..texts import pilot_texts
from ..types import Mission, Vector
from .estimation.pose import home_moved
from .guidance.path_follower import PathFollower
from .guidance.trajectory import FloatArray
from .plan_requests import Awaited
from .planning.plan_jobs import PlanAnswer
from .planning.site_maps import SiteMaps
from .reports import Reports
from .safety.failsafe_paths import Hit, failsafe_hit, loss_objection
from .safety.refuges import unprotected

_PLACES = 16
"""Most places of a plan at which a landing without a position is looked at."""


class OffboardLossCheck:
    """Keeps the autopilot's behaviour after an offboard loss, and the objection to it.

    limits: the action on an objection. An escape route only causes a warning: staying is no better.
    """

    def __init__(self, vehicle: Vehicle, limits: Supervision, reports: Reports) -> None:
        self.site_maps: SiteMaps | None = None
        """Site and maps; None without a site."""
        self._vehicle = vehicle
        self._check = limits.loss_action
        self._failsafe_check = limits.failsafe_action
        self._reports = reports
        self._home_m: Vector | None = None
        """Home in the site's frame, as used in the last check of the flight."""
        self.loss: OffboardLoss | None = None
        """Flight after an offboard loss; None while that is unknown."""
        self.objection: str | None = None
        """Reason against the current flight or hold, by changes since it was planned."""

    def take_vehicle(self, vehicle: Vehicle) -> None:
        """Takes the vehicle with the settings in force."""
        self._vehicle = vehicle

    def learn(
        self,
        loss: OffboardLoss | None,
        home_m: Vector | None,
        flight: PathFollower | None,
        now_s: float,
    ) -> None:
        """Takes the flight after an offboard loss, None while that is unknown, and home.

        Checks the current flight or hold by them.
        """
        before, self.loss = self.loss, loss
        if self.loss is None:
            return
        if self.loss != before:
            if flight is not None:
                flight.learn_loss(self.loss)
        elif not home_moved(home_m, self._home_m):
            return
        self._home_m = home_m
        self._check_flight(flight, now_s)

    def learn_maps(self, site_maps: SiteMaps, flight: PathFollower | None, now_s: float) -> None:
        """Takes maps with other obstacles; checks the current flight or hold by them."""
        self.site_maps = site_maps
        self._check_flight(flight, now_s)

    def _check_flight(self, flight: PathFollower | None, now_s: float) -> None:
        self.objection = None
        if flight is None or flight.mission is None:
            return
        objection = self._objection_to(flight.path.volume.reach, flight.path.rests_ahead_m())
        if objection is not None and self._refuses(flight.mission):
            self.objection = objection
        elif objection is not None:
            self._reports.send_text(Severity.WARNING, objection, now_s)

    def reconsider(self, flight: PathFollower | None) -> None:
        """Repeats the check of an objection, after the inflation or the failsafes have changed.

        The offboard loss alone counts, and obstacles without their inflation.
        """
        if self.objection is not None and flight is not None:
            self.objection = self._objection_to(None, flight.path.rests_ahead_m())

    def checked(
        self,
        awaited: Awaited,
        answer: PlanAnswer,
        flight: PathFollower | None,
        failsafes: Failsafes,
        now_s: float,
        *,
        ordered: bool,
    ) -> PlanAnswer:
        """Returns the answer; without its plan, if an offboard loss on it would hit an obstacle.

        The current path then stays, unless an offboard loss on that is no better. The objection to
        a first plan that no operator has ordered stands until something changes.
        """
        plan = answer.plan
        if flight is None or plan is None:
            return answer
        rests_m = flight.rests_m(plan, awaited.junction, answer.escape_m, answer.reach)
        objection = self._objection_to(answer.reach, rests_m)
        if awaited.first:
            by_itself = self._by_itself(failsafes, answer.reach, rests_m)
            refused = self._failsafe_check is LossCheck.REFUSE
            if by_itself is not None and refused and plan.mission.visits_targets:
                if not ordered:
                    self.objection = by_itself
                return replace(answer, plan=None, reason=by_itself, would_collide=True)
            if by_itself is not None:
                self._reports.send_text(Severity.NOTICE, by_itself, now_s)
        if objection is None:
            return answer
        if self._refuses(plan.mission):
            if not awaited.first:
                self.objection = self._objection_to(answer.reach, flight.path.rests_ahead_m())
            elif not ordered:
                self.objection = objection
            return replace(answer, plan=None, reason=objection, would_collide=True)
        if awaited.first:
            self._reports.send_text(Severity.WARNING, objection, now_s)
        return answer

    def _by_itself(
        self, failsafes: Failsafes, reach: FreeDistance | None, rests_m: FloatArray
    ) -> str | None:
        """Text of a failsafe's collision from places (n, 2) after a link loss; None without one."""
        if self.site_maps is None:
            return None
        found = failsafe_hit(failsafes.of(LINKS), reach or self.site_maps.maps.reach, rests_m)
        if found is None and self._failsafe_check is LossCheck.REFUSE:
            found = self._blindly(failsafes.of({Trigger.GPS_LOSS}), self.site_maps, rests_m)
        if found is None:
            return None
        action, hit = found
        return pilot_texts.FAILSAFE_HITS(
            link=action.trigger.value, reaction=action.action.noun, obstacle=hit.obstacle
        )

    def _blindly(
        self, failsafes: Failsafes, site_maps: SiteMaps, places_m: FloatArray
    ) -> tuple[FailsafeAction, Hit] | None:
        """Hit without a position, from places (n, 2) where the leg at the fix's loss is no help.

        Some of the places are looked at: the search takes a millisecond for each.
        """
        places_m = places_m[:: max(1, math.ceil(len(places_m) / _PLACES))]
        site, maps = site_maps.site, site_maps.maps
        lost = unprotected(failsafes, site, self._vehicle, maps, places_m)
        return failsafe_hit(failsafes, maps.reach, places_m[lost], drifting=True)

    def _objection_to(self, reach: FreeDistance | None, rests_m: FloatArray) -> str | None:
        """Reason why an offboard loss at stop points (n, 2) is unsafe; None if it is safe."""
        loss, site_maps = self.loss, self.site_maps
        if loss is None or site_maps is None:
            return None
        lag = loss.lag(self._vehicle.guidance.acceleration_mps2)
        return lag or loss_objection(loss, reach or site_maps.maps.reach, rests_m, self._home_m)

    def _refuses(self, mission: Mission) -> bool:
        """True if an objection forbids a mission."""
        return self._check is LossCheck.REFUSE and mission.visits_targets

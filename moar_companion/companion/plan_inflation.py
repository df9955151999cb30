"""Obstacle inflation of plans, and the search that found no path with it.

Inputs: risks, the tracking error, answers without a plan. Outputs: the inflation of each mission's
plans, and the reason why there is no room for a path.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..planner.site import Margin
from ..risk import RiskEstimate
from ..settings.config import Supervision
from ..settings.vehicle import Vehicle
from ..texts import pilot_texts
from ..texts.text_format import distance
from ..types import Mission
from .plan_requests import Awaited
from .planning.plan_jobs import PlanAnswer
from .safety.position_checks import widening_m

STEP_M = 0.1
"""A third of a usual cell: less would not change its maps."""
_SLACK_M = 0.1
"""Fluctuation of receivers' accuracies under an open sky."""
_SHRINKS_AFTER_S = 3.0
"""Less than the time after which `uncertainty` clears (5 s): the first plan after that hold uses
the smaller inflation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ObstacleInflation:
    """Extra distance from obstacles in plans, in steps, never less than needed.

    It grows at once, and shrinks when less would have been enough for a while, so that noise in a
    measurement causes no new plan. width_m: inflation in plans. since_s, less_m: start and size of
    a smaller need.
    """

    width_m: float = 0.0
    less_m: float = 0.0
    since_s: float | None = None

    def followed(self, needed_m: float, now_s: float) -> ObstacleInflation:
        """Returns the inflation after a cycle that needs `needed_m`."""
        if needed_m > self.width_m:
            return ObstacleInflation(width_m=_stepped_m(needed_m))
        enough_m = _stepped_m(needed_m + _SLACK_M) if needed_m > 0.0 else 0.0
        if enough_m >= self.width_m:
            return ObstacleInflation(width_m=self.width_m)
        if self.since_s is None:
            return ObstacleInflation(width_m=self.width_m, less_m=enough_m, since_s=now_s)
        less_m = max(self.less_m, enough_m)
        if now_s - self.since_s >= _SHRINKS_AFTER_S:
            return ObstacleInflation(width_m=less_m)
        return ObstacleInflation(width_m=self.width_m, less_m=less_m, since_s=self.since_s)


def _stepped_m(needed_m: float) -> float:
    """Smallest whole number of steps that is enough."""
    steps = math.ceil(needed_m / STEP_M)
    while steps * STEP_M < needed_m:
        steps += 1  # where the quotient was rounded down
    return steps * STEP_M


class PlanInflation:
    """Keeps the obstacle inflation, and that at which no path was found."""

    def __init__(self, vehicle: Vehicle, limits: Supervision, margin: Margin) -> None:
        self.take_settings(vehicle, limits, margin)
        self._uncertainty_m: float | None = None
        self.needed_m = 0.0
        """Required obstacle inflation by position uncertainty, beyond keep-outs."""
        self._widening = ObstacleInflation()
        self._lasting = ObstacleInflation()
        """Required obstacle inflation without the tracking error, which a gust causes only for a
        time."""
        self._not_found: tuple[float, str] | None = None
        """Obstacle inflation at which no path was found, and the reason."""

    def take_settings(self, vehicle: Vehicle, limits: Supervision, margin: Margin) -> None:
        """Takes the settings in force."""
        self._vehicle = vehicle
        self._limit_m = limits.position_uncertainty_limit_m
        self._margin = margin

    @property
    def lasting_m(self) -> float:
        """Obstacle inflation of contingencies and recovery legs, without the tracking error.

        Above the uncertainty limit no mission starts: escape routes are measured as at the limit.
        """
        most_m = self._limit_m - self._margin.position_m
        return min(self._lasting.width_m, max(0.0, most_m))

    def of(self, mission: Mission) -> float:
        """Obstacle inflation of a mission's plans; on escape routes without the tracking error."""
        widening = self._widening if mission.visits_targets else self._lasting
        return widening.width_m

    def update(self, risk: RiskEstimate, tracking_error_m: float | None, now_s: float) -> bool:
        """Updates the obstacle inflation; returns True if it has become less.

        tracking_error_m: None without control, and on an escape route, which a gust must not stop.
        Beyond `tracking_hold_m` the setpoint waits.
        """
        before, most_m = self._widening, self._vehicle.guidance.tracking_hold_m
        self._uncertainty_m = risk.position_uncertainty_m
        self.needed_m = widening_m(risk, self._margin)
        deviation_m = min(tracking_error_m or 0.0, most_m) - self._margin.tracking_m
        self._widening = before.followed(self.needed_m + max(0.0, deviation_m), now_s)
        self._lasting = self._lasting.followed(self.needed_m, now_s)
        return self._widening.width_m < before.width_m

    @property
    def no_room(self) -> str | None:
        """Reason why no path was found; None once the obstacle inflation is less than then.

        None, too, above the uncertainty limit: then the uncertainty is the reason.
        """
        if self._not_found is None or self._uncertainty_m is None:
            return None
        width_m, reason = self._not_found
        over = self._widening.width_m < width_m or self._uncertainty_m > self._limit_m
        return None if over else reason

    def note_no_room(self, awaited: Awaited, reason: str) -> None:
        """Notes that no path was found with the present obstacle inflation."""
        self._not_found = (awaited.job.widening_m, reason)

    def forget_no_room(self) -> None:
        """Drops the search that found no path."""
        self._not_found = None

    def explained(self, answer: PlanAnswer) -> str:
        """Reason why there is no plan, with the uncertainty, or tracking, if that is the cause."""
        if not answer.too_wide or self._uncertainty_m is None:
            return answer.reason
        if not self.needed_m:
            return pilot_texts.TRACKING_BLOCKS(detail=answer.reason)
        return pilot_texts.UNCERTAINTY_BLOCKS(m=distance(self._uncertainty_m), detail=answer.reason)

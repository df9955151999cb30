"""Reports of adopted plans: the reason for a path, and the clearance of a narrow escape route.

Inputs: the adopted plan, and the rest of the plan before it. Outputs: record entries and texts.
"""

from __future__ import annotations

import math

from ..mavlink.session import Severity
from ..planner.adaptation import Adaptation
from ..planner.comparison import path_difference
from ..planner.plan_values import Plan
from ..planner.regions import narrowest
from ..planner.site import Site
from ..risk import RiskEstimate
from ..risk.explain import WeightsReason, risk_dict
from ..settings.vehicle import Vehicle
from ..texts import pilot_texts
from ..texts.text_format import coordinate, distance, limit_text
from ..types import Mission, RiskIndices
from .plan_requests import Awaited
from .reports import Reports

_REPORT_PERIOD_S = 10.0
"""Minimum time between two texts about a path that a risk has moved; the record has all."""
_RISK_MOVED = 0.05
"""Minimum change of a risk since the last path to be reported as the reason for a move."""


class PlanReports:
    """Keeps the risk indices of the active path, and the time of the last text about a move."""

    def __init__(self, vehicle: Vehicle, reports: Reports) -> None:
        self._vehicle = vehicle
        self._reports = reports
        self._reported_s = -math.inf
        self._flown_risk = RiskIndices()
        """Risk indices of the active path's plan."""

    def explain(
        self,
        awaited: Awaited,
        plan: Plan,
        flown: Plan | None,
        estimate: RiskEstimate,
        now_s: float,
    ) -> None:
        """Records the reason for a path; reports a path that a risk has moved.

        flown: rest of the plan before it; None where that could not stay.
        """
        adaptation = plan.request.adaptation or Adaptation.of(self._vehicle, plan.mission)
        difference = None if flown is None else path_difference(flown, plan)
        self._reports.record(
            "plan",
            now_s,
            first=awaited.first,
            plan=plan.to_dict(),
            explanation={
                "reason": awaited.reason,
                "risk": risk_dict(estimate),
                "weights": WeightsReason.of(adaptation, plan.request.risk).to_dict(),
                "path": None if difference is None else difference.to_dict(),
            },
        )
        before, self._flown_risk = self._flown_risk.as_dict(), plan.request.risk
        after = plan.request.risk.as_dict()
        name = max(after, key=lambda name: abs(after[name] - before[name]))
        if (
            difference is not None
            and abs(after[name] - before[name]) >= _RISK_MOVED
            and now_s - self._reported_s >= _REPORT_PERIOD_S
        ):
            self._reported_s = now_s
            reason = pilot_texts.PATH_MOVED(
                risk=name,
                fraction=coordinate(after[name], 2),
                path=difference.gist(),
                detail=f"was {coordinate(before[name], 2)}",
            )
            self._reports.send_text(Severity.INFO, reason, now_s)

    def report_narrow(self, plan: Plan, site: Site, now_s: float) -> None:
        """Reports the clearance of an escape route that keeps less than the margin."""
        nearest = narrowest(site, self._vehicle, plan.waypoints.position_m)
        if nearest is not None:
            name, clearance_m, needed_m = nearest
            reason = pilot_texts.NARROW(
                low_m=distance(clearance_m), obstacle=name, least_m=limit_text(needed_m)
            )
            action = "exiting" if plan.mission is Mission.EXIT else "evacuating"
            self._reports.send_text(Severity.WARNING, reason, now_s, action=action)

"""Position of a recorded aircraft on a site, and the flight time of its evacuation."""

from __future__ import annotations

import itertools
import math

from ...companion.estimation.plane_to_local import PlaneToLocal
from ...companion.estimation.pose import Pose
from ...companion.estimation.pose_tracker import PoseTracker
from ...companion.planning.plan_jobs import PlanJob, answer_job
from ...companion.planning.planner_set import PlannerSet
from ...companion.planning.site_maps import SiteMaps
from ...mavlink.telemetry import Telemetry
from ...planner.adaptation import Adaptation
from ...planner.plan_values import PlanRequest
from ...planner.planner import Planner
from ...planner.site import Site
from ...settings.config import Supervision
from ...types import Mission, RiskIndices
from .replay_report import ReplayPlace

_EVACUATION_PERIOD_S = 2.0
"""Time between two plans."""
_POSITION_MAX_AGE_S = 2.0
"""GLOBAL_POSITION_INT comes at 1 Hz or more, even on a slow link: 2 periods."""
_NEAR_M = 10_000.0
"""Greatest distance from the site at which its plane is a valid frame."""


class SitePosition:
    """Locates the aircraft on a planner's site, which is the one that was flown: with its margin.

    Raises InputError for a site with landing points for an evacuation that are not visible.
    """

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self._planners = PlannerSet(planner)
        self._site_maps = SiteMaps(site=planner.site, maps=planner.maps)
        self._limits = Supervision()
        self._pose_tracker = PoseTracker(planner.site, planner.vehicle.autopilot)
        self._planned_s = -math.inf
        self._evacuation_s: float | None = None
        self._has_escape_route = bool(planner.site.landing_m.get(Mission.EVACUATION))
        if self._has_escape_route:
            planner.prepare(mission=Mission.EVACUATION)

    @property
    def site(self) -> Site:
        """The site as it was flown."""
        return self._planner.site

    def at(self, telemetry: Telemetry, risk: RiskIndices, now_s: float) -> ReplayPlace | None:
        """Place of the aircraft; None if its position is unknown, or far from the site.

        Clearance and evacuation are those of the plane: None if the aircraft is not in it.
        """
        pose = self._pose(telemetry, now_s)
        if pose is None or math.hypot(*pose.position_m) > _NEAR_M:
            return None
        in_plane = abs(pose.position_m[1]) <= self._limits.plane_tolerance_m
        if now_s - self._planned_s >= _EVACUATION_PERIOD_S:
            self._planned_s = now_s
            armed = telemetry.autopilot is not None and telemetry.autopilot.armed
            due = in_plane and armed and self._has_escape_route
            self._evacuation_s = self._evacuation(pose, risk) if due else None
        clearance_m = self._site_maps.clearance_m(pose, self._planner.vehicle.radius_m)
        return ReplayPlace(
            position_m=pose.position_m,
            clearance_m=clearance_m if in_plane else None,
            evacuation_s=self._evacuation_s,
        )

    def _pose(self, telemetry: Telemetry, now_s: float) -> Pose | None:
        """Pose as the companion has it; by GNSS if the local frame's origin is unknown."""
        self._pose_tracker.update(telemetry)
        local, geodetic = telemetry.local_position, telemetry.global_position
        pose = self._pose_tracker.pose
        if local is not None and pose is not None:
            return pose if now_s - local.received_s <= _POSITION_MAX_AGE_S else None
        autopilot = telemetry.autopilot
        if (
            autopilot is None
            or geodetic is None
            or now_s - geodetic.received_s > _POSITION_MAX_AGE_S
        ):
            return None
        planner = self._planner
        here = PlaneToLocal.between(
            planner.site.frame, geodetic.point, planner.vehicle.autopilot or autopilot.kind
        )
        still = (0.0, 0.0, 0.0)
        return Pose(position_m=here.position_from_ned(still), velocity_mps=still, yaw_rad=0.0)

    def _evacuation(self, pose: Pose, risk: RiskIndices) -> float | None:
        """Flight time of the evacuation planned from here; None if there is none.

        Includes the leg to the point where a plan may begin.
        """
        start_m = (pose.position_m[0], pose.position_m[2])
        adaptation = Adaptation.of(self._planner.vehicle, Mission.EVACUATION)
        request = PlanRequest(
            mission=Mission.EVACUATION,
            target=None,
            start_m=start_m,
            velocity_mps=(pose.velocity_mps[0], pose.velocity_mps[2]),
            weights=adaptation.weights(risk),
            risk=risk,
            adaptation=adaptation,
        )
        answer = answer_job(self._planners, PlanJob(job_id=0, request=request))
        if answer.plan is None or answer.plan.metrics is None:
            return None
        leg_m = sum(itertools.starmap(math.dist, itertools.pairwise((start_m, *answer.escape_m))))
        slow_mps = self._planner.vehicle.speed.min_mps
        return answer.plan.metrics.duration_s + leg_m / slow_mps

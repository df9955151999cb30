"""Heading of the aircraft: along the path, to the inspected object, or fixed."""

from __future__ import annotations

import math

from ...planner.plan_values import Plan
from ...planner.site import Site, Target
from ...settings.vehicle import Guidance, YawMode
from ...types import Vector
from ..estimation.plane_to_local import PlaneToLocal
from ..estimation.pose import Pose

_LEAST_PATH_MPS = 0.1
"""Minimum setpoint speed at which the path has a direction."""
_LOOK_FROM_M = 1.0
"""Minimum distance to the inspected point; nearer, its direction is undefined: heading kept."""


def wanted_yaw_rad(
    site: Site,
    guidance: Guidance,
    plan: Plan | None,
    pose: Pose,
    plane: PlaneToLocal,
    *,
    velocity_mps: Vector,
    arrived: bool,
) -> float | None:
    """Heading from north that a flight should have; None to keep the present one.

    velocity_mps: of the setpoint. arrived: at the plan's end.
    """
    target = None if plan is None else _target(site, plan)
    # At a view the nose aims, whatever the way there: a gimbal's yaw is often limited.
    aims = arrived and target is not None and target.view is not None
    if guidance.yaw_mode is YawMode.FIXED and not aims:
        return guidance.fixed_yaw_rad
    if plan is None:
        return None
    if guidance.yaw_mode is YawMode.PATH and not aims:
        return _yaw_rad(velocity_mps, plane, _LEAST_PATH_MPS)
    x_m, y_m, _ = pose.position_m
    if target is None:
        end = plan.waypoints.position_m[-1]
        return _yaw_rad((float(end[0]) - x_m, -y_m, 0.0), plane, _LOOK_FROM_M)
    if arrived and target.yaw_deg is not None:
        return math.radians(target.yaw_deg)
    look_at = target.look_at_m or target.position_m
    return _yaw_rad((look_at[0] - x_m, -y_m, 0.0), plane, _LOOK_FROM_M)


def _target(site: Site, plan: Plan) -> Target | None:
    """The target of an inspection's plan; None for other missions."""
    if not plan.mission.visits_targets:
        return None
    return site.target(str(plan.request.target))


def _yaw_rad(direction: Vector, plane: PlaneToLocal, least: float) -> float | None:
    """The heading of a direction in the site's frame; None where it is shorter than `least`."""
    if math.hypot(direction[0], direction[1]) < least:
        return None
    north, east, _ = plane.velocity_to_ned(direction)
    return math.atan2(east, north)


def turned(yaw_rad: float, wanted_rad: float, greatest_rad: float) -> float:
    """A heading turned towards another the short way, by no more than `greatest_rad`."""
    turn = math.remainder(wanted_rad - yaw_rad, math.tau)
    return math.remainder(yaw_rad + max(-greatest_rad, min(greatest_rad, turn)), math.tau)

"""A mission of QGroundControl with the corners of planned paths."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from itertools import pairwise
from typing import Any, NamedTuple

from ...mavlink.autopilots import profile
from ...planner.plan_values import Plan
from ...planner.site import Site
from ...types import AutopilotKind, GeodeticPoint
from .drawn_site import waypoints_m

_WAYPOINT, _LAND, _TAKEOFF = 16, 21, 22
"""MAV_CMD_NAV_*."""
_SPEED_STEP_MPS = 0.05
"""Least change of speed that is a command of its own."""
_STRAIGHT_RAD = 0.01
"""Greatest turn that counts as straight."""
_ACCEPTANCE_M = 0.5
"""Acceptance radius at a corner of a mission; the autopilot's default (2 m and more) cuts the
corner."""


def qgc_plan_of(site: Site, plans: Iterable[Plan], autopilot: AutopilotKind | None) -> str:
    """A mission of QGroundControl (.plan, version 1) with the corners of the paths.

    MAV_CMD_NAV_TAKEOFF to the start, MAV_CMD_NAV_WAYPOINT at each corner, before it
    MAV_CMD_DO_CHANGE_SPEED where the planned speed changes, MAV_CMD_NAV_LAND at the end of an exit.
    Places are in MAV_FRAME_GLOBAL, heights above mean sea level. At each target the aircraft waits
    as long as its dwell or its view takes.
    """
    items: list[dict[str, Any]] = []
    speeds_mps = [0.0]

    def add(command: int, x_m: float, z_m: float, params: list[float | None]) -> None:
        place = site.frame.to_geodetic((x_m, 0.0, z_m))
        items.append(_place_item(command, place, params, len(items) + 1))

    for plan in plans:
        corners = _corners(plan)
        if not items:
            add(_TAKEOFF, *corners[0].position_m, [0, 0, 0, None])
        dwell_s = (
            site.target(str(plan.request.target)).hold_s if plan.mission.visits_targets else 0.0
        )
        for before, corner in pairwise(corners):
            speed_mps = round(before.speed_to_mps(corner), 2)
            if abs(speed_mps - speeds_mps[-1]) > _SPEED_STEP_MPS:
                speeds_mps.append(speed_mps)
                items.append(_speed_item(speed_mps, len(items) + 1))
            hold_s = dwell_s if corner is corners[-1] else 0.0
            add(_WAYPOINT, *corner.position_m, [hold_s, _ACCEPTANCE_M, 0, None])
        leg = plan.landing_leg
        if leg is not None:
            landing_m = site.landing_m[plan.mission][leg.landing_index]
            add(_LAND, *landing_m, [0, 0, 0, None])
    home = site.frame.to_geodetic((site.start_m[0], 0.0, site.start_m[1]))
    return json.dumps(
        {
            "fileType": "Plan",
            "version": 1,
            "groundStation": "QGroundControl",
            "mission": {
                "version": 2,
                "firmwareType": profile(autopilot).mav_autopilot or 0,
                "vehicleType": 2,
                "cruiseSpeed": max(speeds_mps),
                "hoverSpeed": max(speeds_mps),
                "globalPlanAltitudeMode": 2,
                "plannedHomePosition": [
                    round(home.latitude_deg, 8),
                    round(home.longitude_deg, 8),
                    round(home.altitude_amsl_m, 3),
                ],
                "items": items,
            },
            "geoFence": {"version": 2, "circles": [], "polygons": []},
            "rallyPoints": {"version": 2, "points": []},
        },
        indent=1,
    )


class _Corner(NamedTuple):
    """End of a straight part of a path."""

    position_m: tuple[float, float]
    time_s: float

    def speed_to_mps(self, other: _Corner) -> float:
        """Planned speed on the way to the next corner, on average."""
        taken_s = other.time_s - self.time_s
        return math.dist(self.position_m, other.position_m) / taken_s if taken_s > 0.0 else 0.0


def _corners(plan: Plan) -> list[_Corner]:
    """Ends of a path, and the waypoints at which it turns."""
    times_s = plan.waypoints.time_s
    at = [
        _Corner(place, float(time)) for place, time in zip(waypoints_m(plan), times_s, strict=True)
    ]
    inner = [
        here
        for before, here, after in zip(at, at[1:], at[2:], strict=False)
        if abs(_turn_rad(before.position_m, here.position_m, after.position_m)) > _STRAIGHT_RAD
    ]
    return [*at[:1], *inner, *at[-1:]]


def _turn_rad(
    before: tuple[float, float], here: tuple[float, float], after: tuple[float, float]
) -> float:
    (x, z), (next_x, next_z) = (
        (end[0] - start[0], end[1] - start[1]) for start, end in ((before, here), (here, after))
    )
    return math.atan2(x * next_z - z * next_x, x * next_x + z * next_z)


def _speed_item(speed_mps: float, number: int) -> dict[str, Any]:
    return {
        "type": "SimpleItem",
        "autoContinue": True,
        "command": 178,  # MAV_CMD_DO_CHANGE_SPEED
        "doJumpId": number,
        "frame": 2,  # MAV_FRAME_MISSION
        "params": [1, speed_mps, -1, 0, 0, 0, 0],
    }


def _place_item(
    command: int, place: GeodeticPoint, params: list[float | None], number: int
) -> dict[str, Any]:
    altitude = round(place.altitude_amsl_m, 3)
    position = [round(place.latitude_deg, 8), round(place.longitude_deg, 8), altitude]
    return {
        "type": "SimpleItem",
        "autoContinue": True,
        "command": command,
        "doJumpId": number,
        "frame": 0,  # MAV_FRAME_GLOBAL
        "Altitude": altitude,
        "AltitudeMode": 2,
        "AMSLAltAboveTerrain": None,
        "params": [*params, *position],
    }

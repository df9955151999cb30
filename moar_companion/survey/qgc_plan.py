"""A mission of QGroundControl with the corners of planned paths."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from typing import Any

from ..autopilots import profile
from ..planner.plan_values import Plan
from ..site import Site
from ..types import AutopilotKind, GeodeticPoint, Mission
from .drawn_site import waypoints_m

_STRAIGHT_RAD = 0.01
"""Greatest turn that counts as straight."""
_ACCEPTANCE_M = 0.5
"""Acceptance radius at a corner of a mission; the autopilot's default (2 m and more) cuts the
corner."""


def qgc_plan_of(
    site: Site, plans: Iterable[Plan], autopilot: AutopilotKind | None, speed_mps: float
) -> str:
    """A mission of QGroundControl (.plan, version 1) with the corners of the paths.

    MAV_CMD_DO_CHANGE_SPEED, then MAV_CMD_NAV_WAYPOINT in MAV_FRAME_GLOBAL, heights above mean sea
    level. At each target the aircraft waits for the dwell. The mission has no takeoff and no
    landing.
    """
    items: list[dict[str, Any]] = [_qgc_speed(speed_mps)]
    for plan in plans:
        waypoints = _corners_m(plan)
        dwell_s = (
            site.target(str(plan.request.target)).dwell_s
            if plan.mission is Mission.INSPECTION
            else 0.0
        )
        for number, (x, z) in enumerate(waypoints, 1):
            if len(items) > 1 and number == 1:
                continue  # end of the path before
            place = site.frame.to_geodetic((x, 0.0, z))
            hold_s = dwell_s if number == len(waypoints) else 0.0
            items.append(_qgc_item(place, hold_s, len(items) + 1))
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
                "cruiseSpeed": speed_mps,
                "hoverSpeed": speed_mps,
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


def _corners_m(plan: Plan) -> list[tuple[float, float]]:
    """Ends of a path, and the waypoints at which it turns."""
    at = waypoints_m(plan)
    inner = [
        here
        for before, here, after in zip(at, at[1:], at[2:], strict=False)
        if abs(_turn_rad(before, here, after)) > _STRAIGHT_RAD
    ]
    return [*at[:1], *inner, *at[-1:]]


def _turn_rad(
    before: tuple[float, float], here: tuple[float, float], after: tuple[float, float]
) -> float:
    (x, z), (next_x, next_z) = (
        (end[0] - start[0], end[1] - start[1]) for start, end in ((before, here), (here, after))
    )
    return math.atan2(x * next_z - z * next_x, x * next_x + z * next_z)


def _qgc_speed(speed_mps: float) -> dict[str, Any]:
    return {
        "type": "SimpleItem",
        "autoContinue": True,
        "command": 178,  # MAV_CMD_DO_CHANGE_SPEED
        "doJumpId": 1,
        "frame": 2,  # MAV_FRAME_MISSION
        "params": [1, speed_mps, -1, 0, 0, 0, 0],
    }


def _qgc_item(place: GeodeticPoint, hold_s: float, number: int) -> dict[str, Any]:
    altitude = round(place.altitude_amsl_m, 3)
    position = [round(place.latitude_deg, 8), round(place.longitude_deg, 8), altitude]
    return {
        "type": "SimpleItem",
        "autoContinue": True,
        "command": 16,  # MAV_CMD_NAV_WAYPOINT
        "doJumpId": number,
        "frame": 0,  # MAV_FRAME_GLOBAL
        "Altitude": altitude,
        "AltitudeMode": 2,
        "AMSLAltAboveTerrain": None,
        "params": [hold_s, _ACCEPTANCE_M, 0, None, *position],
    }

"""A site and its maps as displays draw them, fit for JSON.

Input: a site, maps of it. Output: mappings; maps are bytes in base64, row by row from the least z.
"""

from __future__ import annotations

import base64
import math
from dataclasses import asdict
from typing import Any

import numpy as np

from .grid import BoolArray, FloatArray
from .maps import Maps
from .site import Conductor, Obstacle, PlanePoint, Site

_OCCUPIED = 255
_GREATEST = 254
_FLOOR_POINTS = 201
"""Of the line of least heights, which is round above a corner of the ground."""


def site_view(site: Site) -> dict[str, Any]:
    """A site as the planner has it: keep-outs with the margin, targets as coordinates."""
    space = site.workspace
    return {
        "name": site.name,
        "frame": {"origin": asdict(site.frame.origin), "azimuth_deg": site.frame.azimuth_deg},
        "workspace": {
            "x_m": [space.lower_m[0], space.upper_m[0]],
            "z_m": [space.lower_m[1], space.upper_m[1]],
            "resolution_m": space.resolution_m,
            "min_altitude_m": space.min_altitude_m,
            "ground": _ground(site),
        },
        "obstacles": [_obstacle(item) for item in site.obstacles],
        "start": _point(site.start_m),
        "targets": [
            {
                "name": item.name,
                **_point(item.position_m),
                "dwell_s": item.dwell_s,
                "yaw_deg": item.yaw_deg,
            }
            for item in site.targets
        ],
        "landing": {
            mission.value: [_point(point) for point in points]
            for mission, points in site.landing_m.items()
        },
        "margin_m": site.margin.total_m,
    }


def _ground(site: Site) -> dict[str, Any] | None:
    """Profile of the ground, and least heights of paths above it; None: level, at z = 0."""
    space = site.workspace
    if not space.ground_m:
        return None
    ends_m = (space.lower_m[0], space.upper_m[0])
    between = [(x_m, z_m) for x_m, z_m in space.ground_m if ends_m[0] < x_m < ends_m[1]]
    first, last = ((x_m, space.ground_at_m(x_m)) for x_m in ends_m)
    x_m = np.linspace(*ends_m, _FLOOR_POINTS)
    return {
        "profile_m": [list(point) for point in (first, *between, last)],
        "floor_m": np.column_stack([x_m, space.floor_m(x_m)]).tolist(),
    }


def _obstacle(item: Obstacle) -> dict[str, Any]:
    if isinstance(item, Conductor):
        place = {"kind": "conductor", **_point(item.position_m), "radius_m": item.radius_m}
    else:
        place = {"kind": "polygon", "vertices_m": [list(vertex) for vertex in item.vertices_m]}
    return {"name": item.name, "keep_out_m": item.keep_out_m, **place}


def _point(point_m: PlanePoint) -> dict[str, Any]:
    return {"x_m": point_m[0], "z_m": point_m[1]}


def maps_view(maps: Maps, *, most_cells: int | None = None) -> dict[str, Any]:
    """Maps of safety cost and speed limit: a value is its byte times `scale`; 255 is occupied.

    most_cells: of larger maps each second cell of a row and a column is left out, or more.
    """
    columns, rows = maps.grid.shape
    step = 1 if most_cells is None else max(1, math.ceil(math.sqrt(columns * rows / most_cells)))
    occupied = maps.occupied[::step, ::step]
    columns, rows = occupied.shape
    return {
        "columns": columns,
        "rows": rows,
        "lower_m": list(maps.grid.lower_m),
        "cell_m": step * maps.grid.resolution_m,
        "safety": _bytes(maps.safety_cost[::step, ::step], occupied),
        "speed_mps": _bytes(maps.speed_limit_mps[::step, ::step], occupied),
    }


def _bytes(values: FloatArray, occupied: BoolArray) -> dict[str, Any]:
    """Values (nx, nz), not negative, as bytes with their scale."""
    scale = float(values.max()) / _GREATEST or 1.0
    data = np.rint(values / scale).astype(np.uint8)
    data[occupied] = _OCCUPIED
    return {"scale": scale, "data": base64.b64encode(data.T.tobytes()).decode()}

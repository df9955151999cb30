"""A cycle of the machine as messages of an .mcap: exact calls, and channels for viewers.

The site's frame is Foxglove's: x along the plane, y to its left, z up; its name is `site`.
"""

from __future__ import annotations

import base64
import json
import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from ...companion.companion import Companion
from ...companion.estimation.pose import Pose
from ...companion.planning.site_maps import SiteMaps
from ...companion.reports import Decision
from ...mavlink.codec import Codec
from ...mavlink.dialect import mavlink
from ...mavlink.telemetry import Telemetry
from ...planner.site import GROUND, Conductor, Site
from .calls import Call, call_encoded
from .schemas import CALLS, STATUS
from .value_codec import encoded

Message = tuple[str, float, dict[str, Any]]
"""Channel, wall clock in seconds since 1970, content."""

_FRAME = "site"
_POSE_PERIOD_S = 0.1
_STATUS_PERIOD_S = 0.5
_FLOWN_PERIOD_S, _FLOWN_STEP_S, _FLOWN_POINTS = 10.0, 1.0, 300
"""Period of the flown path; period of its points, and how many of them: the last five minutes."""
_SETPOINT = int(mavlink.MAVLINK_MSG_ID_SET_POSITION_TARGET_LOCAL_NED)
_INFO = 2
"""Level of a text in foxglove.Log."""
_FLOAT32 = 7
_LINE_STRIP, _LINE_LOOP = 0, 1
_HALF_WIDTH_M = 10.0
"""Drawn length of a conductor to either side of the plane."""
_KEEP_OUT, _CONDUCTOR, _TOWER, _TARGET = (
    {"r": 0.9, "g": 0.3, "b": 0.2, "a": 0.5},
    {"r": 0.9, "g": 0.6, "b": 0.1, "a": 1.0},
    {"r": 0.5, "g": 0.5, "b": 0.5, "a": 1.0},
    {"r": 0.1, "g": 0.6, "b": 0.2, "a": 1.0},
)
_UPRIGHT = {"x": math.sqrt(0.5), "y": 0.0, "z": 0.0, "w": math.sqrt(0.5)}
"""Turns the x-y plane, in which grids and cylinders' circles lie, to the site's x-z plane."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Cycle:
    """One cycle's calls, and of some cycles the state after it. now_s: the machine's clock."""

    now_s: float
    calls: list[Call]
    pose: Pose | None = None
    telemetry: Telemetry | None = None
    status: dict[str, Any] | None = None


class CycleSampler:
    """Takes a cycle from the machine, and its state at the rate of the viewers."""

    def __init__(self) -> None:
        self._pose_due_s = self._status_due_s = -math.inf

    def status_is_due(self, now_s: float) -> bool:
        """True if the cycle at `now_s` should have the status."""
        return now_s >= self._status_due_s

    def cycle(
        self, companion: Companion, calls: list[Call], status: dict[str, Any] | None, now_s: float
    ) -> Cycle:
        """The cycle's values. status: as `companion.status` has it, where it is due."""
        pose = None
        if now_s >= self._pose_due_s:
            self._pose_due_s, pose = now_s + _POSE_PERIOD_S, companion.pose
        if status is not None:
            self._status_due_s = now_s + _STATUS_PERIOD_S
        return Cycle(
            now_s=now_s,
            calls=calls,
            pose=pose,
            telemetry=None if status is None else companion.telemetry,
            status=status,
        )


class Channels:
    """Makes messages of cycles. clock_offset_s: wall clock minus the machine's clock."""

    def __init__(self, clock_offset_s: float) -> None:
        self._offset_s = clock_offset_s
        self._site_maps: SiteMaps | None = None
        self._flown: deque[Pose] = deque(maxlen=_FLOWN_POINTS)
        self._point_due_s = self._flown_due_s = -math.inf
        self._setpoints = Codec(system_id=1, component_id=1, wanted={_SETPOINT})

    def latched(self, now_s: float) -> Iterator[Message]:
        """Messages at the start of each file: site and map, once these are known."""
        if self._site_maps is not None:
            wall_s = now_s + self._offset_s
            yield "/site", wall_s, _scene(self._site_maps.site, wall_s)
            yield "/safety_map", wall_s, _safety_map(self._site_maps, wall_s)

    def messages(self, cycle: Cycle) -> Iterator[Message]:
        """The messages of a cycle."""
        wall_s = cycle.now_s + self._offset_s
        calls = [call_encoded(call) for call in cycle.calls]
        yield CALLS, wall_s, {"time_s": cycle.now_s, "calls": calls}
        for call in cycle.calls:
            match call.method:
                case "take_ground":
                    (self._site_maps,) = call.arguments
                    yield from self.latched(cycle.now_s)
                case "note_host":
                    yield "/host", wall_s, encoded(call.arguments[0])
                case "decisions":
                    for decision in call.result:
                        yield from self._decision(decision)
                case "control_to_send" | "data_to_send":
                    for _, packet in call.result:
                        yield from self._setpoint(packet, wall_s)
        if cycle.pose is not None:
            yield from self._pose(cycle.pose, cycle.now_s)
        if cycle.status is not None:
            for name in STATUS:
                section = cycle.status.get(name)
                if section is not None:
                    yield f"/{name}", wall_s, encoded(section)
        if cycle.telemetry is not None:
            yield "/telemetry", wall_s, encoded(cycle.telemetry)
            yield from _location(cycle.telemetry, wall_s)

    def _decision(self, decision: Decision) -> Iterator[Message]:
        wall_s = decision.time_s + self._offset_s
        if decision.kind == "status":
            return
        data = {"time_s": wall_s, "kind": decision.kind, "data": encoded(decision.data)}
        yield "/decision", wall_s, data
        if decision.kind == "text":
            log = {"level": _INFO, "message": decision.data["text"], "name": "moar"}
            yield "/log", wall_s, {"timestamp": _stamp(wall_s), **log, "file": "", "line": 0}
        elif decision.kind == "plan":
            points = decision.data["plan"]["waypoints"]
            poses = [_pose((point["x_m"], 0.0, point["z_m"])) for point in points]
            yield "/planned", wall_s, {**_framed(wall_s), "poses": poses}

    def _setpoint(self, packet: bytes, wall_s: float) -> Iterator[Message]:
        for message in self._setpoints.receive(packet):
            yield (
                "/setpoint",
                wall_s,
                {
                    "time_s": wall_s,
                    "position_ned_m": _xyz((message.x, message.y, message.z)),
                    "velocity_ned_mps": _xyz((message.vx, message.vy, message.vz)),
                    "yaw_rad": message.yaw,
                    "type_mask": message.type_mask,
                },
            )

    def _pose(self, pose: Pose, now_s: float) -> Iterator[Message]:
        wall_s = now_s + self._offset_s
        yield "/pose", wall_s, {**_framed(wall_s), "pose": self._turned(pose)}
        if now_s >= self._point_due_s:
            self._point_due_s = now_s + _FLOWN_STEP_S
            self._flown.append(pose)
        if now_s >= self._flown_due_s:
            self._flown_due_s = now_s + _FLOWN_PERIOD_S
            poses = [_pose(point.position_m) for point in self._flown]
            yield "/flown", wall_s, {**_framed(wall_s), "poses": poses}

    def _turned(self, pose: Pose) -> dict[str, Any]:
        """A pose with the heading, from north to the right, as a turn about z from the site's x."""
        azimuth_deg = 0.0 if self._site_maps is None else self._site_maps.site.frame.azimuth_deg
        half_rad = 0.5 * (math.radians(azimuth_deg) - pose.yaw_rad)
        turn = {"x": 0.0, "y": 0.0, "z": math.sin(half_rad), "w": math.cos(half_rad)}
        return _pose(pose.position_m, turn)


def _stamp(wall_s: float) -> dict[str, int]:
    nanoseconds = nanoseconds_of(wall_s)
    return {"sec": nanoseconds // 10**9, "nsec": nanoseconds % 10**9}


def nanoseconds_of(wall_s: float) -> int:
    """A wall clock in whole microseconds, as many as a float has, in nanoseconds."""
    return round(wall_s * 1e6) * 1000


def _framed(wall_s: float) -> dict[str, Any]:
    return {"timestamp": _stamp(wall_s), "frame_id": _FRAME}


def _xyz(vector: tuple[float, ...]) -> dict[str, float]:
    return dict(zip("xyz", vector, strict=True))


def _pose(
    position_m: tuple[float, ...], orientation: dict[str, float] | None = None
) -> dict[str, Any]:
    straight = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    return {"position": _xyz(position_m), "orientation": orientation or straight}


def _location(telemetry: Telemetry, wall_s: float) -> Iterator[Message]:
    position = telemetry.global_position
    if position is not None:
        point = position.point
        yield (
            "/location",
            wall_s,
            {
                "timestamp": _stamp(wall_s),
                "frame_id": "wgs84",
                "latitude": point.latitude_deg,
                "longitude": point.longitude_deg,
                "altitude": point.altitude_amsl_m,
                "position_covariance": [0.0] * 9,
                "position_covariance_type": 0,
            },
        )


def _safety_map(site_maps: SiteMaps, wall_s: float) -> dict[str, Any]:
    """The map of the safety cost, a row for each height."""
    grid, cost = site_maps.maps.grid, site_maps.maps.safety_cost
    x_m, z_m = grid.lower_m
    columns, size_m = grid.shape[0], grid.resolution_m
    return {
        **_framed(wall_s),
        "pose": _pose((x_m, 0.0, z_m), _UPRIGHT),
        "column_count": columns,
        "cell_size": {"x": size_m, "y": size_m},
        "row_stride": 4 * columns,
        "cell_stride": 4,
        "fields": [{"name": "safety_cost", "offset": 0, "type": _FLOAT32}],
        "data": base64.b64encode(cost.T.astype("<f4").tobytes()).decode(),
    }


def _scene(site: Site, wall_s: float) -> dict[str, Any]:
    """Obstacles with their keep-outs, and targets."""
    entities = []
    for item in site.obstacles:
        lines, cylinders = [], []
        if isinstance(item, Conductor):
            x_m, z_m = item.position_m
            kept_m = item.radius_m + item.keep_out_m
            cylinders = [
                _cylinder((x_m, z_m), max(item.radius_m, 0.05), _HALF_WIDTH_M, _CONDUCTOR),
                _cylinder((x_m, z_m), kept_m, 0.05, _KEEP_OUT),
            ]
        else:
            corners = [_xyz((x_m, 0.0, z_m)) for x_m, z_m in item.vertices_m]
            lines = [_line(_LINE_LOOP, corners, _TOWER)]
        entities.append(_entity(item.name, wall_s, lines=lines, cylinders=cylinders))
    if site.workspace.ground_m:
        profile = [_xyz((x_m, 0.0, z_m)) for x_m, z_m in site.workspace.ground_m]
        entities.append(_entity(GROUND, wall_s, lines=[_line(_LINE_STRIP, profile, _TOWER)]))
    for target in site.targets:
        x_m, z_m = target.position_m
        entities.append(
            _entity(
                f"target {target.name}",
                wall_s,
                cylinders=[_cylinder((x_m, z_m), 0.2, 0.05, _TARGET)],
                texts=[_text(target.name, (x_m, 0.0, z_m + 0.5))],
            )
        )
    return {"deletions": [], "entities": entities}


def _entity(name: str, wall_s: float, **parts: list[dict[str, Any]]) -> dict[str, Any]:
    kinds = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
    return {
        **_framed(wall_s),
        "id": name,
        "lifetime": {"sec": 0, "nsec": 0},
        "frame_locked": False,
        "metadata": [],
        **{kind: parts.get(kind, []) for kind in kinds},
    }


def _cylinder(
    place_m: tuple[float, float], radius_m: float, half_m: float, color: dict[str, float]
) -> dict[str, Any]:
    x_m, z_m = place_m
    return {
        "pose": _pose((x_m, 0.0, z_m), _UPRIGHT),
        "size": _xyz((2.0 * radius_m, 2.0 * radius_m, 2.0 * half_m)),
        "bottom_scale": 1.0,
        "top_scale": 1.0,
        "color": color,
    }


def _line(kind: int, points: list[dict[str, float]], color: dict[str, float]) -> dict[str, Any]:
    return {
        "type": kind,
        "pose": _pose((0.0, 0.0, 0.0)),
        "thickness": 2.0,
        "scale_invariant": True,
        "points": points,
        "color": color,
        "colors": [],
        "indices": [],
    }


def _text(text: str, place_m: tuple[float, float, float]) -> dict[str, Any]:
    return {
        "pose": _pose(place_m),
        "billboard": True,
        "font_size": 12.0,
        "scale_invariant": True,
        "color": _TARGET,
        "text": text,
    }


def encoded_message(content: dict[str, Any]) -> bytes:
    """A message as JSON."""
    return json.dumps(content, allow_nan=False, separators=(",", ":")).encode()

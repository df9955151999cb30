"""JSON schemas of the channels of an .mcap.

Foxglove reads each field by one type. A value that may be null has the type of its other values; a
value without fixed fields is left out. Names with `foxglove.` are schemas of Foxglove
(https://docs.foxglove.dev/docs/visualization/message-schemas), which its 3D, Map and Log panels
display.
"""

from __future__ import annotations

import dataclasses
import enum
import json
import types
import typing
from typing import Any

from ...companion.safety.check_inputs import Host
from ...mavlink.telemetry import Telemetry

Shape = str | dict[str, Any] | list[Any]
"""`number`, `integer`, `string`, `boolean`, `base64`; names to shapes; a list of one shape."""

_N, _I, _S, _B = "number", "integer", "string", "boolean"


def schema(name: str, shape: Shape) -> bytes:
    """The JSON schema of a shape. name: its title."""
    return json.dumps({"title": name, **_schema(shape)}).encode()


def _schema(shape: Shape) -> dict[str, Any]:
    if isinstance(shape, dict):
        properties = {name: _schema(item) for name, item in shape.items()}
        return {"type": "object", "properties": properties}
    if isinstance(shape, list):
        return {"type": "array", "items": _schema(shape[0])}
    if shape == "base64":
        return {"type": "string", "contentEncoding": "base64"}
    return {"type": shape}


def shape_of(hint: Any) -> Shape:
    """Shape of a dataclass, by its annotations; a mapping by key has none of its fields."""
    arguments = [kind for kind in typing.get_args(hint) if kind is not type(None)]
    origin = typing.get_origin(hint)
    if origin in {typing.Union, types.UnionType}:
        return shape_of(arguments[0])
    if origin is tuple:
        return [shape_of(arguments[0])]
    if dataclasses.is_dataclass(hint):
        return {name: shape_of(kind) for name, kind in typing.get_type_hints(hint).items()}
    if isinstance(hint, type) and issubclass(hint, enum.Enum):
        hint = type(next(iter(hint)).value)
    return {bool: _B, int: _I, float: _N, str: _S}.get(hint, {})


_TIME = {"sec": _I, "nsec": _I}
_VECTOR = {"x": _N, "y": _N, "z": _N}
_POSE = {"position": _VECTOR, "orientation": {**_VECTOR, "w": _N}}
_COLOR = {"r": _N, "g": _N, "b": _N, "a": _N}
_SIZED = {"pose": _POSE, "size": _VECTOR, "color": _COLOR}
_POINTS = {"points": [_VECTOR], "color": _COLOR, "colors": [_COLOR], "indices": [_I]}
_ENTITY = {
    "timestamp": _TIME,
    "frame_id": _S,
    "id": _S,
    "lifetime": _TIME,
    "frame_locked": _B,
    "metadata": [{"key": _S, "value": _S}],
    "arrows": [
        {
            "pose": _POSE,
            "shaft_length": _N,
            "shaft_diameter": _N,
            "head_length": _N,
            "head_diameter": _N,
            "color": _COLOR,
        }
    ],
    "cubes": [_SIZED],
    "spheres": [_SIZED],
    "cylinders": [{**_SIZED, "bottom_scale": _N, "top_scale": _N}],
    "lines": [{"type": _I, "pose": _POSE, "thickness": _N, "scale_invariant": _B, **_POINTS}],
    "triangles": [{"pose": _POSE, **_POINTS}],
    "texts": [
        {
            "pose": _POSE,
            "billboard": _B,
            "font_size": _N,
            "scale_invariant": _B,
            "color": _COLOR,
            "text": _S,
        }
    ],
    "models": [
        {
            "pose": _POSE,
            "scale": _VECTOR,
            "color": _COLOR,
            "override_color": _B,
            "url": _S,
            "media_type": _S,
            "data": "base64",
        }
    ],
}
_FOXGLOVE: dict[str, Shape] = {
    "foxglove.PoseInFrame": {"timestamp": _TIME, "frame_id": _S, "pose": _POSE},
    "foxglove.PosesInFrame": {"timestamp": _TIME, "frame_id": _S, "poses": [_POSE]},
    "foxglove.LocationFix": {
        "timestamp": _TIME,
        "frame_id": _S,
        "latitude": _N,
        "longitude": _N,
        "altitude": _N,
        "position_covariance": [_N],
        "position_covariance_type": _I,
    },
    "foxglove.Log": {
        "timestamp": _TIME,
        "level": _I,
        "message": _S,
        "name": _S,
        "file": _S,
        "line": _I,
    },
    "foxglove.Grid": {
        "timestamp": _TIME,
        "frame_id": _S,
        "pose": _POSE,
        "column_count": _I,
        "cell_size": {"x": _N, "y": _N},
        "row_stride": _I,
        "cell_stride": _I,
        "fields": [{"name": _S, "offset": _I, "type": _I}],
        "data": "base64",
    },
    "foxglove.SceneUpdate": {
        "deletions": [{"timestamp": _TIME, "type": _I, "id": _S}],
        "entities": [_ENTITY],
    },
}

_WEIGHTS = {"safety": _N, "time": _N, "energy": _N}
_INPUT = {
    "name": _S,
    "value": _N,
    "unit": _S,
    "reading": _S,
    "age_s": _N,
    "risk": _N,
    "known": _B,
}
_INDEX = {
    "value": _N,
    "target": _N,
    "known": _B,
    "worst": _S,
    "cause": _S,
    "held": _B,
    "words": _S,
    "inputs": [_INPUT],
}
_INDICES = ("wind", "communication", "localization", "battery")
_COST = {"total": _N, "safety": _N, "time": _N, "energy": _N}
_WAY = {"duration_s": _N, "energy_wh": _N, "left_s": _N, "age_s": _N}
_SETPOINT = {"position_m": [_N], "velocity_mps": [_N], "yaw_rad": _N}
_SOURCES = [*(item.name for item in dataclasses.fields(Telemetry)), "battery"]
STATUS: dict[str, Shape] = {
    "autopilot": {
        "kind": _S,
        "system_id": _I,
        "mode": _S,
        "ours": _B,
        "armed": _B,
        "failsafe": _B,
        "age_s": _N,
    },
    "supervision": {
        "action": _S,
        "conditions": [{"name": _S, "action": _S, "reason": _S, "overridden": _B}],
    },
    "mission": {
        "state": _S,
        "for_s": _N,
        "mission": _S,
        "goal": _S,
        "text": _S,
        "text_age_s": _N,
    },
    "aircraft": {
        "landed": _S,
        "position_m": [_N],
        "position_ned_m": [_N],
        "velocity_mps": [_N],
        "speed_mps": _N,
        "yaw_rad": _N,
        "clearance_m": _N,
        "global_position": {"latitude_deg": _N, "longitude_deg": _N, "altitude_amsl_m": _N},
    },
    "path": {"setpoint": _SETPOINT, "error_m": _N, "left_m": _N, "left_s": _N},
    "risk": dict.fromkeys(_INDICES, _INDEX),
    "energy": {
        "left_wh": _N,
        "flight_s": _N,
        "factor": _N,
        "source": _S,
        "finish": _WAY,
        "exit": _WAY,
        "evacuation": _WAY,
        "better": _S,
    },
    "weights": {
        "base": _WEIGHTS,
        "adjusted": _WEIGHTS,
        "by_risk": dict.fromkeys(_INDICES, _WEIGHTS),
        "adaptation": {"kind": _S, "calibrated": _B},
        "words": _S,
    },
    "plan": {
        "status": _S,
        "site": _S,
        "mission": _S,
        "target": _S,
        "cost": _COST,
        "search_ms": _N,
        "age_s": _N,
        "reason": _S,
        "change": _S,
        "path": [dict.fromkeys(("x_m", "y_m", "z_m", "speed_mps", "time_s"), _N)],
        "paths": _I,
        "replans": _I,
    },
    "link": {"packets_received": _I, "packets_lost": _I, "packets_late": _I, "rate_hz": _N},
    "refused": {},
    "radio": {
        "kind": _S,
        "rssi": _N,
        "remote_rssi": _N,
        "noise": _N,
        "remote_noise": _N,
        "transmit_buffer_percent": _N,
        "age_s": _N,
    },
    "age_s": dict.fromkeys(_SOURCES, _N),
}
"""Sections of the status (`companion/status`), one channel each."""

CALLS = "/machine/calls"
CHANNELS: dict[str, str] = {
    "/pose": "foxglove.PoseInFrame",
    "/flown": "foxglove.PosesInFrame",
    "/planned": "foxglove.PosesInFrame",
    "/site": "foxglove.SceneUpdate",
    "/safety_map": "foxglove.Grid",
    "/location": "foxglove.LocationFix",
    "/log": "foxglove.Log",
    "/setpoint": "moar.Setpoint",
    "/decision": "moar.Decision",
    "/host": "moar.Host",
    "/telemetry": "moar.Telemetry",
    CALLS: "moar.Calls",
    **{f"/{name}": f"moar.{name.title().replace('_', '')}" for name in STATUS},
}
"""Schema of each channel."""
SHAPES: dict[str, Shape] = {
    **_FOXGLOVE,
    "moar.Setpoint": {
        "time_s": _N,
        "position_ned_m": _VECTOR,
        "velocity_ned_mps": _VECTOR,
        "yaw_rad": _N,
        "type_mask": _I,
    },
    "moar.Decision": {"time_s": _N, "kind": _S},
    "moar.Host": shape_of(Host),
    "moar.Telemetry": shape_of(Telemetry),
    "moar.Calls": {"time_s": _N},
    **{CHANNELS[f"/{name}"]: shape for name, shape in STATUS.items()},
}

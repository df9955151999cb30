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
from ...status_values import Status

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


def _about(kind: Any) -> str:
    """First paragraph of a section's description."""
    kinds = (kind, *typing.get_args(kind))
    described = next((item for item in kinds if dataclasses.is_dataclass(item)), None)
    about = "Numbers by name." if described is None else described.__doc__ or ""
    return " ".join(about.partition("\n\n")[0].split())


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

_SOURCES = [*(item.name for item in dataclasses.fields(Telemetry)), "battery"]
_WITHOUT = {"time_s", "batteries", "host", "recorder"}
"""Values of the status without a channel: others have them, or no panel plots them."""
_SECTIONS = typing.get_type_hints(Status)
STATUS: dict[str, Shape] = {
    name: shape_of(kind) for name, kind in _SECTIONS.items() if name not in _WITHOUT
} | {"age_s": dict.fromkeys(_SOURCES, _N)}
"""Sections of the status, one channel each."""

CALLS = "/machine/calls"
ABOUT: dict[str, tuple[str, str]] = {
    "/pose": ("foxglove.PoseInFrame", "The aircraft, 10 Hz."),
    "/flown": ("foxglove.PosesInFrame", "Places of the last five minutes, each 10 s."),
    "/planned": ("foxglove.PosesInFrame", "Each path that is taken."),
    "/site": ("foxglove.SceneUpdate", "Obstacles with keep-outs, and targets, once in each part."),
    "/safety_map": ("foxglove.Grid", "The safety cost, once in each part."),
    "/location": ("foxglove.LocationFix", "The aircraft for the Map panel, 2 Hz."),
    "/log": ("foxglove.Log", "Texts for pilots."),
    "/setpoint": ("moar.Setpoint", "Each setpoint that was sent, in the autopilot's frame."),
    "/decision": ("moar.Decision", "As in `decisions.jsonl`, without the status."),
    "/host": ("moar.Host", "Free disk and memory, delays, file faults, 1 Hz."),
    "/telemetry": ("moar.Telemetry", "The last report of each source, 2 Hz."),
    CALLS: (
        "moar.Calls",
        "Every input of the companion and every result, in order: for `replay --exact`.",
    ),
    **{
        f"/{name}": (f"moar.{name.title().replace('_', '')}", f"{_about(_SECTIONS[name])} 2 Hz.")
        for name in STATUS
    },
}
"""Schema and content of each channel."""
CHANNELS = {name: schema for name, (schema, _) in ABOUT.items()}
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

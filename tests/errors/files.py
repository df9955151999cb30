"""A site, a vehicle and a configuration with every key, and the rules of the keys."""

from __future__ import annotations

import dataclasses
import enum
import math
from collections.abc import Iterator
from typing import Any

from moar_companion.planner.site import Site
from moar_companion.settings.config import (
    CompanionConfig,
    Inspection,
    RecorderSettings,
    Replanning,
    Supervision,
)
from moar_companion.settings.risk_model import RadioKind, Range, RiskModel
from moar_companion.settings.vehicle import Guidance, Power, Vehicle
from moar_companion.settings.yaml_schema import file_key


def section(record: Any) -> dict[str, Any]:
    """A section of a file with every key, from the defaults of its dataclass."""
    content = {}
    for member in dataclasses.fields(record):
        value = getattr(record, member.name)
        key = file_key(member.name)
        if isinstance(value, Range):
            value = [value.low, value.high]
        elif isinstance(value, enum.Enum):
            value = value.value
        elif value is None:
            value = 6
        if key != member.name:
            value = [math.degrees(x) for x in value] if isinstance(value, list) else value
            value = math.degrees(value) if isinstance(value, float) else value
        content[key] = value
    return content


WEIGHTS = {"safety": 0.4, "time": 0.3, "energy": 0.3}
SITE: dict[str, Any] = {
    "name": "Span 12",
    "frame": {
        "origin": {"latitude_deg": 45.4, "longitude_deg": -71.9, "altitude_amsl_m": 210.0},
        "azimuth_deg": 90.0,
        "shifts": [
            {
                "north_m": 0.4,
                "east_m": -0.1,
                "up_m": 0.03,
                "reason": "base moved",
                "date": "2026-05-31",
            }
        ],
    },
    "workspace": {
        "x_m": [0.0, 30.0],
        "z_m": [0.0, 20.0],
        "resolution_m": 0.3,
        "min_altitude_m": 2.0,
    },
    "ground": [[0.0, 0.0], [14.0, 1.0], [30.0, 0.5]],
    "obstacles": [
        {"conductor": {"name": "left", "x_m": 9, "z_m": 8, "radius_m": 0.03, "keep_out_m": 0.5}},
        {
            "polygon": {
                "name": "leg",
                "vertices_m": [[14.0, 0.0], [16.0, 0.0], [15.5, 19.0], [14.5, 19.0]],
                "keep_out_m": 0.2,
            }
        },
    ],
    "start": {"x_m": 27.0, "z_m": 2.5},
    "targets": {
        "splice-1": {"x_m": 9.0, "z_m": 14.0, "dwell_s": 3.0, "yaw_deg": 180.0},
        "splice-2": {"conductor": "left", "standoff_m": 2.0, "side": "left"},
        "splice-3": {
            "x_m": 12.0,
            "z_m": 14.0,
            "views": [
                {
                    "conductor": "left",
                    "standoff_m": 2.0,
                    "side": "left",
                    "pictures": 2,
                    "video_s": 5.0,
                },
                {"x_m": 3.0, "z_m": 8.0, "aim": {"x_m": 9.0, "z_m": 8.5}, "zoom_percent": 50.0},
            ],
        },
    },
    "landing": {
        "exit": [{"x_m": 40.0, "z_m": 0.0}],
        "evacuation": [{"x_m": -8.0, "z_m": 0.0}, {"x_m": 40.0, "z_m": 0.0}],
    },
}
VEHICLE: dict[str, Any] = {
    "name": "LineDrone",
    "autopilot": "px4",
    "adaptation": "paper",
    "geometry": {"radius_m": 0.6},
    "safety": {
        "d_min_m": 1.2,
        "d_max_m": 3.0,
        "exposure": 0.2,
        "weights": {"collision": 0.3, "insertion": 0.2, "damage": 0.5},
    },
    "speed": {
        "min_mps": 0.5,
        "horizontal_mps": 10.0,
        "up_mps": 1.5,
        "down_mps": 1.5,
        "diagonal_up_mps": 2.5,
        "diagonal_down_mps": 2.5,
        "max_mps": 10.0,
    },
    "weights": {"inspection": WEIGHTS, "exit": dict(WEIGHTS), "evacuation": dict(WEIGHTS)},
    "guidance": section(Guidance()),
    "power": section(Power()),
    "risk": section(
        RiskModel(
            motor_pulse_us=Range(low=1000.0, high=2000.0),
            motor_rpm=Range(low=0.0, high=8000.0),
            radio=RadioKind.ELRS,
        )
    ),
}
COMPANION: dict[str, Any] = {
    "vehicle": "vehicles/linedrone.yaml",
    "site": "sites/span.yaml",
    "links": [{"url": "udp:127.0.0.1:14540", "role": "autopilot", "signed": False}],
    "system_id": 1,
    "component_id": 195,
    "authority": "stream",
    "setpoint_rate_hz": 50.0,
    "resume": False,
    "commands": {
        "systems": [255],
        "components": [190],
        "links": ["udp:127.0.0.1:14540"],
        "signed_only": False,
    },
    "replanning": section(Replanning()),
    "inspection": section(Inspection()),
    "supervision": section(Supervision(position_uncertainty_m=1.4)),
    "recorder": {**section(RecorderSettings()), "directory": "flights"},
    "state": {"directory": "state"},
    "view": {"socket": "view.sock"},
    "signing": {"key_file": "signing.key", "credential": "mavlink-signing-key"},
    "mqtt": {
        "url": "mqtts://broker.example:8883",
        "vehicle": "a1",
        "ca_file": "ca.pem",
        "certificate_file": "a1.pem",
        "key_file": "a1.key",
        "username": "a1",
        "password_file": "password",
        "password_credential": "mqtt-password",
        "commands": {
            "accept": True,
            "key_file": "orders.key",
            "credential": "mqtt-orders-key",
            "window_s": 10.0,
        },
    },
    "page": {
        "enabled": True,
        "host": "0.0.0.0",
        "port": 8195,
        "token_file": "page.token",
        "token_credential": "page-token",
        "allowed_hosts": ["drone-1"],
        "tile_url": "https://tiles.example/{z}/{x}/{y}.png",
    },
    "perception": {
        "sensor": "velodyne",
        "address": "0.0.0.0",
        "port": 2368,
        "metadata": "lidar.json",
        "mount": {"position_m": [0.1, 0.0, 0.2], "roll_pitch_yaw_deg": [-90.0, 0.0, 0.0]},
        "keep_out_m": 0.5,
        "fly_by_line": False,
        "gate_m": 2.0,
        "moved_m": 0.5,
        "sight_m": 8.0,
        "target_slack_m": 2.0,
        "timeout_s": 1.0,
        "late_s": 0.5,
        "least_returns": 0.05,
    },
}
FILES: dict[str, tuple[Any, dict[str, Any]]] = {
    "site.yaml": (Site.load, SITE),
    "vehicle.yaml": (Vehicle.load, VEHICLE),
    "companion.yaml": (CompanionConfig.load, COMPANION),
}
REQUIRED = {
    "site.yaml": {
        "name", "frame", "frame.origin", "frame.origin.latitude_deg", "frame.origin.longitude_deg",
        "frame.origin.altitude_amsl_m", "frame.azimuth_deg", "frame.shifts[0].reason",
        "frame.shifts[0].date", "workspace", "workspace.x_m",
        "workspace.z_m", "workspace.resolution_m", "obstacles", "obstacles[0].conductor.name",
        "obstacles[0].conductor.x_m", "obstacles[0].conductor.z_m",
        "obstacles[0].conductor.radius_m", "obstacles[1].polygon.name",
        "obstacles[1].polygon.vertices_m", "start", "start.x_m", "start.z_m",
        "targets.splice-1.x_m", "targets.splice-1.z_m", "targets.splice-2.conductor",
        "targets.splice-2.standoff_m", "targets.splice-2.side",
        "targets.splice-3.x_m", "targets.splice-3.z_m",
        "targets.splice-3.views[0].standoff_m", "targets.splice-3.views[0].side",
        "targets.splice-3.views[1].x_m", "targets.splice-3.views[1].z_m",
        "targets.splice-3.views[1].aim.x_m", "targets.splice-3.views[1].aim.z_m",
        "landing.exit[0].x_m",
        "landing.exit[0].z_m", "landing.evacuation[0].x_m", "landing.evacuation[0].z_m",
        "landing.evacuation[1].x_m", "landing.evacuation[1].z_m",
    },
    "vehicle.yaml": {
        "name", "geometry", "geometry.radius_m", "safety", "safety.d_min_m", "safety.d_max_m",
        "safety.weights", "safety.weights.collision", "safety.weights.insertion",
        "safety.weights.damage", "speed", "speed.min_mps", "speed.horizontal_mps", "speed.up_mps",
        "speed.down_mps", "speed.diagonal_up_mps", "speed.diagonal_down_mps", "weights",
        *(f"weights.{mission}" for mission in ("inspection", "exit", "evacuation")),
        *(
            f"weights.{mission}.{name}"
            for mission in ("inspection", "exit", "evacuation")
            for name in WEIGHTS
        ),
    },
    "companion.yaml": {
        "vehicle", "links[0].url", "mqtt.vehicle", "mqtt.certificate_file", "mqtt.key_file",
        "mqtt.username",
    },
}  # fmt: skip
EMPTY_IS_NONE = {
    "site.yaml": {
        "workspace.min_altitude_m", "ground",
        "targets.splice-1.dwell_s", "targets.splice-1.yaw_deg",
        "targets.splice-3.views", "targets.splice-3.views[0].conductor",
        "targets.splice-3.views[0].pictures", "targets.splice-3.views[1].aim",
        "targets.splice-3.views[1].zoom_percent",
    },
    "vehicle.yaml": {
        "autopilot", "speed.max_mps", "power.cruise_w", "power.climb_w", "power.descent_w",
        "power.capacity_wh", "risk.cells", "risk.motor_pulse_us", "risk.motor_rpm", "risk.radio",
        "guidance.tracking_margin_m",
    },
    "companion.yaml": {
        "site", "recorder.directory", "state.directory", "view.socket",
        "supervision.position_uncertainty_m", "signing.key_file", "signing.credential",
        "commands.systems", "commands.components", "commands.links", "mqtt.url", "mqtt.vehicle",
        "mqtt.ca_file", "mqtt.certificate_file", "mqtt.key_file", "mqtt.username",
        "mqtt.password_file", "mqtt.password_credential", "mqtt.commands.key_file",
        "mqtt.commands.credential", "perception.sensor", "perception.port",
        "perception.metadata", "page.token_file", "page.token_credential", "page.tile_url",
    },
}  # fmt: skip
"""Keys whose default is nothing; `key:` without a value says the same."""

ONE_OF_TWO = {
    "site.yaml": {
        "obstacles[0].conductor", "obstacles[1].polygon", "targets.splice-1.x_m",
        "targets.splice-1.z_m", "targets.splice-2.conductor", "targets.splice-2.standoff_m",
        "targets.splice-2.side", "targets.splice-3.x_m", "targets.splice-3.z_m",
        "targets.splice-3.views[0].standoff_m", "targets.splice-3.views[0].side",
        "targets.splice-3.views[1].x_m", "targets.splice-3.views[1].z_m",
    },
    "vehicle.yaml": set(),
    "companion.yaml": {"vehicle"},
}  # fmt: skip
"""Keys that something else may stand for: without a value they are as good as missing."""


def walk(
    value: Any, key: tuple[str | int, ...] = ()
) -> Iterator[tuple[tuple[str | int, ...], Any]]:
    """Every key of a file with its value, the file itself first."""
    yield key, value
    if isinstance(value, dict | list):
        for part, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from walk(item, (*key, part))


def parent(content: Any, key: tuple[str | int, ...]) -> Any:
    for part in key[:-1]:
        content = content[part]
    return content

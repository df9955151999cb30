"""The section `perception` of the configuration: the lidar, its mount, and use of its reports."""

from __future__ import annotations

import enum
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from pydantic import Field

from ..types import Vector
from .yaml_file import FileFinding


class Sensor(str, enum.Enum):
    """Kind of the sensor that measures obstacles."""

    VELODYNE = "velodyne"
    OUSTER = "ouster"
    MAVLINK = "mavlink"
    """OBSTACLE_DISTANCE and OBSTACLE_DISTANCE_3D on the autopilot's links."""


DATA_PORTS = {Sensor.VELODYNE: 2368, Sensor.OUSTER: 7502}
"""UDP ports to which the sensors send data unless they are set otherwise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorMount:
    """Mount of the sensor on the aircraft.

    By default the axis of rotation points to the aircraft's left: the scan is its x-z plane.
    """

    position_m: Annotated[Vector, Field(ge=-1e6, le=1e6)] = (0.0, 0.0, 0.0)
    """Forward, left, up of the position that the autopilot reports."""
    roll_pitch_yaw_deg: Annotated[Vector, Field(ge=-360.0, le=360.0)] = (-90.0, 0.0, 0.0)
    """From the sensor's axes to the aircraft's (x forward, y left, z up): turned about x, then y,
    then z."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Perception:
    """Sensor of obstacles, and use of its reports."""

    sensor: Sensor | None = None
    """The sensor that measures obstacles; none: no perception."""
    address: str = "0.0.0.0"  # noqa: S104 - the sensor broadcasts, or sends to any address of ours
    """Address of this computer at which the data packets arrive."""
    port: Annotated[int | None, Field(ge=1, le=65_535)] = None
    """UDP port of the data packets; none: 2368 of a Velodyne, 7502 of an Ouster."""
    metadata: Path | None = None
    """Description of an Ouster, the `.json` of its web page."""
    mount: SensorMount = field(default_factory=SensorMount)
    fly_by_line: bool = False
    """The flight is in the frame of the line's wires, as the lidar sees them, and not where the
    autopilot's estimate has them. Not by default: its trials are not complete."""
    keep_out_m: Annotated[float, Field(ge=0.0, le=1e6)] = 0.5
    """Keep-out of obstacles that the site file lacks."""
    gate_m: Annotated[float, Field(gt=0.0, le=1e6)] = 2.0
    """Distance from a conductor of the site file within which a seen conductor counts as the
    same."""
    moved_m: Annotated[float, Field(gt=0.0, le=1e6)] = 0.5
    """Least difference from the site file's place that is reported to operators."""
    sight_m: Annotated[float, Field(gt=0.0, le=1e6)] = 8.0
    """Distance within which the sensor detects every unknown conductor: it limits the speed. A
    VLP-16 finds a cable of 15 mm from 10 m on, one of 10 mm from 5 m."""
    target_slack_m: Annotated[float, Field(ge=0.0, le=1e6)] = 2.0
    """Greatest distance by which a target is moved out of a seen obstacle's keep-out."""
    timeout_s: Annotated[float, Field(gt=0.0, le=3_600.0)] = 1.0
    """Time without a scan after which the sensor is lost."""
    late_s: Annotated[float, Field(gt=0.0, le=3_600.0)] = 0.5
    """Age of the newest scan at which the sensor is late; at most `timeout_s`."""
    least_returns: Annotated[float, Field(ge=0.0, le=1.0)] = 0.05
    """Share of a scan's beams with a return below which the sensor is blinded; near the ground it
    is half."""

    @property
    def data_port(self) -> int | None:
        """UDP port of the data packets; None without any."""
        return DATA_PORTS.get(self.sensor) if self.port is None and self.sensor else self.port


def perception_findings(section: Perception) -> Iterator[FileFinding]:
    """Errors across the keys of the section."""
    if section.sensor is Sensor.OUSTER and section.metadata is None:
        yield FileFinding(("perception", "metadata"), "is missing: sensor is 'ouster'")
    if section.late_s > section.timeout_s:
        problem = f"is {section.late_s:g}, must be at most timeout_s ({section.timeout_s:g})"
        yield FileFinding(("perception", "late_s"), problem)

"""The section `perception` of the configuration: the lidar, its mount, and use of its reports."""

from __future__ import annotations

import enum
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from pydantic import Field, Strict

from ..types import Vector
from .yaml_file import FileFinding
from .yaml_schema import Coordinate, FileModel, FilePath, Length, Name, PositiveLength

Port = Annotated[int, Field(ge=1, le=65_535)]
_Seconds = Annotated[float, Field(gt=0.0, le=3_600.0)]
_Angle = Annotated[float, Field(ge=-360.0, le=360.0)]


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
    """Mount of the sensor on the aircraft: forward, left, up in m; roll, pitch, yaw in degrees.

    From the sensor's axes to the aircraft's (x forward, y left, z up): first roll, then pitch, then
    yaw. By default the axis of rotation points to the aircraft's left: the scan is its x-z plane.
    """

    position_m: Vector = (0.0, 0.0, 0.0)
    roll_pitch_yaw_deg: Vector = (-90.0, 0.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Perception:
    """Sensor, and use of its reports; sensor None: no perception."""

    sensor: Sensor | None = None
    address: str = "0.0.0.0"  # noqa: S104 - the sensor broadcasts, or sends to any address of ours
    """Address of this computer at which the data packets arrive."""
    port: int | None = None
    """UDP port of the data packets; None: the sensor's usual one."""
    metadata: Path | None = None
    """Description of an Ouster, the file of its web page."""
    mount: SensorMount = field(default_factory=SensorMount)
    keep_out_m: float = 0.5
    """Keep-out of obstacles that the site file lacks."""
    gate_m: float = 2.0
    """Distance from a conductor of the site file within which a seen conductor counts as the
    same."""
    moved_m: float = 0.5
    """Least difference from the site file's place that is reported to operators."""
    sight_m: float = 8.0
    """Distance within which the sensor detects every unknown conductor: it limits the speed. A
    VLP-16 finds a cable of 15 mm from 10 m on, one of 10 mm from 5 m."""
    target_slack_m: float = 2.0
    """Greatest distance by which a target is moved out of a seen obstacle's keep-out."""
    timeout_s: float = 1.0
    """Time without a scan after which the sensor is lost."""
    late_s: float = 0.5
    """Age of the newest scan at which the sensor is late."""
    least_returns: float = 0.05
    """Share of a scan's beams with a return below which the sensor is blinded; near the ground it
    is half."""

    @property
    def data_port(self) -> int | None:
        """UDP port of the data packets; None without any."""
        return DATA_PORTS.get(self.sensor) if self.port is None and self.sensor else self.port


_Place = Annotated[list[Coordinate], Field(min_length=3, max_length=3)]
_Angles = Annotated[list[_Angle], Field(min_length=3, max_length=3)]


class _MountFile(FileModel):
    position_m: _Place = Field(default_factory=lambda: list(SensorMount().position_m))
    roll_pitch_yaw_deg: _Angles = Field(
        default_factory=lambda: list(SensorMount().roll_pitch_yaw_deg)
    )


class PerceptionFile(FileModel):
    """The section in the file; `Perception` defines the defaults."""

    sensor: Annotated[Sensor, Strict(strict=False)] | None = None
    address: Name = Perception().address
    port: Port | None = None
    metadata: FilePath | None = None
    mount: _MountFile = Field(default_factory=_MountFile)
    keep_out_m: Length = 0.5
    gate_m: PositiveLength = 2.0
    moved_m: PositiveLength = 0.5
    sight_m: PositiveLength = 8.0
    target_slack_m: Length = 2.0
    timeout_s: _Seconds = 1.0
    late_s: _Seconds = 0.5
    least_returns: Annotated[float, Field(ge=0.0, le=1.0)] = 0.05

    def settings(self, folder: Path) -> Perception:
        """The settings; relative paths are relative to the folder of the file."""
        forward_m, left_m, up_m = self.mount.position_m
        roll_deg, pitch_deg, yaw_deg = self.mount.roll_pitch_yaw_deg
        return Perception(
            **self.arguments(
                folder,
                mount=SensorMount(
                    position_m=(forward_m, left_m, up_m),
                    roll_pitch_yaw_deg=(roll_deg, pitch_deg, yaw_deg),
                ),
            )
        )


def perception_findings(section: PerceptionFile) -> Iterator[FileFinding]:
    """Errors across the keys of the section."""
    if section.sensor is Sensor.OUSTER and section.metadata is None:
        yield FileFinding(("perception", "metadata"), "is missing: sensor is 'ouster'")
    if section.late_s > section.timeout_s:
        problem = f"is {section.late_s:g}, must be at most timeout_s ({section.timeout_s:g})"
        yield FileFinding(("perception", "late_s"), problem)

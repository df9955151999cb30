"""Scene of the fake aircraft's lidar: a YAML file.

    name: one wire and a tree
    frame:
      origin: {latitude_deg: 45.3781, longitude_deg: -71.9295, altitude_amsl_m: 210.0}
      azimuth_deg: 90.0
    wires: [{start_m: [5, -150, 20], end_m: [5, 150, 20], sag_m: 8, diameter_m: 0.03}]
    trees: [{centre_m: [-9, 2, 5], radius_m: 3}]
    rain_per_m: 0.002

Metres in the frame: x along the azimuth, z up, y across, to the left of x. Inputs: the file.
Outputs: a `PlacedScene`; and back, its file.
"""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Final

import yaml
from pydantic import BaseModel, ConfigDict, Field, Strict, model_validator

from sitl.geodesy import Geodetic
from sitl.lidar import Box, LidarScene, Prism, Tree, Wire
from sitl.yaml_input import load_yaml, validated

_LEAST_WIRE_M: Final = 0.1
_Length = Annotated[float, Field(ge=-10_000.0, le=10_000.0)]
_Point = Annotated[tuple[_Length, _Length, _Length], Strict(strict=False)]
_Corner = Annotated[tuple[_Length, _Length], Strict(strict=False)]
_Angle = Annotated[float, Field(ge=-360.0, le=360.0)]
_Angles = Annotated[tuple[_Angle, _Angle, _Angle], Strict(strict=False)]
_Share = Annotated[float, Field(ge=0.0, le=1.0)]


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class _Origin(_Model):
    latitude_deg: Annotated[float, Field(ge=-89.0, le=89.0)]
    longitude_deg: Annotated[float, Field(ge=-180.0, le=180.0)]
    altitude_amsl_m: _Length


class _Frame(_Model):
    origin: _Origin
    azimuth_deg: _Angle


class _Wire(_Model):
    start_m: _Point
    end_m: _Point
    sag_m: Annotated[float, Field(ge=0.0, le=1_000.0)] = 0.0
    diameter_m: Annotated[float, Field(gt=0.0, le=2.0)] = Wire(
        start_m=(0, 0, 0), end_m=(0, 0, 0)
    ).diameter_m

    @model_validator(mode="after")
    def _has_length(self) -> "_Wire":
        if sum((a - b) ** 2 for a, b in zip(self.start_m, self.end_m, strict=True)) < (
            _LEAST_WIRE_M**2
        ):
            raise ValueError(f"end_m must be at least {_LEAST_WIRE_M} m from start_m")
        return self


class _Tree(_Model):
    centre_m: _Point
    radius_m: Annotated[float, Field(gt=0.0, le=100.0)]
    density_per_m: Annotated[float, Field(gt=0.0, le=1_000.0)] = Tree(
        centre_m=(0, 0, 0), radius_m=1
    ).density_per_m


class _Box(_Model):
    lower_m: _Point
    upper_m: _Point

    @model_validator(mode="after")
    def _has_volume(self) -> "_Box":
        if not all(low < high for low, high in zip(self.lower_m, self.upper_m, strict=True)):
            raise ValueError("each of lower_m must be less than that of upper_m")
        return self


class _Prism(_Model):
    vertices_m: Annotated[list[_Corner], Field(min_length=3, max_length=1_000)]
    lower_y_m: _Length
    upper_y_m: _Length

    @model_validator(mode="after")
    def _has_depth(self) -> "_Prism":
        if not self.lower_y_m < self.upper_y_m:
            raise ValueError("lower_y_m must be less than upper_y_m")
        return self


class _Mount(_Model):
    position_m: _Point = (0.0, 0.0, 0.0)
    roll_pitch_yaw_deg: _Angles = (-90.0, 0.0, 0.0)


class _File(_Model):
    name: str
    frame: _Frame
    mount: _Mount = _Mount()
    wires: list[_Wire] = []
    trees: list[_Tree] = []
    boxes: list[_Box] = []
    prisms: list[_Prism] = []
    ground_m: _Length | None = LidarScene().ground_m
    noise_m: Annotated[float, Field(ge=0.0, le=10.0)] = LidarScene().noise_m
    dropout: _Share = LidarScene().dropout
    rain_per_m: Annotated[float, Field(ge=0.0, le=100.0)] = LidarScene().rain_per_m


@dataclass(frozen=True, kw_only=True)
class LidarMount:
    """Mount of the lidar on the aircraft: forward, left, up in m; roll, pitch, yaw in degrees.

    From the sensor's axes to the aircraft's: first roll, then pitch, then yaw. By default the axis
    of rotation points to the aircraft's left.
    """

    position_m: tuple[float, float, float] = _Mount().position_m
    roll_pitch_yaw_deg: tuple[float, float, float] = _Mount().roll_pitch_yaw_deg


@dataclass(frozen=True, kw_only=True)
class PlacedScene:
    """A scene, its place on the earth, and the mount of its lidar."""

    name: str
    origin: Geodetic
    azimuth_deg: float
    scene: LidarScene
    mount: LidarMount = LidarMount()

    @staticmethod
    def load(path: Path) -> "PlacedScene":
        """Read a file; a `BadInputError` names file, key, value and the allowed values."""
        return PlacedScene.parse(load_yaml(path), str(path))

    @staticmethod
    def parse(data: object, source: str) -> "PlacedScene":
        """Build a scene from YAML data; `source` names the file in errors."""
        read = validated(_File, data, source)
        return PlacedScene(
            name=read.name,
            origin=Geodetic(**read.frame.origin.model_dump()),
            azimuth_deg=read.frame.azimuth_deg,
            mount=LidarMount(**read.mount.model_dump()),
            scene=LidarScene(
                wires=tuple(Wire(**each.model_dump()) for each in read.wires),
                trees=tuple(Tree(**each.model_dump()) for each in read.trees),
                boxes=tuple(Box(**each.model_dump()) for each in read.boxes),
                prisms=tuple(
                    Prism(
                        vertices_m=tuple(each.vertices_m),
                        lower_y_m=each.lower_y_m,
                        upper_y_m=each.upper_y_m,
                    )
                    for each in read.prisms
                ),
                ground_m=read.ground_m,
                noise_m=read.noise_m,
                dropout=read.dropout,
                rain_per_m=read.rain_per_m,
            ),
        )

    def text(self) -> str:
        """The file of this scene."""
        document: dict[str, Any] = {
            "name": self.name,
            "frame": {
                "origin": dataclasses.asdict(self.origin), "azimuth_deg": self.azimuth_deg
            },
            "mount": dataclasses.asdict(self.mount),
            **dataclasses.asdict(self.scene),
        }  # fmt: skip
        text: str = yaml.safe_dump(document, sort_keys=False, default_flow_style=None)
        return text

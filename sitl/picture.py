"""A picture of the site from a true pose: pinhole projection, blur, and a small drawing. Pure.

The scene is in the frame of a site file: x along the azimuth, y to the left of it, z up. The
camera's axes are forward, right, down; a point's place in the picture is in parts of its width and
height, from the middle to the right and down.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt
import yaml
from pydantic import TypeAdapter, ValidationError

from sitl.geodesy import Geodetic
from sitl.yaml_input import BadInputError, load_yaml

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Lens:
    """A camera with a full-frame sensor, 24 mm wide-angle lens by default."""

    width_px: int = 4000
    height_px: int = 3000
    field_of_view_deg: float = 70.0
    """Of the width."""
    exposure_s: float = 1.0 / 500.0

    @property
    def focal_px(self) -> float:
        """Focal length in pixels."""
        return self.width_px / (2.0 * math.tan(math.radians(self.field_of_view_deg) / 2.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class PictureScene:
    """What the camera sees: wires across the plane, and named points, as splices."""

    name: str
    origin: Geodetic
    azimuth_deg: float
    wires: tuple[tuple[float, float, float], ...]
    """x, z and diameter of each, in metres."""
    points: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """x and z of each."""

    @classmethod
    def load(cls, path: Path) -> "PictureScene":
        """The scene of a YAML file with these keys; BadInputError when it cannot be used."""
        try:
            return _SCENE.validate_python(load_yaml(path))
        except ValidationError as error:
            detail = error.errors()[0]
            key = ".".join(map(str, detail["loc"])) or "file"
            raise BadInputError(f"{path}: {key}: {detail['msg']}") from None

    def text(self) -> str:
        """The file."""
        return yaml.safe_dump(_SCENE.dump_python(self, mode="json"), sort_keys=False)


_SCENE = TypeAdapter(PictureScene)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CameraPose:
    """True pose and motion of a camera in the site's frame.

    position_m      (3,)
    axes            (3, 3)  rows: the camera's forward, right, down axes
    turn_rate_radps (3,)    about these axes
    velocity_mps    (3,)
    """

    position_m: FloatArray
    axes: FloatArray
    turn_rate_radps: FloatArray
    velocity_mps: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True)
class Sighting:
    """A point in a picture: (right, down) from the middle in parts of width and height; blur."""

    right: float
    down: float
    blur_px: float

    @property
    def in_middle_fifth(self) -> bool:
        """True within a tenth of width and height of the middle."""
        return abs(self.right) <= 0.1 and abs(self.down) <= 0.1


def seen(point_m: tuple[float, float, float], pose: CameraPose, lens: Lens) -> Sighting | None:
    """The point in the picture, also beyond its edges; None behind the camera."""
    forward, right, down = pose.axes @ (np.array(point_m) - pose.position_m)
    if forward <= 0.0:
        return None
    roll, pitch, yaw = pose.turn_rate_radps
    v_forward, v_right, v_down = -(pose.axes @ pose.velocity_mps)
    # Motion of the point in the camera's axes: by the camera's velocity and its rotation.
    v_forward -= pitch * down - yaw * right
    v_right -= yaw * forward - roll * down
    v_down -= roll * right - pitch * forward
    across = (v_right - right / forward * v_forward) / forward
    along = (v_down - down / forward * v_forward) / forward
    return Sighting(
        right=float(lens.focal_px * right / forward / lens.width_px),
        down=float(lens.focal_px * down / forward / lens.height_px),
        blur_px=float(lens.focal_px * math.hypot(across, along) * lens.exposure_s),
    )


def drawing(scene: PictureScene, pose: CameraPose, lens: Lens, width_px: int = 480) -> FloatArray:
    """The picture, (height, width, 3) from 0 to 1: sky, ground, wires, splices; blurred."""
    height_px = width_px * lens.height_px // lens.width_px
    focal = lens.focal_px * width_px / lens.width_px
    rows, columns = np.mgrid[0:height_px, 0:width_px]
    right = (columns + 0.5 - width_px / 2.0) / focal
    down = (rows + 0.5 - height_px / 2.0) / focal
    rays = pose.axes[0] + right[..., None] * pose.axes[1] + down[..., None] * pose.axes[2]
    image = np.where(rays[..., 2:] > 0.0, (0.72, 0.82, 0.93), (0.45, 0.48, 0.36))
    image = np.asarray(image, dtype=float)
    order = sorted(
        scene.wires,
        key=lambda wire: -math.dist(wire[:2], (pose.position_m[0], pose.position_m[2])),
    )
    for x_m, z_m, diameter_m in order:
        _draw_wire(image, rays, pose.position_m, (x_m, z_m), diameter_m, scene)
    blur = max(
        (
            sighting.blur_px * width_px / lens.width_px
            for x_m, z_m in scene.points.values()
            if (sighting := seen((x_m, 0.0, z_m), pose, lens)) is not None
        ),
        default=0.0,
    )
    steps = min(25, round(blur))
    if steps > 1:
        image = np.mean([np.roll(image, step - steps // 2, axis=1) for step in range(steps)], 0)
    return image


def _draw_wire(
    image: FloatArray,
    rays: FloatArray,
    from_m: FloatArray,
    wire_m: tuple[float, float],
    diameter_m: float,
    scene: PictureScene,
) -> None:
    """Colours the pixels whose rays pass a wire along y: grey, a splice as a thick dark sleeve."""
    across = rays[..., [0, 2]]
    square = np.maximum((across**2).sum(-1), 1e-12)
    to_wire = np.array(wire_m) - from_m[[0, 2]]
    along = across @ to_wire / square
    miss_m = np.abs(across[..., 0] * to_wire[1] - across[..., 1] * to_wire[0]) / np.sqrt(square)
    y_m = from_m[1] + along * rays[..., 1]
    pixel_m = along / image.shape[1]
    ahead = along > 0.0
    hit = ahead & (miss_m <= np.maximum(0.5 * diameter_m, pixel_m))
    image[hit] = (0.30, 0.30, 0.33)
    for point_m in scene.points.values():
        if math.dist(point_m, wire_m) < 0.5:
            sleeve = ahead & (np.abs(y_m) <= 0.35)
            image[sleeve & (miss_m <= 1.6 * diameter_m)] = (0.62, 0.22, 0.12)

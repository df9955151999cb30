"""A simulated VLP-16: rays against wires, trees, solids and the ground, as Velodyne data packets.

Geometry, timing and packet format: VLP-16 User Manual 63-9243 Rev. E, sections 6 and 9. A wire is
thinner than the beam, so that thin conductors are visible only nearby (`visible_m`).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sitl.lidar_rays import (
    APERTURE_M,
    DIVERGENCE_RAD,
    LEAST_SHARE,
    SEQUENCE_S,
    SEQUENCES,
    FloatArray,
    SceneArrays,
    ranges,
)

PACKET_BYTES = 1206
PORT = 2368
PACKET_S = SEQUENCES * SEQUENCE_S
_STEP_M = 0.002
_BLOCKS = 12
_PIECES = 24
_REFLECTIVITY = 10
_HOUR_US = 3_600_000_000
_STRONGEST_RETURN, _VLP16 = 0x37, 0x22

_BLOCK = np.dtype(
    [
        ("flag", "<u2"),
        ("azimuth", "<u2"),
        ("channels", np.dtype([("steps", "<u2"), ("reflectivity", "u1")]), 32),
    ]
)
_PACKET = np.dtype(
    [("blocks", _BLOCK, _BLOCKS), ("time_us", "<u4"), ("mode", "u1"), ("model", "u1")]
)

PoseAt = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""Pose function: (n,) times to positions (n, 3), and rotations (n, 3, 3) from sensor to world.

The sensor's x points to azimuth 0, y to the left, z along the axis of its rotation.
"""


@dataclass(frozen=True, kw_only=True)
class Wire:
    """A conductor between two points, with sag at the middle, all in m."""

    start_m: tuple[float, float, float]
    end_m: tuple[float, float, float]
    sag_m: float = 0.0
    diameter_m: float = 0.03

    @property
    def visible_m(self) -> float:
        """Greatest distance with returns."""
        return (self.diameter_m / LEAST_SHARE - APERTURE_M) / DIVERGENCE_RAD

    def ends(self) -> FloatArray:
        """Ends (n + 1, 3) of the straight pieces of the wire, 24 pieces for a wire with sag."""
        count = _PIECES if self.sag_m else 1
        share = np.linspace(0.0, 1.0, count + 1)[:, None]
        places: FloatArray = np.array(self.start_m) * (1.0 - share) + np.array(self.end_m) * share
        places[:, 2] -= 4.0 * self.sag_m * (share * (1.0 - share))[:, 0]
        return places


@dataclass(frozen=True, kw_only=True)
class Tree:
    """Leaves in a ball. density_per_m: chance of a hit per metre of ray."""

    centre_m: tuple[float, float, float]
    radius_m: float
    density_per_m: float = 1.5


@dataclass(frozen=True, kw_only=True)
class Prism:
    """A solid: a polygon of the x-z plane, drawn out along y."""

    vertices_m: tuple[tuple[float, float], ...]
    lower_y_m: float
    upper_y_m: float


@dataclass(frozen=True, kw_only=True)
class Box:
    """A solid between two corners."""

    lower_m: tuple[float, float, float]
    upper_m: tuple[float, float, float]

    @property
    def prism(self) -> Prism:
        """The box as a prism."""
        (x, y, z), (x2, y2, z2) = self.lower_m, self.upper_m
        corners = ((x, z), (x2, z), (x2, z2), (x, z2))
        return Prism(vertices_m=corners, lower_y_m=y, upper_y_m=y2)


@dataclass(frozen=True, kw_only=True)
class LidarScene:
    """Objects around the lidar. rain_per_m: chance of a drop's return per metre, within 10 m."""

    wires: tuple[Wire, ...] = ()
    trees: tuple[Tree, ...] = ()
    boxes: tuple[Box, ...] = ()
    prisms: tuple[Prism, ...] = ()
    ground_m: float | None = 0.0
    noise_m: float = 0.02
    dropout: float = 0.02
    rain_per_m: float = 0.0


class SimulatedLidar:
    """A VLP-16 in a scene. The same seed and calls give the same packets."""

    def __init__(self, scene: LidarScene, seed: int = 0, rpm: float = 600.0) -> None:
        self._random = np.random.default_rng(seed)
        self._turn_rad_s = rpm / 60.0 * 2.0 * math.pi
        self.show(scene)

    def show(self, scene: LidarScene) -> None:
        """Take another scene."""
        self._arrays = _arrays(scene)
        ground_m = math.nan if scene.ground_m is None else float(scene.ground_m)
        self._air = (
            ground_m, float(scene.noise_m), float(scene.dropout), float(scene.rain_per_m)
        )  # fmt: skip

    def packet(self, time_s: float, pose_at: PoseAt) -> bytes:
        """The data packet with its first firing at a time: 24 sequences of 16 lasers."""
        return self.packets(np.array([time_s]), pose_at)[0]

    def packets(self, times_s: FloatArray, pose_at: PoseAt) -> list[bytes]:
        """The data packets with their first firings at times (k,); a pose for each sequence."""
        sequences = times_s[:, None] + np.arange(SEQUENCES) * SEQUENCE_S
        origins, turns = pose_at(sequences.reshape(-1))
        azimuths = self._turn_rad_s * times_s % (2.0 * math.pi)
        measured = ranges(
            self._arrays,
            self._air,
            origins.reshape(-1, SEQUENCES, 3),
            turns.reshape(-1, SEQUENCES, 3, 3),
            azimuths,
            self._turn_rad_s,
            self._random,
        )
        return self._encoded(times_s, azimuths, measured)

    def _encoded(
        self, times_s: FloatArray, azimuths: FloatArray, ranges_m: FloatArray
    ) -> list[bytes]:
        packets = np.zeros(len(times_s), _PACKET)
        blocks = packets["blocks"]
        blocks["flag"] = 0xEEFF
        begins_s = np.arange(_BLOCKS) * (SEQUENCES // _BLOCKS * SEQUENCE_S)
        turned = np.degrees(azimuths[:, None] + self._turn_rad_s * begins_s)
        blocks["azimuth"] = np.round(turned * 100.0).astype(int) % 36_000
        steps = np.round(ranges_m / _STEP_M).astype(int).reshape(-1, _BLOCKS, 32)
        blocks["channels"]["steps"] = steps
        blocks["channels"]["reflectivity"] = np.where(steps > 0, _REFLECTIVITY, 0)
        packets["time_us"] = (times_s * 1e6).astype(np.int64) % _HOUR_US
        packets["mode"], packets["model"] = _STRONGEST_RETURN, _VLP16
        return [packet.tobytes() for packet in packets]


def _arrays(scene: LidarScene) -> SceneArrays:
    pieces = [
        np.column_stack(
            (
                ends[:-1],
                np.diff(ends, axis=0) / lengths[:, None],
                lengths,
                np.full(len(lengths), wire.diameter_m),
            )
        )
        for wire in scene.wires
        for ends in (wire.ends(),)
        for lengths in (np.linalg.norm(np.diff(ends, axis=0), axis=1),)
    ]
    prisms = [*scene.prisms, *(box.prism for box in scene.boxes)]
    corners = [np.array(prism.vertices_m, float) for prism in prisms]
    return SceneArrays(
        pieces=np.vstack(pieces) if pieces else np.empty((0, 8)),
        trees=np.array(
            [(*tree.centre_m, tree.radius_m, tree.density_per_m) for tree in scene.trees], float
        ).reshape(-1, 5),
        solids=np.array([_solid(prism) for prism in prisms], float).reshape(-1, 6),
        corners=np.vstack(corners) if corners else np.empty((0, 2)),
        first=np.cumsum([0, *(len(each) for each in corners)], dtype=np.int64),
    )


def _solid(prism: Prism) -> tuple[float, ...]:
    """Least and greatest y; centre and radius of a ball around the solid."""
    corners = np.array(prism.vertices_m, float)
    low, high = corners.min(axis=0), corners.max(axis=0)
    x_m, z_m = (low + high) / 2.0
    y_m = (prism.lower_y_m + prism.upper_y_m) / 2.0
    radius_m = math.hypot(*(high - low), prism.upper_y_m - prism.lower_y_m) / 2.0
    return prism.lower_y_m, prism.upper_y_m, float(x_m), y_m, float(z_m), radius_m

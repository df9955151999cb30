"""A simulated VLP-16: rays against wires, trees, boxes and the ground, as Velodyne data packets.

Geometry, timing and packet format: VLP-16 User Manual 63-9243 Rev. E, sections 6 and 9. A wire is
thinner than the beam: the less of it the beam meets, the less comes back, so that thin conductors
are seen only near (`visible_m`).
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]

PACKET_BYTES = 1206
PORT = 2368
_ELEVATIONS_DEG = np.array([-15, 1, -13, 3, -11, 5, -9, 7, -7, 9, -5, 11, -3, 13, -1, 15.0])
_FIRING_S, _SEQUENCE_S = 2.304e-6, 55.296e-6
_SEQUENCES = 24
PACKET_S = _SEQUENCES * _SEQUENCE_S
_RANGE_M, _LEAST_RANGE_M = 100.0, 0.5
_STEP_M = 0.002
_DIVERGENCE_RAD, _APERTURE_M = 3.0e-3, 0.0095
"""Horizontal divergence, and width of the beam at the sensor."""
_LEAST_SHARE = 0.35
"""Share of the beam's width that has to meet a wire for a return, at a reflectivity of 10 %."""

PoseAt = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""(n,) times to positions (n, 3), and rotations (n, 3, 3) from the sensor to the world.

The sensor's x points where its azimuth is 0, y to the left, z along the axis of its rotation.
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
        """Distance up to which it gives returns."""
        return (self.diameter_m / _LEAST_SHARE - _APERTURE_M) / _DIVERGENCE_RAD

    def segments(self) -> tuple[FloatArray, FloatArray]:
        """Ends (n, 3) of straight pieces, 24 of a wire that sags."""
        count = 24 if self.sag_m else 1
        share = np.linspace(0.0, 1.0, count + 1)[:, None]
        places = np.array(self.start_m) * (1.0 - share) + np.array(self.end_m) * share
        places[:, 2] -= 4.0 * self.sag_m * (share * (1.0 - share))[:, 0]
        return places[:-1], places[1:]


@dataclass(frozen=True, kw_only=True)
class Tree:
    """Leaves in a ball. density_per_m: chance of a hit per metre of ray."""

    centre_m: tuple[float, float, float]
    radius_m: float
    density_per_m: float = 1.5


@dataclass(frozen=True, kw_only=True)
class Box:
    """A solid between two corners."""

    lower_m: tuple[float, float, float]
    upper_m: tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class LidarScene:
    """What stands around. rain_per_m: chance of a drop's return per metre, within 10 m."""

    wires: tuple[Wire, ...] = ()
    trees: tuple[Tree, ...] = ()
    boxes: tuple[Box, ...] = ()
    ground_m: float | None = 0.0
    noise_m: float = 0.02
    dropout: float = 0.02
    rain_per_m: float = 0.0


class SimulatedLidar:
    """A VLP-16 at 600 rpm that looks at a scene."""

    def __init__(self, scene: LidarScene, seed: int = 0, rpm: float = 600.0) -> None:
        self._scene = scene
        self._random = np.random.default_rng(seed)
        self._turn_rad_s = rpm / 60.0 * 2.0 * math.pi
        pieces = [wire.segments() for wire in scene.wires]
        self._pieces = [
            (start, end - start, wire)
            for wire, (starts, ends) in zip(scene.wires, pieces, strict=True)
            for start, end in zip(starts, ends, strict=True)
        ]

    def packet(self, time_s: float, pose_at: PoseAt) -> bytes:
        """The data packet whose first firing is at a time: 24 sequences of 16 lasers."""
        sequence = np.arange(_SEQUENCES)[:, None] * _SEQUENCE_S
        times = time_s + sequence + np.arange(16)[None, :] * _FIRING_S
        azimuth = self._turn_rad_s * times
        elevation = np.broadcast_to(np.radians(_ELEVATIONS_DEG), azimuth.shape)
        ways = np.stack(
            (
                np.cos(elevation) * np.cos(azimuth),
                -np.cos(elevation) * np.sin(azimuth),
                np.sin(elevation),
            ),
            axis=-1,
        ).reshape(-1, 3)
        origins, turns = pose_at(times.reshape(-1))
        ranges = self.ranges(origins, np.einsum("nij,nj->ni", turns, ways))
        return self._encoded(azimuth[:, 0], ranges.reshape(_SEQUENCES, 16), time_s)

    def ranges(self, origins_m: FloatArray, ways: FloatArray) -> FloatArray:
        """(n,) measured range along unit vectors (n, 3); 0 without a return."""
        nearest = np.full(len(ways), np.inf)
        scene = self._scene
        if scene.ground_m is not None:
            with np.errstate(divide="ignore"):
                down = (scene.ground_m - origins_m[:, 2]) / ways[:, 2]
            nearest = np.where((down > 0.0) & np.isfinite(down), down, nearest)
        for box in scene.boxes:
            nearest = np.minimum(nearest, _to_box(box, origins_m, ways))
        for tree in scene.trees:
            nearest = np.minimum(nearest, self._to_leaf(tree, origins_m, ways))
        for start, extent, wire in self._pieces:
            nearest = np.minimum(nearest, _to_wire(start, extent, wire, origins_m, ways))
        if scene.rain_per_m:
            drop = self._random.exponential(1.0 / scene.rain_per_m, len(ways))
            nearest = np.where((drop < nearest) & (drop < 10.0), drop, nearest)
        measured = nearest + self._random.normal(0.0, scene.noise_m, len(ways))
        lost = self._random.uniform(size=len(ways)) < scene.dropout
        seen = np.isfinite(nearest) & (measured > _LEAST_RANGE_M) & (measured < _RANGE_M) & ~lost
        return np.where(seen, measured, 0.0)

    def _to_leaf(self, tree: Tree, origins_m: FloatArray, ways: FloatArray) -> FloatArray:
        offset = np.array(tree.centre_m) - origins_m
        along = (offset * ways).sum(axis=1)
        inside = tree.radius_m**2 - ((offset**2).sum(axis=1) - along**2)
        half = np.sqrt(np.maximum(inside, 0.0))
        entry = np.maximum(along - half, 0.0)
        hit = entry + self._random.exponential(1.0 / tree.density_per_m, len(ways))
        return np.where((inside > 0.0) & (hit < along + half), hit, np.inf)

    def _encoded(self, azimuth_rad: FloatArray, ranges_m: FloatArray, time_s: float) -> bytes:
        blocks = []
        steps = np.round(ranges_m / _STEP_M).astype(int)
        for block in range(12):
            turned = round(math.degrees(azimuth_rad[2 * block]) * 100.0) % 36_000
            channels = steps[2 * block : 2 * block + 2].reshape(-1)
            blocks.append(
                struct.pack("<HH", 0xEEFF, turned)
                + b"".join(struct.pack("<HB", step, 10 if step else 0) for step in channels)
            )
        microseconds = int(time_s * 1e6) % 3_600_000_000
        return b"".join(blocks) + struct.pack("<IBB", microseconds, 0x37, 0x22)


def _to_wire(
    start: FloatArray, extent: FloatArray, wire: Wire, origins_m: FloatArray, ways: FloatArray
) -> FloatArray:
    """Range to where rays pass a straight piece within half its width and the beam's."""
    length = float(np.linalg.norm(extent))
    along = extent / length
    offset = origins_m - start
    dot = ways @ along
    ways_across = ways - dot[:, None] * along
    offset_across = offset - (offset @ along)[:, None] * along
    square = np.maximum((ways_across**2).sum(axis=1), 1e-12)
    reach = -(ways_across * offset_across).sum(axis=1) / square
    miss = np.linalg.norm(offset_across + reach[:, None] * ways_across, axis=1)
    place = (offset + reach[:, None] * ways) @ along
    beam = (_APERTURE_M + _DIVERGENCE_RAD * np.maximum(reach, 0.0)) / 2.0
    met = np.minimum(miss + wire.diameter_m / 2.0, beam) - np.maximum(
        miss - wire.diameter_m / 2.0, -beam
    )
    seen = (reach > 0.0) & (place >= 0.0) & (place < length) & (met / (2.0 * beam) >= _LEAST_SHARE)
    return np.where(seen, reach, np.inf)


def _to_box(box: Box, origins_m: FloatArray, ways: FloatArray) -> FloatArray:
    with np.errstate(divide="ignore", invalid="ignore"):
        first = (np.array(box.lower_m) - origins_m) / ways
        second = (np.array(box.upper_m) - origins_m) / ways
    enter = np.nanmax(np.minimum(first, second), axis=1)
    leave = np.nanmin(np.maximum(first, second), axis=1)
    return np.where((enter <= leave) & (enter > 0.0), enter, np.inf)

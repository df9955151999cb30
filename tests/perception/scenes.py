"""Point clouds of power lines, made for tests: the true place of every object is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Wire:
    """A conductor: lateral position, height of its lowest point, catenary constant."""

    lateral_m: float
    lowest_m: float
    constant_m: float = 1200.0
    bundle_m: float = 0.0
    """Distance of two sub-conductors, side by side; 0: one."""
    per_m: float = 8.0
    """Points per metre."""


DOUBLE_CIRCUIT = tuple(
    Wire(lateral_m=side * half, lowest_m=height)
    for side in (-1.0, 1.0)
    for half, height in ((5.8, 12.0), (7.7, 19.0), (5.8, 26.0))
)


class Scene:
    """Points of a span from 0 to `length_m` along a direction, on flat ground, and their origin.

    labels: number of the wire; -1 ground, -2 trees, -3 tower.
    """

    def __init__(self, seed: int = 0, *, length_m: float = 200.0, azimuth_deg: float = 30.0):
        self.random = np.random.default_rng(seed)
        self.length_m = length_m
        turn = np.radians(azimuth_deg)
        self.along = np.array([np.sin(turn), np.cos(turn)])
        self.left = np.array([-self.along[1], self.along[0]])
        self.points, self.labels = [np.zeros((0, 3))], [np.zeros(0, dtype=int)]

    def with_wires(self, wires, noise_m=0.03, swing_m=0.0, start_m=0.0, end_m=None):
        for number, wire in enumerate(wires):
            end = self.length_m if end_m is None else end_m
            count = int((end - start_m) * wire.per_m)
            along = self.random.uniform(start_m, end, count)
            lateral = np.full(count, wire.lateral_m)
            lateral += self.random.choice((-0.5, 0.5), count) * wire.bundle_m
            lateral += swing_m * (1.0 - (2.0 * along / self.length_m - 1.0) ** 2)
            self._add(along, lateral, self.height(wire, along), number, noise_m)
        return self

    def height(self, wire, along):
        offset = along - self.length_m / 2.0
        return wire.lowest_m + wire.constant_m * (np.cosh(offset / wire.constant_m) - 1.0)

    def with_ground(self, per_m2=1.0, width_m=60.0):
        count = int(per_m2 * self.length_m * width_m)
        along = self.random.uniform(0.0, self.length_m, count)
        lateral = self.random.uniform(-width_m / 2.0, width_m / 2.0, count)
        self._add(along, lateral, np.zeros(count), -1, 0.05)
        return self

    def with_tree(self, along_m, lateral_m, height_m, radius_m=3.0, count=1500):
        centre = np.array([along_m, lateral_m, height_m * 0.6])
        size = np.array([radius_m, radius_m, height_m * 0.4])
        inside = self.random.normal(size=(count, 3))
        inside /= np.linalg.norm(inside, axis=1)[:, None]
        inside = centre + inside * size * self.random.uniform(0.0, 1.0, (count, 1)) ** (1 / 3)
        self._add(*inside.T, -2, 0.02)
        return self

    def with_tower(self, along_m, top_m=32.0, half_width_m=4.0):
        height = self.random.uniform(0.0, top_m, 600)
        edge = self.random.choice((-1.0, 1.0), 600) * half_width_m * (1.0 - 0.7 * height / top_m)
        self._add(along_m + self.random.uniform(-1.0, 1.0, 600), edge, height, -3, 0.02)
        for level in (12.0, 19.0, 26.0):
            across = self.random.uniform(-8.0, 8.0, 120)
            self._add(np.full(120, along_m), across, np.full(120, level + 6.0), -3, 0.05)
        return self

    def with_outliers(self, count, low=(0.0, -15.0, 5.0), high=(None, 15.0, 40.0)):
        high = (self.length_m, *high[1:])
        self._add(*self.random.uniform(low, high, (count, 3)).T, -2, 0.0)
        return self

    def _add(self, along, lateral, up, label, noise_m):
        horizontal = np.outer(along, self.along) + np.outer(lateral, self.left)
        points = np.column_stack((horizontal, up))
        self.points.append(points + self.random.normal(0.0, noise_m, points.shape))
        self.labels.append(np.full(len(points), label))

    @property
    def cloud(self):
        return np.vstack(self.points)

    @property
    def label(self):
        return np.concatenate(self.labels)

    def place(self, along_m, lateral_m, up_m):
        return np.array([*(along_m * self.along + lateral_m * self.left), up_m])

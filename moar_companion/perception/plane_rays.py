"""Rays of a sensor in the plane of the site: the free distance by direction."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]
BoolArray = npt.NDArray[np.bool_]

SLAB_M = 2.5
"""Half the thickness of the plane, for a large aircraft with its errors. The aircraft does not meet
obstacles beside the slab."""
_REACH_M = 60.0


@dataclass(frozen=True, kw_only=True, eq=False)
class PlaneRays:
    """Rays from one place in the plane, by their direction in it.

    centre_m: (2,) of the sensor. sector: (n,) number of the direction; sectors: number in a full
    turn. distance_m: (n,) measured, in the plane. reach_m: (n,) length of the ray within the slab,
    at most the distance. inside: (n,) points within the slab.
    """

    centre_m: FloatArray
    sectors: int
    sector: IntArray
    distance_m: FloatArray
    reach_m: FloatArray
    inside: BoolArray

    @classmethod
    def of(cls, points_m: FloatArray, sensor_m: FloatArray, sectors: int) -> PlaneRays:
        """Rays from (3,) to points (n, 3), in the site's frame."""
        x, y, z = (points_m - sensor_m).T
        distance = np.sqrt(x * x + z * z)
        inside = abs(points_m[:, 1]) <= SLAB_M
        room = np.maximum(SLAB_M - np.sign(y) * sensor_m[1], 0.0)
        share = np.minimum(room / np.maximum(abs(y), 1e-9), 1.0)
        if abs(sensor_m[1]) > SLAB_M:
            share = np.zeros_like(y)
        return cls(
            centre_m=sensor_m[[0, 2]],
            sectors=sectors,
            sector=sector_of(x, z, sectors),
            distance_m=distance,
            reach_m=share * distance,
            inside=inside,
        )

    def passing(self, step_m: float, before_m: float) -> IntArray:
        """Number (sectors, k) of rays that reach beyond k steps, and `before_m` more."""
        count = math.ceil(_REACH_M / step_m)
        steps = np.clip((self.reach_m - before_m) / step_m, 0.0, count - 1).astype(np.intp)
        ends = np.bincount(self.sector * count + steps, minlength=self.sectors * count)
        upto = ends.reshape(self.sectors, count).cumsum(axis=1)
        return np.asarray(upto[:, -1:] - upto)

    def nearest_m(self, among: BoolArray) -> FloatArray:
        """Least distance (sectors,) of some of the points; infinite without one."""
        found = np.full(self.sectors, np.inf)
        np.minimum.at(found, self.sector[among], self.distance_m[among])
        return found


def sector_of(x: FloatArray, z: FloatArray, sectors: int) -> IntArray:
    """Number of the direction (x, z), from 0 on."""
    turn = np.arctan2(z, x) * (sectors / (2.0 * math.pi))
    return np.asarray(np.floor(turn).astype(np.intp) % sectors)

"""Conductors in single scans of a lidar whose scan plane stands across the line.

Every laser crosses every conductor: a conductor is a row of narrow echoes, one or two beams wide,
on a line along the axis of rotation. Narrow echoes are looked for ring by ring; lines through them
by RANSAC, as in the paper. What is seen again and again at one place is a conductor:
`conductor_tracks`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

_GAP_RAD = math.radians(0.7)
"""Beams of one echo follow within this angle: three steps at 600 rpm."""
_STEP_M = 0.3
"""Ranges of one echo differ by less."""
_NARROW_M = 0.25
"""Greatest width of an echo of a wire or a twin bundle's half; wider ones are no conductor."""
_LEAST_RANGE_M, _GREATEST_RANGE_M = 1.0, 40.0
_PAIRS = 200
_MOST_ECHOES = 800
_RINGS_APART = 4
_TURNED_RAD = math.radians(15.0)
"""By which a conductor may be turned from the axis of rotation."""
_RADIUS_M = 0.12
"""Echoes of one conductor lie within this distance of its line."""
_AROUND_M = 0.6
_LEAST_RINGS = 6
_RING_SHARE = 0.6
"""Of the rings between the first and the last that see it."""
_LEAST_CLEAR = 0.6
"""Share of the echoes around that lie on the line: leaves are everywhere."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConductorSighting:
    """A line in one scan. point_m: (3,) nearest to the sensor; direction: (3,) unit vector."""

    point_m: FloatArray
    direction: FloatArray
    rings: int
    range_m: float

    def crossing_m(self, along_m: float = 0.0) -> tuple[float, float]:
        """Place (x, z) where it crosses the plane y = `along_m` of the site."""
        run_m = (along_m - self.point_m[1]) / self.direction[1]
        place_m = self.point_m + run_m * self.direction
        return float(place_m[0]), float(place_m[2])


def narrow_echoes(
    points_m: FloatArray, sensor_m: FloatArray, ring: IntArray, time_s: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Middles (k, 3) of echoes that are narrow, and their rings (k,).

    points_m: (n, 3) of one scan; sensor_m: (n, 3) where each was measured from.
    """
    offset = points_m - sensor_m
    ranges = np.sqrt((offset**2).sum(axis=1))
    order = np.lexsort((time_s, ring))
    offset, ranges, ring = offset[order], ranges[order], ring[order]
    ways = offset / np.maximum(ranges, 1e-6)[:, None]
    turned = np.sqrt(((ways[1:] - ways[:-1]) ** 2).sum(axis=1))
    apart = (ring[1:] != ring[:-1]) | (turned > _GAP_RAD)
    stepped = abs(np.diff(ranges)) > _STEP_M
    begins = np.concatenate(([True], apart | stepped))
    group = np.cumsum(begins) - 1
    count = np.bincount(group)
    starts = np.flatnonzero(begins)
    ends = np.append(starts[1:], len(group)) - 1
    width = np.sqrt(((offset[ends] - offset[starts]) ** 2).sum(axis=1))
    # An echo beside a nearer one may be the rest of something wide that this hides.
    nearest = np.minimum.reduceat(ranges, starts)
    before = np.concatenate(([np.inf], np.where(apart, np.inf, ranges[:-1])))[starts]
    after = np.concatenate((np.where(apart, np.inf, ranges[1:]), [np.inf]))[ends]
    in_front = (before > nearest) & (after > nearest)
    middle = np.column_stack(
        [np.bincount(group, points_m[order][:, axis]) / count for axis in range(3)]
    )
    good = (
        (width < _NARROW_M) & in_front & (nearest > _LEAST_RANGE_M) & (nearest < _GREATEST_RANGE_M)
    )
    return middle[good], ring[starts][good]


def sightings(
    echoes_m: FloatArray,
    ring: IntArray,
    sensor_m: FloatArray,
    axis: FloatArray,
    random: np.random.Generator,
) -> list[ConductorSighting]:
    """Lines through narrow echoes of many rings, best supported first.

    sensor_m: (3,) the sensor's place; axis: (3,) unit vector of its rotation.
    """
    if len(echoes_m) < _LEAST_RINGS:
        return []
    if len(echoes_m) > _MOST_ECHOES:
        kept = np.sort(random.choice(len(echoes_m), _MOST_ECHOES, replace=False))
        echoes_m, ring = echoes_m[kept], ring[kept]
    free = np.ones(len(echoes_m), dtype=bool)
    partners = _partners(echoes_m, ring, axis)
    found: list[ConductorSighting] = []
    while free.sum() >= _LEAST_RINGS:
        line = _best_line(echoes_m, ring, partners & free & free[:, None], random)
        if line is None:
            break
        at, way = line
        on = free & (_distance(echoes_m, at, way) < _RADIUS_M)
        centre = echoes_m[on].mean(axis=0)
        _, _, axes = np.linalg.svd(echoes_m[on] - centre, full_matrices=False)
        way = axes[0] * math.copysign(1.0, float(axes[0] @ axis))
        fitted = free & (_distance(echoes_m, centre, way) < _RADIUS_M)
        sighting = _judged(echoes_m, ring, fitted, centre, way, sensor_m)
        if sighting is not None:
            found.append(sighting)
        free &= ~(on | fitted)
    return found


def _partners(echoes_m: FloatArray, ring: IntArray, axis: FloatArray) -> BoolArray:
    """(k, k) pairs of echoes that may lie on one conductor: rings apart, along the axis."""
    along = echoes_m @ axis
    across = echoes_m - along[:, None] * axis
    across = across - across.mean(axis=0)
    square = (across**2).sum(axis=1)
    miss = square[:, None] + square[None] - 2.0 * across @ across.T
    run = abs(along[:, None] - along[None])
    allowed = _RADIUS_M + math.tan(_TURNED_RAD) * run
    return np.asarray((miss < allowed**2) & (abs(ring[:, None] - ring[None]) >= _RINGS_APART))


def _best_line(
    echoes_m: FloatArray, ring: IntArray, partners: BoolArray, random: np.random.Generator
) -> tuple[FloatArray, FloatArray] | None:
    """RANSAC: the line through two partners with echoes of most rings close to it."""
    support = partners.sum(axis=1)
    usable = np.flatnonzero(support >= _LEAST_RINGS - 1)
    if not len(usable):
        return None
    # The better the support, the likelier the choice.
    chance = support[usable].astype(float) ** 2
    first = random.choice(usable, _PAIRS, p=chance / chance.sum())
    rank = (random.uniform(size=_PAIRS) * support[first]).astype(np.intp)
    second = np.array(
        [np.flatnonzero(row)[n] for row, n in zip(partners[first], rank, strict=True)]
    )
    index = np.flatnonzero(partners.any(axis=1))
    at, way = echoes_m[first], echoes_m[second] - echoes_m[first]
    way /= np.sqrt((way**2).sum(axis=1))[:, None]
    centre = echoes_m[index].mean(axis=0)
    near, at_near = echoes_m[index] - centre, at - centre
    run = way @ near.T - (way * at_near).sum(axis=1)[:, None]
    square = (near**2).sum(axis=1)[None] + (at_near**2).sum(axis=1)[:, None]
    on = square - 2.0 * at_near @ near.T - run**2 < _RADIUS_M**2
    of_ring = (ring[index][:, None] == np.arange(ring.max() + 1)).astype(np.float32)
    rings = (on.astype(np.float32) @ of_ring > 0.0).sum(axis=1)
    best = int(np.argmax(rings))
    return (at[best], way[best]) if rings[best] >= _LEAST_RINGS else None


def _judged(
    echoes_m: FloatArray,
    ring: IntArray,
    on: BoolArray,
    centre: FloatArray,
    way: FloatArray,
    sensor_m: FloatArray,
) -> ConductorSighting | None:
    seen = np.unique(ring[on])
    if len(seen) < _LEAST_RINGS or len(seen) < _RING_SHARE * (seen[-1] - seen[0] + 1):
        return None
    run = (echoes_m - centre) @ way
    low, high = run[on].min(), run[on].max()
    beside = (run >= low) & (run <= high)
    around = beside & (_distance(echoes_m, centre, way) < _AROUND_M)
    if on.sum() < _LEAST_CLEAR * around.sum():
        return None
    nearest = centre + way * float((sensor_m - centre) @ way)
    return ConductorSighting(
        point_m=nearest,
        direction=way,
        rings=len(seen),
        range_m=float(np.linalg.norm(nearest - sensor_m)),
    )


def _distance(points_m: FloatArray, at_m: FloatArray, way: FloatArray) -> FloatArray:
    offset = points_m - at_m
    run = offset @ way
    return np.asarray(np.sqrt(np.maximum((offset**2).sum(axis=1) - run**2, 0.0)))

"""Conductors in single scans of a lidar whose scan plane stands across the line.

Every laser crosses every conductor: a conductor is a row of narrow echoes, one or two beams wide,
on a line along the axis of rotation. Narrow echoes are found ring by ring, and lines through them
by RANSAC, as in the paper. `conductor_tracks` confirms repeated sightings at one place as a
conductor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

_GAP_RAD = math.radians(0.7)
"""Greatest angle between beams of one echo: three steps at 600 rpm."""
_STEP_M = 0.3
"""Greatest difference in range between neighbouring beams of one echo."""
_NARROW_M = 0.25
"""Greatest width of an echo of a wire or of half a twin bundle."""
_LEAST_RANGE_M, _GREATEST_RANGE_M = 1.0, 40.0
_MOST_ECHOES = 1000
_RUN_SHARES = (0.1, 0.25)
"""Least and greatest distance of two echoes that define a line, per range: 6° to 14°."""
_NEAR_M = 3.0
"""Range below which the search may miss a line that is turned by the greatest angle."""
_TRIES = 4
"""Number of lines tried through each echo."""
_LEAST_SUPPORT = 4
"""Least number of an echo's partners on a line that is then fitted."""
_LEAST_ALONE = 0.35
"""Least share of the partners nearby that lie on the line; a bundle of four has more."""
_TURNED_RAD = math.radians(17.0)
"""Greatest angle between a conductor and the axis: 15° of the line, and its slope."""
_RADIUS_M = 0.12
"""Greatest distance of echoes of one conductor from its line."""
_AROUND_M = 0.6
LEAST_RINGS = 6
"""Least number of rings with echoes of a conductor."""
_RING_SHARE = 0.6
"""Least share of the rings between the first and the last with an echo."""
_LEAST_CLEAR = 0.6
"""Least share of the echoes nearby on the line or a parallel one; leaves scatter around it."""
_PARALLEL = 0.05


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ConductorSighting:
    """A line in one scan. point_m: (3,) nearest to the sensor; direction: (3,) unit vector."""

    point_m: FloatArray
    direction: FloatArray
    rings: int
    range_m: float

    def crossing_m(self, along_m: float = 0.0) -> tuple[float, float]:
        """Crossing (x, z) of the line with the plane y = `along_m` of the site."""
        run_m = (along_m - self.point_m[1]) / self.direction[1]
        place_m = self.point_m + run_m * self.direction
        return float(place_m[0]), float(place_m[2])


def narrow_echoes(
    points_m: FloatArray, sensor_m: FloatArray, ring: IntArray, time_s: FloatArray
) -> tuple[FloatArray, IntArray]:
    """Middles (k, 3) of echoes that are narrow, and their rings (k,).

    points_m: (n, 3) of one scan; sensor_m: (n, 3) place of the sensor at each.
    """
    offset = points_m - sensor_m
    ranges = _length(offset)
    order = np.lexsort((time_s, ring))
    offset, ranges, ring = offset[order], ranges[order], ring[order]
    beams = offset / np.maximum(ranges, 1e-6)[:, None]
    turned = _length(beams[1:] - beams[:-1])
    apart = (ring[1:] != ring[:-1]) | (turned > _GAP_RAD)
    stepped = abs(np.diff(ranges)) > _STEP_M
    begins = np.concatenate(([True], apart | stepped))
    group = np.cumsum(begins) - 1
    count = np.bincount(group)
    starts = np.flatnonzero(begins)
    ends = np.append(starts[1:], len(group)) - 1
    width = _length(offset[ends] - offset[starts])
    # An echo beside a nearer one may be part of a wide object that the nearer one hides.
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


def _length(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.sqrt(np.einsum("ij,ij->i", vectors, vectors)))


def sightings(
    echoes_m: FloatArray,
    ring: IntArray,
    sensor_m: FloatArray,
    axis: FloatArray,
    random: np.random.Generator,
) -> list[ConductorSighting]:
    """Lines through narrow echoes of many rings, best supported first.

    sensor_m: (3,) the sensor's place; axis: (3,) unit vector along which conductors run.
    """
    if len(echoes_m) > _MOST_ECHOES:
        kept = np.sort(random.choice(len(echoes_m), _MOST_ECHOES, replace=False))
        echoes_m, ring = echoes_m[kept], ring[kept]
    if len(echoes_m) < LEAST_RINGS:
        return []
    # Columns: one along the axis, two across.
    aside = np.cross(axis, np.eye(3)[np.argmin(abs(axis))])
    aside /= np.linalg.norm(aside)
    frame = np.column_stack((axis, aside, np.cross(axis, aside)))
    places = np.asfortranarray((echoes_m - sensor_m) @ frame)
    lines = _lines(places, ring, random)
    return [
        _sighting(line, ring, frame, sensor_m) for line in lines if _is_clear(line, lines, places)
    ]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Line:
    """at: (3,) middle of its echoes; slope: (2,) across per metre along; on: (k,) its echoes."""

    at: FloatArray
    slope: FloatArray
    on: BoolArray

    def distance_m(self, places: FloatArray) -> FloatArray:
        """Distance (k,) across the line, at the same place along it."""
        run = places[:, 0] - self.at[0]
        first = places[:, 1] - self.at[1] - self.slope[0] * run
        second = places[:, 2] - self.at[2] - self.slope[1] * run
        return np.asarray(np.sqrt(first * first + second * second))


def _lines(places: FloatArray, ring: IntArray, random: np.random.Generator) -> list[_Line]:
    """RANSAC: disjoint lines through an echo and a partner, with echoes of enough rings.

    places: (k, 3), one column along and two across, from the sensor.
    """
    first, second = _partners(places)
    support, slope = _best_lines(places, first, second, random)
    free = np.ones(len(places), dtype=bool)
    lines: list[_Line] = []
    for index in np.argsort(-support, kind="stable")[: int((support >= _LEAST_SUPPORT).sum())]:
        if not free[index]:
            continue
        line = _refined(places, free, places[index], slope[index])
        if line is not None and _has_rings(ring[line.on]):
            lines.append(line)
            free &= ~line.on
    return lines


def _partners(places: FloatArray) -> tuple[IntArray, IntArray]:
    """Pairs (p,), (p,) of echoes that may lie on one conductor, ordered by the first."""
    away = np.maximum(np.hypot(places[:, 1], places[:, 2]), 1e-6)
    around = np.column_stack((places[:, 1] / away, places[:, 2] / away, np.log(away)))
    most = math.tan(_TURNED_RAD) * _RUN_SHARES[1] + _RADIUS_M / _NEAR_M
    pairs = cKDTree(around).query_pairs(most, output_type="ndarray")
    run = abs(places[pairs[:, 1], 0] - places[pairs[:, 0], 0])
    share = run / away[pairs[:, 0]]
    pairs = pairs[(share > _RUN_SHARES[0]) & (share < _RUN_SHARES[1])]
    run, *aside = (places[pairs[:, 1]] - places[pairs[:, 0]]).T
    allowed = _RADIUS_M + math.tan(_TURNED_RAD) * abs(run)
    good = aside[0] ** 2 + aside[1] ** 2 < allowed**2
    first = np.concatenate((pairs[good, 0], pairs[good, 1]))
    second = np.concatenate((pairs[good, 1], pairs[good, 0]))
    order = np.lexsort((second, first))
    return first[order], second[order]


def _best_lines(
    places: FloatArray, first: IntArray, second: IntArray, random: np.random.Generator
) -> tuple[IntArray, FloatArray]:
    """Greatest number (k,) of an echo's partners on one line through it, and the slope (k, 2)."""
    count = np.bincount(first, minlength=len(places))
    begin = np.cumsum(count) - count
    run, *aside = (places[second] - places[first]).T
    best = np.zeros(len(places), dtype=np.int64)
    slopes = np.zeros((len(places), 2))
    some = np.flatnonzero(count >= _LEAST_SUPPORT)
    for _ in range(_TRIES):
        chosen = begin[some] + (random.uniform(size=len(some)) * count[some]).astype(np.int64)
        slope = np.zeros((len(places), 2))
        slope[some] = np.column_stack((aside[0][chosen], aside[1][chosen])) / run[chosen, None]
        off = (aside[0] - slope[first, 0] * run) ** 2 + (aside[1] - slope[first, 1] * run) ** 2
        on = np.bincount(first[off < _RADIUS_M**2], minlength=len(places))
        around = np.bincount(first[off < _AROUND_M**2], minlength=len(places))
        on[on < _LEAST_ALONE * around] = 0
        better = on > best
        best[better], slopes[better] = on[better], slope[better]
    return best, slopes


def _refined(
    places: FloatArray, free: BoolArray, at: FloatArray, slope: FloatArray
) -> _Line | None:
    """The line fitted to the free echoes close to it, twice; None with too few of them."""
    on = free
    for _ in range(2):
        on = free & (_Line(at=at, slope=slope, on=on).distance_m(places) < _RADIUS_M)
        if on.sum() < LEAST_RINGS:
            return None
        middle = places[on].mean(axis=0)
        offset = places[on] - middle
        along = offset[:, 0]
        at = middle
        slope = along @ offset[:, 1:] / max(float(along @ along), 1e-9)
    turned = float(np.hypot(slope[0], slope[1]))
    return _Line(at=at, slope=slope, on=on) if turned < math.tan(_TURNED_RAD) else None


def _has_rings(seen_by: IntArray) -> bool:
    """Returns True for echoes of enough rings, and of most between the first and the last."""
    rings = np.unique(seen_by)
    if len(rings) < LEAST_RINGS:
        return False
    return len(rings) >= _RING_SHARE * (int(rings[-1]) - int(rings[0]) + 1)


def _is_clear(line: _Line, lines: list[_Line], places: FloatArray) -> bool:
    """Returns True if most echoes around are its own, or those of parallel lines."""
    run = places[:, 0]
    beside = (run >= run[line.on].min()) & (run <= run[line.on].max())
    around = beside & (line.distance_m(places) < _AROUND_M)
    known = line.on.copy()
    for other in lines:
        if other is not line and np.hypot(*(other.slope - line.slope)) < _PARALLEL:
            known |= other.on
    return int((known & around).sum()) >= _LEAST_CLEAR * int(around.sum())


def _sighting(
    line: _Line, ring: IntArray, frame: FloatArray, sensor_m: FloatArray
) -> ConductorSighting:
    axis = frame @ np.append(1.0, line.slope)
    axis /= np.linalg.norm(axis)
    at = frame @ line.at
    nearest = at - axis * float(at @ axis)
    return ConductorSighting(
        point_m=nearest + sensor_m,
        direction=axis,
        rings=len(np.unique(ring[line.on])),
        range_m=float(np.linalg.norm(nearest)),
    )

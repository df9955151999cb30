"""The trajectory: a path with rounded corners and, at each point, the greatest speed allowed.

Inputs: the points of a plan with the speed of each move, and further speed caps; output: samples
along the path. Corners are rounded by arcs that leave the path within a given distance of the
corner. Neither the arcs nor braking need more than the vehicle's acceleration. The tracker
(`tracking`) decides how that speed is reached: it measures the aircraft's delay.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.floating[Any]]
SpeedCap = Callable[[FloatArray, FloatArray], FloatArray]
"""Greatest speeds (n,) at places (n, d) that are passed in directions (n, d)."""

_SAMPLE_M = 0.1
_ARC_PIECES = 6
_SLIGHT_TURN_RAD = math.radians(10.0)
"""A lesser turn needs no arc; its speed is at most that of an arc as long as its straights."""
_SHARP_TURN_RAD = math.radians(150.0)
"""A greater turn cannot be an arc: it is flown at the corner, almost at rest."""
_SHARP_TURN_MPS = 0.1
_STRAIGHT_RAD = 1e-6
_SAME_POINT_M = 1e-6
_COLLINEAR = 1e-6
"""Greatest loss of the cosine between two moves on one straight."""
_SLOWEST_MPS = 1e-3
"""Lower bound of the mean speed in durations: a lower speed lasts only an instant."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PathPoints:
    """A path by its points. position_m: (n, d); speed_mps: (n - 1,) of the move to the next."""

    position_m: FloatArray
    speed_mps: FloatArray

    def then(self, other: PathPoints) -> PathPoints:
        """The path, followed by another that begins at its last point."""
        return PathPoints(
            position_m=np.concatenate([self.position_m[:-1], other.position_m]),
            speed_mps=np.concatenate([self.speed_mps, other.speed_mps]),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """A path, sampled; distances are along it from its first point.

    distance_m:  (n,)    of each sample, increasing
    position_m:  (n, d)
    direction:   (n, d)  unit vectors
    limit_mps:   (n,)    allowed by the plan, the corners and the cap
    speed_mps:   (n,)    the limit reduced so that braking is possible, to rest at the end
    points_m:    (m, d)  the points of the plan
    corner_m:    (m,)    distance of each of them, or of the start of its rounding
    """

    distance_m: FloatArray
    position_m: FloatArray
    direction: FloatArray
    limit_mps: FloatArray
    speed_mps: FloatArray
    points_m: FloatArray
    corner_m: FloatArray

    @property
    def length_m(self) -> float:
        """The length of the path."""
        return float(self.distance_m[-1])

    @cached_property
    def _distances(self) -> list[float]:
        return [float(distance) for distance in self.distance_m]

    def at(self, distance_m: float) -> tuple[FloatArray, FloatArray, float]:
        """Position (d,), direction (d,) and greatest speed at a distance, clamped to the ends."""
        known = self._distances
        if distance_m >= known[-1]:
            return self.position_m[-1], self.direction[-1], 0.0
        after = max(1, bisect.bisect_right(known, distance_m))
        before = after - 1
        part = max(0.0, (distance_m - known[before]) / (known[after] - known[before]))
        step = self.position_m[after] - self.position_m[before]
        position = self.position_m[before] + part * step
        direction = self.direction[before] + part * (self.direction[after] - self.direction[before])
        if float(self.direction[before] @ self.direction[after]) < 0.0:
            # The path turns back at the next sample, and not before.
            direction = step
        norm = float(np.sqrt(direction @ direction))
        # Under constant braking the square of the speed is linear in the distance.
        first, second = float(self.speed_mps[before]), float(self.speed_mps[after])
        speed = math.sqrt(first * first + part * (second * second - first * first))
        return position, direction / norm if norm > _SAME_POINT_M else direction, speed

    def corners_m(self, from_m: float | None = None) -> FloatArray:
        """Points (k, d) at which the path begins, turns or ends; those after a distance, if given.

        The first point counts as the beginning, so that it is ahead nowhere.
        """
        points = self.points_m
        step = np.diff(points, axis=0)
        length = np.linalg.norm(step, axis=1)
        moves = length > _SAME_POINT_M
        kept = np.concatenate([[True], moves])
        points, corner = points[kept], self.corner_m[kept]
        direction = step[moves] / length[moves, None]
        turns = (direction[:-1] * direction[1:]).sum(axis=1) < 1.0 - _COLLINEAR
        found = np.concatenate([[True], turns, [True]])[: len(points)]
        if from_m is not None:
            found &= corner > from_m
        corners: FloatArray = points[found]
        return corners

    def duration_s(self, from_m: float) -> float:
        """Time for the rest of the path from a distance on, at the greatest speed."""
        if from_m >= self.length_m:
            return 0.0
        ahead = self.distance_m > from_m
        distance = np.concatenate([[from_m], self.distance_m[ahead]])
        speed = np.concatenate([[self.at(from_m)[2]], self.speed_mps[ahead]])
        # Between two samples the acceleration is constant, and the mean speed that of the ends.
        mean = np.maximum(0.5 * (speed[:-1] + speed[1:]), _SLOWEST_MPS)
        return float((np.diff(distance) / mean).sum())

    def rest(
        self, from_m: float, speed_mps: float, acceleration_mps2: float
    ) -> tuple[FloatArray, FloatArray]:
        """Points (n, d) from a distance on, and the times (n - 1,) between them, as it is flown.

        speed_mps: speed there; the acceleration limits how soon the greatest speed is reached.
        """
        ahead = self.distance_m > from_m
        first, _, greatest_mps = self.at(from_m)
        distance = np.concatenate([[from_m], self.distance_m[ahead]])
        limit = np.concatenate([[min(speed_mps, greatest_mps)], self.speed_mps[ahead]])
        # With v^2 - 2 a s constant during acceleration, the limit is a running minimum of that.
        gained = 2.0 * acceleration_mps2 * distance
        speed = np.sqrt(np.minimum.accumulate(limit**2 - gained) + gained)
        mean = np.maximum(0.5 * (speed[:-1] + speed[1:]), _SLOWEST_MPS)
        return np.concatenate([first[None], self.position_m[ahead]]), np.diff(distance) / mean

    def capped(self, cap: SpeedCap, acceleration_mps2: float) -> Trajectory:
        """The trajectory under another speed cap."""
        if len(self.distance_m) == 1:
            return self
        limit = np.minimum(self.limit_mps, cap(self.position_m, self.direction))
        speed = _braking_speed_mps(self.distance_m, limit, acceleration_mps2)
        return replace(self, limit_mps=limit, speed_mps=speed)

    def corner_after(self, distance_m: float) -> int:
        """The first point of the plan that is reached at or after a distance, or its last."""
        return min(int(np.searchsorted(self.corner_m, distance_m)), len(self.corner_m) - 1)

    def between(self, from_m: float, until_m: float) -> PathPoints:
        """The path between two distances, as points; the lead-in of a new trajectory."""
        inside = (self.distance_m > from_m + _SAME_POINT_M) & (
            self.distance_m < until_m - _SAME_POINT_M
        )
        first, _, _ = self.at(from_m)
        last, _, _ = self.at(until_m)
        ends = np.concatenate([self.distance_m[inside], [until_m]])
        return PathPoints(
            position_m=np.concatenate([first[None], self.position_m[inside], last[None]]),
            speed_mps=np.interp(ends, self.distance_m, self.limit_mps),
        )


def make_trajectory(
    path: PathPoints,
    *,
    lead_in: PathPoints | None = None,
    acceleration_mps2: float,
    rounding_m: float,
    cap: SpeedCap | None = None,
) -> Trajectory:
    """The trajectory along a plan's points, at rest at its end.

    lead_in: points that are flown first and end at the plan's first point: the rest of an earlier
    trajectory, so that a new plan moves no setpoint. rounding_m: greatest reach of an arc before
    and behind its corner. cap: a further limit of the speed.
    """
    whole = path if lead_in is None else lead_in.then(path)
    plan_begins = 0 if lead_in is None else len(lead_in.position_m) - 1
    steps = np.diff(whole.position_m, axis=0)
    lengths = np.sqrt((steps**2).sum(axis=1))
    moves = lengths > _SAME_POINT_M
    points = np.concatenate([whole.position_m[:1], whole.position_m[1:][moves]])
    speed = whole.speed_mps[moves]
    # A point that repeats the one before it is reached when that one is.
    index_of_point = np.concatenate([[0], np.cumsum(moves)])[plan_begins:]
    if not len(speed):
        nowhere = np.zeros(1)
        return Trajectory(
            distance_m=nowhere,
            position_m=points,
            direction=np.zeros_like(points),
            limit_mps=nowhere,
            speed_mps=nowhere,
            points_m=path.position_m,
            corner_m=np.zeros(len(index_of_point)),
        )
    order, position, limit = _sample(points, speed, acceleration_mps2, rounding_m)
    step = np.diff(position, axis=0)
    distance = np.concatenate([[0.0], np.cumsum(np.sqrt((step**2).sum(axis=1)))])
    direction = _directions(step)
    if cap is not None:
        limit = np.minimum(limit, cap(position, direction))
    return Trajectory(
        distance_m=distance,
        position_m=position,
        direction=direction,
        limit_mps=limit,
        speed_mps=_braking_speed_mps(distance, limit, acceleration_mps2),
        points_m=path.position_m,
        # A point on which an arc ends is not a sample of its own: it is where the path ends.
        corner_m=distance[
            np.minimum(np.searchsorted(order, index_of_point - 0.25), len(order) - 1)
        ],
    )


def _sample(
    points: FloatArray, speed_mps: FloatArray, acceleration_mps2: float, rounding_m: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    r"""Order (n,), position (n, d) and speed limit (n,) of the samples along a path.

    Point i and its arc have an order in [i - 0.25, i + 0.25], the straight behind it between
    i + 0.25 and i + 0.75:

        point i-1 ---straight---( arc of point i )---straight--- point i+1
                  \_ rounding _/                  \_ rounding _/
    """
    steps = np.diff(points, axis=0)
    lengths = np.sqrt((steps**2).sum(axis=1))
    unit = steps / lengths[:, None]
    incoming, outgoing = unit[:-1], unit[1:]
    turn = np.arccos(np.clip((incoming * outgoing).sum(axis=1), -1.0, 1.0))
    arc = (turn >= _SLIGHT_TURN_RAD) & (turn <= _SHARP_TURN_RAD)
    rounded = np.concatenate([[False], arc, [False]])
    # Where two corners share a straight, each has half of it.
    share = np.where(rounded[:-1] & rounded[1:], 0.5, 1.0) * lengths
    reach = np.zeros(len(points))
    reach[1:-1][arc] = np.minimum(rounding_m, np.minimum(share[:-1], share[1:]))[arc]

    at_point = np.minimum(
        np.concatenate([speed_mps[:1], speed_mps]), np.concatenate([speed_mps, speed_mps[-1:]])
    )
    at_point[1:-1][turn > _SHARP_TURN_RAD] = _SHARP_TURN_MPS
    slight = turn < _SLIGHT_TURN_RAD
    around_m = np.minimum(0.5 * (lengths[:-1] + lengths[1:]), 2.0 * rounding_m)[slight]
    radius = around_m / np.maximum(turn[slight], _STRAIGHT_RAD)
    at_point[1:-1][slight] = np.minimum(at_point[1:-1][slight], np.sqrt(acceleration_mps2 * radius))

    corner = np.flatnonzero(rounded)
    angle = turn[arc]
    radius = reach[corner] / np.tan(0.5 * angle)
    normal = (outgoing[arc] - np.cos(angle)[:, None] * incoming[arc]) / np.sin(angle)[:, None]
    at_arc = np.minimum(at_point[corner], np.sqrt(acceleration_mps2 * radius))
    part = np.linspace(0.0, 1.0, _ARC_PIECES + 1)
    swept = angle[:, None] * part
    begin = points[corner] - reach[corner, None] * incoming[arc]
    arcs = begin[:, None] + radius[:, None, None] * (
        np.sin(swept)[..., None] * incoming[arc][:, None]
        + (1.0 - np.cos(swept))[..., None] * normal[:, None]
    )

    sharp = np.flatnonzero(~rounded)
    straight_m = lengths - reach[:-1] - reach[1:]
    pieces = np.ceil(straight_m / _SAMPLE_M).astype(int)
    segment = np.repeat(np.arange(len(lengths)), np.maximum(pieces - 1, 0))
    nth = np.arange(len(segment)) - np.searchsorted(segment, segment) + 1
    fraction = nth / pieces[segment]
    along = reach[segment] + fraction * straight_m[segment]

    order = np.concatenate(
        [
            sharp.astype(float),
            (corner[:, None] - 0.25 + 0.5 * part).ravel(),
            segment + 0.25 + 0.5 * fraction,
        ]
    )
    position = np.concatenate(
        [
            points[sharp],
            arcs.reshape(-1, points.shape[1]),
            points[segment] + along[:, None] * unit[segment],
        ]
    )
    limit = np.concatenate(
        [at_point[sharp], np.repeat(at_arc, _ARC_PIECES + 1), speed_mps[segment]]
    )
    sequence = np.argsort(order, kind="stable")
    order, position, limit = order[sequence], position[sequence], limit[sequence]
    # Arcs of neighbouring corners may touch: of two samples in one place the slower stays.
    gap = np.sqrt((np.diff(position, axis=0) ** 2).sum(axis=1)) > _SAME_POINT_M
    keep = np.concatenate([[True], gap])
    limit = np.minimum.reduceat(limit, np.flatnonzero(keep))
    return order[keep], position[keep], limit


def _directions(step: FloatArray) -> FloatArray:
    """Unit vectors (n, d) at samples from the steps (n - 1, d) between them."""
    unit = step / np.sqrt((step**2).sum(axis=1))[:, None]
    before, after = np.concatenate([unit[:1], unit]), np.concatenate([unit, unit[-1:]])
    mean = before + after
    norm = np.sqrt((mean**2).sum(axis=1))[:, None]
    # A path that turns back has no mean direction: the next step gives the direction.
    return np.where(norm > 0.5, mean / np.maximum(norm, _SAME_POINT_M), after)


def _braking_speed_mps(
    distance_m: FloatArray, limit_mps: FloatArray, acceleration_mps2: float
) -> FloatArray:
    """The greatest speeds (n,) within limits from which every later one can be braked to.

    With v^2 + 2 a s constant under braking, the limit backward is a running minimum of that sum.
    """
    squares = np.append(limit_mps[:-1] ** 2, 0.0) + 2.0 * acceleration_mps2 * distance_m
    feasible = np.minimum.accumulate(squares[::-1])[::-1] - 2.0 * acceleration_mps2 * distance_m
    return np.asarray(np.sqrt(np.maximum(feasible, 0.0)))

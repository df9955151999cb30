"""Offset between the autopilot's estimate and the line, by the wires that a scan sees.

In: sightings of single scans, placed by the autopilot's estimate; the wires of the site file, or
without any those that were seen first. Out: `LineOffset`, which added to the estimate gives the
place in the line's frame.

State of a Kalman filter: the offset (x, z) in the plane, and the error of the attitude about the
line, which turns everything that is seen about the sensor. Model: the estimate drifts by at most
0.3 m/s; its jumps are known (`shift`). The error of the heading is taken off first
(`line_heading`): each direction in which rows are seen is tried, and that of the wires counts.

Which sighting is of which wire is decided for a whole scan: the hypothesis with the most pairs that
are jointly compatible (Neira, Tardos: "Data Association in Stochastic Mapping Using the Joint
Compatibility Test", IEEE Trans. Robotics and Automation 17, 2001), by branch and bound. Ghosts,
wires that the site lacks, and one that hangs elsewhere have no pair. Where another hypothesis with
another offset costs little more, or that nothing is of the line, the scan decides nothing. Several
scans in turn have to agree before an unknown offset counts.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..planner.site import PlanePoint
from ..types import Vector
from .line_heading import LineHeading, rows
from .perception_report import LineOffset
from .scan_conductors import ConductorSighting

FloatArray = npt.NDArray[np.float64]

_DRIFT_MPS = 0.3
"""Greatest drift of the estimate. Of real ones: PX4 1 to 1.7 m in all, ArduPilot's pushed GPS."""
_BEGIN_M = 1.5
"""Standard deviation of the offset before a scan has shown it: the estimate's own error."""
_TURN_RAD, _TURN_S = 0.03, 10.0
"""Standard deviation of the attitude's error, and the time after which it is another one. A real
PX4's was 2 degrees after a turn."""
_SIGHTING_M = 0.08
"""Standard deviation of a sighting's place against the wire's: echoes, sag, survey."""
_NOISE = np.eye(2) * _SIGHTING_M**2
_SURVEY_M = 0.05
"""Error that all sightings share, and which no number of scans makes less."""
_JUMP_M = 0.05
"""Standard deviation of a known jump's length."""
_PAIR, _PER_PAIR = 13.8, 9.2
"""Greatest squared distances: of one pair (chi-square of two degrees, 0.999), and of all of them by
pair (0.99)."""
_CLEARER = 9.0
"""Least difference of squared distances of two hypotheses of which the nearer one is taken: it is
ninety times as likely."""
_ANOTHER_M = 0.5
"""Difference of the offsets of two hypotheses that mean different places."""
_KNOWN_M = 0.6
"""Standard deviation below which one pair is enough: no other wire hangs so near."""
_LEAST_PAIRS = 2
_UNPAIRED, _FEWER = 10.0, 2
"""Cost of a sighting without a wire, as a squared distance; by how many pairs fewer still count."""
_AGREE = 5
"""Number of scans in turn whose offsets agree, before it counts."""
_MOST_SIGHTINGS = 8
"""Sightings that are matched, the nearest ones: more decide nothing else."""
_NEAR_M = 10.0
"""Distance from which every wire is found (of 15 mm)."""
_LOST_M = 3.0
"""Standard deviation above which nothing is known of the offset any more."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Hypothesis:
    """Pairs of sightings and wires.

    squared: joint Mahalanobis distance, squared; mean (3,), covariance (3, 3): state given these.
    """

    pairs: tuple[tuple[int, int], ...]
    squared: float
    mean: FloatArray
    covariance: FloatArray


class LineTracker:
    """Tracks the offset. wires_m: places (x, z) of the site file's wires.

    Without any the wires of this flight are learned, and the first ones define the line's frame.
    """

    def __init__(self, wires_m: Iterable[PlanePoint]) -> None:
        self._wires_m = list(wires_m)
        self._learns = not self._wires_m
        self._mean = np.zeros(3)
        self._covariance = _unknown()
        self._seen_s: float | None = None
        """Time of the last scan that was matched; None while nothing is known of the offset."""
        self._agreed: tuple[int, PlanePoint] = (0, (0.0, 0.0))
        """Number of scans that agreed so far, and their last offset; while it is unknown."""
        self._matched = 0
        self._contradicted_s: float | None = None
        self._heading = LineHeading()

    @property
    def axis(self) -> FloatArray:
        """Unit vector (3,), by the estimate, along which the next scan's wires are searched."""
        return self._heading.axis(turns=bool(self._wires_m))

    @property
    def offset_m(self) -> PlanePoint:
        """The offset (x, z), as last known; (0, 0) before the first match."""
        return float(self._mean[0]), float(self._mean[1])

    def placed(self, points_m: FloatArray, sensor_m: FloatArray) -> FloatArray:
        """Points (n, 3) in the line's frame, without the errors of heading and attitude.

        sensor_m: (3,) or (n, 3); both as the estimate places them.
        """
        x_m, z_m, turn_rad = self._mean
        about_line = np.array([[1.0, 0.0, -turn_rad], [0.0, 1.0, 0.0], [turn_rad, 0.0, 1.0]])
        change = self._heading.back @ about_line - np.eye(3)
        return np.asarray(points_m + np.array([x_m, 0.0, z_m]) + (points_m - sensor_m) @ change)

    def placed_sighting(
        self, sighting: ConductorSighting, sensor_m: FloatArray
    ) -> ConductorSighting:
        """A sighting in the line's frame. sensor_m: (3,)."""
        (point_m,) = self.placed(sighting.point_m[None], sensor_m)
        direction = sighting.direction @ self._heading.back
        return replace(sighting, point_m=point_m, direction=direction)

    @property
    def seen_s(self) -> float | None:
        """Time of the last scan that was matched; None before that, and once it may be too old."""
        return self._seen_s

    @property
    def is_known(self) -> bool:
        """True from a match on, until the estimate may have drifted too far."""
        return self._seen_s is not None

    def step(self, found: Sequence[ConductorSighting], sensor_m: FloatArray, time_s: float) -> None:
        """Takes the sightings of a scan. sensor_m: (3,), placed by the estimate as they are."""
        nearest = sorted(found, key=lambda each: each.range_m)[:_MOST_SIGHTINGS]
        self._forget_by(time_s)
        best, shown = self._matched_scan(nearest, sensor_m, time_s)
        pairs = 0 if best is None else len(best.pairs)
        if best is not None and self._agrees(best):
            self._mean, self._covariance = best.mean, best.covariance
            self._seen_s, self._matched = time_s, pairs
        if not self._wires_m:
            shown = self._heading.shown_by(nearest, time_s, least=_LEAST_PAIRS)
        self._heading = self._heading.missed() if shown is None else shown
        if not self._should_see(sensor_m) or pairs >= min(_LEAST_PAIRS, len(nearest) - 1):
            self._contradicted_s = None
        elif self._contradicted_s is None:
            self._contradicted_s = time_s

    def _agrees(self, best: _Hypothesis) -> bool:
        """True for a known offset, and where enough scans in turn have shown an unknown one."""
        if self.is_known:
            return True
        place_m = float(best.mean[0]), float(best.mean[1])
        count, before_m = self._agreed
        count = count + 1 if math.dist(place_m, before_m) < _ANOTHER_M else 1
        self._agreed = count, place_m
        return count >= _AGREE

    def _forget_by(self, time_s: float) -> None:
        """Forgets an offset that the estimate's drift may have changed by too much."""
        if self._seen_s is not None and self._covariance_at(time_s)[0, 0] > _LOST_M**2:
            self._seen_s, self._contradicted_s, self._agreed = None, None, (0, (0.0, 0.0))
            self._mean[2] = 0.0
            self._covariance = np.diag([_LOST_M**2, _LOST_M**2, _TURN_RAD**2])

    def place(self, offset_m: PlanePoint) -> None:
        """Takes the offset that the aircraft is flown with, while none is known here."""
        if not self.is_known:
            self._mean = np.array([*offset_m, 0.0])

    def _should_see(self, sensor_m: FloatArray) -> bool:
        """True if a sighting should be of a known wire, which hangs close by."""
        here_m = (sensor_m[0] + self._mean[0], sensor_m[2] + self._mean[1])
        near = any(math.dist(here_m, wire_m) < _NEAR_M for wire_m in self._wires_m)
        return near and self.is_known

    def learn(self, wires_m: Iterable[PlanePoint], time_s: float) -> None:
        """Takes wires in the line's frame that were seen often; none where the site has its own."""
        if not self._learns:
            return
        if not self._wires_m:
            self._covariance, self._seen_s = np.diag([_SIGHTING_M**2] * 2 + [_TURN_RAD**2]), time_s
        elif not self.is_known:
            return
        for place_m in wires_m:
            if all(math.dist(place_m, known_m) > _ANOTHER_M for known_m in self._wires_m):
                self._wires_m.append(place_m)

    def shift(self, step_m: Vector) -> None:
        """Takes a jump of the estimate: neither the aircraft nor the line has moved."""
        self._mean = self._mean - np.array([step_m[0], step_m[2], 0.0])
        self._covariance = self._covariance + np.diag([_JUMP_M**2, _JUMP_M**2, 0.0])

    def report(self, time_s: float, jumped_m: Vector) -> LineOffset:
        """The offset with its covariance at a time. jumped_m: jumps of the estimate so far."""
        self._forget_by(time_s)
        covariance = self._covariance_at(time_s) + np.eye(3) * _SURVEY_M**2
        return LineOffset(
            offset_m=self.offset_m,
            covariance_m2=(
                float(covariance[0, 0]), float(covariance[0, 1]), float(covariance[1, 1]),
            ),
            jumped_m=jumped_m,
            seen_s=self._seen_s,
            wires=self._matched if self.is_known else 0,
            contradicted_s=self._contradicted_s,
            turned_rad=self._heading.turned_rad,
        )  # fmt: skip

    def _covariance_at(self, time_s: float) -> FloatArray:
        """Covariance (3, 3) of offset and turn, for an estimate that has drifted until then."""
        if self._seen_s is None:
            return self._covariance
        drift = (_DRIFT_MPS * max(0.0, time_s - self._seen_s)) ** 2
        kept = np.diag([1.0, 1.0, self._turn_kept(time_s)])
        more = np.diag([drift, drift, _TURN_RAD**2 * (1.0 - kept[2, 2] ** 2)])
        return np.asarray(kept @ self._covariance @ kept + more)

    def _mean_at(self, time_s: float) -> FloatArray:
        return np.asarray(self._mean * np.array([1.0, 1.0, self._turn_kept(time_s)]))

    def _turn_kept(self, time_s: float) -> float:
        """Share of the attitude's error that is left: it tends to none."""
        return 1.0 if self._seen_s is None else math.exp(-max(0.0, time_s - self._seen_s) / _TURN_S)

    def _matched_scan(
        self, found: Sequence[ConductorSighting], sensor_m: FloatArray, time_s: float
    ) -> tuple[_Hypothesis | None, LineHeading | None]:
        """The hypothesis of a scan, and the heading that its wires show.

        The wires of a line have one direction: sightings of each are matched on their own. None,
        where no or no clear hypothesis has pairs enough.
        """
        wires = np.array(self._wires_m).reshape(-1, 2)
        mean, covariance = self._mean_at(time_s), self._covariance_at(time_s)
        nothing = _Hypothesis(
            pairs=(), squared=_UNPAIRED * len(found), mean=mean, covariance=covariance
        )
        hypotheses: list[tuple[_Hypothesis, LineHeading | None]] = [(nothing, None)]
        for row in rows(found):
            heading = self._heading.shown_by(row, time_s, least=1, near=False)
            if heading is None:
                continue
            places = np.array([_crossing_m(each, sensor_m, heading) for each in row])
            one_shows = self._heading.may_be(
                heading, time_s, alone=len(wires) == 1 and not self._learns
            )
            others_cost = _UNPAIRED * (len(found) - len(row))
            for each in _Search(places, places - sensor_m[[0, 2]], wires).costs(mean, covariance):
                if one_shows or len(each.pairs) >= _LEAST_PAIRS:
                    cost = each.squared + others_cost
                    hypotheses.append((replace(each, squared=cost), heading))
        (best, shown), *others = sorted(hypotheses, key=lambda each: each[0].squared)
        known = math.sqrt(max(covariance[0, 0], covariance[1, 1])) < _KNOWN_M
        if len(best.pairs) < (1 if known or len(wires) == 1 else _LEAST_PAIRS):
            return None, None
        for other, _ in others:
            elsewhere = math.dist(best.mean[:2], other.mean[:2]) > _ANOTHER_M
            if elsewhere and other.squared - best.squared < _CLEARER:
                return None, None
        return best, shown


def _crossing_m(
    sighting: ConductorSighting, sensor_m: FloatArray, heading: LineHeading
) -> PlanePoint:
    """Crossing of the site's plane, as the estimate places it, without the heading's error."""
    point_m = sensor_m + (sighting.point_m - sensor_m) @ heading.back
    direction = sighting.direction @ heading.back
    return replace(sighting, point_m=point_m, direction=direction).crossing_m()


def _unknown() -> FloatArray:
    return np.diag([_BEGIN_M**2, _BEGIN_M**2, _TURN_RAD**2])


class _Search:
    """Branch and bound over the pairs of one scan.

    places (n, 2): crossings as the estimate places them; beside (n, 2): from the sensor to them;
    wires (m, 2).
    """

    def __init__(self, places: FloatArray, beside: FloatArray, wires: FloatArray) -> None:
        self._places, self._beside, self._wires = places, beside, wires
        self._most = 0
        self._found: list[_Hypothesis] = []

    def costs(self, mean: FloatArray, covariance: FloatArray) -> list[_Hypothesis]:
        """The hypotheses with nearly the most pairs; `squared` has the cost of what is unpaired."""
        begin = _Hypothesis(pairs=(), squared=0.0, mean=mean, covariance=covariance)
        self._extend(begin, 0)
        count = len(self._places)
        return [
            replace(each, squared=each.squared + _UNPAIRED * (count - len(each.pairs)))
            for each in self._found
            if len(each.pairs) >= max(1, self._most - _FEWER)
        ]

    def _extend(self, so_far: _Hypothesis, index: int) -> None:
        least = max(1, self._most - _FEWER)
        if len(so_far.pairs) + len(self._places) - index < least:
            return
        if index == len(self._places):
            self._most = max(self._most, len(so_far.pairs))
            self._found.append(so_far)
            return
        for longer in self._paired(so_far, index):
            self._extend(longer, index + 1)
        self._extend(so_far, index + 1)

    def _paired(self, so_far: _Hypothesis, index: int) -> list[_Hypothesis]:
        """The hypotheses with one more pair, of the nearest wire first, whose pairs fit together.

        The innovations of successive updates are independent: their squared distances add up to the
        joint one. Gain and covariance are those of any wire.
        """
        x_m, z_m = self._beside[index]
        jacobian = np.array([[1.0, 0.0, z_m], [0.0, 1.0, -x_m]])
        across = so_far.covariance @ jacobian.T
        spread = jacobian @ across + _NOISE
        inverse = _inverse(spread)
        off = self._wires - self._places[index] - jacobian @ so_far.mean
        squared = ((off @ inverse) * off).sum(axis=1)
        most = min(_PAIR, _PER_PAIR * (len(so_far.pairs) + 1) - so_far.squared)
        taken = {wire for _, wire in so_far.pairs}
        wires = [
            int(wire)
            for wire in np.argsort(squared, kind="stable")
            if squared[wire] < most and wire not in taken
        ]
        if not wires:
            return []
        gain = across @ inverse
        covariance = so_far.covariance - gain @ across.T
        return [
            _Hypothesis(
                pairs=(*so_far.pairs, (index, wire)),
                squared=so_far.squared + float(squared[wire]),
                mean=so_far.mean + gain @ off[wire],
                covariance=covariance,
            )
            for wire in wires
        ]


def _inverse(spread: FloatArray) -> FloatArray:
    """Inverse of a covariance (2, 2)."""
    (a, b), (_, c) = spread.tolist()
    share = 1.0 / (a * c - b * b)
    return np.array([[c * share, -b * share], [-b * share, a * share]])

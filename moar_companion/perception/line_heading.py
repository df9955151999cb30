"""Error of the autopilot's heading, by the directions of the wires that scans see.

The wires of a line run side by side, across the plane of the site. When all that a scan sees are
turned about the vertical by one angle, the heading is wrong by it: near a line or steel a compass
is, by 20 degrees and more. A scalar Kalman filter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from .scan_conductors import ConductorSighting

FloatArray = npt.NDArray[np.float64]

_BEGIN_RAD = 0.25
"""Standard deviation before a scan has shown it, and the greatest later on."""
_DRIFT_RADPS = 0.1
"""Change of the error: a real PX4's changed by up to 0.05 rad/s."""
_SIGHTING_RAD = 0.02
"""Standard deviation of a wire's direction in a scan."""
_SAME_RAD = 0.05
"""Greatest difference of directions that are the same."""
_GATE = 3.0
"""Greatest difference from the error before, in standard deviations: a fence beside is no wire."""
_ONE_WIRE_RAD = 0.1
"""Greatest change that one wire of several shows: it may be a row of something else."""
_GREATEST_RAD = 0.7
"""Greatest error; a row that is turned by more is not of the line."""
_ASIDE_RAD = 0.3
"""Turn of further searches, half of what one search covers."""
_BLANK = 5
"""Number of scans in turn that show no direction, after which searches turn aside."""
_ASIDE = (0.0, _ASIDE_RAD, 0.0, -_ASIDE_RAD)


@dataclass(frozen=True, slots=True, kw_only=True)
class LineHeading:
    """turned_rad: angle, counterclockwise from above, by which what is seen is turned.

    seen_s: time of the last scan that has shown it; None before. blank: number of scans since.
    """

    turned_rad: float = 0.0
    variance_rad2: float = _BEGIN_RAD**2
    seen_s: float | None = None
    blank: int = 0

    def axis(self, *, turns: bool) -> FloatArray:
        """Unit vector (3,) along which wires are searched in the next scan.

        turns: it turns aside while scans show nothing, since the error may have grown out of sight.
        """
        aside_rad = _ASIDE[self.blank % len(_ASIDE)] if turns and self.blank > _BLANK else 0.0
        searched_rad = self.turned_rad + aside_rad
        return np.array([-math.sin(searched_rad), math.cos(searched_rad), 0.0])

    def missed(self) -> LineHeading:
        """The heading after a scan that has not shown it."""
        return replace(self, blank=self.blank + 1)

    def shown_by(
        self,
        found: Sequence[ConductorSighting],
        time_s: float,
        *,
        least: int,
        near: bool = True,
    ) -> LineHeading | None:
        """The heading with a scan; None where fewer than `least` sightings have one direction.

        near: those that differ by more than the error may have changed do not count.
        """
        variance, gate_rad = self._at(time_s)
        angles = sorted(
            angle
            for angle in (_turned_rad(each.direction) for each in found)
            if abs(angle) < _GREATEST_RAD and (not near or abs(angle - self.turned_rad) < gate_rad)
        )
        if not angles:
            return None
        middle = angles[len(angles) // 2]
        same = [angle for angle in angles if abs(angle - middle) < _SAME_RAD]
        if len(same) < least:
            return None
        shown_rad = sum(same) / len(same)
        if abs(shown_rad - self.turned_rad) >= gate_rad:
            variance = _BEGIN_RAD**2
        gain = variance / (variance + _SIGHTING_RAD**2)
        return LineHeading(
            turned_rad=self.turned_rad + gain * (shown_rad - self.turned_rad),
            variance_rad2=(1.0 - gain) * variance,
            seen_s=time_s,
        )

    def may_be(self, other: LineHeading, time_s: float, *, alone: bool) -> bool:
        """True if one wire may show another heading. alone: it is the only one that is listed."""
        _, gate_rad = self._at(time_s)
        most_rad = gate_rad if alone else min(gate_rad, _ONE_WIRE_RAD)
        return abs(other.turned_rad - self.turned_rad) < most_rad

    def _at(self, time_s: float) -> tuple[float, float]:
        """Variance at a time, and the greatest difference of a direction that is near."""
        elapsed_s = 0.0 if self.seen_s is None else max(0.0, time_s - self.seen_s)
        variance = min(self.variance_rad2 + (_DRIFT_RADPS * elapsed_s) ** 2, _BEGIN_RAD**2)
        return variance, _GATE * math.sqrt(variance + _SIGHTING_RAD**2)

    @property
    def back(self) -> FloatArray:
        """Rotation (3, 3) that takes the error off row vectors from the sensor."""
        cos, sin = math.cos(self.turned_rad), math.sin(self.turned_rad)
        return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def rows(found: Sequence[ConductorSighting]) -> list[list[ConductorSighting]]:
    """Sightings by their direction, which those of one line share."""
    angles = [_turned_rad(each.direction) for each in found]
    grouped: list[list[ConductorSighting]] = []
    before_rad = -math.inf
    for index in np.argsort(angles, kind="stable"):
        if angles[index] - before_rad > _SAME_RAD:
            grouped.append([])
        grouped[-1].append(found[index])
        before_rad = angles[index]
    return grouped


def _turned_rad(direction: FloatArray) -> float:
    """Angle of a wire from the normal of the plane, counterclockwise from above."""
    x, y, _ = direction if direction[1] >= 0.0 else -direction
    return math.atan2(-x, y)

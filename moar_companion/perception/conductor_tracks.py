"""Tracks of conductors from scan to scan: confirmed by sightings, removed after repeated misses.

A scan misses a conductor only if it measured beyond it. A beam without an echo shows nothing: the
window may be covered, or no beam was sent there. A track in front of the sky stays.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from ..types import Vector
from .perception_report import SeenConductor
from .plane_rays import PlaneRays, sector_of
from .scan_conductors import LEAST_RINGS, ConductorSighting

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]

GATE_M = 0.5
"""Greatest distance of a sighting from its track."""
_SAME_M = 0.25
"""Distance within which a second sighting in one scan is of the same wire, whose echoes scatter."""
CONFIRMED_BY = 5
"""Number of sightings that confirm a track."""
_BESIDE_M = 1.0
"""Distance within which a seen conductor makes an unseen one count as missed. The keep-out of the
seen conductor covers the unseen one, if that still hangs there."""
_TENTATIVE_S = 1.0
"""Time without a sighting after which an unconfirmed track is removed."""
_MISSED = 20
"""Number of scans without a sighting, though the conductor must be visible, after which its track
is removed."""
_SIGHTING_M = 0.05
"""Standard deviation of one sighting."""
_DRIFT_M = 0.02
"""Standard deviation of the change from scan to scan, of a conductor or of the aircraft's
position."""
_OWN_M = 0.3
"""Greatest distance of a conductor's own echoes from its line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Track:
    """A conductor. x_m, z_m: its crossing of the plane; slope: of x and z per metre of y.

    range_m: greatest range of a sighting; within it the conductor must be visible.
    """

    number: int
    x_m: float
    z_m: float
    slope: tuple[float, float]
    deviation_m: float
    sightings: int
    seen_s: float
    range_m: float
    missed: int = 0

    @property
    def confirmed(self) -> bool:
        return self.sightings >= CONFIRMED_BY


class ConductorTracks:
    """Tracks that repeated sightings confirm. Confirmed tracks are kept while out of view.

    A track takes its number, and so its name, when it is confirmed.
    """

    def __init__(self) -> None:
        self._tracks: list[_Track] = []
        self._confirmed = 0

    def step(
        self,
        seen: Iterable[ConductorSighting],
        time_s: float,
        rays: PlaneRays,
        ring: IntArray,
    ) -> None:
        """Takes the sightings of a scan, the rays that it measured in the plane, and their rings.

        ring: (n,) number of the laser of each ray.
        """
        self._tracks = [
            track
            for track in self._tracks
            if track.confirmed or time_s - track.seen_s < _TENTATIVE_S
        ]
        free = list(range(len(self._tracks)))
        matched: list[int] = []
        for sighting in seen:
            x, z = sighting.crossing_m()
            if any(self._distance(index, x, z) < _SAME_M for index in matched):
                continue
            nearest = min(free, key=lambda index: self._distance(index, x, z), default=None)
            if nearest is None or self._distance(nearest, x, z) > GATE_M:
                nearest = len(self._tracks)
                self._tracks.append(_begun(sighting, time_s))
            else:
                free.remove(nearest)
                self._tracks[nearest] = self._corrected(self._tracks[nearest], sighting, time_s)
            matched.append(nearest)
        before_m = rays.nearest_m(rays.inside)
        # After drift of the position estimate, a wire has its sighting beside its track. The
        # sighting then hides the place of the track.
        others = [index for index in matched if self._tracks[index].confirmed]
        for index in free:
            track = self._tracks[index]
            beside = any(self._distance(each, track.x_m, track.z_m) < _BESIDE_M for each in others)
            if beside or _missed(track, rays, ring, before_m):
                self._tracks[index] = replace(track, missed=track.missed + 1)
        self._tracks = [track for track in self._tracks if track.missed < _MISSED]

    def own(self, points_m: FloatArray, time_s: float) -> BoolArray:
        """Mask of points (n, 3) on conductors that are confirmed, or seen at this time."""
        own = np.zeros(len(points_m), dtype=bool)
        for track in self._tracks:
            if track.confirmed or track.seen_s == time_s:
                x = points_m[:, 0] - track.x_m - track.slope[0] * points_m[:, 1]
                z = points_m[:, 2] - track.z_m - track.slope[1] * points_m[:, 1]
                own |= x * x + z * z < _OWN_M**2
        return own

    def shift(
        self, step_m: Vector, *, after_s: float = -math.inf, until_s: float = math.inf
    ) -> None:
        """Moves by (x, y, z) the conductors that were last seen after one time, until another."""
        self._tracks = [
            replace(
                track,
                x_m=track.x_m + step_m[0] - step_m[1] * track.slope[0],
                z_m=track.z_m + step_m[2] - step_m[1] * track.slope[1],
            )
            if after_s < track.seen_s <= until_s
            else track
            for track in self._tracks
        ]

    def join(self, until_s: float) -> None:
        """Joins tracks of one wire after a gap: one last seen until a time, and one seen since.

        A wire that was confirmed before takes its first name again, at the mean of both places,
        weighted by their variances. One that was not begins with what was seen since.
        """
        since = [track for track in self._tracks if track.seen_s > until_s]
        before = [track for track in self._tracks if track.seen_s <= until_s]
        confirmed = [track for track in before if track.confirmed]
        kept = [
            track
            for track in before
            if not track.confirmed and all(_apart_m(track, each) > GATE_M for each in since)
        ]
        for track in since:
            first = min(confirmed, key=lambda each: _apart_m(each, track), default=None)
            if first is None or _apart_m(first, track) > GATE_M:
                kept.append(track)
                continue
            confirmed.remove(first)
            kept.append(_joined(first, track))
        self._tracks = [*confirmed, *kept]

    @property
    def conductors(self) -> tuple[SeenConductor, ...]:
        """Confirmed conductors, in the order of their confirmation."""
        return tuple(
            SeenConductor(
                name=f"seen-{track.number}",
                position_m=(track.x_m, track.z_m),
                deviation_m=track.deviation_m,
                sightings=track.sightings,
                seen_s=track.seen_s,
            )
            for track in sorted(self._tracks, key=lambda track: track.number)
            if track.confirmed
        )

    def _distance(self, index: int, x_m: float, z_m: float) -> float:
        track = self._tracks[index]
        return math.hypot(track.x_m - x_m, track.z_m - z_m)

    def _corrected(self, track: _Track, sighting: ConductorSighting, time_s: float) -> _Track:
        """Kalman update of a place that is almost constant."""
        x, z = sighting.crossing_m()
        variance = track.deviation_m**2 + _DRIFT_M**2
        gain = variance / (variance + _SIGHTING_M**2)
        count = track.sightings + 1
        if count == CONFIRMED_BY:
            self._confirmed += 1
        slope = _slope(sighting)
        return replace(
            track,
            number=self._confirmed if count == CONFIRMED_BY else track.number,
            x_m=track.x_m + gain * (x - track.x_m),
            z_m=track.z_m + gain * (z - track.z_m),
            slope=(
                track.slope[0] + gain * (slope[0] - track.slope[0]),
                track.slope[1] + gain * (slope[1] - track.slope[1]),
            ),
            deviation_m=math.sqrt((1.0 - gain) * variance),
            sightings=count,
            seen_s=time_s,
            range_m=max(track.range_m, sighting.range_m),
            missed=0,
        )


def _begun(sighting: ConductorSighting, time_s: float) -> _Track:
    x, z = sighting.crossing_m()
    return _Track(
        number=0,
        x_m=x,
        z_m=z,
        slope=_slope(sighting),
        deviation_m=_SIGHTING_M,
        sightings=1,
        seen_s=time_s,
        range_m=sighting.range_m,
    )


def _joined(first: _Track, since: _Track) -> _Track:
    """A track that was confirmed before a gap, with one of the same wire since."""
    variance = first.deviation_m**2 + _DRIFT_M**2
    gain = variance / (variance + since.deviation_m**2)
    return replace(
        since,
        number=first.number,
        x_m=first.x_m + gain * (since.x_m - first.x_m),
        z_m=first.z_m + gain * (since.z_m - first.z_m),
        slope=(
            first.slope[0] + gain * (since.slope[0] - first.slope[0]),
            first.slope[1] + gain * (since.slope[1] - first.slope[1]),
        ),
        deviation_m=math.sqrt((1.0 - gain) * variance),
        sightings=first.sightings + since.sightings,
        range_m=max(first.range_m, since.range_m),
    )


def _apart_m(one: _Track, other: _Track) -> float:
    return math.hypot(one.x_m - other.x_m, one.z_m - other.z_m)


def _slope(sighting: ConductorSighting) -> tuple[float, float]:
    x, y, z = sighting.direction
    return float(x / y), float(z / y)


def _missed(track: _Track, rays: PlaneRays, ring: IntArray, before_m: FloatArray) -> bool:
    """Returns True if the scan measured beyond the conductor, all around it, and not before.

    Beams of as many rings as a sighting needs end beyond it, in the slab up to there. Every two
    neighbouring directions have such beams together, since beams may be farther apart than
    directions. before_m: least measured distance by direction.
    """
    x, z = track.x_m - rays.centre_m[0], track.z_m - rays.centre_m[1]
    distance = math.hypot(x, z)
    if not GATE_M < distance <= track.range_m:
        return False
    around = math.ceil(math.asin(min(_OWN_M / distance, 1.0)) / (2.0 * math.pi) * rays.sectors)
    middle = int(sector_of(np.array([x]), np.array([z]), rays.sectors)[0])
    sectors = np.arange(middle - around, middle + around + 1) % rays.sectors
    if (before_m[sectors] <= distance + GATE_M).any():
        return False
    beyond = rays.reach_m > distance + GATE_M
    by_ring = np.zeros((rays.sectors, int(ring.max(initial=0)) + 1), dtype=bool)
    by_ring[rays.sector[beyond], ring[beyond]] = True
    rings = (by_ring[sectors[1:]] | by_ring[sectors[:-1]]).sum(axis=1)
    return bool((rings >= LEAST_RINGS).all())

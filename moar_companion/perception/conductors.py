"""Power-line conductors in a point cloud: RANSAC for lines, a catenary grown along each.

As in the paper (Section V-A), RANSAC finds lines, one after the other. The line with the most
support is extended to a catenary as far as points lie on it. Its points are removed, and the search
continues until no line has support. A conductor must hang free: hedges, roofs and fences have
points close beneath.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.spatial import KDTree

from .catenary import Catenary, fit
from .local_lines import local_lines, thinned
from .wire_groups import Rough, WireGroup, owners, wire_groups

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]
BoolArray = npt.NDArray[np.bool_]

_GAP, _MOST_IN_GAP = 1.6, 0.25
"""Radius of the gap around a wire over the wire's, and the greatest number of points in the gap per
point of the wire; the edge of a roof has 0.4, leaves have 1.5."""
_PARALLEL_COSINE = math.cos(math.radians(15.0))


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectorSettings:
    """Thresholds of the search for conductors."""

    seed: int = 0
    least_height_m: float = 4.0
    """Least height above the ground; conductors hang higher (EN 50341: 5 m and more)."""
    voxel_m: float = 0.3
    """Voxel of the search, one point each; at the end all points are assigned."""
    neighbourhood_m: float = 3.0
    """Radius within which a conductor is a straight line of at least five points."""
    max_width: float = 0.35
    """Greatest width over length of a neighbourhood that counts as a line."""
    max_slope_deg: float = 35.0
    window_m: float = 10.0
    """Half the length of RANSAC's lines."""
    seed_radius_m: float = 0.35
    bundle_radius_m: float = 0.5
    """Radius about the curve; bundles of two to four have 0.2 to 0.35 m."""
    gap_m: float = 15.0
    """Greatest gap without points within one conductor."""
    sparse_gap_m: float = 60.0
    """Greatest gap of a wire that hangs along a conductor that was found."""
    least_points: int = 10
    least_length_m: float = 10.0
    max_sigma_m: float = 0.35
    """Greatest deviation of points from their wire, or from the centre of an unresolved bundle."""
    least_confidence: float = 0.25
    """Least confidence. Points in a line by chance reach 0.17: ten over 150 m, among twice as many
    others."""
    hypotheses: int = 96


@dataclass(frozen=True, kw_only=True, eq=False)
class DetectedConductor:
    """A conductor of one span, a bundle or a single wire."""

    curve: Catenary
    """Curve of the bundle's centre."""
    wires: tuple[Catenary, ...]
    """One curve per resolved sub-conductor; for a single wire the curve itself."""
    inliers: IntArray
    """Indices of its points in the cloud."""
    sigma_m: float
    """Standard deviation of its points from their wires, perpendicular to these."""
    covered: float
    """Share of its length with points, by windows of the median spacing or of 2 m."""
    clear: float
    """Share of the points within 1.5 m of the curve that are its own."""

    @property
    def confidence(self) -> float:
        """Confidence, 0 to 1: coverage times the share of own points; less below 30 points."""
        return self.covered * self.clear * min(1.0, len(self.inliers) / 30.0)


def find_conductors(
    points_m: FloatArray, height_m: FloatArray, settings: DetectorSettings
) -> tuple[DetectedConductor, ...]:
    """Conductors in (n, 3) points, x east, y north, z up, in metres; best supported first.

    height_m: (n,) height of the points above the ground.
    """
    high = np.flatnonzero(height_m >= settings.least_height_m)
    if not len(high):
        return ()
    return _Search(points_m, high, settings).run()


class _Search:
    """State of one search: the points that belong to no conductor yet."""

    def __init__(self, points_m: FloatArray, high: IntArray, settings: DetectorSettings) -> None:
        self._settings = settings
        self._random = np.random.default_rng(settings.seed)
        self._centre = points_m[high].mean(axis=0)
        self._all_m = points_m[high] - self._centre
        self._high = high
        self._points_m = thinned(self._all_m, settings.voxel_m)
        self._free = np.ones(len(self._points_m), dtype=bool)
        self._tree = KDTree(self._points_m)
        self._lines = local_lines(
            self._points_m,
            self._tree,
            self._random,
            neighbourhood_m=settings.neighbourhood_m,
            max_width=settings.max_width,
            bundle_radius_m=settings.bundle_radius_m,
        )

    def run(self) -> tuple[DetectedConductor, ...]:
        curves = self._curves()
        return self._detected(self._merged(curves + self._parallel(curves)))

    # --- lines

    def _curves(self) -> list[Rough]:
        """Conductors by lines; first the wires that have others close beside them."""
        found: list[Rough] = []
        steepest = math.sin(math.radians(self._settings.max_slope_deg))
        flat = abs(self._lines.directions[:, 2]) <= steepest
        for radius_m in np.unique(self._lines.radius_m[self._lines.radius_m > 0.0]):
            candidate = flat & self._free & (self._lines.radius_m == radius_m)
            self._search(found, candidate, float(radius_m))
        return found

    def _search(self, found: list[Rough], candidate: BoolArray, radius_m: float) -> None:
        """Adds the conductors with their points within a radius, of lines through candidates."""
        while candidate.any():
            line = self._best_line(np.flatnonzero(candidate), radius_m)
            if line is None:
                return
            at, along = line
            near = self._within(at, along, radius_m)
            beside = len(self._within(at, along, _GAP * radius_m)) - len(near)
            is_row = len(near) >= 4 and beside <= 2.0 * _MOST_IN_GAP * len(near)
            rough = self._grown(near, along, radius_m) if is_row else None
            if rough is not None and self._is_conductor(rough):
                found.append(rough)
                taken = self._on(rough)
                self._free[taken] = False
                candidate[taken] = False
            candidate[near] = False

    def _best_line(
        self, candidates: IntArray, radius_m: float
    ) -> tuple[FloatArray, FloatArray] | None:
        """RANSAC: the line through two points, along both neighbourhoods, with most support."""
        points = self._points_m[candidates]
        seed_radius_m = min(self._settings.seed_radius_m, radius_m)
        chosen = self._random.choice(len(candidates), size=self._settings.hypotheses, replace=True)
        first = points[chosen]
        along = self._lines.directions[candidates[chosen]]
        # Second point of each pair: one in the window, as far along the direction of the first.
        best, support = None, self._settings.least_points // 2 - 1
        if radius_m < self._settings.bundle_radius_m:
            support = self._settings.least_points - 1
        tree = KDTree(points)
        for at, tangent, near in zip(
            first, along, tree.query_ball_point(first, self._settings.window_m), strict=True
        ):
            around = points[near]
            offset = around - at
            length = offset @ tangent
            distance = np.sqrt(np.maximum((offset**2).sum(axis=1) - length**2, 0.0))
            partners = np.flatnonzero(
                (abs(length) > 2.0) & (distance < np.maximum(0.2 * abs(length), 0.5))
            )
            if not len(partners):
                continue
            for partner in self._random.choice(partners, size=min(4, len(partners)), replace=False):
                line = offset[partner] / math.sqrt(float(offset[partner] @ offset[partner]))
                run = offset @ line
                miss = np.sqrt(np.maximum((offset**2).sum(axis=1) - run**2, 0.0))
                count = int((miss <= seed_radius_m).sum())
                if count > support:
                    best, support = (at, line), count
        return best

    def _within(self, at: FloatArray, along: FloatArray, radius_m: float) -> IntArray:
        """Free points in the cylinder of a line."""
        near = np.array(self._tree.query_ball_point(at, self._settings.window_m), dtype=np.intp)
        near = near[self._free[near]]
        offset = self._points_m[near] - at
        run = offset @ along
        miss = np.sqrt(np.maximum((offset**2).sum(axis=1) - run**2, 0.0))
        return np.asarray(near[miss <= min(self._settings.seed_radius_m, radius_m)])

    # --- catenaries

    def _grown(self, near: IntArray, along: FloatArray, radius_m: float) -> Rough | None:
        """The catenary of a line's points, extended at both ends as long as points lie on it."""
        direction = along[:2] / np.hypot(*along[:2])
        rough = Rough(fit(self._points_m[near], direction), radius_m)
        done_m = 0.0
        for _ in range(60):
            reach_m = max(self._settings.gap_m, min(0.3 * rough.curve.length_m, 40.0))
            inliers = self._inliers(rough, reach_m, self._settings.gap_m)
            if len(inliers) < 4:
                return None
            rough = Rough(fit(self._points_m[inliers], rough.curve.direction), radius_m)
            if rough.curve.length_m < done_m + 0.5:
                return rough
            done_m = rough.curve.length_m
        return rough

    def _inliers(self, rough: Rough, reach_m: float, gap_m: float) -> IntArray:
        """Free points on the curve, up to `reach_m` beyond its ends, up to the first gap."""
        on = self._on(rough, reach_m)
        on = on[self._free[on]]
        along = rough.curve.coordinates(self._points_m[on])[:, 0]
        order = np.argsort(along)
        on, along = on[order], along[order]
        middle = float(np.mean(rough.curve.extent_m))
        gaps = np.flatnonzero(np.diff(along) > gap_m)
        below = gaps[along[gaps] < middle]
        above = gaps[along[gaps] >= middle]
        first = below[-1] + 1 if len(below) else 0
        last = above[0] + 1 if len(above) else len(on)
        return on[first:last]

    def _on(self, rough: Rough, reach_m: float = 1.0) -> IntArray:
        """Points of the search within the radius of the curve."""
        coordinates = rough.curve.coordinates(self._points_m)
        return np.flatnonzero(rough.curve.near(coordinates, rough.radius_m, reach_m))

    def _is_conductor(self, rough: Rough) -> bool:
        curve = rough.curve
        if curve.length_m < self._settings.least_length_m:
            return False
        count = len(self._on(rough))
        if count < self._settings.least_points:
            return False
        if rough.radius_m < self._settings.bundle_radius_m:
            beside = len(self._on(Rough(curve, _GAP * rough.radius_m))) - count
            if beside > _MOST_IN_GAP * count:
                return False
        sags_upwards = curve.vertical[2] + 3.0 * math.sqrt(curve.covariance[5, 5]) < 0.0
        return not sags_upwards and self._hangs_free(curve)

    def _hangs_free(self, curve: Catenary) -> bool:
        """Returns True if few other points lie close around, along most of the curve.

        Points on lines parallel to it are those of other wires.
        """
        coordinates = curve.coordinates(self._points_m)
        around = curve.near(coordinates, 1.5, 0.0)
        near = coordinates[around]
        own = np.hypot(*curve.residuals(near).T) <= self._settings.bundle_radius_m
        other = ~own & ~self._lines.parallel(curve.direction, _PARALLEL_COSINE)[around]
        edges = np.arange(curve.extent_m[0], curve.extent_m[1] + 4.0, 4.0)
        own_count, _ = np.histogram(near[own, 0], edges)
        other_count, _ = np.histogram(near[other, 0], edges)
        crowded = other_count > own_count
        return float(crowded.mean()) < 0.4

    def _parallel(self, roughs: list[Rough]) -> list[Rough]:
        """Sparse wires parallel to found conductors, as earth wires are: their shape, shifted."""
        found: list[Rough] = []
        radius_m = self._settings.bundle_radius_m
        for curve, _ in sorted(roughs, key=lambda rough: -rough.curve.length_m):
            for candidate in self._shifted(curve):
                grown = Rough(fit(self._points_m[candidate], curve.direction), radius_m)
                gap_m = self._settings.sparse_gap_m
                on = self._beside(curve, self._inliers(grown, gap_m, gap_m))
                if len(on) < self._settings.least_points:
                    continue
                grown = Rough(fit(self._points_m[on], curve.direction), radius_m)
                if self._is_conductor(grown) and grown.curve.length_m > 0.4 * curve.length_m:
                    found.append(grown)
                    self._free[self._on(grown)] = False
        return found

    def _beside(self, curve: Catenary, points: IntArray) -> IntArray:
        """Points beside a curve; beyond its ends nothing shows that a parallel wire continues."""
        along = curve.coordinates(self._points_m[points])[:, 0]
        low, high = curve.extent_m
        reach_m = self._settings.gap_m
        return points[(along >= low - reach_m) & (along <= high + reach_m)]

    def _shifted(self, curve: Catenary) -> Iterator[IntArray]:
        """Free points near the curve after a shift across and up, for each shift with support."""
        coordinates = curve.coordinates(self._points_m)
        low, high = curve.extent_m
        within = self._free & (coordinates[:, 0] >= low) & (coordinates[:, 0] <= high)
        for _ in range(8):
            free = np.flatnonzero(within & self._free)
            offset = curve.residuals(coordinates[free])
            beside = (abs(offset[:, 0]) < 25.0) & (offset[:, 1] > -1.0) & (offset[:, 1] < 25.0)
            free, offset = free[beside], offset[beside]
            if len(free) < self._settings.least_points:
                return
            tree = KDTree(offset)
            chosen = self._random.choice(len(free), size=min(64, len(free)), replace=False)
            near = tree.query_ball_point(offset[chosen], 1.0)
            # Support is the covered length: a tree has many points over a short piece.
            support = [
                len(np.unique((coordinates[free[each], 0] // 5.0).astype(int))) for each in near
            ]
            best = int(np.argmax(support))
            if support[best] < max(4, 0.25 * curve.length_m / 5.0):
                return
            yield free[near[best]]
            within[free[near[best]]] = False

    # --- from curves to conductors

    def _merged(self, roughs: list[Rough]) -> list[Rough]:
        """The conductors, with the pieces of one conductor of one span joined."""
        pieces = sorted(roughs, key=lambda rough: -rough.curve.length_m)
        merged: list[Rough] = []
        for piece in pieces:
            for index, other in enumerate(merged):
                joined = self._joined(other, piece)
                if joined is not None:
                    merged[index] = joined
                    break
            else:
                merged.append(piece)
        return merged

    def _joined(self, first: Rough, second: Rough) -> Rough | None:
        samples = second.curve.points_at(np.linspace(*second.curve.extent_m, 12))
        coordinates = first.curve.coordinates(samples)
        distance = np.hypot(*first.curve.residuals(coordinates).T)
        radius_m = max(first.radius_m, second.radius_m)
        # Side by side they are two wires, unless they are parts of a bundle.
        apart = coordinates[:, 0].max() < first.curve.extent_m[0]
        apart |= coordinates[:, 0].min() > first.curve.extent_m[1]
        alone = min(first.radius_m, second.radius_m) == self._settings.bundle_radius_m
        if float(np.median(distance)) > (2.0 * radius_m if apart or alone else radius_m):
            return None
        both = np.union1d(self._on(first), self._on(second))
        joined = Rough(fit(self._points_m[both], first.curve.direction), radius_m)
        residuals = joined.curve.residuals(joined.curve.coordinates(self._points_m[both]))
        good = float((np.hypot(*residuals.T) <= radius_m).mean()) > 0.95
        return joined if good else None

    def _detected(self, roughs: list[Rough]) -> tuple[DetectedConductor, ...]:
        roughs = sorted(roughs, key=lambda rough: -len(self._on(rough)))
        groups = wire_groups(self._all_m, roughs)
        owner = owners(self._all_m, groups)
        found = []
        for number, group in enumerate(groups):
            inliers = np.flatnonzero(owner == number)
            few = len(inliers) < self._settings.least_points
            if few or group.sigma_m > self._settings.max_sigma_m:
                continue
            others = (owner >= 0) & (owner != number)
            conductor = self._conductor(group, inliers, others)
            if conductor.confidence >= self._settings.least_confidence:
                found.append(conductor)
        return tuple(sorted(found, key=lambda each: -len(each.inliers)))

    def _conductor(
        self, group: WireGroup, inliers: IntArray, others: BoolArray
    ) -> DetectedConductor:
        """others: mask of the points of other conductors."""
        curve = group.curve
        coordinates = curve.coordinates(self._all_m)
        around = curve.near(coordinates, 1.5, 0.0) & ~others
        along = np.sort(coordinates[inliers, 0])
        window_m = max(2.0, 3.0 * float(np.median(np.diff(along))))
        bins = max(1, math.ceil(curve.length_m / window_m))
        reached, _ = np.histogram(along, bins, range=curve.extent_m)
        own = around[inliers].sum()
        return DetectedConductor(
            curve=_moved(curve, self._centre),
            wires=tuple(_moved(wire, self._centre) for wire in group.wires),
            inliers=self._high[inliers],
            sigma_m=group.sigma_m,
            covered=float((reached > 0).mean()),
            clear=float(own / max(int(around.sum()), 1)),
        )


def _moved(curve: Catenary, by_m: FloatArray) -> Catenary:
    return replace(curve, origin_m=curve.origin_m + by_m)

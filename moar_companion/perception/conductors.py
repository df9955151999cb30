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

from .catenary import Catenary, fit, wires_of

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]


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
    return _Search(points_m, high, settings).run()


class _Search:
    """State of one search: the points that belong to no conductor yet."""

    def __init__(self, points_m: FloatArray, high: IntArray, settings: DetectorSettings) -> None:
        self._settings = settings
        self._random = np.random.default_rng(settings.seed)
        self._centre = points_m[high].mean(axis=0) if len(high) else np.zeros(3)
        self._all_m = points_m[high] - self._centre
        self._high = high
        self._points_m = _thinned(self._all_m, settings.voxel_m)
        self._free = np.ones(len(self._points_m), dtype=bool)
        self._tree = KDTree(self._points_m) if len(self._points_m) else None

    def run(self) -> tuple[DetectedConductor, ...]:
        if self._tree is None:
            return ()
        curves = self._curves()
        curves += self._parallel(curves)
        curves = self._merged(curves)
        return self._detected(curves)

    # --- lines

    def _curves(self) -> list[Catenary]:
        directions, widths = self._local_lines()
        steepest = math.sin(math.radians(self._settings.max_slope_deg))
        line_like = (widths <= self._settings.max_width) & (abs(directions[:, 2]) <= steepest)
        candidate = line_like.copy()
        curves: list[Catenary] = []
        while candidate.sum() >= self._settings.least_points // 2:
            line = self._best_line(np.flatnonzero(candidate), directions)
            if line is None:
                break
            at, along = line
            near = self._within(at, along)
            curve = self._grown(near, along) if len(near) >= 4 else None
            if curve is not None and self._is_conductor(curve):
                curves.append(curve)
                taken = self._on(curve, self._settings.bundle_radius_m)
                self._free[taken] = False
                candidate[taken] = False
            candidate[near] = False
        return curves

    def _local_lines(self) -> tuple[FloatArray, FloatArray]:
        """Direction (n, 3) of each point's neighbourhood, and its width over its length."""
        count = len(self._points_m)
        assert self._tree is not None
        directions = np.zeros((count, 3))
        widths = np.ones(count)
        padded = np.vstack((self._points_m, np.full((1, 3), np.nan)))
        for part in np.array_split(np.arange(count), max(1, count // 20_000)):
            _, neighbours = self._tree.query(
                self._points_m[part], k=24, distance_upper_bound=self._settings.neighbourhood_m
            )
            around = padded[neighbours]
            known = (neighbours < count).sum(axis=1)
            offset = around - np.nanmean(around, axis=1, keepdims=True)
            offset = np.nan_to_num(offset)
            spread = np.einsum("nki,nkj->nij", offset, offset)
            values, vectors = np.linalg.eigh(spread)
            directions[part] = vectors[:, :, 2]
            width = np.sqrt(np.maximum(values[:, 1], 0.0) / np.maximum(values[:, 2], 1e-12))
            widths[part] = np.where(known >= 5, width, 1.0)
        return directions, widths

    def _best_line(
        self, candidates: IntArray, directions: FloatArray
    ) -> tuple[FloatArray, FloatArray] | None:
        """RANSAC: the line through two points, along both neighbourhoods, with most support."""
        points = self._points_m[candidates]
        chosen = self._random.choice(len(candidates), size=self._settings.hypotheses, replace=True)
        first = points[chosen]
        along = directions[candidates[chosen]]
        # Second point of each pair: one in the window, as far along the direction of the first.
        best, support = None, self._settings.least_points // 2 - 1
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
                count = int((miss <= self._settings.seed_radius_m).sum())
                if count > support:
                    best, support = (at, line), count
        return best

    def _within(self, at: FloatArray, along: FloatArray) -> IntArray:
        """Free points in the cylinder of a line."""
        assert self._tree is not None
        near = np.array(self._tree.query_ball_point(at, self._settings.window_m), dtype=np.intp)
        near = near[self._free[near]]
        offset = self._points_m[near] - at
        run = offset @ along
        miss = np.sqrt(np.maximum((offset**2).sum(axis=1) - run**2, 0.0))
        return np.asarray(near[miss <= self._settings.seed_radius_m])

    # --- catenaries

    def _grown(self, near: IntArray, along: FloatArray) -> Catenary | None:
        """The catenary of a line's points, extended at both ends as long as points lie on it."""
        direction = along[:2] / np.hypot(*along[:2])
        curve = fit(self._points_m[near], direction)
        done_m = 0.0
        for _ in range(60):
            reach_m = max(self._settings.gap_m, min(0.3 * curve.length_m, 40.0))
            inliers = self._inliers(curve, reach_m, self._settings.gap_m)
            if len(inliers) < 4:
                return None
            curve = fit(self._points_m[inliers], curve.direction)
            if curve.length_m < done_m + 0.5:
                return curve
            done_m = curve.length_m
        return curve

    def _inliers(self, curve: Catenary, reach_m: float, gap_m: float) -> IntArray:
        """Free points on the curve, up to `reach_m` beyond its ends, up to the first gap."""
        on = self._on(curve, self._settings.bundle_radius_m, reach_m)
        on = on[self._free[on]]
        along = curve.coordinates(self._points_m[on])[:, 0]
        order = np.argsort(along)
        on, along = on[order], along[order]
        middle = float(np.mean(curve.extent_m))
        gaps = np.flatnonzero(np.diff(along) > gap_m)
        below = gaps[along[gaps] < middle]
        above = gaps[along[gaps] >= middle]
        first = below[-1] + 1 if len(below) else 0
        last = above[0] + 1 if len(above) else len(on)
        return on[first:last]

    def _on(self, curve: Catenary, radius_m: float, reach_m: float = 1.0) -> IntArray:
        """Points of the search within a radius of the curve."""
        coordinates = curve.coordinates(self._points_m)
        return np.flatnonzero(curve.near(coordinates, radius_m, reach_m))

    def _is_conductor(self, curve: Catenary) -> bool:
        if curve.length_m < self._settings.least_length_m:
            return False
        on = self._on(curve, self._settings.bundle_radius_m)
        if len(on) < self._settings.least_points:
            return False
        sags_upwards = curve.vertical[2] + 3.0 * math.sqrt(curve.covariance[5, 5]) < 0.0
        return not sags_upwards and self._hangs_free(curve)

    def _hangs_free(self, curve: Catenary) -> bool:
        """Returns True if few other points lie close around, along most of the curve."""
        coordinates = curve.coordinates(self._points_m)
        near = coordinates[curve.near(coordinates, 1.5, 0.0)]
        distance = np.hypot(*curve.residuals(near).T)
        own = distance <= self._settings.bundle_radius_m
        edges = np.arange(curve.extent_m[0], curve.extent_m[1] + 4.0, 4.0)
        own_count, _ = np.histogram(near[own, 0], edges)
        other_count, _ = np.histogram(near[~own, 0], edges)
        crowded = other_count > own_count
        return float(crowded.mean()) < 0.4

    def _parallel(self, curves: list[Catenary]) -> list[Catenary]:
        """Sparse wires parallel to found conductors, as earth wires are: their shape, shifted."""
        found: list[Catenary] = []
        for curve in sorted(curves, key=lambda curve: -curve.length_m):
            for candidate in self._shifted(curve):
                grown = fit(self._points_m[candidate], curve.direction)
                gap_m = self._settings.sparse_gap_m
                on = self._inliers(grown, gap_m, gap_m)
                on = self._beside(curve, on)
                if len(on) < self._settings.least_points:
                    continue
                grown = fit(self._points_m[on], curve.direction)
                if self._is_conductor(grown) and grown.length_m > 0.4 * curve.length_m:
                    found.append(grown)
                    self._free[self._on(grown, self._settings.bundle_radius_m)] = False
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

    def _merged(self, curves: list[Catenary]) -> list[Catenary]:
        """The curves, with the pieces of one conductor of one span joined."""
        pieces = sorted(curves, key=lambda curve: -curve.length_m)
        merged: list[Catenary] = []
        for piece in pieces:
            for index, other in enumerate(merged):
                joined = self._joined(other, piece)
                if joined is not None:
                    merged[index] = joined
                    break
            else:
                merged.append(piece)
        return merged

    def _joined(self, first: Catenary, second: Catenary) -> Catenary | None:
        samples = second.points_at(np.linspace(*second.extent_m, 12))
        distance = np.hypot(*first.residuals(first.coordinates(samples)).T)
        if float(np.median(distance)) > 2.0 * self._settings.bundle_radius_m:
            return None
        both = np.union1d(
            self._on(first, self._settings.bundle_radius_m),
            self._on(second, self._settings.bundle_radius_m),
        )
        curve = fit(self._points_m[both], first.direction)
        miss = np.hypot(*curve.residuals(curve.coordinates(self._points_m[both])).T)
        good = float((miss <= self._settings.bundle_radius_m).mean()) > 0.95
        return curve if good else None

    def _detected(self, curves: list[Catenary]) -> tuple[DetectedConductor, ...]:
        owner = np.full(len(self._all_m), -1)
        distance_of = np.full(len(self._all_m), np.inf)
        refined: list[tuple[Catenary, tuple[Catenary, ...], float]] = []
        for number, rough in enumerate(curves):
            coordinates = rough.coordinates(self._all_m)
            on = np.flatnonzero(rough.near(coordinates, self._settings.bundle_radius_m, 1.0))
            curve, wires, sigma = wires_of(self._all_m[on], rough)
            refined.append((curve, wires, sigma))
            radius_m = min(max(4.0 * sigma, 0.12), 0.4)
            for wire in wires:
                at = wire.coordinates(self._all_m)
                near = np.flatnonzero(wire.near(at, radius_m, 1.0))
                distance = np.hypot(*wire.residuals(at[near]).T)
                nearer = distance < distance_of[near]
                owner[near[nearer]] = number
                distance_of[near[nearer]] = distance[nearer]
        found = []
        for number, (curve, wires, sigma) in enumerate(refined):
            inliers = np.flatnonzero(owner == number)
            if len(inliers) < self._settings.least_points or sigma > self._settings.max_sigma_m:
                continue
            conductor = self._conductor(curve, wires, sigma, inliers)
            if conductor.confidence >= self._settings.least_confidence:
                found.append(conductor)
        return tuple(sorted(found, key=lambda each: -len(each.inliers)))

    def _conductor(
        self, curve: Catenary, wires: tuple[Catenary, ...], sigma: float, inliers: IntArray
    ) -> DetectedConductor:
        coordinates = curve.coordinates(self._all_m)
        around = curve.near(coordinates, 1.5, 0.0)
        along = np.sort(coordinates[inliers, 0])
        window_m = max(2.0, 3.0 * float(np.median(np.diff(along))))
        bins = max(1, math.ceil(curve.length_m / window_m))
        reached, _ = np.histogram(along, bins, range=curve.extent_m)
        own = around[inliers].sum()
        return DetectedConductor(
            curve=_moved(curve, self._centre),
            wires=tuple(_moved(wire, self._centre) for wire in wires),
            inliers=self._high[inliers],
            sigma_m=sigma,
            covered=float((reached > 0).mean()),
            clear=float(own / max(int(around.sum()), 1)),
        )


def _thinned(points_m: FloatArray, voxel_m: float) -> FloatArray:
    """One point of each voxel: the first."""
    voxels = (
        np.floor((points_m - points_m.min(axis=0)) / voxel_m).astype(np.int64)
        if len(points_m)
        else np.zeros((0, 3), dtype=np.int64)
    )
    sizes = voxels.max(axis=0) + 1 if len(voxels) else np.ones(3, dtype=np.int64)
    _, first = np.unique(
        (voxels[:, 0] * sizes[1] + voxels[:, 1]) * sizes[2] + voxels[:, 2], return_index=True
    )
    return points_m[np.sort(first)]


def _moved(curve: Catenary, by_m: FloatArray) -> Catenary:
    return replace(curve, origin_m=curve.origin_m + by_m)

"""One conductor of one span as a curve: a catenary along a horizontal direction.

The curve has coordinates along its direction (`along`), to the left of it (`lateral`) and up. Wind
swings a conductor out of the vertical plane, so the lateral position is a parabola.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

_STRAIGHT_PER_M = 1e-7
"""Curvature below which a catenary is computed as a line: 1 mm of sag over 280 m."""
_ITERATIONS = 12
_LEAST_VERTICAL, _GREATEST_VERTICAL = (-np.inf, -2.0, -0.05), (np.inf, 2.0, 0.05)
"""Limits of height, slope and curvature; without them the iteration diverges."""
_TUKEY = 4.685
"""Tuning constant of Tukey's biweight: 95 % efficiency on normal errors."""

_RAYLEIGH_MEDIAN = 1.1774
"""Median distance from a centre in the plane, of deviation 1 along each axis."""
_TWO_CENTRES = 3.2
"""Least distance of the medians of two halves over their deviation, for two wires. One normal
distribution has 2.3, a uniform one 2.7."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Catenary:
    """z = z0 + (cosh(k s + asinh m) - cosh(asinh m)) / k along s, y = a0 + a1 s + a2 s².

    origin_m: (3,) where s = 0, y = 0, z = 0; direction: (2,) horizontal unit vector of s.
    lateral: (a0 in m, a1, a2 in 1/m); vertical: (z0 in m, slope m, curvature k in 1/m), whose
    catenary constant is 1/k. covariance: (6, 6) of both, in this order.
    """

    origin_m: FloatArray
    direction: FloatArray
    lateral: FloatArray
    vertical: FloatArray
    covariance: FloatArray
    extent_m: tuple[float, float]
    """Least and greatest s of the measured points."""

    @property
    def length_m(self) -> float:
        """Horizontal length that the measured points cover."""
        return self.extent_m[1] - self.extent_m[0]

    @property
    def constant_m(self) -> float:
        """Horizontal tension over weight per metre; inf for a straight line."""
        curvature = float(self.vertical[2])
        return 1.0 / curvature if curvature > _STRAIGHT_PER_M else math.inf

    @cached_property
    def left(self) -> FloatArray:
        """(2,) horizontal unit vector to the left of the direction."""
        return np.array([-self.direction[1], self.direction[0]])

    def coordinates(self, points_m: FloatArray) -> FloatArray:
        """(n, 3): along, lateral, up of (n, 3) points."""
        offset = points_m - self.origin_m
        return np.column_stack(
            (offset[:, :2] @ self.direction, offset[:, :2] @ self.left, offset[:, 2])
        )

    def residuals(self, coordinates_m: FloatArray) -> FloatArray:
        """(n, 2) lateral and up from the curve, perpendicular to it, of (n, 3) coordinates."""
        along = coordinates_m[:, 0]
        inclination = np.cos(np.arctan(self.slope(along)))
        return np.column_stack(
            (
                coordinates_m[:, 1] - np.polynomial.polynomial.polyval(along, self.lateral),
                (coordinates_m[:, 2] - _height(self.vertical, along)) * inclination,
            )
        )

    def near(self, coordinates_m: FloatArray, radius_m: float, reach_m: float) -> BoolArray:
        """Mask (n,) of points within a radius of the curve, up to `reach_m` beyond its ends."""
        low, high = self.extent_m
        near = (coordinates_m[:, 0] >= low - reach_m) & (coordinates_m[:, 0] <= high + reach_m)
        inside = np.flatnonzero(near)
        distance = np.hypot(*self.residuals(coordinates_m[inside]).T)
        near[inside[distance > radius_m]] = False
        return near

    def slope(self, along_m: FloatArray) -> FloatArray:
        """Slope dz/ds of the curve."""
        _, slope, curvature = self.vertical
        return np.asarray(np.sinh(curvature * along_m + math.asinh(slope)))

    def points_at(self, along_m: FloatArray) -> FloatArray:
        """Points (n, 3) of the curve."""
        lateral = np.polynomial.polynomial.polyval(along_m, self.lateral)
        horizontal = np.outer(along_m, self.direction) + np.outer(lateral, self.left)
        return np.asarray(
            np.column_stack((horizontal, _height(self.vertical, along_m))) + self.origin_m
        )

    def covariance_at(self, along_m: float) -> FloatArray:
        """(2, 2) covariance of the lateral position and the height at s, in m²."""
        jacobian = np.zeros((2, 6))
        jacobian[0, :3] = 1.0, along_m, along_m**2
        jacobian[1, 3:] = _jacobian(self.vertical, np.array([along_m]))[0]
        return jacobian @ self.covariance @ jacobian.T

    def crossing(self, point_m: FloatArray, normal: FloatArray) -> float:
        """Coordinate s where the curve crosses the vertical plane through a point; normal: (2,).

        Wind turns the curve by a few degrees at most: a few steps of Newton's method converge.
        """
        along_m = 0.0
        for _ in range(4):
            at = self.points_at(np.array([along_m]))[0, :2]
            bend = self.lateral[1] + 2.0 * self.lateral[2] * along_m
            towards = float((self.direction + bend * self.left) @ normal)
            if abs(towards) < 1e-6:
                return math.inf
            along_m += float((point_m[:2] - at) @ normal) / towards
        return along_m


def fit(points_m: FloatArray, direction: FloatArray, *, scale_m: float | None = None) -> Catenary:
    """The catenary through (n, 3) points, n at least 4, robust to a minority of outliers.

    Iteratively reweighted least squares with Tukey's biweight. `scale_m` is the standard deviation
    of good points; without it, the median of the residuals gives the estimate.
    """
    direction = _fitted_direction(points_m, direction)
    origin = np.median(points_m, axis=0)
    curve = Catenary(
        origin_m=origin,
        direction=direction,
        lateral=np.zeros(3),
        vertical=np.zeros(3),
        covariance=np.zeros((6, 6)),
        extent_m=(0.0, 0.0),
    )
    coordinates = curve.coordinates(points_m)
    along = coordinates[:, 0]
    half_length = max(float(np.ptp(along)) / 2.0, 1.0)
    powers = np.column_stack((np.ones_like(along), along, along**2))
    # A short piece does not determine the curvature: the prior pulls it to a straight line.
    prior = np.diag([0.0, 0.0, (half_length**2 / 50.0) ** 2])
    weights: FloatArray = np.ones(len(along))
    lateral: FloatArray = np.zeros(3)
    vertical: FloatArray = np.zeros(3)
    sigma = 1.0
    for _ in range(_ITERATIONS):
        normal = (powers * weights[:, None]).T @ powers + prior
        lateral = np.asarray(
            np.linalg.solve(normal, powers.T @ (weights * coordinates[:, 1])), float
        )
        jacobian = _jacobian(vertical, along)
        left_over = coordinates[:, 2] - _height(vertical, along)
        step = np.linalg.solve(
            (jacobian * weights[:, None]).T @ jacobian + prior,
            jacobian.T @ (weights * left_over) - prior @ vertical,
        )
        vertical = np.clip(vertical + step, _LEAST_VERTICAL, _GREATEST_VERTICAL)
        curve = replace(curve, lateral=lateral, vertical=vertical)
        distance = np.hypot(*curve.residuals(coordinates).T)
        sigma = scale_m or max(float(np.median(distance)) / _RAYLEIGH_MEDIAN, 1e-3)
        weights = np.asarray(np.maximum(1.0 - (distance / (_TUKEY * sigma)) ** 2, 0.0) ** 2)
        if weights.sum() < 4.0:
            weights = np.ones(len(along))
    used = weights > 0.0
    spread = curve.residuals(coordinates[used])
    freedom = max(int(used.sum()) - 3, 1)
    variance = np.maximum((spread**2).sum(axis=0) / freedom, 1e-8)
    covariance = np.zeros((6, 6))
    normal = (powers * weights[:, None]).T @ powers + prior
    covariance[:3, :3] = variance[0] * np.linalg.inv(normal)
    jacobian = _jacobian(vertical, along)
    covariance[3:, 3:] = variance[1] * np.linalg.inv(
        (jacobian * weights[:, None]).T @ jacobian + prior
    )
    return replace(
        curve,
        covariance=covariance,
        extent_m=(float(along[used].min()), float(along[used].max())),
    )


def wires_of(
    points_m: FloatArray, curve: Catenary, depth: int = 2
) -> tuple[Catenary, tuple[Catenary, ...], float]:
    """The curve fitted again, its sub-conductors, and the deviation of points from these.

    The points of a bundle lie about two centres along the first axis of their residuals; those of a
    bundle of four lie two by two.
    """
    curve = fit(points_m, curve.direction)
    residuals = curve.residuals(curve.coordinates(points_m))
    distance = np.hypot(*residuals.T)
    sigma = float(np.median(distance)) / _RAYLEIGH_MEDIAN
    if depth == 0 or len(points_m) < 20:
        return curve, (curve,), sigma
    _, _, axes = np.linalg.svd(residuals - np.median(residuals, axis=0), full_matrices=False)
    across = residuals @ axes[0]
    low, high = np.percentile(across, (10.0, 90.0))
    for _ in range(20):
        upper = across > (low + high) / 2.0
        if upper.all() or not upper.any():
            return curve, (curve,), sigma
        low, high = float(np.median(across[~upper])), float(np.median(across[upper]))
    width = 1.4826 * np.median(np.abs(across - np.where(upper, high, low)))
    share = min(upper.mean(), 1.0 - upper.mean())
    if high - low < _TWO_CENTRES * width or high - low < 0.15 or share < 0.2:
        return curve, (curve,), sigma
    _, one, sigma_one = wires_of(points_m[~upper], curve, depth - 1)
    _, two, sigma_two = wires_of(points_m[upper], curve, depth - 1)
    return curve, (*one, *two), (sigma_one + sigma_two) / 2.0


def _fitted_direction(points_m: FloatArray, direction: FloatArray) -> FloatArray:
    """Horizontal direction of the points, on the side of the given direction."""
    offset = points_m[:, :2] - np.median(points_m[:, :2], axis=0)
    along = offset @ direction
    across = offset @ np.array([-direction[1], direction[0]])
    spread = float(along @ along)
    turn = float(along @ across) / spread if spread > 0.0 else 0.0
    turned = direction + turn * np.array([-direction[1], direction[0]])
    return np.asarray(turned / np.hypot(*turned))


def _height(vertical: FloatArray, along_m: FloatArray) -> FloatArray:
    height, slope, curvature = vertical
    if abs(curvature) < _STRAIGHT_PER_M:
        return np.asarray(height + slope * along_m)
    half = curvature * along_m / 2.0
    return np.asarray(height + 2.0 * np.sinh(math.asinh(slope) + half) * np.sinh(half) / curvature)


def _jacobian(vertical: FloatArray, along_m: FloatArray) -> FloatArray:
    """(n, 3) derivatives of the height by z0, slope and curvature."""
    _, slope, curvature = vertical
    steepness = math.hypot(1.0, slope)
    if abs(curvature) < _STRAIGHT_PER_M:
        return np.column_stack((np.ones_like(along_m), along_m, steepness * along_m**2 / 2.0))
    angle = curvature * along_m + math.asinh(slope)
    rise = (np.cosh(angle) - steepness) / curvature
    run = (np.sinh(angle) - slope) / curvature
    return np.column_stack(
        (np.ones_like(along_m), run / steepness, (along_m * np.sinh(angle) - rise) / curvature)
    )

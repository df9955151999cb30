"""Rough curves to conductors: the wires of each, bundles of wires, and the wire of each point."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from .catenary import Catenary, fit, wires_of

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

_SAME_WIRE_M = 0.2
"""Distance within which two wires are one that was found twice; those of a bundle are farther
apart."""
_BUNDLE_M = 0.55
"""Greatest distance of neighbouring wires of one bundle."""
_MOST_IN_BUNDLE = 4
"""Greatest number of wires in a bundle; more wires are as many conductors."""
_LEAST_OWN_M, _MOST_OWN_M = 0.12, 0.4
"""Limits of the distance from a wire within which points are its own: four deviations."""


class Rough(NamedTuple):
    """A conductor of the search. radius_m: about the curve, within which its points lie."""

    curve: Catenary
    radius_m: float


class WireGroup(NamedTuple):
    """A conductor: the curve of its centre, its wires, and the deviation of points from these.

    points: (k,) indices of the points about the curve.
    """

    curve: Catenary
    wires: tuple[Catenary, ...]
    sigma_m: float
    points: IntArray


def wire_groups(points_m: FloatArray, roughs: Iterable[Rough]) -> list[WireGroup]:
    """Conductors through (n, 3) points: each wire once, wires of one bundle together."""
    groups: list[WireGroup] = []
    for curve, radius_m in roughs:
        points = np.flatnonzero(curve.near(curve.coordinates(points_m), radius_m, 1.0))
        fitted, wires, sigma_m = wires_of(points_m[points], curve)
        known = [wire for group in groups for wire in group.wires]
        new = tuple(
            wire for wire in wires if all(_apart_m(other, wire) > _SAME_WIRE_M for other in known)
        )
        if new:
            groups.append(WireGroup(fitted, new, sigma_m, points))
    return _bundled(points_m, groups)


def _bundled(points_m: FloatArray, groups: list[WireGroup]) -> list[WireGroup]:
    """The groups, with those joined that make up one bundle."""
    clusters: list[list[WireGroup]] = []
    for group in groups:
        near = [
            cluster
            for cluster in clusters
            if any(
                _apart_m(first, second) <= _BUNDLE_M
                for other in cluster
                for first in other.wires
                for second in group.wires
            )
        ]
        clusters = [cluster for cluster in clusters if not any(cluster is each for each in near)]
        clusters.append([each for cluster in near for each in cluster] + [group])
    bundled: list[WireGroup] = []
    for cluster in clusters:
        wires = tuple(wire for group in cluster for wire in group.wires)
        if len(cluster) == 1 or len(wires) > _MOST_IN_BUNDLE:
            bundled += cluster
            continue
        points = np.unique(np.concatenate([group.points for group in cluster]))
        curve = fit(points_m[points], cluster[0].curve.direction)
        sigma_m = float(np.mean([group.sigma_m for group in cluster]))
        bundled.append(WireGroup(curve, wires, sigma_m, points))
    return bundled


def owners(points_m: FloatArray, groups: list[WireGroup]) -> IntArray:
    """Number (n,) of the group with the nearest wire to each of (n, 3) points; -1 without one."""
    owner = np.full(len(points_m), -1)
    least_m = np.full(len(points_m), np.inf)
    for number, group in enumerate(groups):
        own_m = min(max(4.0 * group.sigma_m, _LEAST_OWN_M), _MOST_OWN_M)
        for wire in group.wires:
            at = wire.coordinates(points_m)
            near = np.flatnonzero(wire.near(at, own_m, 1.0))
            distance = np.hypot(*wire.residuals(at[near]).T)
            nearer = distance < least_m[near]
            owner[near[nearer]] = number
            least_m[near[nearer]] = distance[nearer]
    return owner


def _apart_m(first: Catenary, second: Catenary) -> float:
    """Median distance of the second one from the first, where they hang side by side."""
    samples = first.coordinates(second.points_at(np.linspace(*second.extent_m, 12)))
    low, high = first.extent_m
    beside = (samples[:, 0] >= low - 1.0) & (samples[:, 0] <= high + 1.0)
    if beside.mean() <= 0.5:
        return float("inf")
    return float(np.median(np.hypot(*first.residuals(samples[beside]).T)))

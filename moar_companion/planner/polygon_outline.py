"""Check of vertices as the outline of a filled shape: simple, and around some area."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import numpy.typing as npt


def outline_problem(vertices_m: npt.NDArray[np.float64]) -> str | None:
    """Reason why vertices, shape (n, 2), are no outline of a filled shape; None if they are."""
    points = vertices_m - vertices_m[0]
    count = len(points)
    following = np.roll(points, -1, axis=0)
    edges = following - points
    scale = float(np.abs(points).max())
    tolerance = 1e-12 * scale * scale
    lengths = np.hypot(edges[:, 0], edges[:, 1])
    repeated = np.flatnonzero(lengths <= 1e-12 * scale)
    if repeated.size:
        first = int(repeated[0])
        return f"has the same vertex at [{first}] and [{(first + 1) % count}], must differ"
    farthest = points[np.argmax(np.hypot(points[:, 0], points[:, 1]))]
    if np.all(np.abs(_cross(farthest, points)) <= tolerance):
        return "encloses no area, must not lie on a line"
    for first, second in itertools.pairwise([*range(count), 0]):
        if (
            abs(_cross(edges[first], edges[second])) <= tolerance
            and float(edges[first] @ edges[second]) < 0.0
        ):
            return f"folds back on itself at [{second}], must be a simple outline"
    for first in range(count - 2):
        # Against all later edges that share no vertex with it.
        others = np.arange(first + 2, count - 1 if first == 0 else count)
        crossing = _touching(
            points[first], following[first], points[others], following[others], tolerance
        )
        if crossing.any():
            second = int(others[np.flatnonzero(crossing)[0]])
            return (
                f"crosses itself (edge [{first}]-[{first + 1}] and edge "
                f"[{second}]-[{(second + 1) % count}]), must be a simple outline"
            )
    return None


def _touching(
    start: npt.NDArray[np.float64],
    end: npt.NDArray[np.float64],
    starts: npt.NDArray[np.float64],
    ends: npt.NDArray[np.float64],
    tolerance: float,
) -> npt.NDArray[np.bool_]:
    """Mask of the n segments, shape (n, 2) each, that share a point with one segment."""

    def side(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        return np.where(np.abs(values) <= tolerance, 0.0, np.sign(values))

    apart = side(_cross(end - start, starts - start)) * side(_cross(end - start, ends - start))
    across = side(_cross(ends - starts, start - starts)) * side(_cross(ends - starts, end - starts))
    overlapping = np.all(
        (np.maximum(starts, ends) >= np.minimum(start, end))
        & (np.maximum(start, end) >= np.minimum(starts, ends)),
        axis=1,
    )
    touching: npt.NDArray[np.bool_] = (apart <= 0.0) & (across <= 0.0) & overlapping
    return touching


def _cross(first: npt.NDArray[np.float64], second: npt.NDArray[np.float64]) -> Any:
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]

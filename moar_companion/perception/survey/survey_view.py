"""Values of a survey that its picture draws."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


def _no_points(columns: int) -> FloatArray:
    return np.empty((0, columns))


def _no_classes() -> npt.NDArray[np.uint8]:
    return np.empty(0, dtype=np.uint8)


@dataclass(frozen=True, kw_only=True, eq=False)
class SurveyMark:
    """A feature of a survey. points_m: as of SurveyView.

    left_out_m: its distance from the plane if it is left out for that; otherwise None.
    """

    kind: str
    name: str
    points_m: FloatArray
    left_out_m: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class SurveyView:
    """A survey, and the site made from it.

    document: of the site file; points_m: (n, 3) along the line to the right of x, across it and up,
    from the site's origin, with their LAS classes; plane_m: (k, 2) x and z of those near the plane,
    with theirs; left_out_m: (j, 2) points that are no obstacle of the site.
    """

    document: dict[str, Any]
    points_m: FloatArray = field(default_factory=lambda: _no_points(3))
    classes: npt.NDArray[np.uint8] = field(default_factory=_no_classes)
    plane_m: FloatArray = field(default_factory=lambda: _no_points(2))
    plane_classes: npt.NDArray[np.uint8] = field(default_factory=_no_classes)
    left_out_m: FloatArray = field(default_factory=lambda: _no_points(2))
    marks: tuple[SurveyMark, ...] = ()

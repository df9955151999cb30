"""One turn of a lidar, in one form for all sensors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Scan:
    """One turn. points_m: (n, 3), x at azimuth 0, y to the left, z the axis of rotation.

    time_s: (n,) on the receiver's clock; ring: (n,) number of the laser, by elevation. beams:
    number of beams sent; a beam without an echo has no point.
    """

    points_m: FloatArray
    time_s: FloatArray
    ring: npt.NDArray[np.int64]
    beams: int

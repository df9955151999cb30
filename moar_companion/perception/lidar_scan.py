"""One turn of a lidar, whichever sensor it is of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Scan:
    """One turn. points_m: (n, 3), x where the azimuth is 0, y left, z the axis of its rotation.

    time_s: (n,) on the receiver's clock; ring: (n,) number of the laser, by elevation. beams:
    number that were sent; those without an echo have no point.
    """

    points_m: FloatArray
    time_s: FloatArray
    ring: npt.NDArray[np.int64]
    beams: int

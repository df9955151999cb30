"""A scan of a lidar, whatever its kind. Values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True, kw_only=True, eq=False)
class Scan:
    """One turn. points_m: (n, 3), x where the azimuth is 0, y left, z the axis of its rotation.

    time_s: (n,) on the receiver's clock; ring: (n,) number of the laser, by elevation. beams:
    number that were sent; those without an echo have no point.
    """

    points_m: npt.NDArray[np.float64]
    time_s: npt.NDArray[np.float64]
    ring: npt.NDArray[np.int64]
    beams: int

"""One turn of a lidar, in one form for all sensors; and why a packet is refused."""

from __future__ import annotations

import enum
from collections import Counter
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


class PacketFault(str, enum.Enum):
    """Reason why a packet is refused, in words that follow "packets"."""

    CUT = "cut short"
    SIZE = "of another size"
    SENSOR = "of another sensor"
    MODEL = "of an unknown model"
    CHECKSUM = "with a wrong checksum"
    MARKS = "with wrong marks"
    ORDER = "out of order"


def refusals(refused: Counter[PacketFault]) -> str:
    """Counts of refused packets by reason, the most frequent first."""
    if len(refused) == 1:
        return f"all {next(iter(refused)).value}"
    return ", ".join(f"{count} {fault.value}" for fault, count in refused.most_common())

"""Points of a scan in the frame of the site, each with the pose at its own time.

The sensor turns in 0.1 s, in which an aircraft flies a metre and tilts by degrees: every point is
placed with the pose interpolated at its time stamp (motion compensation).
"""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation, Slerp

from ..perception_config import SensorMount

FloatArray = npt.NDArray[np.float64]

_KEPT_S = 2.0
_SLOTS = 256
"""Poses are computed for this many instants of a scan, 0.4 ms apart: a millimetre of flight."""


def mount_rotation(mount: SensorMount) -> Rotation:
    """Rotation from the sensor's axes to the aircraft's."""
    return Rotation.from_euler("xyz", mount.roll_pitch_yaw_deg, degrees=True)


class PoseHistory:
    """Poses of the last seconds: position in the site's frame, and attitude."""

    def __init__(self) -> None:
        self._poses: deque[tuple[float, FloatArray, FloatArray]] = deque()

    def add(self, time_s: float, position_m: FloatArray, attitude: Rotation) -> None:
        """attitude: from the aircraft (x forward, y left, z up) to the site; times must rise."""
        if self._poses and time_s <= self._poses[-1][0]:
            return
        self._poses.append((time_s, np.asarray(position_m, float), attitude.as_quat()))
        while self._poses[0][0] < time_s - _KEPT_S:
            self._poses.popleft()

    def at(self, time_s: FloatArray, *, late_s: float) -> tuple[FloatArray, Rotation] | None:
        """Positions (n, 3) and attitudes at times (n,); None where poses do not reach.

        late_s: a time up to this far after the last pose, or before the first, takes that pose.
        """
        if len(self._poses) < 2:
            return None
        known_s = np.array([each[0] for each in self._poses])
        if time_s.min() < known_s[0] - late_s or time_s.max() > known_s[-1] + late_s:
            return None
        inside = np.clip(time_s, known_s[0], known_s[-1])
        places = np.array([each[1] for each in self._poses])
        position = np.column_stack([np.interp(inside, known_s, axis) for axis in places.T])
        turns = Rotation.from_quat(np.array([each[2] for each in self._poses]))
        return position, Slerp(known_s, turns)(inside)


def points_in_site(
    points_m: FloatArray,
    time_s: FloatArray,
    poses: PoseHistory,
    mount: SensorMount,
    *,
    late_s: float = 0.05,
) -> tuple[FloatArray, FloatArray] | None:
    """(n, 3) points of a scan in the site's frame, and the places (n, 3) of the sensor for each.

    None where the poses do not reach.
    """
    first, last = float(time_s.min()), float(time_s.max())
    slots = np.linspace(first, last, _SLOTS)
    found = poses.at(slots, late_s=late_s)
    if found is None:
        return None
    position, attitude = found
    span = max(last - first, 1e-9)
    slot = np.minimum(((time_s - first) / span * (_SLOTS - 1) + 0.5).astype(np.intp), _SLOTS - 1)
    sensor = position + attitude.apply(np.array(mount.position_m))
    turns = (attitude * mount_rotation(mount)).as_matrix()
    turned = np.einsum("nij,nj->ni", turns[slot], points_m)
    return turned + sensor[slot], sensor[slot]

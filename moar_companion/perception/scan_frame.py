"""Points of a scan in the frame of the site, each with the pose at its own time.

The sensor turns in 0.1 s, in which an aircraft flies a metre and tilts by degrees. Every point is
placed with the pose interpolated at its time stamp (motion compensation).
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation, Slerp

from ..settings.perception_config import SensorMount

FloatArray = npt.NDArray[np.float64]

_KEPT_S = 2.0
_GREATEST_GAP_S = 0.5
"""Longest time between two poses for interpolation."""
_SLOTS = 256
"""Number of pose instants of a scan, 0.4 ms apart: a millimetre of flight."""


def mount_rotation(mount: SensorMount) -> Rotation:
    """Rotation from the sensor's axes to the aircraft's."""
    return Rotation.from_euler("xyz", mount.roll_pitch_yaw_deg, degrees=True)


def attitude_in_site(
    roll_rad: float, pitch_rad: float, yaw_rad: float, azimuth_deg: float
) -> Rotation:
    """Rotation from the aircraft (x forward, y left, z up) to the site.

    roll_rad, pitch_rad, yaw_rad: of the body (forward, right, down) in north, east, down;
    azimuth_deg: of the site's x.
    """
    turned_rad = math.radians(azimuth_deg) - yaw_rad
    return Rotation.from_euler("ZYX", (turned_rad, -pitch_rad, roll_rad))


class PoseHistory:
    """Positions in the site's frame and attitudes of the last seconds, each with its time."""

    def __init__(self) -> None:
        self._positions: deque[tuple[float, FloatArray]] = deque()
        self._attitudes: deque[tuple[float, FloatArray]] = deque()

    def note_position(self, time_s: float, position_m: npt.ArrayLike) -> None:
        """Takes a position (3,); drops one that is not newer than the last.

        One that is 2 s older than the last begins a new history: the last time was wrong.
        """
        _append(self._positions, time_s, np.asarray(position_m, float))

    def note_attitude(self, time_s: float, attitude: Rotation) -> None:
        """Takes an attitude: from the aircraft (x forward, y left, z up) to the site."""
        _append(self._attitudes, time_s, attitude.as_quat())

    def shift(self, step_m: npt.ArrayLike) -> None:
        """Moves all positions by (3,)."""
        step = np.asarray(step_m, float)
        self._positions = deque((time_s, place + step) for time_s, place in self._positions)

    @property
    def until_s(self) -> float:
        """Time up to which both positions and attitudes are available."""
        if not self._positions or not self._attitudes:
            return -math.inf
        return min(self._positions[-1][0], self._attitudes[-1][0])

    def at(self, time_s: FloatArray, *, late_s: float) -> tuple[FloatArray, Rotation] | None:
        """Positions (n, 3) and attitudes at times (n,); None where poses do not reach.

        late_s: times up to this long after the last pose, or before the first, take that pose.
        """
        first_s, last_s = float(time_s.min()), float(time_s.max())
        positions = _around(self._positions, first_s, last_s, late_s)
        attitudes = _around(self._attitudes, first_s, last_s, late_s)
        if positions is None or attitudes is None:
            return None
        known_s, places = positions
        position = np.column_stack([np.interp(time_s, known_s, axis) for axis in places.T])
        known_s, turns = attitudes
        inside_s = np.clip(time_s, known_s[0], known_s[-1])
        return position, Slerp(known_s, Rotation.from_quat(turns))(inside_s)


def _append(known: deque[tuple[float, FloatArray]], time_s: float, value: FloatArray) -> None:
    if known and time_s <= known[-1][0]:
        if time_s >= known[-1][0] - _KEPT_S:
            return
        known.clear()
    known.append((time_s, value))
    while known[0][0] < time_s - _KEPT_S:
        known.popleft()


def _around(
    known: deque[tuple[float, FloatArray]], first_s: float, last_s: float, late_s: float
) -> tuple[FloatArray, FloatArray] | None:
    """Times and values from the last before `first_s` to the first after `last_s`."""
    if len(known) < 2:
        return None
    known_s = np.array([time_s for time_s, _ in known])
    if first_s < known_s[0] - late_s or last_s > known_s[-1] + late_s:
        return None
    begin = min(max(int(np.searchsorted(known_s, first_s, "right")) - 1, 0), len(known) - 2)
    end = max(min(int(np.searchsorted(known_s, last_s)) + 1, len(known)), begin + 2)
    known_s = known_s[begin:end]
    if float(np.diff(known_s).max()) > _GREATEST_GAP_S:
        return None
    return known_s, np.array([known[index][1] for index in range(begin, end)])


def points_in_site(
    points_m: FloatArray,
    time_s: FloatArray,
    poses: PoseHistory,
    mount: SensorMount,
    *,
    late_s: float = 0.01,
) -> tuple[FloatArray, FloatArray] | None:
    """Points (n, 3) of a scan, and places (n, 3) of the sensor at each, in the site's frame.

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

"""The lidar on a simulated aircraft: true states in order of time to the packets that are due.

The pose of each firing sequence is interpolated between the true states before and after it.
"""

import math
from collections import deque
from typing import Protocol

import numpy as np

from sitl.geodesy import Geodetic, TrueFrame
from sitl.lidar import PACKET_S, SimulatedLidar
from sitl.lidar_rays import FloatArray
from sitl.lidar_scene import LidarMount, PlacedScene


class Posed(Protocol):
    """Fields of a true state that the lidar needs, and the payload."""

    @property
    def time_s(self) -> float:
        """Simulated time."""

    @property
    def latitude_deg(self) -> float:
        """WGS84."""

    @property
    def longitude_deg(self) -> float:
        """WGS84."""

    @property
    def altitude_amsl_m(self) -> float:
        """Altitude above the sea."""

    @property
    def attitude_rad(self) -> tuple[float, float, float]:
        """Roll, pitch, yaw."""


class LidarCarrier:
    """Lidar of an aircraft. Pure. The first packet begins at the first truth's time, or later."""

    def __init__(self, placed: PlacedScene, seed: int = 1) -> None:
        self._lidar = SimulatedLidar(placed.scene, seed)
        self._frame = TrueFrame(placed.origin)
        azimuth = math.radians(placed.azimuth_deg)
        cos, sin = math.cos(azimuth), math.sin(azimuth)
        self._from_ned = np.array([[cos, sin, 0.0], [sin, -cos, 0.0], [0.0, 0.0, -1.0]])
        self._mount(placed.mount)
        self._states: deque[tuple[float, FloatArray, FloatArray]] = deque()
        """Time, place in the scene, and roll, pitch, yaw, of the truths that are still needed."""
        self._next = 0

    def show(self, placed: PlacedScene) -> None:
        """Take another scene and mount, at the same place."""
        self._lidar.show(placed.scene)
        self._mount(placed.mount)

    def _mount(self, mount: LidarMount) -> None:
        self._mount_m = np.array(mount.position_m)
        self._mount_turn = _mount_turn(mount)

    def step(self, truth: Posed) -> list[tuple[float, bytes]]:
        """The packets that are complete at a truth's time, with the times of their ends."""
        if not self._states:
            self._next = math.ceil(truth.time_s / PACKET_S - 1e-9)
        self._add(truth)
        first, self._next = self._next, max(self._next, math.floor(truth.time_s / PACKET_S + 1e-9))
        if first == self._next:
            return []
        times_s: FloatArray = np.arange(first, self._next, dtype=float) * PACKET_S
        packets = self._lidar.packets(times_s, self._pose_at)
        while len(self._states) > 1 and self._states[1][0] <= self._next * PACKET_S:
            self._states.popleft()
        return [
            (float(time_s) + PACKET_S, packet)
            for time_s, packet in zip(times_s, packets, strict=True)
        ]

    def _add(self, truth: Posed) -> None:
        place = Geodetic(
            latitude_deg=truth.latitude_deg,
            longitude_deg=truth.longitude_deg,
            altitude_amsl_m=truth.altitude_amsl_m,
        )
        attitude = np.array(truth.attitude_rad)
        if self._states:
            turned = attitude[2] - self._states[-1][2][2]
            attitude[2] -= 2.0 * math.pi * round(turned / (2.0 * math.pi))
        place_m = self._from_ned @ np.array(self._frame.ned(place))
        self._states.append((truth.time_s, place_m, attitude))

    def _pose_at(self, times_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        known_s = np.array([each[0] for each in self._states])
        values = np.array([np.concatenate(each[1:]) for each in self._states])
        here = np.column_stack([np.interp(times_s, known_s, column) for column in values.T])
        turns = self._from_ned @ _from_forward_left_up(here[:, 3:])
        return here[:, :3] + turns @ self._mount_m, turns @ self._mount_turn


def _from_forward_left_up(attitude_rad: FloatArray) -> FloatArray:
    """(n, 3, 3) rotations to north, east, down, for roll, pitch, yaw (n, 3)."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(attitude_rad).T, np.cos(attitude_rad).T
    return np.moveaxis(
        np.array(
            [
                [cy * cp, sy * cr - cy * sp * sr, -sy * sr - cy * sp * cr],
                [sy * cp, -cy * cr - sy * sp * sr, cy * sr - sy * sp * cr],
                [-sp, -cp * sr, -cp * cr],
            ]
        ),
        -1,
        0,
    )


def _mount_turn(mount: LidarMount) -> FloatArray:
    """Rotation (3, 3) from the sensor's axes to the aircraft's."""
    (sr, sp, sy), (cr, cp, cy) = (
        part(np.radians(mount.roll_pitch_yaw_deg)) for part in (np.sin, np.cos)
    )
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )

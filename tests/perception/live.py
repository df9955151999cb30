"""The simulated lidar on an aircraft, and what the tracker makes of its packets."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter

import numpy as np
from scipy.spatial.transform import Rotation

from moar_companion.perception.scan_conductors import (
    ConductorTracks,
    narrow_echoes,
    sightings,
)
from moar_companion.perception.scan_frame import PoseHistory, mount_rotation, points_in_site
from moar_companion.perception.velodyne import VelodyneStream
from moar_companion.perception_config import SensorMount
from sitl.lidar import PACKET_S, LidarScene, SimulatedLidar

ALONG = np.array([0.0, 1.0, 0.0])
_POSE_S = 0.02


@dataclass(frozen=True, kw_only=True)
class Seen:
    """After one scan: its sightings, the confirmed conductors, and what it took to compute."""

    time_s: float
    points: int
    sightings: list
    tracks: tuple
    cost_s: float


def watch(
    scene: LidarScene,
    at_m,
    seconds: float,
    *,
    seed: int = 0,
    velocity_mps=(0.0, 0.0, 0.0),
    tilt_rad: float = 0.0,
    position_noise_m: float = 0.0,
):
    """Yields what is seen from an aircraft that flies straight, and sways by `tilt_rad`."""
    lidar, stream, mount = SimulatedLidar(scene, seed), VelodyneStream(), SensorMount()
    random, poses, tracks = np.random.default_rng(seed), PoseHistory(), ConductorTracks()

    def state(times):
        places = np.array(at_m) + np.outer(times, velocity_mps)
        angles = np.column_stack(
            (tilt_rad * np.sin(3.0 * times), tilt_rad * np.cos(2.0 * times), 0.0 * times)
        )
        return places, Rotation.from_euler("xyz", angles)

    def pose_at(times):
        places, attitude = state(times)
        return places, (attitude * mount_rotation(mount)).as_matrix()

    told_s = 0.0
    for number in range(int(seconds / PACKET_S)):
        time_s = number * PACKET_S
        while told_s <= time_s + _POSE_S:
            places, attitude = state(np.array([told_s]))
            poses.add(told_s, places[0] + random.normal(0.0, position_noise_m, 3), attitude[0])
            told_s += _POSE_S
        scan = stream.receive(lidar.packet(time_s, pose_at), time_s)
        if scan is None:
            continue
        started_s = perf_counter()
        placed = points_in_site(scan.points_m, scan.time_s, poses, mount)
        if placed is None:
            continue
        echoes, ring = narrow_echoes(*placed, scan.ring, scan.time_s)
        found = sightings(echoes, ring, placed[1].mean(axis=0), ALONG, random)
        confirmed = tracks.step(found, time_s)
        yield Seen(
            time_s=time_s,
            points=len(scan.points_m),
            sightings=found,
            tracks=confirmed,
            cost_s=perf_counter() - started_s,
        )

"""The simulated lidar on an aircraft, and the reports of live perception."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from time import process_time

import numpy as np
from scipy.spatial.transform import Rotation

from moar_companion.perception.live_perception import LivePerception
from moar_companion.perception.perception_report import PerceptionReport
from moar_companion.perception.scan_frame import mount_rotation
from moar_companion.planner.site import Site, Workspace
from moar_companion.planner.site_frame import SiteFrame
from moar_companion.settings.perception_config import Perception, Sensor, SensorMount
from moar_companion.types import GeodeticPoint
from sitl.lidar import PACKET_S, LidarScene, SimulatedLidar

VELODYNE = Perception(sensor=Sensor.VELODYNE)
SITE = Site(
    name="test",
    frame=SiteFrame(
        origin=GeodeticPoint(latitude_deg=47.0, longitude_deg=8.0, altitude_amsl_m=400.0),
        azimuth_deg=70.0,
    ),
    workspace=Workspace(lower_m=(-25.0, 0.0), upper_m=(30.0, 30.0), resolution_m=0.3),
    obstacles=(),
    start_m=(0.0, 3.0),
    targets=(),
    landing_m={},
)
POSITION_S, ATTITUDE_S = 0.03, 0.045


@dataclass(frozen=True, kw_only=True)
class Flight:
    """An aircraft that flies straight, sways by `tilt_rad`, and reports its poses with errors."""

    at_m: tuple[float, float, float]
    velocity_mps: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tilt_rad: float = 0.0
    yaw_error_rad: float = 0.0
    """Between the aircraft's nose and the plane of the site."""
    position_noise_m: float = 0.0
    height_error_m: float = 0.0

    def position_m(self, time_s):
        return np.array(self.at_m) + np.outer(time_s, self.velocity_mps)

    def angles_rad(self, time_s):
        """(n, 3) roll, pitch and yaw of the body in north, east, down."""
        time_s = np.asarray(time_s)
        yaw = np.radians(SITE.frame.azimuth_deg) + self.yaw_error_rad
        return np.column_stack(
            (
                self.tilt_rad * np.sin(3.0 * time_s),
                self.tilt_rad * np.cos(2.0 * time_s),
                yaw + 0.0 * time_s,
            )
        )

    def sensor_pose(self, mount: SensorMount):
        def pose_at(times):
            azimuth = np.radians(SITE.frame.azimuth_deg)
            roll, pitch, yaw = self.angles_rad(times).T
            attitude = Rotation.from_euler("ZYX", np.column_stack((azimuth - yaw, -pitch, roll)))
            places = self.position_m(times) + attitude.apply(mount.position_m)
            return places, (attitude * mount_rotation(mount)).as_matrix()

        return pose_at


class Rig:
    """Live perception with a simulated lidar; time goes on from packet to packet."""

    def __init__(
        self, scene: LidarScene, flight: Flight, *, seed: int = 0, settings: Perception = VELODYNE
    ) -> None:
        self.perception = LivePerception(settings, SITE)
        self.flight = flight
        self.settings = settings
        self.cost_s = 0.0
        """Processor time of the last report that processed a scan."""
        self.poses_flow = True
        self.packets_flow = True
        self.heading_error_rad = 0.0
        """The estimated heading less the true one."""
        self.sensor_clock_s = 0.0
        """Sensor's clock minus the receiver's."""
        self._lidar = SimulatedLidar(scene, seed)
        self._random = np.random.default_rng(seed)
        self._number = 0
        self._error_m = np.zeros(3)
        self._reported_s = {"position": 0.0, "attitude": 0.0}

    def look_at(self, scene: LidarScene, seed: int = 1) -> None:
        self._lidar = SimulatedLidar(scene, seed)

    def jump(self, step_m) -> None:
        """The estimate jumps by a step; the aircraft does not."""
        self._error_m += step_m
        self.perception.shift(step_m)

    @property
    def time_s(self) -> float:
        return self._number * PACKET_S

    def run(self, seconds: float) -> Iterator[PerceptionReport]:
        until_s = self.time_s + seconds
        while self.time_s < until_s:
            self._send_poses()
            spent_s = process_time()
            if self.packets_flow:
                pose_at = self.flight.sensor_pose(self.settings.mount)
                packet = self._stamped(self._lidar.packet(self.time_s, pose_at))
                spent_s = process_time()
                self.perception.receive(packet, self.time_s)
            self._number += 1
            report = self.perception.step(self.time_s)
            if report is not None:
                self.cost_s = process_time() - spent_s
                yield report

    def _stamped(self, packet: bytes) -> bytes:
        stamp_us = int((self.time_s + self.sensor_clock_s) * 1e6) % 3_600_000_000
        return packet[:-6] + struct.pack("<I", stamp_us) + packet[-2:]

    def _send_poses(self) -> None:
        while self.poses_flow and self._reported_s["position"] <= self.time_s:
            time_s = self._reported_s["position"]
            error = self._random.normal(0.0, self.flight.position_noise_m, 3)
            error[2] += self.flight.height_error_m
            place = self.flight.position_m(time_s)[0] + error + self._error_m
            self.perception.note_position(time_s, tuple(place))
            self._reported_s["position"] += POSITION_S
        while self.poses_flow and self._reported_s["attitude"] <= self.time_s:
            time_s = self._reported_s["attitude"]
            roll, pitch, yaw = self.flight.angles_rad([time_s])[0]
            self.perception.note_attitude(time_s, roll, pitch, yaw + self.heading_error_rad)
            self._reported_s["attitude"] += ATTITUDE_S


def last(rig: Rig, seconds: float) -> PerceptionReport:
    """The last report of some seconds."""
    *_, report = rig.run(seconds)
    return report

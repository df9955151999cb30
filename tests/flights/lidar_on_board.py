"""A simulated lidar on the aircraft of a lockstep flight, and the perception of its packets."""

from __future__ import annotations

from moar_companion.companion.companion import Companion
from moar_companion.perception.live_perception import LivePerception
from moar_companion.perception.perception_report import PerceptionReport
from moar_companion.perception_config import Perception
from moar_companion.service.perception_worker import apply
from moar_companion.site import Site
from sitl.autopilot import Truth
from sitl.lidar_carrier import LidarCarrier
from sitl.lidar_scene import PlacedScene


class LidarOnBoard:
    """Lidar packets from true poses, and their perception with the poses that the companion notes.

    reports: all reports that the companion received.
    """

    def __init__(
        self, placed: PlacedScene, settings: Perception, site: Site, *, seed: int = 1
    ) -> None:
        self._carrier = LidarCarrier(placed, seed)
        self._perception = LivePerception(settings, site)
        self.reports: list[PerceptionReport] = []

    def step(self, truth: Truth, companion: Companion, now_s: float) -> None:
        """After a cycle of the companion, which takes the report in the next one."""
        for note in companion.pose_notes():
            apply(self._perception, note)
        for time_s, packet in self._carrier.step(truth):
            self._perception.receive(packet, time_s)
        report = self._perception.step(now_s)
        if report is not None:
            self.reports.append(report)
            companion.perceived(report)

"""A simulated lidar on the aircraft of a lockstep flight, and the perception of its packets."""

from __future__ import annotations

from collections.abc import Callable

from moar_companion.companion.companion import Companion
from moar_companion.perception.live_perception import LivePerception
from moar_companion.perception.perception_report import PerceptionReport
from moar_companion.planner.site import Conductor, Site
from moar_companion.service.perception_worker import apply
from moar_companion.settings.perception_config import Perception
from sitl.autopilot import Truth
from sitl.geodesy import Geodetic
from sitl.lidar import LidarScene, Prism, Wire
from sitl.lidar_carrier import LidarCarrier
from sitl.lidar_scene import PlacedScene

HALF_SPAN_M = 150.0


def scene_of(site: Site) -> PlacedScene:
    """Scene of a site: level wires across its plane, and solids along them."""
    wires, prisms = [], []
    for item in site.obstacles:
        if isinstance(item, Conductor):
            x_m, z_m = item.position_m
            wires.append(
                Wire(
                    start_m=(x_m, -HALF_SPAN_M, z_m),
                    end_m=(x_m, HALF_SPAN_M, z_m),
                    diameter_m=2.0 * item.radius_m,
                )
            )
        else:
            prisms.append(Prism(vertices_m=item.vertices_m, lower_y_m=-1.0, upper_y_m=1.0))
    origin = site.frame.origin
    return PlacedScene(
        name=site.name,
        origin=Geodetic(
            latitude_deg=origin.latitude_deg,
            longitude_deg=origin.longitude_deg,
            altitude_amsl_m=origin.altitude_amsl_m,
        ),
        azimuth_deg=site.frame.azimuth_deg,
        scene=LidarScene(wires=tuple(wires), prisms=tuple(prisms)),
    )


class LidarOnBoard:
    """Lidar packets from true poses, and their perception with the poses that the companion notes.

    reports: all reports that the companion received. filters: change the packets between sensor
    and perception; an item is (time of its arrival, packet).
    """

    def __init__(
        self, placed: PlacedScene, settings: Perception, site: Site, *, seed: int = 1
    ) -> None:
        self.placed = placed
        self._carrier = LidarCarrier(placed, seed)
        self._new_perception = lambda: LivePerception(settings, site)
        self._perception = self._new_perception()
        self.filters: list[Callable[[float, list], list]] = []
        self.reports: list[PerceptionReport] = []

    def restart(self) -> None:
        """A new perception, which has seen nothing."""
        self._perception = self._new_perception()

    def show(self, placed: PlacedScene) -> None:
        """Changes the scene and the sensor's mount."""
        self.placed = placed
        self._carrier.show(placed)

    def step(self, truth: Truth, companion: Companion, now_s: float) -> None:
        """After a cycle of the companion, which takes the report in the next one."""
        for note in companion.pose_notes():
            apply(self._perception, note)
        items = self._carrier.step(truth)
        for one in self.filters:
            items = one(now_s, items)
        for time_s, packet in items:
            self._perception.receive(packet, time_s)
        report = self._perception.step(now_s)
        if report is not None:
            self.reports.append(report)
            companion.perceived(report)

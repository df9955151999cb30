"""A desk with a sensor: conductors and other obstacles that it sees, places on the path ahead."""

from __future__ import annotations

import copy
import math
from dataclasses import replace

import numpy as np

from moar_companion.perception.perception_report import (
    LineOffset,
    PerceptionReport,
    SeenConductor,
    SensorHealth,
)
from moar_companion.planner.planner import Planner
from moar_companion.settings.perception_config import Perception, Sensor
from tests.companion.desk import INSPECTION, STEP_S, USER_1, Desk, usual_planner
from tests.companion.scripted_autopilot import OFFBOARD
from tests.flights.cameras import with_views

SETTINGS = Perception(sensor=Sensor.VELODYNE, fly_by_line=True)


def conductor(x_m, z_m, name="seen-1"):
    return SeenConductor(
        name=name, position_m=(x_m, z_m), deviation_m=0.05, sightings=9, seen_s=0.0
    )


class Watched(Desk):
    """A desk with a working sensor, which sees `conductors` and `solids`."""

    def __init__(self, *, views=False, **options):
        """views: True for targets with a view each."""
        usual = usual_planner()
        site = with_views(usual.site) if views else usual.site
        # Seen obstacles must not change the maps of other tests.
        super().__init__(planner=Planner(site, usual.vehicle), perception=SETTINGS, **options)
        self.conductors, self.solids, self.line = (), (), LineOffset()
        self.works = self.scans = self.sees_line = True
        self.began_s = 0.0
        self.notes = []

    def step(self, seconds=STEP_S):
        if self.line.seen_s is not None and self.sees_line:
            self.line = replace(self.line, seen_s=self.now_s)
        if self._count % 5 == 0 and self.works:
            self.companion.perceived(
                PerceptionReport(
                    time_s=self.now_s,
                    began_s=self.began_s,
                    health=SensorHealth(
                        scan_s=self.now_s - 0.05 if self.scans else None,
                        received_s=self.now_s,
                        returns=0.5,
                    ),
                    conductors=self.conductors,
                    solids=self.solids,
                    line=self.line,
                )
            )
        super().step(seconds)
        self.notes += self.companion.pose_notes()
        return self

    def fly(self, seconds=2.0):
        self.run(1.0)
        self.handle(self.operator.command(USER_1, INSPECTION, 1))
        self.run_until("ready")
        self.set(mode=OFFBOARD)
        self.run_until("flying")
        return self.run(seconds)

    @property
    def place_m(self):
        return self.companion.pose.position_m

    @property
    def ahead_m(self):
        """Points (n, 2) of the path still ahead."""
        points_m, _ = self.companion.state.routes.flight.path.rest()
        return points_m[:, ::2]


def ahead(desk, by_m=6.0):
    """A place on the path ahead, `by_m` from the aircraft."""
    x_m, _, z_m = desk.place_m
    points_m = desk.ahead_m
    far_m = np.hypot(*(points_m - (x_m, z_m)).T)
    return points_m[np.argmax(far_m >= by_m)]


def nearest_m(desk, place_m, seconds, end=None):
    """Least distance of the aircraft from a place in the plane in the next seconds.

    end: a state, at which the flight is over.
    """
    least_m = math.inf
    for _ in range(round(seconds / STEP_S)):
        if desk.state == end:
            break
        least_m = min(least_m, math.dist(desk.step().place_m[::2], place_m))
    return least_m


def copied(flight):
    twin, usual = copy.deepcopy(flight), usual_planner()
    twin.planner = Planner(usual.site, usual.vehicle)
    twin.planners = type(twin.planners)(twin.planner)
    return twin


def by_line(desk, x_m, z_m, **changes):
    """The line shows from now on that the aircraft is (x_m, z_m) from where the autopilot says."""
    seen = LineOffset(
        offset_m=(x_m, z_m), covariance_m2=(0.01, 0.0, 0.01), seen_s=desk.now_s, wires=5
    )
    desk.line = replace(seen, **changes)
    return desk

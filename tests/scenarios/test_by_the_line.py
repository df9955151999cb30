"""Flights with a lidar and a wrong estimate: the line's wires show the place."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import pytest

from moar_companion.planner.site import Site
from moar_companion.settings.config import shipped_configs
from moar_companion.settings.perception_config import Perception, Sensor
from sitl.demonstration.perceive import lidar_scene
from sitl.geodesy import Geodetic, TrueFrame

from ..flights.lockstep import STEP_S, Lockstep
from ..flights.operator import INSPECTION, Manner

pytest.importorskip("velodyne_decoder")
pytestmark = pytest.mark.slow
SITE = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
INNER = 1
"""Number of the target between the circuits."""
READY_S = 6.0
"""Time until the lidar has worked long enough for an order."""


@dataclass
class Drift:
    """An estimate that drifts in the plane, at a speed and towards an angle from +x upwards."""

    flight: Lockstep
    speed_mps: float
    towards_deg: float
    most_m: float = 4.5
    off_m: float = 0.0

    def step(self):
        towards = math.radians(self.towards_deg)
        azimuth = math.radians(SITE.frame.azimuth_deg)
        step_m = min(self.speed_mps * STEP_S, self.most_m - self.off_m)
        self.off_m += step_m
        estimator = self.flight.autopilot._world.estimator
        estimator._off_n += math.cos(towards) * step_m * math.cos(azimuth)
        estimator._off_e += math.cos(towards) * step_m * math.sin(azimuth)
        up_m = math.sin(towards) * self.off_m
        if up_m:
            estimator._err_d += 0.05 * (-up_m - estimator._err_d)


def true_place_m(flight):
    """(x, z) of the true aircraft in the site's frame."""
    origin, truth = SITE.frame.origin, flight.truth
    frame = TrueFrame(
        Geodetic(
            latitude_deg=origin.latitude_deg,
            longitude_deg=origin.longitude_deg,
            altitude_amsl_m=origin.altitude_amsl_m,
        )
    )
    north, east, down = frame.ned(
        Geodetic(
            latitude_deg=truth.latitude_deg,
            longitude_deg=truth.longitude_deg,
            altitude_amsl_m=truth.altitude_amsl_m,
        )
    )
    azimuth = math.radians(SITE.frame.azimuth_deg)
    return north * math.cos(azimuth) + east * math.sin(azimuth), -down


def room_m(flight):
    """From the true hull to the nearest conductor."""
    place_m = true_place_m(flight)
    nearest_m = min(math.dist(place_m, item.position_m) - item.radius_m for item in SITE.conductors)
    return nearest_m - flight.vehicle.radius_m


def error_m(flight):
    """From the pose that is flown with to the true place."""
    x_m, _, z_m = flight.companion.pose.position_m
    return math.dist((x_m, z_m), true_place_m(flight))


def hovering(manner=Manner.PX4):
    """In the air at the 315 kV line, with a lidar, and an order to the inner target."""
    flight = Lockstep(
        site=SITE,
        vehicle="x500",
        manner=manner,
        options={"yaw_deg": SITE.frame.azimuth_deg},
        lidar_scene=lidar_scene(SITE),
        perception=Perception(sensor=Sensor.VELODYNE, fly_by_line=True),
    )
    flight.blind = True
    flight.start_in_the_air()
    flight.blind = False
    flight.run(READY_S)
    flight.begin(INSPECTION, INNER)
    return flight


def flown(flight, state, within_s, each_step=lambda: None):
    """Flies to a state; returns the least room on the way, and the errors of the pose."""
    least_m, errors_m, end_s = math.inf, [], flight.now_s + within_s
    while flight.state != state and flight.now_s < end_s:
        flight.step()
        each_step()
        least_m = min(least_m, room_m(flight))
        errors_m.append(error_m(flight))
    assert flight.state == state, flight.operator.texts()[-3:]
    return least_m, errors_m


@pytest.mark.parametrize(
    ("manner", "towards_deg", "turned_deg"),
    [
        (Manner.PX4, 180.0, 22.0),
        (Manner.PX4, 90.0, 0.0),
        (Manner.ARDUPILOT, 0.0, 0.0),
        (Manner.ARDUPILOT, 270.0, -22.0),
    ],
)
def test_an_estimate_that_drifts_by_4_5_m_costs_neither_room_nor_the_target(
    manner, towards_deg, turned_deg
):
    """With a heading that becomes wrong beside the line, too, by as much as no search covers."""
    flight = hovering(manner)
    drift, conditions = Drift(flight, 0.3, towards_deg), flight.autopilot.conditions

    def each_step():
        drift.step()
        conditions.heading_error_deg += math.copysign(0.04, turned_deg) * (
            abs(conditions.heading_error_deg) < abs(turned_deg)
        )

    least_m, _ = flown(flight, "at_target", 60.0, each_step)
    assert drift.off_m > 4.0
    flight.run(2.0)
    assert error_m(flight) < 0.3
    assert min(least_m, room_m(flight)) > 2.5
    seen = {item.name for report in flight.lidar.reports for item in report.conductors}
    assert len(seen) <= len(SITE.conductors) + 2


def test_while_the_lidar_sees_nothing_the_last_place_of_the_line_stays():
    flight = hovering()
    drift = Drift(flight, 0.3, 180.0, most_m=1.5)
    flown(flight, "at_target", 60.0, drift.step)
    offset_m = flight.companion.state.pose_tracker.offset_m
    assert math.hypot(*offset_m) == pytest.approx(1.5, abs=0.3)
    flight.blind = True
    flight.run(20.0)
    assert flight.state == "holding"
    assert flight.companion.state.pose_tracker.offset_m == offset_m
    assert error_m(flight) < 0.4


def test_a_wire_that_hangs_beside_its_place_in_the_file_is_no_drift():
    """The lowest wire of the inner circuit has sagged by a metre: it alone is told as moved."""
    flight = hovering()
    placed = flight.lidar.placed
    sagged, *others = sorted(
        placed.scene.wires, key=lambda wire: (wire.start_m[2], wire.start_m[0])
    )
    ends_m = [(*end_m[:2], end_m[2] - 1.0) for end_m in (sagged.start_m, sagged.end_m)]
    lower = replace(sagged, start_m=ends_m[0], end_m=ends_m[1])
    flight.lidar.show(replace(placed, scene=replace(placed.scene, wires=(lower, *others))))
    flown(flight, "at_target", 60.0)
    assert math.hypot(*flight.companion.state.pose_tracker.offset_m) < 0.2
    assert any("1.0 m" in text and "avoided" in text for text in flight.operator.texts())

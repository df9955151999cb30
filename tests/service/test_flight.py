"""The flight: at every instant it can be braked, and goes on from there."""

from __future__ import annotations

import copy
import math

import pytest

from moar_companion.config import shipped_configs
from moar_companion.frames import PlaneToLocal
from moar_companion.planner.plan import PlanRequest
from moar_companion.planner.planner import Planner
from moar_companion.service.flight import Adoption, Flight, Pose
from moar_companion.service.jobs import PlanJob, answer_job
from moar_companion.site import Site
from moar_companion.types import AutopilotKind, Mission, RiskIndices, Weights
from moar_companion.vehicle import Vehicle

STEP_S = 0.02
WEIGHTS = Weights(safety=0.4, time=0.4, energy=0.2)


class Flown:
    """A flight whose aircraft is wherever its setpoint is."""

    def __init__(self, vehicle):
        self.site = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
        self.vehicle = Vehicle.load(shipped_configs() / "vehicles" / f"{vehicle}.yaml")
        self.planner = Planner(self.site, self.vehicle)
        x_m, z_m = self.site.start_m
        self.pose = Pose(
            position_m=(x_m, 0.0, max(2.6, z_m)), velocity_mps=(0.0, 0.0, 0.0), yaw_rad=0.0
        )
        origin = self.site.frame.to_geodetic((x_m, 0.0, 0.0))
        self.plane = PlaneToLocal.between(self.site.frame, origin, AutopilotKind.PX4)
        self.flight = Flight(self.site, self.vehicle, self.planner.maps, self.pose)

    def order(self, mission):
        target = self.site.targets[0].name if mission is Mission.INSPECTION else None
        junction = self.flight.junction()
        (x_m, _, z_m), (vx_mps, _, vz_mps) = junction.position_m, junction.velocity_mps
        request = PlanRequest(
            mission=mission,
            target=target,
            start_m=(x_m, z_m),
            velocity_mps=(vx_mps, vz_mps),
            weights=WEIGHTS,
            risk=RiskIndices(),
        )
        answer = answer_job(self.planner, PlanJob(job_id=1, request=request))
        assert answer.plan is not None, answer.reason
        adoption = self.flight.adopt(answer.plan, junction, answer.escape_end_m)
        assert adoption is not Adoption.TOO_LATE

    def advanced(self, flight):
        flight.advance(self.pose_of(flight), STEP_S)

    def pose_of(self, flight):
        place = flight.setpoint(self.pose, self.plane, 0.0).position_m
        return Pose(position_m=place, velocity_mps=(0.0, 0.0, 0.0), yaw_rad=0.0)


@pytest.mark.parametrize("vehicle", ["linedrone_flight", "linedrone"])
@pytest.mark.parametrize(
    "missions",
    [
        (Mission.INSPECTION, Mission.EXIT),
        (Mission.INSPECTION, Mission.EVACUATION),
        (Mission.INSPECTION, Mission.EXIT, Mission.INSPECTION),
    ],
)
def test_at_every_tick_of_a_flight_that_turns_back_it_can_be_braked(vehicle, missions):
    flown = Flown(vehicle)
    *before, last = missions
    for mission in before:
        flown.order(mission)
        for _ in range(100 if vehicle == "linedrone" else 150):
            flown.advanced(flown.flight)
    flown.order(last)
    most_mps, guidance = flown.vehicle.speed.max_mps, flown.vehicle.guidance
    room_m = most_mps**2 / (2.0 * guidance.acceleration_mps2) + 0.01
    for tick in range(400):
        flown.advanced(flown.flight)
        braked = copy.copy(flown.flight)
        place = flown.pose_of(braked).position_m
        braked.brake()
        assert flown.pose_of(braked).position_m == pytest.approx(place, abs=1e-9)
        if tick % 20 == 0:
            for _ in range(1000):
                flown.advanced(braked)
            rest = flown.pose_of(braked).position_m
            flown.advanced(braked)
            assert flown.pose_of(braked).position_m == pytest.approx(rest, abs=0.006)
            assert not braked.arrived  # where it was braked is not where it was going
            assert math.dist(flown.pose_of(braked).position_m, place) <= room_m


def test_a_jump_is_taken_along_and_faded_back_to_the_path():
    flown = Flown("linedrone_flight")
    flown.order(Mission.INSPECTION)
    for _ in range(200):
        flown.advanced(flown.flight)
    x_m, y_m, z_m = flown.pose_of(flown.flight).position_m
    flown.flight.shift((0.3, -0.2, 1.0))
    shifted = (x_m + 0.3, y_m - 0.2, z_m + 1.0)
    assert flown.pose_of(flown.flight).position_m == pytest.approx(shifted)
    for _ in range(500):
        flown.advanced(flown.flight)
    assert flown.pose_of(flown.flight).position_m[1] == pytest.approx(0.0)

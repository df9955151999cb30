"""The path follower: braking at every instant, and flight from there."""

from __future__ import annotations

import copy
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moar_companion.companion.estimation.plane_to_local import PlaneToLocal
from moar_companion.companion.estimation.pose import Jump, Pose
from moar_companion.companion.guidance.flight_volume import FlightVolume
from moar_companion.companion.guidance.path_follower import PathFollower
from moar_companion.companion.guidance.splice import Adoption
from moar_companion.companion.planning.plan_jobs import PlanJob, answer_job
from moar_companion.companion.planning.planner_set import PlannerSet
from moar_companion.planner.plan_values import PlanRequest, PlanStatus
from moar_companion.planner.planner import Planner
from moar_companion.planner.regions import obstacle_clearance_m
from moar_companion.settings.config import shipped_configs
from moar_companion.settings.vehicle import Vehicle
from moar_companion.types import ARDUPILOT, PX4, Mission, RiskIndices, Weights
from tests.vehicles import named_vehicle

from ..companion.desk import usual_planner
from ..losses import loss_of
from ..planner.problems import conductor, make_site

STEP_S = 0.02
WEIGHTS = Weights(safety=0.4, time=0.4, energy=0.2)
SHORT, LONG = (loss_of(ARDUPILOT, GUID_TIMEOUT=timeout_s) for timeout_s in (0.5, 3.0))
PX4 = loss_of(PX4)


class Flown:
    """A flight whose aircraft is always at its setpoint."""

    def __init__(self, vehicle, loss=SHORT):
        self.site = usual_planner().site
        self.vehicle = named_vehicle(vehicle)
        self.planner = Planner(self.site, self.vehicle)
        x_m, z_m = self.site.start_m
        self.pose = Pose(
            position_m=(x_m, 0.0, max(2.6, z_m)), velocity_mps=(0.0, 0.0, 0.0), yaw_rad=0.0
        )
        origin = self.site.frame.to_geodetic((x_m, 0.0, 0.0))
        self.plane = PlaneToLocal.between(self.site.frame, origin, PX4)
        volume = FlightVolume(
            site=self.site, vehicle=self.vehicle, maps=self.planner.maps, loss=loss
        )
        self.flight = PathFollower(volume, self.pose)

    def order(self, mission):
        target = self.site.targets[0].name if mission is Mission.INSPECTION else None
        junction = self.flight.path.junction()
        (x_m, _, z_m), (vx_mps, _, vz_mps) = junction.position_m, junction.velocity_mps
        request = PlanRequest(
            mission=mission,
            target=target,
            start_m=(x_m, z_m),
            velocity_mps=(vx_mps, vz_mps),
            weights=WEIGHTS,
            risk=RiskIndices(),
        )
        answer = answer_job(PlannerSet(self.planner), PlanJob(job_id=1, request=request))
        assert answer.plan is not None, answer.reason
        adoption = self.flight.adopt(answer.plan, junction, answer.escape_m)
        assert adoption is not Adoption.TOO_LATE

    def advanced(self, flight):
        flight.advance(self.pose_of(flight), STEP_S)

    def pose_of(self, flight):
        place = flight.setpoint(self.pose, self.plane, 0.0).position_m
        return Pose(position_m=place, velocity_mps=(0.0, 0.0, 0.0), yaw_rad=0.0)


@pytest.mark.parametrize("vehicle", ["linedrone_uniform", "linedrone"])
@pytest.mark.parametrize(
    "missions",
    [
        (Mission.INSPECTION, Mission.EXIT),
        pytest.param((Mission.INSPECTION, Mission.EVACUATION), marks=pytest.mark.slow),
        pytest.param(
            (Mission.INSPECTION, Mission.EXIT, Mission.INSPECTION), marks=pytest.mark.slow
        ),
    ],
)
def test_a_flight_that_turns_back_can_be_braked_at_every_tick(vehicle, missions):
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
        if tick % 40 == 0:
            for _ in range(1000):
                flown.advanced(braked)
            rest = flown.pose_of(braked).position_m
            flown.advanced(braked)
            assert flown.pose_of(braked).position_m == pytest.approx(rest, abs=0.006)
            assert not braked.arrived  # the stop is not the goal
            assert math.dist(flown.pose_of(braked).position_m, place) <= room_m


@pytest.mark.parametrize("loss", [SHORT, LONG, PX4], ids=["short", "long", "PX4"])
@pytest.mark.parametrize("vehicle", ["linedrone_uniform", "x500"])
def test_the_stopping_path_on_offboard_loss_is_free_at_every_tick(vehicle, loss):
    flown = Flown(vehicle, loss)
    maps = flown.planner.maps
    flown.order(Mission.INSPECTION)
    fastest_mps = 0.0
    while not flown.flight.arrived:
        flown.advanced(flown.flight)
        setpoint = flown.flight.setpoint(flown.pose, flown.plane, 0.0)
        (x_m, _, z_m), velocity = setpoint.position_m, setpoint.velocity_mps
        speed_mps = math.hypot(*velocity)
        fastest_mps = max(fastest_mps, speed_mps)
        stopping_m = float(loss.stopping_m(np.array(speed_mps)))
        # A tolerance of one tick of braking.
        for part in np.linspace(0.0, max(0.0, stopping_m - 0.1), 20) / max(speed_mps, 1e-9):
            cell = maps.grid.cell_of((x_m + part * velocity[0], z_m + part * velocity[2]))
            assert cell is None or not maps.occupied[cell]
    assert fastest_mps > 0.6


@pytest.mark.parametrize("learns", [True, False])
def test_the_flight_slows_down_when_the_offboard_loss_distance_grows(learns):
    flown = Flown("x500", SHORT)
    flown.order(Mission.INSPECTION)
    for _ in range(100):
        flown.advanced(flown.flight)
    loss = loss_of(ARDUPILOT, GUID_TIMEOUT=5.0)
    volume = FlightVolume(
        site=flown.site, vehicle=flown.vehicle, maps=flown.planner.maps, loss=loss
    )
    if learns:
        flown.flight.learn_loss(loss)
    too_fast_mps = 0.0
    for tick in range(4000):
        flown.advanced(flown.flight)
        setpoint = flown.flight.setpoint(flown.pose, flown.plane, 0.0)
        speed_mps = math.hypot(*setpoint.velocity_mps)
        if tick > 150 and speed_mps:  # the flight has slowed down by then
            place, velocity = np.array([setpoint.position_m]), np.array([setpoint.velocity_mps])
            allowed_mps = float(volume.speed_cap_mps(place, velocity / speed_mps)[0])
            too_fast_mps = max(too_fast_mps, speed_mps - allowed_mps)
    assert flown.flight.arrived
    assert (too_fast_mps < 0.2) is learns, too_fast_mps


def test_a_return_to_the_path_slows_down_near_an_obstacle():
    flown = Flown("x500", LONG)
    flown.pose = Pose(position_m=(24.4, 0.0, 10.99), velocity_mps=(0.0, 0.0, 0.0), yaw_rad=0.0)
    volume = FlightVolume(
        site=flown.site, vehicle=flown.vehicle, maps=flown.planner.maps, loss=LONG
    )
    flight = PathFollower(volume, flown.pose)
    flight.shift(Jump(step_m=(2.0, 0.0, 0.0)))  # the conductor is 1.7 m beside the path
    fades_mps = []
    for _ in range(3000):
        flown.advanced(flight)
        setpoint = flight.setpoint(flown.pose, flown.plane, 0.0)
        fades_mps.append(round(math.hypot(*setpoint.velocity_mps), 9))
    assert fades_mps[0] == pytest.approx(flown.vehicle.speed.min_mps)
    assert 0.05 < fades_mps[fades_mps.index(0.0) - 1] < 0.25
    assert fades_mps == sorted(fades_mps, reverse=True)
    assert flown.pose_of(flight).position_m == pytest.approx(flown.pose.position_m)


@settings(deadline=None, max_examples=40, derandomize=True, database=None)
@given(
    wires=st.lists(st.tuples(st.floats(1.0, 19.0), st.floats(1.0, 11.0)), max_size=6),
    start=st.tuples(st.floats(0.0, 20.0), st.floats(2.0, 12.0)),
    target=st.tuples(st.floats(0.0, 20.0), st.floats(2.0, 12.0)),
    loss=st.sampled_from([SHORT, LONG, PX4]),
)
def test_on_any_site_the_stopping_paths_on_offboard_loss_are_free(wires, start, target, loss):
    site = make_site(
        *(conductor(*place, keep_out=0.6) for place in wires),
        size=(20.0, 12.0),
        resolution=0.5,
        min_altitude=2.0,
        targets={"target": target},
    )
    vehicle = Vehicle.load(shipped_configs() / "vehicles" / "x500.yaml")
    planner = Planner(site, vehicle)
    plan = planner.plan(mission="inspection", target="target", start=start, weights=WEIGHTS)
    if plan.status is not PlanStatus.FOUND:
        return
    place = (start[0], 0.0, start[1])
    pose = Pose(position_m=place, velocity_mps=(0.0, 0.0, 0.0), yaw_rad=0.0)
    volume = FlightVolume(site=site, vehicle=vehicle, maps=planner.maps, loss=loss)
    flight = PathFollower(volume, pose)
    places, rests = np.split(flight.rests_m(plan, flight.path.junction_at(pose), ()), 2)
    assert places[-1] == pytest.approx(rests[-1])
    # A cell is free if its centre is.
    allowed_m = vehicle.radius_m + 0.6 - 0.5 * math.sqrt(0.5)
    for part in np.linspace(0.0, 1.0, 12):
        between = places + part * (rests - places)
        assert (obstacle_clearance_m(site, between) > allowed_m - 1e-6).all()
        assert (between[:, 1] > 2.0 - 0.25 - 1e-6).all()


def test_a_position_jump_shifts_the_setpoint_and_fades_out():
    flown = Flown("linedrone_uniform")
    flown.order(Mission.INSPECTION)
    for _ in range(200):
        flown.advanced(flown.flight)
    x_m, y_m, z_m = flown.pose_of(flown.flight).position_m
    flown.flight.shift(Jump(step_m=(0.3, -0.2, 1.0)))
    shifted = (x_m + 0.3, y_m - 0.2, z_m + 1.0)
    assert flown.pose_of(flown.flight).position_m == pytest.approx(shifted)
    for _ in range(500):
        flown.advanced(flown.flight)
    assert flown.pose_of(flown.flight).position_m[1] == pytest.approx(0.0)


def test_on_offboard_loss_above_the_least_altitude_the_aircraft_stops_above_it():
    site = make_site(size=(20.0, 20.0), resolution=0.5, min_altitude=6.0, exits=[(10.25, 0.0)])
    vehicle = Vehicle.load(shipped_configs() / "vehicles" / "x500.yaml")
    vehicle = replace(vehicle, guidance=replace(vehicle.guidance, landing_height_m=1.0))
    planner = Planner(site, vehicle)
    plan = planner.plan(mission="exit", start=(10.25, 15.25), weights=WEIGHTS)
    pose = Pose(position_m=(10.25, 0.0, 15.25), velocity_mps=(0.0, 0.0, 0.0), yaw_rad=0.0)
    volume = FlightVolume(site=site, vehicle=vehicle, maps=planner.maps, loss=LONG)
    flight = PathFollower(volume, pose)
    places, rests = np.split(flight.rests_m(plan, flight.path.junction_at(pose), ()), 2)
    assert (places[0, 1], places[-1, 1]) == pytest.approx((15.25, 1.0))
    inside = places[:, 1] > 6.0
    assert (rests[inside, 1] > 6.0 - 0.25).all()  # half a cell is always free
    assert (rests[:, 1] > 1.0 - 0.25).all()
    beyond = places[~inside, 1] - rests[~inside, 1]
    assert beyond.max() > 1.0  # on the leg the workspace's limit does not slow it down

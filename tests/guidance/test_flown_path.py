"""Junctions, recovery legs and plans that cannot be joined, on a small site."""

from __future__ import annotations

import pytest

from moar_companion.companion.estimation.pose import Pose
from moar_companion.companion.guidance.flight_volume import FlightVolume
from moar_companion.companion.guidance.path_follower import PathFollower
from moar_companion.companion.guidance.splice import Adoption
from moar_companion.planner.planner import Planner
from moar_companion.types import PX4

from ..losses import loss_of
from ..planner.problems import conductor, make_site, make_vehicle, polygon

WIRE = conductor(5.5, 4.5, 0.1, name="wire")


def pose(x_m, z_m):
    return Pose(position_m=(x_m, 0.0, z_m), velocity_mps=(0.0, 0.0, 0.0), yaw_rad=0.0)


def started(planner, at):
    """A flight that stands at the aircraft."""
    space = FlightVolume(
        site=planner.site,
        vehicle=planner.vehicle,
        maps=planner.maps,
        loss=loss_of(PX4),
    )
    return PathFollower(space, at)


def planned(planner, at):
    x_m, _, z_m = at.position_m
    return planner.plan(mission="inspection", start=(x_m, z_m))


@pytest.fixture
def planner():
    return Planner(make_site(WIRE), make_vehicle())


def test_an_aircraft_off_its_path_is_met_only_by_a_line_without_obstacles(planner):
    here, behind, above = pose(2.5, 4.5), pose(8.5, 4.5), pose(2.5, 7.5)
    flight = started(planner, here)
    junction = flight.path.junction_at(behind)
    assert flight.adopt(planned(planner, behind), junction, ()) is Adoption.TOO_LATE
    assert flight.mission is None
    junction = flight.path.junction_at(above)
    assert flight.adopt(planned(planner, above), junction, ()) is Adoption.NEW_PATH


def test_the_rest_of_the_plan_answers_only_a_request_from_the_path(planner):
    here = pose(2.5, 4.5)
    flight = started(planner, here)
    plan, junction = planned(planner, here), flight.path.junction()
    assert flight.adopt(plan, junction, ()) is Adoption.NEW_PATH
    ahead, beside = flight.path.junction(), flight.path.junction_at(here)
    newer = planned(planner, pose(*ahead.position_m[::2]))
    assert flight.rest_of_plan(newer, ahead, None) is not None
    assert flight.rest_of_plan(newer, beside, None) is None
    elsewhere = planned(planner, pose(2.5, 7.5))
    assert flight.rest_of_plan(elsewhere, ahead, None) is None


def test_a_flight_outside_counts_as_outside_until_its_recovery_leg_ends(planner):
    outside, inside = pose(-4.0, 4.5), pose(0.5, 4.5)
    flight = started(planner, outside)
    assert flight.excursion(outside) == "4.0 m outside the workspace"
    assert flight.begin_recovery(0.0)
    assert flight.recovers
    assert flight.excursion(inside) == "4.0 m outside, wind is less"
    here = outside
    for _ in range(2_000):
        flight.advance(here, 0.02, holds=True)
        here = pose(*flight.progress(here).setpoint.position_m[::2])
        if not flight.recovers:
            break
    assert here.position_m == pytest.approx(inside.position_m, abs=0.05)
    assert flight.excursion(here) is None


def test_a_flight_behind_a_wall_begins_no_recovery_leg():
    wall = polygon((-1.2, -60.0), (-1.0, -60.0), (-1.0, 90.0), (-1.2, 90.0))
    flight = started(Planner(make_site(wall), make_vehicle()), pose(-4.0, 4.5))
    path = flight.path
    assert not flight.begin_recovery(0.0)
    assert (flight.recovers, flight.path) == (False, path)

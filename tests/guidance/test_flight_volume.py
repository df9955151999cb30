"""Places, legs and speeds that the flight volume permits, on a small site."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from moar_companion.companion.estimation.pose import Setpoint
from moar_companion.companion.guidance.flight_volume import FlightVolume
from moar_companion.companion.guidance.plan_path import CheckedLeg
from moar_companion.planner.maps import build_maps
from moar_companion.planner.plane_fence import Bound, PlaneFence
from moar_companion.types import PX4

from ..losses import loss_of
from ..planner.problems import conductor, make_site, make_vehicle, polygon

WIRE = conductor(5.5, 4.5, 0.1, name="wire")
VEHICLE = make_vehicle()
FENCE = PlaneFence(bounds=(Bound(name="GF_MAX_HOR_DIST 7 m", x_m=((-9.0, 7.0),)),), margin_m=0.5)


def volume(*obstacles, fence=None, **site):
    site = make_site(*obstacles, **site)
    return FlightVolume(
        site=site,
        vehicle=VEHICLE,
        maps=build_maps(site, VEHICLE),
        loss=loss_of(PX4),
        fence=fence,
    )


def test_without_a_least_altitude_a_descent_can_stop_within_half_a_cell_of_its_lowest_place():
    space = volume(size=(10.0, 20.0))
    places = np.array([(5.0, 0.0, z) for z in (16.0, 14.0, 12.0)])
    down = np.tile((0.0, 0.0, -1.0), (3, 1))
    stopping_m = space.loss.stopping_m(space.speed_cap_mps(places, down))
    assert stopping_m == pytest.approx([4.0, 2.0, 0.5])


def test_a_line_is_free_only_if_no_cell_on_it_is_occupied_or_outside():
    space = volume(WIRE)
    start = np.array((2.5, 0.0, 4.5))
    assert space.free_between(start, (2.5, 0.0, 7.5))
    assert not space.free_between(start, (8.5, 0.0, 4.5))
    assert not space.free_between(start, (-1.5, 0.0, 4.5))


def test_only_the_rest_of_a_leg_has_to_keep_its_distance_from_obstacles():
    space = volume(replace(WIRE, keep_out_m=1.5))
    past_the_wire = ((2.5, 0.0, 4.5), (8.5, 0.0, 4.5), (8.5, 0.0, 7.5), (8.5, 0.0, 12.0))
    assert not space.is_rest_of_leg_free(past_the_wire, past_the_wire[0])
    assert not space.is_rest_of_leg_free(past_the_wire, (4.0, 0.0, 4.5))
    assert space.is_rest_of_leg_free(past_the_wire, (8.5, 0.0, 6.0))
    assert space.is_rest_of_leg_free(past_the_wire, (8.5, 0.0, 9.0))


@pytest.mark.parametrize("is_entry", [False, True])
def test_a_rechecked_landing_leg_has_the_room_to_obstacles_that_were_seen_since(is_entry):
    space = volume(conductor(13.0, 9.5, 0.1, keep_out=0.5, name="seen"))
    points_m = tuple((x_m, 0.0, 7.5) for x_m in (8.5, 10.0, 12.0, 14.0, 16.0))
    planned = CheckedLeg(points_m=points_m, room_m=9.0, is_entry=is_entry)
    leg = space.rechecked(planned, points_m[0])
    assert not leg.barred
    assert leg.room_m == (9.0 if is_entry else pytest.approx(2.0 - 0.6 - VEHICLE.radius_m))
    rest = space.rechecked(planned, points_m[4])
    assert rest.room_m == (9.0 if is_entry else pytest.approx(13**0.5 - 0.6 - VEHICLE.radius_m))


def test_a_landing_leg_through_a_seen_keep_out_is_barred_on_the_way_there_only():
    space = volume(conductor(13.0, 8.4, 0.1, keep_out=0.5, name="seen"))
    points_m = tuple((x_m, 0.0, 7.5) for x_m in (8.5, 10.0, 12.0, 14.0, 16.0))
    planned = CheckedLeg(points_m=points_m, room_m=9.0)
    assert space.rechecked(planned, points_m[0]).barred
    assert not space.rechecked(planned, points_m[4]).barred


def test_a_place_beside_the_plane_is_left_straight_for_the_plane():
    leg = volume(WIRE).entry_leg((2.5, 4.0, 6.5), 0.0)
    assert leg.points_m == ((2.5, 4.0, 6.5), (2.5, 0.0, 6.5))
    assert leg.is_entry


def test_a_place_outside_the_workspace_is_left_for_the_nearest_free_cell():
    leg = volume(WIRE).entry_leg((-4.0, 0.0, 4.5), 0.0)
    assert leg.points_m == ((-4.0, 0.0, 4.5), (0.5, 0.0, 4.5))


def test_no_leg_leads_back_from_farther_beside_the_plane_than_the_vehicle_recovers():
    space, most_m = volume(WIRE), VEHICLE.guidance.recovery_m
    assert space.entry_leg((2.5, most_m - 0.1, 6.5), 0.0) is not None
    assert space.entry_leg((2.5, -most_m - 0.1, 6.5), 0.0) is None


def test_no_leg_leads_back_through_a_wall_along_the_border():
    wall = polygon((-1.2, -60.0), (-1.0, -60.0), (-1.0, 90.0), (-1.2, 90.0))
    assert volume(wall).entry_leg((-4.0, 0.0, 4.5), 0.0) is None


def test_a_moving_setpoint_past_the_fence_is_refused_and_one_at_rest_is_not():
    space = volume(fence=FENCE)

    def refusal(x_m, speed_mps, **changes):
        setpoint = Setpoint(
            position_m=(x_m, 0.0, 4.5), velocity_mps=(speed_mps, 0.0, 0.0), yaw_rad=0.0
        )
        return space.refusal(setpoint, (), plane_tolerance_m=1.0, widened_m=0.0, **changes)

    assert refusal(6.5, 0.5) is None
    assert refusal(8.5, 0.5).reason == "sp outside GF_MAX_HOR_DIST 7 m"
    assert refusal(8.5, 0.0) is None
    assert refusal(8.5, 0.5, brakes=True) is None


def test_a_recovery_leg_may_begin_past_the_fence():
    space = volume(fence=FENCE)
    leg = space.entry_leg((13.0, 0.0, 4.5), 0.0)
    setpoint = Setpoint(position_m=(9.5, 0.0, 4.5), velocity_mps=(-0.5, 0.0, 0.0), yaw_rad=0.0)
    limits = {"plane_tolerance_m": 1.0, "widened_m": 0.0}
    assert space.refusal(setpoint, (leg,), **limits) is None
    aside = replace(setpoint, position_m=(9.5, 0.0, 8.5))
    assert space.refusal(aside, (leg,), **limits).reason == "sp outside GF_MAX_HOR_DIST 7 m"
    no_entry = replace(leg, is_entry=False)
    assert space.refusal(setpoint, (no_entry,), **limits).reason == "sp outside GF_MAX_HOR_DIST 7 m"


@pytest.mark.parametrize("place_m", [(6.2, -4.0, 4.5), (5.5, 3.0, 3.8)])
def test_from_beside_the_plane_within_a_keep_out_the_leg_leaves_that_before_it_returns(place_m):
    """A conductor runs beside the plane, too: the straight leg back would stay as near to it."""
    space = volume(replace(WIRE, keep_out_m=1.0))
    first, corner, last = space.entry_leg(place_m, 0.0).points_m
    wire = np.array((5.5, 4.5))
    off_m = [np.hypot(*(np.array(point)[::2] - wire)) for point in (first, corner, last)]
    assert (first, corner[1], last[1]) == (place_m, place_m[1], 0.0)
    assert corner[::2] == last[::2]
    assert off_m[0] < 0.1 + 1.0 + VEHICLE.radius_m <= off_m[1] + 1e-9

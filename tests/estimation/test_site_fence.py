"""Fence in the plane of the site: against Shapely's distances, and by example."""

from __future__ import annotations

import math
from unittest import mock

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely.geometry import Polygon

from moar_companion.companion.estimation import site_fence
from moar_companion.companion.estimation.site_fence import SiteFence, fenced, plane_fence
from moar_companion.companion.planning.plan_jobs import PlanJob, answer_job
from moar_companion.companion.planning.planner_set import PlannerSet
from moar_companion.mavlink.autopilots.fence import Area, Fence, Limit
from moar_companion.mavlink.telemetry import FenceItem
from moar_companion.planner.plane_fence import Bound, PlaneFence
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Site
from moar_companion.settings.config import shipped_configs
from moar_companion.types import PX4, Mission
from tests.vehicles import named_vehicle

from ..companion.desk import INSPECTION, STEP_S, TEMPORARILY_REJECTED, Desk

SITE = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
VEHICLE = named_vehicle("linedrone_uniform")
FRAME = SITE.frame
ALONG_M = np.linspace(-60.0, 60.0, 1201)
LINE_M = np.stack([ALONG_M, np.zeros_like(ALONG_M)], axis=1)
HOME_M = (27.0, 0.0, 0.0)


def on_map(places_m):
    points = [FRAME.to_geodetic((x, y, 0.0)) for x, y in places_m]
    return tuple((point.latitude_deg, point.longitude_deg) for point in points)


def area(places_m, *, inclusion=True, radius_m=None, name="area"):
    return Area(name=name, inclusion=inclusion, vertices_deg=on_map(places_m), radius_m=radius_m)


def kept(fence, margin_m, home_m=HOME_M):
    """Places along the line that keep the fence's margin, (n,)."""
    return plane_fence(fence, FRAME, home_m, margin_m).holds(LINE_M)


def assert_same_but_at_borders(got, shape, expected):
    """Asserts equality, except within 1e-6 m of the border of the margin."""
    doubtful = np.abs(shape) < 1e-6
    assert (got == expected)[~doubtful].all()


coordinates = st.floats(-50.0, 50.0)
corner = st.tuples(coordinates, coordinates)


@given(
    centre=corner,
    radius_m=st.floats(0.5, 60.0),
    margin_m=st.floats(0.0, 5.0),
    inclusion=st.booleans(),
)
def test_circles_keep_their_margin(centre, radius_m, margin_m, inclusion):
    fence = Fence(areas=(area([centre], inclusion=inclusion, radius_m=radius_m),))
    distance = np.hypot(ALONG_M - centre[0], centre[1])
    left = radius_m - margin_m - distance if inclusion else distance - radius_m - margin_m
    assert_same_but_at_borders(kept(fence, margin_m), left, left >= 0.0)


@given(
    corners=st.lists(corner, min_size=3, max_size=6),
    margin_m=st.floats(0.01, 5.0),
    inclusion=st.booleans(),
)
def test_polygons_keep_their_margin(corners, margin_m, inclusion):
    shape = Polygon(corners)
    if not shape.is_valid or shape.area < 1.0:
        return
    fence = Fence(areas=(area(corners, inclusion=inclusion),))
    points = shapely.points(LINE_M)
    left = shapely.distance(shape.exterior, points) - margin_m
    inside = shapely.contains_properly(shape, points)
    assert_same_but_at_borders(kept(fence, margin_m), left, (inside == inclusion) & (left >= 0.0))


def test_all_inclusions_count_and_with_a_union_one_is_enough():
    areas = (area([(0.0, 0.0)], radius_m=12.0), area([(18.0, 0.0)], radius_m=12.0))
    both, one = kept(Fence(areas=areas), 1.0), kept(Fence(areas=areas, union=True), 1.0)
    at = {round(x, 1): index for index, x in enumerate(ALONG_M.tolist())}
    assert [both[at[x]] for x in (0.0, 9.0, 18.0)] == [False, True, False]
    assert [one[at[x]] for x in (0.0, 9.0, 18.0, 40.0)] == [True, True, True, False]


def test_an_uploaded_area_moves_with_the_lines_frame():
    """The autopilot keeps its areas by its own estimate, which the line shows to be 2 m off."""
    fence = Fence(areas=(area([(10.0, 0.0)], radius_m=20.0),))
    plane = plane_fence(fence, FRAME, None, 0.0)
    moved = plane_fence(fence, FRAME, None, 0.0, offset_x_m=2.0)
    (low_m, high_m), (moved_low_m, moved_high_m) = plane.bounds[0].x_m[0], moved.bounds[0].x_m[0]
    assert (moved_low_m - low_m, moved_high_m - high_m) == pytest.approx((2.0, 2.0))


def test_limits_around_home_move_with_home():
    fence = Fence(
        circle=Limit(parameter="GF_MAX_HOR_DIST", value_m=10.0),
        ceiling=Limit(parameter="GF_MAX_VER_DIST", value_m=20.0),
    )
    plane = plane_fence(fence, FRAME, (27.0, 6.0, 2.0), 1.0)
    half_m = math.sqrt(9.0**2 - 6.0**2)
    places_m = np.array([(27.0 + half_m - 0.01, 20.9), (27.0 + half_m + 0.01, 20.9), (27.0, 21.1)])
    assert plane.holds(places_m).tolist() == [True, False, False]
    assert plane.crossed(places_m[1:2]) == "GF_MAX_HOR_DIST 10 m"
    assert plane.crossed(places_m[2:]) == "GF_MAX_VER_DIST 20 m"


def test_a_home_too_far_beside_the_plane_leaves_no_free_place():
    fence = Fence(circle=Limit(parameter="FENCE_RADIUS", value_m=30.0))
    assert not kept(fence, 1.0, home_m=(27.0, 29.5, 0.0)).any()


def test_the_greater_of_the_two_margins_is_kept():
    fence = Fence(floor=Limit(parameter="FENCE_ALT_MIN", value_m=3.0), margin_m=2.0)
    plane = plane_fence(fence, FRAME, HOME_M, 1.5)
    assert plane.margin_m == 2.0
    assert plane.holds(np.array([(0.0, 4.9), (0.0, 5.1)])).tolist() == [False, True]


def test_the_free_distance_to_the_fence_depends_on_the_direction():
    fence = Fence(circle=Limit(parameter="FENCE_RADIUS", value_m=10.0))
    plane = plane_fence(fence, FRAME, HOME_M, 1.0)
    places_m = np.array([(30.0, 5.0), (30.0, 5.0), (30.0, 5.0), (50.0, 5.0)])
    directions = np.array([(1.0, 0.0), (-0.6, 0.8), (0.0, 1.0), (1.0, 0.0)])
    free_m = plane.free_m(places_m, directions)
    assert free_m[:2] == pytest.approx([6.0, 12.0 / 0.6])
    assert np.isinf(free_m[2:]).all()


def test_a_fence_around_the_whole_site_is_no_fence():
    wide = plane_fence(
        Fence(circle=Limit(parameter="FENCE_RADIUS", value_m=300.0)), FRAME, HOME_M, 2.0
    )
    assert fenced(wide, SITE, 2.0) is None
    near = plane_fence(
        Fence(circle=Limit(parameter="FENCE_RADIUS", value_m=30.0)), FRAME, HOME_M, 2.0
    )
    assert fenced(near, SITE, 2.0) == near


PARAMETERS = {"GF_ACTION": 2.0, "GF_MAX_HOR_DIST": 10.0, "GF_MAX_VER_DIST": 0.0, "GF_SOURCE": 0.0}


def test_an_unread_fence_or_home_is_the_reason_for_no_start():
    watch = SiteFence(SITE, 1.5)
    assert "not read yet" in watch.not_ready_reason
    watch.learn(PX4, PARAMETERS, None, HOME_M)
    assert "not read yet" in watch.not_ready_reason
    watch.learn(PX4, PARAMETERS, (), None)
    assert "home" in watch.not_ready_reason
    watch.learn(PX4, PARAMETERS, (), HOME_M)
    assert watch.not_ready_reason is None
    assert watch.plane is not None


def test_a_fence_around_an_unknown_home_prevents_planning():
    watch = SiteFence(SITE, 1.5)
    watch.learn(PX4, {**PARAMETERS, "GF_MAX_HOR_DIST": 0.0}, (), None)
    assert (watch.not_ready_reason, watch.plane) == (None, None)
    watch.learn(PX4, PARAMETERS, (), None)
    assert "home" in watch.not_ready_reason
    watch.learn(PX4, PARAMETERS, (), HOME_M)
    assert watch.not_ready_reason is None
    known = watch.plane
    watch.learn(PX4, {}, (), None)
    watch.learn(PX4, PARAMETERS, (), None)  # the same parameters, requested again
    assert watch.not_ready_reason is None
    assert watch.plane is known


def test_a_fence_being_read_again_keeps_its_last_value():
    watch = SiteFence(SITE, 1.5)
    watch.learn(PX4, PARAMETERS, (), HOME_M)
    known = watch.plane
    watch.learn(PX4, {}, (), HOME_M)
    assert watch.plane is known
    assert watch.not_ready_reason is None
    watch.learn(PX4, {**PARAMETERS, "GF_MAX_HOR_DIST": 0.0}, (), HOME_M)
    assert watch.plane is None


@pytest.mark.uncounted
def test_a_fence_with_an_unreported_limit_permits_no_inspection_and_is_reported_once():
    desk = Desk()
    for name in ("GF_MAX_HOR_DIST", "GF_MAX_VER_DIST"):
        del desk.parameters[name]
    desk.run(2.0).order(INSPECTION).run(0.5)
    assert desk.answers() == [TEMPORARILY_REJECTED]
    assert not desk.said("unread")
    desk.run(10.0)
    assert desk.texts().count("MOAR: 2 parameters unread, taken as worst") == 1
    desk.order(INSPECTION, 0.0).run(0.5)
    assert desk.answers()[-1] == TEMPORARILY_REJECTED
    assert desk.said("unread: GF_MAX_HOR_DIST, GF_MAX_VER_DIST") or desk.said(
        "unread: GF_MAX_HOR_DIST and 1 more"
    )


@pytest.mark.uncounted
def test_a_fence_with_unreadable_items_does_not_count_as_none():
    desk = Desk(fence_items=4)
    desk.run(20.0).order(INSPECTION).run(0.5)
    assert desk.answers() == [TEMPORARILY_REJECTED]
    assert desk.said("autopilot's fence not read yet, rejected")


def test_the_fence_is_rebuilt_only_after_a_change():
    """The fence is read in every cycle, fifty times a second."""
    watch, items = SiteFence(SITE, 1.5), corners(3)
    with mock.patch.object(site_fence, "plane_fence", wraps=site_fence.plane_fence) as made:
        for _ in range(3):
            watch.learn(PX4, PARAMETERS, items, HOME_M)
        assert made.call_count == 1
        watch.learn(PX4, PARAMETERS, corners(3), HOME_M)  # the same items, read again
        assert made.call_count == 1
        watch.learn(PX4, PARAMETERS, corners(4), HOME_M)
        watch.learn(PX4, {**PARAMETERS, "GF_MAX_HOR_DIST": 9.0}, corners(4), HOME_M)
        assert made.call_count == 3


def corners(number):
    return tuple(
        FenceItem(command=5002, parameter=number, latitude_deg=45.0, longitude_deg=-71.0 + n)
        for n in range(number)
    )


def test_a_home_that_moves_within_its_accuracy_keeps_the_fence():
    watch = SiteFence(SITE, 1.5)
    watch.learn(PX4, PARAMETERS, (), HOME_M)
    known = watch.plane
    for x_m, same in ((27.001, True), (27.05, True), (27.5, False)):
        watch.learn(PX4, PARAMETERS, (), (x_m, 0.0, 0.0))
        assert (watch.plane is known) is same


def flown_with_a_fence(**fence):
    """A desk whose fence is set while it flies an inspection."""
    desk = Desk(height_m=5.0, wind_mps=2.0).set(accuracy_m=0.3)
    desk.run(1.0).report_home(27.0).come_to("flying", then_s=3.0)
    assert any((desk.setpoints()[-1].vx, desk.setpoints()[-1].vy, desk.setpoints()[-1].vz))
    return desk.set_parameters(**fence)


def test_a_fence_tightened_in_flight_is_a_hold_until_it_is_widened():
    """The aircraft brakes within the acceleration; the gate, which needs an order, does not act."""
    desk = flown_with_a_fence(GF_MAX_VER_DIST=5.0)
    began_s = desk.now_s
    desk.run(3.0)
    assert desk.state == "holding"
    assert desk.said("outside GF_MAX_VER_DIST 5 m, holding")
    assert not desk.said("setpoint")
    speeds = [np.hypot(m.vx, np.hypot(m.vy, m.vz)) for m in desk.setpoints(began_s)]
    assert speeds[-1] == 0.0
    braking_mps2 = desk.vehicle.guidance.acceleration_mps2
    assert max(-np.diff(speeds)) <= 2.0 * braking_mps2 * STEP_S
    desk.set_parameters(GF_MAX_VER_DIST=0.0).run_until("flying", 5.0)


def test_the_aircraft_slows_down_towards_a_fence_set_nearer_in_flight():
    desk = flown_with_a_fence(GF_ACTION=2.0)
    flight = desk.companion.state.routes.flight
    rest_m, _ = flight.path.rest()
    ahead_m = float(rest_m[:, 2].max())
    before = flight._reference.trajectory.speed_mps.copy()
    bound = Bound(name="near", z_m=(0.0, ahead_m - 0.2))
    flight.learn_fence(PlaneFence(bounds=(bound,), margin_m=0.0))
    after = flight._reference.trajectory.speed_mps
    assert (after <= before).all()
    assert (after < before - 0.05).any()


def test_each_obstacle_inflation_within_a_fence_has_its_own_planner():
    plane = plane_fence(
        Fence(circle=Limit(parameter="GF_MAX_HOR_DIST", value_m=12.0)), FRAME, HOME_M, 1.5
    )
    planners = PlannerSet(Planner(SITE, VEHICLE))
    inner = planners.widened_by(0.0, plane)
    assert inner is planners.widened_by(0.0, plane)
    assert inner is not planners.widened_by(0.2, plane)
    outside = ~plane.holds(
        np.stack(np.meshgrid(*inner.maps.grid.axes_m, indexing="ij"), axis=-1).reshape(-1, 2)
    ).reshape(inner.maps.occupied.shape)
    exact = planners.exact.maps
    assert (inner.maps.occupied == (exact.occupied | outside)).all()
    assert (inner.maps.safety_cost == exact.safety_cost).all()
    assert (inner.maps.room_m == exact.room_m).all()


def test_a_start_outside_the_fence_is_left_by_a_leg_into_it():
    plane = plane_fence(
        Fence(ceiling=Limit(parameter="GF_MAX_VER_DIST", value_m=8.0)), FRAME, HOME_M, 1.5
    )
    planners = PlannerSet(Planner(SITE, VEHICLE))
    job = PlanJob(
        job_id=1,
        request=planners.exact.plan(mission=Mission.EXIT, start=(27.0, 9.0)).request,
        fence=plane,
    )
    answer = answer_job(planners, job)
    assert answer.escape_m
    assert answer.escape_m[-1][1] <= 6.5
    assert plane.holds(answer.plan.waypoints.position_m).all()

"""Ground that is not flat: lowest heights, maps, plans, legs, against distances by shapely."""

from __future__ import annotations

import random
from dataclasses import replace

import numpy as np
import pytest
from shapely.geometry import LineString, Point, Polygon

from moar_companion.companion.estimation.pose import Setpoint
from moar_companion.companion.guidance.flight_volume import FlightVolume
from moar_companion.companion.safety.failsafe_paths import exposed_places
from moar_companion.errors import InputError
from moar_companion.mavlink.autopilots.failsafe_actions import (
    AutopilotAction,
    FailsafeAction,
    Failsafes,
    Trigger,
)
from moar_companion.planner.escape import recovery_leg
from moar_companion.planner.ground_profile import floor_m
from moar_companion.planner.maps import build_maps
from moar_companion.planner.planner import Planner
from moar_companion.planner.regions import goal_region, landing_leg, legs_above_ground
from moar_companion.planner.site import Margin, Site
from moar_companion.settings.config import shipped_configs
from moar_companion.types import PX4, Mission

from ..losses import loss_of
from .problems import conductor, make_site, make_vehicle

LEAST_M = 1.5
HILL = ((0.0, 0.0), (6.0, 0.0), (10.0, 6.0), (14.0, 0.5), (20.0, 0.0))
VEHICLE = make_vehicle(radius=0.5)
WIRE = conductor(10.0, 12.0, 0.02, name="wire")
BESIDE = Setpoint(position_m=(10.0, 0.0, 7.0), velocity_mps=(0.0, 0.0, 0.0), yaw_rad=0.0)


def hilly(profile=HILL, **changes):
    site = make_site(
        WIRE,
        size=(20.0, 15.0),
        resolution=0.5,
        start=(2.0, 3.0),
        targets={"target": (18.25, 3.25)},
        **changes,
    )
    space = replace(site.workspace, min_altitude_m=LEAST_M, ground_m=profile)
    return replace(site, workspace=space)


def ground_of(profile):
    (left, left_z), (right, right_z) = profile[0], profile[-1]
    ends = [(right + 100.0, right_z), (right + 100.0, -100.0), (left - 100.0, -100.0)]
    return Polygon([(left - 100.0, left_z), *profile, *ends])


def random_profile(rng):
    x_m = sorted(rng.uniform(0.0, 20.0) for _ in range(rng.randint(0, 6)))
    return tuple((x, rng.uniform(-4.0, 8.0)) for x in (-1.0, *x_m, 21.0))


def file_text(ground, **workspace):
    text = (shipped_configs() / "sites" / "315kv_double_circuit.yaml").read_text()
    for key, value in workspace.items():
        text = text.replace(f", {key}: 2.0", value)
    return f"{text}\nground: {ground}\n"


@pytest.mark.parametrize("seed", range(5))
def test_the_least_height_is_the_lowest_at_that_distance_from_the_ground(seed):
    rng = random.Random(seed)
    profile = random_profile(rng)
    ground, distance_m = ground_of(profile), rng.uniform(0.2, 4.0)
    for x_m in (rng.uniform(-5.0, 25.0) for _ in range(40)):
        least_m = float(floor_m(profile, distance_m, x_m))
        assert ground.distance(Point(x_m, least_m)) == pytest.approx(distance_m, abs=1e-6)
        assert ground.distance(Point(x_m, least_m + 0.01)) > distance_m
        assert ground.distance(Point(x_m, least_m - 0.01)) < distance_m


def test_a_level_profile_is_as_none():
    level = Site.of_text(file_text("[[0, 0], [30, 0]]"), "level")
    plain = Site.of_text(file_text("null"), "plain")
    assert plain == Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
    vehicle = make_vehicle(radius=0.38)
    maps = [build_maps(site, vehicle) for site in (level, plain)]
    assert (maps[0].occupied == maps[1].occupied).all()
    regions = [
        goal_region(site, vehicle, each, Mission.EVACUATION)
        for site, each in zip((level, plain), maps, strict=True)
    ]
    assert (regions[0].mask == regions[1].mask).all()
    assert regions[0].corners.keys() == regions[1].corners.keys()


@pytest.mark.parametrize("seed", range(4))
def test_a_path_keeps_the_minimum_altitude_from_the_ground(seed):
    rng = random.Random(seed)
    profile = HILL if seed == 0 else random_profile(rng)
    site, ground = hilly(profile), ground_of(profile)
    planner = Planner(site, VEHICLE)
    occupied = planner.maps.occupied
    free = np.argwhere(~occupied)
    centres = np.array(planner.maps.grid.lower_m) + (free + 0.5) * 0.5
    assert all(ground.distance(Point(at)) >= LEAST_M - 1e-6 for at in centres)
    start, target = (tuple(centres[index].tolist()) for index in (0, -1))
    site = replace(site, targets=(replace(site.targets[0], position_m=target),))
    planner = Planner(site, VEHICLE)
    plan = planner.plan(mission=Mission.INSPECTION, start=start)
    if plan.reason:
        return
    refined = planner.refine(plan).points_m
    least_m = min(LEAST_M, ground.distance(LineString(plan.waypoints.position_m)))
    assert ground.distance(LineString(refined)) >= least_m - 1e-6


def test_a_path_over_a_hill_climbs_and_its_legs_do_not_lead_through_it():
    site = hilly()
    planner = Planner(site, VEHICLE)
    plan = planner.plan(mission=Mission.INSPECTION, start=(2.25, 3.25))
    assert not plan.reason
    assert plan.waypoints.position_m[:, 1].max() > 7.0
    starts = np.array([(2.0, 3.0), (2.0, 13.0), (15.5, 3.0)])
    assert legs_above_ground(site, starts, np.array((18.0, 3.0))).tolist() == [False, True, True]


@pytest.mark.parametrize("landing", [(17.0, 0.3), (24.0, 0.0), (3.0, 0.0)])
def test_a_landing_leg_begins_at_the_edge_and_keeps_off_the_ground(landing):
    site, ground = hilly(), ground_of(HILL)
    site = replace(site, landing_m={Mission.EXIT: (landing,)})
    maps = build_maps(site, VEHICLE)
    region = goal_region(site, VEHICLE, maps, Mission.EXIT)
    assert region.mask.any()
    for x, z in np.argwhere(region.mask).tolist():
        leg = landing_leg(site, VEHICLE, region, (x, z))
        points = [maps.grid.centre_m((x, z)), *map(tuple, leg.points_m.tolist())]
        end_m = ground.distance(Point(points[-1]))
        # It leaves the cell's centre by its edge, half a cell lower.
        assert ground.distance(LineString(points)) >= min(LEAST_M - 0.25, end_m) - 1e-6


def test_no_leg_leads_to_a_landing_point_behind_the_hill():
    site = hilly()
    maps = build_maps(site, VEHICLE)
    region = goal_region(
        replace(site, landing_m={Mission.EXIT: ((14.5, 0.4),)}), VEHICLE, maps, Mission.EXIT
    )
    columns = np.argwhere(region.mask)[:, 0] * 0.5
    assert columns.min() > 10.0


def test_a_setpoint_is_refused_where_it_is_low_above_its_own_ground():
    site = hilly()
    volume = FlightVolume(
        site=site, vehicle=VEHICLE, maps=build_maps(site, VEHICLE), loss=loss_of(PX4)
    )

    def refusal(x_m, z_m, **options):
        setpoint = replace(BESIDE, position_m=(x_m, 0.0, z_m))
        return volume.refusal(setpoint, (), plane_tolerance_m=1.0, widened_m=0.0, **options)

    assert refusal(10.25, 8.25) is None
    assert refusal(10.25, 6.75).reason == "setpoint near an obstacle, or low"
    assert refusal(2.25, 2.25) is None
    # Wind may carry a low aircraft, never into the ground.
    assert refusal(10.25, 6.75, carried_from_z_m=2.0) is None
    assert refusal(10.25, 6.25, carried_from_z_m=2.0) is not None


def test_the_speed_is_capped_before_ground_that_rises():
    site = hilly()
    volume = FlightVolume(
        site=site, vehicle=VEHICLE, maps=build_maps(site, VEHICLE), loss=loss_of(PX4)
    )
    places = np.array([(1.25, 0.0, 3.25), (5.25, 0.0, 3.25), (5.25, 0.0, 10.25)])
    level = np.tile((1.0, 0.0, 0.0), (3, 1))
    far, near, above = volume.speed_cap_mps(places, level).tolist()
    assert near < far < above
    stop_m = 5.25 + float(volume.loss.stopping_m(np.array(near)))
    assert ground_of(HILL).distance(Point(stop_m, 3.25)) >= LEAST_M - 1e-6


def test_the_speed_is_capped_above_ground_that_is_below_the_workspace():
    site = hilly()
    space = replace(site.workspace, lower_m=(0.0, 5.0), min_altitude_m=4.0, ground_m=())
    place, down = np.array([(2.25, 0.0, 6.25)]), np.array([(0.0, 0.0, -1.0)])

    def cap_mps(profile):
        over = replace(site, workspace=replace(space, ground_m=profile))
        maps = build_maps(over, VEHICLE)
        volume = FlightVolume(site=over, vehicle=VEHICLE, maps=maps, loss=loss_of(PX4))
        return float(volume.speed_cap_mps(place, down)[0])

    level = cap_mps(((0.0, 0.0), (20.0, 0.0)))
    assert 0.8 * cap_mps(()) < level <= cap_mps(())
    assert cap_mps(((0.0, -1.0), (20.0, -1.0))) > level


def test_a_low_aircraft_on_a_slope_recovers_straight_up():
    site = hilly()
    corners = recovery_leg(site, VEHICLE, build_maps(site, VEHICLE), (8.25, 3.8))
    assert corners[0][0] == pytest.approx(8.25)
    assert ground_of(HILL).distance(Point(corners[0])) >= LEAST_M - 1e-6


def test_a_level_return_hits_the_hill_and_a_landing_on_it_does_not():
    site = hilly().flown_with(Margin(position_m=0.5, tracking_m=0.5))
    reach = build_maps(site, VEHICLE).reach
    places = np.array([(2.25, 3.25), (10.25, 9.25), (17.25, 3.25)])

    def exposed(action, **options):
        item = FailsafeAction(trigger=Trigger.GPS_LOSS, action=action, setting="", **options)
        return exposed_places(Failsafes(actions=(item,)), reach, places, drifting=True).tolist()

    assert exposed(AutopilotAction.LAND) == [False, False, False]
    assert exposed(AutopilotAction.DRIFT, drift_m=5.0) == [True, False, True]
    assert reach.nearest((10.0, 6.5)) == "ground"


@pytest.mark.parametrize("seed", range(4))
def test_no_descent_hits_the_ground_that_it_ends_on(seed):
    rng = random.Random(seed)
    site = replace(hilly(random_profile(rng)), obstacles=())
    maps = build_maps(site, VEHICLE)
    free = np.argwhere(~maps.occupied)
    places = np.array(maps.grid.lower_m) + (free + 0.5) * maps.grid.resolution_m
    descent = FailsafeAction(
        trigger=Trigger.GPS_LOSS, action=AutopilotAction.DESCEND, setting="", drift_m=2.0
    )
    mask = exposed_places(Failsafes(actions=(descent,)), maps.reach, places, drifting=True)
    assert not mask.any()


@pytest.mark.parametrize(
    ("ground", "workspace", "words"),
    [
        ("[[0, 0]]", {}, "ground: has a length of 1, must be at least 2"),
        ("[[0, 0], [30, 1, 2]]", {}, "ground[1]: "),
        ("[[0, 0], [20, 1], [20, 2], [30, 0]]", {}, "ground[2]: has x 20 after 20, x must rise"),
        ("[[0, 0], [29, 0]]", {}, "ground: reaches from x = 0 to 29, must reach from 0 to 30"),
        ("[[0, 0], [30, 0]]", {"min_altitude_m": ""}, "workspace.min_altitude_m: is missing"),
    ],
)
def test_a_profile_that_cannot_be_used_is_refused(ground, workspace, words):
    with pytest.raises(InputError, match=words.replace("[", r"\[").replace("]", r"\]")):
        Site.of_text(file_text(ground, **workspace), "site.yaml")

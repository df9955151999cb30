"""Frames: the site's plane on the WGS84 ellipsoid, and the autopilots' own projections."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from moar_companion.companion.estimation.plane_to_local import PlaneToLocal
from moar_companion.mavlink import autopilots
from moar_companion.planner.site_frame import SiteFrame, radii_of_curvature_m
from moar_companion.types import ARDUPILOT, PX4, UNKNOWN, GeodeticPoint

ORIGIN = GeodeticPoint(latitude_deg=45.3781, longitude_deg=-71.9295, altitude_amsl_m=210.0)


def geodetic(latitude_deg, longitude_deg, altitude_m=0.0):
    return GeodeticPoint(
        latitude_deg=latitude_deg, longitude_deg=longitude_deg, altitude_amsl_m=altitude_m
    )


def earth_centred(point):
    """WGS84 geodetic to earth-centred coordinates, by the textbook."""
    a, f = 6_378_137.0, 1.0 / 298.257223563
    e2 = f * (2.0 - f)
    latitude, longitude = math.radians(point.latitude_deg), math.radians(point.longitude_deg)
    n = a / math.sqrt(1.0 - e2 * math.sin(latitude) ** 2)
    h = point.altitude_amsl_m
    return np.array(
        [
            (n + h) * math.cos(latitude) * math.cos(longitude),
            (n + h) * math.cos(latitude) * math.sin(longitude),
            (n * (1.0 - e2) + h) * math.sin(latitude),
        ]
    )


def px4_projection(point, origin):
    """MapProjection::project of PX4 (src/lib/geo/geo.cpp), with its arccosine."""
    lat, lon = math.radians(point.latitude_deg), math.radians(point.longitude_deg)
    ref_lat, ref_lon = math.radians(origin.latitude_deg), math.radians(origin.longitude_deg)
    cos_d_lon = math.cos(lon - ref_lon)
    arg = math.sin(ref_lat) * math.sin(lat) + math.cos(ref_lat) * math.cos(lat) * cos_d_lon
    c = math.acos(min(1.0, max(-1.0, arg)))
    k = c / math.sin(c) if abs(c) > 0.0 else 1.0
    north = math.cos(ref_lat) * math.sin(lat) - math.sin(ref_lat) * math.cos(lat) * cos_d_lon
    east = math.cos(lat) * math.sin(lon - ref_lon)
    return k * north * 6_371_000.0, k * east * 6_371_000.0


# The site's plane -------------------------------------------------------------------------------


@pytest.mark.parametrize("azimuth_deg", [0.0, 37.0, 90.0, 271.0])
@pytest.mark.parametrize("latitude_deg", [45.3781, -33.0, 69.0])
def test_a_moved_frame_moves_every_place_by_the_same_displacement_in_the_world(
    azimuth_deg, latitude_deg
):
    before = SiteFrame(origin=geodetic(latitude_deg, 179.99999, 210.0), azimuth_deg=azimuth_deg)
    after = before.moved(3.0, 4.0, -1.5)
    assert after.azimuth_deg == azimuth_deg
    for place_m in ((0.0, 0.0, 0.0), (40.0, 0.0, 18.0)):
        points = [earth_centred(frame.to_geodetic(place_m)) for frame in (before, after)]
        assert math.dist(*points) == pytest.approx(math.hypot(3.0, 4.0, 1.5), abs=1e-3)
    x_m, y_m = before.place_of(after.origin.latitude_deg, after.origin.longitude_deg)
    assert math.hypot(x_m, y_m) == pytest.approx(5.0, abs=1e-4)
    bearing_rad = before.bearing_rad(x_m, y_m)
    assert math.cos(bearing_rad - math.atan2(4.0, 3.0)) == pytest.approx(1.0)
    assert after.origin.altitude_amsl_m == 208.5


@pytest.mark.parametrize(
    ("azimuth", "north", "east"),
    [(0.0, 1, 0), (90.0, 0, 1), (180.0, -1, 0), (270.0, 0, -1), (360.0, 1, 0), (45.0, 1, 1)],
)
def test_x_points_along_the_azimuth(azimuth, north, east):
    point = SiteFrame(origin=ORIGIN, azimuth_deg=azimuth).to_geodetic((10.0, 0.0, 0.0))
    steps = (point.latitude_deg - 45.3781, point.longitude_deg + 71.9295)
    for step, sign in zip(steps, (north, east), strict=True):
        assert (abs(step) < 1e-12) if sign == 0 else (step * sign > 1e-5)


def test_y_is_to_the_left_of_x_and_z_is_up():
    east = SiteFrame(origin=ORIGIN, azimuth_deg=90.0)
    left = east.to_geodetic((0.0, 10.0, 3.0))
    assert left.latitude_deg > ORIGIN.latitude_deg
    assert left.longitude_deg == pytest.approx(ORIGIN.longitude_deg, abs=1e-12)
    assert left.altitude_amsl_m == 213.0


@pytest.mark.parametrize("latitude", [-60.0, -33.0, 0.0, 45.3781, 70.0])
@pytest.mark.parametrize("azimuth", [0.0, 33.0, 90.0, 250.0])
def test_metres_of_the_site_are_metres_on_the_ellipsoid(latitude, azimuth):
    origin = geodetic(latitude, -71.9)
    frame = SiteFrame(origin=origin, azimuth_deg=azimuth)
    for position in ((100.0, 0.0, 0.0), (0.0, 50.0, 0.0), (-80.0, 20.0, 0.0)):
        chord = np.linalg.norm(earth_centred(frame.to_geodetic(position)) - earth_centred(origin))
        assert chord == pytest.approx(math.hypot(*position), rel=5e-5)


def test_the_radii_of_curvature_are_those_of_wgs84():
    # At the equator a (1 - e2) and a, at a pole a / sqrt(1 - e2) twice.
    assert radii_of_curvature_m(0.0) == pytest.approx((6_335_439.327, 6_378_137.0), abs=1e-2)
    assert radii_of_curvature_m(90.0) == pytest.approx((6_399_593.626,) * 2, abs=1e-2)


# Local NED --------------------------------------------------------------------------------------


def test_px4s_frame_is_its_own_formula_beyond_the_reach_of_the_arccosines_rounding():
    rng = random.Random("px4")
    for _ in range(300):
        origin = geodetic(rng.uniform(-75.0, 75.0), rng.uniform(-179.0, 179.0), 100.0)
        distance_deg = 10.0 ** rng.uniform(-3.0, 0.0)
        turn = rng.uniform(0.0, math.tau)
        point = geodetic(
            origin.latitude_deg + 1.5 * distance_deg * math.cos(turn),
            origin.longitude_deg + 1.5 * distance_deg * math.sin(turn),
            130.0,
        )
        expected = px4_projection(point, origin)
        north, east, down = autopilots.profile(PX4).to_local_ned(point, origin)
        # The arccosine near 1 has a relative error of eps / c^2: 1e-6 at 100 m.
        assert (north, east) == pytest.approx(expected, rel=5e-6, abs=1e-3)
        assert down == -30.0


def test_px4s_frame_keeps_its_precision_over_centimetres():
    step_deg = math.degrees(0.01 / 6_371_000.0)
    point = geodetic(ORIGIN.latitude_deg + step_deg, ORIGIN.longitude_deg)
    assert autopilots.profile(PX4).to_local_ned(point, ORIGIN)[0] == pytest.approx(0.01, abs=1e-8)
    assert autopilots.profile(PX4).to_local_ned(ORIGIN, ORIGIN) == (0.0, 0.0, 0.0)


def test_ardupilots_frame_scales_degrees_by_its_own_constant():
    # LOCATION_SCALING_FACTOR: 0.011131884502145034 m for 1e-7 degrees.
    point = geodetic(ORIGIN.latitude_deg + 1e-3, ORIGIN.longitude_deg + 1e-3, 200.0)
    north, east, down = autopilots.profile(ARDUPILOT).to_local_ned(point, ORIGIN)
    metres = 1e4 * 0.011131884502145034
    assert north == pytest.approx(metres, abs=1e-6)
    middle = math.radians(ORIGIN.latitude_deg + 0.5e-3)
    assert east == pytest.approx(metres * math.cos(middle), abs=1e-6)
    assert down == 10.0


# The two composed -------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [*autopilots.PROFILES, UNKNOWN])
def test_local_ned_and_the_plane_are_inverse(kind):
    rng = random.Random("inverse")
    for _ in range(100):
        frame = SiteFrame(origin=ORIGIN, azimuth_deg=rng.uniform(0.0, 360.0))
        home = frame.to_geodetic(
            (rng.uniform(-300, 300), rng.uniform(-300, 300), rng.uniform(-5, 5))
        )
        both = PlaneToLocal.between(frame, home, kind)
        vector = (rng.uniform(-100, 100), rng.uniform(-100, 100), rng.uniform(0, 50))
        there_and_back = both.position_from_ned(both.position_to_ned(vector))
        assert there_and_back == pytest.approx(vector, abs=1e-9)
        assert both.velocity_from_ned(both.velocity_to_ned(vector)) == pytest.approx(
            vector, abs=1e-9
        )


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
def test_the_affine_map_is_the_projection_of_the_geodetic_point(kind):
    rng = random.Random("affine")
    for _ in range(100):
        frame = SiteFrame(origin=ORIGIN, azimuth_deg=rng.uniform(0.0, 360.0))
        home = frame.to_geodetic((rng.uniform(-200, 200), rng.uniform(-200, 200), -1.0))
        both = PlaneToLocal.between(frame, home, kind)
        position = (rng.uniform(-60, 60), rng.uniform(-60, 60), rng.uniform(0, 40))
        expected = autopilots.profile(kind).to_local_ned(frame.to_geodetic(position), home)
        assert both.position_to_ned(position) == pytest.approx(expected, abs=5e-3)


@pytest.mark.parametrize("kind", [PX4, ARDUPILOT])
@pytest.mark.parametrize("azimuth", [0.0, 37.0, 90.0, 200.0])
def test_the_axes_stay_orthogonal_but_for_the_scales_of_the_projection(kind, azimuth):
    frame = SiteFrame(origin=ORIGIN, azimuth_deg=azimuth)
    matrix = PlaneToLocal.between(frame, ORIGIN, kind).matrix
    # Spheres of 6,371 and 6,378 km against the ellipsoid: at most half a per cent, as a shear too.
    assert matrix.T @ matrix == pytest.approx(np.eye(3), abs=1e-2)
    assert np.linalg.det(matrix) == pytest.approx(1.0, abs=1e-2)
    # x, y, z is right-handed with z up; north, east, down is right-handed with z down.
    turn = math.radians(azimuth)
    assert matrix[:, 0] == pytest.approx([math.cos(turn), math.sin(turn), 0.0], abs=1e-2)
    assert matrix[:, 1] == pytest.approx([math.sin(turn), -math.cos(turn), 0.0], abs=1e-2)
    assert matrix[:, 2] == pytest.approx([0.0, 0.0, -1.0], abs=1e-12)


def test_with_an_azimuth_of_90_degrees_x_is_east_and_y_is_north():
    both = PlaneToLocal.between(SiteFrame(origin=ORIGIN, azimuth_deg=90.0), ORIGIN, PX4)
    north, east, down = both.velocity_to_ned((1.0, 0.0, 0.0))
    assert (north, east, down) == pytest.approx((0.0, 1.0, 0.0), abs=5e-3)
    assert both.velocity_to_ned((0.0, 1.0, 0.0)) == pytest.approx((1.0, 0.0, 0.0), abs=5e-3)
    assert both.velocity_to_ned((0.0, 0.0, 2.0)) == pytest.approx((0.0, 0.0, -2.0))


def test_a_home_away_from_the_site_shifts_positions_and_not_velocities():
    frame = SiteFrame(origin=ORIGIN, azimuth_deg=90.0)
    home = frame.to_geodetic((-50.0, 0.0, -2.0))
    both = PlaneToLocal.between(frame, home, ARDUPILOT)
    assert both.position_to_ned((0.0, 0.0, 0.0)) == pytest.approx((0.0, 50.0, -2.0), abs=0.2)
    assert both.velocity_to_ned((1.0, 0.0, 0.0)) == pytest.approx((0.0, 1.0, 0.0), abs=5e-3)

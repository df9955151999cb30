"""Sites and flights across the 180th meridian: distances of metres."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from moar_companion.commands.cli import main
from moar_companion.commands.point_clouds import Cloud, around
from moar_companion.mavlink.autopilots import profile
from moar_companion.planner.site import Site
from moar_companion.planner.site_frame import SiteFrame
from moar_companion.settings.config import shipped_configs
from moar_companion.types import AutopilotKind, GeodeticPoint
from tests.flights.judging import assert_nothing_was_touched, in_plane
from tests.flights.lockstep import Lockstep
from tests.flights.operator import INSPECTION, Manner

SHARED = Path(__file__).parents[3] / "shared" / "cases" / "antimeridian.csv"
SURVEY = """\
kind,name,latitude_deg,longitude_deg,altitude_amsl_m
conductor,a,-17.8000,179.99990,30
conductor,a,-17.8000,-179.99985,30
conductor,b,-17.80008,179.99990,34
conductor,b,-17.80008,-179.99985,34
target,t,-17.80012,179.99999,30
ground,g,-17.8002,179.9999,5
start,s,-17.8003,-179.99999,12
exit,x,-17.8004,179.99999,12
evacuation,e,-17.8004,179.99999,12
"""
WEST = GeodeticPoint(latitude_deg=-17.8, longitude_deg=179.99999, altitude_amsl_m=30.0)


@pytest.mark.parametrize("kind", [each.value for each in Manner])
def test_the_local_frame_has_metres_across_the_meridian(kind):
    east = replace(WEST, longitude_deg=-179.99999)
    north_m, east_m, _ = profile(AutopilotKind(kind)).to_local_ned(east, WEST)
    metres = math.radians(2e-5) * 6.37e6 * math.cos(math.radians(17.8))
    assert (north_m, east_m) == pytest.approx((0.0, metres), abs=0.01)


def test_a_place_beyond_the_meridian_has_a_longitude_that_exists():
    place = SiteFrame(origin=WEST, azimuth_deg=90.0).to_geodetic((10.0, 0.0, 0.0))
    assert -180.0 <= place.longitude_deg < -179.9999


def test_a_map_across_the_meridian_makes_a_site_of_metres(tmp_path: Path):
    survey, site = tmp_path / "survey.csv", tmp_path / "site.yaml"
    survey.write_text(SURVEY)
    assert main(["site", "from-map", str(survey), "--out", str(site)]) == 0
    made = Site.load(str(site))
    assert [each.position_m[0] for each in made.obstacles] == pytest.approx([13.3, 4.4], abs=0.1)
    assert all(abs(value) < 50.0 for value in (*made.workspace.lower_m, *made.workspace.upper_m))


def test_a_start_beside_the_plane_is_refused_with_its_distance_in_metres(tmp_path, capsys):
    if not SHARED.exists():
        pytest.skip("no ../shared/cases beside the checkout")
    assert main(["site", "from-map", str(SHARED), "--out", str(tmp_path / "site.yaml")]) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert ": s: " in line
    assert "9.5 m" in line


def test_a_cloud_across_the_meridian_has_points_in_metres():
    pyproj = pytest.importorskip("pyproj")
    random = np.random.default_rng(0)
    longitude = 180.0 + random.uniform(-1e-4, 1e-4, 500)
    longitude = np.where(longitude > 180.0, longitude - 360.0, longitude)
    points = np.column_stack((longitude, np.full(500, -17.8), np.full(500, 30.0)))
    cloud = Cloud(file="cloud.laz", points=points, crs=pyproj.CRS("EPSG:4979"))
    local = around(cloud, (-17.8, 179.99999), None)
    assert len(local.points_m) == 500
    assert np.ptp(local.points_m[:, 0]) == pytest.approx(21.2, abs=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("manner", list(Manner))
def test_a_flight_across_the_meridian_reaches_its_target(manner):
    site = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
    origin = replace(WEST, longitude_deg=179.99982, altitude_amsl_m=5.0)
    site = replace(site, frame=SiteFrame(origin=origin, azimuth_deg=90.0))
    flight = Lockstep(site=site, manner=manner)
    flight.take_off(site.start_m[1])
    flight.begin(INSPECTION, 1)
    flight.run_until_state("at_target", 200.0)
    assert_nothing_was_touched(flight)
    target_x_m, target_z_m = site.targets[1].position_m
    truth = flight.truths[-1]
    x_m, y_m, z_m = in_plane(site, truth.latitude_deg, truth.longitude_deg, truth.altitude_amsl_m)
    assert math.dist((x_m, y_m, z_m), (target_x_m, 0.0, target_z_m)) < 1.5
    longitudes = [truth.longitude_deg for truth in flight.truths]
    assert min(longitudes) < 0.0 < max(longitudes), "it has flown across"

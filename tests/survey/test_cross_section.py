"""A site from a cloud: the plane, its obstacles, its landing places, against the made scene."""

import math
from dataclasses import replace

import numpy as np
import pytest
import yaml

from moar_companion.perception.spans import find_power_line
from moar_companion.perception.survey.cross_section import site_of_cloud
from moar_companion.perception.survey.site_document import SiteOptions, SurveyError, site_text
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Conductor, Polygon, Site
from moar_companion.settings.config import default_vehicle
from moar_companion.settings.vehicle import Vehicle
from moar_companion.types import GeodeticPoint, Mission
from tests.perception.scenes import DOUBLE_CIRCUIT, Scene, Wire

AT = GeodeticPoint(latitude_deg=45.4, longitude_deg=-71.9, altitude_amsl_m=200.0)


def survey(scene, along_m=100.0, lateral_m=-5.8, height_m=None, **options):
    """The cross-section at a place of the scene."""
    cloud = scene.cloud - scene.place(along_m, lateral_m, 0.0)
    return site_of_cloud(cloud, find_power_line(cloud), AT, height_m, SiteOptions(**options))


def loaded(section, tmp_path):
    """The site as its file is read."""
    file = tmp_path / "site.yaml"
    file.write_text(site_text(section.document, ["made"]))
    return Site.load(file)


@pytest.fixture(
    params=[*(pytest.param(each, marks=pytest.mark.slow) for each in (0.0, 140.0)), 260.0]
)
def scene(request):
    return Scene(1, azimuth_deg=request.param).with_wires(DOUBLE_CIRCUIT).with_ground()


def test_conductors_stand_where_they_hang(scene, tmp_path):
    site = loaded(survey(scene), tmp_path)
    wires = [each for each in site.obstacles if isinstance(each, Conductor)]
    assert len(wires) == 6
    found = sorted((round(abs(x), 1), round(z, 1)) for x, z in (each.position_m for each in wires))
    expected = sorted((round(abs(each.lateral_m), 1), each.lowest_m) for each in DOUBLE_CIRCUIT)
    assert np.array(found) == pytest.approx(np.array(expected), abs=0.15)
    assert all(each.keep_out_m >= 0.5 for each in wires)


def test_the_plane_is_perpendicular_to_the_line_and_on_its_place(scene, tmp_path):
    site = loaded(survey(scene), tmp_path)
    across = math.radians(site.frame.azimuth_deg)
    assert abs(np.array([math.sin(across), math.cos(across)]) @ scene.along) < 0.01
    assert 0.0 <= site.frame.azimuth_deg < 180.0
    target = site.targets[0]
    at = site.frame.place_of(AT.latitude_deg, AT.longitude_deg)
    assert at[1] == pytest.approx(0.0, abs=0.1)
    assert target.look_at_m[0] == pytest.approx(at[0], abs=0.3)
    assert site.frame.origin.altitude_amsl_m == pytest.approx(200.0, abs=0.2)


def test_the_target_is_the_lowest_conductor_there_or_the_one_asked_for(scene):
    lowest = survey(scene).document["targets"]
    assert list(lowest) in (["at-circuit-1-phase-1"], ["at-circuit-2-phase-1"])
    highest = survey(scene, height_m=26.0).document["targets"]
    assert list(highest) in (["at-circuit-1-phase-3"], ["at-circuit-2-phase-3"])


def test_the_file_is_planned_on(scene, tmp_path):
    site = loaded(survey(scene), tmp_path)
    planner = Planner(site, Vehicle.load(default_vehicle()))
    for mission in Mission:
        assert planner.plan(mission=mission).reason == ""


@pytest.mark.uncounted
def test_a_tree_stands_on_the_ground_and_no_path_passes_below_its_crown(tmp_path):
    scene = Scene(2).with_wires(DOUBLE_CIRCUIT).with_ground().with_tree(100.0, 12.0, 9.0)
    site = loaded(survey(scene), tmp_path)
    trees = [each for each in site.obstacles if isinstance(each, Polygon)]
    side = 1.0 if max(x for each in trees for x, _ in each.vertices_m) > 0.0 else -1.0
    tops = [z for each in trees for x, z in each.vertices_m if abs(x - side * 12.0) < 1.5]
    assert max(tops) == pytest.approx(9.0, abs=0.8)
    assert min(z for each in trees for _, z in each.vertices_m) < 0.0


def test_ground_that_is_not_even_becomes_a_profile_and_no_obstacle(tmp_path):
    """The ground of the scene is lifted by 0.3 m for each metre across, as on a slope of 17 deg."""
    scene = Scene(11).with_wires(DOUBLE_CIRCUIT).with_ground().with_tree(100.0, 12.0, 9.0)
    lifted = scene.cloud + np.outer(0.3 * (scene.cloud[:, :2] @ scene.left), (0.0, 0.0, 1.0))
    cloud = lifted - scene.place(100.0, -5.8, 0.0)
    section = site_of_cloud(cloud, find_power_line(cloud), AT, None, SiteOptions())
    site = loaded(section, tmp_path)
    rising = math.copysign(0.3, site.workspace.ground_at_m(5.0) - site.workspace.ground_at_m(-5.0))
    for x_m in range(-15, 16, 5):
        assert site.workspace.ground_at_m(x_m) == pytest.approx(rising * x_m, abs=0.5)
    assert len(site.workspace.ground_m) < 20
    (tree,) = [each for each in site.obstacles if isinstance(each, Polygon)]
    tree_m = max(z - site.workspace.ground_at_m(x) for x, z in tree.vertices_m)
    assert tree_m == pytest.approx(9.0, abs=1.5)


@pytest.mark.uncounted
def test_a_tree_away_from_the_plane_is_not_in_it(tmp_path):
    scene = Scene(3).with_wires(DOUBLE_CIRCUIT).with_ground().with_tree(120.0, 12.0, 9.0)
    assert not [o for o in loaded(survey(scene), tmp_path).obstacles if isinstance(o, Polygon)]


def test_an_object_in_the_air_is_kept_and_a_lone_point_is_reported(tmp_path):
    scene = Scene(4).with_wires(DOUBLE_CIRCUIT).with_ground()
    scene._add(np.full(30, 100.0), np.linspace(0.0, 1.0, 30), np.full(30, 22.0), -2, 0.05)
    scene._add(np.array([100.0]), np.array([2.0]), np.array([15.0]), -2, 0.0)
    section = survey(scene)
    (hanging,) = [o for o in loaded(section, tmp_path).obstacles if isinstance(o, Polygon)]
    assert hanging.name == "hanging-1"
    assert {round(z) for _, z in hanging.vertices_m} <= {21, 22, 23}
    assert len(section.left_out_m) == 1
    assert "1 lone point left out" in section.notes


def test_a_tower_in_the_plane_is_one_shape(tmp_path):
    scene = Scene(5, length_m=150.0).with_ground().with_wires(DOUBLE_CIRCUIT).with_tower(149.0)
    site = loaded(survey(scene, along_m=148.0), tmp_path)
    towers = [each for each in site.obstacles if each.name.startswith("tower")]
    assert 1 <= len(towers) <= 3
    assert max(z for each in towers for _, z in each.vertices_m) > 30.0


def test_landing_places_are_on_even_ground_and_never_in_a_wood(tmp_path):
    scene = Scene(6, length_m=120.0).with_wires(DOUBLE_CIRCUIT).with_ground(width_m=120.0)
    for along in (52.0, 60.0, 68.0):
        for lateral in np.arange(18.0, 55.0, 4.0):
            scene.with_tree(along, lateral, 8.0)
    section = survey(scene, along_m=60.0)
    site = loaded(section, tmp_path)
    (place,) = site.landing_m[Mission.EVACUATION]
    assert place[1] == pytest.approx(2.5, abs=0.3)
    assert len([note for note in section.notes if "no landing place" in note]) == 1


def test_a_line_without_a_near_conductor_is_reported():
    scene = Scene(7).with_ground()
    with pytest.raises(SurveyError, match="no conductor was found"):
        survey(scene)
    scene = Scene(8, length_m=400.0).with_ground().with_wires(DOUBLE_CIRCUIT, end_m=200.0)
    with pytest.raises(SurveyError, match=r"the nearest is 1.. m away"):
        survey(scene, along_m=350.0)


def test_bundles_are_two_discs_and_the_standoff_is_of_the_nearer(tmp_path):
    wires = [Wire(lateral_m=x, lowest_m=12.0, bundle_m=0.4) for x in (-8.0, 0.0, 8.0)]
    scene = Scene(9).with_wires(wires).with_ground()
    site = loaded(survey(scene, lateral_m=-8.0, standoff_m=5.0), tmp_path)
    assert len(site.obstacles) == 6
    target = site.targets[0].position_m
    nearest = min(math.dist(target, each.position_m) for each in site.obstacles)
    assert nearest == pytest.approx(5.02, abs=0.02)


def test_the_text_is_yaml_with_the_same_content():
    section = survey(Scene(10).with_wires(DOUBLE_CIRCUIT).with_ground(), name="a: b # c")
    assert yaml.safe_load(site_text(section.document, ["remark: #1"])) == section.document


def test_without_ground_beneath_the_line_its_height_is_that_of_the_nearest_ground(tmp_path):
    """As over water, which reflects no light."""
    scene = Scene(3, length_m=60.0).with_wires(
        [replace(each, per_m=1.5) for each in DOUBLE_CIRCUIT[:3]]
    )
    for side in (-26.0, 14.0):
        beside = Scene(4, length_m=60.0).with_ground(0.5, 12.0)
        scene.points.append(beside.cloud + np.array([*(side * scene.left), 0.0]))
        scene.labels.append(beside.label)
    site = loaded(survey(scene, along_m=30.0), tmp_path)
    assert site.frame.origin.altitude_amsl_m == pytest.approx(200.0, abs=0.3)
    lowest_m = min(each.position_m[1] for each in site.obstacles if isinstance(each, Conductor))
    assert lowest_m == pytest.approx(12.0, abs=0.5)

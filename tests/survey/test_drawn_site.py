"""Points on a map to a site, and a site back on a map."""

import json
import math
from dataclasses import replace
from itertools import pairwise

import pytest

from moar_companion.errors import InputError
from moar_companion.perception.survey.drawn_site import features_of_site, site_of_features
from moar_companion.perception.survey.map_features import features_of, geojson_of, kml_of
from moar_companion.perception.survey.qgc_plan import qgc_plan_of
from moar_companion.perception.survey.site_document import SiteOptions, site_text
from moar_companion.planner.planner import Planner
from moar_companion.planner.site import Conductor, Polygon, Site
from moar_companion.planner.site_frame import SiteFrame
from moar_companion.settings.config import default_vehicle, shipped_configs
from moar_companion.settings.vehicle import Vehicle
from moar_companion.types import GeodeticPoint, Mission

SITES = sorted((shipped_configs() / "sites").glob("*.yaml"))
FRAME = SiteFrame(
    origin=GeodeticPoint(latitude_deg=45.4, longitude_deg=-71.9, altitude_amsl_m=200.0),
    azimuth_deg=90.0,
)
KML = '<kml xmlns="http://www.opengis.net/kml/2.2">'
ABSOLUTE = "<altitudeMode>absolute</altitudeMode>"
PLACE = "<coordinates>1,2,3</coordinates>"
HEADER = "kind,name,latitude_deg,longitude_deg,altitude_amsl_m,radius_m\n"


def row(kind, name, east, north, up, radius=""):
    at = FRAME.to_geodetic((east, north, up))
    place = f"{at.latitude_deg:.9f},{at.longitude_deg:.9f},{at.altitude_amsl_m}"
    return f"{kind},{name},{place},{radius}\n"


LINE = (
    HEADER
    + row("ground", "road", 0, 0, 0)
    + "".join(row("conductor", "left", -4, y, 12 + 0.001 * y * y) for y in (-25, 25, 60))
    + "".join(row("conductor", "right", 4, y, 12 + 0.001 * y * y) for y in (-25, 25, 60))
    + row("target", "splice", 8, 0, 12)
    + row("exit", "road", 25, 1, 2.5)
)


def site(text, tmp_path, ending=".csv"):
    document = site_of_features(features_of(text, "map", ending), "map", SiteOptions()).document
    file = tmp_path / "drawn.yaml"
    file.write_text(site_text(document, []))
    return Site.load(file)


def refused(text, ending=".csv"):
    with pytest.raises(InputError) as error:
        site_of_features(features_of(text, "map", ending), "map", SiteOptions())
    return str(error.value)


@pytest.mark.parametrize("file", SITES, ids=lambda file: file.stem)
@pytest.mark.parametrize(("ending", "writer"), [(".geojson", None), (".kml", kml_of)])
def test_a_site_exported_to_the_map_and_imported_is_the_same_site(file, ending, writer, tmp_path):
    shipped = Site.load(file)
    features = features_of_site(shipped, ())
    text = geojson_of(features) if writer is None else writer(shipped.name, features)
    back = site(text, tmp_path, ending)
    origin = back.frame.origin
    shift = shipped.frame.place_of(origin.latitude_deg, origin.longitude_deg)
    assert shift[1] == pytest.approx(0.0, abs=0.02)
    assert back.frame.azimuth_deg % 180.0 == pytest.approx(
        shipped.frame.azimuth_deg % 180.0, abs=0.02
    )
    sign = 1.0 if abs(back.frame.azimuth_deg - shipped.frame.azimuth_deg) < 90.0 else -1.0
    names = {each.name: each for each in back.obstacles}
    for obstacle in shipped.obstacles:
        assert names[obstacle.name].keep_out_m == pytest.approx(obstacle.keep_out_m, abs=1e-9)
        if isinstance(obstacle, Conductor):
            x, z = names[obstacle.name].position_m
            assert sign * x + shift[0] == pytest.approx(obstacle.position_m[0], abs=0.03)
            assert z == pytest.approx(obstacle.position_m[1], abs=0.03)
    assert [each.name for each in back.targets] == [each.name for each in shipped.targets]


@pytest.mark.parametrize("keep_out_m", [0.0, 0.52, 0.55, 2.0])
@pytest.mark.parametrize("ending", [".geojson", ".kml"])
def test_keep_outs_and_radii_survive_the_map(keep_out_m, ending, tmp_path):
    shipped = Site.load(SITES[0])
    corners = ((20.0, 0.0), (22.0, 0.0), (22.0, 5.0))
    obstacles = (
        *(each for each in shipped.obstacles if isinstance(each, Conductor)),
        Polygon(name="tree", vertices_m=corners),
    )
    obstacles = tuple(replace(each, keep_out_m=keep_out_m) for each in obstacles)
    features = features_of_site(replace(shipped, obstacles=obstacles), ())
    text = geojson_of(features) if ending == ".geojson" else kml_of("s", features)
    back = {each.name: each for each in site(text, tmp_path, ending).obstacles}
    for each in obstacles:
        assert back[each.name].keep_out_m == keep_out_m
        if isinstance(each, Conductor):
            assert back[each.name].radius_m == each.radius_m


def test_a_keep_out_in_one_row_of_a_csv_holds_for_the_conductor_and_sag_is_added(tmp_path):
    head, *rows = LINE.splitlines()
    first = next(index for index, each in enumerate(rows) if "conductor,left" in each)
    rows = [f"{each},{2 if index == first else ''}" for index, each in enumerate(rows)]
    drawn = site("\n".join([f"{head},keep_out_m", *rows]), tmp_path)
    keep_outs = {each.name: each.keep_out_m for each in drawn.obstacles}
    assert keep_outs == {"left": pytest.approx(2.63), "right": pytest.approx(1.13)}


def test_the_plane_stands_across_the_conductors_at_the_first_target(tmp_path):
    drawn = site(LINE, tmp_path)
    assert drawn.frame.azimuth_deg == pytest.approx(90.0, abs=0.01)
    assert drawn.targets[0].position_m == (0.0, 12.0)
    assert [each.position_m[0] for each in drawn.obstacles] == pytest.approx(
        [-12.0, -4.0], abs=0.02
    )
    assert drawn.landing_m[Mission.EXIT][0] == pytest.approx((17.0, 2.5), abs=0.02)


def test_between_two_points_the_keep_out_holds_the_sag(tmp_path):
    wire = site(LINE, tmp_path).obstacles[0]
    true_z = 12.0
    assert wire.position_m[1] == pytest.approx(12.625, abs=0.01)
    assert wire.position_m[1] - wire.keep_out_m < true_z


def test_a_site_drawn_on_a_map_is_planned_on(tmp_path):
    planner = Planner(site(LINE, tmp_path), Vehicle.load(default_vehicle()))
    assert planner.plan(mission=Mission.INSPECTION).reason == ""


def test_a_tower_is_a_box_up_to_its_height_where_it_stands_in_the_plane(tmp_path):
    near = site(LINE + row("tower", "t", 0, 3, 20, 2), tmp_path)
    assert max(z for _, z in near.obstacles[-1].vertices_m) == pytest.approx(20.0, abs=0.01)
    far = site(LINE + row("tower", "t", 0, 30, 20, 2), tmp_path)
    assert len(far.obstacles) == 2


def test_left_out_objects_are_reported_with_their_distance_from_the_plane():
    text = LINE + row("tower", "T2", 3, 34, 20, 2) + row("target", "clamp", 8, -9, 12)
    drawn = site_of_features(features_of(text, "map", ".csv"), "map", SiteOptions())
    reported = "tower T2, 34 m from the plane", "target clamp, 9 m from the plane"
    assert drawn.left_out == reported
    assert list(drawn.document["targets"]) == ["splice"]
    tower = next(each for each in drawn.marks if each.name == "T2")
    # x = 0 at the target, 8 m east; along the line to the right of x, which is to the south.
    assert tower.points_m[0] == pytest.approx((-34.0, -5.0, 20.0), abs=0.01)


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ("kind,name\n", "has no column latitude_deg, longitude_deg, altitude_amsl_m"),
        (HEADER + row("wire", "a", 0, 0, 0), "kind is 'wire', must be one of conductor"),
        (HEADER + "target,a,north,7,1,\n", "line 2, latitude_deg: is 'north', must be a finite"),
        (HEADER + "target,a,97,7,1,\n", "line 2, latitude_deg: is 97, must be within ±90"),
        (HEADER + "target,a,45\n", "line 2, longitude_deg: is None"),
        (HEADER + row("target", "", 0, 0, 0), "target: has no name"),
        (HEADER + row("target", "a", 0, 0, 0), "has no conductor"),
        (HEADER + row("conductor", "a", 0, 0, 9) + row("conductor", "a", 0, 9, 9), "has no target"),
        (LINE + row("conductor", "one", 3, 3, 9), "one: has one point, must have two or more"),
        (
            LINE + row("conductor", "far", 3, 8, 9) + row("conductor", "far", 3, 20, 9),
            "far: has points at one side of the plane only",
        ),
        (
            LINE + row("conductor", "long", 3, -60, 9) + row("conductor", "long", 3, 60, 9),
            "long: has 120 m between its points at both sides of the plane, must be at most 60 m",
        ),
        (LINE + row("start", "b", 8, 9, 12), "b: is 9.0 m beside the plane through splice"),
        (LINE + row("tower", "t", 0, 3, 20), "t: has no radius_m"),
        (LINE + row("tower", "t", 0, 3, 20, -2), "line 11, radius_m: is -2, must be 0 or more"),
    ],
)
def test_an_unusable_feature_is_named(text, reported):
    assert reported in refused(text)


@pytest.mark.parametrize(
    ("text", "ending", "reported"),
    [
        ("{", ".geojson", "is no JSON"),
        ("[]", ".geojson", "must be a GeoJSON FeatureCollection"),
        ('{"features": [{"geometry": {"type": "Polygon"}}]}', ".geojson", "is a Polygon, must be"),
        (
            '{"features": [{"geometry": {"type": "Point", "coordinates": [1, 2]}}]}',
            ".geojson",
            "must have longitude, latitude and height",
        ),
        ('{"features": [{"properties": [1], "geometry": "x"}]}', ".geojson", "is a None, must be"),
        (
            '{"features": [{"geometry": {"type": "LineString", "coordinates": 5}}]}',
            ".geojson",
            "features[0]: has no list of coordinates",
        ),
        ("<kml>", ".kml", "is no KML"),
        (
            "<kml><Placemark><name>target a</name></Placemark></kml>",
            ".kml",
            "a: altitudeMode is clampToGround",
        ),
        (
            f"<kml><Placemark><name>target a</name>{ABSOLUTE}</Placemark></kml>",
            ".kml",
            "a: has no points",
        ),
        (
            f"{KML}<Placemark><name>target a</name><Point>{PLACE}</Point></Placemark></kml>",
            ".kml",
            "a: altitudeMode is clampToGround, must be absolute",
        ),
    ],
)
def test_files_of_another_format_are_reported(text, ending, reported):
    assert reported in refused(text, ending)


def test_a_mission_of_qgroundcontrol_has_the_corners_and_waits_at_the_target(tmp_path):
    drawn = site(LINE, tmp_path)
    vehicle = Vehicle.load(default_vehicle())
    plan = Planner(drawn, vehicle).plan(mission=Mission.INSPECTION)
    document = json.loads(qgc_plan_of(drawn, [plan], None))
    everything = document["mission"]["items"]
    assert document["fileType"] == "Plan"
    assert [each["doJumpId"] for each in everything] == list(range(1, len(everything) + 1))
    speeds = [each["params"][1] for each in everything if each["command"] == 178]
    planned = plan.to_dict()["waypoints"]
    fastest = max(each["speed_mps"] for each in planned)
    assert all(0.0 < speed <= fastest + 0.01 for speed in speeds)
    items = [each for each in everything if each["command"] != 178]
    assert [each["command"] for each in items] == [22] + [16] * (len(items) - 1)
    assert items[-1]["params"][0] == drawn.targets[0].dwell_s
    corners = []
    for each in items:
        latitude, longitude, altitude = each["params"][4:]
        x, y = drawn.frame.place_of(latitude, longitude)
        assert y == pytest.approx(0.0, abs=0.01)
        corners.append((x, altitude - 200.0))
    path = [(each["x_m"], each["z_m"]) for each in plan.to_dict()["waypoints"]]
    assert corners[-1] == pytest.approx(path[-1], abs=0.01)
    assert len(corners) < 0.2 * len(path)
    legs = list(pairwise(corners))
    assert max(min(beside(place, *leg) for leg in legs) for place in path) < 0.02


def beside(place, start, end):
    """Distance of a place from the leg of a path."""
    (x, z), (along, up) = place, (end[0] - start[0], end[1] - start[1])
    share = ((x - start[0]) * along + (z - start[1]) * up) / (along**2 + up**2)
    share = min(max(share, 0.0), 1.0)
    return math.hypot(x - start[0] - share * along, z - start[1] - share * up)


def test_the_plane_is_the_same_whichever_way_the_conductors_are_drawn(tmp_path):
    head, *rows = LINE.splitlines()
    drawn = site(LINE, tmp_path)
    of_left = [text for text in rows if ",left," in text]
    others = [text for text in rows if ",left," not in text]
    assert len(of_left) == 3
    for turned in (rows[::-1], [*of_left[::-1], *others]):
        back = site("\n".join([head, *turned]), tmp_path)
        assert back.frame.azimuth_deg == pytest.approx(drawn.frame.azimuth_deg)
        places = [{each.name: each.position_m for each in it.obstacles} for it in (drawn, back)]
        for name, position_m in places[0].items():
            assert places[1][name] == pytest.approx(position_m, abs=0.01)


def test_a_conductor_with_two_points_at_one_place_is_refused_by_name():
    twice = row("conductor", "twice", 3, 3, 9)
    assert "twice: has two points at one place" in refused(LINE + twice + twice)

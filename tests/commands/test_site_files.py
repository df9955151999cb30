"""`moar-companion site`: clouds of every format, maps, pictures, and what it refuses."""

import json

import numpy as np
import pytest
from matplotlib.image import imread

from moar_companion.commands import cli
from moar_companion.planner.site import Site
from moar_companion.planner.site_frame import SiteFrame
from moar_companion.settings.config import shipped_configs
from moar_companion.types import GeodeticPoint
from tests.one_line import one_line
from tests.perception.scenes import DOUBLE_CIRCUIT, Scene

SHIPPED = shipped_configs() / "sites" / "315kv_double_circuit.yaml"
ORIGIN = "45.4,-71.9,200"


@pytest.fixture(scope="module")
def scene():
    return Scene(1, length_m=120.0).with_wires(DOUBLE_CIRCUIT).with_ground()


@pytest.fixture
def at(scene):
    """The middle of the span, in the scene's metres."""
    x, y, _ = scene.place(60.0, -5.8, 0.0)
    return f"{x:.2f},{y:.2f}"


@pytest.fixture
def cloud(scene, tmp_path):
    """Writes the scene in a format; the file's name."""
    points = scene.cloud

    def write(ending, offset=(0.0, 0.0, 0.0), **options):
        file = tmp_path / f"scan{ending}"
        moved = points + offset
        if ending == ".npz":
            np.savez(file, points=moved)
        elif ending == ".xyz":
            np.savetxt(file, moved, fmt="%.3f")
        elif ending == ".csv":
            np.savetxt(file, moved, fmt="%.3f", delimiter=",", header="x,y,z", comments="")
        elif ending == ".ply":
            plyfile = pytest.importorskip("plyfile")
            kind = [("x", "f8"), ("y", "f8"), ("z", "f8")]
            vertices = np.array(list(map(tuple, moved)), dtype=kind)
            plyfile.PlyData([plyfile.PlyElement.describe(vertices, "vertex")]).write(file)
        elif ending == ".pcd":
            pypcd4 = pytest.importorskip("pypcd4")
            pypcd4.PointCloud.from_xyz_points(moved.astype(np.float32)).save(file)
        else:
            laspy = pytest.importorskip("laspy")
            header = laspy.LasHeader(point_format=6, version="1.4")
            header.scales, header.offsets = np.full(3, 0.001), np.floor(moved.min(axis=0))
            if "crs" in options:
                header.add_crs(options["crs"])
            las = laspy.LasData(header)
            las.x, las.y, las.z = moved.T
            las.write(file)
        return str(file)

    return write


def run(*argv):
    return cli.main(["site", *map(str, argv)])


@pytest.mark.parametrize(
    "ending",
    [
        ".npz",
        ".xyz",
        ".laz",
        *(pytest.param(each, marks=pytest.mark.slow) for each in (".csv", ".ply", ".pcd", ".las")),
    ],
)
def test_every_format_gives_the_same_site(ending, cloud, at, tmp_path, capsys):
    out = tmp_path / "site.yaml"
    assert run("from-cloud", cloud(ending), "--at", at, "--origin", ORIGIN, "--out", out) == 0
    reported = capsys.readouterr().out
    assert "6 conductors cross the plane" in reported
    assert reported.count("circuit-1-phase-") == 3
    assert "the plane: x = 0 at 45.4" in reported
    site = Site.load(out)
    heights = sorted(round(each.position_m[1]) for each in site.obstacles)
    assert heights == [12, 12, 19, 19, 26, 26]
    assert site.frame.origin.altitude_amsl_m == pytest.approx(200.0, abs=0.2)


@pytest.mark.slow
def test_the_coordinate_system_turns_the_plane_to_true_north(cloud, scene, at, tmp_path):
    pyproj = pytest.importorskip("pyproj")
    offset = np.array([228_900.0, 578_400.0, 0.0])
    x, y = (float(each) for each in at.split(","))
    place = f"{x + offset[0]:.2f},{y + offset[1]:.2f}"
    named = cloud(".laz", offset, crs=pyproj.CRS("EPSG:28992"))
    first, second, third = (tmp_path / f"{name}.yaml" for name in "abc")
    assert run("from-cloud", named, "--at", place, "--out", first) == 0
    bare = cloud(".las", offset)
    assert run("from-cloud", bare, "--at", place, "--crs", "EPSG:28992", "--out", second) == 0
    to_map = pyproj.Transformer.from_crs("EPSG:28992", "EPSG:4326")
    latitude, longitude = to_map.transform(x + offset[0], y + offset[1])
    on_map = f"{latitude:.8f},{longitude:.8f}"
    assert run("from-cloud", named, "--at", on_map, "--out", third) == 0
    sites = [Site.load(each) for each in (first, second, third)]
    for site in sites:
        assert site.frame == pytest.approx(sites[0].frame) or site.frame.azimuth_deg == (
            pytest.approx(sites[0].frame.azimuth_deg, abs=0.01)
        )
    # Grid north of the Dutch system is a degree off true north there.
    north = to_map.transform(x + offset[0], y + offset[1] + 100.0)
    east_m = (north[1] - longitude) * 111_320 * np.cos(np.radians(latitude))
    convergence = np.degrees(np.arctan2(east_m, 100.0))
    local = tmp_path / "local.yaml"
    assert run("from-cloud", cloud(".npz"), "--at", at, "--origin", ORIGIN, "--out", local) == 0
    turn = sites[0].frame.azimuth_deg - Site.load(local).frame.azimuth_deg
    assert abs(convergence) > 0.5
    assert turn == pytest.approx(convergence, abs=0.05)


def test_the_file_is_checked_and_planned_on(cloud, at, tmp_path, capsys):
    out = tmp_path / "site.yaml"
    assert run("from-cloud", cloud(".npz"), "--at", at, "--origin", ORIGIN, "--out", out) == 0
    assert cli.main(["check", "--files", "--site", str(out)]) == 0
    assert cli.main(["plan", str(out), "--mission", "inspection"]) == 0
    assert "FILES OK" in capsys.readouterr().out


@pytest.mark.slow
def test_the_picture_shows_wires_ground_and_the_plane(cloud, at, tmp_path):
    out, plot = tmp_path / "site.yaml", tmp_path / "site.png"
    arguments = ("--at", at, "--origin", ORIGIN, "--out", out, "--plot", plot)
    assert run("from-cloud", cloud(".npz"), *arguments) == 0
    picture = imread(plot)[..., :3]
    for colour in ((0x2C, 0x6F, 0xB3), (0xC9, 0xB4, 0x8F), (0xA3, 0x27, 0x1B)):
        near = abs(picture - np.array(colour) / 255.0).max(axis=2) < 0.02
        assert near.sum() > 20


@pytest.mark.slow
def test_a_site_is_shown_and_read_back(tmp_path, capsys):
    names = {"--kml": "s.kml", "--geojson": "s.geojson", "--qgc-plan": "s.plan"}
    files = [str(word) for option, name in names.items() for word in (option, tmp_path / name)]
    assert run("show", SHIPPED, *files) == 0
    reported = capsys.readouterr().out
    assert "inspection splice-outer: " in reported
    assert "exit: " in reported
    assert json.loads((tmp_path / "s.plan").read_text())["mission"]["items"]
    for name in ("s.kml", "s.geojson"):
        out, plot = tmp_path / f"{name}.yaml", tmp_path / f"{name}.png"
        assert run("from-map", tmp_path / name, "--out", out, "--plot", plot) == 0
        assert len(Site.load(out).targets) == 2
        assert imread(plot).size
        assert cli.main(["plan", str(out), "--mission", "exit"]) == 0


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        (("from-cloud", "a.npz"), "--out: is missing"),
        (("from-cloud", "a.npz", "--out", "{out}"), "--at: is missing"),
        (("from-cloud", "a.npz", "--at", "1,2", "--out", "{out}"), "a.npz: is no file"),
        (("from-cloud", "a.obj", "--at", "1,2", "--out", "{out}"), "a.obj: ends in '.obj', must"),
        (("from-cloud", "a", "--at", "1", "--out", "{out}"), "--at: is '1', must be LAT,LON"),
        (("from-map", "a.txt", "--out", "{out}"), "a.txt: must end in one of .kml, .geojson"),
        (("from-map", "a.kml", "--out", "{out}"), "a.kml: no such file"),
        (("show", str(SHIPPED)), "show: writes nothing: give one of --kml, --geojson, --qgc-plan"),
        (("draw", "a"), "site: is 'draw', must be one of from-cloud, from-map, new, show"),
        (("from-map", "a.kml", "--standoff", "-1"), "--standoff: is '-1', must be a number of"),
        (("from-cloud", "a.npz", "--seed", "x"), "--seed: is 'x', must be a whole number"),
        (
            ("from-map", "a.kml", "--out", "{out}", "--plot", "a.gif"),
            "--plot: is 'a.gif', must end",
        ),
    ],
)
def test_an_unusable_survey_is_one_line(arguments, reported, tmp_path, capsys):
    words = [word.format(out=tmp_path / "out.yaml") for word in arguments]
    assert reported in one_line(["site", *words], 2, capsys)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("ending", "content", "reported"),
    [
        (".npz", b"PK", "cannot be read as NPZ: is no zip archive"),
        (".xyz", b"\n", "is empty"),
        (".pcd", b"text\n" * 9, "cannot be read as PCD: "),
        (".xyz", b"1 2\n3 4\n", "cannot be read as x y z per line"),
        (".xyz", b"\xff\xfe\x00", "cannot be read as x y z per line"),
        (".las", b"LASF", "cannot be read as LAS"),
        (".ply", b"ply\nformat", "cannot be read as PLY"),
        (".pcd", b"# .PCD", "cannot be read as PCD"),
        (".xyz", b"1 2 3\n", "has 1 points, must have 100 or more"),
    ],
)
def test_a_damaged_cloud_is_one_line(ending, content, reported, tmp_path, capsys):
    file = tmp_path / f"cloud{ending}"
    file.write_bytes(content)
    arguments = ["--at", "0,0", "--origin", ORIGIN, "--out", tmp_path / "out.yaml"]
    assert reported in one_line(["site", "from-cloud", file, *arguments], 2, capsys)
    assert not (tmp_path / "out.yaml").exists()


@pytest.mark.slow
def test_latitude_and_longitude_near_the_origin_are_no_metres(scene, cloud, tmp_path):
    # With 20 % of its size around it the cloud's metres reach over 6, 10.
    origin, sites = (6.0, 10.0, 200.0), []
    frame = SiteFrame(origin=GeodeticPoint(
        latitude_deg=6.0, longitude_deg=10.0, altitude_amsl_m=200.0), azimuth_deg=90.0)  # fmt: skip
    x, y, _ = scene.place(60.0, -5.8, 0.0)
    there = frame.to_geodetic((x, y, 0.0))
    for at in (f"{x},{y}", f"{x},{y},0", f"{there.latitude_deg:.9f},{there.longitude_deg:.9f}"):
        out = tmp_path / f"{len(sites)}.yaml"
        arguments = ("--at", at, "--origin", ",".join(map(str, origin)), "--out", out)
        assert run("from-cloud", cloud(".npz"), *arguments) == 0
        sites.append(Site.load(out).frame.origin)
    for each in sites[1:]:
        assert each.latitude_deg == pytest.approx(sites[0].latitude_deg, abs=1e-7)
        assert each.longitude_deg == pytest.approx(sites[0].longitude_deg, abs=1e-7)


@pytest.mark.parametrize(
    ("option", "value", "reported"),
    [
        ("--origin", "95,6,0", "--origin: 95,6,0: is no latitude and longitude"),
        ("--crs", "EPSG:4978", "is 'EPSG:4978' (WGS 84), neither projected nor geographic"),
        ("--crs", "EPSG:5709", "is 'EPSG:5709' (NAP height), neither projected nor geographic"),
    ],
)
def test_a_place_of_no_map_is_one_line(option, value, reported, cloud, at, tmp_path, capsys):
    pytest.importorskip("pyproj")
    out = tmp_path / "out.yaml"
    arguments = ["--at", at, option, value, "--out", out]
    assert reported in one_line(["site", "from-cloud", cloud(".npz"), *arguments], 2, capsys)
    assert not out.exists()


@pytest.mark.parametrize(
    ("system", "easting", "northing", "inside"),
    [
        ("EPSG:25831", 229_000.0, 578_400.0, False),  # a place of the Dutch grid
        ("EPSG:32631", -400_000.0, 5_800_000.0, False),
        ("EPSG:28992", 700_000.0, 5_800_000.0, False),  # a place of UTM
        ("EPSG:32631", 780_000.0, 5_890_000.0, True),  # 1.2 degrees beside its zone
        ("EPSG:32660", 840_000.0, 1_000_000.0, True),  # beyond 180 degrees
    ],
)
def test_points_outside_of_the_area_of_their_coordinate_system_are_one_line(
    system, easting, northing, inside, cloud, scene, tmp_path, capsys
):
    pyproj = pytest.importorskip("pyproj")
    x, y, _ = scene.place(60.0, -5.8, 0.0)
    file = cloud(".las", (easting, northing, 0.0), crs=pyproj.CRS(system))
    out = tmp_path / "out.yaml"
    arguments = ["from-cloud", file, "--at", f"{x + easting},{y + northing}", "--out", out]
    if inside:
        assert run(*arguments) == 0
        return
    reported = one_line(["site", *arguments], 2, capsys)
    assert "outside of the area of " in reported
    assert "is --crs right?" in reported
    assert not out.exists()


@pytest.mark.parametrize(("system", "reported"), [("EPSG:4979", 1), ("EPSG:4326+5773", 0)])
def test_heights_above_the_ellipsoid_are_reported(system, reported, scene, tmp_path, capsys):
    pyproj = pytest.importorskip("pyproj")
    file, out = tmp_path / "cloud.npz", tmp_path / "out.yaml"
    to_map = pyproj.Transformer.from_crs("EPSG:32618", "EPSG:4326", always_xy=True)
    x, y, z = (scene.cloud + np.array([500_000.0, 5_000_000.0, 0.0])).T
    np.savez(file, points=np.column_stack((*to_map.transform(x, y), z)))
    x, y, _ = scene.place(60.0, -5.8, 0.0)
    longitude, latitude = to_map.transform(x + 500_000.0, y + 5_000_000.0)
    at = ("--at", f"{latitude:.8f},{longitude:.8f}", "--crs", system, "--out", out)
    assert run("from-cloud", file, *at) == 0
    assert capsys.readouterr().out.count("above the ellipsoid") == reported
    assert out.read_text().count("above the ellipsoid") == reported


def test_a_site_whose_landing_place_is_covered_is_shown_without_that_path(tmp_path, capsys):
    drawn, out, shown = (tmp_path / name for name in ("drawn.csv", "site.yaml", "site.kml"))
    rows = [f"conductor,a,{45 + north * 1e-5},7,20," for north in (-9, 9)]
    rows += ["target,b,45,7.0002,20,", "ground,c,45,7,0,"]
    rows += ["exit,d,45,7.0004,3,", "tower,e,45,7.0004,30,2"]
    header = "kind,name,latitude_deg,longitude_deg,altitude_amsl_m,radius_m"
    drawn.write_text("\n".join([header, *rows]))
    assert run("from-map", drawn, "--out", out) == 0
    assert run("show", out, "--kml", shown) == 0
    assert "no path: drawn: landing.exit: no free" in capsys.readouterr().out
    assert "inspection b" in shown.read_text()


@pytest.mark.slow
def test_a_map_gives_a_picture_of_its_survey_and_reports_the_parts_left_out(tmp_path, capsys):
    drawn, out, plot = (tmp_path / name for name in ("drawn.csv", "site.yaml", "site.png"))
    rows = [f"conductor,a,{45 + north * 1e-5},7,20," for north in (-9, 9)]
    rows += ["target,b,45,7.0002,20,", "ground,c,45,7,0,", "tower,T2,45.0003,7,30,2"]
    header = "kind,name,latitude_deg,longitude_deg,altitude_amsl_m,radius_m"
    drawn.write_text("\n".join([header, *rows]))
    assert run("from-map", drawn, "--out", out, "--plot", plot) == 0
    reported = capsys.readouterr().out.splitlines()
    assert reported[0] == "1 obstacle, 1 target"
    assert reported[2] == "left out: tower T2, 33 m from the plane"
    assert len(reported) == 4
    red = abs(imread(plot)[..., :3] - np.array((0xA3, 0x27, 0x1B)) / 255.0).max(axis=2) < 0.02
    plan_view = red[: len(red) // 3]
    assert plan_view.sum() > 20


def test_a_site_that_other_commands_refuse_is_reported(tmp_path, capsys):
    drawn, out = tmp_path / "drawn.csv", tmp_path / "site.yaml"
    rows = [f"conductor,a,{45 + north * 1e-5},7,20" for north in (-9, 9)]
    rows += ["outline,a,45,7,10", "outline,a,45,7.0001,10", "outline,a,45,7.0001,15"]
    header = "kind,name,latitude_deg,longitude_deg,altitude_amsl_m"
    drawn.write_text("\n".join([header, *rows, "target,b,45,7.0002,20"]))
    assert run("from-map", drawn, "--out", out) == 2
    assert "is 'a' like obstacles[0], must be unique" in capsys.readouterr().err


def test_a_cloud_without_a_place_needs_one(cloud, at, tmp_path, capsys):
    file, out = cloud(".npz"), tmp_path / "out.yaml"
    reported = one_line(["site", "from-cloud", file, "--at", at, "--out", out], 2, capsys)
    assert "names no coordinate system: needs --crs EPSG:…, or --origin" in reported
    arguments = ["--at", "900,900", "--origin", ORIGIN, "--out", out]
    reported = one_line(["site", "from-cloud", file, *arguments], 2, capsys)
    assert "m from the nearest point; the file has x" in reported
    arguments = ["--at", at, "--crs", "EPSG:nowhere", "--out", out]
    reported = one_line(["site", "from-cloud", file, *arguments], 2, capsys)
    assert reported == "--crs: is 'EPSG:nowhere', must be a coordinate system such as EPSG:28992"
    arguments = ["--at", at, "--origin", ORIGIN, "--out", file]
    assert "the file of the input too" in one_line(
        ["site", "from-cloud", file, *arguments], 2, capsys
    )


def test_a_site_is_shifted_with_its_record_and_shown_with_it(tmp_path, capsys):
    out, again = tmp_path / "moved.yaml", tmp_path / "again.yaml"
    words = ("--north", "0.4", "--east", "-0.1", "--reason", "base moved", "--date", "2026-05-31")
    assert run("shift", SHIPPED, *words, "--out", out) == 0
    written = capsys.readouterr().out
    assert written.startswith("frame moved 0.4 m N, 0.1 m W on 2026-05-31: base moved\nx = 0 at ")
    assert f"wrote {out}; next: moar-companion check --files --site {out}\n" in written
    assert run("shift", out, "--up", "1", "--reason", "datum", "--out", again) == 0
    first, second = Site.load(again).shifts
    assert (first.reason, second.reason, second.up_m) == ("base moved", "datum", 1.0)
    assert len(second.date) == len("2026-05-31")  # today
    assert cli.main(["check", "--files", "--site", str(again)]) == 0
    assert "frame: moved 0.4 m N, 0.1 m W on 2026-05-31: base moved" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        (("--north", "1", "--reason", "x"), "--out: is missing"),
        (("--north", "1", "--out", "{out}"), "--reason: is missing: why the site is moved"),
        (("--reason", "x", "--out", "{out}"), "shift: moves nothing: give --north, --east or --up"),
        (("--up", "101"), "--up: is '101', must be a number of metres from -100 to 100"),
        (("--north", "nan"), "--north: is 'nan', must be a number of metres"),
        (("--reason", "a\nb"), "must be 1 to 100 printable characters"),
        (("--date", "2026-02-30"), "--date: is '2026-02-30', must be a day, as 2026-05-31"),
    ],
)
def test_a_shift_without_sense_is_one_line(arguments, reported, tmp_path, capsys):
    words = [word.format(out=tmp_path / "out.yaml") for word in arguments]
    assert reported in one_line(["site", "shift", SHIPPED, *words], 2, capsys)
    assert list(tmp_path.iterdir()) == []


def test_a_site_is_not_shifted_in_place(tmp_path, capsys):
    site = tmp_path / "site.yaml"
    site.write_bytes(SHIPPED.read_bytes())
    words = ("site", "shift", site, "--up", "1", "--reason", "x", "--out", site)
    assert "the file of the input too, must be another" in one_line(words, 2, capsys)

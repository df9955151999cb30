"""`moar-companion site new` as a user runs it: typical lines, questions, a place marked by PX4."""

from __future__ import annotations

import math

import pytest

from moar_companion.commands import cli, site_new
from moar_companion.mavlink.telemetry import Gnss
from moar_companion.perception.survey.site_document import SiteOptions
from moar_companion.perception.survey.typical_lines import (
    TYPICAL_LINES,
    frame_through,
    typical_site,
)
from moar_companion.planner.site import Conductor, Site
from moar_companion.planner.site_frame import SiteFrame
from moar_companion.settings.config import shipped_configs
from moar_companion.types import GeodeticPoint, Mission
from tests.one_line import one_line
from tests.processes import simulator

AT = GeodeticPoint(latitude_deg=45.3781, longitude_deg=-71.9295, altitude_amsl_m=210.0)
ANSWERS = ("--line", "120kv-single", "--height", "9", "--along", "200", "--at", "45.3,-71.9,210")


def new(*arguments):
    return cli.main(["site", "new", *map(str, arguments)])


@pytest.mark.parametrize("name", TYPICAL_LINES)
def test_a_typical_line_hangs_at_the_height_that_was_measured(name, tmp_path, capsys):
    out = tmp_path / "site.yaml"
    where = ("--along", "30", "--at", "45.3781,-71.9295,210")
    assert new("--yes", "--line", name, "--height", "12.5", *where, "--out", out) == 0
    site = Site.load(out)
    wires = [each for each in site.obstacles if isinstance(each, Conductor)]
    assert min(each.position_m[1] for each in wires) == pytest.approx(12.5)
    assert len(wires) == len(TYPICAL_LINES[name].conductors_m | TYPICAL_LINES[name].earth_wires_m)
    assert site.frame.azimuth_deg == 120.0
    assert len(site.targets) == 2
    assert set(site.landing_m) == {Mission.EXIT, Mission.EVACUATION}
    shown = capsys.readouterr().out
    assert TYPICAL_LINES[name].source in shown
    assert TYPICAL_LINES[name].source in out.read_text()


@pytest.mark.parametrize(
    ("name", "shipped"),
    [("120kv-single", "120kv_single_circuit"), ("315kv-double", "315kv_double_circuit")],
)
def test_the_spacings_are_those_of_the_shipped_sites(name, shipped):
    site = Site.load(shipped_configs() / "sites" / f"{shipped}.yaml")
    wires = [each for each in site.obstacles if isinstance(each, Conductor)]
    lowest_m = min(each.position_m[1] for each in wires)
    expected = sorted((x - 15.0, z - lowest_m) for x, z in (each.position_m for each in wires))
    line = TYPICAL_LINES[name]
    made = sorted((line.conductors_m | line.earth_wires_m).values())
    assert [pair for made_m, shipped_m in zip(made, expected, strict=True)
            for pair in (*made_m, *shipped_m)] == pytest.approx(
        [pair for shipped_m in expected for pair in (*shipped_m, *shipped_m)], abs=1e-6
    )  # fmt: skip


@pytest.mark.parametrize(
    ("along_deg", "east_m", "north_m"), [(0, 10, 0), (90, 0, -10), (180, -10, 0)]
)
def test_x_grows_to_the_right_of_who_looks_along_the_line(along_deg, east_m, north_m):
    right = frame_through((0.0, 0.0), AT, along_deg).to_geodetic((10.0, 0.0, 0.0))
    to_the_east = SiteFrame(origin=AT, azimuth_deg=90.0)
    found = to_the_east.place_of(right.latitude_deg, right.longitude_deg)
    assert found == pytest.approx((east_m, north_m), abs=1e-3)


def test_the_marked_point_of_the_plane_is_where_it_was_marked():
    frame = frame_through((7.0, 12.0), AT, 200.0)
    assert frame.azimuth_deg == pytest.approx(290.0)
    point = frame.to_geodetic((7.0, 0.0, 12.0))
    assert point.altitude_amsl_m == pytest.approx(AT.altitude_amsl_m)
    x_m, y_m = frame.place_of(AT.latitude_deg, AT.longitude_deg)
    assert (x_m, y_m) == pytest.approx((7.0, 0.0), abs=1e-3)
    document = typical_site(TYPICAL_LINES["horizontal"], frame, 10.0, SiteOptions())
    assert document["frame"]["origin"]["altitude_amsl_m"] == pytest.approx(198.0)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (ANSWERS[2:], ["--line", "is missing", "120kv-single"]),
        ((*ANSWERS[:2], *ANSWERS[4:]), ["--height", "is missing"]),
        (ANSWERS[:6], ["--at", "is missing"]),
        ((*ANSWERS[:6], "--at", "95,0,0"), ["--at", "LAT,LON,ALT"]),
        ((*ANSWERS[:6], "--at", "45,-71"), ["--at", "LAT,LON,ALT"]),
        ((*ANSWERS[:6], "--mark", "0,0"), ["--connect", "is missing"]),
        (("--line", "66kv"), ["--line", "'66kv'", "315kv-double"]),
        (("--height", "1"), ["--height", "'1'", "3 to 100"]),
        (("--along", "400"), ["--along", "'400'", "0 to 360"]),
        (("cloud.las", *ANSWERS), ["new", "'cloud.las'"]),
    ],
)
def test_a_wrong_or_missing_answer_is_one_line(arguments, words, tmp_path, capsys):
    out = tmp_path / "site.yaml"
    line = one_line(["site", "new", "--yes", *arguments, "--out", out], 2, capsys)
    assert [word for word in words if word not in line] == []
    assert not out.exists()


def test_the_other_actions_need_their_file(capsys):
    assert "FILE: is missing: the file of from-map" in one_line(["site", "from-map"], 2, capsys)


def test_a_fix_that_is_no_longer_reported_is_unknown():
    assert site_new._fix_type(None, 10.0) is None
    gnss = Gnss(
        received_s=10.0,
        receiver_s=None,
        fix_type=6,
        satellites=None,
        hdop=None,
        vdop=None,
        horizontal_accuracy_m=None,
        vertical_accuracy_m=None,
    )
    assert site_new._fix_type(gnss, 11.0) == 6
    assert site_new._fix_type(gnss, 13.0) is None


@pytest.mark.slow
@pytest.mark.real_time
def test_the_place_of_an_aircraft_is_marked_with_its_spread(tmp_path, capsys, unused_udp_port):
    out, link = tmp_path / "site.yaml", f"udp:127.0.0.1:{unused_udp_port}"
    mark = ("--yes", *ANSWERS[:6], "--mark", "2,0", "--connect", link, "--out", out)
    home = f"{AT.latitude_deg},{AT.longitude_deg},{AT.altitude_amsl_m},0"
    with simulator("--link", f"companion=udpout:127.0.0.1:{unused_udp_port}", "--home", home):
        assert new(*mark, "--any-fix") == 0
        text = capsys.readouterr().out
    site = Site.load(out)
    x_m, y_m = site.frame.place_of(AT.latitude_deg, AT.longitude_deg)
    assert math.hypot(x_m - 2.0, y_m) < 1.0
    assert "spread of the 5 means" in text
    assert "marked at 45.37" in out.read_text()

"""The site file: the contract's example, what may not be in it, and the shipped sites."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import shapely
import yaml
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from moar_companion.errors import InputError
from moar_companion.planner.site import (
    MAX_VERTICES,
    Conductor,
    Polygon,
    Site,
    Target,
    TargetView,
    Workspace,
    outline_problem,
)
from moar_companion.planner.site_frame import SiteFrame
from moar_companion.settings.config import shipped_configs
from moar_companion.types import GeodeticPoint, Mission

EXAMPLE = """\
name: 315 kV double circuit, span 12
frame:                                  # where the plane stands in the world
  origin: {latitude_deg: 45.3781, longitude_deg: -71.9295, altitude_amsl_m: 210.0}   # x = 0, z = 0
  azimuth_deg: 90                       # compass direction of +x
workspace: {x_m: [0, 30], z_m: [0, 20], resolution_m: 0.3, min_altitude_m: 2.0}
obstacles:
  - {conductor: {name: left-lower, x_m: 9.0, z_m: 8.0, radius_m: 0.03}}
  - {polygon: {name: tower leg, vertices_m: [[14, 0], [16, 0], [15.5, 19], [14.5, 19]]}}
start: {x_m: 27.0, z_m: 2.5}            # default of --start
targets:                                # visited in this order when none is named
  splice-1: {x_m: 9.0, z_m: 14.0}
landing:
  exit: [{x_m: 40.0, z_m: 0.0}]
  evacuation: [{x_m: -8.0, z_m: 0.0}, {x_m: 40.0, z_m: 0.0}]
"""
"""The example of the contract."""

SITES = sorted((shipped_configs() / "sites").glob("*.yaml"))


def load(text: str, folder: Path) -> Site:
    path = folder / "site.yaml"
    path.write_text(text)
    return Site.load(path)


def refusal(text: str, folder: Path) -> str:
    with pytest.raises(InputError) as raised:
        load(text, folder)
    line = str(raised.value)
    assert line.isprintable()
    return line.removeprefix(f"{folder / 'site.yaml'}: ")


def changed(old: str, new: str) -> str:
    assert EXAMPLE.count(old) == 1
    return EXAMPLE.replace(old, new)


def test_the_example_of_the_contract(tmp_path: Path) -> None:
    assert load(EXAMPLE, tmp_path) == Site(
        name="315 kV double circuit, span 12",
        frame=SiteFrame(
            origin=GeodeticPoint(
                latitude_deg=45.3781, longitude_deg=-71.9295, altitude_amsl_m=210.0
            ),
            azimuth_deg=90.0,
        ),
        workspace=Workspace(
            lower_m=(0.0, 0.0), upper_m=(30.0, 20.0), resolution_m=0.3, min_altitude_m=2.0
        ),
        obstacles=(
            Conductor(name="left-lower", position_m=(9.0, 8.0), radius_m=0.03),
            Polygon(
                name="tower leg",
                vertices_m=((14.0, 0.0), (16.0, 0.0), (15.5, 19.0), (14.5, 19.0)),
            ),
        ),
        start_m=(27.0, 2.5),
        targets=(Target(name="splice-1", position_m=(9.0, 14.0), dwell_s=5.0),),
        landing_m={
            Mission.EXIT: ((40.0, 0.0),),
            Mission.EVACUATION: ((-8.0, 0.0), (40.0, 0.0)),
        },
    )


def test_a_site_without_obstacles_targets_or_landing_points(tmp_path: Path) -> None:
    content = yaml.safe_load(EXAMPLE)
    content["obstacles"] = []
    for empty in ({"targets": {}, "landing": {}}, {"landing": {"exit": []}}, {}):
        smaller = {key: content[key] for key in content if key not in ("targets", "landing")}
        site = load(yaml.safe_dump(smaller | empty), tmp_path)
        assert site.obstacles == ()
        assert site.targets == ()
        assert site.landing_m == {}


def test_a_target_outside_the_workspace_is_no_error_of_the_file(tmp_path: Path) -> None:
    site = load(changed("{x_m: 9.0, z_m: 14.0}", "{x_m: 90.0, z_m: -14.0}"), tmp_path)
    assert site.targets[0].position_m == (90.0, -14.0)


@pytest.mark.parametrize(
    ("side", "position_m"),
    [
        ("left", (6.97, 8.0)),
        ("right", (11.03, 8.0)),
        ("above", (9.0, 10.03)),
        ("below", (9.0, 5.97)),
    ],
)
def test_a_target_beside_a_conductor_looks_at_it(
    side: str, position_m: tuple[float, float], tmp_path: Path
) -> None:
    written = f"{{conductor: left-lower, standoff_m: 2, side: {side}, dwell_s: 0, yaw_deg: -90}}"
    target = load(changed("{x_m: 9.0, z_m: 14.0}", written), tmp_path).targets[0]
    assert target.position_m == pytest.approx(position_m)
    assert target.look_at_m == (9.0, 8.0)
    assert target.dwell_s == 0.0
    assert target.yaw_deg == -90.0


def test_targets_keep_the_order_of_the_file(tmp_path: Path) -> None:
    more = "targets:\n  zulu: {x_m: 1, z_m: 2}\n  alpha: {x_m: 3, z_m: 4}\n"
    site = load(EXAMPLE.replace("targets: ", more + "#"), tmp_path)
    assert [target.name for target in site.targets] == ["zulu", "alpha", "splice-1"]


@pytest.mark.parametrize(
    ("written", "problem"),
    [
        ("{x_m: 9.0}", "targets.splice-1.z_m: is missing"),
        ("{standoff_m: 2, side: left}", "targets.splice-1.conductor: is missing"),
        (
            "{dwell_s: 1}",
            "targets.splice-1: must have x_m and z_m, or conductor, standoff_m and side",
        ),
        (
            "{x_m: 9, z_m: 2, side: left}",
            (
                "targets.splice-1: has x_m and z_m and side, must have x_m and z_m, or conductor, "
                "standoff_m and side"
            ),
        ),
        (
            "{conductor: left-lowr, standoff_m: 2, side: left}",
            (
                "targets.splice-1.conductor: is 'left-lowr', no conductor of this site, "
                "did you mean left-lower?"
            ),
        ),
        (
            "{conductor: tower leg, standoff_m: 2, side: left}",
            (
                "targets.splice-1.conductor: is 'tower leg', no conductor of this site, "
                "must be one of left-lower"
            ),
        ),
        (
            "{conductor: left-lower, standoff_m: 0, side: left}",
            "targets.splice-1.standoff_m: is 0, must be greater than 0",
        ),
        (
            "{conductor: left-lower, standoff_m: 2, side: under}",
            "targets.splice-1.side: is 'under', must be 'left', 'right', 'above' or 'below'",
        ),
        (
            "{x_m: 9, z_m: 2, dwell_s: -1}",
            "targets.splice-1.dwell_s: is -1, must be at least 0",
        ),
    ],
)
def test_a_target_is_coordinates_or_beside_a_conductor(
    written: str, problem: str, tmp_path: Path
) -> None:
    assert refusal(changed("{x_m: 9.0, z_m: 14.0}", written), tmp_path) == problem


VIEWED = "{conductor: left-lower, yaw_deg: 90, views: [%s]}"


def test_views_are_places_of_their_target(tmp_path: Path) -> None:
    views = (
        "{standoff_m: 2, side: left, pictures: 3}, "
        "{standoff_m: 1, side: above, video_s: 8, aim: {x_m: 9.5, z_m: 8}}, "
        "{x_m: 4, z_m: 9, zoom_percent: 40}"
    )
    site = load(changed("{x_m: 9.0, z_m: 14.0}", VIEWED % views), tmp_path)
    first, second, third = site.targets
    assert site.target_names == ("splice-1",)
    assert site.stops_of("splice-1") == ("splice-1/1", "splice-1/2", "splice-1/3")
    assert first.position_m == pytest.approx((6.97, 8.0))
    assert second.position_m == pytest.approx((9.0, 9.03))
    assert third.position_m == (4.0, 9.0)
    assert [place.look_at_m for place in site.targets] == [(9.0, 8.0), (9.5, 8.0), (9.0, 8.0)]
    assert [place.dwell_s for place in site.targets] == [0.0] * 3
    assert [place.yaw_deg for place in site.targets] == [90.0] * 3
    view = TargetView(target="splice-1", number=1, aim_m=(9.0, 8.0), pictures=3, video_s=0.0)
    assert first.view == view
    assert (second.view.pictures, second.view.video_s) == (0, 8.0)
    assert (third.view.pictures, third.view.zoom_percent) == (1, 40.0)
    assert second.hold_s > 8.0


def test_views_beside_a_point_aim_at_it(tmp_path: Path) -> None:
    views = "{standoff_m: 2, side: right}, {conductor: left-lower, standoff_m: 3, side: below}"
    written = f"{{x_m: 12, z_m: 14, dwell_s: 30, views: [{views}]}}"
    site = load(changed("{x_m: 9.0, z_m: 14.0}", written), tmp_path)
    assert site.targets[0].position_m == (14.0, 14.0)
    assert site.targets[1].position_m == pytest.approx((9.0, 4.97))
    assert [place.look_at_m for place in site.targets] == [(12.0, 14.0), (9.0, 8.0)]
    assert [place.hold_s for place in site.targets] == [30.0, 30.0]


def test_a_place_is_found_by_its_own_name_and_the_first_by_its_targets(tmp_path: Path) -> None:
    views = "{standoff_m: 2, side: left}, {standoff_m: 2, side: above}"
    site = load(changed("{x_m: 9.0, z_m: 14.0}", VIEWED % views), tmp_path)
    assert site.target("splice-1/2") is site.targets[1]
    assert site.target("splice-1") is site.target(None) is site.targets[0]
    with pytest.raises(InputError, match="no target 'splice-1/3'; the site has: splice-1/1, "):
        site.target("splice-1/3")


@pytest.mark.parametrize(
    ("written", "problem"),
    [
        ("{views: [{x_m: 1, z_m: 2}]}", ": must have conductor, or x_m and z_m"),
        (
            "{conductor: left-lower, side: left, views: [{x_m: 1, z_m: 2}]}",
            ".side: is given beside views, must be a key of each view",
        ),
        (VIEWED % "{}", ".views[0]: must have x_m and z_m, or standoff_m and side"),
        (VIEWED % "{side: left}", ".views[0].standoff_m: is missing"),
        (
            VIEWED % "{x_m: 1, z_m: 2, conductor: left-lower}",
            ".views[0].conductor: is given beside x_m and z_m, use aim instead",
        ),
        (
            VIEWED % "{conductor: lost, standoff_m: 1, side: left}",
            ".views[0].conductor: is 'lost', no conductor of this site, must be one of left-lower",
        ),
        (
            VIEWED % "{x_m: 1, z_m: 2, aim: {x_m: 1, z_m: 2}}",
            ".views[0].aim: is the view's own place, must be another point",
        ),
        (
            VIEWED % "{x_m: 1, z_m: 2, pictures: 0}",
            ".views[0].pictures: is 0, must be at least 1 without video_s",
        ),
        (VIEWED % "", ".views: has a length of 0, must be at least 1"),
    ],
)
def test_wrong_views_are_refused(written: str, problem: str, tmp_path: Path) -> None:
    text = changed("{x_m: 9.0, z_m: 14.0}", written)
    assert refusal(text, tmp_path) == f"targets.splice-1{problem}"


def test_no_target_has_the_name_of_a_view(tmp_path: Path) -> None:
    views = VIEWED % "{x_m: 1, z_m: 2}"
    text = changed("{x_m: 9.0, z_m: 14.0}", f"{views}\n  splice-1/1: {{x_m: 9.0, z_m: 14.0}}")
    assert refusal(text, tmp_path) == "targets['splice-1/1']: is the name of a view of splice-1"


def test_a_target_beside_a_missing_conductor_is_refused(tmp_path: Path) -> None:
    content = yaml.safe_load(EXAMPLE)
    content["obstacles"] = []
    content["targets"]["splice-1"] = {"conductor": "left", "standoff_m": 2.0, "side": "left"}
    assert refusal(yaml.safe_dump(content), tmp_path).endswith("of this site, there are none")


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("z_m: [0, 20]", "z_m: [20, 0]", "workspace.z_m: is [20, 0], the first must be less"),
        ("x_m: [0, 30]", "x_m: [3, 3]", "workspace.x_m: is [3, 3], the first must be less"),
        ("x_m: [0, 30]", "x_m: [0]", "workspace.x_m: has a length of 1, must be at least 2"),
        ("x_m: [0, 30]", "x_m: [0, 1, 2]", "workspace.x_m: has a length of 3, must be at most 2"),
        ("resolution_m: 0.3", "resolution_m: 0", "workspace.resolution_m: is 0, must be greater"),
        ("latitude_deg: 45.3781", "latitude_deg: 90.1", "frame.origin.latitude_deg: is 90.1, must"),
        ("-71.9295", "-180.5", "frame.origin.longitude_deg: is -180.5, must be at least -180"),
        ("azimuth_deg: 90", "azimuth_deg: -1", "frame.azimuth_deg: is -1, must be at least 0"),
        ("radius_m: 0.03", "radius_m: 0", "obstacles[0].conductor.radius_m: is 0, must be greater"),
        ("}}\n  - {p", "}, polygon: 3}\n  - {p", "obstacles[0].polygon: is 3, must be a mapping"),
        ("{conductor: {name", "{cable: {name", "obstacles[0].cable: is not a known key, must be"),
        ("radius_m: 0.03", "keep_out_m: -1", "obstacles[0].conductor.keep_out_m: is -1, must be"),
        ("name: tower leg", "name: left-lower", "obstacles[1].polygon.name: is 'left-lower' like"),
    ],
)
def test_an_invalid_site_file_is_refused(old: str, new: str, problem: str, tmp_path: Path) -> None:
    assert refusal(changed(old, new), tmp_path).startswith(problem)


def test_an_obstacle_is_one_thing(tmp_path: Path) -> None:
    content = yaml.safe_load(EXAMPLE)
    content["obstacles"] = [{}]
    problem = "obstacles[0]: must have one key, conductor or polygon"
    assert refusal(yaml.safe_dump(content), tmp_path) == problem
    content = yaml.safe_load(EXAMPLE)
    content["obstacles"] = [content["obstacles"][0] | content["obstacles"][1]]
    assert refusal(yaml.safe_dump(content), tmp_path) == problem


@pytest.mark.parametrize(
    ("extent_m", "resolution_m", "cells"),
    [
        (30.0, 0.3, 100),  # 30 / 0.3 is 100.00000000000001
        (0.9, 0.3, 3),  # 0.9 / 0.3 is 3.0000000000000004 or less
        (2.1, 0.7, 3),  # 2.0999999999999996 / 0.7 is below 3
        (20.0, 0.3, 66),  # the remainder is not workspace
        (0.1, 0.3, 1),
    ],
)
def test_cells_of_an_extent(extent_m: float, resolution_m: float, cells: int) -> None:
    workspace = Workspace(
        lower_m=(-5.0, 0.0), upper_m=(extent_m - 5.0, 1.0), resolution_m=resolution_m
    )
    assert workspace.shape[0] == cells


def test_too_many_cells_are_counted_and_mended(tmp_path: Path) -> None:
    line = refusal(changed("resolution_m: 0.3", "resolution_m: 0.01"), tmp_path)
    assert line == (
        "workspace.resolution_m: is 0.01, which makes 6000000 cells where 4000000 are allowed: "
        "must be at least 0.0123, or the workspace smaller"
    )
    load(changed("resolution_m: 0.3", "resolution_m: 0.0123"), tmp_path)


def test_exactly_as_many_cells_as_allowed(tmp_path: Path) -> None:
    load(changed("x_m: [0, 30], z_m: [0, 20]", "x_m: [0, 600], z_m: [0, 600]"), tmp_path)
    load(changed("x_m: [0, 30], z_m: [0, 20]", "x_m: [0, 1200000], z_m: [0, 0.3]")
         .replace("1200000", "1e6"), tmp_path)  # fmt: skip


@pytest.mark.slow
@settings(max_examples=200, deadline=None)
@given(
    width_m=st.floats(1e-6, 2e6),
    height_m=st.floats(1e-6, 2e6),
    resolution_m=st.floats(min_value=0.0, max_value=1e6, exclude_min=True),
)
def test_the_advised_resolution_is_enough(
    width_m: float, height_m: float, resolution_m: float, tmp_path_factory: pytest.TempPathFactory
) -> None:
    content = yaml.safe_load(EXAMPLE)
    half = width_m / 2.0, height_m / 2.0
    content["workspace"] = {
        "x_m": [-half[0], half[0]],
        "z_m": [-half[1], half[1]],
        "resolution_m": resolution_m,
    }
    folder = tmp_path_factory.getbasetemp()
    try:
        load(yaml.safe_dump(content), folder)
    except InputError as error:
        advised = float(str(error).split("at least ")[1].split(",")[0])
        content["workspace"]["resolution_m"] = advised
        load(yaml.safe_dump(content), folder)


@pytest.mark.parametrize(
    ("vertices_m", "problem"),
    [
        ([(0, 0), (4, 0), (0, 4)], None),
        ([(0, 4), (4, 0), (0, 0)], None),
        ([(0, 0), (2, 0), (4, 0), (0, 4)], None),
        ([(0, 0), (4, 0), (4, 4), (2, 1), (0, 4)], None),
        ([(0, 0), (4, 0), (0, 4), (0, 0)], "the same vertex at [3] and [0]"),
        ([(0, 0), (4, 0), (4, 0), (0, 4)], "the same vertex at [1] and [2]"),
        ([(0, 0), (1, 1), (3, 3)], "encloses no area"),
        ([(1, 1), (1, 1), (1, 1)], "the same vertex at [0] and [1]"),
        ([(0, 0), (4, 4), (4, 0), (0, 4)], "crosses itself (edge [0]-[1] and edge [2]-[3])"),
        ([(0, 0), (4, 0), (4, 4), (2, 0), (0, 4)], "crosses itself (edge [0]-[1] and edge [2]-"),
        ([(0, 0), (4, 0), (4, 4), (4, 2), (0, 4)], "folds back on itself at [2]"),
        ([(0, 0), (4, 0), (4, 4), (0, 0), (-4, 4), (-4, 0)], "crosses itself"),
    ],
)
def test_the_outline_of_a_polygon(
    vertices_m: list[tuple[float, float]], problem: str | None
) -> None:
    for scale, shift in ((1.0, 0.0), (0.01, 700.0)):
        found = outline_problem(np.array(vertices_m, dtype=float) * scale + shift)
        assert (found is None) if problem is None else (found is not None and problem in found)


@settings(max_examples=400, deadline=None)
@given(st.lists(st.tuples(st.integers(0, 4), st.integers(0, 4)), min_size=3, max_size=7))
def test_outlines_agree_with_shapely(vertices: list[tuple[int, int]]) -> None:
    following = [*vertices[1:], vertices[0]]
    assume(all(first != second for first, second in zip(vertices, following, strict=True)))
    polygon = shapely.Polygon(vertices)
    simple = polygon.is_valid and polygon.area > 0.0
    assert (outline_problem(np.array(vertices, dtype=float)) is None) == simple


@pytest.mark.slow
def test_a_large_outline_is_checked_and_a_larger_one_refused(tmp_path: Path) -> None:
    content = yaml.safe_load(EXAMPLE)
    for count in (MAX_VERTICES, MAX_VERTICES + 1):
        angles = [2.0 * math.pi * index / count for index in range(count)]
        vertices = [[round(math.cos(a), 9), round(math.sin(a), 9)] for a in angles]
        content["obstacles"][1]["polygon"]["vertices_m"] = vertices
        if count == MAX_VERTICES:
            load(yaml.safe_dump(content), tmp_path)
    line = refusal(yaml.safe_dump(content), tmp_path)
    assert line == "obstacles[1].polygon.vertices_m: has a length of 2001, must be at most 2000"


@pytest.mark.parametrize("path", SITES, ids=lambda path: path.stem)
def test_a_shipped_site(path: Path) -> None:
    site = Site.load(path)
    workspace = site.workspace
    assert workspace.shape == (100, 66)
    assert workspace.min_altitude_m == 2.0
    assert len(site.targets) == 2
    assert all(target.look_at_m for target in site.targets)
    assert set(site.landing_m) == {Mission.EXIT, Mission.EVACUATION}
    radius_m, d_min_m = 0.6, 1.2
    for point in (site.start_m, *(target.position_m for target in site.targets)):
        assert all(
            low < value < high
            for low, value, high in zip(workspace.lower_m, point, workspace.upper_m, strict=True)
        )
        for obstacle in site.obstacles:
            assert isinstance(obstacle, Conductor)
            assert math.dist(point, obstacle.position_m) > radius_m + d_min_m
    # Exit on the side of the start, evacuation on both sides.
    assert all(x_m > workspace.upper_m[0] for x_m, _ in site.landing_m[Mission.EXIT])
    sides = {x_m > workspace.upper_m[0] for x_m, _ in site.landing_m[Mission.EVACUATION]}
    assert sides == {True, False}


def test_three_sites_are_shipped() -> None:
    assert [path.stem for path in SITES] == [
        "120kv_single_circuit",
        "315kv_double_circuit",
        "horizontal_three_conductors",
    ]


def test_the_315_kv_line_has_the_measured_spacings() -> None:
    site = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
    positions = {
        obstacle.name: obstacle.position_m
        for obstacle in site.obstacles
        if isinstance(obstacle, Conductor)
    }
    for level, half_m in (("lower", 5.83), ("middle", 7.68), ("upper", 5.83)):
        left, right = positions[f"left-{level}"], positions[f"right-{level}"]
        assert right[0] - left[0] == pytest.approx(2.0 * half_m)
        assert right[1] == left[1]
    heights = [positions[f"left-{level}"][1] for level in ("lower", "middle", "upper")]
    assert np.diff(heights) == pytest.approx([7.29, 7.29])

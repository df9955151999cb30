"""The picture of a flight by sight."""

import math
from dataclasses import replace

import pytest
from matplotlib import colormaps
from PIL import Image

from moar_companion.analysis.pictures.perceived_picture import SeenStory, draw_perceived
from moar_companion.planner.site import Polygon, Site
from moar_companion.settings.config import shipped_configs
from tests.vehicles import named_vehicle

SITE = Site.load(shipped_configs() / "sites" / "315kv_double_circuit.yaml")
JIB = Polygon(name="jib", vertices_m=((25.0, 6.0), (26.0, 6.0), (26.0, 7.0), (25.0, 7.0)))


def decision(time_s, kind, **data):
    return {"time_s": 100.0 + time_s, "kind": kind, "data": data}


def status(time_s, x_m, z_m):
    return decision(time_s, "status", position_m=[x_m, 0.1, z_m], risk={})


def seen(time_s, *conductors, solids=()):
    return decision(
        time_s,
        "seen",
        conductors=[{"name": name, "x_m": x, "z_m": z} for name, x, z in conductors],
        solids=[{"name": "seen-solid-1", "vertices_m": list(outline)} for outline in solids],
    )


OUTLINE = ((25.2, 6.0), (25.8, 6.0), (25.8, 6.6))
DECISIONS = [
    decision(0.0, "status", position_m=None),
    status(1.0, 27.0, 2.5),
    status(1.5, 27.0, 2.5),
    seen(2.0, ("seen-1", 22.5, 11.0)),
    status(2.0, 27.0, 3.5),
    decision(2.2, "state", state="flying", before="ready"),
    seen(3.0, ("seen-1", 22.7, 11.0), ("seen-2", 9.0, 18.3), solids=[OUTLINE]),
    status(3.0, 27.0, 5.0),
    seen(3.5, ("seen-2", 9.1, 18.3), solids=[OUTLINE]),
    status(4.0, 27.0, 5.0),
    status(4.5, 27.0, 5.0),
]


def test_a_conductor_has_the_time_of_its_first_report_and_the_place_of_its_last():
    first, second = SeenStory.of(DECISIONS).conductors
    assert (first.name, first.time_s, first.position_m) == ("seen-1", 2.0, (22.7, 11.0))
    assert (second.name, second.time_s, second.position_m) == ("seen-2", 3.0, (9.1, 18.3))
    assert first.from_m == (27.0, 3.5)


def test_an_outline_has_the_time_at_which_it_was_reported_first():
    assert SeenStory.of(DECISIONS).solids == ((3.0, OUTLINE),)


def test_a_conductor_seen_before_the_first_position_has_no_viewpoint():
    (sight,) = SeenStory.of([*DECISIONS[:1], seen(0.1, ("seen-1", 1.0, 2.0))]).conductors
    assert all(math.isnan(each) for each in sight.from_m)


def test_time_at_rest_before_and_after_the_flight_is_left_out():
    assert [time_s for time_s, _ in SeenStory.of(DECISIONS).moves] == [1.5, 2.0, 3.0]
    assert SeenStory.of(DECISIONS[:3]).moves == ()


def test_a_last_line_that_was_cut_short_is_left_out(tmp_path):
    file = tmp_path / "decisions.jsonl"
    file.write_text('{"time_s": 1.0, "kind": "state", "data": {"state": "idle"}}\n{"time_s": 2')
    assert SeenStory.read(file).states == ((0.0, "idle"),)


def colours_of(path):
    with Image.open(path) as picture:
        assert min(picture.size) > 800
        return {colour for _, colour in picture.convert("RGB").getcolors(1 << 24)}


def rgb(colour):
    return tuple(round(255 * part) for part in colour[:3])


def test_seen_obstacles_are_drawn_over_the_true_and_the_configured_ones(tmp_path):
    true = SITE.with_obstacles((*SITE.obstacles, JIB))
    configured = replace(SITE, obstacles=())
    flown = [(27.0, 2.5), (27.0, 5.0)]
    file = tmp_path / "perceived.png"
    draw_perceived(
        SeenStory.of(DECISIONS),
        flown,
        true,
        configured,
        named_vehicle("x500"),
        file,
        added=("jib",),
    )
    drawn = colours_of(file)
    assert rgb(colormaps["plasma"](0.0)) in drawn
    assert {(0xC2, 0x18, 0x5B), (0x15, 0x65, 0xC0)} <= drawn  # added; configured


@pytest.mark.parametrize("decisions", [[], DECISIONS[:1]], ids=["none", "no place"])
def test_a_flight_without_seen_obstacles_has_a_picture_too(tmp_path, decisions):
    file = tmp_path / "perceived.png"
    draw_perceived(SeenStory.of(decisions), [], SITE, SITE, named_vehicle("x500"), file)
    assert colours_of(file)


def test_where_the_line_shows_another_place_the_autopilots_is_drawn_too():
    by_line = decision(
        5.0, "status", position_m=[27.0, 0.0, 5.0], line_offset_m=[-1.5, 0.5], risk={}
    )
    assert SeenStory.of(DECISIONS).estimates == ()
    assert SeenStory.of([*DECISIONS, by_line]).estimates == ((28.5, 4.5),)

"""The fence of both autopilots, by their parameters and their uploaded items."""

from __future__ import annotations

import math

import pytest

from moar_companion.mavlink.autopilots import profile
from moar_companion.mavlink.autopilots.fence import Fence, Limit, areas_of
from moar_companion.mavlink.autopilots.parameter_names import Parameters
from moar_companion.mavlink.telemetry import FenceItem
from moar_companion.types import ARDUPILOT, PX4, UNKNOWN

OFF = {
    PX4: dict.fromkeys(profile(PX4).fence_parameters, 0.0),
    ARDUPILOT: dict.fromkeys(profile(ARDUPILOT).fence_parameters, 0.0),
}
ON = {
    "FENCE_ENABLE": 1.0,
    "FENCE_TYPE": 15.0,
    "FENCE_RADIUS": 60.0,
    "FENCE_ALT_MAX": 25.0,
    "FENCE_ALT_MIN": 3.0,
    "FENCE_MARGIN": 2.0,
    "FENCE_ACTION": 4.0,
}


def fence(kind, items=(), **values):
    return profile(kind).fence(Parameters({**OFF[kind], **values}), items)


def test_ardupilots_fence_counts_when_its_status_alone_reports_it():
    reported = {**OFF[ARDUPILOT], "FENCE_TYPE": 2.0, "FENCE_RADIUS": 60.0}
    assert profile(ARDUPILOT).fence(reported, ()).names == ()
    assert profile(ARDUPILOT).fence(reported, (), enabled=True).names == ("FENCE_RADIUS 60 m",)


def polygon(command, *places):
    return [
        FenceItem(
            command=command, parameter=float(len(places)), latitude_deg=lat, longitude_deg=lon
        )
        for lat, lon in places
    ]


def circle(command, radius_m, latitude_deg=45.0, longitude_deg=7.0):
    return FenceItem(
        command=command,
        parameter=radius_m,
        latitude_deg=latitude_deg,
        longitude_deg=longitude_deg,
    )


def test_px4_without_limits_has_no_fence():
    assert fence(PX4).names == ()
    assert not fence(PX4).about_home


def test_the_limits_of_px4_are_horizontal_and_vertical_distances_from_home():
    found = fence(PX4, GF_MAX_HOR_DIST=10.0, GF_MAX_VER_DIST=20.0, GF_ACTION=2.0)
    assert found.circle == Limit(parameter="GF_MAX_HOR_DIST", value_m=10.0)
    assert found.names == ("GF_MAX_HOR_DIST 10 m", "GF_MAX_VER_DIST 20 m")
    assert found.about_home
    assert found.action == "hold"
    assert found.overrules_land


def test_ardupilots_fence_is_off_until_it_is_enabled():
    assert fence(ARDUPILOT, **{**ON, "FENCE_ENABLE": 0.0}).names == ()
    assert fence(ARDUPILOT, **{**ON, "FENCE_ENABLE": 0.0, "FENCE_AUTOENABLE": 3.0}).names


@pytest.mark.parametrize(
    ("bit", "names"),
    [
        (1, ("FENCE_ALT_MAX 25 m",)),
        (2, ("FENCE_RADIUS 60 m",)),
        (4, ("inclusion circle 1",)),
        (8, ("FENCE_ALT_MIN 3 m",)),
        (0, ()),
    ],
)
def test_the_bits_of_fence_type_select_the_limits(bit, names):
    found = fence(ARDUPILOT, [circle(5003, 30.0)], **{**ON, "FENCE_TYPE": float(bit)})
    assert found.names == names
    assert found.margin_m == 2.0


def test_a_fence_is_unknown_while_a_parameter_is_awaited():
    assert profile(PX4).fence(Parameters({"GF_ACTION": 2.0}), ()) is None


def test_an_unreported_switch_of_the_fence_counts_as_on_and_a_margin_as_the_greatest():
    found = fence(ARDUPILOT, **{**ON, "FENCE_ENABLE": None, "FENCE_MARGIN": None})
    assert found.circle is not None
    assert found.margin_m == 10.0


def test_firmware_that_was_built_without_a_fence_has_none():
    known = profile(ARDUPILOT)
    for later in ({}, {"FENCE_MARGIN_XY": 0.0, "FENCE_AUTOENABLE": 0.0}):
        silent = Parameters(
            {**known.parameters.defaults, **dict.fromkeys(known.fence_parameters), **later}
        )
        assert known.fence(silent, ()) == Fence()
        assert known.unreported(silent).denying == ()
        assert "FENCE_RADIUS" in known.unreported(silent).names


def test_fence_items_become_polygons_and_circles_in_their_order():
    areas = areas_of(
        [
            *polygon(5001, (45.0, 7.0), (45.1, 7.0), (45.0, 7.1)),
            circle(5004, 12.0),
            FenceItem(command=5000, parameter=0.0, latitude_deg=45.0, longitude_deg=7.0),
            *polygon(5002, (45.0, 7.0), (45.1, 7.0), (45.0, 7.1), (45.2, 7.2)),
        ]
    )
    assert [(area.name, area.inclusion, len(area.vertices_deg)) for area in areas] == [
        ("inclusion polygon 1", True, 3),
        ("exclusion circle 2", False, 1),
        ("exclusion polygon 3", False, 4),
    ]
    assert areas[1].radius_m == 12.0


def test_an_incomplete_polygon_and_an_invalid_radius_are_read_without_an_error():
    items = [
        *polygon(5001, (45.0, 7.0), (45.1, 7.0), (45.0, 7.1))[:2],
        circle(5003, math.nan),
    ]
    areas = areas_of(items)
    assert len(areas[0].vertices_deg) == 2
    assert areas[1].radius_m == 0.0


def test_the_fence_of_an_unknown_autopilot_is_unknown():
    assert profile(UNKNOWN).fence(Parameters({}), (), enabled=True) is None

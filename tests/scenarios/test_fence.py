"""The autopilot's fence: missions are planned inside with a margin, or denied with its name."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from moar_companion.settings.config import Supervision
from tests.vehicles import named_vehicle

from ..copies import flown_once
from ..flights.judging import assert_nothing_was_touched, in_plane, true_places
from ..flights.lockstep import Lockstep, hovering
from ..flights.operator import ACCEPTED, DENIED, EVACUATION, EXIT, INSPECTION, Manner
from ..thorough import sampled
from .marks import BOTH, PX4_FIRST

POLYGON_INCLUSION, POLYGON_EXCLUSION, CIRCLE_INCLUSION, CIRCLE_EXCLUSION = range(5001, 5005)
DO_FENCE_ENABLE = 207
MARGIN_M = {Manner.PX4: 1.5, Manner.ARDUPILOT: 2.0}
"""Margin of the companion; ArduPilot's FENCE_MARGIN is more."""
CIRCLE = {
    Manner.PX4: lambda radius_m: {"GF_MAX_HOR_DIST": radius_m, "GF_ACTION": 2},
    Manner.ARDUPILOT: lambda radius_m: {
        "FENCE_ENABLE": 1, "FENCE_TYPE": 2, "FENCE_RADIUS": radius_m, "FENCE_ACTION": 4,
    },
}  # fmt: skip
CEILING = {
    Manner.PX4: lambda height_m: {"GF_MAX_VER_DIST": height_m, "GF_ACTION": 2},
    Manner.ARDUPILOT: lambda height_m: {
        "FENCE_ENABLE": 1, "FENCE_TYPE": 1, "FENCE_ALT_MAX": height_m, "FENCE_ACTION": 4,
    },
}  # fmt: skip
NAMES = {
    Manner.PX4: ("GF_MAX_HOR_DIST", "GF_MAX_VER_DIST"),
    Manner.ARDUPILOT: ("FENCE_RADIUS", "FENCE_ALT_MAX"),
}
HOME_X_M = 27.0
LINEDRONE = named_vehicle("linedrone_uniform")
EXACT = replace(LINEDRONE, guidance=replace(LINEDRONE.guidance, tracking_margin_m=0.0))


@flown_once
def fenced(manner, parameters, **options):
    return hovering(manner=manner, options={"parameters": parameters}, **options)


def refused(flight, mission, index=-1):
    """The text with which an order is denied."""
    flight.operator.mission(mission, index)
    flight.run(1.0)
    assert flight.operator.answers()[-1] == DENIED
    return next(text for text in reversed(flight.operator.texts()) if "denied" in text)


def height_m(flight):
    return true_places(flight)[-1][2]


def highest_m(flight):
    return max(z for _, _, z in true_places(flight))


def texts_are_short(flight):
    assert max(map(len, (t for t in flight.operator.texts() if t.startswith("MOAR")))) <= 50


@BOTH
def test_an_exit_through_the_circle_is_denied_with_its_name_and_value(manner):
    """As recorded on PX4 with 10 m: flown until the fence took the aircraft at 9.9 m."""
    flight = fenced(manner, CIRCLE[manner](10.0))
    assert refused(flight, EXIT) == f"MOAR: fence {NAMES[manner][0]} 10 m, denied"
    assert not flight.setpoints
    sentence = [item.data["detail"] for item in flight.decisions if item.kind == "no_plan"][-1]
    assert "inside the autopilot's fence" in sentence
    texts_are_short(flight)


def test_a_fence_that_a_switch_has_enabled_is_kept_although_the_parameters_have_none():
    """ArduPilot's DO_FENCE_ENABLE, mission item or RC switch changes no parameter."""
    manner = Manner.ARDUPILOT
    flight = fenced(manner, {**CIRCLE[manner](10.0), "FENCE_ENABLE": 0})
    flight.operator.command(DO_FENCE_ENABLE, 1)
    flight.run(1.5)
    assert refused(flight, EXIT) == "MOAR: fence FENCE_RADIUS 10 m, denied"


@pytest.mark.slow
@BOTH
def test_a_target_outside_the_circle_is_denied_and_one_inside_is_flown(manner):
    flight = fenced(manner, CIRCLE[manner](10.0))
    text = refused(flight, INSPECTION, 1)
    assert NAMES[manner][0] in text
    flight.operator.mission(INSPECTION, 0)
    flight.give_mode()
    flight.run_until_state("at_target", 60.0)
    farthest_m = max(math.hypot(x - HOME_X_M, y) for x, y, _ in true_places(flight))
    assert farthest_m < 10.0
    assert_nothing_was_touched(flight)


WITHOUT_AND_WITH = [
    (Manner.PX4, {}, 9.5, 20.0),
    (Manner.ARDUPILOT, CEILING[Manner.ARDUPILOT](9.2), 2.0, 6.5),
    (Manner.PX4, CEILING[Manner.PX4](9.2), 2.0, 6.5),
]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("manner", "parameters", "lowest_m", "highest_m"),
    sampled(WITHOUT_AND_WITH[:2], WITHOUT_AND_WITH),
)
def test_under_a_ceiling_another_path_is_flown(manner, parameters, lowest_m, highest_m):
    """Past two conductors: a path above both is safer than between them."""
    base = Lockstep().site
    conductors = tuple(
        replace(base.obstacles[0], name=name, position_m=(15.0, z_m), keep_out_m=0.0)
        for name, z_m in (("lower", 3.0), ("upper", 7.5))
    )
    target = replace(base.targets[0], position_m=(4.0, 7.0))
    site = replace(base, obstacles=conductors, targets=(target,))
    flight = Lockstep(
        site=site,
        vehicle=EXACT,
        manner=manner,
        options={"parameters": parameters},
        start_m=(19.0, 0.0),
        supervision=Supervision(position_uncertainty_m=0.9),
    )
    flight.start_in_the_air(7.0)
    flight.operator.mission(INSPECTION, 0)
    flight.give_mode()
    flight.run_until(lambda: true_places(flight)[-1][0] < 14.0, 60.0)
    assert_nothing_was_touched(flight)
    passed_m = max(z for x, _, z in true_places(flight) if abs(x - 15.0) < 1.0)
    assert lowest_m < passed_m < highest_m


@PX4_FIRST
def test_a_fence_lowered_in_flight_is_kept(manner):
    """The flight holds before the new fence, and is planned again inside or ends."""
    flight = fenced(manner, CEILING[manner](60.0))
    flight.begin(INSPECTION, 0)
    flight.run(3.0)
    name, limit_m = NAMES[manner][1], 9.0
    flight.operator.set_parameter(name, limit_m)
    flight.run_until_state("holding", 25.0)
    flight.run(3.0)
    assert flight.operator.in_mode("ours")
    assert any(f"path past {name} 9 m" in text for text in flight.operator.texts())
    assert highest_m(flight) < limit_m
    assert flight.state == "holding"
    texts_are_short(flight)
    flight.operator.mission(EXIT)
    flight.run_until_state("landing_leg", 40.0)
    assert highest_m(flight) < limit_m
    assert_nothing_was_touched(flight)


def polygon(flight, corners_m, command=POLYGON_INCLUSION):
    """Items of a polygon with corners (x, y) in the site's frame."""
    places = [flight.site.frame.to_geodetic((x, y, 0.0)) for x, y in corners_m]
    return [(command, len(places), p.latitude_deg, p.longitude_deg) for p in places]


@pytest.mark.slow
@BOTH
def test_uploaded_areas_count_without_a_notification(manner):
    """A polygon first; then a wide one, and a circle around the landing point of the exit."""
    parameters = {} if manner is Manner.PX4 else {"FENCE_ENABLE": 1, "FENCE_TYPE": 4}
    flight = fenced(manner, parameters)
    flight.operator.upload_fence(polygon(flight, [(15, -20), (35, -20), (35, 20), (15, 20)]))
    flight.run(11.0)
    assert refused(flight, EXIT) == "MOAR: fence inclusion polygon 1, denied"
    wide = polygon(flight, [(-20, -9), (60, -9), (60, 9), (-20, 9)])
    place = flight.site.frame.to_geodetic((41.0, 0.0, 0.0))
    circle = (CIRCLE_EXCLUSION, 5.0, place.latitude_deg, place.longitude_deg)
    flight.operator.upload_fence([circle, *wide])
    flight.run(11.0)
    assert refused(flight, EXIT) == "MOAR: fence exclusion circle 1, denied"
    # The evacuation has another landing point, at -10 m.
    flight.operator.mission(EVACUATION)
    flight.give_mode()
    assert flight.operator.answers()[-1] == ACCEPTED
    plan = [item.data["plan"] for item in flight.decisions if item.kind == "plan"][-1]
    assert plan["waypoints"][-1]["x_m"] == pytest.approx(-10.0)
    flight.run(8.0)
    assert true_places(flight)[-1][0] < HOME_X_M - 1.0
    assert_nothing_was_touched(flight)


def test_a_fence_without_an_action_is_kept_in_planning():
    flight = fenced(Manner.PX4, {"GF_MAX_HOR_DIST": 10.0, "GF_ACTION": 0})
    assert refused(flight, EXIT) == "MOAR: fence GF_MAX_HOR_DIST 10 m, denied"


@pytest.mark.slow
def test_an_exit_from_outside_the_fence_flies_back_inside():
    """A lower fence is set while the aircraft is above it."""
    flight = fenced(Manner.PX4, {"GF_MAX_HOR_DIST": 100.0, "GF_ACTION": 1})
    flight.begin(INSPECTION, 0)
    flight.run_until(lambda: height_m(flight) > 8.5, 60.0)
    flight.operator.set_parameter("GF_MAX_VER_DIST", 8.0)
    flight.run(5.0)
    assert height_m(flight) > 8.0
    assert any("outside GF_MAX_VER_DIST 8 m" in text for text in flight.operator.texts())
    flight.operator.mission(EXIT)
    flight.run_until(lambda: height_m(flight) < 6.5 + 0.5, 60.0)
    assert flight.state == "flying"
    assert_nothing_was_touched(flight)


def test_no_mission_starts_before_the_fence_is_read():
    flight = Lockstep(options={"parameters": {"GF_MAX_HOR_DIST": 10.0}})
    flight.deaf = True
    flight.take_off()
    flight.deaf = False
    flight.run(0.1)
    flight.operator.mission(EXIT)
    flight.run(0.5)
    assert ACCEPTED not in flight.operator.answers()


@pytest.mark.slow
def test_the_fence_is_centred_on_the_home_of_the_flight():
    """Taken off elsewhere, the same radius lets the exit through."""
    flight = fenced(Manner.PX4, CIRCLE[Manner.PX4](20.0))
    flight.operator.mission(EXIT)
    flight.give_mode()
    flight.run_until_state("landing_leg", 40.0)
    assert in_plane(flight.site, *_home(flight))[0] == pytest.approx(HOME_X_M, abs=0.1)


def _home(flight):
    options = flight.autopilot.options
    return options.latitude_deg, options.longitude_deg, options.altitude_amsl_m

"""The error of the heading, from the directions of the wires that scans see."""

from __future__ import annotations

import math

import numpy as np
import pytest

from moar_companion.perception.line_heading import LineHeading
from moar_companion.perception.scan_conductors import ConductorSighting

SCAN_S = 0.1
SENSOR = np.array([0.0, 0.0, 12.0])


def turned(angle_deg, sign=1.0):
    """A wire that is seen turned by an angle, counterclockwise from above."""
    angle = math.radians(angle_deg)
    return ConductorSighting(
        point_m=SENSOR,
        direction=sign * np.array([-math.sin(angle), math.cos(angle), 0.02]),
        rings=12,
        range_m=8.0,
    )


def after(*scans, heading=None, from_s=0.0):
    """The heading after scans, each with sightings at some angles in degrees."""
    heading = LineHeading() if heading is None else heading
    for number, angles in enumerate(scans):
        found = [turned(angle) for angle in angles]
        shown = heading.shown_by(found, from_s + number * SCAN_S, least=2)
        heading = heading.missed() if shown is None else shown
    return heading


def degrees(heading):
    return math.degrees(heading.turned_rad)


@pytest.mark.parametrize("angle_deg", [-25.0, 0.0, 12.0, 38.0])
def test_the_angle_by_which_all_wires_are_turned_is_the_headings_error(angle_deg):
    scan = (angle_deg - 0.5, angle_deg, angle_deg + 0.5)
    assert degrees(after(*[scan] * 5)) == pytest.approx(angle_deg, abs=0.3)


def test_an_error_that_grows_as_a_real_one_is_followed_within_a_degree():
    ramp = [(0.25 * number,) * 4 for number in range(100)]  # 2.5 degrees per second
    assert degrees(after(*ramp)) == pytest.approx(24.75, abs=1.0)


def test_a_wire_has_no_beginning_and_no_end():
    shown = LineHeading().shown_by([turned(10.0), turned(10.0, sign=-1.0)], 0.0, least=2)
    assert degrees(shown) == pytest.approx(10.0, abs=0.2)


def test_one_row_in_another_direction_turns_nothing():
    assert degrees(after(*[(5.0, 5.5, 16.0)] * 5)) == pytest.approx(5.25, abs=0.3)


def test_two_rows_in_different_directions_show_nothing():
    assert degrees(after(*[(-8.0, 8.0)] * 5)) == 0.0


def test_more_rows_of_a_fence_than_of_wires_turn_nothing_once_the_heading_is_known():
    heading = after(*[(5.0, 5.0)] * 10)
    scans = [(5.0, 5.0, 16.0, 16.0, 16.0)] * 20
    assert degrees(after(*scans, heading=heading, from_s=1.0)) == pytest.approx(5.0, abs=0.3)


def test_a_reset_of_the_heading_is_found_again_within_two_seconds():
    heading = after(*[(5.0, 5.0)] * 10)
    heading = after(*[(20.0, 20.0, 20.0)] * 20, heading=heading, from_s=1.0)
    assert degrees(heading) == pytest.approx(20.0, abs=0.5)


def test_a_row_that_is_turned_by_more_than_any_heading_is_not_of_the_line():
    assert degrees(after(*[(55.0, 55.0)] * 5)) == 0.0


def test_what_is_seen_is_turned_back_about_the_sensor():
    heading = after(*[(20.0, 20.0)] * 10)
    angle = math.radians(20.0)
    seen = np.array([[math.cos(angle), math.sin(angle), 3.0]])  # true: ahead, and 3 m up
    assert (seen @ heading.back)[0] == pytest.approx([1.0, 0.0, 3.0], abs=0.01)


def test_wires_are_searched_along_the_direction_in_which_they_were_seen():
    assert after(*[(20.0, 20.0)] * 10).axis(turns=True) == pytest.approx(
        turned(20.0).direction, abs=0.03
    )


def test_after_scans_without_the_line_searches_turn_to_both_sides_and_back():
    heading, searched = after(*[(20.0, 20.0)] * 10), set()
    for _ in range(20):
        heading = heading.missed()
        x, y, _ = heading.axis(turns=True)
        searched.add(round(math.degrees(math.atan2(-x, y))))
        assert heading.axis(turns=False) == pytest.approx(turned(20.0).direction, abs=0.03)
    assert searched == {3, 20, 37}
    found = after(*[(35.0, 35.0)] * 10, heading=heading, from_s=3.0)
    assert degrees(found) == pytest.approx(35.0, abs=1.0)

"""Limits of the search for conductors: few points, gaps, pieces of one wire, rows of wires."""

from __future__ import annotations

import numpy as np
import pytest

from moar_companion.perception.conductors import DetectorSettings, find_conductors
from moar_companion.perception.spans import find_power_line
from tests.perception.scenes import Scene, Wire

WIRE = Wire(lateral_m=0.0, lowest_m=14.0, per_m=2.0)


def lengths_m(cloud, **settings):
    """Lengths of the conductors in points above level ground."""
    found = find_conductors(cloud, cloud[:, 2], DetectorSettings(**settings))
    return [each.curve.length_m for each in found]


def in_a_row(*along_m):
    """Points at these places of a straight level wire."""
    along = np.array(along_m)
    return np.column_stack((along, np.zeros(len(along)), np.full(len(along), 10.0)))


def test_ten_points_in_a_row_are_a_conductor_and_nine_are_not():
    nine = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.5, 9.5, 12.0)
    assert lengths_m(in_a_row(*nine)) == []
    assert lengths_m(in_a_row(*nine), least_points=9) == [pytest.approx(12.0)]
    assert lengths_m(in_a_row(*sorted((*nine, 7.0)))) == [pytest.approx(12.0)]


def test_a_short_row_of_many_points_is_no_conductor():
    assert lengths_m(in_a_row(*np.arange(0.0, 9.5, 0.4))) == []
    assert lengths_m(in_a_row(*np.arange(0.0, 10.5, 0.4))) == [pytest.approx(10.4)]


def test_points_farther_apart_than_the_greatest_gap_are_no_conductor():
    points = in_a_row(0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.5, 7.0, 9.5, 12.0)
    assert lengths_m(points, gap_m=15.0) == [pytest.approx(12.0)]
    assert lengths_m(points, gap_m=1.0) == []


def test_two_pieces_of_one_wire_beyond_the_greatest_gap_are_one_conductor():
    pieces = Scene(1, length_m=160.0).with_wires([WIRE], end_m=60.0)
    cloud = pieces.with_wires([WIRE], start_m=100.0).cloud
    assert lengths_m(cloud) == [pytest.approx(160.0, abs=2.0)]


def test_two_wires_one_after_the_other_beside_each_other_stay_two_conductors():
    beside = Wire(lateral_m=1.5, lowest_m=14.0, per_m=2.0)
    pieces = Scene(1, length_m=160.0).with_wires([WIRE], end_m=60.0)
    cloud = pieces.with_wires([beside], start_m=100.0).cloud
    assert lengths_m(cloud) == [pytest.approx(60.0, abs=2.0)] * 2


def test_the_wire_above_three_phases_is_the_earth_wire_though_it_is_alike():
    """As dense as the others and single as these: only its height tells."""
    wires = [Wire(lateral_m=x, lowest_m=12.0, per_m=2.0) for x in (-6.0, 0.0, 6.0)]
    above = Wire(lateral_m=0.0, lowest_m=18.0, per_m=2.0)
    scene = Scene(2, length_m=40.0).with_wires([*wires, above]).with_ground(0.2, 24.0)
    (span,) = find_power_line(scene.cloud).spans
    assert [len(circuit) for circuit in span.circuits] == [3]
    (earth,) = span.earth_wires
    assert earth.curve.points_at(np.zeros(1))[0, 2] == pytest.approx(18.0, abs=0.5)


def test_four_wires_at_one_height_have_no_earth_wire():
    wires = [Wire(lateral_m=x, lowest_m=12.0, per_m=2.0) for x in (-9.0, -3.0, 3.0, 9.0)]
    scene = Scene(2, length_m=40.0).with_wires(wires).with_ground(0.2, 24.0)
    (span,) = find_power_line(scene.cloud).spans
    assert [len(circuit) for circuit in span.circuits] == [4]
    assert span.earth_wires == ()

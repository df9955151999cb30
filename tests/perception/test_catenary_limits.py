"""The catenary fit where the points or the question are at their limits."""

from __future__ import annotations

import math

import numpy as np
import pytest

from moar_companion.perception.catenary import fit, wires_of

EAST, NORTH = np.array([1.0, 0.0]), np.array([0.0, 1.0])


def level_wire(count=40, noise_m=0.0):
    """Points 60 m along x, 10 m above the ground."""
    along = np.linspace(-30.0, 30.0, count)
    noise = np.random.default_rng(3).normal(0.0, noise_m, (2, count))
    return np.column_stack((along, noise[0], 10.0 + noise[1]))


def test_a_plane_along_the_conductor_is_crossed_nowhere():
    curve = fit(level_wire(), EAST)
    place = np.array([4.0, 7.0, 0.0])
    assert curve.crossing(place, EAST) == pytest.approx(4.0 - curve.origin_m[0])
    assert curve.crossing(place, NORTH) == math.inf


def test_points_that_all_deviate_by_more_than_their_scale_count_alike():
    curve = fit(level_wire(noise_m=0.3), EAST, scale_m=1e-6)
    assert curve.extent_m[1] - curve.extent_m[0] == pytest.approx(60.0, abs=0.1)
    middle = curve.points_at(np.array([0.0]))[0]
    assert middle[1:] == pytest.approx([0.0, 10.0], abs=0.3)


def test_points_exactly_on_a_line_are_one_wire_without_deviation():
    points = level_wire()
    curve, wires, sigma_m = wires_of(points, fit(points, EAST))
    assert (wires, sigma_m) == ((curve,), 0.0)

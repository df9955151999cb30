"""Rays in the plane: how far they stay in the slab, and how many pass."""

from __future__ import annotations

import numpy as np
import pytest

from moar_companion.perception.plane_rays import SLAB_M, PlaneRays, sector_of

SENSOR = np.array([1.0, 0.5, 10.0])


def rays(*points, sensor=SENSOR, sectors=8):
    return PlaneRays.of(np.array(points, float), np.array(sensor), sectors)


def test_directions_are_numbered_from_ahead_upwards():
    x, z = np.array([1.0, 0.1, -1.0, -1.0, 1.0]), np.array([0.1, 1.0, 0.1, -0.1, -0.1])
    assert sector_of(x, z, 8).tolist() == [0, 1, 3, 4, 7]


def test_a_ray_to_a_point_near_the_plane_reaches_it():
    found = rays((5.0, 1.0, 13.0))
    assert found.distance_m == pytest.approx([5.0])
    assert found.reach_m == pytest.approx([5.0])
    assert found.inside.all()


@pytest.mark.parametrize(("y", "share"), [(4.5, 0.5), (-5.5, 0.5), (2.5, 1.0), (8.5, 0.25)])
def test_a_ray_to_a_point_beside_reaches_to_the_side_of_the_slab(y, share):
    found = rays((5.0, y, 13.0))
    assert found.reach_m == pytest.approx([5.0 * share])
    assert found.inside.tolist() == [abs(y) <= SLAB_M]


def test_a_sensor_beside_the_plane_clears_no_cell():
    assert rays((5.0, 0.0, 13.0), sensor=(1.0, 3.0, 10.0)).reach_m.tolist() == [0.0]


def test_rays_are_counted_that_reach_beyond():
    found = rays((5.2, 0.5, 10.1), (9.2, 0.5, 10.1), (1.0, 0.5, 15.3))
    passing = found.passing(1.0, 0.0)
    assert passing[0, [0, 3, 4, 7, 8]].tolist() == [2, 2, 1, 1, 0]
    assert passing[2, [4, 5]].tolist() == [1, 0]
    assert found.passing(1.0, 2.0)[0, [1, 2, 5, 6]].tolist() == [2, 1, 1, 0]


def test_the_nearest_by_direction():
    found = rays((5.0, 0.5, 10.1), (3.0, 0.5, 10.1))
    assert found.nearest_m(np.array([True, True]))[0] == pytest.approx(2.0, abs=0.01)
    assert found.nearest_m(np.array([True, False]))[0] == pytest.approx(4.0, abs=0.01)
    assert np.isinf(found.nearest_m(np.array([True, True]))[1])

"""Outlines of cells: exact, simple, without holes, with a limit of vertices."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scipy import ndimage

from moar_companion.perception.cell_outlines import outline_of, straightened
from moar_companion.polygon_outline import outline_problem


def cells(*rows):
    """Cells (x, z) drawn from the top row down."""
    return np.array([[mark == "#" for mark in row] for row in rows[::-1]]).T


def test_one_cell_is_a_square():
    assert outline_of(cells("#")) == [(0, 0), (1, 0), (1, 1), (0, 1)]


def test_a_concave_shape_is_not_filled_up():
    found = outline_of(cells("#.#", "#.#", "###"))
    assert shapely.Polygon(found).area == 7.0
    assert len(found) == 8


def test_holes_are_filled():
    assert outline_of(cells("###", "#.#", "###")) == [(0, 0), (3, 0), (3, 3), (0, 3)]


def test_a_ring_that_closes_at_a_corner_is_a_simple_outline():
    found = outline_of(cells(".##", "#.#", "###"))
    assert outline_problem(np.array(found)) is None
    assert shapely.Polygon(found).area == 8.0


@pytest.mark.parametrize("seed", range(20))
def test_any_connected_cells_have_a_simple_outline_of_their_area(seed):
    drawn = np.random.default_rng(seed).uniform(size=(14, 11)) < 0.62
    labels, _ = ndimage.label(drawn)
    part = labels == np.argmax(np.bincount(labels[drawn]))
    found = np.array(outline_of(part))
    assert outline_problem(found) is None
    assert shapely.Polygon(found).area == ndimage.binary_fill_holes(part).sum()


def test_too_many_vertices_are_had_by_no_outline():
    steps = np.tri(60, dtype=bool)
    assert len(outline_of(steps, 1000)) == 122
    coarse = outline_of(steps, 50)
    assert len(coarse) <= 50
    shape = shapely.Polygon(coarse)
    assert all(shape.contains(shapely.Point(x + 0.5, z + 0.5)) for x, z in np.argwhere(steps))


def test_vertices_inside_a_straight_edge_are_left_out():
    assert straightened([(0, 0), (1, 0), (2, 0), (2, 3)]) == [(0, 0), (2, 0), (2, 3)]

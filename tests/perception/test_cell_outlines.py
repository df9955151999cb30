"""Outlines of cells: exact, simple, without holes, with a limit of vertices."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scipy import ndimage

from moar_companion.perception.cell_outlines import parts_of, straightened
from moar_companion.planner.site import outline_problem


def cells(*rows):
    """Cells (x, z) drawn from the top row down."""
    return np.array([[mark == "#" for mark in row] for row in rows[::-1]]).T


def outlines(drawn, most_hole_cells=1, most_vertices=200):
    return [outline for _, outline in parts_of(drawn, most_hole_cells, most_vertices)]


def test_one_cell_is_a_square():
    assert outlines(cells("#")) == [[(0, 0), (1, 0), (1, 1), (0, 1)]]


def test_a_concave_shape_is_not_filled_up():
    (found,) = outlines(cells("#.#", "#.#", "###"))
    assert shapely.Polygon(found).area == 7.0
    assert len(found) == 8


def test_cells_that_touch_only_at_a_corner_are_two_parts():
    assert len(outlines(cells("#.", ".#"))) == 2


def test_small_holes_are_filled():
    assert outlines(cells("###", "#.#", "###")) == [[(0, 0), (3, 0), (3, 3), (0, 3)]]


def test_a_ring_that_closes_at_a_corner_is_a_simple_outline():
    (found,) = outlines(cells(".##", "#.#", "###"))
    assert outline_problem(np.array(found)) is None
    assert shapely.Polygon(found).area == 8.0


def test_an_outline_around_free_space_is_cut():
    drawn = cells("#####", "#...#", "#...#", "#####")
    found = [shapely.Polygon(each) for each in outlines(drawn, 4)]
    assert len(found) == 2
    assert sum(each.area for each in found) == drawn.sum()
    assert not any(each.intersects(shapely.Point(2.5, 2.0)) for each in found)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize(("hole", "vertices"), [(0, 1000), (200, 1000), (0, 20)])
def test_outlines_cover_the_cells_and_nothing_else(seed, hole, vertices):
    drawn = np.random.default_rng(seed).uniform(size=(14, 11)) < 0.62
    found = outlines(drawn, hole, vertices)
    assert all(outline_problem(np.array(each)) is None for each in found)
    assert all(len(each) <= vertices for each in found)
    covered = shapely.union_all([shapely.Polygon(each) for each in found])
    labels, _ = ndimage.label(drawn)
    whole = np.any(
        [ndimage.binary_fill_holes(labels == label) for label in np.unique(labels[drawn])], axis=0
    )
    assert covered.area == pytest.approx((whole if hole else drawn).sum())


def test_vertices_inside_a_straight_edge_are_left_out():
    assert straightened([(0, 0), (1, 0), (2, 0), (2, 3)]) == [(0, 0), (2, 0), (2, 3)]

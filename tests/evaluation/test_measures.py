"""Measures of sweeps, by hand and against a count of cells."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from moar_companion.analysis.evaluation import measures


def test_the_range_ratio_is_that_of_the_ranges():
    assert measures.range_ratio(np.array([1.0, 4.0]), np.array([2.0, 2.5, 4.0])) == 1.5
    assert math.isnan(measures.range_ratio(np.array([1.0, 4.0]), np.array([2.0, 2.0])))


@pytest.mark.parametrize(
    ("values", "ends", "share"),
    [
        ([2.0, 3.0], (1.0, 5.0), 0.25),
        ([0.0, 9.0], (5.0, 1.0), 1.0),
        ([6.0, 9.0], (1.0, 5.0), 0.0),
        ([3.0], (1.0, 5.0), 0.0),
        ([1.0, 2.0], (1.0, 1.0), math.nan),
        ([1.0, 2.0], (1.0, math.nan), math.nan),
    ],
)
def test_coverage_is_the_part_of_the_interval_within_the_values(values, ends, share):
    assert measures.coverage(np.array(values), *ends) == pytest.approx(share, nan_ok=True)


def test_a_switch_is_measured_by_its_place_and_by_its_steps():
    levels = np.linspace(0.0, 1.0, 5)
    values = np.array([10.0, 10.0, 13.0, 18.0, 18.0])
    assert measures.first_nearer(levels, values, 10.0, 20.0) == 0.75
    assert math.isnan(measures.first_nearer(levels, values, 0.0, 30.0 + 10.0))
    assert measures.half_passed(levels, values) == 0.75
    assert measures.half_passed(levels, -values) == 0.75
    assert measures.greatest_step(values) == pytest.approx(5.0 / 8.0)
    assert math.isnan(measures.half_passed(levels, np.ones(5)))
    # Of the points 9 and 30 lie outside the values' range.
    points = np.array([30.0, 10.0, 14.0, 9.0, 18.0])
    assert measures.greatest_gap(points, values) == pytest.approx(0.5)


def test_quartiles_leave_out_undefined_values():
    assert measures.quartiles(np.array([1.0, math.nan, 3.0, 2.0])) == (3, 1.5, 2.0, 2.5)
    assert measures.quartiles(np.array([math.nan]))[0] == 0


@settings(max_examples=40)
@given(arrays(np.int64, st.tuples(st.integers(1, 8), st.just(3)), elements=st.integers(0, 6)))
def test_the_hypervolume_is_the_number_of_unit_cells_that_a_point_dominates(points):
    size = 6
    cells = np.stack(np.meshgrid(*[np.arange(size)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    dominated = (points[:, None, :] <= cells[None, :, :]).all(axis=2).any(axis=0).sum()
    volume = measures.hypervolume(points.astype(float), np.full(3, float(size)))
    assert volume == pytest.approx(float(dominated))

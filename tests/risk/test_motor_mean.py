from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from moar_companion.risk.wind import (
    MOTORS_MAX_AGE_S,
    MOTORS_WINDOW_S,
    MotorSample,
    window_mean,
    with_sample,
)


def received(values, period_s=0.2):
    samples = ()
    for number, value in enumerate(values):
        samples = with_sample(samples, MotorSample(number * period_s, value))
    return samples


def test_no_sample_has_no_mean():
    assert window_mean((), 5.0) is None


def test_the_first_sample_counts_at_once():
    assert window_mean(received([0.7]), 0.0) == 0.7


def test_one_sample_counts_for_its_duration():
    samples = received([0.5] * 6 + [0.9, 0.5])
    assert window_mean(samples, 1.4) == pytest.approx(0.5 + 0.4 * 0.2 / MOTORS_WINDOW_S)
    assert window_mean(samples, 1.2 + 0.2 + MOTORS_WINDOW_S) == pytest.approx(0.5)


def test_a_lasting_value_counts_in_full_after_the_window():
    samples = received([0.5] * 6 + [0.9] * 5)
    assert window_mean(samples, 1.2 + MOTORS_WINDOW_S) == pytest.approx(0.9)


def test_the_last_sample_counts_in_full_before_its_maximum_age():
    samples = received([0.5] * 6 + [0.9])
    assert window_mean(samples, 1.0 + 0.2 + MOTORS_WINDOW_S) == pytest.approx(0.9)
    assert MOTORS_WINDOW_S < MOTORS_MAX_AGE_S


def test_after_a_gap_the_mean_restarts():
    samples = with_sample(received([0.9] * 6), MotorSample(2.1, 0.5))
    assert samples == (MotorSample(2.1, 0.5),)


def test_a_sample_is_taken_once():
    samples = received([0.5, 0.9])
    assert with_sample(samples, MotorSample(0.2, 0.9)) is samples


@given(
    values=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=30),
    period_s=st.sampled_from((0.1, 0.2, 0.5, 1.0)),
    later_s=st.floats(0.0, 1.0),
)
def test_the_mean_is_the_time_average_of_held_samples(values, period_s, later_s):
    now_s = (len(values) - 1) * period_s + later_s
    times_s = np.linspace(max(0.0, now_s - MOTORS_WINDOW_S), now_s, 20_001)
    stood = np.array(values)[
        np.minimum(np.floor(times_s / period_s + 1e-9).astype(int), len(values) - 1)
    ]
    assert window_mean(received(values, period_s), now_s) == pytest.approx(stood.mean(), abs=1e-3)

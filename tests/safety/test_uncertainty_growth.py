"""Growth of the position's uncertainty: a steady rise counts, a step or noise does not."""

from __future__ import annotations

import random

import pytest

from moar_companion.companion.safety.uncertainty_growth import AHEAD_S, UncertaintyGrowth


def grown(values):
    """Growth after (time, value) reports."""
    growth = UncertaintyGrowth()
    for now_s, value_m in values:
        growth = growth.followed(value_m, now_s)
    return growth


def reports(value_of, *, until_s=10.0, period_s=0.1):
    return [(n * period_s, value_of(n * period_s)) for n in range(round(until_s / period_s) + 1)]


@pytest.mark.parametrize("rate_mps", [0.1, 0.3, 1.0])
@pytest.mark.parametrize("period_s", [0.02, 0.1, 0.2])
def test_a_steady_growth_is_its_rate(rate_mps, period_s):
    growth = grown(reports(lambda now_s: 0.3 + rate_mps * now_s, period_s=period_s))
    assert growth.rate_mps == pytest.approx(rate_mps, rel=0.2)


def test_a_growth_is_known_after_three_seconds():
    rising = reports(lambda now_s: 0.3 + 0.3 * now_s, until_s=3.4)
    assert grown(rising[:28]).rate_mps == 0.0
    assert grown(rising).rate_mps == pytest.approx(0.3, rel=0.2)


def test_reports_once_a_second_are_enough():
    growth = grown(reports(lambda now_s: 0.3 + 0.3 * now_s, period_s=1.0))
    assert growth.rate_mps == pytest.approx(0.3)


def test_two_lost_reports_of_one_a_second_do_not_end_a_growth():
    rising = reports(lambda now_s: 0.3 + 0.3 * now_s, until_s=20.0, period_s=1.0)
    for lost in range(5, 18):
        for until in range(lost + 3, 21):
            kept = [*rising[:lost], *rising[lost + 2 : until]]
            assert grown(kept).rate_mps == pytest.approx(0.3)


def test_a_silent_source_is_taken_to_go_on_growing():
    growth = grown(reports(lambda now_s: 0.3 * now_s))
    assert growth.at_m(20.0) == pytest.approx(6.0, abs=0.3)
    assert growth.followed(3.0, 10.0) == growth


def test_a_step_is_no_growth():
    for until_s in range(50, 100):
        stepped = reports(lambda now_s: 0.5 if now_s < 5.0 else 1.5, until_s=0.1 * until_s)
        assert grown(stepped).rate_mps == 0.0


def test_a_growth_that_ends_is_over_within_two_seconds():
    ended = reports(lambda now_s: 0.3 + 0.3 * min(now_s, 6.0), until_s=8.0)
    assert grown(ended).rate_mps == 0.0


def test_a_shrinking_value_is_no_growth():
    assert grown(reports(lambda now_s: 3.0 - 0.2 * now_s)).rate_mps == 0.0


def test_noise_of_a_receiver_stays_below_the_limit():
    """A receiver's accuracy under an open sky varies by 0.1 m."""
    noise = random.Random(1)
    growth = UncertaintyGrowth()
    for n in range(20_000):
        value_m = 0.9 + noise.uniform(-0.1, 0.1)
        growth = growth.followed(value_m, 0.2 * n)
        assert value_m + AHEAD_S * growth.rate_mps < 2.0

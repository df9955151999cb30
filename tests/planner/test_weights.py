"""Risk indices and the adjustment of the weights (Eq. 9)."""

from __future__ import annotations

import math
import random

import pytest

from moar_companion.types import RiskIndices, Weights

MIDDLE = Weights.normalised(0.33, 0.33, 0.33)


def test_without_risk_the_weights_stay():
    assert MIDDLE.adjusted(RiskIndices()) == MIDDLE


@pytest.mark.parametrize(
    ("risk", "factors"),
    [
        ({"wind": 1.0}, (1.5, 0.5, 1.5)),
        ({"communication": 1.0}, (1.25, 0.75, 1.0)),
        ({"localization": 1.0}, (1.25, 0.75, 1.0)),
        ({"battery": 1.0}, (0.0, 2.0, 1.5)),
        ({"wind": 1.0, "communication": 1.0, "localization": 1.0}, (2.0, 0.0, 1.5)),
        ({"wind": 1.0, "battery": 1.0}, (0.5, 1.5, 2.0)),
        ({"wind": 0.4, "communication": 0.8, "localization": 0.2, "battery": 0.3},
         (1.15, 0.85, 1.35)),
    ],
)  # fmt: skip
def test_each_risk_shifts_the_weights_by_equation_9(risk, factors):
    adjusted = MIDDLE.adjusted(RiskIndices(**risk))
    expected = [factor / sum(factors) for factor in factors]
    assert (adjusted.safety, adjusted.time, adjusted.energy) == pytest.approx(expected)


def test_the_paper_s_flight_weights_in_wind_by_hand():
    adjusted = Weights(0.43, 0.14, 0.43).adjusted(RiskIndices(wind=0.5))
    # 0.43 * 1.25, 0.14 * 0.75, 0.43 * 1.25: together 1.18.
    assert adjusted.safety == pytest.approx(0.5375 / 1.18)
    assert adjusted.time == pytest.approx(0.105 / 1.18)
    assert adjusted.energy == pytest.approx(0.5375 / 1.18)


@pytest.mark.parametrize(
    ("case", "weights", "risk"),
    [
        ("safety alone, battery empty", Weights(1.0, 0.0, 0.0), RiskIndices(battery=1.0)),
        (
            "time alone, all others at their worst",
            Weights(0.0, 1.0, 0.0),
            RiskIndices(wind=1.0, communication=1.0, localization=1.0),
        ),
    ],
)
def test_where_all_three_weights_vanish_they_stay_as_they_were(case, weights, risk):
    assert weights.adjusted(risk) == weights, case


def test_adjusted_weights_sum_to_one_for_any_risk():
    rng = random.Random("weights")
    for _ in range(500):
        values = [rng.choice([0.0, 1.0, rng.random()]) for _ in range(7)]
        if sum(values[:3]) == 0.0:
            continue
        weights = Weights.normalised(*values[:3])
        risk = RiskIndices(
            wind=values[3], communication=values[4], localization=values[5], battery=values[6]
        )
        adjusted = weights.adjusted(risk)
        total = adjusted.safety + adjusted.time + adjusted.energy
        assert total == pytest.approx(1.0)
        assert min(adjusted.safety, adjusted.time, adjusted.energy) >= 0.0


@pytest.mark.parametrize("name", ["wind", "communication", "localization", "battery"])
@pytest.mark.parametrize("value", [-1e-9, 1.0 + 1e-9, 7.0, math.nan, math.inf])
def test_an_index_outside_zero_and_one_is_an_error_that_names_it(name, value):
    with pytest.raises(ValueError, match=name):
        RiskIndices(**{name: value})


@pytest.mark.parametrize(
    "values",
    [(0.5, 0.5, 0.5), (1.5, -0.5, 0.0), (math.nan, 0.5, 0.5), (math.inf, 0.0, 0.0), (0, 0, 0)],
)
def test_final_weights_that_are_not_weights_are_an_error(values):
    with pytest.raises(ValueError, match="weights"):
        Weights(*values)


@pytest.mark.parametrize("values", [(0.0, 0.0, 0.0), (-1.0, 1.0, 1.0), (math.inf, 1.0, 1.0)])
def test_weights_that_cannot_be_normalised_are_an_error(values):
    with pytest.raises(ValueError, match="weights"):
        Weights.normalised(*values)


def test_any_positive_weights_are_normalised():
    assert Weights.normalised(2.0, 1.0, 1.0) == Weights(0.5, 0.25, 0.25)

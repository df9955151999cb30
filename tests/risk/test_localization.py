from __future__ import annotations

from dataclasses import replace

import pytest

from moar_companion.vehicle import RiskModel


def test_a_good_fix_settles_to_no_risk(flight):
    assert flight.estimate.indices.localization == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize(
    ("source", "changes", "name"),
    [
        pytest.param("gnss", {"fix_type": 2}, "fix type", id="fix lost"),
        pytest.param("gnss", {"satellites": 4}, "satellites", id="satellites lost"),
        pytest.param("gnss", {"hdop": 3.5}, "hdop", id="bad geometry"),
        pytest.param("gnss", {"horizontal_accuracy_m": 15.0}, "receiver accuracy", id="jamming"),
        pytest.param(
            "estimator", {"horizontal_accuracy_m": 15.0}, "estimator accuracy", id="dead reckoning"
        ),
        pytest.param(
            "estimator",
            {"horizontal_position_ok": False},
            "estimator without position",
            id="the estimator gives up",
        ),
    ],
)
def test_one_bad_input_is_enough(flight, source, changes, name):
    flight.hear(source, **changes)
    assert flight.fly(3.0).indices.localization > 0.99
    assert flight.estimate.report.localization.value == 1.0
    assert flight.estimate.report.localization.worst == name


def test_fewer_satellites_raise_the_risk_by_steps(flight):
    risks = []
    for satellites in range(11, 3, -1):
        flight.hear("gnss", satellites=satellites)
        flight.fly(5.0)
        risks.append(flight.estimate.report.localization.value)
    assert risks == pytest.approx([0.0, 0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.0])


def test_a_dead_receiver_repeats_its_last_good_values(flight):
    frozen_s = flight.now_s
    flight.hear("gnss", receiver_s=frozen_s)
    assert flight.fly(1.5).indices.localization < 0.01
    assert flight.fly(1.5).indices.localization > 0.9
    assert flight.estimate.report.localization.worst == "receiver clock stopped"
    flight.hear("gnss")  # it is back
    assert flight.fly(1.0).indices.localization > 0.7
    assert flight.fly(30.0).indices.localization < 0.01


def test_a_receiver_that_measures_once_a_second_is_not_dead(flight):
    healthy = flight.sources["gnss"]
    flight.sources["gnss"] = lambda t: replace(healthy(t), receiver_s=float(int(t)))
    assert flight.fly(20.0).indices.localization < 0.01


def test_a_receiver_without_a_clock_is_judged_by_the_rest(new_flight, healthy):
    source = healthy["gnss"]
    healthy["gnss"] = lambda t: replace(source(t), receiver_s=None)
    flight = new_flight(**healthy)
    assert flight.fly(60.0).indices.localization < 0.01
    assert flight.input("localization", "receiver clock stopped").risk is None


def test_an_accuracy_of_zero_is_unknown(flight):
    flight.hear("gnss", horizontal_accuracy_m=0.0, hdop=0.0)
    flight.fly(1.0)
    assert flight.input("localization", "receiver accuracy").risk is None
    assert flight.input("localization", "hdop").risk is None


def test_without_any_receiver_or_estimator_the_risk_stays_unknown(new_flight, healthy):
    for name in ("gnss", "estimator"):
        del healthy[name]
    blind = new_flight(**healthy)
    assert blind.fly(60.0).indices.localization == RiskModel().unknown


def test_the_receiver_and_the_estimator_fall_silent(flight):
    flight.silence("gnss", "estimator")
    assert flight.fly(2.5).indices.localization < 0.01
    assert flight.fly(1.0).indices.localization >= RiskModel().unknown
    assert flight.estimate.report.localization.value is None
    assert flight.estimate.report.localization.ever_known

"""Reasons of the indices' values, as text and as JSON."""

from __future__ import annotations

import json
from dataclasses import asdict, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from moar_companion.planner.adaptation import Adaptation, Calibration
from moar_companion.risk import IndexReport, InputReport
from moar_companion.risk.explain import (
    index_words,
    input_words,
    rise_words,
    risk_section,
    weights_section,
)
from moar_companion.risk.input_reports import YES_OR_NO
from moar_companion.settings.risk_model import RiskModel
from moar_companion.settings.vehicle import AdaptationKind
from moar_companion.status_values import AdaptationEntry
from moar_companion.types import RiskIndices, Weights

EQUAL = Weights.normalised(1, 1, 1)


def shown(flight, name):
    return index_words(
        name, getattr(flight.estimate.indices, name), getattr(flight.estimate.report, name)
    )


def test_the_input_that_raises_an_index_is_shown_with_value_age_and_risk(flight):
    flight.handle("wind", velocity_ned_mps=(9.0, 0.0, 0.0))
    flight.fly(0.5)
    assert shown(flight, "wind").endswith(
        "rising to 0.67: wind reported 9.0 m/s, 0.0 s old -> 0.67"
    )
    flight.fly(10.0)
    assert shown(flight, "wind") == "wind 0.67: wind reported 9.0 m/s, 0.0 s old -> 0.67"


def test_an_index_without_a_cause_is_shown_as_falling(flight):
    flight.handle("gnss", fix_type=0)
    flight.fly(10.0)
    flight.handle("gnss")
    flight.fly(1.0)
    assert shown(flight, "localization") == (
        "localization 0.82, falling to 0.00: no input raises it"
    )


def test_the_last_value_of_a_silent_source_is_held(flight):
    flight.handle("wind", velocity_ned_mps=(9.0, 0.0, 0.0))
    flight.fly(10.0)
    flight.silence("wind")
    flight.fly(12.0)
    report = flight.estimate.report.wind
    assert (report.cause, report.held, report.worst != report.cause) == (
        "wind reported",
        True,
        True,
    )
    assert shown(flight, "wind") == (
        "wind 0.67, held at the last value: wind reported 9.0 m/s, 12.0 s old"
    )


@pytest.mark.slow
def test_the_last_value_of_a_source_that_reports_unknown_is_held_with_its_age(flight):
    before = flight.sources["batteries"]
    flight.sources["batteries"] = lambda t: {0: replace(before(t)[0], remaining=0.04)}
    flight.fly(20.0)
    flight.sources["batteries"] = lambda t: {0: replace(before(t)[0], remaining=None)}
    flight.fly(600.0)
    report = flight.estimate.report.battery
    assert (report.cause, report.held) == ("battery 0 remaining", True)
    assert shown(flight, "battery") == (
        "battery 1.00, held at the last value: battery 0 remaining 4% of its charge, 600.0 s old"
    )
    assert rise_words("battery", report) == "battery to 1.00: battery 0 remaining 4% of its charge"


def test_an_index_without_any_measurement_is_explained(new_flight):
    silent = new_flight()
    silent.fly(1.0)
    assert shown(silent, "battery") == "battery 0.50: nothing was measured"


def test_an_index_that_has_lost_all_its_inputs_is_explained(flight):
    flight.silence(*list(flight.sources))
    flight.fly(100.0)
    assert shown(flight, "battery") == "battery 0.50: nothing is measured any more"


@pytest.mark.parametrize(
    ("item", "expected"),
    [
        (InputReport(name="tilt", value=0.35, unit="rad", age_s=0.04, risk=0.5), "20.1°"),
        (InputReport(name="satellites", value=7, unit="", age_s=0.2, risk=0.6), "7"),
        (
            InputReport(name="loss", value=0.125, unit="of packets", age_s=0.2, risk=0.4),
            "12%",
        ),
        (InputReport(name="lost", value=1.0, unit=YES_OR_NO, age_s=0.2, risk=1.0), "yes"),
        (InputReport(name="cell", value=3.456, unit="V", age_s=0.2, risk=0.4), "3.46 V"),
        (InputReport(name="gusts", value=2.34, unit="m/s", age_s=0.2, risk=0.4), "2.3 m/s"),
        (InputReport(name="hdop", value=None, unit="", age_s=None, risk=None), "unknown"),
    ],
    ids=lambda item: getattr(item, "name", item),
)
def test_values_are_shown_in_readable_units(item, expected):
    assert item.reading == expected


@pytest.mark.parametrize(
    ("index", "name", "source", "says", "expected"),
    [
        ("wind", "motor output", "motors", {"pulse_us": (1930, 1500)}, "93% of its range"),
        ("communication", "remote control", "remote_control", {"rssi": 0.3}, "30% of full signal"),
        ("localization", "fix type", "gnss", {"fix_type": 2}, "2 (2D)"),
        (
            *("localization", "position innovation", "estimator"),
            *({"position_innovation": 0.75}, "75% of what is accepted"),
        ),
    ],
)
def test_fractions_and_codes_are_shown_with_their_meaning(
    flight, index, name, source, says, expected
):
    flight.handle(source, **says)
    flight.fly(1.0)
    assert flight.input(index, name).phrase == f"{name} {expected}"


@pytest.mark.parametrize(
    ("state", "expected"), [(1, "1 (ok)"), (2, "2 (low)"), (3, "3 (critical)"), (5, "5 (failed)")]
)
def test_a_charge_state_is_shown_with_its_name(flight, state, expected):
    before = flight.sources["batteries"]
    flight.sources["batteries"] = lambda t: {0: replace(before(t)[0], charge_state=state)}
    flight.fly(0.1)
    item = flight.input("battery", "battery 0 charge state")
    assert item.phrase == f"battery 0 charge state {expected}"


def test_a_yes_or_no_input_is_shown_as_yes(flight):
    flight.handle("estimator", horizontal_position_ok=False)
    flight.fly(10.0)
    assert shown(flight, "localization") == (
        "localization 1.00: estimator without position: yes, 0.0 s old -> 1.00"
    )


def test_wind_by_an_unmeasured_drag_is_marked(new_flight):
    usual, measured = new_flight.healthy(), new_flight.healthy(model=RiskModel(drag_per_s=0.25))
    for flight, remark in ((usual, " (default drag, not measured)"), (measured, "")):
        flight.handle("attitude", pitch_rad=-0.2)
        flight.fly(10.0)
        tilt = flight.input("wind", "wind from tilt")
        assert tilt.phrase == f"wind from tilt {tilt.value:.1f} m/s{remark}"


def test_motor_outputs_alone_do_not_prove_calm_and_are_marked(flight):
    flight.silence("wind", "attitude")
    flight.fly(10.0)
    motors = flight.input("wind", "motor output")
    assert motors.phrase == "motor output 51% of its range (alone it proves no calm)"
    assert motors.risk == RiskModel().unknown


def test_the_value_of_a_silence_is_shown_without_its_age():
    silence = InputReport(name="ground station silence", value=4.0, unit="s", age_s=4.0, risk=0.2)
    assert input_words(silence) == "ground station silence 4.0 s -> 0.20"


def test_weights_are_shown_before_and_after_with_the_contribution_of_each_risk():
    reason = weights_section(Adaptation(base=EQUAL), RiskIndices(wind=0.8))
    # Eq. 9 by hand: 1.4, 0.6, 1.4 of 3.4.
    assert reason.words == (
        "k_S 0.33 -> 0.41 (wind +0.08), k_T 0.33 -> 0.18 (wind -0.16), "
        "k_E 0.33 -> 0.41 (wind +0.08)"
    )


def test_a_calibrated_rule_is_named_with_the_state_of_its_front():
    rule = Adaptation(base=Weights(0.2, 0.6, 0.2), kind=AdaptationKind.CALIBRATED)
    risk = RiskIndices(wind=1.0)
    # Halfway to safety alone; the other weights keep their ratio.
    changes = "k_S 0.20 -> 0.60 (wind +0.40), k_T 0.60 -> 0.30 (wind -0.30), k_E 0.20 -> 0.10"
    text = weights_section(rule, risk).words
    assert text.startswith(f"calibrated, front not known yet: {changes}")
    known = replace(rule, calibration=Calibration.linear(rule.base))
    section = weights_section(known, risk)
    assert section.words.startswith(f"calibrated: {changes}")
    assert section.adaptation == AdaptationEntry(kind="calibrated", calibrated=True)


def test_without_any_risk_the_weights_are_unchanged():
    assert weights_section(Adaptation(base=EQUAL), RiskIndices()).words == (
        "k_S 0.33 -> 0.33, k_T 0.33 -> 0.33, k_E 0.33 -> 0.33"
    )


index = st.floats(0.0, 1.0)


@given(wind=index, communication=index, localization=index, battery=index)
def test_the_contribution_of_a_risk_is_the_difference_to_weights_without_it(
    wind, communication, localization, battery
):
    risk = RiskIndices(
        wind=wind, communication=communication, localization=localization, battery=battery
    )
    reason = weights_section(Adaptation(base=EQUAL), risk)
    assert asdict(reason.adjusted) == asdict(EQUAL.adjusted(risk))
    for changes in asdict(reason.by_risk).values():
        assert sum(changes.values()) == pytest.approx(0.0, abs=1e-9)
    calm = EQUAL.adjusted(
        RiskIndices(communication=communication, localization=localization, battery=battery)
    )
    assert reason.by_risk.wind.time == pytest.approx(reason.adjusted.time - calm.time)
    assert reason.by_risk.wind.time <= 1e-12


def test_the_risk_document_is_valid_json_and_explains_each_index(flight):
    flight.silence("gnss")
    flight.fly(10.0)
    whole = json.loads(json.dumps(asdict(risk_section(flight.estimate)), allow_nan=False))
    assert list(whole) == ["wind", "communication", "localization", "battery"]
    for entry in whole.values():
        for item in entry["inputs"]:
            assert item["known"] == (item["risk"] is not None)
    satellites = next(
        item for item in whole["localization"]["inputs"] if item["name"] == "satellites"
    )
    assert (satellites["value"], satellites["known"]) == (14, False)
    assert satellites["age_s"] == pytest.approx(10.0, abs=0.2)
    assert all(entry["words"].startswith(f"{name} ") for name, entry in whole.items())


def test_an_input_that_no_longer_applies_is_dropped(flight):
    flight.tracking_error_m = 1.9
    flight.fly(10.0)
    assert flight.estimate.report.wind.cause == "tracking error"
    flight.tracking_error_m = None
    flight.fly(60.0)
    assert flight.estimate.report.wind.cause != "tracking error"
    assert flight.estimate.indices.wind < 0.1


def test_an_empty_report_is_explained_as_no_risk():
    assert index_words("wind", 0.0, IndexReport()) == "wind 0.00: no input raises it"


def test_an_input_without_a_value_is_phrased_by_its_name_alone():
    known = InputReport(name="tilt in hover", value=0.2, unit="rad", age_s=0.1, risk=0.0)
    assert known.phrase.startswith("tilt in hover ")
    assert known._replace(value=None, risk=None).phrase == "tilt in hover"

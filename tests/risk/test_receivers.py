"""One satellite receiver or two: the one that counts, and the report of the lost one."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from moar_companion.mavlink.telemetry import Gnss, Telemetry
from moar_companion.risk import InputReport
from moar_companion.risk.receivers import ReceiverMemory, receiver_inputs, trouble
from moar_companion.settings.risk_model import RiskModel

MODEL = RiskModel()
NOW_S = 100.0
NEITHER = (ReceiverMemory(), ReceiverMemory())


def gnss(**changes: object) -> Gnss:
    good = Gnss(
        received_s=NOW_S,
        receiver_s=NOW_S,
        fix_type=3,
        satellites=14,
        hdop=0.7,
        vdop=1.1,
        horizontal_accuracy_m=0.9,
        vertical_accuracy_m=1.8,
    )
    return replace(good, **changes)


def two(first: Gnss, second: Gnss | None, *, better: bool = True, **choice: bool) -> Telemetry:
    return Telemetry(gnss=first, second_gnss=second, better_gnss_taken=better, **choice)


def judged(telemetry: Telemetry, *before: Telemetry) -> dict[str, InputReport]:
    first, second = NEITHER
    for received in (*before, telemetry):
        first, second = first.read(received.gnss), second.read(received.second_gnss)
    reports = receiver_inputs(telemetry, (first, second), NOW_S, MODEL)
    return {report.name: report for report in reports}


def worst(telemetry: Telemetry, *before: Telemetry) -> float:
    risks = [report.risk for report in judged(telemetry, *before).values()]
    return max(risk for risk in risks if risk is not None)


NO_FIX = gnss(fix_type=1)
POOR = gnss(satellites=7)
SILENT = gnss(received_s=NOW_S - 5.0)


@pytest.mark.parametrize("lost", [NO_FIX, SILENT], ids=["no fix", "silent"])
def test_the_better_of_two_receivers_counts_and_the_lost_one_is_reported(lost: Gnss) -> None:
    for telemetry in (two(lost, gnss()), two(gnss(), lost)):
        reports = judged(telemetry)
        assert reports["fix type"].value == 3
        assert reports["receivers lost"].value == 1
        assert worst(telemetry) == reports["receivers lost"].risk == MODEL.receiver_lost
        assert trouble(telemetry, NEITHER, NOW_S) is None


def test_a_poor_receiver_beside_a_good_one_is_no_risk() -> None:
    assert worst(two(POOR, gnss())) == worst(two(gnss(), POOR)) == 0.0
    assert worst(two(POOR, None)) == pytest.approx(0.6)


def test_without_receiver_switching_the_autopilots_first_choice_counts() -> None:
    assert worst(two(POOR, gnss(), better=False)) == pytest.approx(0.6)
    assert worst(two(gnss(), POOR, better=False)) == 0.0
    assert worst(two(gnss(), POOR, better=False, second_gnss_first=True)) == pytest.approx(0.6)
    telemetry = two(NO_FIX, gnss(), better=False)
    assert worst(telemetry) == 1.0
    assert trouble(telemetry, NEITHER, NOW_S) == "GNSS receiver has no 3D fix"


def test_the_loss_of_both_receivers_is_full_risk() -> None:
    telemetry = two(SILENT, NO_FIX)
    assert worst(telemetry) == 1.0
    assert judged(telemetry)["receivers lost"].value == 2
    assert trouble(telemetry, NEITHER, NOW_S) == "GNSS receiver silent for 5.0 s"


def test_a_single_receiver_has_no_receivers_lost_input() -> None:
    assert judged(two(NO_FIX, None))["receivers lost"].risk is None
    assert trouble(two(NO_FIX, None), NEITHER, NOW_S) == "GNSS receiver has no 3D fix"
    assert trouble(Telemetry(), NEITHER, NOW_S) is None


def test_a_second_receiver_with_a_stopped_clock_is_lost() -> None:
    began = gnss(received_s=NOW_S - 2.0, receiver_s=7.0)
    frozen = two(gnss(), gnss(receiver_s=7.0))
    before = two(gnss(), began)
    assert judged(frozen, before)["receivers lost"].value == 1
    memory = ReceiverMemory().read(began).read(gnss(receiver_s=7.0))
    reason = trouble(two(gnss(receiver_s=7.0), None), (memory, NEITHER[1]), NOW_S)
    assert reason == "GNSS receiver stopped 2.0 s ago"


def test_a_receiver_that_stops_reporting_a_value_does_not_become_the_better_one() -> None:
    before = two(gnss(hdop=1.5), gnss(satellites=6))
    after = two(gnss(hdop=1.5), gnss(satellites=None))
    assert judged(after, before)["hdop"].value == 1.5


numbers = st.floats(0.1, 20.0)
receivers = st.builds(
    Gnss,
    received_s=st.just(NOW_S),
    receiver_s=st.none(),
    fix_type=st.integers(2, 6),
    satellites=st.integers(0, 20),
    hdop=numbers,
    vdop=numbers,
    horizontal_accuracy_m=numbers,
    vertical_accuracy_m=numbers,
)
"""Receivers that are there: of 0 (no receiver) from the beginning none is; `WORSE` makes 2 a 1."""
WORSE = {"satellites": -1, "fix_type": -1, "hdop": 1, "vdop": 1, "horizontal_accuracy_m": 1}


@given(first=receivers, second=receivers, better=st.booleans(), name=st.sampled_from(list(WORSE)))
def test_a_worse_receiver_is_never_less_risk(first, second, better, name):
    bad = replace(first, **{name: getattr(first, name) + WORSE[name]})
    assert worst(two(bad, second, better=better)) >= worst(two(first, second, better=better))
    assert worst(two(second, bad, better=better)) >= worst(two(second, first, better=better))


@given(first=receivers, second=receivers)
def test_the_loss_of_one_of_two_is_never_less_risk(first, second):
    silent = replace(second, received_s=NOW_S - 10.0)
    assert worst(two(first, silent)) >= worst(two(first, second))
    assert worst(two(silent, first)) >= worst(two(second, first))


@given(first=receivers, second=receivers, noise=st.floats(-0.01, 0.01))
def test_a_little_noise_changes_the_risk_little(first, second, noise):
    noisy = replace(first, hdop=first.hdop + noise, vdop=first.vdop + noise)
    before = worst(two(first, second))
    assert worst(two(noisy, second)) == pytest.approx(before, abs=0.01)


@pytest.mark.parametrize(
    ("fix_type", "reported_m", "counts_m"),
    [(3, 1.0, 1.0), (2, 1.0, 2.5), (2, 50.0, 50.0), (0, 0.0, None)],
)
def test_a_receiver_without_a_3d_fix_is_no_more_accurate_than_before(
    fix_type: int, reported_m: float, counts_m: float | None
) -> None:
    before = two(gnss(horizontal_accuracy_m=2.5), None)
    now = two(gnss(fix_type=fix_type, horizontal_accuracy_m=reported_m), None)
    assert judged(now, before)["receiver accuracy"].value == counts_m

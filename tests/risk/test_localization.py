from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from moar_companion.mavlink.telemetry import (
    Estimator,
    LandedState,
    MagneticField,
    Odometry,
    Telemetry,
)
from moar_companion.risk import RiskEstimate, localization, update
from moar_companion.risk.localization import LocalizationMemory, PlaceByLine, remember
from moar_companion.settings.risk_model import RiskModel


def test_a_good_fix_settles_to_no_risk(flight):
    assert flight.estimate.indices.localization == pytest.approx(0.0, abs=1e-4)


@pytest.mark.parametrize(
    ("source", "changes", "name"),
    [
        pytest.param("gnss", {"fix_type": 2}, "fix type", id="fix lost"),
        pytest.param("gnss", {"satellites": 4}, "satellites", id="satellites lost"),
        pytest.param("gnss", {"hdop": 3.5}, "hdop", id="bad geometry"),
        pytest.param("gnss", {"vdop": 6.0}, "vdop", id="bad geometry above"),
        pytest.param("gnss", {"horizontal_accuracy_m": 15.0}, "receiver accuracy", id="jamming"),
        pytest.param(
            "gnss", {"vertical_accuracy_m": 9.0}, "receiver height accuracy", id="heights unknown"
        ),
        pytest.param(
            "estimator", {"horizontal_accuracy_m": 15.0}, "estimator accuracy", id="dead reckoning"
        ),
        pytest.param(
            "estimator",
            {"horizontal_position_ok": False},
            "estimator without position",
            id="the estimator gives up",
        ),
        *(
            pytest.param(
                "estimator", {f"{name}_innovation": 1.0}, f"{name} innovation", id=f"{name} refused"
            )
            for name in ("velocity", "position", "height", "compass")
        ),
    ],
)
def test_one_bad_input_raises_the_risk(flight, source, changes, name):
    flight.handle(source, **changes)
    assert flight.fly(3.0).indices.localization > 0.99
    assert flight.estimate.report.localization.value == 1.0
    assert flight.estimate.report.localization.worst == name


def test_fewer_satellites_raise_the_risk_by_steps(flight):
    risks = []
    for satellites in range(11, 3, -1):
        flight.handle("gnss", satellites=satellites)
        flight.fly(5.0)
        risks.append(flight.estimate.report.localization.value)
    assert risks == pytest.approx([0.0, 0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.0])


def test_a_receiver_with_a_stopped_clock_raises_the_risk(flight):
    frozen_s = flight.now_s
    flight.handle("gnss", receiver_s=frozen_s)
    assert flight.fly(1.5).indices.localization < 0.01
    assert flight.fly(1.5).indices.localization > 0.9
    assert flight.estimate.report.localization.worst == "receiver clock stopped"
    flight.handle("gnss")  # the receiver works again
    assert flight.fly(1.0).indices.localization > 0.7
    assert flight.fly(30.0).indices.localization < 0.01


def test_a_receiver_that_measures_once_a_second_is_not_stopped(flight):
    healthy = flight.sources["gnss"]
    flight.sources["gnss"] = lambda t: replace(healthy(t), receiver_s=float(int(t)))
    assert flight.fly(20.0).indices.localization < 0.01


def test_a_receiver_without_a_clock_is_judged_by_its_other_values(new_flight, healthy):
    source = healthy["gnss"]
    healthy["gnss"] = lambda t: replace(source(t), receiver_s=None)
    flight = new_flight(**healthy)
    assert flight.fly(60.0).indices.localization < 0.01
    assert flight.input("localization", "receiver clock stopped").risk is None


def test_an_accuracy_of_zero_is_unknown(flight):
    flight.handle("gnss", horizontal_accuracy_m=0.0, hdop=0.0)
    flight.fly(1.0)
    assert flight.input("localization", "receiver accuracy").risk is None
    assert flight.input("localization", "hdop").risk is None


def test_without_any_receiver_or_estimator_the_risk_stays_unknown(new_flight, healthy):
    for name in ("gnss", "estimator"):
        del healthy[name]
    blind = new_flight(**healthy)
    assert blind.fly(60.0).indices.localization == RiskModel().unknown


def test_a_silent_receiver_and_estimator_make_the_risk_unknown(flight):
    flight.silence("gnss", "estimator")
    assert flight.fly(2.5).indices.localization < 0.01
    assert flight.fly(1.0).indices.localization >= RiskModel().unknown
    assert flight.estimate.report.localization.value is None
    assert flight.estimate.report.localization.ever_known


@pytest.mark.parametrize(
    ("innovation", "risk"),
    [
        pytest.param(0.5, 0.0, id="PX4 arms"),
        pytest.param(0.8, 0.6, id="ArduPilot lands"),
        pytest.param(1.3, 1.0, id="refused"),
    ],
)
def test_a_large_compass_innovation_raises_the_risk(flight, innovation, risk):
    flight.handle("estimator", compass_innovation=innovation)
    flight.fly(3.0)
    assert flight.input("localization", "compass innovation").risk == pytest.approx(risk)


def odometry(flight, *, resets=0, accuracy_m=0.3):
    """Adds odometry from now on, with a number of resets one second apart."""
    since_s = flight.now_s
    flight.sources["odometry"] = lambda t: Odometry(
        received_s=t,
        reset_counter=(250 + min(resets, int(t - since_s))) % 256,
        horizontal_accuracy_m=accuracy_m,
    )


def test_repeated_estimator_resets_raise_the_risk(flight):
    odometry(flight, resets=4)
    flight.fly(5.0)
    resets = flight.input("localization", "position resets")
    assert (resets.value, resets.risk) == (4, 1.0)
    flight.fly(9.0)
    assert flight.input("localization", "position resets").value == 1
    flight.fly(2.0)
    assert flight.input("localization", "position resets").value == 0


def test_a_single_reset_is_no_risk(flight):
    odometry(flight, resets=1)
    flight.fly(5.0)
    assert flight.input("localization", "position resets").value == 1
    assert flight.estimate.indices.localization < 0.01


def test_a_reset_counter_that_restarts_with_the_autopilot_is_no_reset(flight):
    odometry(flight)
    flight.fly(1.0)
    flight.silence("odometry")
    flight.telemetry = replace(flight.telemetry, odometry=None)
    flight.fly(1.0)
    flight.handle("local_position", boot_s=0.5)
    flight.sources["odometry"] = lambda t: Odometry(
        received_s=t, reset_counter=4, horizontal_accuracy_m=0.3
    )
    flight.fly(1.0)
    assert flight.input("localization", "position resets").value == 0


def test_a_poor_odometry_accuracy_raises_the_risk(flight):
    odometry(flight, accuracy_m=6.0)
    assert flight.fly(3.0).indices.localization > 0.99
    assert flight.estimate.report.localization.worst == "odometry accuracy"


@pytest.mark.parametrize("source", ["estimator", "odometry"])
def test_a_poor_height_accuracy_raises_the_risk(flight, source):
    odometry(flight)
    usual = flight.sources[source]
    flight.sources[source] = lambda t: replace(usual(t), vertical_accuracy_m=6.0)
    flight.fly(3.0)
    height = flight.input("localization", f"{source} height accuracy")
    assert (height.value, height.risk) == (6.0, pytest.approx(2.0 / 3.0))
    assert flight.estimate.report.localization.worst == height.name


def test_a_height_accuracy_alone_leaves_the_risk_unknown(new_flight, healthy):
    for name in ("gnss", "estimator"):
        del healthy[name]
    blind = new_flight(**healthy)
    blind.sources["odometry"] = lambda t: Odometry(
        received_s=t, reset_counter=0, horizontal_accuracy_m=None, vertical_accuracy_m=0.2
    )
    assert blind.fly(10.0).indices.localization == RiskModel().unknown


def field(flight, strength_gauss):
    flight.sources["magnetic_field"] = lambda t: MagneticField(
        received_s=t, strength_gauss=strength_gauss(t)
    )


def test_a_changed_magnetic_field_raises_the_risk(flight):
    field(flight, lambda t: 0.5 + 0.05 * math.sin(9.0 * t))  # motors, noise
    assert flight.fly(60.0).indices.localization < 0.01
    field(flight, lambda _: 0.69)
    flight.fly(2.0)
    change = flight.input("localization", "magnetic field change")
    assert change.value == pytest.approx(0.38, abs=0.02)
    assert flight.estimate.report.localization.worst == "magnetic field change"
    assert flight.estimate.indices.localization > 0.4
    field(flight, lambda _: 0.25)
    assert flight.fly(3.0).indices.localization > 0.9


def test_a_magnetic_field_received_for_seconds_has_no_mean_yet(flight):
    field(flight, lambda _: 0.5)
    flight.fly(4.0)
    assert flight.input("localization", "magnetic field change").risk is None
    flight.fly(2.0)
    assert flight.input("localization", "magnetic field change").risk == 0.0


def test_the_mean_field_is_of_the_flight_and_an_inspection_does_not_shift_it(flight):
    field(flight, lambda _: 0.5)
    flight.fly(120.0, step_s=0.5)
    field(flight, lambda _: 0.75)
    flight.fly(60.0, step_s=0.5)
    assert flight.input("localization", "magnetic field change").value > 0.25


def test_a_field_that_stays_wrong_becomes_the_usual_one_slowly(flight):
    field(flight, lambda _: 0.5)
    flight.fly(300.0, step_s=0.5)
    field(flight, lambda _: 0.8)
    assert flight.fly(10.0).indices.localization > 0.95
    assert flight.fly(300.0, step_s=0.5).indices.localization > 0.7
    field(flight, lambda _: 0.5)
    assert flight.fly(40.0).indices.localization < 0.01


def test_a_mean_field_learned_over_steel_is_corrected_in_minutes(flight):
    field(flight, lambda _: 0.85)
    flight.fly(35.0)
    field(flight, lambda _: 0.45)
    assert flight.fly(10.0).indices.localization > 0.7
    assert flight.fly(600.0, step_s=0.5).indices.localization < 0.01


@pytest.mark.parametrize("state", [LandedState.ON_GROUND, LandedState.IN_AIR])
def test_each_takeoff_and_landing_restarts_the_mean_field(flight, state):
    other = {LandedState.ON_GROUND: LandedState.IN_AIR, LandedState.IN_AIR: LandedState.ON_GROUND}
    flight.handle("landed", state=other[state])
    field(flight, lambda _: 0.5)
    flight.fly(60.0)
    flight.handle("landed", state=state)
    field(flight, lambda _: 0.8)
    assert flight.fly(60.0).indices.localization < 0.01


def test_the_field_near_the_pad_does_not_enter_the_mean_field(flight):
    since_s = flight.now_s
    field(flight, lambda t: 0.8 if t < since_s + 8.0 else 0.5)
    flight.fly(60.0)
    assert flight.input("localization", "magnetic field change").value < 0.25


def test_an_update_without_odometry_keeps_the_counted_resets(flight):
    odometry(flight, resets=5)
    flight.fly(4.5)
    assert flight.input("localization", "position resets").value == 4
    received = flight.sources["odometry"]
    flight.sources["odometry"] = lambda _: None
    flight.fly(0.2)
    flight.sources["odometry"] = received
    flight.fly(0.5)
    assert flight.input("localization", "position resets").value == 5


def test_a_steady_field_and_no_resets_alone_leave_the_risk_unknown(new_flight, healthy):
    for name in ("gnss", "estimator"):
        del healthy[name]
    blind = new_flight(**healthy)
    field(blind, lambda _: 0.5)
    odometry(blind, accuracy_m=None)
    assert blind.fly(60.0).indices.localization == RiskModel().unknown
    assert not blind.estimate.report.localization.ever_known


def test_the_second_receiver_takes_over(flight):
    first = flight.sources["gnss"]
    flight.sources["second_gnss"] = first
    flight.sources["better_gnss_taken"] = lambda _: True
    flight.fly(5.0)
    flight.handle("gnss", fix_type=0, satellites=None, hdop=None)
    after = flight.fly(10.0).indices.localization
    assert after == pytest.approx(RiskModel().receiver_lost, abs=0.01)
    assert flight.estimate.report.localization.worst == "receivers lost"
    flight.silence("second_gnss")
    assert flight.fly(10.0).indices.localization > 0.99


NOW_S = 100.0
estimators = st.builds(
    Estimator,
    received_s=st.just(NOW_S),
    flags=st.just(0),
    horizontal_position_ok=st.just(True),
    horizontal_accuracy_m=st.floats(0.1, 8.0),
    velocity_innovation=st.floats(0.0, 2.0),
    position_innovation=st.floats(0.0, 2.0),
    height_innovation=st.floats(0.0, 2.0),
    compass_innovation=st.floats(0.0, 2.0),
)
MEASURES = (
    "horizontal_accuracy_m",
    "velocity_innovation",
    "position_innovation",
    "height_innovation",
    "compass_innovation",
)


def worst(telemetry, memory=None):
    memory = remember(memory or LocalizationMemory(), telemetry, RiskModel())
    reports = localization.inputs(telemetry, NOW_S, RiskModel(), memory)
    risks = [report.risk for report in reports if report.risk is not None]
    assert all(0.0 <= risk <= 1.0 for risk in risks)
    return max(risks)


@given(estimator=estimators, name=st.sampled_from(MEASURES), more=st.floats(0.0, 2.0))
def test_a_worse_estimator_is_never_less_risk(estimator, name, more):
    bad = replace(estimator, **{name: getattr(estimator, name) + more})
    assert worst(Telemetry(estimator=bad)) >= worst(Telemetry(estimator=estimator))


@given(estimator=estimators, name=st.sampled_from(MEASURES), noise=st.floats(-0.01, 0.01))
def test_a_little_noise_changes_the_risk_little(estimator, name, noise):
    noisy = replace(estimator, **{name: getattr(estimator, name) + noise})
    before = worst(Telemetry(estimator=estimator))
    assert worst(Telemetry(estimator=noisy)) == pytest.approx(before, abs=0.025)


@given(
    strengths=st.lists(st.floats(allow_nan=True, allow_infinity=True), min_size=1, max_size=20),
    estimator=estimators,
)
def test_any_field_strength_gives_a_risk_between_0_and_1(strengths, estimator):
    memory = LocalizationMemory()
    for number, strength in enumerate(strengths):
        magnetic = MagneticField(
            received_s=NOW_S - len(strengths) + number + 1, strength_gauss=strength
        )
        telemetry = Telemetry(estimator=estimator, magnetic_field=magnetic)
        memory = remember(memory, telemetry, RiskModel())
        assert 0.0 <= worst(telemetry, memory) <= 1.0


@given(strengths=st.tuples(st.floats(0.5, 2.0), st.floats(0.5, 2.0)))
def test_a_greater_change_of_the_field_is_never_less_risk(strengths):
    estimator = Estimator(
        received_s=NOW_S, flags=0, horizontal_position_ok=True, horizontal_accuracy_m=None
    )
    calm = LocalizationMemory()
    for second in range(20):
        received = MagneticField(received_s=NOW_S - 20.0 + second, strength_gauss=0.5)
        calm = remember(calm, Telemetry(magnetic_field=received), RiskModel())
    less, more = (
        worst(
            Telemetry(
                estimator=estimator,
                magnetic_field=MagneticField(received_s=NOW_S, strength_gauss=strength),
            ),
            calm,
        )
        for strength in sorted(strengths)
    )
    assert less <= more


def test_the_risk_of_an_accuracy_is_less_only_while_the_line_is_seen():
    """The estimator is silent from 2 s on, the line out of sight from 7 s on."""
    model, estimate = RiskModel(), RiskEstimate.unknown(RiskModel())
    targets = []
    for now_s in (0.0, 1.0, 2.0, 4.0, 6.0, 7.0, 8.0):
        estimator = Estimator(
            received_s=min(now_s, 2.0),
            flags=0x37F,
            horizontal_position_ok=True,
            horizontal_accuracy_m=2.9,
        )
        by_line = PlaceByLine(
            received_s=now_s, uncertainty_m=0.15 if now_s < 7.0 else None, off_m=0.0, wires=3
        )
        telemetry = Telemetry(estimator=estimator)
        estimate = update(estimate, telemetry, now_s, model=model, cruise_mps=3.0, by_line=by_line)
        targets.append(estimate.report.localization.target)
    alone = model.horizontal_accuracy_m.fraction(2.9)
    assert targets[:5] == [0.0] * 5
    assert targets[5:] == pytest.approx([alone] * 2)

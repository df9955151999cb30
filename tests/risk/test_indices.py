from __future__ import annotations

import math
from dataclasses import fields, replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moar_companion.mavlink import autopilots
from moar_companion.mavlink.radio import Radio
from moar_companion.mavlink.telemetry import (
    Attitude,
    AutopilotStatus,
    Battery,
    Estimator,
    Gnss,
    Home,
    Landed,
    LandedState,
    LinkNode,
    LinkStatistics,
    LocalPosition,
    MagneticField,
    MotorOutputs,
    MotorSpeeds,
    Odometry,
    PeerHeartbeat,
    RemoteControl,
    Telemetry,
    Wind,
)
from moar_companion.risk import RiskEstimate, update
from moar_companion.risk.power import Demands
from moar_companion.settings.risk_model import RiskModel
from moar_companion.types import UNKNOWN, GeodeticPoint

INDICES = ("wind", "communication", "localization", "battery")
MODEL = RiskModel(cells=4)
NOW_S = 100.0

received = st.floats(80.0, NOW_S)
wild = st.floats(allow_nan=True, allow_infinity=True)
maybe_wild = st.none() | wild
vectors = st.tuples(wild, wild, wild)
bytes_ = st.none() | st.integers(0, 254)
receivers = st.builds(
    Gnss,
    received_s=received,
    receiver_s=maybe_wild,
    fix_type=st.integers(0, 8),
    satellites=st.none() | st.integers(0, 60),
    hdop=maybe_wild,
    vdop=maybe_wild,
    horizontal_accuracy_m=maybe_wild,
    vertical_accuracy_m=maybe_wild,
)
wild_telemetry = st.builds(
    Telemetry,
    autopilot=st.none()
    | st.builds(
        AutopilotStatus,
        received_s=received,
        system_id=st.just(1),
        component_id=st.just(1),
        kind=st.sampled_from([*autopilots.PROFILES, UNKNOWN]),
        armed=st.booleans(),
        custom_mode=st.just(0),
        mode=st.just(""),
        ours=st.booleans(),
        failsafe=st.booleans(),
    ),
    attitude=st.none()
    | st.builds(Attitude, received_s=received, roll_rad=wild, pitch_rad=wild, yaw_rad=wild),
    local_position=st.none()
    | st.builds(
        LocalPosition,
        received_s=received,
        boot_s=received,
        position_ned_m=vectors,
        velocity_ned_mps=vectors,
    ),
    home=st.none()
    | st.builds(
        Home,
        received_s=received,
        point=st.just(GeodeticPoint(latitude_deg=0.0, longitude_deg=0.0, altitude_amsl_m=0.0)),
        position_ned_m=vectors,
    ),
    landed=st.none() | st.builds(Landed, received_s=received, state=st.sampled_from(LandedState)),
    batteries=st.dictionaries(
        st.integers(0, 2),
        st.builds(
            Battery,
            received_s=received,
            remaining=maybe_wild,
            voltage_v=maybe_wild,
            current_a=maybe_wild,
            charge_state=st.none() | st.integers(0, 9),
        ),
        max_size=3,
    ),
    gnss=st.none() | receivers,
    second_gnss=st.none() | receivers,
    second_gnss_first=st.booleans(),
    better_gnss_taken=st.booleans(),
    estimator=st.none()
    | st.builds(
        Estimator,
        received_s=received,
        flags=st.just(0),
        horizontal_position_ok=st.booleans(),
        horizontal_accuracy_m=maybe_wild,
        velocity_innovation=maybe_wild,
        position_innovation=maybe_wild,
        height_innovation=maybe_wild,
        compass_innovation=maybe_wild,
    ),
    odometry=st.none()
    | st.builds(
        Odometry,
        received_s=received,
        reset_counter=st.integers(0, 255),
        horizontal_accuracy_m=maybe_wild,
    ),
    magnetic_field=st.none() | st.builds(MagneticField, received_s=received, strength_gauss=wild),
    motor_speeds=st.none()
    | st.builds(
        MotorSpeeds,
        received_s=received,
        rpm=st.lists(st.integers(0, 1_000_000), max_size=4).map(tuple),
    ),
    motor_min_us=maybe_wild,
    motor_max_us=maybe_wild,
    link_node=st.none()
    | st.builds(
        LinkNode,
        received_s=received,
        packets_received=st.integers(0, 10_000),
        packets_lost=st.integers(0, 10_000),
    ),
    wind=st.none() | st.builds(Wind, received_s=received, velocity_ned_mps=vectors),
    radio=st.none()
    | st.builds(
        Radio,
        received_s=received,
        rssi=bytes_,
        remote_rssi=bytes_,
        noise=bytes_,
        remote_noise=bytes_,
        receive_errors=st.just(0),
        transmit_buffer_percent=st.none() | st.integers(0, 100),
    ),
    remote_control=st.none() | st.builds(RemoteControl, received_s=received, rssi=maybe_wild),
    motors=st.none()
    | st.builds(
        MotorOutputs,
        received_s=received,
        pulse_us=st.lists(st.integers(0, 3000), max_size=8).map(tuple),
    ),
    ground_station=st.none()
    | st.builds(PeerHeartbeat, received_s=received, system_id=st.just(255)),
    link=st.none()
    | st.builds(
        LinkStatistics,
        received_s=received,
        packets_received=st.integers(0, 10_000),
        packets_lost=st.integers(0, 10_000),
    ),
)


def step(estimate: RiskEstimate, telemetry: Telemetry, now_s: float) -> RiskEstimate:
    return update(estimate, telemetry, now_s, model=MODEL, cruise_mps=5.0)


@given(
    steps=st.lists(
        st.tuples(wild_telemetry, st.floats(-1.0, 100.0)),
        min_size=1,
        max_size=6,
    )
)
def test_indices_stay_between_0_and_1_for_any_telemetry(steps):
    estimate, now_s = RiskEstimate.unknown(MODEL), NOW_S
    for telemetry, elapsed_s in steps:
        now_s += elapsed_s  # a clock may go back
        estimate = step(estimate, telemetry, now_s)
        for name in INDICES:
            assert 0.0 <= getattr(estimate.indices, name) <= 1.0
            report = getattr(estimate.report, name)
            risks = [found.risk for found in report.inputs if found.risk is not None]
            assert all(0.0 <= risk <= 1.0 for risk in risks)
            assert report.value == max(risks, default=None)
            assert (report.worst is None) == (report.value is None)
            assert all(found.value is None or math.isfinite(found.value) for found in report.inputs)


@given(telemetry=wild_telemetry, silence_s=st.floats(0.0, 1000.0))
def test_the_loss_of_all_telemetry_never_lowers_an_index(telemetry, silence_s):
    received = step(step(RiskEstimate.unknown(MODEL), telemetry, NOW_S), telemetry, NOW_S + 0.5)
    after = step(received, Telemetry(), NOW_S + 0.5 + silence_s)
    for name in INDICES:
        assert getattr(after.indices, name) >= getattr(received.indices, name)
        assert getattr(after.indices, name) >= MODEL.unknown


NAMES = sorted({field.name for field in fields(Telemetry)} - {"global_position", "local_origin"})
needs_wh = st.fixed_dictionaries(
    {name: st.floats(0.0, 150.0) for name in ("finish_wh", "exit_wh", "evacuation_wh")}
)


@pytest.mark.slow
@settings(max_examples=30, deadline=None)
@given(
    silent=st.sets(st.sampled_from(NAMES), min_size=1),
    erased=st.booleans(),
    roll_rad=st.floats(0.0, 0.6),
    wind_mps=st.floats(0.0, 15.0),
    satellites=st.integers(3, 15),
    remaining=st.floats(0.0, 1.0),
    rssi=st.integers(40, 200),
    loss=st.integers(0, 40),
    duration_s=st.floats(0.1, 100.0),
    needs=needs_wh,
    unknown_needs=st.sets(st.sampled_from(["finish_wh", "exit_wh", "evacuation_wh"])),
)
def test_the_loss_of_sources_never_lowers_a_settled_index(
    new_flight,
    silent,
    erased,
    roll_rad,
    wind_mps,
    satellites,
    remaining,
    rssi,
    loss,
    duration_s,
    needs,
    unknown_needs,
):
    flight = new_flight.healthy(model=MODEL)
    flight.demands = Demands(flown=True, **needs)
    flight.handle("attitude", roll_rad=roll_rad)
    flight.handle("wind", velocity_ned_mps=(wind_mps, 0.0, 0.0))
    flight.handle("gnss", satellites=satellites)
    flight.handle("radio", rssi=rssi)
    flight.sources["batteries"] = lambda t: {
        0: Battery(
            received_s=t, remaining=remaining, voltage_v=15.0, current_a=None, charge_state=1
        )
    }
    flight.sources["link"] = lambda t: LinkStatistics(
        received_s=t, packets_received=50 * round(2 * t), packets_lost=loss * round(2 * t)
    )
    before = flight.fly(100.0, step_s=0.5).indices
    flight.silence(*silent)
    flight.demands = replace(flight.demands, **dict.fromkeys(unknown_needs))
    if erased:
        nothing = {name: getattr(Telemetry(), name) for name in silent}
        flight.telemetry = replace(flight.telemetry, **nothing)
    while duration_s > 0.0:
        duration_s -= 0.5
        after = flight.fly(0.5, step_s=0.5).indices
        assert all(getattr(after, name) >= getattr(before, name) - 1e-6 for name in INDICES)


WORSE = [
    pytest.param("wind", "velocity_ned_mps", (2.0, 0.0, 0.0), (8.0, 0.0, 0.0), id="wind"),
    pytest.param("attitude", "pitch_rad", 0.1, 0.35, id="lean"),
    pytest.param("motors", "pulse_us", (1500, 1600), (1500, 1900), id="motors"),
    pytest.param("radio", "rssi", 100, 60, id="signal"),
    pytest.param("radio", "noise", 60, 150, id="noise"),
    pytest.param("radio", "transmit_buffer_percent", 60, 20, id="transmit buffer"),
    pytest.param("remote_control", "rssi", 0.5, 0.3, id="remote control"),
    pytest.param("gnss", "satellites", 9, 6, id="satellites"),
    pytest.param("gnss", "hdop", 1.0, 2.0, id="hdop"),
    pytest.param("gnss", "fix_type", 3, 1, id="fix"),
    pytest.param("gnss", "horizontal_accuracy_m", 1.5, 3.0, id="receiver accuracy"),
    pytest.param("estimator", "horizontal_accuracy_m", 1.5, 3.0, id="estimator accuracy"),
    pytest.param("estimator", "horizontal_position_ok", True, False, id="estimator"),
    pytest.param(
        "local_position", "position_ned_m", (100.0, 0.0, 0.0), (9000.0, 0.0, 0.0), id="way home"
    ),
]


@pytest.mark.parametrize(("source", "name", "good", "bad"), WORSE)
def test_a_worse_input_never_gives_a_lower_index(new_flight, healthy, source, name, good, bad):
    better, worse = new_flight(**healthy), new_flight(**healthy)
    better.handle(source, **{name: good})
    worse.handle(source, **{name: bad})
    for _ in range(100):
        low, high = better.fly(0.1).indices, worse.fly(0.1).indices
        assert all(getattr(low, index) <= getattr(high, index) for index in INDICES)
    assert low != high


@given(values=st.tuples(st.floats(0.0, 20.0), st.floats(0.0, 20.0)))
def test_more_wind_is_never_less_risk(values):
    low, high = sorted(values)
    first, second = (
        step(
            RiskEstimate.unknown(MODEL),
            Telemetry(wind=Wind(received_s=NOW_S, velocity_ned_mps=(0.0, -wind, 0.0))),
            NOW_S,
        )
        for wind in (low, high)
    )
    assert first.report.wind.value <= second.report.wind.value


def test_before_any_telemetry_every_index_is_unknown():
    estimate = step(RiskEstimate.unknown(MODEL), Telemetry(), NOW_S)
    assert set(estimate.indices.as_dict().values()) == {MODEL.unknown}
    assert not any(getattr(estimate.report, name).ever_known for name in INDICES)
    assert all(getattr(estimate.report, name).worst is None for name in INDICES)


def test_an_index_rises_fast(flight):
    flight.handle("gnss", fix_type=0)
    assert flight.fly(0.1).indices.localization == pytest.approx(0.18, abs=0.01)
    assert flight.fly(0.9).indices.localization > 0.85
    assert flight.fly(2.0).indices.localization > 0.99


def test_an_index_falls_slowly(flight):
    flight.handle("gnss", fix_type=0)
    flight.fly(10.0)
    flight.handle("gnss")
    assert flight.fly(1.0).indices.localization == pytest.approx(0.82, abs=0.01)
    assert flight.fly(4.0).indices.localization == pytest.approx(0.37, abs=0.01)


def test_the_rate_of_updates_does_not_matter(new_flight, healthy):
    often, seldom = new_flight(**healthy), new_flight(**healthy)
    for flight, step_s in ((often, 0.02), (seldom, 0.2)):
        flight.fly(20.0, step_s=step_s)
        flight.handle("gnss", satellites=6)
        flight.fly(1.0, step_s=step_s)
    assert often.estimate.indices.localization == pytest.approx(
        seldom.estimate.indices.localization, abs=0.03
    )


def test_a_stale_input_keeps_its_risk_while_other_inputs_remain(flight):
    flight.handle("wind", velocity_ned_mps=(9.0, 0.0, 0.0))
    before = flight.fly(10.0).indices.wind
    flight.silence("wind")
    assert flight.fly(60.0).indices.wind >= before  # a calm lean does not replace the reported wind
    assert flight.input("wind", "wind reported").risk is None
    flight.handle("wind", velocity_ned_mps=(1.0, 0.0, 0.0))
    assert flight.fly(60.0).indices.wind < 0.01  # only a new report lowers it


def test_the_risk_of_a_single_packet_is_held_until_the_next_one(flight):
    flight.handle("gnss", satellites=6)
    flight.fly(0.1)
    flight.silence("gnss")
    assert flight.fly(10.0).indices.localization == pytest.approx(0.8, abs=0.01)


def test_the_inputs_of_an_index_have_distinct_names_and_ages(flight):
    report = flight.estimate.report
    for name in INDICES:
        inputs = getattr(report, name).inputs
        assert len({found.name for found in inputs}) == len(inputs)
        assert all(found.age_s is None or found.age_s >= 0.0 for found in inputs)

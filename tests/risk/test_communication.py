from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from moar_companion.mavlink.radio import Radio
from moar_companion.mavlink.telemetry import (
    LandedState,
    LinkNode,
    LinkStatistics,
    PeerHeartbeat,
    Readiness,
    RemoteControl,
    Telemetry,
)
from moar_companion.risk import communication
from moar_companion.risk.communication import CommunicationMemory
from moar_companion.settings.risk_model import RiskModel


def test_a_good_link_settles_to_no_risk(flight):
    assert flight.estimate.indices.communication == pytest.approx(0.0, abs=1e-4)


def test_a_silent_ground_station_raises_the_risk(flight):
    flight.silence("ground_station")
    assert flight.fly(2.5).indices.communication < 0.01  # two heartbeats may be lost
    assert flight.fly(3.5).indices.communication > 0.3  # 6 s: rising
    flight.fly(4.1)  # 10 s: the measured risk is 1, the index close behind
    assert flight.estimate.report.communication.value == 1.0
    assert flight.estimate.report.communication.worst == "ground station silence"
    assert flight.estimate.indices.communication > 0.93
    assert flight.fly(600.0, step_s=1.0).indices.communication == pytest.approx(1.0)


def test_a_returned_ground_station_lowers_the_risk(flight):
    flight.silence("ground_station")
    flight.fly(20.0)
    flight.handle("ground_station")
    assert flight.fly(1.0).indices.communication > 0.8  # one heartbeat is not enough
    assert flight.fly(25.0).indices.communication < 0.01


def test_a_ground_station_that_was_never_received_is_unknown(new_flight, healthy):
    for name in ("ground_station", "radio", "remote_control", "link"):
        del healthy[name]
    alone = new_flight(**healthy)
    assert alone.fly(60.0).indices.communication == RiskModel().unknown
    assert alone.estimate.report.communication.value is None
    assert not alone.estimate.report.communication.ever_known


def test_a_good_link_to_the_autopilot_alone_leaves_the_risk_unknown(new_flight, healthy):
    for name in ("ground_station", "radio", "remote_control"):
        del healthy[name]
    alone = new_flight(**healthy)
    assert alone.fly(60.0).indices.communication == RiskModel().unknown
    assert alone.estimate.report.communication.worst == "known links to the ground"
    assert alone.input("communication", "known links to the ground").value == 0
    assert alone.input("communication", "packet loss").risk == 0.0


def test_a_free_radio_buffer_alone_leaves_the_risk_unknown(new_flight, healthy):
    for name in ("ground_station", "remote_control"):
        del healthy[name]
    flight = new_flight(**healthy)
    flight.handle("radio", rssi=None, remote_rssi=None)
    assert flight.fly(60.0).indices.communication == RiskModel().unknown
    flight.handle("radio")
    assert flight.fly(60.0).indices.communication < 0.01


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        pytest.param({"rssi": 48}, "radio margin here", id="weak here"),
        pytest.param({"remote_rssi": 50}, "radio margin there", id="weak there"),
        pytest.param({"noise": 175}, "radio margin here", id="noisy here"),
        pytest.param({"transmit_buffer_percent": 12}, "radio transmit buffer", id="buffer full"),
    ],
)
def test_a_bad_radio_raises_the_risk(flight, changes, name):
    flight.handle("radio", **changes)
    assert flight.fly(3.0).indices.communication > 0.95
    assert flight.estimate.report.communication.worst == name


def test_a_weak_remote_control_raises_the_risk(flight):
    flight.handle("remote_control", rssi=0.2)
    assert flight.fly(3.0).indices.communication > 0.95


def test_a_radio_margin_that_is_no_longer_reported_does_not_lower_the_risk(flight):
    flight.handle("radio", remote_rssi=60)
    before = flight.fly(10.0).indices.communication
    flight.handle("radio", remote_rssi=None)
    assert flight.fly(60.0).indices.communication >= before


def losing(now_s: float, *, since_s: float, every: int) -> LinkStatistics:
    """100 packets a second; one of `every` is lost after `since_s`."""
    lost = round(100.0 * max(0.0, now_s - since_s)) // every
    return LinkStatistics(
        received_s=now_s, packets_received=round(100.0 * now_s) - lost, packets_lost=lost
    )


def test_a_loss_of_one_packet_in_five_raises_the_risk(flight):
    since_s = flight.now_s
    flight.sources["link"] = lambda t: losing(t, since_s=since_s, every=5)
    flight.fly(10.0)
    assert flight.input("communication", "packet loss").value == pytest.approx(0.2, abs=0.01)
    assert flight.estimate.indices.communication > 0.5


def test_losses_expire_after_the_window(flight):
    since_s = flight.now_s
    flight.sources["link"] = lambda t: losing(min(t, since_s + 5), since_s=since_s, every=5)
    flight.fly(5.0)
    lost = flight.telemetry.link.packets_lost
    flight.sources["link"] = lambda t: LinkStatistics(
        received_s=t, packets_received=round(100.0 * t), packets_lost=lost
    )
    flight.fly(6.0)
    assert flight.input("communication", "packet loss").value == 0.0


def test_packet_counts_that_restart_are_no_loss(flight):
    start_s = flight.now_s
    flight.sources["link"] = lambda t: LinkStatistics(
        received_s=t, packets_received=round(100.0 * (t - start_s)), packets_lost=0
    )
    flight.fly(0.1)
    assert flight.input("communication", "packet loss").risk is None
    flight.fly(5.0)
    assert flight.input("communication", "packet loss").value == 0.0


def test_a_late_packet_ends_no_window(flight):
    # A packet counted as lost arrives later.
    flight.sources["link"] = lambda t: LinkStatistics(
        received_s=t, packets_received=round(100.0 * t), packets_lost=round(10.0 * t) % 2
    )
    flight.fly(5.0)
    assert flight.input("communication", "packet loss").value == pytest.approx(0.0, abs=0.005)
    assert flight.estimate.indices.communication < 0.01


def test_packets_lost_towards_the_autopilot_raise_the_risk(flight):
    since_s = flight.now_s
    flight.sources["link_node"] = lambda t: LinkNode(
        received_s=t,
        packets_received=round(40.0 * (t - since_s)),
        packets_lost=round(10.0 * (t - since_s)),
    )
    assert flight.fly(6.0).indices.communication > 0.5
    found = flight.input("communication", "packet loss to the autopilot")
    assert found.value == pytest.approx(0.2, abs=0.01)
    assert flight.estimate.report.communication.worst == found.name


def test_receive_errors_of_the_radio_raise_the_risk(flight):
    since_s = flight.now_s
    flight.handle("radio")
    healthy = flight.sources["radio"]
    flight.sources["radio"] = lambda t: replace(
        healthy(t), receive_errors=round(3.0 * (t - since_s))
    )
    flight.fly(6.0)
    errors = flight.input("communication", "radio receive errors")
    assert (errors.value, errors.risk) == (pytest.approx(3.0, abs=0.3), 1.0)
    last = flight.telemetry.radio.receive_errors
    flight.handle("radio", receive_errors=last)
    flight.fly(4.0)
    assert flight.input("communication", "radio receive errors").value == 0.0


def test_the_error_count_of_a_restarted_radio_restarts(flight):
    flight.handle("radio", receive_errors=160)
    flight.fly(5.0)
    flight.handle("radio", receive_errors=2)
    flight.fly(5.0)
    assert flight.input("communication", "radio receive errors").risk == 0.0


def test_a_transmitter_loss_reported_by_the_autopilot_raises_the_risk(flight):
    flight.sources["readiness"] = lambda t: Readiness(
        received_s=t, ready=True, unhealthy=(), remote_control_ok=False
    )
    assert flight.fly(3.0).indices.communication > 0.95
    assert flight.estimate.report.communication.worst == "remote control lost"


def test_silent_transmitter_channels_on_a_live_link_raise_the_risk(flight):
    flight.silence("remote_control")
    assert flight.fly(2.4).indices.communication < 0.01
    flight.fly(4.0)
    assert flight.estimate.report.communication.worst == "remote control silence"
    assert flight.estimate.indices.communication > 0.9


def test_a_silent_link_is_reported_as_autopilot_silence(flight):
    flight.silence("remote_control", "link", "ground_station", "radio")
    flight.fly(2.9)
    assert flight.input("communication", "remote control silence").risk == 0.0
    assert flight.estimate.report.communication.worst == "autopilot silence"
    assert flight.fly(1.6).indices.communication > 0.9


def paced(flight, rate_hz):
    """Sets the packet rate of the link from now on."""
    since_s, before = flight.now_s, flight.telemetry.link.packets_received
    flight.sources["link"] = lambda t: LinkStatistics(
        received_s=t, packets_received=before + round(rate_hz * (t - since_s)), packets_lost=0
    )


def test_a_falling_data_rate_raises_the_risk(flight):
    paced(flight, 40.0)
    flight.fly(4.0)
    rate = flight.input("communication", "data rate")
    assert rate.value == pytest.approx(0.4, abs=0.05)
    assert rate.risk == pytest.approx(0.25, abs=0.1)
    paced(flight, 5.0)
    assert flight.fly(4.0).indices.communication > 0.9


def test_a_lasting_low_data_rate_becomes_the_usual_one_on_the_ground_alone(flight):
    paced(flight, 10.0)
    assert flight.fly(4.0).indices.communication > 0.5
    before = flight.fly(20.0).indices.communication
    assert flight.fly(600.0, step_s=0.5).indices.communication >= before - 0.01
    flight.handle("landed", state=LandedState.ON_GROUND)
    assert flight.fly(900.0, step_s=0.5).indices.communication < 0.01


def test_a_slightly_changed_data_rate_becomes_the_usual_one(flight):
    paced(flight, 60.0)
    flight.fly(600.0, step_s=0.5)
    assert flight.input("communication", "data rate").value == pytest.approx(1.0, abs=0.05)


def test_the_end_of_a_parameter_list_is_no_fall_of_the_data_rate(flight):
    since_s, before = flight.now_s, flight.telemetry.link.packets_received

    def listed(t):
        answers = round(500.0 * min(30.0, t - since_s))
        streamed = round(100.0 * (t - since_s))
        return LinkStatistics(
            received_s=t,
            packets_received=before + streamed + answers,
            packets_lost=0,
            off_stream=answers,
        )

    flight.sources["link"] = listed
    flight.fly(30.0)
    assert flight.fly(10.0).indices.communication < 0.01
    assert flight.input("communication", "data rate").value == pytest.approx(1.0, abs=0.05)


def test_heartbeats_alone_give_no_usual_data_rate(new_flight, healthy):
    # A TIMESYNC packet every other second: two packets or four in a window.
    healthy["link"] = lambda t: LinkStatistics(
        received_s=t, packets_received=int(t) + int(t / 2.0), packets_lost=0
    )
    flight = new_flight(**healthy)
    flight.fly(60.0)
    assert flight.input("communication", "data rate").value is None


def test_a_rising_data_rate_and_new_streams_are_no_risk(new_flight, healthy):
    healthy["link"] = lambda t: LinkStatistics(
        received_s=t, packets_received=int(t - 100.0), packets_lost=0
    )
    flight = new_flight(**healthy)
    flight.fly(10.0)
    paced(flight, 100.0)
    flight.fly(60.0)
    assert flight.input("communication", "data rate").risk == 0.0


def test_too_few_packets_give_no_packet_loss(new_flight, healthy):
    healthy["link"] = lambda t: LinkStatistics(
        received_s=t, packets_received=int(t), packets_lost=int(t) // 2
    )
    slow = new_flight(**healthy)
    slow.fly(10.0)
    assert slow.input("communication", "packet loss").risk is None


NOW_S = 100.0
fractions = st.floats(0.0, 1.0)
signals = st.integers(0, 254)
telemetries = st.builds(
    Telemetry,
    radio=st.builds(
        Radio,
        received_s=st.just(NOW_S),
        rssi=signals,
        remote_rssi=signals,
        noise=signals,
        remote_noise=signals,
        receive_errors=st.integers(0, 60),
        transmit_buffer_percent=st.integers(0, 100),
    ),
    remote_control=st.builds(RemoteControl, received_s=st.floats(90.0, NOW_S), rssi=fractions),
    ground_station=st.builds(
        PeerHeartbeat, received_s=st.floats(80.0, NOW_S), system_id=st.just(255)
    ),
    link=st.builds(
        LinkStatistics,
        received_s=st.just(NOW_S),
        packets_received=st.integers(0, 400),
        packets_lost=st.integers(0, 400),
    ),
    link_node=st.builds(
        LinkNode,
        received_s=st.just(NOW_S),
        packets_received=st.integers(0, 200),
        packets_lost=st.integers(0, 200),
    ),
    readiness=st.builds(
        Readiness,
        received_s=st.just(NOW_S),
        ready=st.just(True),
        unhealthy=st.just(()),
        remote_control_ok=st.booleans(),
    ),
)
BEFORE = CommunicationMemory(
    here=(LinkStatistics(received_s=97.5, packets_received=0, packets_lost=0),),
    there=(LinkNode(received_s=97.5, packets_received=0, packets_lost=0),),
    radio=(
        Radio(
            received_s=97.5,
            rssi=180,
            remote_rssi=180,
            noise=40,
            remote_noise=40,
            receive_errors=0,
            transmit_buffer_percent=90,
        ),
    ),
    usual_rate_hz=100.0,
    usual_since_s=0.0,
)
"""As 2.5 s before the telemetry that is judged."""


def worst(telemetry):
    reports = communication.inputs(telemetry, NOW_S, RiskModel(), BEFORE)
    risks = [report.risk for report in reports if report.risk is not None]
    assert all(0.0 <= risk <= 1.0 for risk in risks)
    return max(risks)


WORSE = [
    ("radio", "rssi", -1),
    ("radio", "remote_rssi", -1),
    ("radio", "noise", 1),
    ("radio", "remote_noise", 1),
    ("radio", "receive_errors", 1),
    ("radio", "transmit_buffer_percent", -1),
    ("remote_control", "rssi", -0.1),
    ("remote_control", "received_s", -1.0),
    ("ground_station", "received_s", -1.0),
    ("link", "packets_lost", 5),
    ("link", "packets_received", -5),
    ("link_node", "packets_lost", 5),
]


@given(telemetry=telemetries, worse=st.sampled_from(WORSE))
def test_a_worse_link_is_never_less_risk(telemetry, worse):
    source, name, step = worse
    before = getattr(telemetry, source)
    after = replace(before, **{name: getattr(before, name) + step})
    if source != "link" or after.packets_received + after.packets_lost >= 20:
        assert worst(replace(telemetry, **{source: after})) >= worst(telemetry)


@given(telemetry=telemetries, noise=st.floats(-0.01, 0.01))
def test_a_little_noise_changes_the_risk_little(telemetry, noise):
    remote = replace(telemetry.remote_control, rssi=telemetry.remote_control.rssi + noise)
    ground = replace(telemetry.ground_station, received_s=NOW_S - 5.0 + noise)
    quiet = replace(telemetry, ground_station=replace(ground, received_s=NOW_S - 5.0))
    noisy = replace(telemetry, ground_station=ground, remote_control=remote)
    assert worst(noisy) == pytest.approx(worst(quiet), abs=0.03)

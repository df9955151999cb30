from __future__ import annotations

import pytest

from moar_companion.types import LinkStatistics
from moar_companion.vehicle import RiskModel


def test_a_good_link_settles_to_no_risk(flight):
    assert flight.estimate.indices.communication == pytest.approx(0.0, abs=1e-4)


def test_the_ground_station_falls_silent(flight):
    flight.silence("ground_station")
    assert flight.fly(2.5).indices.communication < 0.01  # two heartbeats may be lost
    assert flight.fly(3.5).indices.communication > 0.3  # 6 s: rising
    flight.fly(4.1)  # 10 s: the measured risk is 1, the index close behind
    assert flight.estimate.report.communication.value == 1.0
    assert flight.estimate.report.communication.worst == "ground station silence"
    assert flight.estimate.indices.communication > 0.93
    assert flight.fly(600.0, step_s=1.0).indices.communication == pytest.approx(1.0)


def test_the_ground_station_comes_back(flight):
    flight.silence("ground_station")
    flight.fly(20.0)
    flight.hear("ground_station")
    assert flight.fly(1.0).indices.communication > 0.8  # one heartbeat is no link yet
    assert flight.fly(25.0).indices.communication < 0.01


def test_a_ground_station_that_was_never_heard_is_unknown(new_flight, healthy):
    for name in ("ground_station", "radio", "remote_control", "link"):
        del healthy[name]
    alone = new_flight(**healthy)
    assert alone.fly(60.0).indices.communication == RiskModel().unknown
    assert alone.estimate.report.communication.value is None
    assert not alone.estimate.report.communication.ever_known


def test_a_good_link_to_the_autopilot_alone_reaches_nobody(new_flight, healthy):
    for name in ("ground_station", "radio", "remote_control"):
        del healthy[name]
    alone = new_flight(**healthy)
    assert alone.fly(60.0).indices.communication == RiskModel().unknown


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
    flight.hear("radio", **changes)
    assert flight.fly(3.0).indices.communication > 0.95
    assert flight.estimate.report.communication.worst == name


def test_a_weak_remote_control_raises_the_risk(flight):
    flight.hear("remote_control", rssi=0.2)
    assert flight.fly(3.0).indices.communication > 0.95


def test_a_margin_that_is_no_longer_told_does_not_lower_the_risk(flight):
    flight.hear("radio", remote_rssi=60)
    before = flight.fly(10.0).indices.communication
    flight.hear("radio", remote_rssi=None)
    assert flight.fly(60.0).indices.communication >= before


def losing(now_s: float, *, since_s: float, every: int) -> LinkStatistics:
    """100 packets a second, of which one of `every` is lost after `since_s`."""
    lost = round(100.0 * max(0.0, now_s - since_s)) // every
    return LinkStatistics(
        received_s=now_s, packets_received=round(100.0 * now_s) - lost, packets_lost=lost
    )


def test_one_packet_in_five_is_lost(flight):
    since_s = flight.now_s
    flight.sources["link"] = lambda t: losing(t, since_s=since_s, every=5)
    flight.fly(10.0)
    assert flight.input("communication", "packet loss").value == pytest.approx(0.2, abs=0.01)
    assert flight.estimate.indices.communication > 0.5


def test_losses_are_forgotten_after_the_window(flight):
    since_s = flight.now_s
    flight.sources["link"] = lambda t: losing(min(t, since_s + 5), since_s=since_s, every=5)
    flight.fly(5.0)
    lost = flight.telemetry.link.packets_lost
    flight.sources["link"] = lambda t: LinkStatistics(
        received_s=t, packets_received=round(100.0 * t), packets_lost=lost
    )
    flight.fly(6.0)
    assert flight.input("communication", "packet loss").value == 0.0


def test_counts_that_start_again_are_no_loss(flight):
    start_s = flight.now_s
    flight.sources["link"] = lambda t: LinkStatistics(
        received_s=t, packets_received=round(100.0 * (t - start_s)), packets_lost=0
    )
    flight.fly(0.1)
    assert flight.input("communication", "packet loss").risk is None
    flight.fly(5.0)
    assert flight.input("communication", "packet loss").value == 0.0


def test_few_packets_are_no_statistics(new_flight, healthy):
    healthy["link"] = lambda t: LinkStatistics(
        received_s=t, packets_received=int(t), packets_lost=int(t) // 2
    )
    slow = new_flight(**healthy)
    slow.fly(10.0)
    assert slow.input("communication", "packet loss").risk is None

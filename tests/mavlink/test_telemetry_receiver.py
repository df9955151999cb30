"""The autopilot's words out of everybody's."""

from __future__ import annotations

import pytest

from moar_companion.config import LinkRole
from moar_companion.mavlink.codec import Codec, SourceStatistics
from moar_companion.mavlink.dialect import mavlink
from moar_companion.mavlink.identity import AutopilotFound, AutopilotRestarted
from moar_companion.mavlink.telemetry_receiver import MESSAGE_IDS, TelemetryReceiver

from .peer import Peer


def hear(listener, packet, *, link="wire", role=LinkRole.AUTOPILOT, now_s=1.0):
    (message,) = Codec(system_id=1, component_id=195, wanted=MESSAGE_IDS).receive(packet)
    return listener.hear(message, link=link, role=role, now_s=now_s)


def test_only_the_autopilot_and_only_on_its_link_tells_where_the_aircraft_is():
    listener, autopilot = TelemetryReceiver(), Peer(1, 1)
    assert isinstance(hear(listener, autopilot.heartbeat()), AutopilotFound)
    hear(listener, Peer(1, 195).attitude(1.0))
    hear(listener, autopilot.attitude(1.0), link="another")
    assert listener.telemetry.attitude is None
    hear(listener, autopilot.attitude(1.0), now_s=2.5)
    assert listener.telemetry.attitude.received_s == 2.5


def test_a_heartbeat_on_an_operators_link_finds_no_autopilot():
    listener = TelemetryReceiver()
    assert hear(listener, Peer(1, 1).heartbeat(), role=LinkRole.OPERATOR) is None
    assert hear(listener, Peer(255, 190).ground_heartbeat(), role=LinkRole.OPERATOR) is None
    assert listener.autopilot is None
    assert listener.telemetry.ground_station.system_id == 255


def test_a_restart_forgets_what_the_autopilot_said_and_nothing_else():
    listener, autopilot = TelemetryReceiver(), Peer(1, 1)
    hear(listener, autopilot.heartbeat())
    hear(listener, Peer(255, 190).ground_heartbeat())
    hear(listener, autopilot.attitude(50.0))
    boot = autopilot.heartbeat(system_status=mavlink.MAV_STATE_BOOT)
    assert isinstance(hear(listener, boot), AutopilotRestarted)
    assert listener.telemetry.attitude is None
    assert listener.telemetry.ground_station is not None
    assert hear(listener, autopilot.attitude(1.0)) is None  # its clock begins anew


@pytest.mark.parametrize("later_s", [0.6, 2.0, 6.0])
@pytest.mark.parametrize("gap_s", [0.0, 0.4])
def test_copies_by_a_slower_route_are_neither_a_restart_nor_another_autopilot(later_s, gap_s):
    """The direct route pauses once; the copies of what it brought arrive all the same."""
    listener, autopilot = TelemetryReceiver(), Peer(1, 1)
    hear(listener, autopilot.heartbeat(), now_s=0.0)
    packets = {step: autopilot.attitude(100.0 + 0.02 * step) for step in range(1000)}
    copied = round(later_s / 0.02)
    for step in range(1000):
        now_s = 1.0 + 0.02 * step
        if not 10.0 <= now_s < 10.0 + gap_s:
            assert hear(listener, packets[step], now_s=now_s) is None
            assert listener.telemetry.attitude.received_s == now_s
        if step >= copied:
            before = listener.telemetry.attitude
            assert hear(listener, packets[step - copied], now_s=now_s + 0.01) is None
            assert listener.telemetry.attitude == before


def test_packets_are_dated_by_the_autopilots_last():
    listener, autopilot = TelemetryReceiver(), Peer(1, 1)
    hear(listener, autopilot.heartbeat(), now_s=3.0)
    hear(listener, Peer(255, 190).ground_heartbeat(), now_s=9.0)
    listener.count_packets(SourceStatistics(received=7, lost=2))
    link = listener.telemetry.link
    assert (link.received_s, link.packets_received, link.packets_lost) == (3.0, 7, 2)

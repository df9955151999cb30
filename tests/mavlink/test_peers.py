"""Addresses that a listening link sends to, and the address of the autopilot."""

from __future__ import annotations

import pytest

from moar_companion.mavlink.dialect import create, mavlink
from moar_companion.mavlink.peers import AutopilotElsewhere, PeerRefused
from moar_companion.settings.config import Commands

from .peer import Peer
from .story import Story

AUTOPILOT, STATION, STRANGER = ("10.0.0.2", 14580), ("10.0.0.3", 14550), ("10.0.0.66", 4242)


class Network(Story):
    """A session with listening links, and packets from given addresses."""

    def receive_from(self, address, data, *, link="serial"):
        self.session.receive(link, data, self.now_s, address)

    def peers(self, link="serial"):
        return self.session.peers(link)


@pytest.fixture
def network():
    return Network()


def corrupted(packet):
    return packet[:-1] + bytes([packet[-1] ^ 1])


def test_one_byte_noise_and_a_wrong_checksum_make_no_peer(network, ground_station):
    network.tick()
    for data in (b"\x00", b"\xfd", bytes(300), corrupted(ground_station.ground_heartbeat())):
        network.receive_from(STRANGER, data)
    assert network.peers() == ()
    network.receive_from(STRANGER, ground_station.ground_heartbeat())
    assert network.peers() == (STRANGER,)


def test_a_message_whose_checksum_cannot_be_verified_makes_no_peer(network):
    network.receive_from(STRANGER, b"\xfd\x00\x00\x00\x00\xff\xbe\xff\xff\x7f\x00\x00")
    assert network.peers() == ()


@pytest.mark.parametrize(
    ("system_id", "allowed"), [(255, True), (240, True), (1, True), (42, False), (51, False)]
)
def test_a_peer_is_a_ground_station_or_the_vehicle_by_default(network, system_id, allowed):
    network.receive_from(STRANGER, Peer(system_id, 190).ground_heartbeat(), link="network")
    assert network.peers("network") == ((STRANGER,) if allowed else ())


def test_the_autopilot_is_a_peer_whatever_systems_may_command():
    network = Network(commands=Commands(systems=(42,)))
    network.receive_from(AUTOPILOT, Peer(7, 1).heartbeat())
    network.receive_from(STATION, Peer(255, 190).ground_heartbeat())
    assert network.peers() == (AUTOPILOT,)


def test_a_possible_autopilot_is_a_peer_before_its_heartbeat(network):
    network.tick()
    network.receive_from(AUTOPILOT, Peer(7, 1).attitude(1.0))
    network.receive_from(STRANGER, Peer(7, 1).attitude(1.0), link="network")
    assert (network.peers(), network.peers("network")) == ((AUTOPILOT,), ())


def test_a_refused_peer_is_reported_once_a_minute(network):
    for number in range(300):
        network.receive_from(("10.0.1.1", number), Peer(2 + number % 238, 190).ground_heartbeat())
    (event,) = network.events()
    assert event == PeerRefused(link="serial", address=("10.0.1.1", 0), system_id=2)
    network.now_s += 60.0
    network.receive_from(STRANGER, Peer(42, 190).ground_heartbeat())
    assert len(network.events()) == 1


def test_a_peer_silent_for_ten_seconds_is_dropped(network, ground_station):
    network.receive_from(STATION, ground_station.ground_heartbeat())
    network.now_s += 10.0
    network.tick()
    assert network.peers() == (STATION,)
    network.now_s += 0.1
    network.tick()
    assert network.peers() == ()
    network.receive_from(STATION, ground_station.ground_heartbeat())
    assert network.peers() == (STATION,)


def test_300_addresses_displace_neither_autopilot_nor_ground_station(
    network, autopilot, ground_station
):
    network.tick()
    network.receive_from(AUTOPILOT, autopilot.heartbeat())
    network.receive_from(STATION, ground_station.ground_heartbeat())
    forged = Peer(255, 190)
    for number in range(300):
        network.now_s += 0.1
        network.receive_from(("10.0.1.1", number), forged.ground_heartbeat())
        if number % 10 == 0:
            network.receive_from(STATION, ground_station.ground_heartbeat())
        assert {AUTOPILOT, STATION} <= {*network.session._peers["serial"]._peers}
    network.receive_from(AUTOPILOT, autopilot.heartbeat())
    assert len(network.peers()) == 8
    assert {AUTOPILOT, STATION} <= {*network.peers()}
    assert len(network.session._peers["serial"]._peers) == 8


def test_the_autopilot_becomes_a_peer_although_eight_others_came_first(network, autopilot):
    stations = [(("10.0.1.1", number), Peer(255, number)) for number in range(1, 10)]
    for address, station in stations:
        network.receive_from(address, station.ground_heartbeat())
    assert len(network.peers()) == 8
    network.receive_from(AUTOPILOT, autopilot.heartbeat())
    assert AUTOPILOT in network.peers()
    assert len(network.peers()) == 8


def test_the_peer_silent_longest_is_replaced_by_a_new_one(network):
    stations = [(("10.0.1.1", number), Peer(255, number)) for number in range(1, 10)]
    for address, station in stations[:8]:
        network.receive_from(address, station.ground_heartbeat())
    network.now_s += 2.0
    new, its_station = stations[8]
    network.receive_from(new, its_station.ground_heartbeat())
    assert new not in network.peers()  # each of the eight was received within 3 s
    for address, station in (*stations[:3], *stations[4:8]):
        network.receive_from(address, station.ground_heartbeat())
    network.now_s += 1.5
    network.receive_from(new, its_station.ground_heartbeat())
    assert new in network.peers()
    assert stations[3][0] not in network.peers()


def test_an_incomplete_packet_of_one_address_delays_no_other_address(network, autopilot, peer):
    network.meet(autopilot)
    network = Network()
    network.tick()
    autopilot.restart()
    network.receive_from(AUTOPILOT, autopilot.heartbeat())
    network.receive_from(STRANGER, b"\xfd\xff\x00\x00\x00\x01\x01\x00\x00\x00")  # 255 bytes follow
    network.receive_from(AUTOPILOT, autopilot.attitude(1.0, roll=0.25))
    assert network.session.telemetry.attitude.roll_rad == 0.25


def test_a_peer_may_split_its_packets(network, autopilot):
    network.receive_from(AUTOPILOT, autopilot.heartbeat())
    packet = autopilot.attitude(1.0, roll=0.25)
    network.receive_from(AUTOPILOT, packet[:20])
    network.receive_from(STATION, Peer(255, 190).ground_heartbeat())
    network.receive_from(AUTOPILOT, packet[20:])
    assert network.session.telemetry.attitude.roll_rad == 0.25


# The autopilot's ids from another address


def test_a_packet_with_the_autopilots_ids_from_elsewhere_is_reported_once(network, autopilot):
    network.tick()
    network.receive_from(AUTOPILOT, autopilot.heartbeat())
    network.events()
    forger = Peer(1, 1)
    forger.skip(100)
    network.receive_from(STRANGER, forger.attitude(1.0, roll=1.5))
    network.receive_from(STRANGER, forger.heartbeat(autopilot=mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA))
    network.receive_from(("10.0.0.67", 1), forger.attitude(1.0, roll=1.5))
    assert network.events() == [AutopilotElsewhere(link="serial", address=STRANGER)]
    assert network.session.telemetry.attitude is None
    assert network.session.conflict is None
    assert network.peers() == (AUTOPILOT,)
    network.receive_from(AUTOPILOT, autopilot.attitude(1.0, roll=0.25))
    network.tick()
    assert network.session.telemetry.attitude.roll_rad == 0.25
    link = network.session.telemetry.link
    assert (link.packets_received, link.packets_lost) == (2, 0)


def test_an_address_with_the_autopilots_ids_is_reported_each_minute(network, autopilot):
    """Also the true autopilot's address, where another sender was received first."""
    network.tick()
    network.receive_from(STRANGER, Peer(1, 1).heartbeat())
    network.events()
    reported_s, began_s = [], network.now_s
    for _ in range(150):
        network.now_s += 1.0
        network.receive_from(STRANGER, Peer(1, 1).heartbeat())
        network.receive_from(AUTOPILOT, autopilot.heartbeat())
        events = network.events()
        assert events in ([], [AutopilotElsewhere(link="serial", address=AUTOPILOT)])
        reported_s += [network.now_s - began_s] * len(events)
    assert reported_s == [1.0, 61.0, 121.0]


def test_an_ignored_packet_is_not_recorded_and_the_rest_of_its_datagram_is(network, autopilot):
    network.tick()
    network.receive_from(AUTOPILOT, autopilot.heartbeat())
    network.session.received_packets()
    forger, station = Peer(1, 1), Peer(255, 190).ground_heartbeat()
    forged = forger.attitude(1.0, roll=1.5)
    clock = create("SYSTEM_TIME", time_unix_usec=1, time_boot_ms=2)
    old = forger.pack(clock, mavlink1=True)
    network.receive_from(STRANGER, forged + station + old)
    true = autopilot.attitude(1.0, roll=0.25)
    network.receive_from(AUTOPILOT, true)
    assert [packet for _, packet in network.session.received_packets()] == [station, true]


def test_a_ground_station_at_the_address_of_a_forger_is_received(network, autopilot):
    network.receive_from(AUTOPILOT, autopilot.heartbeat())
    both = Peer(1, 1).attitude(1.0) + Peer(255, 190).ground_heartbeat()
    network.receive_from(STRANGER, both)
    assert network.session.telemetry.ground_station.system_id == 255
    assert network.peers() == (AUTOPILOT, STRANGER)


def test_an_autopilot_silent_for_three_seconds_may_have_a_new_address(network, autopilot):
    network.receive_from(AUTOPILOT, autopilot.heartbeat())
    network.now_s += 2.9
    network.receive_from(STRANGER, autopilot.attitude(1.0, roll=0.5))
    assert network.session.telemetry.attitude is None
    network.now_s += 0.2  # a restarted router sends from another port
    network.receive_from(STRANGER, autopilot.attitude(1.1, roll=0.5))
    assert network.session.telemetry.attitude.roll_rad == 0.5
    network.receive_from(AUTOPILOT, autopilot.attitude(1.2, roll=0.25))
    assert network.session.telemetry.attitude.roll_rad == 0.5


def test_a_link_without_addresses_has_no_autopilot_elsewhere(story, autopilot):
    story.meet(autopilot)
    for number in range(3):
        story.handle(autopilot.attitude(1.0 + number, roll=0.25))
    assert story.session.telemetry.attitude.roll_rad == 0.25
    assert story.session.peers("serial") == ()
    assert story.events() == []

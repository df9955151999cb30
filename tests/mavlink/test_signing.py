"""Signed links: accepted packets, refused packets with reasons, and sent signatures."""

from __future__ import annotations

import copy
import hashlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.dialect import create
from moar_companion.mavlink.session import Session, SystemStatus
from moar_companion.mavlink.signing import (
    LATEST_TIMESTAMP,
    Signing,
    SigningKey,
    SigningRefusal,
    link_signings,
    timestamp_at,
)
from moar_companion.settings.link_config import LinkConfig, LinkRole

from .peer import Peer
from .signed import MINUTE, OTHER_SECRET, SECRET, SignedPeer, signed_codec, signing

SECOND = MINUTE // 60
CLOCK = create("SYSTEM_TIME", time_unix_usec=1, time_boot_ms=6)


def types(messages):
    return [message.get_type() for message in messages]


def setup_signing(peer):
    return peer.send(
        "SETUP_SIGNING",
        target_system=1,
        target_component=195,
        secret_key=list(OTHER_SECRET),
        initial_timestamp=1,
    )


# Accepted packets


@given(st.integers(0, 255), st.integers(1, 255), st.integers(1, 255), st.integers(0, 255))
def test_packets_signed_by_pymavlink_are_accepted(link_id, system_id, component_id, sequence):
    peer, codec = SignedPeer(system_id, component_id, link_id=link_id), signed_codec()
    peer.skip(sequence)
    messages = codec.receive(peer.heartbeat() + peer.attitude(1.0))
    assert types(messages) == ["HEARTBEAT", "ATTITUDE"]
    assert all(message.get_signed() for message in messages)
    assert sum(codec.refused.values()) == 0
    assert codec.statistics(system_id, component_id).received == 2


def test_pymavlink_accepts_packets_signed_by_the_companion():
    peer, codec = SignedPeer(), signed_codec(signing(link_id=9))
    for _ in range(300):
        (message,) = peer.read(codec.encode(CLOCK))
        assert (message.get_type(), message.get_link_id()) == ("SYSTEM_TIME", 9)
        assert message.get_signed()
    assert peer.signing.badsig_count == 0


def test_pymavlink_with_another_key_refuses_packets_of_the_companion():
    peer, codec = SignedPeer(secret=OTHER_SECRET), signed_codec()
    assert peer.read(codec.encode(CLOCK)) == []


def test_a_stream_of_signed_packets_split_at_any_byte_gives_the_same_messages():
    peer = SignedPeer()
    stream = peer.heartbeat() + peer.attitude(1.0) + peer.heartbeat()
    for split in range(len(stream) + 1):
        codec = signed_codec()
        messages = codec.receive(stream[:split]) + codec.receive(stream[split:])
        assert types(messages) == ["HEARTBEAT", "ATTITUDE", "HEARTBEAT"]


def test_a_message_that_the_dialect_lacks_is_checked_by_its_signature():
    peer, codec = SignedPeer(), signed_codec()
    body = b"\xfd\x02\x01\x00\x07\x01\x01" + (999_999).to_bytes(3, "little") + b"ab" + b"\x12\x34"
    body += bytes([3]) + (100 * MINUTE - 1).to_bytes(6, "little")
    packet = body + hashlib.sha256(SECRET + body).digest()[:6]
    codec.receive(packet[:-1] + bytes([packet[-1] ^ 1]))
    assert codec.packets == []
    codec.receive(packet)
    assert codec.packets == [packet]
    assert codec.unknown_messages == 1
    codec.receive(packet)
    assert codec.packets == []
    assert codec.refused[SigningRefusal.OLD] == 1
    assert types(codec.receive(peer.heartbeat())) == ["HEARTBEAT"]


def test_a_link_without_signing_reads_signed_packets_and_marks_them_unchecked():
    codec = Codec(system_id=1, component_id=195)
    data = SignedPeer(secret=OTHER_SECRET).heartbeat() + Peer(1, 1).heartbeat()
    messages = codec.receive(data)
    assert types(messages) == ["HEARTBEAT", "HEARTBEAT"]
    assert not any(message.get_signed() for message in messages)
    assert codec.encode(CLOCK)[2] == 0


# Refused packets


def refused(codec, data, reason, count=1):
    """Asserts that no packet in the data is read, recorded or listed, and each is counted."""
    before, sources = codec.refused[reason], codec.sources
    assert codec.receive(data) == []
    assert codec.packets == []
    assert codec.unwanted == []
    assert codec.sources == sources
    assert codec.refused[reason] == before + count


@pytest.mark.parametrize("mavlink1", [False, True])
def test_an_unsigned_packet_is_refused(autopilot, mavlink1):
    data = autopilot.pack(CLOCK, mavlink1=mavlink1)
    refused(signed_codec(), data, SigningRefusal.UNSIGNED)


def test_unsigned_telemetry_is_refused(autopilot):
    data = autopilot.heartbeat() + autopilot.attitude(1.0)
    refused(signed_codec(), data, SigningRefusal.UNSIGNED, count=2)


def test_a_packet_signed_with_another_key_is_refused():
    refused(signed_codec(), SignedPeer(secret=OTHER_SECRET).heartbeat(), SigningRefusal.WRONG)


def test_a_wrongly_signed_packet_does_not_advance_the_time_stamp():
    link = signing()
    before = copy.deepcopy(link)
    codec = signed_codec(link)
    refused(
        codec,
        SignedPeer(secret=OTHER_SECRET, timestamp=LATEST_TIMESTAMP - 9).heartbeat(),
        SigningRefusal.WRONG,
    )
    assert link.timestamp == before.timestamp
    assert types(codec.receive(SignedPeer().heartbeat())) == ["HEARTBEAT"]


def test_the_same_packet_a_second_time_is_refused():
    codec, packet = signed_codec(), SignedPeer().heartbeat()
    assert types(codec.receive(packet)) == ["HEARTBEAT"]
    refused(codec, packet, SigningRefusal.OLD)


def test_a_packet_older_than_the_last_of_its_stream_is_refused():
    codec, peer = signed_codec(), SignedPeer()
    first, second = peer.heartbeat(), peer.heartbeat()
    assert types(codec.receive(second)) == ["HEARTBEAT"]
    refused(codec, first, SigningRefusal.OLD)


@pytest.mark.parametrize(
    ("behind", "accepted"), [(0, True), (MINUTE, True), (MINUTE + 1, False), (50 * MINUTE, False)]
)
def test_the_first_packet_of_a_stream_may_be_a_minute_behind(behind, accepted):
    codec = signed_codec(signing(timestamp=100 * MINUTE))
    packet = SignedPeer(timestamp=100 * MINUTE - behind).heartbeat()
    if accepted:
        assert types(codec.receive(packet)) == ["HEARTBEAT"]
    else:
        refused(codec, packet, SigningRefusal.OLD)


def test_an_established_stream_may_fall_behind_the_clock():
    link, peer = signing(timestamp=100 * MINUTE), SignedPeer(timestamp=100 * MINUTE)
    codec = signed_codec(link)
    codec.receive(peer.heartbeat())
    link.advance(1_420_070_400 + 200 * 60)
    assert link.timestamp == 200 * MINUTE
    assert types(codec.receive(peer.heartbeat())) == ["HEARTBEAT"]


@pytest.mark.parametrize("restarted", [False, True])
def test_a_peer_with_a_clock_ahead_does_not_make_other_peers_refused(restarted):
    wall_s = 1_420_070_400 + 6000.0
    link = two_links(wall_s=wall_s)["serial"]
    codec = signed_codec(link)
    ahead = SignedPeer(255, 190, timestamp=102 * MINUTE)
    assert types(codec.receive(ahead.ground_heartbeat())) == ["HEARTBEAT"]
    assert link.next_timestamp() > 102 * MINUTE
    if restarted:
        kept, references = {"serial": link.timestamp}, {"serial": link.reference}
        link = two_links(wall_s=wall_s + 5.0, kept=kept, references=references)["serial"]
        codec = signed_codec(link)
        assert link.next_timestamp() > 102 * MINUTE
    assert types(codec.receive(SignedPeer(1, 1).heartbeat())) == ["HEARTBEAT"]
    assert link.behind_s == {}


def test_a_computer_without_a_set_clock_judges_by_received_time_stamps():
    for wall_s, references in ((0.0, {}), (1_420_070_400 + 60.0, {"serial": 90 * MINUTE})):
        link = two_links(wall_s=wall_s, references=references)["serial"]
        codec = signed_codec(link)
        assert types(codec.receive(SignedPeer(255, 190).heartbeat())) == ["HEARTBEAT"]
        recorded = SignedPeer(1, 1, timestamp=98 * MINUTE)
        refused(codec, recorded.heartbeat(), SigningRefusal.OLD)
        assert link.behind_s == {1: pytest.approx(120.0, abs=0.1)}


def test_a_sender_that_is_behind_is_named_until_its_clock_is_right():
    link = two_links()["serial"]
    codec, behind = signed_codec(link), SignedPeer(1, 1, timestamp=98 * MINUTE)
    refused(codec, behind.heartbeat(), SigningRefusal.OLD)
    assert link.behind_s == {1: pytest.approx(120.0, abs=0.1)}
    behind.signing.timestamp = 100 * MINUTE
    packet = behind.heartbeat()
    assert types(codec.receive(packet)) == ["HEARTBEAT"]
    refused(codec, packet, SigningRefusal.OLD)
    assert link.behind_s == {}


def test_link_ids_and_components_of_one_system_are_separate_streams():
    codec = signed_codec()
    for peer in (
        SignedPeer(1, 1, link_id=0, timestamp=100 * MINUTE),
        SignedPeer(1, 1, link_id=1, timestamp=100 * MINUTE - 5),
        SignedPeer(1, 2, link_id=0, timestamp=100 * MINUTE - 5),
        SignedPeer(2, 1, link_id=0, timestamp=100 * MINUTE - 5),
    ):
        assert types(codec.receive(peer.heartbeat())) == ["HEARTBEAT"]


@given(st.data())
def test_a_packet_with_any_byte_changed_is_refused(data):
    packet = bytearray(data.draw(st.sampled_from(PACKETS)))
    position = data.draw(st.integers(0, len(packet) - 1))
    packet[position] ^= data.draw(st.integers(1, 255))
    codec = signed_codec()
    assert codec.receive(bytes(packet)) == []
    assert codec.receive(bytes(300)) == []
    assert codec.packets == []
    assert codec.sources == []


def packets_of(peer):
    return [peer.heartbeat(), peer.attitude(1.0), peer.command(31010, 1), peer.ground_heartbeat()]


PACKETS = packets_of(SignedPeer())


@given(st.binary(max_size=280), st.binary(max_size=280))
def test_no_noise_blocks_or_replaces_a_signed_packet(before, between):
    """A false start marker in the noise loses at most the next 280 bytes."""
    codec, peer = signed_codec(), SignedPeer()
    data = before + bytes(300) + peer.heartbeat() + between + bytes(300) + peer.attitude(1.0)
    assert types(codec.receive(data)) == ["HEARTBEAT", "ATTITUDE"]


def test_a_radio_that_cannot_sign_is_refused_without_being_counted():
    codec, radio = signed_codec(), Peer(51, 68)
    status = {"rssi": 1, "remrssi": 1, "txbuf": 1, "noise": 1, "remnoise": 1, "rxerrors": 0}
    refused(codec, radio.send("RADIO_STATUS", **status, fixed=0), SigningRefusal.UNSIGNED, count=0)


@pytest.mark.parametrize("signed", [False, True])
def test_setup_signing_is_neither_recorded_nor_accepted_on_any_link(signed):
    peer = SignedPeer() if signed else Peer(1, 1)
    link = signing() if signed else None
    session = Session(
        links={"serial": LinkRole.AUTOPILOT}, signing={"serial": link} if link else {}
    )
    session.tick(1.0, SystemStatus.STANDBY)
    session.receive("serial", peer.heartbeat() + setup_signing(peer), 1.0)
    assert len(session.received_packets()) == 1
    assert OTHER_SECRET not in b"".join(data for _, data in session.data_to_send())
    session.receive("serial", peer.heartbeat(), 2.0)
    assert len(session.received_packets()) == 1
    if link is not None:
        assert link.key.secret == SECRET


# Several links


def two_links(**options):
    links = [
        LinkConfig(url="serial", signed=True),
        LinkConfig(url="plain", role=LinkRole.OPERATOR),
        LinkConfig(url="network", role=LinkRole.OPERATOR, signed=True),
    ]
    start = {"wall_s": 1_420_070_400 + 6000.0, **options}
    return link_signings(links, Signing(key=SigningKey(SECRET), **start))


def test_signed_links_have_distinct_link_ids_and_other_links_are_not_signed():
    found = two_links()
    assert {url: link.link_id for url, link in found.items()} == {"serial": 0, "network": 2}


def test_all_packets_are_signed_on_signed_links_and_none_on_others():
    session = Session(
        links=dict.fromkeys(("serial", "plain", "network"), LinkRole.AUTOPILOT),
        signing=two_links(),
    )
    peers = {"serial": SignedPeer(), "network": SignedPeer()}
    sent = []
    for step in range(200):
        session.tick(1.0 + 0.02 * step, SystemStatus.ACTIVE)
        session.receive("serial", peers["serial"].heartbeat(), 1.0 + 0.02 * step)
        session.services.values.take({"RISK_WIND": 0.5})
        sent += session.data_to_send()
    assert {link for link, _ in sent} == {"serial", "plain", "network"}
    for link, data in sent:
        assert data[2] == (link != "plain")
        if link in peers:
            assert len(peers[link].read(data)) == 1


def test_a_copy_over_another_link_is_accepted_and_an_old_one_is_refused():
    found, peer = two_links(), SignedPeer(255, 190)
    serial, network = signed_codec(found["serial"]), signed_codec(found["network"])
    recorded = peer.heartbeat()
    assert types(serial.receive(recorded)) == ["HEARTBEAT"]
    assert types(network.receive(recorded)) == ["HEARTBEAT"]
    recorded = peer.heartbeat()
    assert types(serial.receive(recorded)) == ["HEARTBEAT"]
    peer.signing.timestamp += 6 * SECOND
    assert types(serial.receive(peer.heartbeat())) == ["HEARTBEAT"]
    refused(network, recorded, SigningRefusal.OLD)


def test_a_signed_link_without_a_key_is_an_error():
    with pytest.raises(ValueError, match="serial asks for signatures, and there is no key"):
        link_signings([LinkConfig(url="serial", signed=True)], None)


# Time stamps of sent packets


def stamps(codec, count):
    """Time stamps of a number of packets."""
    packets = [codec.encode(CLOCK) for _ in range(count)]
    return [int.from_bytes(packet[-12:-6], "little") for packet in packets]


@given(
    st.lists(
        st.one_of(
            st.floats(0.0, 4e9).map(lambda wall_s: ("clock", wall_s)),
            st.integers(0, LATEST_TIMESTAMP - 1000).map(lambda stamp: ("peer", stamp)),
            st.integers(1, 5).map(lambda count: ("send", count)),
        ),
        max_size=20,
    )
)
def test_sent_time_stamps_always_increase(steps):
    link = signing(timestamp=0)
    codec, sent = signed_codec(link), []
    for what, value in steps:
        if what == "clock":
            link.advance(value)
        elif what == "peer":
            codec.receive(SignedPeer(timestamp=value).heartbeat())
        else:
            sent += stamps(codec, value)
    assert sent == sorted(set(sent))


def test_sent_time_stamps_follow_the_wall_clock_and_a_peer_ahead_of_it():
    link = signing(timestamp=0)
    codec = signed_codec(link)
    link.advance(1_420_070_400 + 60.0)
    assert stamps(codec, 2) == [MINUTE + 1, MINUTE + 2]
    link.advance(0.0)
    assert stamps(codec, 1) == [MINUTE + 3]
    codec.receive(SignedPeer(timestamp=9 * MINUTE).heartbeat())
    assert stamps(codec, 1) == [9 * MINUTE + 1]


def test_a_peer_with_the_last_possible_time_stamp_is_no_error():
    link = signing()
    codec = signed_codec(link)
    codec.receive(SignedPeer(timestamp=LATEST_TIMESTAMP).heartbeat())
    assert stamps(codec, 2) == [LATEST_TIMESTAMP, LATEST_TIMESTAMP]


@pytest.mark.parametrize(
    ("wall_s", "timestamp"), [(0.0, 0), (1_420_070_400, 0), (1_420_070_460, MINUTE)]
)
def test_time_stamps_count_from_2015(wall_s, timestamp):
    assert timestamp_at(wall_s) == timestamp


def test_a_link_starts_after_its_saved_time_stamp_and_a_new_one_after_all_saved():
    kept = {"serial": 500 * MINUTE, "gone": 700 * MINUTE}
    found = two_links(wall_s=0.0, kept=kept)
    assert found["serial"].timestamp == 500 * MINUTE
    assert found["network"].timestamp == 700 * MINUTE
    found = two_links(wall_s=1_420_070_400 + 900 * 60.0, kept=kept)
    assert {link.timestamp for link in found.values()} == {900 * MINUTE}


# The key


@pytest.mark.parametrize("secret", [b"", bytes(31), bytes(33), bytes(32)])
def test_a_key_has_32_bytes_that_are_not_all_zero(secret):
    with pytest.raises(ValueError, match="must"):
        SigningKey(secret)


def test_the_key_is_never_printed():
    start = Signing(key=SigningKey(SECRET), wall_s=0.0)
    for item in (start, start.key, signing(), signed_codec(), two_links()):
        for text in (repr(item), str(item)):
            assert SECRET.hex() not in text
            assert repr(SECRET)[2:-1] not in text

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from moar_companion.mavlink.codec import Codec, checksum, is_sound
from moar_companion.mavlink.dialect import create, mavlink


def new_codec(**options):
    return Codec(system_id=1, component_id=195, **options)


def types(messages):
    return [message.get_type() for message in messages]


def test_the_checksum_is_that_of_the_standard():
    assert checksum(b"123456789") == 0x6F91


@given(st.binary(max_size=300))
def test_the_checksum_is_pymavlinks(data):
    assert checksum(data) == mavlink.x25crc(data).crc


def test_a_stream_split_at_any_byte_gives_the_same_messages(autopilot):
    stream = (
        autopilot.heartbeat()
        + autopilot.attitude(1.0)
        + autopilot.pack(create("SYSTEM_TIME", time_unix_usec=1, time_boot_ms=2), mavlink1=True)
        + autopilot.send("STATUSTEXT", severity=6, text=b"hello", id=0, chunk_seq=0)
    )
    expected = ["HEARTBEAT", "ATTITUDE", "SYSTEM_TIME", "STATUSTEXT"]
    for split in range(len(stream) + 1):
        codec = new_codec()
        messages = codec.receive(stream[:split]) + codec.receive(stream[split:])
        assert types(messages) == expected
        assert codec.dropped_bytes == 0
    codec = new_codec()
    messages = [message for byte in stream for message in codec.receive(bytes([byte]))]
    assert types(messages) == expected
    assert messages[3].text == "hello"


@pytest.mark.parametrize("mavlink1", [False, True])
def test_a_message_carries_its_source_sequence_and_bytes(peer, mavlink1):
    sender = peer(7, 42)
    sender.skip(200)
    data = sender.pack(create("SYSTEM_TIME", time_unix_usec=5, time_boot_ms=6), mavlink1=mavlink1)
    (message,) = new_codec().receive(data)
    assert (message.get_srcSystem(), message.get_srcComponent()) == (7, 42)
    assert message.get_seq() == 200
    assert bytes(message.get_msgbuf()) == data
    assert (message.time_unix_usec, message.time_boot_ms) == (5, 6)


def test_truncated_trailing_zeros_are_restored(autopilot):
    data = autopilot.send("PING", time_usec=1, seq=0, target_system=0, target_component=0)
    assert len(data) == 13
    (message,) = new_codec().receive(data)
    assert (message.seq, message.target_component) == (0, 0)


def test_a_signed_packet_is_read(autopilot):
    autopilot._packer.signing.secret_key = bytes(32)
    autopilot._packer.signing.sign_outgoing = True
    data = autopilot.heartbeat() + autopilot.heartbeat()
    assert types(new_codec().receive(data)) == ["HEARTBEAT", "HEARTBEAT"]


def test_fields_of_a_newer_definition_are_ignored(autopilot):
    payload = bytes(range(1, 17)) + b"\x01\x02\x07\x07\x07"
    header = bytes([len(payload), 0, 0, 0, 1, 1, 111, 0, 0])
    value = checksum(header + payload + bytes([34]))
    (message,) = new_codec().receive(b"\xfd" + header + payload + value.to_bytes(2, "little"))
    assert (message.target_system, message.target_component) == (1, 2)


def test_messages_after_a_corrupted_byte_arrive(autopilot):
    first = autopilot.attitude(1.0)
    rest = autopilot.heartbeat() * 20
    for position in range(len(first)):
        for flip in (0x01, 0x80, 0xFF):
            broken = bytearray(first)
            broken[position] ^= flip
            received = new_codec().receive(bytes(broken) + rest)
            assert types(received[-20:]) == ["HEARTBEAT"] * 20
            assert all(m.get_type() == "HEARTBEAT" for m in received), (position, flip)


def test_messages_after_a_truncated_message_arrive(autopilot):
    first = autopilot.attitude(1.0)
    rest = autopilot.heartbeat() * 20
    for start in range(len(first)):
        for end in range(start + 1, len(first)):
            received = new_codec().receive(first[:start] + first[end:] + rest)
            assert types(received) == ["HEARTBEAT"] * 20


@given(st.lists(st.binary(max_size=400), max_size=5))
def test_no_bytes_raise_an_error(chunks):
    codec = new_codec()
    for chunk in chunks:
        codec.receive(chunk)
        assert len(codec._buffer) < 300


@given(st.binary(max_size=200), st.integers(min_value=1, max_value=50))
def test_messages_after_noise_arrive(noise, size):
    codec = new_codec()
    packer = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    beat = create(
        "HEARTBEAT",
        type=2,
        autopilot=12,
        base_mode=1,
        custom_mode=3,
        system_status=4,
        mavlink_version=3,
    )
    stream = noise + bytes(beat.pack(packer)) * 20
    received = []
    for start in range(0, len(stream), size):
        received += codec.receive(stream[start : start + size])
    # A false marker at the end of the noise may delay up to 280 bytes: 13 heartbeats.
    assert types(received)[:7] == ["HEARTBEAT"] * 7
    assert bytes(codec._buffer) == b"" or len(received) >= 7


@given(st.sampled_from(sorted(mavlink.mavlink_map)), st.binary(max_size=255))
def test_any_payload_of_any_message_is_read(message_id, payload):
    header = bytes([len(payload), 0, 0, 5, 1, 1]) + message_id.to_bytes(3, "little")
    extra = mavlink.mavlink_map[message_id].crc_extra
    value = checksum(header + payload + bytes([extra]))
    codec = new_codec()
    (message,) = codec.receive(b"\xfd" + header + payload + value.to_bytes(2, "little"))
    assert message.get_msgId() == message_id


def test_only_wanted_messages_are_built_and_all_are_counted(autopilot):
    codec = new_codec(wanted={mavlink.MAVLINK_MSG_ID_ATTITUDE})
    received = codec.receive(
        autopilot.heartbeat() + autopilot.attitude(1.0) + autopilot.heartbeat()
    )
    assert types(received) == ["ATTITUDE"]
    assert codec.statistics(1, 1).received == 3
    assert codec.statistics(1, 1).off_stream == 2
    assert codec.unwanted == [((1, 1), mavlink.MAVLINK_MSG_ID_HEARTBEAT)] * 2
    codec.receive(autopilot.attitude(2.0))
    assert codec.unwanted == []


def test_parameters_and_texts_belong_to_no_stream(autopilot):
    codec = new_codec()
    for message in (
        mavlink.MAVLink_param_value_message(b"MPC_XY_P", 0.95, 9, 2, 0),
        mavlink.MAVLink_statustext_message(6, b"ready"),
    ):
        codec.receive(autopilot.pack(message))
    codec.receive(autopilot.attitude(1.0))
    assert codec.statistics(1, 1).off_stream == 2


def test_packets_are_kept_whole_for_recording_except_those_with_a_secret(autopilot, ground_station):
    codec = new_codec(wanted=())
    packets = [autopilot.heartbeat(), unknown_packet(1)]
    signing = ground_station.send(
        "SETUP_SIGNING",
        target_system=1,
        target_component=1,
        secret_key=list(range(32)),
        initial_timestamp=1,
    )
    stream = b"noise" + packets[0] + packets[1] + signing
    codec.receive(stream[:10])
    assert codec.packets == []
    codec.receive(stream[10:])
    assert codec.packets == packets


def unknown_packet(sequence):
    return bytes([0xFD, 3, 0, 0, sequence, 1, 1, 0xF0, 0xFF, 0x10]) + b"abc" + b"\x00\x00"


def test_unknown_messages_are_skipped_and_count_in_the_sequence(autopilot):
    codec = new_codec()
    codec.receive(autopilot.heartbeat())
    codec.receive(unknown_packet(1))
    autopilot.skip(1)
    assert types(codec.receive(autopilot.heartbeat())) == ["HEARTBEAT"]
    assert codec.unknown_messages == 1
    assert (codec.statistics(1, 1).received, codec.statistics(1, 1).lost) == (3, 0)


def test_an_unknown_message_of_an_unknown_source_is_noise(autopilot):
    codec = new_codec()
    assert types(codec.receive(unknown_packet(1) + autopilot.heartbeat())) == ["HEARTBEAT"]
    assert codec.unknown_messages == 0
    assert codec.dropped_bytes == len(unknown_packet(1))


def counted(codec):
    statistics = codec.statistics(1, 1)
    return statistics.received, statistics.lost


def test_a_source_never_received_has_no_packets():
    assert counted(new_codec()) == (0, 0)


def test_three_missing_packets_are_three_lost(autopilot):
    codec = new_codec()
    codec.receive(autopilot.heartbeat())
    autopilot.skip(3)
    codec.receive(autopilot.heartbeat())
    assert counted(codec) == (2, 3)


def test_the_sequence_wraps_without_a_loss(autopilot):
    codec = new_codec()
    for _ in range(600):
        codec.receive(autopilot.heartbeat())
    assert counted(codec) == (600, 0)


def test_a_duplicate_counts_neither_as_received_nor_as_lost(autopilot):
    codec = new_codec()
    packets = [autopilot.heartbeat() for _ in range(3)]
    for packet in (*packets, packets[2], packets[0]):
        codec.receive(packet)
    assert counted(codec) == (3, 0)


def test_a_late_packet_was_not_lost(autopilot):
    codec = new_codec()
    packets = [autopilot.heartbeat() for _ in range(6)]
    for index in (0, 2, 1, 5, 4, 3):
        codec.receive(packets[index])
    assert counted(codec) == (6, 0)


def test_two_sources_have_sequences_of_their_own(autopilot, ground_station):
    codec = new_codec()
    ground_station.skip(100)
    for _ in range(10):
        codec.receive(autopilot.heartbeat() + ground_station.ground_heartbeat())
    assert counted(codec) == (10, 0)
    assert codec.statistics(255, 190).lost == 0


def test_a_restarted_sender_has_lost_no_packets(autopilot):
    codec = new_codec()
    for _ in range(100):
        codec.receive(autopilot.heartbeat())
    autopilot.restart()
    for _ in range(100):
        codec.receive(autopilot.heartbeat())
    assert counted(codec) == (200, 0)


def test_sent_packets_have_the_companions_ids_and_consecutive_numbers():
    codec = Codec(system_id=1, component_id=195)
    message = create("PING", time_usec=1, seq=2, target_system=0, target_component=0)
    reader = mavlink.MAVLink(None)
    first = reader.parse_buffer(codec.encode(message))[0]
    codec.system_id = 7
    numbers = [reader.parse_buffer(codec.encode(message))[0].get_header().seq for _ in range(300)]
    assert (first.get_srcSystem(), first.get_srcComponent(), first.get_header().seq) == (1, 195, 0)
    assert numbers == [number % 256 for number in range(1, 301)]
    assert codec.system_id == 7


@pytest.mark.recordings
@pytest.mark.parametrize(
    "name",
    [
        pytest.param("px4/c1_wind_v118.companion.tlog", marks=pytest.mark.slow),
        "ardupilot/a1_boot.companion.tlog",
    ],
)
def test_every_message_is_the_one_pymavlink_reads(recording, name):
    ours = new_codec()
    theirs = mavlink.MAVLink(None)
    theirs.robust_parsing = True
    for _, packet in recording(name):
        expected = [
            message
            for message in theirs.parse_buffer(packet) or []
            if not message.get_type().startswith("UNKNOWN")
        ]
        received = ours.receive(packet)
        assert [str(m) for m in received] == [str(m) for m in expected]
        assert [m.get_header().seq for m in received] == [m.get_header().seq for m in expected]
    assert ours.dropped_bytes == 0


@pytest.mark.recordings
@pytest.mark.parametrize(
    ("name", "lost"),
    [
        ("px4/b1_battery_drain.companion.tlog", 0),
        ("px4/k1_nogcs_autopilot_restart.companion.tlog", 0),
        ("ardupilot/a2_square.companion.tlog", 0),
        ("ardupilot/k2_reboot.companion.tlog", 0),
    ],
)
def test_on_a_good_recorded_link_no_packet_is_lost(recording, name, lost):
    codec = new_codec(wanted=())
    for _, packet in recording(name):
        codec.receive(packet)
    assert counted(codec)[1] == lost
    assert counted(codec)[0] > 200


@pytest.mark.recordings
def test_a_recorded_stream_with_gaps_loses_only_the_missing_packets(recording):
    packets = [packet for _, packet in recording("px4/h0_boot_rates.companion.tlog")][:3000]
    codec = new_codec()
    stream = b"".join(packets)
    holed = bytearray()
    for start in range(0, len(stream), 5000):
        holed += stream[start : start + 4960]
    received = []
    for start in range(0, len(holed), 97):
        received += codec.receive(bytes(holed[start : start + 97]))
    holes = len(stream) // 5000
    assert len(received) >= len(packets) - 4 * holes - len(packets) // 50
    statistics = codec.statistics(1, 1)
    assert 0 < statistics.lost < 6 * holes


def test_a_frame_is_valid_when_its_checksum_is_correct(autopilot):
    data = autopilot.heartbeat()
    assert is_sound(b"junk" + data, 4) is True
    assert is_sound(data[:-1] + bytes([data[-1] ^ 1]), 0) is False
    assert is_sound(b"\xfd\x00\x00\x00\x00\x01\x01\xff\xff\x7fXY", 0) is None


def test_senders_of_random_ids_do_not_fill_memory_and_a_later_autopilot_counts(peer):
    codec = new_codec()
    autopilot = peer(1, 1)
    for number in range(600):
        codec.receive(peer(2 + number % 250, number // 250).heartbeat())
        if number >= 300:
            codec.receive(autopilot.heartbeat())
    assert len(codec.sources) <= 256
    assert counted(codec) == (300, 0)


def test_sources_are_listed_in_the_order_received(peer):
    codec = new_codec()
    codec.receive(peer(7, 1).heartbeat() + peer(1, 1).heartbeat() + peer(7, 1).heartbeat())
    assert codec.sources == [(7, 1), (1, 1)]


def test_a_datagram_is_not_read_beyond_its_first_invalid_packet(autopilot):
    codec = new_codec()
    codec.whole_packets = True
    sound, cut = autopilot.heartbeat(), autopilot.attitude(1.0)[:20]
    for rest in (b"\x00", b"\xfe" * 300, cut, b"\xfd\xff\x04", sound[:-1] + b"\x00"):
        before = codec.dropped_bytes
        assert len(codec.receive(sound + rest + sound)) == 1
        assert codec.dropped_bytes == before + len(rest + sound)
    assert len(codec.receive(sound + sound[:5])) == 1
    assert len(codec.receive(sound + sound)) == 2

"""Records of a .tlog: whole, truncated, corrupted, and files that are no recording."""

from __future__ import annotations

import gzip
import random
import struct

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from moar_companion.mavlink.dialect import create
from moar_companion.mavlink.tlog import Tlog

from .conftest import SHARED
from .peer import Peer

T0_US = 1_700_000_000_000_000


def stamped(packet, time_us=T0_US):
    return struct.pack(">Q", time_us) + packet


def recorded(count=5):
    """Packets of both MAVLink versions, and their recording."""
    peer = Peer(1, 1)
    packets = [
        peer.pack(create("SYSTEM_TIME", time_unix_usec=n, time_boot_ms=n), mavlink1=n % 2 == 1)
        for n in range(count)
    ]
    data = b"".join(stamped(packet, T0_US + 100_000 * n) for n, packet in enumerate(packets))
    return packets, data


def packets_of(data):
    return [record.packet for record in Tlog(data)]


def test_records_have_their_times_and_packets():
    packets, data = recorded()
    tlog = Tlog(data)
    assert tlog.recognised
    records = list(tlog)
    assert [record.packet for record in records] == packets
    times_s = [record.time_s - T0_US * 1e-6 for record in records]
    assert times_s == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4], abs=1e-5)
    assert (tlog.bad_packets, tlog.skipped_bytes, tlog.cut_short) == (0, 0, False)


def test_a_truncated_recording_keeps_its_whole_records():
    packets, data = recorded(3)
    ends = [0]
    for packet in packets:
        ends.append(ends[-1] + 8 + len(packet))
    for size in range(len(data)):
        tlog = Tlog(data[:size])
        whole = sum(end <= size for end in ends[1:])
        assert [record.packet for record in tlog] == packets[:whole]
        assert tlog.cut_short == (size not in ends)
        assert tlog.skipped_bytes == 0


def test_a_broken_packet_is_left_out_and_counted():
    packets, data = recorded()
    broken = bytearray(data)
    broken[8 + len(packets[0]) + 8 + 7] ^= 0xFF
    tlog = Tlog(bytes(broken))
    assert [record.packet for record in tlog] == [packets[0], *packets[2:]]
    assert (tlog.bad_packets, tlog.skipped_bytes) == (1, 0)


@pytest.mark.parametrize("noise", [b"\x00", b"noise", b"\xfd", b"\xfe\x09" * 20, bytes(300)])
def test_after_stray_bytes_the_next_record_is_found(noise):
    packets, data = recorded()
    first = 8 + len(packets[0])
    tlog = Tlog(data[:first] + noise + data[first:])
    assert [record.packet for record in tlog] == packets
    assert tlog.skipped_bytes == len(noise)


def test_a_message_of_an_unknown_dialect_is_a_valid_record():
    packets, data = recorded(2)
    unknown = b"\xfd\x03\x00\x00\x07\x01\x01\xff\xff\x7fabcXY"
    assert packets_of(data + stamped(unknown) + data) == [*packets, unknown, *packets]


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 20,
        b"ULog\x01\x12\x35\x01" + random.Random(1).randbytes(50_000),
        b"time,roll,pitch\n" * 200,
        random.Random(2).randbytes(200_000),
        struct.pack(">Q", T0_US),
    ],
    ids=["empty", "picture", "ulog", "table", "noise", "time alone"],
)
def test_a_file_that_is_no_recording_is_rejected(data):
    assert not Tlog(data).recognised


def test_packets_without_time_stamps_are_no_recording():
    packets, _ = recorded()
    assert not Tlog(b"".join(packets)).recognised


@settings(max_examples=60, deadline=None)
@given(st.binary(max_size=400), st.integers(0, 200))
def test_reading_never_fails_and_accounts_for_every_byte(noise, position):
    _, data = recorded()
    position = min(position, len(data))
    mixed = data[:position] + noise + data[position:]
    tlog = Tlog(mixed)
    read = sum(8 + len(record.packet) for record in tlog)
    assert read + tlog.skipped_bytes <= len(mixed)


@pytest.mark.recordings
@pytest.mark.skipif(not (SHARED / "data").is_dir(), reason="no recordings beside the checkout")
@pytest.mark.parametrize(
    ("name", "packets", "bad"),
    [
        ("dronekit_flight_replay.tlog", 75_477, 1_314),
        ("pymavlink_swift_flight.tlog.gz", 163_851, 0),
        ("pymavlink_capture.mav2.battery_status.tlog", 1, 0),
    ],
)
def test_recordings_of_others_have_the_packets_that_pymavlink_finds(name, packets, bad):
    data = (SHARED / "data" / "mavlink_tlog" / name).read_bytes()
    tlog = Tlog(gzip.decompress(data) if name.endswith(".gz") else data)
    assert tlog.recognised
    assert sum(1 for _ in tlog) == packets
    assert tlog.bad_packets == bad

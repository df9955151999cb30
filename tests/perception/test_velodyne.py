"""Velodyne packets to scans: against the reference decoder, the simulator's truth, and damage."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from moar_companion.perception.lidar_scan import PacketFault
from moar_companion.perception.velodyne import PACKET_BYTES, VelodyneStream
from sitl.lidar import PACKET_S, Box, LidarScene, SimulatedLidar

vd = pytest.importorskip("velodyne_decoder")
RECORDING = Path(__file__).parents[3] / "shared/data/lidar_packets/vlp16go_recording.bin"


def at_rest(times):
    return np.zeros((len(times), 3)), np.tile(np.eye(3), (len(times), 1, 1))


def packets(seconds=0.25, scene=None):
    """Packets of a room of 10 m, with their times."""
    room = scene or LidarScene(
        boxes=(Box(lower_m=(4.0, -50.0, -50.0), upper_m=(5.0, 50.0, 50.0)),), ground_m=None,
        noise_m=0.0, dropout=0.0,
    )  # fmt: skip
    lidar = SimulatedLidar(room)
    return [
        (n * PACKET_S, lidar.packet(n * PACKET_S, at_rest)) for n in range(int(seconds / PACKET_S))
    ]


def scans(stream, received):
    return [scan for time_s, packet in received if (scan := stream.receive(packet, time_s))]


def test_a_wall_is_a_plane_at_its_distance():
    (scan, *_) = scans(VelodyneStream(), packets())
    near = scan.points_m[np.linalg.norm(scan.points_m, axis=1) < 30.0]
    assert len(near) > 1000
    assert near[:, 0] == pytest.approx(np.full(len(near), 4.0), abs=0.02)


def test_each_point_has_the_time_of_its_firing():
    (first, second, *_) = scans(VelodyneStream(), packets(0.35))
    assert 0.0 <= first.time_s.min() < first.time_s.max() < second.time_s.max() < 0.35
    azimuth = np.arctan2(-second.points_m[:, 1], second.points_m[:, 0])
    ahead = (azimuth > 0.4) & (azimuth < 1.2)
    turn = np.polyfit(second.time_s[ahead], azimuth[ahead], 1)[0]
    assert turn == pytest.approx(2.0 * np.pi * 10.0, rel=0.02)


@pytest.mark.recordings
@pytest.mark.skipif(not RECORDING.exists(), reason=f"no recording at {RECORDING}")
def test_a_real_recording_as_the_reference_decoder_has_it():
    content = RECORDING.read_bytes()
    received = [
        (0.001327 * n, content[start : start + PACKET_BYTES])
        for n, start in enumerate(range(0, len(content), PACKET_BYTES))
    ]
    stream = VelodyneStream()
    ours = scans(stream, received)
    decoder = vd.StreamDecoder(vd.Config(model=vd.Model.VLP16))
    reference = [done[1] for time_s, packet in received if (done := decoder.decode(time_s, packet))]
    assert stream.packets == 1000
    assert stream.refused == {}
    assert [len(scan.points_m) for scan in ours] == [len(rows) for rows in reference]
    assert len(ours) == 13
    for scan, rows in zip(ours, reference, strict=True):
        assert np.linalg.norm(scan.points_m, axis=1) == pytest.approx(
            np.linalg.norm(rows[:, :3], axis=1), abs=1e-5
        )
        assert np.ptp(scan.time_s) < 0.11


@pytest.mark.parametrize(
    ("broken", "kind"),
    [
        (lambda packet: packet[:700], PacketFault.CUT),
        (lambda _: b"", PacketFault.SIZE),
        (lambda _: bytes(512), PacketFault.SIZE),
        (lambda packet: packet + b"\0", PacketFault.SIZE),
        (lambda packet: packet[:-1] + b"\x99", PacketFault.MODEL),
        (lambda packet: packet[:300] + b"\0\0" + packet[302:], PacketFault.MARKS),
        (lambda packet: packet[:302] + b"\xff\xff" + packet[304:], PacketFault.MARKS),
    ],
)
def test_an_incomplete_packet_is_counted_and_dropped(broken, kind):
    stream = VelodyneStream()
    good = packets(0.12)
    whole = len(scans(VelodyneStream(), good)[0].points_m)
    spoilt = [good[0], (good[0][0] + 1e-4, broken(good[5][1])), *good[1:]]
    found = scans(stream, spoilt)
    assert stream.refused == {kind: 1}
    assert len(found[0].points_m) == whole


def as_model(packet, mode, model):
    return packet[:-2] + bytes((mode, model))


@pytest.mark.parametrize("mode", [0x00, 0x37, 0x38])
def test_an_hdl_32e_without_a_return_mode_is_read(mode):
    received = [(time_s, as_model(packet, mode, 0x21)) for time_s, packet in packets()]
    decoder = vd.StreamDecoder(vd.Config(model=vd.Model.HDL32E))
    reference = [done[1] for time_s, packet in received if (done := decoder.decode(time_s, packet))]
    stream = VelodyneStream()
    ours = scans(stream, received)
    assert stream.refused == {}
    assert [len(scan.points_m) for scan in ours] == [len(rows) for rows in reference]
    assert all(scan.beams % 384 == 0 for scan in ours)


def alpha_prime(packet, mode):
    """The packet with the block marks of an Alpha Prime; with two returns four blocks are empty."""
    blocks = [packet[start : start + 100] for start in range(0, 1200, 100)]
    per_mark = 2 if mode == 0x39 else 1
    marks = [b"\xff\xee", b"\xff\xdd", b"\xff\xcc", b"\xff\xbb"]
    used = [
        marks[number // per_mark % 4] + blocks[number // (4 * per_mark)][2:] for number in range(12)
    ]
    if mode == 0x39:
        used[8:] = [b"\0\0" + block[2:4] + bytes(96) for block in used[8:]]
    return b"".join(used) + packet[1200:1204] + bytes((mode, 0xA1))


@pytest.mark.parametrize("mode", [0x37, 0x39])
def test_an_alpha_prime_is_read(mode):
    received = [(time_s, alpha_prime(packet, mode)) for time_s, packet in packets()]
    decoder = vd.StreamDecoder(vd.Config(model=vd.Model.VLS128))
    reference = [done[1] for time_s, packet in received if (done := decoder.decode(time_s, packet))]
    stream = VelodyneStream()
    ours = scans(stream, received)
    assert stream.refused == {}
    assert [len(scan.points_m) for scan in ours] == [len(rows) for rows in reference] != []


def test_what_a_capture_has_of_its_last_turn_is_read():
    stream = VelodyneStream()
    assert stream.finish() is None
    assert scans(stream, packets(0.05)) == []
    assert len(stream.finish().points_m) > 1000


def test_a_turn_with_lost_packets_has_the_points_of_the_others():
    received = packets(0.35)
    _, whole, *_ = scans(VelodyneStream(), received)
    stream = VelodyneStream()
    lost = [each for each in received if abs(each[0] - np.quantile(whole.time_s, 0.25)) < 0.01]
    _, part, *_ = scans(stream, [each for each in received if each not in lost])
    assert len(lost) > 10
    assert stream.packets == len(received) - len(lost)
    assert 0.6 * len(whole.points_m) < len(part.points_m) < len(whole.points_m)
    assert {tuple(point) for point in part.points_m} < {tuple(point) for point in whole.points_m}


def test_random_bytes_never_raise():
    random = np.random.default_rng(0)
    stream = VelodyneStream()
    (_, good), *_ = packets(0.01)
    for _ in range(300):
        spoilt = bytearray(good)
        for place in random.integers(0, PACKET_BYTES, 20):
            spoilt[place] = random.integers(0, 256)
        stream.receive(bytes(spoilt), 0.0)
        stream.receive(random.bytes(PACKET_BYTES), 0.0)
    assert stream.packets + stream.refused.total() == 600

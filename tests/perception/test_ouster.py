"""Ouster packets to scans: against the maker's own decoder, with lost and damaged packets."""

from __future__ import annotations

import json

import numpy as np
import pytest

from moar_companion.perception.lidar_scan import PacketFault
from moar_companion.perception.ouster import OusterStream

from .captures import FOLDER, OUSTERS, metadata, packets, recorded

core = pytest.importorskip("ouster.sdk.core", reason="needs the extra ouster")
pytestmark = recorded
DUAL, LEGACY = OUSTERS
STEP_S = 0.1 / 64


def stream(name):
    return OusterStream(metadata(name))


def scans(receiver, received):
    return [scan for time_s, packet in received if (scan := receiver.receive(packet, time_s))]


def turn(name, number, start_s, *, clock_s=0.0, without=()):
    """The capture's packets as the turn with this number, from start_s on.

    clock_s: what the sensor's clock has advanced since the capture.
    """
    layout = core.PacketFormat(core.SensorInfo(metadata(name)))
    for place, (_, content) in enumerate(packets(name)):
        packet = core.LidarPacket(layout)
        packet.buf[:] = np.frombuffer(content, np.uint8)
        layout.set_frame_id(packet, number)
        stamps_ns = layout.packet_header(core.ColHeader.TIMESTAMP, packet.buf)
        for column, stamp_ns in enumerate(stamps_ns):
            layout.set_col_timestamp(packet, column, int(stamp_ns + 1e9 * clock_s))
        if place not in without:
            yield start_s + STEP_S * place, packet.buf.tobytes()


@pytest.fixture
def reference():
    """The maker's decoder of whole captures."""
    from ouster.sdk import open_source

    def decode(name):
        capture = str(FOLDER / f"{name}.pcap")
        source = open_source(capture, meta=[str(FOLDER / f"{name}.json")])
        to_points = core.XYZLut(core.SensorInfo(metadata(name)), use_extrinsics=False)
        (frames,) = source
        (frame,) = frames
        returns = [frame.field(name) for name in ("RANGE", "RANGE2") if frame.has_field(name)]
        return np.concatenate([to_points(ranges)[ranges > 0] for ranges in returns])

    return decode


@pytest.mark.parametrize(("name", "count"), [(DUAL, 21_803), (LEGACY, 27_310)])
def test_a_capture_has_the_points_of_the_makers_decoder(name, count, reference):
    receiver = stream(name)
    (scan,) = scans(receiver, packets(name))
    expected = reference(name)
    assert (receiver.packets, receiver.refused) == (64, {})
    assert len(scan.points_m) == len(expected) == count
    assert scan.points_m == pytest.approx(expected, abs=1e-5)
    assert np.linalg.norm(scan.points_m, axis=1) == pytest.approx(
        np.linalg.norm(expected, axis=1), abs=1e-5
    )


@pytest.mark.parametrize("name", OUSTERS)
def test_rings_count_upwards(name):
    (scan,) = scans(stream(name), packets(name))
    elevation = np.arctan2(scan.points_m[:, 2], np.hypot(*scan.points_m[:, :2].T))
    far = np.linalg.norm(scan.points_m, axis=1) > 5.0
    middle = [np.median(elevation[far & (scan.ring == ring)]) for ring in np.unique(scan.ring[far])]
    assert np.all(np.diff(middle) > 0.0)
    assert (scan.ring.min(), scan.ring.max()) == (0, 31)


@pytest.mark.parametrize("name", OUSTERS)
def test_times_are_those_of_the_receiver_for_any_clock_of_the_sensor(name):
    (scan,) = scans(stream(name), turn(name, 7, 50.0, clock_s=1.6e9))
    azimuth = np.unwrap(np.sort(-np.arctan2(scan.points_m[:, 1], scan.points_m[:, 0])))
    assert np.ptp(azimuth) > 6.0
    assert 49.99 < scan.time_s.min() < 50.0
    assert scan.time_s.max() == pytest.approx(50.0 + 63 * STEP_S, abs=1e-3)


def test_packets_that_come_late_all_at_once_are_dated_by_those_that_did_not():
    received = [
        (max(time_s, 50.05), packet) if time_s < 50.05 else (time_s, packet)
        for time_s, packet in turn(DUAL, 7, 50.0)
    ]
    (prompt,) = scans(stream(DUAL), turn(DUAL, 7, 50.0))
    (held_up,) = scans(stream(DUAL), received)
    assert held_up.time_s == pytest.approx(prompt.time_s, abs=1e-3)


def test_a_step_of_the_sensors_clock_within_a_turn_moves_no_point():
    before, after = list(turn(DUAL, 7, 50.0)), list(turn(DUAL, 7, 50.0, clock_s=1.6e9))
    (scan,) = scans(stream(DUAL), [*before[:30], *after[30:]])
    (steady,) = scans(stream(DUAL), before)
    assert scan.time_s == pytest.approx(steady.time_s, abs=2e-3)


@pytest.mark.parametrize("name", OUSTERS)
@pytest.mark.parametrize("without", [(3, 4, 30), (0,), (63,), tuple(range(20, 60))])
def test_a_turn_with_lost_packets_has_the_points_of_the_others(name, without):
    receiver = stream(name)
    received = [*turn(name, 7, 50.0, without=without), *turn(name, 8, 50.1, clock_s=0.1)]
    part, whole = scans(receiver, received)
    assert 0.2 * len(whole.points_m) < len(part.points_m) < len(whole.points_m)
    assert {tuple(point) for point in part.points_m} < {tuple(point) for point in whole.points_m}


def test_packets_in_another_order_or_twice_make_the_same_scan():
    received = list(turn(DUAL, 7, 50.0))
    (whole,) = scans(stream(DUAL), received)
    mixed = [*received[:10], received[12], received[10], received[11], received[11], *received[13:]]
    again = [*mixed, received[63], *turn(DUAL, 8, 50.1)]
    (first, second) = scans(stream(DUAL), again)
    assert np.array_equal(first.points_m, whole.points_m)
    assert np.array_equal(second.points_m, whole.points_m)


def test_a_sensor_that_restarts_is_still_received():
    received = [*turn(DUAL, 900, 50.0), *turn(DUAL, 0, 60.0), *turn(DUAL, 1, 60.1)]
    assert len(scans(stream(DUAL), received)) == 3


def serial(packet, digits):
    return packet[:7] + digits + packet[12:]


def checksum(packet, field):
    return packet[:-8] + field


@pytest.mark.parametrize(
    ("name", "broken", "kind"),
    [
        (DUAL, lambda packet: packet[:5000], PacketFault.CUT),
        (LEGACY, lambda packet: packet[:5000], PacketFault.CUT),
        (DUAL, lambda _: b"", PacketFault.SIZE),
        (DUAL, lambda _: bytes(48), PacketFault.SIZE),
        (DUAL, lambda packet: packet + b"\0", PacketFault.SIZE),
        (DUAL, lambda packet: serial(packet, b"\1\1\1\1\1"), PacketFault.SENSOR),
        (DUAL, lambda packet: checksum(packet, b"\1" * 8), PacketFault.CHECKSUM),
        (LEGACY, lambda _: b"\xff\xee" + bytes(1204), PacketFault.SIZE),
        (LEGACY, lambda packet: packet[:8] + b"\xff\xff" + packet[10:], PacketFault.ORDER),
        (LEGACY, lambda packet: packet[:8] + b"\x05\x00" + packet[10:], PacketFault.ORDER),
        (LEGACY, lambda packet: packet[:7] + b"\x70" + packet[8:], PacketFault.ORDER),
        (DUAL, lambda packet: packet[:40] + b"\xff\xff" + packet[42:], PacketFault.ORDER),
    ],
)
def test_an_incomplete_packet_is_counted_and_dropped(name, broken, kind):
    receiver = stream(name)
    received = list(packets(name))
    (whole,) = scans(stream(name), received)
    time_s, packet = received[5]
    (scan,) = scans(receiver, [*received[:5], (time_s, broken(packet)), *received[5:]])
    assert receiver.refused == {kind: 1}
    assert np.array_equal(scan.points_m, whole.points_m)


def test_a_packet_without_a_serial_number_is_taken_as_the_maker_takes_it():
    (whole,) = scans(stream(DUAL), packets(DUAL))
    bare = [(time_s, serial(packet, bytes(5))) for time_s, packet in packets(DUAL)]
    (scan,) = scans(stream(DUAL), bare)
    assert np.array_equal(scan.points_m, whole.points_m)


@pytest.mark.parametrize(
    ("field", "refused"),
    [(bytes(8), 0), (0xDEADBEEF0000C0DE.to_bytes(8, "little"), 0), (b"no check", 1)],
    ids=["firmware 2.2", "firmware 2.3 and 2.4", "another constant"],
)
def test_a_constant_in_the_checksums_field_is_no_checksum(field, refused):
    receiver = stream(DUAL)
    scans(receiver, [(time_s, checksum(packet, field)) for time_s, packet in packets(DUAL)])
    assert (receiver.packets, receiver.refused.total()) == (64 - refused, refused)


def written(profile, header, window):
    """A turn with random ranges in a profile, as the maker writes it: description and packets."""
    info = core.SensorInfo(metadata(DUAL))
    info.format.udp_profile_lidar = profile
    info.format.header_type = header
    info.format.column_window = window
    frame = core.LidarFrame(info)
    frame.frame_id = 3
    frame.status[:] = 1
    frame.timestamp[:] = 1_000_000 * np.arange(1, frame.w + 1)
    frame.measurement_id[:] = np.arange(frame.w)
    random = np.random.default_rng(0)
    layout = core.PacketFormat(info)
    names = [name for name in layout.fields if name.startswith("RANGE")]
    points = 0
    for number, name in enumerate(names, 1):
        # A profile for tests has whole words alone, which begin with the range.
        field = frame.field(name if frame.has_field(name) else f"RAW32_WORD{number}")
        field[:] = 8 * random.integers(0, 3000, (frame.h, frame.w))
        points += np.count_nonzero(field)
    made = core.frame_to_packets(frame, layout, info.init_id, info.sn)
    return info, [packet.buf.tobytes() for packet in made], points


@pytest.mark.parametrize("header", [core.HeaderType.STANDARD, core.HeaderType.FUSA], ids=str)
@pytest.mark.parametrize(
    "profile",
    [
        value
        for name, value in vars(core.UDPProfileLidar).items()
        if isinstance(value, core.UDPProfileLidar) and name not in {"OFF", "UNKNOWN"}
    ],
    ids=str,
)
def test_each_profile_of_the_makers_decoder_is_read(profile, header):
    info, made, points = written(profile, header, (0, 1023))
    receiver = OusterStream(info.to_json_string())
    found = scans(receiver, [(50.0 + STEP_S * n, packet) for n, packet in enumerate(made)])
    assert (receiver.packets, receiver.refused) == (64, {})
    assert [len(scan.points_m) for scan in found] == [points]


def test_a_sensor_that_sends_no_data_is_refused():
    info = core.SensorInfo(metadata(DUAL))
    info.format.udp_profile_lidar = core.UDPProfileLidar.OFF
    with pytest.raises(ValueError, match=r"^describes an Ouster whose data packets are off"):
        OusterStream(info.to_json_string())


def test_what_a_capture_has_of_its_last_turn_is_read():
    receiver = stream(DUAL)
    assert scans(receiver, packets(DUAL)[:1]) == []
    assert len(receiver.finish().points_m) == 223
    assert receiver.finish() is None


@pytest.mark.parametrize("name", OUSTERS)
def test_random_bytes_never_raise(name):
    random = np.random.default_rng(0)
    receiver = stream(name)
    size = len(packets(name)[0][1])
    for time_s, packet in packets(name) * 4:
        spoilt = bytearray(packet)
        for place in random.integers(0, size, 200):
            spoilt[place] = random.integers(0, 256)
        receiver.receive(bytes(spoilt), time_s)
        receiver.receive(random.bytes(size), time_s)
        receiver.receive(random.bytes(random.integers(0, size)), time_s)
    assert receiver.packets + receiver.refused.total() == 3 * 4 * 64


def test_the_description_names_the_port():
    assert stream(DUAL).port == 7502
    assert stream(LEGACY).port == 0


@pytest.mark.parametrize("text", ["", "nonsense", "[1]", "{}", json.dumps({"data_format": {}})])
def test_a_text_that_describes_no_sensor_is_refused_in_one_line(text):
    with pytest.raises(ValueError, match=r"^is no description of an Ouster: [^\n]+$"):
        OusterStream(text)

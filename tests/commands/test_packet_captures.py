"""Packet captures of lidars to points, and one line for those that give none."""

from __future__ import annotations

import io

import numpy as np
import pytest

from moar_companion.commands.packet_captures import data_packets, read_capture, udp_packets
from moar_companion.commands.point_clouds import read_cloud
from moar_companion.errors import InputError
from sitl.lidar import PACKET_S, Box, LidarScene, SimulatedLidar
from tests.perception.captures import FOLDER, OUSTERS, packets, recorded

dpkt = pytest.importorskip("dpkt")
pytest.importorskip("velodyne_decoder")


def datagram(payload, port=2368):
    return dpkt.udp.UDP(sport=4000, dport=port, ulen=8 + len(payload), data=payload)


def internet(content, **fields):
    header = {"src": b"\xc0\xa8\1\xc9", "dst": b"\xc0\xa8\1\2", "p": 17, "len": 20 + len(content)}
    return dpkt.ip.IP(**header | fields, data=content)


def frame(packet):
    return bytes(dpkt.ethernet.Ethernet(type=0x0800, data=packet))


def capture(path, packets, link=1):
    """Writes packets, each a time and the bytes of its frame."""
    with path.open("wb") as stream:
        writer = dpkt.pcap.Writer(stream, linktype=link, snaplen=65_535)
        for time_s, content in packets:
            writer.writepkt(content, time_s)
    return str(path)


def turns(seconds):
    """Data packets of a Velodyne in a room of 10 m, with their times."""
    walls = (Box(lower_m=(4.0, -50.0, -50.0), upper_m=(5.0, 50.0, 50.0)),)
    lidar = SimulatedLidar(LidarScene(boxes=walls, ground_m=None, noise_m=0.0, dropout=0.0))

    def at_rest(times):
        return np.zeros((len(times), 3)), np.tile(np.eye(3), (len(times), 1, 1))

    for number in range(int(seconds / PACKET_S)):
        time_s = number * PACKET_S
        yield time_s, lidar.packet(time_s, at_rest)


def velodyne(path, seconds=0.35, **fields):
    content = [
        (1e9 + time_s, frame(internet(datagram(packet, **fields))))
        for time_s, packet in turns(seconds)
    ]
    return capture(path, content)


def refusal(*arguments):
    with pytest.raises(InputError) as refused:
        read_capture(*arguments)
    assert "\n" not in str(refused.value)
    return str(refused.value)


def test_the_points_of_all_turns_are_read(tmp_path):
    points = read_capture(velodyne(tmp_path / "scan.pcap"), None, None)
    assert len(points) > 2000
    assert points[:, 0] == pytest.approx(np.full(len(points), 4.0), abs=0.02)
    assert len(read_cloud(str(tmp_path / "scan.pcap"), None).points) == len(points)


def test_another_port_is_read_if_the_option_names_the_port(tmp_path):
    file = velodyne(tmp_path / "scan.pcap", port=2369)
    assert len(read_capture(file, None, 2369)) > 2000
    assert refusal(file, None, None).endswith(
        "has no data packets of a Velodyne at UDP port 2368; its UDP packets: "
        "263 at 2369; an Ouster's need --metadata FILE.json, others --port N"
    )


def test_each_packet_has_its_time_and_port(tmp_path):
    frames = [
        (5.0, frame(internet(datagram(b"a", 1)))),
        (5.5, frame(internet(datagram(b"bc", 2)))),
        (6.0, b"no frame"),
        (6.5, frame(dpkt.ip6.IP6(nxt=17, plen=10, data=datagram(b"de", 2)))),
        (7.0, frame(internet(dpkt.tcp.TCP(dport=2, data=b"other"), p=6))),
        (7.5, frame(dpkt.arp.ARP())),
    ]
    file = capture(tmp_path / "scan.pcap", frames)
    assert list(udp_packets(file)) == [(5.0, 1, b"a"), (5.5, 2, b"bc"), (6.5, 2, b"de")]
    assert list(data_packets(file, 2)) == [(5.5, b"bc"), (6.5, b"de")]


@pytest.mark.parametrize("order", [(0, 1, 2), (0, 2, 1), (2, 1, 0)])
def test_a_datagram_in_fragments_is_put_together(order, tmp_path):
    payload = bytes(np.random.default_rng(0).integers(0, 256, 4000, np.uint8))
    whole = bytes(datagram(payload))
    parts = [
        frame(internet(whole[start : start + 1480], id=9, mf=start < 2960, offset=start // 8))
        for start in (0, 1480, 2960)
    ]
    lost = frame(internet(whole[:1480], id=8, mf=1))
    content = [(4.0, lost), *((5.0 + place, parts[place]) for place in order)]
    (only,) = udp_packets(capture(tmp_path / "scan.pcap", content))
    assert (only[1], only[2]) == (2368, payload)


@pytest.mark.parametrize(
    ("link", "header"),
    [(101, b""), (113, b"\0\0\0\1\0\6" + bytes(8) + b"\x08\0"), (0, b"\2\0\0\0")],
    ids=["raw IP", "Linux cooked", "loopback"],
)
def test_captures_of_other_interfaces_are_read(link, header, tmp_path):
    content = [(5.0, header + bytes(internet(datagram(b"abc"))))]
    assert list(udp_packets(capture(tmp_path / "scan.pcap", content, link))) == [
        (5.0, 2368, b"abc")
    ]


def test_a_pcapng_is_read(tmp_path):
    stream = io.BytesIO()
    writer = dpkt.pcapng.Writer(stream)
    writer.writepkt(frame(internet(datagram(b"abc"))), 5.0)
    (tmp_path / "scan.pcapng").write_bytes(stream.getvalue())
    assert list(udp_packets(str(tmp_path / "scan.pcapng"))) == [(5.0, 2368, b"abc")]


def test_a_capture_that_was_cut_off_is_read_up_to_there(tmp_path):
    file = tmp_path / "scan.pcap"
    velodyne(file)
    whole = len(list(udp_packets(str(file))))
    file.write_bytes(file.read_bytes()[: -3 * 1264 - 700])
    assert whole - 4 <= len(list(udp_packets(str(file)))) <= whole - 3
    assert len(read_capture(str(file), None, None)) > 1000


@pytest.mark.parametrize("content", [b"", b"x", bytes(40), b"\xd4\xc3\xb2\xa1", b"\n\r\r\n" * 9])
def test_a_file_that_is_no_capture_is_refused(content, tmp_path):
    file = tmp_path / "scan.pcap"
    file.write_bytes(content)
    assert refusal(str(file), None, None) == f"{file}: cannot be read as a packet capture"


def test_a_capture_of_another_interface_is_refused(tmp_path):
    file = capture(tmp_path / "scan.pcap", [(5.0, bytes(60))], link=127)
    assert refusal(file, None, None) == f"{file}: cannot be read as a packet capture"


def test_a_part_of_a_turn_is_read(tmp_path):
    file = velodyne(tmp_path / "scan.pcap", seconds=0.05)
    assert len(read_capture(file, None, None)) > 1000


def test_a_capture_whose_packets_are_all_refused_says_why(tmp_path):
    spoilt = [packet[:300] + b"\0\0" + packet[302:] for _, packet in turns(0.1)]
    frames = [(5.0, frame(internet(datagram(packet)))) for packet in spoilt]
    hint = "an Ouster's need --metadata FILE.json, others --port N"
    assert refusal(capture(tmp_path / "scan.pcap", frames), None, None).endswith(
        f": has 75 packets at UDP port 2368, all with wrong marks; {hint}"
    )
    frames += [(5.0, frame(internet(datagram(bytes(48)))))] * 4
    assert refusal(capture(tmp_path / "scan.pcap", frames), None, None).endswith(
        f": has 79 packets at UDP port 2368, 75 with wrong marks, 4 of another size; {hint}"
    )


def test_a_capture_without_udp_is_refused(tmp_path):
    file = capture(tmp_path / "scan.pcap", [])
    assert "; its UDP packets: none; " in refusal(file, None, None)


@pytest.mark.parametrize(("option", "value"), [("metadata", "a.json"), ("port", 2368)])
def test_options_of_captures_are_refused_for_other_files(option, value, tmp_path):
    file = tmp_path / "scan.xyz"
    file.write_text("1 2 3\n" * 100)
    with pytest.raises(InputError, match=f"^--{option}: is for a packet capture: .pcap or .pcapng"):
        read_cloud(str(file), None, **{option: value})


class TestOfAnOuster:
    pytestmark = recorded

    @pytest.mark.parametrize(("name", "count"), [(OUSTERS[0], 21_803), (OUSTERS[1], 27_310)])
    def test_the_points_are_read_with_the_description_of_the_sensor(self, name, count):
        pytest.importorskip("ouster.sdk")
        file, metadata = str(FOLDER / f"{name}.pcap"), str(FOLDER / f"{name}.json")
        assert len(read_capture(file, metadata, None)) == count

    def test_a_missing_description_is_asked_for(self):
        file = str(FOLDER / f"{OUSTERS[0]}.pcap")
        assert "64 at 7502, 10 at 7503; an Ouster's need --metadata" in refusal(file, None, None)

    @pytest.mark.parametrize(
        ("content", "problem"),
        [
            (None, "no such file"),
            (b"\xff\xfe", "is no text"),
            (b"{}", "is no description of an Ouster: "),
        ],
    )
    def test_a_file_that_is_no_description_is_refused(self, content, problem, tmp_path):
        pytest.importorskip("ouster.sdk")
        metadata = tmp_path / "sensor.json"
        if content is not None:
            metadata.write_bytes(content)
        file = str(FOLDER / f"{OUSTERS[0]}.pcap")
        assert refusal(file, str(metadata), None).startswith(f"{metadata}: {problem}")

    def test_the_description_of_another_sensor_finds_no_packets(self):
        pytest.importorskip("ouster.sdk")
        file, metadata = str(FOLDER / f"{OUSTERS[0]}.pcap"), str(FOLDER / f"{OUSTERS[1]}.json")
        assert refusal(file, metadata, None).endswith(
            ": has 64 packets at UDP port 7502, all of another size"
        )

    def test_wrong_checksums_are_named(self, tmp_path):
        pytest.importorskip("ouster.sdk")
        name = OUSTERS[0]
        frames = [
            (time_s, frame(internet(datagram(packet[:-8] + number.to_bytes(8, "big"), 7502))))
            for number, (time_s, packet) in enumerate(packets(name), 1)
        ]
        file, metadata = capture(tmp_path / "scan.pcap", frames), str(FOLDER / f"{name}.json")
        assert refusal(file, metadata, None).endswith(
            ": has 64 packets at UDP port 7502, all with a wrong checksum"
        )


@pytest.mark.slow
@pytest.mark.recordings
@pytest.mark.skipif(not FOLDER.exists(), reason=f"no packet captures at {FOLDER}")
def test_a_real_velodynes_turns_are_those_of_the_reference_reader(tmp_path):
    import velodyne_decoder

    recording = (FOLDER / "vlp16go_recording.bin").read_bytes()
    frames = [
        (1e9 + 0.001327 * number, frame(internet(datagram(recording[start : start + 1206]))))
        for number, start in enumerate(range(0, len(recording), 1206))
    ]
    file = capture(tmp_path / "scan.pcap", frames)
    config = velodyne_decoder.Config(model=velodyne_decoder.Model.VLP16)
    reference = [rows for _, rows in velodyne_decoder.read_pcap(file, config)]
    points = read_capture(file, None, None)
    whole = np.concatenate([rows[:, :3] for rows in reference])
    assert len(points) == len(whole) > 201_812
    assert np.linalg.norm(points, axis=1) == pytest.approx(np.linalg.norm(whole, axis=1), abs=1e-5)

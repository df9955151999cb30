"""Files that ground stations download from a session, by the clients that they have."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from pymavlink import mavftp
from pymavlink.dialects.v20 import all as mavlink

from moar_companion.mavlink.component.component_metadata import metadata_files
from moar_companion.mavlink.component.file_server import file_crc32
from moar_companion.mavlink.session import Session, SystemStatus
from moar_companion.settings.link_config import LinkRole
from tests.mavlink.lossy_network import LossyNetwork
from tests.thorough import sampled

from .ftp_client import ACK, BURST, LIST, NAK, OPEN, READ, RESET, reply_of, request

NETWORK, SERIAL = "tcp:127.0.0.1:5760", "serial:/dev/ttyTHS1:57600"
FILES = metadata_files(195)
EOF, MISSING = 6, 10


class World:
    """A session and a ground station beside it, on one link with a network in between."""

    def __init__(self, link=NETWORK, **losses):
        self.link, self.now_s = link, 1000.0
        self.session = Session(links={link: LinkRole.OPERATOR})
        self.up, self.down = (LossyNetwork(seed, **losses) for seed in ("up", "down"))
        self.mav = mavlink.MAVLink(self, srcSystem=255, srcComponent=190)
        self._reader = mavlink.MAVLink(None)
        self.received = []
        self.received_bytes = 0

    def write(self, packet):
        """Sends a packet of the ground station; `MAVLink` calls it."""
        self.up.send(bytes(packet), self.now_s)

    def step(self):
        self.now_s += 0.02
        for packet in self.up.arrived(self.now_s):
            self.session.receive(self.link, packet, self.now_s)
        self.session.tick(self.now_s, SystemStatus.ACTIVE)
        for _, packet in self.session.data_to_send():
            self.down.send(packet, self.now_s)
            self.received_bytes += len(packet)
        for packet in self.down.arrived(self.now_s):
            self.received += [
                message
                for message in self._reader.parse_buffer(packet) or []
                if message.get_type() == "FILE_TRANSFER_PROTOCOL"
            ]


class Master:
    """What pymavlink's client sees of a connection; it waits in the world's time."""

    source_system, source_component = 255, 190

    def __init__(self, world):
        self.world, self.mav = world, world.mav

    def recv_match(self, *, blocking=False, timeout=0.0, **_):
        for _ in range(max(1, round(timeout / 0.02)) if blocking else 1):
            if self.world.received:
                break
            self.world.step()
        return self.world.received.pop(0) if self.world.received else None


@pytest.fixture
def pymavlink_client(monkeypatch, tmp_path):
    """Makes pymavlink's client beside a world."""
    monkeypatch.chdir(tmp_path)

    def made(world):
        def sleep(duration_s):
            world.now_s += duration_s

        clock = SimpleNamespace(time=lambda: world.now_s, sleep=sleep)
        monkeypatch.setattr(mavftp, "time", clock)
        return mavftp.MAVFTP(Master(world), target_system=1, target_component=195)

    return made


def downloaded(client, name):
    """Content of a file by pymavlink's client; None where the client gives up."""
    content = []
    client.cmd_get([f"/{name}"], callback=lambda file: content.append(file and file.read()))
    client.process_ftp_reply("OpenFileRO", timeout=300.0)
    return content[0] if content else None


@pytest.mark.parametrize("link", [NETWORK, SERIAL])
def test_pymavlink_downloads_every_file_and_lists_them(pymavlink_client, link):
    world = World(link, loss=0.0, doubled=0.0, delay_s=0.0)
    client = pymavlink_client(world)
    for name, file in FILES.items():
        assert downloaded(client, name) == file
    listed = client.cmd_list(["/"])
    assert {entry.name: entry.size_b for entry in listed.directory_listing} == {
        name: len(file) for name, file in FILES.items()
    }
    assert client.cmd_crc(["/general.json.xz"]).error_code == mavftp.FtpError.Success
    assert downloaded(client, "etc/passwd") is None
    assert client.cmd_rm(["/general.json.xz"]).error_code == mavftp.FtpError.FileProtected


@pytest.mark.parametrize("link", [NETWORK, SERIAL])
@pytest.mark.parametrize("seed", range(sampled(2, 300)))
def test_pymavlink_downloads_the_same_bytes_over_a_network_that_loses_a_third(
    pymavlink_client, link, seed
):
    world = World(link)
    world.up, world.down = LossyNetwork(f"up {seed}"), LossyNetwork(f"down {seed}")
    client = pymavlink_client(world)
    for name, file in FILES.items():
        contents = [downloaded(client, name)]
        while contents[-1] is None and len(contents) < 200:  # it asks to open a file thrice
            contents.append(downloaded(client, name))
        assert contents[-1] == file


class GroundStation:
    """A client that works as QGroundControl's: one request at a time, answered within a second.

    A burst notes holes in the file, and is asked for again from the end of what has arrived; then
    the holes are read. Numbers of requests follow those of the last reply; older ones are ignored.
    """

    RETRIES = 3

    def __init__(self, world):
        self.world, self.next_expected = world, 0

    def download(self, name):
        """Content of a file; None where the client gives up."""
        self.data, self.holes = {}, []
        opened = self._answer_to(OPEN, data=f"/{name}".encode(), retries=self.RETRIES)
        if opened is None or opened.opcode != ACK:
            return None
        size = int.from_bytes(opened.data, "little")
        if not self._burst() or not all(map(self._fill, self.holes)):
            return None
        self._answer_to(RESET, retries=0)
        content = b"".join(self.data[offset] for offset in sorted(self.data))
        return content if len(content) == size else None

    def _burst(self):
        end, silent = 0, 0
        self._send(BURST, size=239, offset=end)
        while silent <= self.RETRIES:
            reply = self._next(BURST)
            if reply is None:
                silent += 1
                self.next_expected -= 2  # the same number again
                self._send(BURST, size=239, offset=end)
            elif reply.opcode == NAK:
                assert reply.error == EOF
                if reply.sequence == self.next_expected:
                    return True
                self.next_expected = reply.sequence
                self._send(BURST, size=239, offset=end)
            elif reply.sequence >= self.next_expected and reply.offset >= end:
                silent = 0
                if reply.offset > end:
                    self.holes.append((end, reply.offset))
                self.data[reply.offset] = reply.data
                end = reply.offset + reply.size
                self.next_expected = reply.sequence + (not reply.burst_complete)
                if reply.burst_complete:
                    self._send(BURST, size=239, offset=end)
        return False

    def _fill(self, hole):
        begin, end = hole
        while begin < end:
            reply = self._answer_to(
                READ, size=min(239, end - begin), offset=begin, retries=self.RETRIES
            )
            if reply is None or reply.opcode != ACK:
                return False
            self.data[begin] = reply.data
            begin += reply.size
        return True

    def _answer_to(self, opcode, *, retries, **fields):
        self._send(opcode, **fields)
        for attempt in range(retries + 1):
            while (reply := self._next(opcode)) is not None:
                if reply.sequence == self.next_expected:
                    return reply
            if attempt < retries:
                self.next_expected -= 2
                self._send(opcode, **fields)
        return None

    def _send(self, opcode, **fields):
        sequence = (self.next_expected + 1) & 0xFFFF
        self.next_expected += 2
        self.world.mav.send(request(sequence, opcode, **fields))

    def _next(self, opcode):
        """Next reply to the opcode within a second that is not older than what is expected."""
        until_s = self.world.now_s + 1.0
        while self.world.now_s < until_s:
            while self.world.received:
                reply = reply_of(self.world.received.pop(0))
                late = (self.next_expected - 1 - reply.sequence) & 0xFFFF < 0x7FFF
                if reply.requested == opcode and not late:
                    return reply
            self.world.step()
        return None


@pytest.mark.parametrize("link", [NETWORK, SERIAL])
def test_a_client_like_qgroundcontrols_downloads_every_file(link):
    world = World(link, loss=0.0, doubled=0.0, delay_s=0.1)
    client = GroundStation(world)
    assert {name: client.download(name) for name in FILES} == dict(FILES)
    assert client.download("param.pck") is None


@pytest.mark.parametrize("link", [NETWORK, SERIAL])
@pytest.mark.parametrize("seed", range(sampled(2, 300)))
def test_a_client_like_qgroundcontrols_never_has_a_wrong_file_over_a_network_that_loses_a_third(
    link, seed
):
    world = World(link)
    world.up, world.down = LossyNetwork(f"up {seed}"), LossyNetwork(f"down {seed}")
    client = GroundStation(world)
    for name, file in FILES.items():
        contents = [client.download(name)]
        while contents[-1] is None and len(contents) < 200:
            contents.append(client.download(name))
        assert contents[-1] == file


def test_the_longest_file_takes_a_slow_line_seconds_and_no_more_than_its_share():
    world = World(SERIAL, loss=0.0, doubled=0.0, delay_s=0.0)
    began_s = world.now_s
    assert GroundStation(world).download("parameter.json.xz") == FILES["parameter.json.xz"]
    took_s = world.now_s - began_s
    assert took_s < 30.0
    assert world.received_bytes < 0.3 * 5760 * took_s


def test_the_checksum_is_that_which_the_server_gives():
    world = World(loss=0.0, doubled=0.0, delay_s=0.0)
    world.mav.send(request(1, LIST, data=b"/"))
    world.step()
    world.mav.send(request(3, 14, data=b"/general.json.xz"))
    world.step()
    world.step()
    *_, crc = map(reply_of, world.received)
    assert int.from_bytes(crc.data, "little") == file_crc32(FILES["general.json.xz"])

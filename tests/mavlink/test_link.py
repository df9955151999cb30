from __future__ import annotations

import asyncio
import contextlib
import errno
import fcntl
import logging
import math
import os
import pty
import socket
import sys
import termios
import threading
import time
import tty

import pytest
import serial as serial_module

from moar_companion.errors import LinkError
from moar_companion.mavlink import link as link_module
from moar_companion.mavlink import udp_link
from moar_companion.mavlink.link import open_link
from moar_companion.mavlink.link_basics import clock_s
from moar_companion.mavlink.urls import LinkAddress, LinkKind
from moar_companion.service.pools import started_pool

pytestmark = pytest.mark.asyncio

SIOCOUTQNSD = 0x894B
"""Request for the number of unsent bytes of a TCP connection (tcp(7))."""


class Received:
    """Delivered data of a link; can be waited for."""

    def __init__(self):
        self.data = b""
        self.addresses = []
        """Sender addresses of datagrams to a listening link."""
        self._arrived = asyncio.Event()

    def __call__(self, data, arrived_s=None, address=None):
        self.arrived_s = arrived_s
        if address is not None and address not in self.addresses:
            self.addresses.append(address)
        self.data += data
        self._arrived.set()

    async def until(self, data):
        while data not in self.data:
            self._arrived.clear()
            await asyncio.wait_for(self._arrived.wait(), 5.0)


def free_port(kind):
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def at_once(monkeypatch):
    """Reconnects without a pause, and counts each connection as success."""
    monkeypatch.setattr(link_module, "_FIRST_PAUSE_S", 0.0)
    monkeypatch.setattr(link_module, "_STEADY_S", 0.0)


def udp_listen(port, host="127.0.0.1"):
    return LinkAddress(kind=LinkKind.UDP_LISTEN, host=host, port=port)


def udp_send(port, host="127.0.0.1"):
    return LinkAddress(kind=LinkKind.UDP_SEND, host=host, port=port)


def tcp(port, host="127.0.0.1"):
    return LinkAddress(kind=LinkKind.TCP, host=host, port=port)


HOSTS = pytest.mark.parametrize("host", ["127.0.0.1", "::1"])


@HOSTS
async def test_two_udp_links_exchange_data(host):
    port = free_port(socket.SOCK_DGRAM)
    here, there = Received(), Received()
    async with open_link(udp_listen(port, host), here) as listener:
        listener.send(b"nobody is there yet")
        async with open_link(udp_send(port, host), there) as sender:
            sender.send(b"hello")
            await here.until(b"hello")
            listener.send(b"welcome", math.inf, here.addresses)
            await there.until(b"welcome")
    assert there.data == b"welcome"


async def test_a_listening_link_sends_to_its_peers_alone():
    port = free_port(socket.SOCK_DGRAM)
    here, first, second = Received(), Received(), Received()
    async with (
        open_link(udp_listen(port), here) as listener,
        open_link(udp_send(port), first) as one,
        open_link(udp_send(port), second) as two,
    ):
        one.send(b"one")
        await here.until(b"one")
        two.send(b"two")
        await here.until(b"two")
        listener.send(b"nobody")
        listener.send(b"both", math.inf, here.addresses)
        await first.until(b"both")
        await second.until(b"both")
        listener.send(b"second", math.inf, here.addresses[1:])
        await second.until(b"second")
    assert first.data == b"both"
    assert second.data == b"bothsecond"


async def test_a_listening_link_whose_peer_is_gone_receives_the_next_one():
    port = free_port(socket.SOCK_DGRAM)
    here = Received()
    async with open_link(udp_listen(port), here) as listener:
        async with open_link(udp_send(port), Received()) as gone:
            gone.send(b"first")
            await here.until(b"first")
        for _ in range(100):
            listener.send(b"to a closed port", math.inf, here.addresses)
        there = Received()
        async with open_link(udp_send(port), there) as following:
            following.send(b"second")
            await here.until(b"second")
            listener.send(b"welcome", math.inf, here.addresses)
            await there.until(b"welcome")
    assert len(here.addresses) == 2


class Arrivals:
    """Arrived data, with the times."""

    def __init__(self):
        self.items = []

    def __call__(self, data, arrived_s, _address):
        self.items.append((data, arrived_s))


async def test_three_seconds_of_px4_wait_without_loss_and_are_read_at_one_wake_up():
    port = free_port(socket.SOCK_DGRAM)
    here = Arrivals()
    sent = [b"%40d" % number for number in range(1236)]
    async with open_link(udp_listen(port), here):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot:
            for data in sent:  # the loop is held meanwhile
                autopilot.sendto(data, ("127.0.0.1", port))
        turns = 0
        while len(here.items) < len(sent):
            await asyncio.sleep(0)
            turns += 1
            assert turns < 10
    assert [data for data, _ in here.items] == sent


async def test_a_datagram_has_the_time_of_its_arrival_not_of_its_reading():
    port = free_port(socket.SOCK_DGRAM)
    here = Arrivals()
    async with open_link(udp_listen(port), here):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot:
            await asyncio.sleep(0.1)  # the kernel begins to stamp a moment after the request
            before_s = clock_s()
            autopilot.sendto(b"early", ("127.0.0.1", port))
            after_s = clock_s()
            time.sleep(0.1)  # noqa: ASYNC251 - the loop is held
            autopilot.sendto(b"late", ("127.0.0.1", port))
        while len(here.items) < 2:  # noqa: ASYNC110
            await asyncio.sleep(0)
    (_, early_s), (_, late_s) = here.items
    assert before_s - 0.005 <= early_s <= after_s + 0.005
    assert late_s - early_s >= 0.1
    assert late_s <= clock_s()


@pytest.mark.parametrize("step_s", [-3600.0, 3600.0])
async def test_a_step_of_the_wall_clock_dates_no_packet_before_the_last_reading(
    step_s, monkeypatch
):
    port = free_port(socket.SOCK_DGRAM)
    here = Arrivals()
    async with open_link(udp_listen(port), here):
        opened_s, wall = clock_s(), time.time
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot:
            autopilot.sendto(b"hello", ("127.0.0.1", port))
            monkeypatch.setattr(udp_link.time, "time", lambda: wall() + step_s)
            while not here.items:  # noqa: ASYNC110
                await asyncio.sleep(0)
    assert opened_s - 0.02 <= here.items[0][1] <= clock_s()


async def test_datagrams_dropped_by_a_full_buffer_are_reported(monkeypatch, caplog):
    monkeypatch.setattr(udp_link, "_RECEIVE_BYTES", 4096)
    port = free_port(socket.SOCK_DGRAM)
    here = Arrivals()
    async with open_link(udp_listen(port), here):
        assert "net.core.rmem_max" in caplog.text
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as autopilot:
            for _ in range(100):
                autopilot.sendto(b"position", ("127.0.0.1", port))
            while not here.items:  # noqa: ASYNC110
                await asyncio.sleep(0)
            autopilot.sendto(b"position", ("127.0.0.1", port))
            read = len(here.items)
            while len(here.items) == read:  # noqa: ASYNC110
                await asyncio.sleep(0)
    assert f"{101 - len(here.items)} datagrams lost, read too late" in caplog.text


async def test_a_port_in_use_is_reported_in_one_line():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        with pytest.raises(LinkError) as refused:
            async with open_link(udp_listen(port), Received()):
                pass
    assert str(refused.value) == f"udpin:127.0.0.1:{port}: in use by another program"


@pytest.mark.parametrize(
    "address", [udp_send(1, "no.such.host.invalid"), tcp(1, "no.such.host.invalid")]
)
async def test_a_host_name_that_is_not_found_is_reported_in_one_line(address, monkeypatch):
    async def refuse(*_args, **_options):
        raise socket.gaierror(socket.EAI_NONAME, "Name or service not known")

    monkeypatch.setattr(asyncio.get_running_loop(), "getaddrinfo", refuse)
    with pytest.raises(LinkError, match="the name is not found"):
        async with open_link(address, Received()):
            pass


def failing(function, *failures):
    """The function, whose first calls fail."""
    left = list(failures)

    def called(*arguments, **options):
        if left:
            raise left.pop(0)
        return function(*arguments, **options)

    return called


NO_NETWORK = OSError(errno.ENETUNREACH, "Network is unreachable")
NO_NAME_SERVER = socket.gaierror(socket.EAI_AGAIN, "Temporary failure in name resolution")


@pytest.mark.parametrize(
    ("owner", "name", "failure", "words"),
    [
        (socket.socket, "connect", NO_NETWORK, "network is unreachable"),
        (socket, "getaddrinfo", NO_NAME_SERVER, "no name server answers"),
    ],
)
async def test_a_sending_link_awaits_its_network(owner, name, failure, words, monkeypatch, caplog):
    """A modem may connect later than the service starts, or never."""
    at_once(monkeypatch)
    monkeypatch.setattr(owner, name, failing(getattr(owner, name), failure, failure))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
        peer.bind(("127.0.0.1", 0))
        peer.setblocking(False)
        async with open_link(udp_send(peer.getsockname()[1], "localhost"), Received()) as link:
            assert words in caplog.text
            link.send(b"dropped")
            data = b""
            while data != b"heartbeat":
                link.send(b"heartbeat")
                await asyncio.sleep(0)
                with contextlib.suppress(BlockingIOError):
                    data = peer.recv(100)


@pytest.mark.parametrize("number", [errno.ENETUNREACH, errno.EINVAL])
async def test_a_sending_link_whose_network_is_gone_takes_the_next_one(number, monkeypatch, caplog):
    at_once(monkeypatch)
    here, port = Received(), free_port(socket.SOCK_DGRAM)
    async with (
        open_link(udp_listen(port), here),
        open_link(udp_send(port), Received()) as sender,
    ):
        sender.send(b"before")
        await here.until(b"before")
        failure = OSError(number, os.strerror(number))
        monkeypatch.setattr(socket.socket, "send", failing(socket.socket.send, failure))
        while b"after" not in here.data:
            sender.send(b"after")
            await asyncio.sleep(0)
    assert os.strerror(number).lower() in caplog.text
    assert len(here.addresses) == 2


async def test_a_refused_address_of_a_sending_link_is_reported_in_one_line():
    with pytest.raises(LinkError, match="permission denied"):
        async with open_link(udp_send(14550, "255.255.255.255"), Received()):
            pass


async def test_an_absent_udp_peer_is_warned_of_once(caplog):
    caplog.set_level(logging.DEBUG, logger=udp_link.__name__)
    port = free_port(socket.SOCK_DGRAM)
    async with open_link(udp_send(port), Received()) as sender:
        while len(caplog.records) < 2:
            sender.send(b"anybody?")
            await asyncio.sleep(0)
    assert [record.levelname for record in caplog.records[:2]] == ["WARNING", "DEBUG"]
    assert "connection refused" in caplog.text


class Server:
    """A TCP peer that accepts, remembers its connections and can be stopped."""

    def __init__(self):
        self.received = Received()
        self.writers = []
        self.connected = asyncio.Event()

    async def serve(self, port, host="127.0.0.1"):
        self._server = await asyncio.start_server(self._accept, host, port)
        return self._server.sockets[0].getsockname()[1]

    async def _accept(self, reader, writer):
        self.writers.append(writer)
        self.connected.set()
        with contextlib.suppress(OSError):
            while data := await reader.read(1000):
                self.received(data)
        writer.close()

    async def until_connected(self):
        await asyncio.wait_for(self.connected.wait(), 5.0)
        self.connected.clear()

    def drop(self):
        for writer in self.writers:
            writer.transport.abort()

    def stop(self):
        self.drop()
        self._server.close()


@HOSTS
async def test_a_lost_tcp_link_reconnects(host, monkeypatch, caplog):
    at_once(monkeypatch)
    caplog.set_level(logging.INFO, logger=link_module.__name__)
    server, here = Server(), Received()
    port = await server.serve(0, host)
    async with open_link(tcp(port, host), here) as link:
        await server.until_connected()
        link.send(b"first")
        await server.received.until(b"first")
        server.writers[0].write(b"answer")
        await here.until(b"answer")
        server.drop()
        await server.until_connected()
        while b"second" not in server.received.data:
            link.send(b"second")
            await asyncio.sleep(0)
        while len(caplog.records) < 2:  # noqa: ASYNC110 — the log has no event
            await asyncio.sleep(0)
    server.stop()
    levels = [record.levelname for record in caplog.records]
    assert levels == ["WARNING", "INFO"]
    assert "connected again" in caplog.text


async def test_a_tcp_link_connects_to_a_peer_that_starts_later(monkeypatch, caplog):
    at_once(monkeypatch)
    caplog.set_level(logging.DEBUG, logger=link_module.__name__)
    port = free_port(socket.SOCK_STREAM)
    server = Server()
    async with open_link(tcp(port), Received()) as link:
        link.send(b"dropped")
        while len(caplog.records) < 3:  # noqa: ASYNC110 — the log has no event
            await asyncio.sleep(0)
        await server.serve(port)
        await server.until_connected()
    server.stop()
    levels = [record.levelname for record in caplog.records if record.name == link_module.__name__]
    assert levels[:3] == ["WARNING", "DEBUG", "DEBUG"]


async def test_a_tcp_server_that_restarts_is_connected_to_again(monkeypatch, caplog):
    at_once(monkeypatch)
    caplog.set_level(logging.DEBUG, logger=link_module.__name__)
    server, later, here = Server(), Server(), Received()
    port = await server.serve(0)
    async with open_link(tcp(port), here):
        await server.until_connected()
        server.stop()
        while "connection refused" not in caplog.text:  # noqa: ASYNC110 — the log has no event
            await asyncio.sleep(0)
        await later.serve(port)
        await later.until_connected()
        later.writers[0].write(b"started again")
        await here.until(b"started again")
    later.stop()


@pytest.fixture
def pauses_s(monkeypatch):
    """Pauses of a link before its attempts, which take no time here."""
    pauses_s, sleep = [], asyncio.sleep

    async def skip(delay_s):
        if delay_s > 0.0:
            pauses_s.append(delay_s)
        await sleep(0)

    monkeypatch.setattr(asyncio, "sleep", skip)
    return pauses_s


BACKOFF_S = [0.1, 0.2, 0.4, 0.8, 1.6, 2.0, 2.0, 2.0]


async def enough_attempts(pauses_s):
    while len(pauses_s) < len(BACKOFF_S):  # noqa: ASYNC110 — each fails by itself
        await asyncio.sleep(0)


async def test_a_peer_that_accepts_and_closes_at_once_is_retried_ever_less_often(pauses_s, caplog):
    caplog.set_level(logging.DEBUG, logger=link_module.__name__)
    accepted = []

    def close_at_once(_reader, writer):
        accepted.append(writer)
        writer.transport.abort()

    server = await asyncio.start_server(close_at_once, "127.0.0.1", 0)
    async with server, open_link(tcp(server.sockets[0].getsockname()[1]), Received()):
        await enough_attempts(pauses_s)
    assert pauses_s[: len(BACKOFF_S)] == BACKOFF_S
    assert len(accepted) <= len(pauses_s) + 1
    levels = {record.levelname for record in caplog.records[1:]}
    assert (caplog.records[0].levelname, levels) == ("WARNING", {"DEBUG"})


async def test_a_serial_device_that_opens_and_fails_at_once_is_retried_ever_less_often(
    pauses_s, monkeypatch
):
    connect, opened = link_module._connect_serial, []

    def fail(_descriptor, _size):
        raise OSError(errno.EIO, "Input/output error")

    with serial_line() as (far, device):

        async def connect_and_fail(address, on_bytes):
            connection = await connect(address, on_bytes)
            opened.append(len(pauses_s))
            os.write(far, b"readable")
            return connection

        monkeypatch.setattr(link_module, "_connect_serial", connect_and_fail)
        monkeypatch.setattr(os, "read", fail)
        async with open_link(serial(device), Received()):
            await enough_attempts(pauses_s)
    assert pauses_s[: len(BACKOFF_S)] == BACKOFF_S
    assert opened[: len(BACKOFF_S)] == list(range(len(BACKOFF_S)))


async def test_after_a_steady_connection_the_first_pause_is_short_again(pauses_s, monkeypatch):
    monkeypatch.setattr(link_module, "_STEADY_S", 0.0)
    server = Server()
    port = await server.serve(0)
    async with open_link(tcp(port), Received()):
        for _ in range(4):
            await server.until_connected()
            for _ in range(10):
                await asyncio.sleep(0)
            server.drop()
        await server.until_connected()
    server.stop()
    assert pauses_s == [0.1] * 4


async def test_a_slow_host_name_lookup_takes_one_thread(monkeypatch):
    at_once(monkeypatch)
    monkeypatch.setattr(link_module, "_CONNECT_TIMEOUT_S", 0.01)
    answers, asked, attempts = threading.Event(), [], []
    server, find = Server(), socket.getaddrinfo
    port = await server.serve(0)

    def stuck(host, *arguments, **options):
        if host != "gcs.local":
            return find(host, *arguments, **options)
        asked.append(host)
        answers.wait(20)
        return find("127.0.0.1", *arguments, **options)

    def complain(_link, why):
        attempts.append(why)

    monkeypatch.setattr(socket, "getaddrinfo", stuck)
    monkeypatch.setattr(link_module._Reconnecting, "_complain", complain)
    asyncio.get_running_loop().set_default_executor(started_pool("links", 2))
    with serial_line() as (_, device):
        async with open_link(tcp(port, "gcs.local"), Received()):
            while len(attempts) < 5:  # noqa: ASYNC110 - each fails by itself
                await asyncio.sleep(0)
            async with open_link(serial(device), Received()):
                assert (asked, set(attempts)) == (["gcs.local"], {"no answer"})
            monkeypatch.setattr(link_module, "_CONNECT_TIMEOUT_S", 5.0)
            answers.set()
            await server.until_connected()
    server.stop()


async def test_of_several_addresses_of_a_host_name_the_first_that_answers_is_used(monkeypatch):
    server, here = Server(), Received()
    port = await server.serve(0)
    find = socket.getaddrinfo

    def two(_host, *rest, **options):
        return find("127.0.0.9", *rest, **options) + find("127.0.0.1", *rest, **options)

    monkeypatch.setattr(socket, "getaddrinfo", two)
    async with open_link(tcp(port, "gcs.local"), here):
        await server.until_connected()
    server.stop()


async def test_a_stalled_tcp_peer_receives_no_old_data():
    server = Server()
    stalled = asyncio.Event()

    async def stall(_reader, writer):
        await stalled.wait()
        writer.close()

    server._accept = stall
    port = await server.serve(0)
    async with open_link(tcp(port), Received()) as link:
        for _ in range(20_000):
            link.send(b"x" * 1000)
        transport = link._connection._transport
        assert transport.get_write_buffer_size() <= 1000
        waiting = fcntl.ioctl(transport.get_extra_info("socket"), SIOCOUTQNSD, bytes(4))
        assert int.from_bytes(waiting, sys.byteorder) <= link_module._UNSENT_BYTES + 1000
    stalled.set()
    server.stop()


@contextlib.contextmanager
def serial_line():
    """The far end's descriptor and the near end's device name of a line."""
    far, near = pty.openpty()
    tty.setraw(near)
    try:
        yield far, os.ttyname(near)
    finally:
        os.close(near)
        with contextlib.suppress(OSError):
            os.close(far)


def serial(device, baud=57600):
    return LinkAddress(kind=LinkKind.SERIAL, device=str(device), baud=baud)


async def read_far(far, size):
    loop = asyncio.get_running_loop()
    data = b""
    readable = asyncio.Event()
    loop.add_reader(far, readable.set)
    try:
        while len(data) < size:
            await asyncio.wait_for(readable.wait(), 5.0)
            data += os.read(far, 4096)
            readable.clear()
    finally:
        loop.remove_reader(far)
    return data


async def test_a_serial_link_carries_bytes_both_ways():
    here = Received()
    with serial_line() as (far, device):
        async with open_link(serial(device), here) as link:
            link.send(b"\x00\xfd\x0d\x0a\x11\x13")
            assert await read_far(far, 6) == b"\x00\xfd\x0d\x0a\x11\x13"
            os.write(far, b"\xfd\x0a\x0d\x00")
            await here.until(b"\xfd\x0a\x0d\x00")


async def test_a_stuck_serial_line_drops_the_oldest_whole_packets_and_never_blocks():
    with serial_line() as (far, device):
        async with open_link(serial(device), Received()) as link:
            packets = [b"%05d" % number * 20 for number in range(2000)]
            for packet in packets:
                link.send(packet)
            link.send(b"the end")
            data = b""
            while not data.endswith(b"the end"):
                data += await read_far(far, 1)
    body = data[: -len(b"the end")]
    arrived = [body[start : start + 100] for start in range(0, len(body), 100)]
    assert all(packet in packets for packet in arrived)
    assert arrived[0] == packets[0]
    assert arrived[-10:] == packets[-10:]
    assert len(arrived) < 1000


async def test_a_full_serial_line_drops_other_packets_before_setpoints():
    with serial_line() as (far, device):
        async with open_link(serial(device), Received()) as link:
            while not link._connection._waiting:
                link.send(b"stuck" * 100)
            setpoints = [b"SETPOINT %d." % number for number in range(5)]
            for setpoint in setpoints:
                link.send(setpoint, 60.0)
            for _ in range(1000):
                link.send(b"an answer to a ping" * 5)
            link.send(b"the end")
            data = b""
            while not data.endswith(b"the end"):
                data += await read_far(far, 1)
    assert b"".join(setpoints) in data


async def test_a_serial_line_that_was_stuck_sends_no_late_setpoints():
    with serial_line() as (far, device):
        async with open_link(serial(device), Received()) as link:
            while not link._connection._waiting:
                link.send(b"stuck" * 100)
            link.send(b"A SETPOINT", 0.0)
            link.send(b"A TEXT")
            link.send(b"THE NEXT SETPOINT", 60.0)
            data = b""
            while not data.endswith(b"THE NEXT SETPOINT"):
                data += await read_far(far, 1)
    assert data.endswith(b"stuckA TEXTTHE NEXT SETPOINT")


async def test_a_missing_device_is_reported_in_one_line():
    with pytest.raises(LinkError) as refused:
        async with open_link(serial("/dev/no-such-tty"), Received()):
            pass
    assert str(refused.value) == "serial:/dev/no-such-tty:57600: no such file or directory"


async def test_a_device_in_use_is_reported_in_one_line():
    with serial_line() as (_, device):
        async with open_link(serial(device), Received()):
            with pytest.raises(LinkError, match="in use by another program"):
                async with open_link(serial(device), Received()):
                    pass


async def test_closing_a_serial_line_waits_until_sent_data_are_written(monkeypatch):
    """The last setpoint, at rest; on a UART it waits in the kernel for some milliseconds."""
    dropped = []
    monkeypatch.setattr(serial_module.Serial, "reset_output_buffer", dropped.append)
    with serial_line() as (far, device):
        async with open_link(serial(device), Received()) as link:
            link.send(b"the last word")
        assert await read_far(far, 13) == b"the last word"
    assert dropped == []


async def test_closing_a_lost_serial_line_does_not_wait(monkeypatch):
    dropped = asyncio.Event()
    monkeypatch.setattr(serial_module.Serial, "reset_output_buffer", lambda _: dropped.set())
    with serial_line() as (far, device):
        async with open_link(serial(device), Received()):
            os.close(far)
            await asyncio.wait_for(dropped.wait(), 5.0)


async def test_a_device_that_comes_back_as_another_tty_is_opened_by_the_same_name(
    monkeypatch, tmp_path, caplog
):
    at_once(monkeypatch)
    caplog.set_level(logging.INFO, logger=link_module.__name__)
    by_id, here = tmp_path / "usb-FTDI_FT232R-if00-port0", Received()
    with serial_line() as (first, ttyusb0), serial_line() as (second, ttyusb1):
        by_id.symlink_to(ttyusb0)
        async with open_link(serial(by_id), here) as link:
            os.write(first, b"before")
            await here.until(b"before")
            os.close(first)
            by_id.unlink()
            while not caplog.records:  # noqa: ASYNC110 — the log has no event
                await asyncio.sleep(0)
            by_id.symlink_to(ttyusb1)
            while "connected again" not in caplog.text:  # noqa: ASYNC110
                await asyncio.sleep(0)
            os.write(second, b"after")
            await here.until(b"after")
            link.send(b"a setpoint")
            assert await read_far(second, 10) == b"a setpoint"


@pytest.mark.parametrize(
    ("failure", "words"),
    [
        (termios.error(errno.EIO, "Input/output error"), "input/output error"),
        (ValueError("Failed to set custom baud rate (31250)"), "Failed to set custom baud rate"),
        (OSError(errno.EIO, "Input/output error"), "input/output error"),
    ],
)
async def test_a_device_that_fails_while_it_is_opened_is_reported_and_tried_again(
    failure, words, monkeypatch, caplog
):
    at_once(monkeypatch)
    caplog.set_level(logging.DEBUG, logger=link_module.__name__)
    port_class, here = serial_module.Serial, Received()

    def fail(*_arguments, **_options):
        raise failure

    with serial_line() as (far, device), serial_line() as (again, other):
        os.set_blocking(again, False)
        monkeypatch.setattr(serial_module, "Serial", fail)
        with pytest.raises(LinkError, match=words):
            async with open_link(serial(device), here):
                pass
        monkeypatch.setattr(serial_module, "Serial", port_class)
        async with open_link(serial(device), here):
            monkeypatch.setattr(serial_module, "Serial", fail)
            os.close(far)
            while words not in caplog.text:  # noqa: ASYNC110 — the log has no event
                await asyncio.sleep(0)
            monkeypatch.setattr(
                serial_module, "Serial", lambda _, *rest, **more: port_class(other, *rest, **more)
            )
            while b"back" not in here.data:
                with contextlib.suppress(BlockingIOError):
                    os.write(again, b"back")
                await asyncio.sleep(0)


async def test_an_unplugged_device_is_warned_of_and_awaited(monkeypatch, caplog):
    at_once(monkeypatch)
    caplog.set_level(logging.DEBUG, logger=link_module.__name__)
    with serial_line() as (far, device):
        async with open_link(serial(device), Received()) as link:
            os.close(far)
            while not caplog.records:
                link.send(b"hello?")
                await asyncio.sleep(0)
    assert caplog.records[0].levelname == "WARNING"
    assert caplog.records[0].message.startswith(f"serial:{device}:57600: ")

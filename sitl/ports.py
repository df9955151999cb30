"""Sockets for the links: udpin, udpout, tcpin, tcp.

A port carries bytes between one link of the machine and one peer. Of MAVLink it reads only the ends
of packets: over UDP each is a datagram.
"""

import asyncio
import contextlib
import re
import socket
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol, cast

from sitl.wire import packets

_URL: Final = re.compile(
    r"(?P<kind>udpin|udpout|udp|tcpin|tcp):(?://)?(?P<host>[^:]*|\[[^]]*\]):(?P<port>\d{1,5})$"
)
_MAX_PORT: Final = 65535
_MAX_BACKLOG_BYTES: Final = 1_000_000
Take = Callable[[bytes], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Url:
    """Address of a link: kind (udpin, udpout, tcpin, tcp), host and port."""

    kind: str
    host: str
    port: int

    @staticmethod
    def parse(text: str) -> "Url":
        """Read KIND:HOST:PORT; `ValueError` names the allowed forms."""
        found = _URL.match(text)
        if found is None or not 0 < int(found["port"]) <= _MAX_PORT:
            raise ValueError(
                f"{text!r}: must be udpin:HOST:PORT, udpout:HOST:PORT, tcpin:HOST:PORT"
                " or tcp:HOST:PORT"
            )
        kind = "udpin" if found["kind"] == "udp" else found["kind"]
        listens = kind in ("udpin", "tcpin")
        host = found["host"].strip("[]") or ("0.0.0.0" if listens else "127.0.0.1")  # noqa: S104
        try:
            host.encode("idna")
        except UnicodeError:
            raise ValueError(f"{text!r}: {host!r} is no name of a host") from None
        return Url(kind=kind, host=host, port=int(found["port"]))

    def __str__(self) -> str:
        return f"{self.kind}:{self.host}:{self.port}"


class Port(Protocol):
    """An open port."""

    def send(self, data: bytes) -> None:
        """Send whole packets to the peer, if there is one."""

    def close(self) -> None:
        """Close the socket."""


class _Udp(asyncio.DatagramProtocol):
    """A UDP socket; without a fixed peer it answers the last sender."""

    def __init__(self, take: Take, peer: tuple[str, int] | None) -> None:
        self._take = take
        self._peer: tuple[str, int] | None = peer
        self._fixed = peer is not None
        self._transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = cast(asyncio.DatagramTransport, transport)

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        if not self._fixed:
            self._peer = addr
        self._take(data)

    def error_received(self, exc: Exception) -> None:
        """Ignore a port without a listener; as with a real vehicle that is no fault."""

    def send(self, data: bytes) -> None:
        if self._transport is None or self._peer is None:
            return
        # One message in each datagram, as PX4 and ArduPilot send them.
        for packet in packets(data):
            self._transport.sendto(packet, self._peer)

    def close(self) -> None:
        if self._transport is not None:
            self._transport.close()


class _Tcp(asyncio.Protocol):
    """TCP streams; the newest peer has the link."""

    def __init__(self, take: Take) -> None:
        self._take = take
        self._transport: asyncio.Transport | None = None
        self.server: asyncio.AbstractServer | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        if self._transport is not None:
            self._transport.close()
        self._transport = cast(asyncio.Transport, transport)

    def data_received(self, data: bytes) -> None:
        self._take(data)

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 - asyncio's name
        if self._transport is not None and self._transport.is_closing():
            self._transport = None

    def send(self, data: bytes) -> None:
        transport = self._transport
        if transport is None or transport.is_closing():
            return
        if transport.get_write_buffer_size() < _MAX_BACKLOG_BYTES:
            transport.write(data)

    def close(self) -> None:
        if self.server is not None:
            self.server.close()
        if self._transport is not None:
            with contextlib.suppress(OSError):
                self._transport.close()


class Datagrams:
    """Datagrams to one address, with or without a receiver; a full buffer drops datagrams."""

    _address: tuple[str | int, ...] | tuple[int, bytes]

    def __init__(self, host: str, port: int) -> None:
        """Resolve the host; OSError when it is unknown."""
        found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
        family, kind, protocol, _, self._address = found
        self._socket = socket.socket(family, kind, protocol)
        self._socket.setblocking(False)

    def send(self, data: bytes) -> None:
        """Send one datagram."""
        with contextlib.suppress(OSError):
            self._socket.sendto(data, self._address)

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


async def open_port(url: Url, take: Take) -> Port:
    """Open a port that passes received bytes to `take`; OSError when that fails."""
    loop = asyncio.get_running_loop()
    if url.kind == "udpin":
        _, udp = await loop.create_datagram_endpoint(
            lambda: _Udp(take, None), local_addr=(url.host, url.port)
        )
        return udp
    if url.kind == "udpout":
        found = await loop.getaddrinfo(url.host, url.port)
        peer = (str(found[0][4][0]), url.port)
        _, udp = await loop.create_datagram_endpoint(
            lambda: _Udp(take, peer),
            local_addr=("::" if ":" in peer[0] else "0.0.0.0", 0),  # noqa: S104
        )
        return udp
    tcp = _Tcp(take)
    if url.kind == "tcpin":
        tcp.server = await loop.create_server(lambda: tcp, url.host, url.port)
    else:
        await loop.create_connection(lambda: tcp, url.host, url.port)
    return tcp

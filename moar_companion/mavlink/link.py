"""Sockets and serial port, the I/O of this package with `udp_link` and `link_basics`.

`open_link` carries bytes between an address and a callback in the running asyncio loop. A
connection (TCP, serial) is used once; the loop around it reconnects. UDP has no connection.

Every portion carries the time of its arrival. A datagram's is the kernel's, so that waiting in the
kernel does not count as delay of the network. A stream's is the time of reading.

No call waits for a peer. A serial port keeps unwritten packets up to a limit and drops the oldest
first, since an old setpoint is worse than none. Bytes in the kernel cannot be dropped: 4096 bytes
of a UART, which are 44 ms at 921600 baud and 0.7 s at 57600.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import os
import socket
import termios
from collections import deque
from collections.abc import AsyncIterator, Callable, Sequence
from typing import Any, Protocol

from ..errors import LinkError
from .link_basics import SEND_BUFFER_BYTES, OnBytes, clock_s, reason
from .peers import Address
from .udp_link import NO_NETWORK, connect_udp, listen_udp
from .urls import LinkAddress, LinkKind

_FIRST_PAUSE_S = 0.1
_LONGEST_PAUSE_S = 2.0
"""Pause before reconnecting: doubled after each failure, up to the longest."""
_STEADY_S = 1.0
"""Duration of a connection that counts as success: a peer that accepts and closes at once, or a
device that opens and fails at once, is retried ever less often."""
_CONNECT_TIMEOUT_S = 5.0
_READ_BYTES = 4096
_UNSENT_BYTES = 512
"""Limit of unsent bytes in a TCP connection beyond the peer's window."""
_UNANSWERED_MS = 1000
"""Time without acknowledgement after which a TCP connection and its unsent bytes are dropped."""
_SERIAL_BUFFER_S = 0.25
"""Limit of the companion's serial buffer, in transmission time."""
_MIN_SERIAL_BUFFER_BYTES = 1024
_TCP_NOTSENT_LOWAT = 25
"""Linux constant; the socket module has it from Python 3.12 on."""
_FAILURES = (OSError, ValueError, termios.error, asyncio.TimeoutError)
"""Failures to connect. pyserial raises ValueError for a baud rate that the device refuses, and
termios.error for a device that fails while it is configured."""

_logger = logging.getLogger(__name__)


class Link(Protocol):
    """One open link."""

    def send(
        self, data: bytes, within_s: float = math.inf, peers: Sequence[Address] = (), /
    ) -> None:
        """Sends one packet without waiting; drops the packet if the link has no peer.

        within_s: greatest time in the companion's buffer; an older packet is dropped.
        peers: addresses to which a listening link sends; other links have one peer.
        """


@contextlib.asynccontextmanager
async def open_link(address: LinkAddress, on_bytes: OnBytes) -> AsyncIterator[Link]:
    """Opens the link to an address; calls on_bytes in the loop with received bytes.

    Raises LinkError with one line if the link cannot be opened: a port in use, a missing device, a
    name that is not found. An absent TCP peer or network, and a connection lost later, are retried,
    after 0.1 s first, in the end every 2 s. Names are looked up again each time: a device's,
    `/dev/serial/by-id/…`, may lead to another tty then.
    """
    if address.kind is LinkKind.UDP_LISTEN:
        listener = await listen_udp(address, on_bytes)
        try:
            yield listener
        finally:
            listener.close()
        return
    if address.kind is LinkKind.TCP:
        link = _Reconnecting(address, _TcpConnector(address, on_bytes).connect)
    elif address.kind is LinkKind.UDP_SEND:
        link = _Reconnecting(address, lambda: connect_udp(address, on_bytes))
    else:
        link = _Reconnecting(address, lambda: _connect_serial(address, on_bytes))
    await link.open()
    keeper = asyncio.create_task(link.keep_open_loop(), name=f"keep open {address}")
    try:
        yield link
    finally:
        keeper.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await keeper
        link.close()


def _keep_short(transport: Any) -> Any:
    """Limits the send queue of a transport's socket to fresh packets; returns the socket."""
    own = transport.get_extra_info("socket")
    own.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
    return own


def _has_room(transport: Any) -> bool:
    """Returns True if bytes written now leave at once."""
    return (
        transport is not None
        and not transport.is_closing()
        and transport.get_write_buffer_size() == 0
    )


def _now_s() -> float:
    return asyncio.get_running_loop().time()


# Connections and reconnecting


class _Connection(Protocol):
    """One connection, used once."""

    lost: asyncio.Future[str]
    """Reason of its end, set when the connection ends."""

    def send(self, data: bytes, within_s: float, /) -> None: ...

    def close(self) -> None: ...


class _Reconnecting:
    """Keeps one connection open; packets sent in between are dropped."""

    def __init__(self, address: LinkAddress, connect: Callable[[], Any]) -> None:
        self._address = address
        self._connect = connect
        self._connection: _Connection | None = None
        self._failing = False

    async def open(self) -> None:
        """First attempt; raises LinkError if a retry would not help."""
        try:
            self._connection = await self._connect()
        except _FAILURES as error:
            if not self._may_pass(error):
                raise LinkError(f"{self._address}: {reason(error)}") from error
            self._complain(reason(error))

    def _may_pass(self, error: BaseException) -> bool:
        """Returns True for a failure that may end without a change of the configuration."""
        if isinstance(error, socket.gaierror):
            return error.errno == socket.EAI_AGAIN
        if self._address.kind is LinkKind.UDP_SEND:
            return isinstance(error, OSError) and error.errno in NO_NETWORK
        return self._address.kind is LinkKind.TCP

    async def keep_open_loop(self) -> None:
        """Reconnects after each end of the connection; never returns."""
        pause_s = _FIRST_PAUSE_S
        while True:
            if self._connection is not None:
                if await self._is_steady(self._connection):
                    pause_s = _FIRST_PAUSE_S
                why = await self._connection.lost
                self.close()
                self._complain(why)
            await asyncio.sleep(pause_s)
            pause_s = min(2.0 * pause_s, _LONGEST_PAUSE_S)
            try:
                self._connection = await self._connect()
            except _FAILURES as error:
                self._complain(reason(error))

    async def _is_steady(self, connection: _Connection) -> bool:
        """Waits for the end of a connection or for success, and logs success after a failure."""
        await asyncio.wait({connection.lost}, timeout=_STEADY_S)
        if connection.lost.done():
            return False
        if self._failing:
            self._failing = False
            _logger.info("%s: connected again", self._address)
        return True

    def send(
        self, data: bytes, within_s: float = math.inf, _peers: Sequence[Address] = (), /
    ) -> None:
        if self._connection is not None:
            self._connection.send(data, within_s)

    def close(self) -> None:
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def _complain(self, why: str) -> None:
        """Logs a failure: the first as a warning, repeats at debug level."""
        level = logging.DEBUG if self._failing else logging.WARNING
        self._failing = True
        _logger.log(level, "%s: %s", self._address, why)


class _TcpConnection(asyncio.Protocol):
    """A TCP client's connection."""

    def __init__(self, on_bytes: OnBytes) -> None:
        self.lost: asyncio.Future[str] = asyncio.get_running_loop().create_future()
        self._on_bytes = on_bytes
        self._transport: asyncio.Transport | None = None

    def connection_made(self, transport: Any) -> None:
        self._transport = transport
        own = _keep_short(transport)
        own.setsockopt(socket.IPPROTO_TCP, _TCP_NOTSENT_LOWAT, _UNSENT_BYTES)
        own.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _UNANSWERED_MS)

    def data_received(self, data: bytes) -> None:
        self._on_bytes(data, clock_s(), None)

    def connection_lost(self, exc: Exception | None) -> None:
        if not self.lost.done():
            self.lost.set_result("closed by the peer" if exc is None else reason(exc))

    def send(self, data: bytes, _within_s: float, /) -> None:
        # Bytes in a stream's buffer cannot be withdrawn, so a full buffer refuses the newest.
        transport: Any = self._transport
        if _has_room(transport):
            transport.write(data)

    def close(self) -> None:
        if self._transport is not None:
            self._transport.abort()


class _TcpConnector:
    """Makes the connections of one link, with one look-up of its name at a time.

    A look-up cannot be cancelled: its thread waits for the name server beyond the timeout here. A
    second look-up would take the thread of another link.
    """

    def __init__(self, address: LinkAddress, on_bytes: OnBytes) -> None:
        self._address = address
        self._on_bytes = on_bytes
        self._looking_up: asyncio.Task[list[Any]] | None = None

    async def connect(self) -> _TcpConnection:
        """Connects; raises OSError, or TimeoutError after 5 s."""
        return await asyncio.wait_for(self._connect(), timeout=_CONNECT_TIMEOUT_S)

    async def _connect(self) -> _TcpConnection:
        loop = asyncio.get_running_loop()
        failed: OSError | None = None
        for family, kind, protocol, _, place in await self._places():
            own = socket.socket(family, kind, protocol)
            try:
                own.setblocking(False)
                await loop.sock_connect(own, place)
                _, connection = await loop.create_connection(
                    lambda: _TcpConnection(self._on_bytes), sock=own
                )
            except OSError as error:
                own.close()
                failed = error
            except BaseException:
                own.close()
                raise
            else:
                return connection
        raise failed or socket.gaierror(socket.EAI_NODATA, "no address")

    async def _places(self) -> list[Any]:
        """Addresses of the link's name, from the look-up in progress if there is one."""
        if self._looking_up is None:
            address, loop = self._address, asyncio.get_running_loop()
            self._looking_up = asyncio.ensure_future(
                loop.getaddrinfo(address.host, address.port, type=socket.SOCK_STREAM)
            )
        looking_up = self._looking_up
        try:
            return await asyncio.shield(looking_up)
        finally:
            if looking_up.done():
                self._looking_up = None


class _SerialConnection:
    """Open serial port; a full buffer drops its oldest packets, those without a deadline first."""

    def __init__(self, port: Any, bytes_per_s: float, on_bytes: OnBytes) -> None:
        self._loop = asyncio.get_running_loop()
        self.lost: asyncio.Future[str] = self._loop.create_future()
        self._port = port
        self._descriptor = port.fileno()
        self._on_bytes = on_bytes
        self._limit_bytes = max(_MIN_SERIAL_BUFFER_BYTES, int(bytes_per_s * _SERIAL_BUFFER_S))
        self._begun = b""
        """Unwritten rest of the packet in transmission."""
        self._waiting: deque[tuple[float, bytes]] = deque()
        """Waiting packets, each with its deadline."""
        self._waiting_bytes = 0
        self._loop.add_reader(self._descriptor, self._readable)

    def send(self, data: bytes, within_s: float, /) -> None:
        if self.lost.done():
            return
        self._waiting.append((_now_s() + within_s, data))
        self._waiting_bytes += len(data)
        while self._waiting_bytes > self._limit_bytes and len(self._waiting) > 1:
            self._drop()
        self._writable()

    def _drop(self) -> None:
        """Drops the oldest packet without a deadline; the oldest of all where each has one.

        So texts and answers never displace setpoints.
        """
        late = (index for index, (last_s, _) in enumerate(self._waiting) if math.isinf(last_s))
        index = next(late, 0)
        self._waiting_bytes -= len(self._waiting[index][1])
        del self._waiting[index]

    def _next(self) -> bytes:
        """Removes and returns the oldest packet; empty if its deadline has passed."""
        last_s, data = self._waiting.popleft()
        self._waiting_bytes -= len(data)
        return data if _now_s() <= last_s else b""

    def close(self) -> None:
        if self.lost.done():
            # Closing would wait up to 30 s for a lost line to take its output buffer.
            with contextlib.suppress(OSError, termios.error):
                self._port.reset_output_buffer()
        self._end("closed")
        self._port.close()

    def _readable(self) -> None:
        try:
            data = os.read(self._descriptor, _READ_BYTES)
        except BlockingIOError:
            return
        except OSError as error:
            self._end(reason(error))
            return
        if data:
            self._on_bytes(data, clock_s(), None)
        else:
            self._end("the device is gone")

    def _writable(self) -> None:
        try:
            while self._begun or self._waiting:
                self._begun = self._begun or self._next()
                self._begun = self._begun[os.write(self._descriptor, self._begun) :]
        except BlockingIOError:
            self._loop.add_writer(self._descriptor, self._writable)
        except OSError as error:
            self._end(reason(error))
        else:
            self._loop.remove_writer(self._descriptor)

    def _end(self, why: str) -> None:
        self._loop.remove_reader(self._descriptor)
        self._loop.remove_writer(self._descriptor)
        if not self.lost.done():
            self.lost.set_result(why)


async def _connect_serial(address: LinkAddress, on_bytes: OnBytes) -> _SerialConnection:
    # Only a service with a serial port imports its library.
    import serial  # noqa: PLC0415

    # In a thread: some drivers (Bluetooth) wait for their peer when a port is opened.
    port = await asyncio.to_thread(
        serial.Serial,
        address.device,
        address.baud,
        timeout=0,
        write_timeout=0,
        exclusive=True,
    )
    os.set_blocking(port.fileno(), False)
    return _SerialConnection(port, address.bytes_per_s or 0.0, on_bytes)

"""UDP links: all waiting datagrams are read at once, each with the kernel's time of arrival."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import math
import socket
import struct
import sys
import time
from collections.abc import Callable, Sequence

from ..errors import LinkError
from .link_basics import SEND_BUFFER_BYTES, OnBytes, clock_s, reason
from .peers import Address
from .urls import LinkAddress

_DATAGRAM_BYTES = 65536
_MOST_DATAGRAMS = 512
"""Limit of datagrams read in one call, so that other tasks of the loop run in between."""
_REPORT_AGAIN_S = 10.0
_RECEIVE_BYTES = 4 * 2**20
_LEAST_RECEIVE_BYTES = 2**20
"""Receive buffer for datagrams that arrive while the process waits. The kernel counts 832 bytes for
a small message, of which PX4 sends 412 a second. So 1 MB is 3 s, the default 208 kB 0.6 s."""
_SO_RCVBUFFORCE, _SO_TIMESTAMPNS, _SO_RXQ_OVFL = 33, 35, 40
"""Linux constants (asm-generic/socket.h); the socket module lacks them."""
_TIMESPEC = struct.Struct("@ll")
_ANCILLARY_BYTES = 128
NO_NETWORK = frozenset({errno.ENETUNREACH, errno.EHOSTUNREACH, errno.ENETDOWN})
"""Failures while the network of a peer is absent: a modem that connects later, a lost Wi-Fi."""

_logger = logging.getLogger(__name__)


def _wall_offset_s() -> float:
    """Clock of arrivals minus the wall clock; the less interrupted of two readings."""
    return max(clock_s() - time.time(), clock_s() - time.time())


class _Udp:
    """UDP socket that reads all waiting datagrams at once, each with its time of arrival.

    Base of the listening and the sending link.
    """

    _listens: bool

    def __init__(self, address: LinkAddress, own: socket.socket, on_bytes: OnBytes) -> None:
        self._address = address
        self._socket = own
        self._on_bytes = on_bytes
        self._failing = False
        self._view = memoryview(bytearray(_DATAGRAM_BYTES))
        """Buffer for the greatest datagram, allocated once: memory may be short in flight."""
        self._read_s = clock_s()
        """Time up to which all arrived datagrams have been read."""
        self._dropped = 0
        self._report_again_s = -math.inf
        asyncio.get_running_loop().add_reader(own, self._readable)

    def close(self) -> None:
        asyncio.get_running_loop().remove_reader(self._socket)
        self._socket.close()

    def _readable(self) -> None:
        """Passes the waiting datagrams to the callback, the oldest first."""
        now_s = clock_s()
        # The kernel's stamps are in wall-clock time, which may be set. So each is limited to the
        # time between the last reading of all datagrams and now.
        offset_s = _wall_offset_s()
        for _ in range(_MOST_DATAGRAMS):
            try:
                count, extra, _, peer = self._socket.recvmsg_into([self._view], _ANCILLARY_BYTES)
            except BlockingIOError:
                self._read_s = max(self._read_s, now_s)
                return
            except OSError as error:
                self._fail(error)
                continue
            stamp_s = self._stamp_s(extra)
            if stamp_s is not None:
                self._read_s = min(max(self._read_s, stamp_s + offset_s), now_s)
            else:
                self._read_s = now_s
            self._failing = False
            data = bytes(self._view[:count])
            self._on_bytes(data, self._read_s, peer if self._listens else None)

    def _stamp_s(self, extra: list[tuple[int, int, bytes]]) -> float | None:
        """Time at which the kernel received a datagram, by the wall clock; None without a stamp."""
        stamp_s = None
        for level, kind, value in extra:
            if level != socket.SOL_SOCKET:
                continue
            if kind == _SO_TIMESTAMPNS and len(value) == _TIMESPEC.size:
                seconds, nanoseconds = _TIMESPEC.unpack(value)
                stamp_s = seconds + 1e-9 * nanoseconds
            elif kind == _SO_RXQ_OVFL:
                self._note_dropped(int.from_bytes(value, sys.byteorder))
        return stamp_s

    def _note_dropped(self, count: int) -> None:
        """Takes the kernel's count of dropped datagrams since the socket was opened."""
        now_s = clock_s()
        if count != self._dropped and now_s >= self._report_again_s:
            lost, self._dropped = (count - self._dropped) & 0xFFFFFFFF, count
            self._report_again_s = now_s + _REPORT_AGAIN_S
            _logger.warning("%s: %d datagrams lost, read too late", self._address, lost)

    def _fail(self, error: OSError) -> None:
        """Logs a failed datagram, for example because the peer is absent."""
        level = logging.DEBUG if self._failing else logging.WARNING
        self._failing = True
        _logger.log(level, "%s: %s", self._address, reason(error))

    def _write(self, data: bytes, peer: Address | None = None) -> None:
        try:
            if peer is None:
                self._socket.send(data)
            else:
                self._socket.sendto(data, peer)
        except BlockingIOError:
            pass  # The network stalls: older packets go first, and this one would be too old.
        except OSError as error:
            self._fail(error)


class _UdpListener(_Udp):
    """Listening link: receives from any address, and sends to the peers given by the caller."""

    _listens = True

    def send(
        self, data: bytes, _within_s: float = math.inf, peers: Sequence[Address] = (), /
    ) -> None:
        for peer in peers:
            self._write(data, peer)


class _UdpSender(_Udp):
    """Sending link: sends to one peer, and receives only from it. Used once.

    Its source address is that of the network at its opening. So it ends when that has gone: EINVAL
    is for an address that this computer has no longer.
    """

    _listens = False

    def __init__(self, address: LinkAddress, own: socket.socket, on_bytes: OnBytes) -> None:
        super().__init__(address, own, on_bytes)
        self.lost: asyncio.Future[str] = asyncio.get_running_loop().create_future()

    def send(self, data: bytes, _within_s: float, /) -> None:
        if not self.lost.done():
            self._write(data)

    def _fail(self, error: OSError) -> None:
        if error.errno not in NO_NETWORK | {errno.EINVAL}:
            super()._fail(error)
        elif not self.lost.done():
            self.lost.set_result(reason(error))


async def listen_udp(address: LinkAddress, on_bytes: OnBytes) -> _UdpListener:
    """Opens a listening link; raises LinkError if the address is not available."""
    try:
        return _UdpListener(address, await _socket(address, socket.socket.bind), on_bytes)
    except OSError as error:
        raise LinkError(f"{address}: {reason(error)}") from error


async def connect_udp(address: LinkAddress, on_bytes: OnBytes) -> _UdpSender:
    """Opens a sending link; raises OSError if its peer's address or network is not known."""
    return _UdpSender(address, await _socket(address, socket.socket.connect), on_bytes)


async def _socket(
    address: LinkAddress, attach: Callable[[socket.socket, Address], None]
) -> socket.socket:
    """Socket bound or connected to an address."""
    found = await asyncio.get_running_loop().getaddrinfo(
        address.host, address.port, type=socket.SOCK_DGRAM
    )
    family, kind, protocol, _, place = found[0]
    own = socket.socket(family, kind, protocol)
    try:
        own.setblocking(False)
        attach(own, place)
    except OSError:
        own.close()
        raise
    own.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
    own.setsockopt(socket.SOL_SOCKET, _SO_TIMESTAMPNS, 1)
    own.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
    granted_bytes = _enlarge(own)
    if granted_bytes < _LEAST_RECEIVE_BYTES:
        _logger.warning(
            "%s: room for %d kB of what has not been read yet, less than %d kB; see"
            " net.core.rmem_max",
            address,
            granted_bytes // 1024,
            _LEAST_RECEIVE_BYTES // 1024,
        )
    return own


def _enlarge(own: socket.socket) -> int:
    """Enlarges a socket's receive buffer; returns the granted bytes."""
    for option in (_SO_RCVBUFFORCE, socket.SO_RCVBUF):
        # The first option exceeds the system's limit and needs root.
        with contextlib.suppress(OSError):
            own.setsockopt(socket.SOL_SOCKET, option, _RECEIVE_BYTES)
            break
    return own.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2

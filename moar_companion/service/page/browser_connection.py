"""Limits of one connection of a browser: number of them, silence, and bytes that wait."""

from __future__ import annotations

import asyncio
import socket
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

_MOST_CONNECTIONS = 128
"""More are closed at once: each holds a file descriptor."""
_REQUEST_S = 10.0
"""Longest time for the head of a request, and between two requests."""
_UNSENT_BYTES = 4096
"""Of a frame that a slow viewer has not got, in the kernel; in the process there is one frame."""
_GONE_MS = 20_000
"""A viewer that acknowledges nothing for this time is gone."""


class BrowserConnection(H11Protocol):
    """A connection that is closed without a request, and whose sender waits for the receiver."""

    _cycle_before: Any = None
    """Request at the last check."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Takes a new connection, or closes it at once."""
        super().connection_made(transport)
        if len(self.connections) > _MOST_CONNECTIONS:
            transport.abort()
            return
        transport.set_write_buffer_limits(high=0)
        own: socket.socket = transport.get_extra_info("socket")
        # A response is two writes: the second one does not wait for the browser's acknowledgement.
        own.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        own.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, _UNSENT_BYTES)
        own.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _GONE_MS)
        self._check_later()

    def _check_later(self) -> None:
        self.loop.call_later(_REQUEST_S, self._check)

    def _check(self) -> None:
        """Closes the connection if it has had no request since the last check."""
        transport = self.transport
        if transport.is_closing() or transport.get_protocol() is not self:
            return  # or a viewer's, which is pinged
        waits = self.cycle is None or self.cycle.response_complete
        if waits and self.cycle is self._cycle_before:
            transport.abort()
            return
        self._cycle_before = self.cycle
        self._check_later()

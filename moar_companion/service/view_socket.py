"""The view socket: the status as JSON lines to whoever connects to a Unix socket.

Read-only: nothing is ever read from a client. A client that does not keep up misses lines, whole
ones, so that neither the thinking waits for it nor memory grows; whatever goes wrong here ends the
view and not the flight.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import socket
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

PERIOD_S = 0.25
_MOST_READERS = 32
"""Each holds a file descriptor, of which links have need, too."""
_MODE = 0o660

_logger = logging.getLogger(__name__)

StatusNow = Callable[[], dict[str, Any]]


@contextlib.asynccontextmanager
async def open_view_socket(path: Path, status_now: StatusNow) -> AsyncIterator[None]:
    """Serve the status on a socket; it is made only while somebody reads.

    The socket file that a dead service left is replaced. One on which somebody listens is left to
    him: a warning, and there is no view. Raises OSError for a path that cannot be had.
    """
    listener = _listen(path)
    if listener is None:
        _logger.warning("no view: another program serves %s", path)
        yield
        return
    readers: set[asyncio.Transport] = set()
    loop = asyncio.get_running_loop()
    server = await loop.create_unix_server(lambda: _Reader(readers), sock=listener)
    publishing = asyncio.create_task(_publish_loop(readers, status_now), name="view")
    _logger.info("view on %s", path)
    try:
        yield
    finally:
        publishing.cancel()
        server.close()
        for reader in tuple(readers):
            reader.abort()
        with contextlib.suppress(OSError):
            os.unlink(path)  # noqa: PTH108 - pathlib's is refused in a loop; this one ends


async def _publish_loop(readers: set[asyncio.Transport], status_now: StatusNow) -> None:
    try:
        while True:
            await asyncio.sleep(PERIOD_S)
            if not readers:
                continue
            line = json.dumps(status_now(), allow_nan=False).encode() + b"\n"
            for reader in tuple(readers):
                if reader.get_write_buffer_size() == 0:
                    reader.write(line)
    except Exception as error:  # noqa: BLE001 - a fault of the view must not end a flight
        _logger.error("the view ended: %s: %s", type(error).__name__, error)  # noqa: TRY400
        for reader in tuple(readers):
            reader.abort()


class _Reader(asyncio.Protocol):
    """A client, to which only is written; that it has gone shows when it is written to."""

    def __init__(self, readers: set[asyncio.Transport]) -> None:
        self._readers = readers
        self._transport: Any = None

    def connection_made(self, transport: Any) -> None:
        self._transport = transport
        if len(self._readers) >= _MOST_READERS:
            transport.abort()
            return
        # Not before reading has begun: Python 3.10 forgets that.
        asyncio.get_running_loop().call_soon(transport.pause_reading)
        self._readers.add(transport)

    def connection_lost(self, exc: Exception | None) -> None:  # noqa: ARG002 - asyncio's name
        self._readers.discard(self._transport)


def _listen(path: Path) -> socket.socket | None:
    """A socket bound to a path, not listening yet; None where another program listens."""
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK)
    try:
        if path.is_socket():
            if _is_served(path):
                listener.close()
                return None
            path.unlink(missing_ok=True)
        listener.bind(str(path))
        path.chmod(_MODE)
    except BaseException:
        listener.close()
        raise
    return listener


def _is_served(path: Path) -> bool:
    """Whether somebody listens on a socket file."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK) as caller:
        try:
            caller.connect(str(path))
        except ConnectionRefusedError:
            return False
        except BlockingIOError:  # its queue is full
            return True
    return True

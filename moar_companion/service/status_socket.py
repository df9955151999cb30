"""The view socket: the status as JSON lines to clients of a Unix socket.

Read-only: no data are read from a client. A slow client misses whole lines, so that the control
loop never waits and memory does not grow. Clients beyond the limit are refused. A fault here ends
the view and not the flight.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import resource
import socket
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

PERIOD_S = 0.25
_MOST_READERS = 32
"""Each holds a file descriptor."""
_RESERVED_DESCRIPTORS = 14
"""Not for readers: links, files that are opened for a moment, the compilers' pipes."""
_RETRY_S = 1.0
"""Pause before the next client is accepted, after the system had no descriptor or memory."""
_MODE = 0o660

_logger = logging.getLogger(__name__)

StatusNow = Callable[[], dict[str, Any]]


@contextlib.asynccontextmanager
async def open_view_socket(path: Path, status_now: StatusNow) -> AsyncIterator[None]:
    """Serves the status on a socket; the status is made only while a client reads.

    The socket file of a failed service is replaced. A socket that another program serves is left
    alone: a warning, and there is no view. Raises OSError for an unusable path.
    """
    listener = _listen(path)
    if listener is None:
        _logger.warning("no view: another program serves %s", path)
        yield
        return
    readers = _Readers(listener, path)
    publishing = asyncio.create_task(_publish_loop(readers, status_now), name="view")
    _logger.info("view on %s", path)
    try:
        yield
    finally:
        publishing.cancel()
        readers.close()
        with contextlib.suppress(OSError):
            os.unlink(path)  # noqa: PTH108 - pathlib's is refused in a loop; this one ends


async def _publish_loop(readers: _Readers, status_now: StatusNow) -> None:
    try:
        while True:
            await asyncio.sleep(PERIOD_S)
            if readers:
                readers.write(json.dumps(status_now(), allow_nan=False).encode() + b"\n")
    except Exception as error:  # noqa: BLE001 - a fault of the view must not end a flight
        _logger.error("the view ended: %s: %s", type(error).__name__, error)  # noqa: TRY400
        readers.close()


class _Readers:
    """Clients of a listening socket, each with the unsent rest of its last line.

    Each turn of the loop accepts one client, and closes it at once beyond the limit: links and
    files find a descriptor however many clients connect.
    """

    def __init__(self, listener: socket.socket, path: Path) -> None:
        self._listener = listener
        self._path = path
        self._unsent: dict[socket.socket, bytes] = {}
        self._most = _most_readers()
        self._warned = False
        self._loop = asyncio.get_running_loop()
        self._accept_later: asyncio.TimerHandle | None = None
        listener.listen()
        self._listen()

    def __len__(self) -> int:
        return len(self._unsent)

    def write(self, line: bytes) -> None:
        """Sends a line to all clients that have taken the one before."""
        for reader, unsent in tuple(self._unsent.items()):
            data = unsent or line
            try:
                self._unsent[reader] = data[reader.send(data) :]
            except BlockingIOError:
                self._unsent[reader] = unsent
            except OSError:
                self._drop(reader)

    def close(self) -> None:
        """Closes all clients and the listener."""
        if self._listener.fileno() < 0:
            return
        if self._accept_later is not None:
            self._accept_later.cancel()
        self._loop.remove_reader(self._listener)
        self._listener.close()
        for reader in tuple(self._unsent):
            self._drop(reader)

    def _drop(self, reader: socket.socket) -> None:
        del self._unsent[reader]
        reader.close()

    def _listen(self) -> None:
        self._loop.add_reader(self._listener, self._accept)

    def _accept(self) -> None:
        try:
            reader, _ = self._listener.accept()
        except BlockingIOError:
            return
        except OSError as error:
            # The client keeps waiting, and its request would start the loop again at once.
            self._warn(f"no reader accepted: {error.strerror}")
            self._loop.remove_reader(self._listener)
            self._accept_later = self._loop.call_later(_RETRY_S, self._listen)
            return
        if len(self) >= self._most:
            reader.close()
            self._warn(f"more than {self._most} readers are refused")
            return
        reader.setblocking(False)
        self._unsent[reader] = b""

    def _warn(self, words: str) -> None:
        """Logs one warning; repeats only at debug level."""
        level = logging.DEBUG if self._warned else logging.WARNING
        self._warned = True
        _logger.log(level, "view on %s: %s", self._path, words)


def _most_readers() -> int:
    """Number of readers that leaves enough file descriptors to the rest of the process."""
    limit, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    with contextlib.suppress(OSError):
        opened = len(os.listdir("/proc/self/fd"))  # noqa: PTH208 - in a loop that has not begun
        return max(0, min(_MOST_READERS, limit - opened - _RESERVED_DESCRIPTORS))
    return _MOST_READERS


def _listen(path: Path) -> socket.socket | None:
    """Returns a socket bound to a path, not listening yet; None if another program listens."""
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
    """True if a program listens on a socket file."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK) as caller:
        try:
            caller.connect(str(path))
        except ConnectionRefusedError:
            return False
        except BlockingIOError:  # its queue is full
            return True
    return True

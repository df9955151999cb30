"""Shared parts of the links: the clock of arrivals, and the texts of failures."""

from __future__ import annotations

import asyncio
import errno
import os
import socket
import termios
import time
from collections.abc import Callable

from .peers import Address

SEND_BUFFER_BYTES = 16384
"""Size of the kernel's send queue, which counts twice that and some 800 bytes for a setpoint. After
a network stall the queue holds half a second of packets, not a minute."""

OnBytes = Callable[[bytes, float, Address | None], None]
"""Callback with received bytes, their time of arrival (`clock_s`) and, on a listening link, the
sender's address."""


def clock_s() -> float:
    """Clock of arrivals: unaffected by changes of the host's clock, and runs during suspend."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def reason(error: BaseException) -> str:
    """Reason of a link's failure, as text."""
    if isinstance(error, socket.gaierror):
        absent = error.errno == socket.EAI_AGAIN
        return "no name server answers" if absent else "the name is not found"
    if isinstance(error, TimeoutError | asyncio.TimeoutError):
        return "no answer"
    if isinstance(error.__context__, termios.error) and error.__context__.args[0] == errno.ENOTTY:
        return "is no serial port"
    if isinstance(error, termios.error):
        return os.strerror(error.args[0]).lower()
    if isinstance(error, OSError):
        if error.errno == errno.EADDRNOTAVAIL:
            return "is no address of this computer"
        if error.errno in {errno.EADDRINUSE, errno.EAGAIN, errno.EBUSY}:
            return "in use by another program"
        if error.errno is not None:
            return os.strerror(error.errno).lower()
    return str(error).replace("\n", " ")

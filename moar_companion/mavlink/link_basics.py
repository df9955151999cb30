"""What the links share: the clock of arrivals, and the words for what fails."""

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
"""Of the kernel's queue, which counts twice that and some 800 for a setpoint: a network that stands
still finds what was said within half a second, not within a minute."""

OnBytes = Callable[[bytes, float, Address | None], None]
"""Called with what has arrived, when it did (`clock_s`), and on a listening link from where."""


def clock_s() -> float:
    """The clock of arrivals: goes on evenly whatever is done to the host's, and in its sleep."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def reason(error: BaseException) -> str:
    """Why a link failed, in words."""
    if isinstance(error, socket.gaierror):
        return "the name is not found"
    if isinstance(error, TimeoutError | asyncio.TimeoutError):
        return "no answer"
    if isinstance(error.__context__, termios.error) and error.__context__.args[0] == errno.ENOTTY:
        return "is no serial port"
    if isinstance(error, OSError):
        if error.errno == errno.EADDRNOTAVAIL:
            return "is no address of this computer"
        if error.errno in {errno.EADDRINUSE, errno.EAGAIN, errno.EBUSY}:
            return "in use by another program"
        if error.errno is not None:
            return os.strerror(error.errno).lower()
    return str(error).replace("\n", " ")

"""The service manager's notification socket (systemd, sd_notify(3)); no action without one."""

from __future__ import annotations

import contextlib
import math
import os
import socket

_FED_PER_TIMEOUT = 2.0
"""Watchdog messages per time-out (sd_watchdog_enabled(3))."""


def notify(state: str) -> None:
    """Sends a state to the service manager, e.g. `READY=1`; no action without one."""
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address:
        return
    if address.startswith("@"):
        address = "\0" + address[1:]
    with contextlib.suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.setblocking(False)
        sender.sendto(state.encode(), address)


class Watchdog:
    """The service manager's watchdog; inactive unless systemd requests it of this process."""

    def __init__(self) -> None:
        timeout_us = os.environ.get("WATCHDOG_USEC", "")
        watched = os.environ.get("WATCHDOG_PID", "") in {"", str(os.getpid())}
        asked = watched and timeout_us.isdecimal()
        self._period_s = int(timeout_us) * 1e-6 / _FED_PER_TIMEOUT if asked else math.inf
        self._fed_s = -math.inf

    def feed(self, now_s: float) -> None:
        """Marks a completed cycle; sends `WATCHDOG=1` when that is due."""
        if now_s - self._fed_s >= self._period_s and self._period_s < math.inf:
            self._fed_s = now_s
            notify("WATCHDOG=1")

"""Replacement of systemd with the functions that the unit uses: readiness, watchdog, restart.

Source: systemd.service(5), sd_notify(3), systemd.kill(5).
"""

from __future__ import annotations

import configparser
import contextlib
import signal
import socket
import threading
import time
from pathlib import Path

UNIT = Path(__file__).parents[2] / "systemd" / "moar-companion.service"
LOOK_S = 0.1


class Manager:
    """Starts a service and keeps it running, in a thread of its own.

    starts: process ids, in order. statuses: exit statuses.
    """

    def __init__(self, service, folder):
        parser = configparser.ConfigParser(strict=False, interpolation=None)
        parser.optionxform = str
        parser.read_string(UNIT.read_text())
        unit = parser["Service"]
        assert (unit["Type"], unit["Restart"]) == ("notify", "on-failure")
        self._watchdog_s, self._restart_s = float(unit["WatchdogSec"]), float(unit["RestartSec"])
        self._service = service
        self._address = str(folder / "notify")
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run)
        self.starts, self.statuses = [], []

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._ending.set()
        self._thread.join()

    def _run(self):
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
            receiver.bind(self._address)
            receiver.settimeout(LOOK_S)
            while not self._ending.is_set():
                self._service.start(
                    NOTIFY_SOCKET=self._address,
                    WATCHDOG_USEC=f"{self._watchdog_s * 1e6:.0f}",
                    PYTHONFAULTHANDLER="1",
                )
                self.starts.append(self._service.process.pid)
                self._watch(receiver)
                status = self._service.process.wait()
                self.statuses.append(status)
                if status == 0:
                    return
                self._ending.wait(self._restart_s)

    def _watch(self, receiver):
        """Waits for the end of the service; kills it after a watchdog time-out."""
        process, ready = self._service.process, False
        fed_s = time.monotonic()
        while process.poll() is None and not self._ending.is_set():
            with contextlib.suppress(TimeoutError):
                ready = receiver.recv(64) == b"READY=1" or ready
                fed_s = time.monotonic()
            if ready and time.monotonic() - fed_s > self._watchdog_s:
                process.send_signal(signal.SIGABRT)
                process.send_signal(signal.SIGCONT)
                return
        if self._ending.is_set():
            process.kill()

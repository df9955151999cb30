"""The two processes of a flight, which communicate by MAVLink alone."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

_STOP_TIMEOUT_S = 10.0


class Process:
    """A program as a process of its own, with its output in a file.

    folder: its working directory; the checkout unless given. environment: additional variables.
    """

    def __init__(
        self,
        name: str,
        log: Path,
        *command: str,
        folder: Path = Path(__file__).parents[2],
        environment: Mapping[str, str] | None = None,
    ) -> None:
        self._name = name
        self._log = log
        with log.open("ab") as output:
            self._process = subprocess.Popen(
                command,
                stdout=output,
                stderr=subprocess.STDOUT,
                stdin=subprocess.DEVNULL,
                cwd=folder,
                env={**os.environ, "PYTHONUNBUFFERED": "1", **(environment or {})},
                start_new_session=True,
            )

    @property
    def id(self) -> int:
        """Process id."""
        return self._process.pid

    def ended(self) -> str | None:
        """One line that it has ended, with its last output; None while it runs."""
        if self._process.poll() is None:
            return None
        lines = self._log.read_text(encoding="utf-8", errors="replace").splitlines()
        return f"the {self._name} ended: {lines[-1] if lines else f'{self._log.name} is empty'}"

    def stop(self) -> None:
        """End it by SIGTERM, if necessary by SIGKILL."""
        self._process.send_signal(signal.SIGTERM)
        try:
            self._process.wait(_STOP_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


@contextlib.contextmanager
def running(name: str, log: Path, module: str, *arguments: str) -> Iterator[Process]:
    """A Python module as a process within the context."""
    process = Process(name, log, sys.executable, "-m", module, *arguments)
    try:
        yield process
    finally:
        process.stop()


def free_ports(count: int) -> list[int]:
    """UDP ports on this machine that are not in use."""
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(count)]
    try:
        for item in sockets:
            item.bind(("127.0.0.1", 0))
        return [int(item.getsockname()[1]) for item in sockets]
    finally:
        for item in sockets:
            item.close()

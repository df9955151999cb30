"""A process of this program beside the service, which a thread starts again after each end."""

from __future__ import annotations

import logging
import socket
import subprocess
import sys
import threading
from collections.abc import Sequence

from .priority import put_behind

_AGAIN_S = 1.0
_END_S = 2.0
"""Longest wait for the process to end by itself."""

_logger = logging.getLogger(__name__)


class ChildProcess:
    """`python -m MODULE DESCRIPTOR…` with a setup on standard input.

    name: in the log. descriptors: stay open in the process; each restart has the same ones.
    """

    def __init__(self, name: str, module: str, descriptors: Sequence[int], setup: bytes) -> None:
        self._name = name
        self._descriptors = tuple(descriptors)
        isolated = ["-I"] if sys.flags.isolated else []
        numbers = map(str, self._descriptors)
        self._command = [sys.executable, *isolated, "-m", module, *numbers]
        self._setup = setup
        self._closing = threading.Event()
        self._process: subprocess.Popen[bytes] | None = None
        self._thread = threading.Thread(target=self._keep_running, name=name, daemon=True)
        self._thread.start()

    @property
    def process_id(self) -> int | None:
        """Process id; None while no process runs."""
        process = self._process
        return None if process is None or process.poll() is not None else process.pid

    def close(self, *channel: socket.socket) -> None:
        """Ends the process, and its restarts. channel: sockets whose end tells it to end."""
        self._closing.set()
        for item in channel:
            item.close()
        self._thread.join(_END_S)
        process = self._process
        if process is not None and process.poll() is None:
            process.kill()
            process.wait()

    def _keep_running(self) -> None:
        """Runs in the thread: restarts the process after each end."""
        while not self._closing.is_set():
            try:
                process = subprocess.Popen(  # noqa: S603 - ourselves
                    self._command,
                    stdin=subprocess.PIPE,
                    pass_fds=self._descriptors,
                    start_new_session=True,
                )
            except (OSError, MemoryError, ValueError) as error:
                _logger.warning("no process for the %s: %s", self._name, error)
            else:
                self._process = process
                put_behind(process.pid)
                try:
                    process.communicate(self._setup)
                except OSError as error:
                    _logger.warning("%s: %s", self._name, error)
                status = process.wait()
                if not self._closing.is_set():
                    text = "the %s has ended (status %d), restarting"
                    _logger.warning(text, self._name, status)
            self._closing.wait(_AGAIN_S)

"""The service's end of the perception: it starts the process, feeds it, and takes its reports.

The loop never waits for the process: notes that it does not take in time are dropped, and a process
that has ended is started again by a thread. Without reports the supervisor holds the flight.
"""

from __future__ import annotations

import json
import logging
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator

from ..errors import InputError
from ..perception.perception_report import PerceptionReport
from ..perception.pose_notes import PoseNote
from ..perception_config import Perception
from ..recording.value_codec import encoded
from ..site import Site
from . import perception_worker
from .perception_worker import MESSAGE_BYTES, Setup, notes_encoded, reports_decoded
from .priority import put_behind

_AGAIN_S = 1.0
_END_S = 2.0
"""Longest wait for the process to end by itself."""

_logger = logging.getLogger(__name__)


class PerceptionProcess:
    """The process. Raises InputError for a description of the sensor that cannot be read."""

    def __init__(self, settings: Perception, site: Site, *, speed: float = 1.0) -> None:
        setup = Setup(
            settings=settings, site=site, description=description_of(settings), speed=speed
        )
        self._setup = json.dumps(encoded(setup)).encode()
        # The process's end stays open here, too: one that ends loses neither notes nor reports.
        self._channel, self._other_end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._channel.setblocking(False)
        self._closing = threading.Event()
        self._process: subprocess.Popen[bytes] | None = None
        self._thread = threading.Thread(target=self._keep_running, name="perception", daemon=True)
        self._thread.start()

    @property
    def process_id(self) -> int | None:
        """The process; None while none runs."""
        process = self._process
        return None if process is None or process.poll() is not None else process.pid

    def send(self, notes: list[PoseNote]) -> None:
        """Hands notes over; drops them when the process is behind."""
        if not notes:
            return
        try:
            self._channel.send(notes_encoded(notes))
        except OSError as error:
            _logger.debug("notes dropped: %s", error)

    def reports(self) -> Iterator[PerceptionReport]:
        """Yields the reports since the last call."""
        while True:
            try:
                message = self._channel.recv(MESSAGE_BYTES)
            except BlockingIOError:
                return
            yield reports_decoded(message)

    def close(self) -> None:
        """Ends the process."""
        self._closing.set()
        self._other_end.close()
        self._channel.close()
        self._thread.join(_END_S)
        process = self._process
        if process is not None and process.poll() is None:
            process.kill()
            process.wait()

    def _keep_running(self) -> None:
        """Runs in the thread: one process after the other."""
        isolated = ["-I"] if sys.flags.isolated else []
        end = self._other_end.fileno()
        command = [sys.executable, *isolated, "-m", perception_worker.__name__, str(end)]
        while not self._closing.is_set():
            try:
                process = subprocess.Popen(  # noqa: S603 - ourselves
                    command, stdin=subprocess.PIPE, pass_fds=(end,), start_new_session=True
                )
            except (OSError, MemoryError, ValueError) as error:
                _logger.warning("no process for the perception: %s", error)
            else:
                self._process = process
                put_behind(process.pid)
                try:
                    process.communicate(self._setup)
                except OSError as error:
                    _logger.warning("perception: %s", error)
                status = process.wait()
                if not self._closing.is_set():
                    _logger.warning("the perception has ended (status %d), restarting", status)
            self._closing.wait(_AGAIN_S)


def description_of(settings: Perception) -> str:
    """Content of the sensor's metadata file; empty without one."""
    if settings.metadata is None:
        return ""
    try:
        return settings.metadata.read_text()
    except (OSError, UnicodeDecodeError) as error:
        problem = error.strerror if isinstance(error, OSError) else "is no text"
        raise InputError(str(settings.metadata), "", f"cannot be read: {problem}") from error

"""Stalled pipes and disks: a writer waits until the test resumes them."""

from __future__ import annotations

import contextlib
import os
import threading
from pathlib import Path

PATIENCE_S = 20.0


class Stopped:
    """A full pipe that is not read before the test resumes it."""

    def __init__(self, reading, writing):
        self.writing = writing
        self.data = bytearray()
        """Bytes that were written after it was full, as far as they have been read."""
        self._reading = reading
        os.set_blocking(writing, False)
        self._filled = 0
        with contextlib.suppress(BlockingIOError):
            while True:
                self._filled += os.write(writing, b"\n" * 512)
        os.set_blocking(writing, True)
        os.set_blocking(reading, True)
        self._thread = threading.Thread(target=self._read_loop, daemon=True)
        self._timer = threading.Timer(PATIENCE_S, self._lose_patience)
        self._timer.start()
        self._patient = True

    def go_on(self):
        """Read from now on."""
        self._timer.cancel()
        if self._thread.ident is None:
            self._thread.start()

    def rest(self):
        """Bytes that were written, once the pipe is resumed and all its writers have closed it.

        Fails if the pipe had to be resumed by the timeout.
        """
        self.go_on()
        os.close(self.writing)
        self._thread.join(PATIENCE_S)
        assert not self._thread.is_alive()
        assert self._patient
        return bytes(self.data)

    def _lose_patience(self):
        self._patient = False
        self._thread.start()

    def _read_loop(self):
        left = self._filled
        while left:
            left -= len(os.read(self._reading, left))
        while chunk := os.read(self._reading, 65536):
            self.data += chunk
        os.close(self._reading)


def stopped_pipe():
    """A stalled pipe."""
    return Stopped(*os.pipe())


def make_recordings(monkeypatch, make):
    """Have `make` put something into each folder of a flight before it is recorded there."""
    mkdir = Path.mkdir

    def made(path, *arguments, **options):
        mkdir(path, *arguments, **options)
        if path.name.startswith("flight_"):
            make(path)

    monkeypatch.setattr(Path, "mkdir", made)


def stop_recordings(monkeypatch):
    """Record the packets of flights to stalled disks. Return their list, which grows."""
    disks = []

    def make(folder):
        path = folder / "flight.tlog"
        os.mkfifo(path)
        reading = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        disks.append(Stopped(reading, os.open(path, os.O_WRONLY)))

    make_recordings(monkeypatch, make)
    return disks

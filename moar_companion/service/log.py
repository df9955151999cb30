"""The log: one line a record on stderr, or an entry with fields in systemd's journal (`journal`).

Nothing here delays the control loop.

A pipe that is not read, or a terminal that is stopped, loses the newest lines; a line reports how
many. The oldest lines are kept: they show the cause.
"""

from __future__ import annotations

import contextlib
import logging
import math
import os
import socket
import sys
from collections.abc import Iterator, Sequence
from functools import partial

from ..mavlink.telemetry import AutopilotStatus
from ..settings.link_config import LinkConfig, LinkRole
from ..texts.text_format import printable
from .background_writer import BackgroundWriter, Batches
from .journal import JournalFormatter, open_journal, write_entries

_MOST_BYTES = 256 * 1024
"""Limit of waiting text: some three thousand lines."""
_SILENCE_S = 5.0
"""An autopilot's heartbeat comes each second: after this time without one a warning is logged."""

_logger = logging.getLogger(__name__)


@contextlib.contextmanager
def log_to_stderr() -> Iterator[None]:
    """Writes records logged inside; the rest is written at the end, if stderr accepts it."""
    lines = _Lines()
    handler = logging.StreamHandler(lines)
    handler.setFormatter(lines.formatter)
    root = logging.getLogger()
    level = root.level
    root.addHandler(handler)
    root.setLevel(logging.INFO)
    try:
        yield
    finally:
        lines.close()
        root.removeHandler(handler)
        root.setLevel(level)


class AutopilotLog:
    """Lines about the autopilot: its absence at the start, and each change of mode or arming."""

    def __init__(self, links: Sequence[LinkConfig]) -> None:
        self._urls = [link.url for link in links if link.role is LinkRole.AUTOPILOT]
        self._before: AutopilotStatus | None = None
        self._warning_due_s: float | None = None
        """Time at which its absence is logged; None: not set yet; infinity: never again."""

    def update(self, autopilot: AutopilotStatus | None, now_s: float) -> None:
        """Logs what is new; to be called about each second. now_s: real seconds."""
        if self._warning_due_s is None:
            self._warning_due_s = now_s + _SILENCE_S
        before, self._before = self._before, autopilot
        if autopilot is None:
            if now_s >= self._warning_due_s:
                self._warning_due_s = math.inf
                _logger.warning(
                    "no autopilot received on %s for %g s; is it on, and does it send there?",
                    ", ".join(self._urls),
                    _SILENCE_S,
                )
            return
        self._warning_due_s = math.inf
        if before is None or (autopilot.mode, autopilot.armed) != (before.mode, before.armed):
            _logger.info(
                "autopilot %s, system %d: %s, %s",
                autopilot.kind,
                autopilot.system_id,
                autopilot.mode,
                "armed" if autopilot.armed else "disarmed",
            )


class _Lines:
    """The stream of a handler, whose lock lets one thread at a time write.

    formatter: of the handler. Each text that is written is one record.
    """

    def __init__(self) -> None:
        # Writing by its buffer is not possible: a thread blocked in it makes the interpreter abort
        # at exit. Writing by its number alone is not possible: without a stderr, a link or a file
        # may have that number.
        stderr = sys.__stderr__
        descriptor = os.open(os.devnull, os.O_WRONLY) if stderr is None else stderr.fileno()
        journal = open_journal(descriptor)
        if journal is None:
            self.formatter = logging.Formatter("%(levelname)s %(message)s")
            write_loop = partial(_write_lines, descriptor)
        else:
            self.formatter = JournalFormatter()
            write_loop = partial(_write_journal, journal)
        self._writer = BackgroundWriter("log", write_loop, most_bytes=_MOST_BYTES)
        self._lost = 0

    def write(self, text: str) -> None:
        if self._lost and self._put(self._loss()):
            self._lost = 0
        if not self._put(text):
            self._lost += 1

    def close(self) -> None:
        if self._lost:
            self._put(self._loss())
        self._writer.close()

    def _loss(self) -> str:
        words = f"{self._lost} lines are lost here: stderr did not take them"
        record = logging.LogRecord(__name__, logging.WARNING, "", 0, words, None, None)
        return f"{self.formatter.format(record)}\n"

    def _put(self, text: str) -> bool:
        shown = "\n".join(map(printable, text.split("\n")))
        return self._writer.put(shown.encode(errors="backslashreplace"))


def _write_lines(descriptor: int, batches: Batches) -> None:
    with contextlib.suppress(OSError), open(descriptor, "wb", closefd=False) as stderr:
        for batch in batches:
            with contextlib.suppress(OSError):
                stderr.writelines(line for (line,) in batch)
                stderr.flush()


def _write_journal(journal: socket.socket, batches: Batches) -> None:
    with journal:
        for batch in batches:
            write_entries(journal, [entry for (entry,) in batch])

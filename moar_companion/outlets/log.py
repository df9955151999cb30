"""The log: one line a record on stderr, written without delaying the control loop.

A pipe that is not read, or a terminal that is stopped, loses the newest lines; a line reports how
many. The oldest lines are kept: they show the cause.
"""

from __future__ import annotations

import contextlib
import logging
import os
import sys
from collections.abc import Iterator
from functools import partial

from .background_writer import BackgroundWriter, Batches

_MOST_BYTES = 256 * 1024
"""Limit of waiting text: some three thousand lines."""


@contextlib.contextmanager
def log_to_stderr() -> Iterator[None]:
    """Writes records logged inside; the rest is written at the end, if stderr accepts it."""
    lines = _Lines()
    handler = logging.StreamHandler(lines)
    handler.setFormatter(logging.Formatter("%(levelname)s %(message)s"))
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


class _Lines:
    """The stream of a handler, whose lock lets one thread at a time write."""

    def __init__(self) -> None:
        # Not by its buffer: a thread blocked in it makes the interpreter abort at exit. Nor by its
        # number alone: without a stderr, a link or a file may have that number.
        stderr = sys.__stderr__
        descriptor = os.open(os.devnull, os.O_WRONLY) if stderr is None else stderr.fileno()
        self._writer = BackgroundWriter(
            "log", partial(_write_loop, descriptor), most_bytes=_MOST_BYTES
        )
        self._lost = 0

    def write(self, text: str) -> None:
        if self._lost:
            text = f"WARNING {self._lost} lines are lost here: stderr did not take them\n{text}"
        if self._writer.put(text.encode(errors="backslashreplace")):
            self._lost = 0
        else:
            self._lost += 1

    def close(self) -> None:
        if self._lost:
            self.write("")
        self._writer.close()


def _write_loop(descriptor: int, batches: Batches) -> None:
    with contextlib.suppress(OSError), open(descriptor, "wb", closefd=False) as stderr:
        for batch in batches:
            with contextlib.suppress(OSError):
                stderr.writelines(line for (line,) in batch)
                stderr.flush()

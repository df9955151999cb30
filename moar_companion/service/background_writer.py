"""A thread that writes, so that a stalled disk or pipe delays nothing else."""

from __future__ import annotations

import contextlib
import math
import threading
from collections.abc import Callable, Iterator
from queue import Empty, SimpleQueue
from typing import Any, TypeAlias

_LAST_WRITE_S = 2.0
"""Longest wait at the end of the program for unwritten data."""

Batches: TypeAlias = Iterator[list[tuple[Any, ...]]]
"""Data received since the last batch, in order; never empty. They end with `close`."""


class BackgroundWriter:
    """Runs `write` in a thread of its own, which does not delay the end of the program.

    period_s: data given within it are one batch. most_bytes: limit of the waiting data.
    """

    def __init__(
        self,
        name: str,
        write: Callable[[Batches], None],
        *,
        period_s: float = 0.0,
        most_bytes: float = math.inf,
    ) -> None:
        self._period_s = period_s
        self._most_bytes = most_bytes
        self._waiting: SimpleQueue[tuple[int, tuple[Any, ...]] | None] = SimpleQueue()
        # One thread alone counts each, so that neither waits for the other.
        self._taken_bytes = self._written_bytes = 0
        self._closing = threading.Event()
        self._thread = threading.Thread(
            target=write, args=(self._batches(),), name=name, daemon=True
        )
        self._thread.start()

    def put(self, *data: Any, size_bytes: int | None = None) -> bool:
        """Queues data to be written soon; False for data refused because too much waits.

        size_bytes: of the data together; None: they are bytes. Returns at once. To be called by one
        thread at a time.
        """
        if size_bytes is None:
            size_bytes = sum(map(len, data))
        taken_bytes = self._taken_bytes + size_bytes
        if taken_bytes - self._written_bytes > self._most_bytes:
            return False
        self._taken_bytes = taken_bytes
        self._waiting.put((size_bytes, data))
        return True

    def close(self) -> bool:
        """Waits a limited time for unwritten data; True if all is written."""
        self._closing.set()
        self._waiting.put(None)
        self._thread.join(_LAST_WRITE_S)
        return not self._thread.is_alive()

    def _batches(self) -> Batches:
        ending = False
        while not ending:
            waiting = [self._waiting.get()]
            self._closing.wait(self._period_s)
            with contextlib.suppress(Empty):
                while True:
                    waiting.append(self._waiting.get_nowait())
            batch = [data for data in waiting if data is not None]
            ending = len(batch) < len(waiting)
            if batch:
                yield [data for _, data in batch]
            self._written_bytes += sum(size_bytes for size_bytes, _ in batch)

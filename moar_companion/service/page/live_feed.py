"""The live state for viewers: who waits for its changes, and which frame each gets next.

A viewer that is behind gets the whole state instead of the changes it missed: it loses frames, and
has the newest. No viewer delays another one, or the feed.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable, Iterator
from typing import Any

from .live_state import LiveState


class LiveFeed:
    """Frames for any number of viewers. watched: called when the first comes or the last goes."""

    def __init__(self, watched: Callable[[bool], None]) -> None:
        self._live = LiveState()
        self._watched = watched
        self._viewers = 0
        self._number = 0
        """Number of changes so far."""
        self._frame = self._whole = ""
        self._changed = asyncio.Event()

    @property
    def viewers(self) -> int:
        """Number of viewers now."""
        return self._viewers

    @property
    def begun(self) -> bool:
        """True after the first status."""
        return bool(self._live.state)

    @property
    def recorder(self) -> str | None:
        """Folder of the recording that is being written; None without one."""
        recorder: str | None = self._live.state.get("recorder")
        return recorder

    def update(self, status: dict[str, Any], now_s: float, *, site_revision: int | None) -> None:
        """Takes a status of the service."""
        if self._live.update(status, now_s, site_revision=site_revision):
            self._tell()

    def note_silence(self, now_s: float) -> None:
        """Notes the time without a status."""
        if self._live.note_silence(now_s):
            self._tell()

    async def frames(self) -> AsyncIterator[str]:
        """Yields the frames for one viewer: the whole state, then changes."""
        with self._viewer():
            had = -1
            while True:
                while had == self._number or not self._number:
                    await self._changed.wait()
                frame = self._frame if had == self._number - 1 else self._whole_frame()
                had = self._number
                yield frame

    def _tell(self) -> None:
        self._number += 1
        self._frame = self._live.patch() if self._viewers else ""
        self._whole = ""
        # Each waiter holds the event that it waits for.
        self._changed.set()
        self._changed = asyncio.Event()

    def _whole_frame(self) -> str:
        self._whole = self._whole or self._live.whole()
        return self._whole

    @contextlib.contextmanager
    def _viewer(self) -> Iterator[None]:
        self._viewers += 1
        if self._viewers == 1:
            self._watched(True)
        try:
            yield
        finally:
            self._viewers -= 1
            if not self._viewers:
                self._watched(False)

"""Channel between the service and the page's process: a JSON object a line, in both directions.

    {"status": …}, {"site": …}     from the service; the site when it has changed
    {"answer": {"order_id", "result", "final", "reason"}}   to an order
    {"watched": true}              from the page: statuses at the rate of viewers
    {"site_wanted": true}          at its start
    {"order": {"order_id", "word", "target"}}

Here the end of the page's process. The other one: `page_process`.
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import secrets
import socket
import time
from dataclasses import dataclass
from typing import Any

from .live_feed import LiveFeed
from .live_state import json_text

_LONGEST_LINE = 16_000_000
"""A site with thousands of obstacles has a tenth of it."""
_SILENCE_PERIOD_S = 0.5
_ANSWER_S = 15.0
"""Longest wait for the last answer to an order: the first plan takes seconds at most."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ServiceAnswer:
    """The companion's answer to an order, by the name of its MAV_RESULT."""

    result: str
    final: bool
    reason: str


class ServiceChannel:
    """The service: its statuses to `feed`, its site, and orders to it."""

    def __init__(self, channel: socket.socket) -> None:
        self._socket = channel
        self._writer: asyncio.StreamWriter | None = None
        self._name, self._numbers = secrets.token_hex(4), itertools.count(1)
        """A restarted process must not take the answer to an order of the one before."""
        self._answers: dict[str, asyncio.Queue[ServiceAnswer]] = {}
        self.feed = LiveFeed(self._note_watched)
        self.site: dict[str, Any] | None = None
        """Site and maps, with their revision."""

    async def run(self) -> None:
        """Reads until the service ends."""
        reader, self._writer = await asyncio.open_connection(sock=self._socket, limit=_LONGEST_LINE)
        self._writer.write(b"\n")  # the end of a line that a killed process has begun
        self._send({"site_wanted": True})
        silence = asyncio.create_task(self._watch_silence())
        try:
            with contextlib.suppress(ConnectionError):
                while line := await reader.readline():
                    # The first line after a restart may be the rest of one.
                    with contextlib.suppress(ValueError):
                        self._take(json.loads(line))
        finally:
            silence.cancel()
            self._writer.close()

    async def order(self, word: str, target: int | None) -> ServiceAnswer | None:
        """Gives an order; its last answer within a time, else the one so far; None without any."""
        order_id = f"{self._name}-{next(self._numbers)}"
        queue = self._answers[order_id] = asyncio.Queue()
        answer: ServiceAnswer | None = None
        end_s = time.monotonic() + _ANSWER_S
        self._send({"order": {"order_id": order_id, "word": word, "target": target}})
        try:
            while answer is None or not answer.final:
                answer = await asyncio.wait_for(queue.get(), end_s - time.monotonic())
        except asyncio.TimeoutError:
            pass
        finally:
            del self._answers[order_id]
        return answer

    def _take(self, message: dict[str, Any]) -> None:
        match message:
            case {"status": status}:
                revision = None if self.site is None else self.site["revision"]
                self.feed.update(status, time.monotonic(), site_revision=revision)
            case {"site": site}:
                self.site = site
            case {"answer": answer} if answer["order_id"] in self._answers:
                values = {name: answer[name] for name in ("result", "final", "reason")}
                self._answers[answer["order_id"]].put_nowait(ServiceAnswer(**values))

    def _note_watched(self, watched: bool) -> None:
        self._send({"watched": watched})

    def _send(self, message: dict[str, Any]) -> None:
        if self._writer is not None and not self._writer.is_closing():
            self._writer.write(f"{json_text(message)}\n".encode())

    async def _watch_silence(self) -> None:
        while True:
            await asyncio.sleep(_SILENCE_PERIOD_S)
            self.feed.note_silence(time.monotonic())

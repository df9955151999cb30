"""Work in one thread, of each sender the newest alone: answers that a drag no longer needs."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import Executor
from typing import TypeVar

Answer = TypeVar("Answer")


class SupersededError(Exception):
    """A newer request of the same sender came before the work began."""


class NewestWork:
    """A request waits until the one before is done. executor: with one thread."""

    def __init__(self, executor: Executor) -> None:
        self._executor = executor
        self._turn = asyncio.Lock()
        self._newest: dict[str, object] = {}
        """Newest waiting request, by sender."""

    async def answer(self, sender: str, work: Callable[[], Answer]) -> Answer:
        """Result of `work`; raises SupersededError where a newer one makes it needless."""
        own = object()
        self._newest[sender] = own
        try:
            async with self._turn:
                if self._newest.get(sender) is not own:
                    raise SupersededError
                loop = asyncio.get_running_loop()
                return await loop.run_in_executor(self._executor, work)
        finally:
            if self._newest.get(sender) is own:
                del self._newest[sender]

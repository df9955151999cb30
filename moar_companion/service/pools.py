"""Pools whose threads run from the beginning: none has to be started in flight."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor


def started_pool(name: str, count: int = 1) -> ThreadPoolExecutor:
    """A pool of so many threads, all of them started, with the priority of the caller.

    Raises RuntimeError where the system has no memory or no task for one.
    """
    pool = ThreadPoolExecutor(max_workers=count, thread_name_prefix=name)
    # A thread that has nothing to do would take the next one's turn.
    all_run = threading.Barrier(count)
    try:
        for _ in range(count):
            pool.submit(all_run.wait)
    except RuntimeError:
        all_run.abort()
        pool.shutdown(wait=False)
        raise
    return pool

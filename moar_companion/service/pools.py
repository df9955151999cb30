"""Pools that start their threads at construction: none has to be started in flight."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor


def started_pool(name: str, count: int = 1) -> ThreadPoolExecutor:
    """Returns a pool of `count` threads, all started, with the priority of the caller.

    Raises RuntimeError if the system has no memory or no task for a thread.
    """
    pool = ThreadPoolExecutor(max_workers=count, thread_name_prefix=name)
    # An idle thread would take the next one's task: the barrier keeps each until all run.
    all_run = threading.Barrier(count)
    try:
        for _ in range(count):
            pool.submit(all_run.wait)
    except RuntimeError:
        all_run.abort()
        pool.shutdown(wait=False)
        raise
    return pool

"""Tasks in processes of this computer, or on a Dask cluster, with a progress bar."""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from typing import Any

from ..errors import InputError

Call = tuple[Callable[..., Any], tuple[Any, ...]]
"""A function and its arguments, which can be sent to another process."""

_CONNECT_S = 10.0


@contextmanager
def task_pool(workers: int, scheduler: str | None) -> Iterator[Executor]:
    """An executor of `workers` processes, or of the cluster of a Dask scheduler.

    Raises InputError for a scheduler that does not answer.
    """
    if scheduler is not None:
        with _cluster(scheduler) as client:
            yield client.get_executor(pure=False)
        return
    # Spawned: a fork would copy threads' locks.
    context = multiprocessing.get_context("spawn")
    executor = ProcessPoolExecutor(workers, mp_context=context)
    try:
        yield executor
    finally:
        executor.shutdown(wait=True, cancel_futures=True)


def run_tasks(name: str, calls: Sequence[Call], pool: Executor) -> list[Any]:
    """The results of calls, in their order, with a progress bar and the remaining time."""
    from rich.console import Console  # noqa: PLC0415
    from rich.progress import (  # noqa: PLC0415
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    console = Console(stderr=True)
    columns = (TextColumn(name), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal) as progress:
        bar = progress.add_task(name, total=len(calls))
        futures: list[Future[Any]] = [
            pool.submit(function, *arguments) for function, arguments in calls
        ]
        for future in as_completed(futures):
            future.result()
            progress.advance(bar)
        return [future.result() for future in futures]


@contextmanager
def _cluster(scheduler: str) -> Iterator[Any]:
    import distributed  # noqa: PLC0415

    try:
        client = distributed.Client(scheduler, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        reason = str(error).splitlines()[0]
        raise InputError(
            "--scheduler", "", f"is {scheduler!r}, no Dask scheduler: {reason}"
        ) from None
    with client:
        yield client

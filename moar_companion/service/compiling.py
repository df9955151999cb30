"""Preparation of the planner's kernels, by several processes where the cache lacks some.

`python -m moar_companion.service.compiling` fills the cache and ends: for an installation, and
before a demonstration. At its first start the service does the same in the background.
"""

from __future__ import annotations

import contextlib
import itertools
import logging
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence

from ..companion import companion as _all_that_flies  # noqa: F401 - with it come all kernels that are needed
from ..planner.jit import KERNELS, Kernel
from . import compiler
from .priority import put_behind

_PERIOD_S = 0.2

_logger = logging.getLogger(__name__)

Progress = Callable[[int, int], None]
"""Callback with the number of compiled kernels, and of all kernels."""


def make_ready(report: Progress, stopped: threading.Event) -> bool:
    """Fills the cache and loads all kernels; False when `stopped` was set before the end."""
    if not fill_cache(report, stopped):
        return False
    for kernel in _kernels():
        if stopped.is_set():
            return False
        # Kernels that could not be cached are compiled here.
        _ = kernel.entry
    return True


def _kernels() -> list[Kernel]:
    return [kernel for kernel in KERNELS if not kernel.is_helper]


def fill_cache(report: Progress, stopped: threading.Event) -> bool:
    """Compiles the kernels that are not in the cache, in other processes.

    report: called with the progress of a compilation. Returns False when `stopped` was set before
    the end.
    """
    kernels = _kernels()
    # Without a cache, kernels compiled by other processes are lost.
    missing = [kernel for kernel in kernels if kernel.has_cache and not kernel.is_cached]
    if missing:
        with _compilers(missing) as compilers:
            while any(compiler.poll() is None for compiler in compilers):
                missing = [kernel for kernel in missing if not kernel.is_cached]
                report(len(kernels) - len(missing), len(kernels))
                if stopped.wait(_PERIOD_S):
                    return False
    return True


def _shares(kernels: Sequence[Kernel], count: int) -> Iterator[list[str]]:
    """Names of the kernels, in up to `count` shares with about the same amount of code.

    In order: kernels of one file call the same helpers, which each process compiles.
    """
    ends = list(itertools.accumulate(len(kernel.py_func.__code__.co_code) for kernel in kernels))
    shares: list[list[str]] = [[] for _ in range(count)]
    for kernel, end, begin in zip(kernels, ends, [0, *ends], strict=False):
        function = kernel.py_func
        name = f"{function.__module__}:{function.__name__}"
        shares[(begin + end) * count // (2 * ends[-1])].append(name)
    return filter(None, shares)


@contextlib.contextmanager
def _compilers(kernels: Sequence[Kernel]) -> Iterator[list[subprocess.Popen[bytes]]]:
    """One process for each permitted processor, at low priority; killed at the end.

    Fewer, or none, where the system has no memory for them: this process then compiles the rest.
    """
    isolated = ["-I"] if sys.flags.isolated else []
    running: list[subprocess.Popen[bytes]] = []
    try:
        try:
            for share in _shares(kernels, len(os.sched_getaffinity(0))):
                process = subprocess.Popen(  # noqa: S603 - ourselves
                    [sys.executable, *isolated, "-m", compiler.__name__, *share],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    start_new_session=True,
                )
                running.append(process)
                put_behind(process.pid)
        except (OSError, MemoryError) as error:
            _logger.warning("no process to compile the planner in: %s", error)
        yield running
    finally:
        for process in running:
            process.kill()
            process.wait()


class _Lines:
    """Progress of a compilation as lines on stdout, each count once."""

    def __init__(self) -> None:
        self._shown = -1

    def __call__(self, count: int, of: int) -> None:
        if count != self._shown:
            self._shown = count
            sys.stdout.write(f"compiling the planner, once: {count} of {of}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    fill_cache(_Lines(), threading.Event())

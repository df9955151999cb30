"""The kernels of the planner made ready, by several processes where the cache lacks some.

`python -m moar_companion.service.compiling` fills the cache and ends: for an installation. The
service has the same done beside it at its first start, and goes on meanwhile.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator

from ..planner.jit import KERNELS
from . import companion as _all_that_flies  # noqa: F401 - with it come all kernels that are needed
from .priority import put_behind

_LOOK_PERIOD_S = 0.2

Told = Callable[[int, int], None]
"""Called with how many of how many kernels are compiled."""


def make_ready(tell: Told, stopped: threading.Event) -> bool:
    """Load all kernels; what is not in the cache is compiled by other processes first.

    tell: called while something has to be compiled. Returns False when `stopped` was set before.
    """
    kernels = list(KERNELS)
    if not all(kernel.is_cached for kernel in kernels):
        with _compilers() as compilers:
            while any(compiler.poll() is None for compiler in compilers):
                tell(sum(kernel.is_cached for kernel in kernels), len(kernels))
                if stopped.wait(_LOOK_PERIOD_S):
                    return False
    for kernel in kernels:
        if stopped.is_set():
            return False
        # What could not be kept in the cache is compiled here.
        _ = kernel.entry
    return True


@contextlib.contextmanager
def _compilers() -> Iterator[list[subprocess.Popen[bytes]]]:
    """A process for each processor that we may use, behind whatever else runs; killed at last."""
    count = len(os.sched_getaffinity(0))
    running = [
        subprocess.Popen(  # noqa: S603 - ourselves
            [sys.executable, "-m", __name__, str(share), str(count)],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        for share in range(count)
    ]
    try:
        for process in running:
            put_behind(process.pid)
        yield running
    finally:
        for process in running:
            process.kill()
            process.wait()


def main(share: int = 0, count: int = 1) -> None:
    """Compile a share of the kernels into the cache."""
    for kernel in KERNELS[share::count]:
        if not kernel.is_cached:
            _ = kernel.ready


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))

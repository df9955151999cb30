"""Priority of the service's threads above other programs, and of child processes below them."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

NICE = -10
"""Nice value of the systemd unit. Beside three busy processes on one core it gives nine times their
share; 0 gives a quarter of the core, in slices."""
_USUAL = 0
_OOM_SCORE = 500
"""Value of oom_score_adj, of -1000 to 1000: a child is ended before most other programs, and before
the service (-500, by its unit)."""
_REAL_TIME = 1
"""Priority of 1 to 99: ahead of all threads without one. A nice value counts within a session or
group only, where the kernel shares processors among those first."""


@contextlib.contextmanager
def ahead_of_others() -> Iterator[bool]:
    """Puts the calling thread, and the threads it makes meanwhile, ahead of other programs.

    All of them: a thread of less priority that holds the interpreter lock would delay the
    others. Yields False if that is not permitted.
    """
    before = os.getpriority(os.PRIO_PROCESS, 0)
    try:
        os.setpriority(os.PRIO_PROCESS, 0, min(before, NICE))
    except OSError:
        yield False
        return
    try:
        yield True
    finally:
        os.setpriority(os.PRIO_PROCESS, 0, before)


@contextlib.contextmanager
def in_real_time() -> Iterator[bool]:
    """Gives the calling thread a processor as soon as the thread has work.

    This thread alone: threads and processes that it makes meanwhile have no priority at all.
    Yields False if that is not permitted.
    """
    before, parameters_before = os.sched_getscheduler(0), os.sched_getparam(0)
    try:
        parameters = os.sched_param(_REAL_TIME)
        os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, parameters)
    except OSError:
        yield False
        return
    try:
        yield True
    finally:
        try:
            os.sched_setscheduler(0, before, parameters_before)
        except OSError:
            # Without privileges SCHED_RESET_ON_FORK cannot be cleared.
            os.sched_setscheduler(0, before | os.SCHED_RESET_ON_FORK, parameters_before)


def put_behind(process_id: int) -> None:
    """Takes the inherited priority and memory protection from a child process."""
    with contextlib.suppress(OSError):
        Path(f"/proc/{process_id}/oom_score_adj").write_text(str(_OOM_SCORE))
    if os.getpriority(os.PRIO_PROCESS, process_id) < _USUAL:
        os.setpriority(os.PRIO_PROCESS, process_id, _USUAL)

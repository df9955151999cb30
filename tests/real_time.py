"""Flights in real time, on a machine that may not keep time itself.

A virtual machine is sometimes not scheduled for a second. The service then releases the aircraft,
as it must; lockstep tests check its behaviour after a pause exactly. A test in real time that fails
while the machine was paused proves nothing. It is flown again, and skipped if the machine pauses
each time. A test that fails on a machine without pauses has failed.

As a program this module is the witness: it reads the clock on each processor and prints when it was
delayed, and for how long.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import threading
import time

import pytest

_RERUNS = 4
_RECENT_S = 120.0
"""Longer than any of these tests takes."""
_LOOK_S = 0.02
_LATE_S = 0.1

_pauses: list[tuple[float, float]] = []
"""Pauses of the machine in the tests of this process."""


@contextlib.contextmanager
def watched(pauses):
    """Look at the clock; each pause of the machine is appended: (end by `time.monotonic()`, s)."""
    with subprocess.Popen(
        [sys.executable, __file__], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE
    ) as running:

        def note():
            pauses.extend(tuple(map(float, line.split())) for line in running.stdout)

        noting = threading.Thread(target=note)
        noting.start()
        try:
            yield
        finally:
            running.kill()
            noting.join()


@pytest.fixture(scope="session")
def witness():
    """Looks at the clock while tests fly in real time."""
    with watched(_pauses):
        yield


def _machine_stood_still():
    return any(time.monotonic() - end_s < _RECENT_S for end_s, _ in _pauses)


def real_time(test):
    """Mark a test that flies in real time."""
    for mark in (
        pytest.mark.slow,
        pytest.mark.real_time,
        pytest.mark.usefixtures("witness"),
        pytest.mark.flaky(reruns=_RERUNS, condition=_machine_stood_still),
    ):
        mark(test)
    return test


def inconclusive(item):
    """Reason why a failure is no verdict; None where it is one, or where there is another try."""
    # The real autopilots are flown once: only a test that is flown again counts its flights.
    if getattr(item, "execution_count", 0) <= _RERUNS:
        return None
    stood_still = _machine_stood_still()
    return f"the machine stood still in each of {_RERUNS + 1} flights" if stood_still else None


def _look_loop(processor):
    os.sched_setaffinity(0, {processor})
    # Where it may: a test may keep this processor busy, which is not the machine's doing.
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
    then_s = time.monotonic()
    while True:
        time.sleep(_LOOK_S)
        now_s = time.monotonic()
        if now_s - then_s > _LOOK_S + _LATE_S:
            sys.stdout.write(f"{now_s} {now_s - then_s - _LOOK_S}\n")
            sys.stdout.flush()
        then_s = now_s


if __name__ == "__main__":
    for number in os.sched_getaffinity(0):
        threading.Thread(target=_look_loop, args=(number,)).start()

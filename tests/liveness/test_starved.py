"""A busy processor: the stream keeps its rate or ends, and is never late."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from tests.real_time import real_time

from .tap import OLDEST_S, clock_s

pytestmark = [
    pytest.mark.alone,
    pytest.mark.skipif(
        len(os.sched_getaffinity(0)) < 2, reason="one processor: the autopilot would starve, too"
    ),
]

BUSY = "while True: pass"
LOST_S = 0.5
"""The rig's COM_OF_LOSS_T."""
LET_GO = ("released", "overridden")
RECOVERED_S = 10.0
"""The processor may have other work when the busy loops have ended."""


@contextlib.contextmanager
def starved(process, *, hogs, nice):
    """Lets a process share its processor with busy loops."""
    everywhere = os.sched_getaffinity(0)
    here = {min(everywhere)}
    confine(process, here)
    loops = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(hogs)]
    try:
        for loop in loops:
            os.sched_setaffinity(loop.pid, here)
            with contextlib.suppress(PermissionError):
                os.setpriority(os.PRIO_PROCESS, loop.pid, nice)
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()
        confine(process, everywhere)


def confine(process, processors):
    for thread in Path(f"/proc/{process.pid}/task").iterdir():
        os.sched_setaffinity(int(thread.name), processors)


@real_time
@pytest.mark.parametrize(("hogs", "nice"), [(3, 0), (6, -19)])
def test_a_starved_service_streams_in_time_or_not_at_all(rig, hogs, nice):
    rig.fly()
    rig.watch(1.0)
    begun_s = rig.tap.setpoints[-1].sent_s
    usual = len(rig.tap.since(begun_s - 1.0))

    def let_go():
        return any(text in rig.said() for text in LET_GO)

    def recovered():
        return len(rig.tap.since(clock_s() - 1.0)) > 0.7 * usual

    with starved(rig.service.process, hogs=hogs, nice=nice):
        rig.watch(5.0)
    rig.watch(2.0)
    rig.operator.wait_for(
        "a stream, or a word that it ended", lambda: let_go() or recovered(), RECOVERED_S
    )
    setpoints = rig.tap.since(begun_s - 0.1)
    assert max(item.age_s for item in setpoints) < OLDEST_S
    if let_go():
        rig.watch(1.0)
        assert not rig.tap.since(clock_s() - 0.5)
    else:
        gaps_s = [later.sent_s - earlier.sent_s for earlier, later in pairwise(setpoints)]
        assert max(gaps_s) < LOST_S + OLDEST_S

"""No thread is started late: memory for it may lack in flight."""

from __future__ import annotations

import threading

import pytest

from moar_companion.service.planner_worker import PlannerWorker
from moar_companion.service.pools import started_pool


def running(name):
    return sum(thread.name.startswith(name) for thread in threading.enumerate())


@pytest.mark.parametrize("count", [1, 4])
def test_all_threads_run_before_the_first_task(count):
    pool = started_pool("eager", count)
    assert running("eager") == count
    assert pool.submit(lambda: 3).result() == 3
    assert running("eager") == count
    pool.shutdown()


def test_a_thread_that_cannot_be_started_is_an_error_and_leaves_none_waiting(monkeypatch):
    start, started = threading.Thread.start, []

    def fail_the_third(thread):
        started.append(thread)
        if len(started) == 3:
            raise RuntimeError("can't start new thread")
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", fail_the_third)
    with pytest.raises(RuntimeError):
        started_pool("few", 4)
    for thread in started[:2]:
        thread.join(10)
        assert not thread.is_alive()


def test_the_planners_threads_run_before_the_first_plan():
    before = running("planner"), running("tables")
    worker = PlannerWorker()
    assert (running("planner"), running("tables")) == (before[0] + 1, before[1] + 1)
    worker.close(wait=True)

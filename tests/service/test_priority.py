"""The priority of the service: above other programs, its embedder and its child processes."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from moar_companion.service.priority import NICE, ahead_of_others, in_real_time, put_behind


def nice():
    return os.getpriority(os.PRIO_PROCESS, 0)


@pytest.fixture
def _permitted():
    with ahead_of_others() as permitted:
        pass
    if not permitted:
        pytest.skip("no priority over other programs is permitted here")


@pytest.mark.usefixtures("_permitted")
def test_the_priority_is_of_the_thread_and_its_threads_and_is_restored():
    before, seen = nice(), []
    beside = threading.Thread(target=lambda: go.wait(10) and seen.append(nice()))
    go = threading.Event()
    beside.start()
    with ahead_of_others():
        assert nice() == NICE
        made = threading.Thread(target=lambda: seen.append(nice()))
        made.start()
        made.join()
        go.set()
        beside.join()
    assert seen == [NICE, before]
    assert nice() == before


@pytest.mark.usefixtures("_permitted")
def test_a_started_process_has_a_lower_priority():
    with (
        ahead_of_others(),
        subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as child,
    ):
        assert os.getpriority(os.PRIO_PROCESS, child.pid) == NICE
        put_behind(child.pid)
        assert os.getpriority(os.PRIO_PROCESS, child.pid) == 0
        child.communicate(b"\n")


def test_a_started_process_is_ended_first_when_memory_runs_out():
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as child:
        score = Path(f"/proc/{child.pid}/oom_score_adj")
        put_behind(child.pid)
        assert int(score.read_text()) > 0
        child.communicate(b"\n")


def test_a_memory_protection_that_cannot_be_changed_is_left(monkeypatch):
    def refuse(*_):
        raise PermissionError

    monkeypatch.setattr(Path, "write_text", refuse)
    put_behind(os.getpid())


@pytest.mark.usefixtures("_permitted")
def test_real_time_is_of_the_thread_alone_and_ends():
    def policy():
        seen.append(os.sched_getscheduler(0))

    before, seen = os.sched_getscheduler(0), []
    with in_real_time() as permitted:
        if not permitted:
            pytest.skip("no real time is permitted here")
        assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_RR
        made = threading.Thread(target=policy)
        made.start()
        made.join()
    policy()
    assert seen == [os.SCHED_OTHER, before]


@pytest.mark.usefixtures("_permitted")
def test_a_thread_that_was_in_real_time_before_has_its_priority_again():
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(3))
    except PermissionError:
        pytest.skip("no real time is permitted here")
    try:
        with in_real_time() as permitted:
            assert permitted
        assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_RR
        assert os.sched_getparam(0).sched_priority == 3
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))


@pytest.mark.usefixtures("_permitted")
def test_without_permission_the_priority_does_not_change(monkeypatch):
    def refuse(*_):
        raise PermissionError

    monkeypatch.setattr(os, "setpriority", refuse)
    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    before = nice()
    with ahead_of_others() as ahead, in_real_time() as in_time:
        assert not ahead
        assert not in_time
        assert nice() == before

"""Free resources of the computer."""

from __future__ import annotations

import threading
import time
from types import SimpleNamespace

import pytest

from moar_companion.service import host_monitor
from moar_companion.service.host_monitor import HostMonitor, memory_bytes


def test_the_memory_that_linux_calls_available():
    text = "MemTotal:        4030000 kB\nMemFree:          100000 kB\nMemAvailable:     250000 kB\n"
    assert memory_bytes(text) == pytest.approx({"MemAvailable": 256e6, "MemTotal": 4126.72e6})
    assert "MemAvailable" not in memory_bytes("MemTotal: 4030000 kB\n")
    assert memory_bytes("") == {}


def test_memory_and_disk_of_this_computer_are_reported(tmp_path):
    left = read_once(tmp_path)
    assert left.disk_free is not None
    assert left.disk_free > 0.0
    assert left.memory_available is None or left.memory_available > 0.0


def read_once(recordings):
    watch = HostMonitor(recordings)
    watch.close()
    return watch.read()


def test_the_free_disk_of_a_missing_folder_is_unknown(tmp_path):
    assert read_once(None).disk_free is None
    assert read_once(tmp_path / "gone").disk_free is None


def test_a_disk_that_does_not_answer_delays_no_caller_and_keeps_its_last_value(
    tmp_path, monkeypatch
):
    asked, answers, words = threading.Event(), threading.Event(), iter([3e9, 2e9, 1e9])

    def usage(_):
        word = next(words)
        if word == 2e9:
            asked.set()
            answers.wait(20)
        if word == 1e9:
            watch.close()
        return SimpleNamespace(free=word, total=4e9)

    monkeypatch.setattr(host_monitor.shutil, "disk_usage", usage)
    monkeypatch.setattr(host_monitor, "_PERIOD_S", 0.0)
    watch = HostMonitor(tmp_path)
    assert asked.wait(20)
    assert watch.read().disk_free == 3e9
    answers.set()
    until_s = time.monotonic() + 20.0
    while watch.read().disk_free != 1e9 and time.monotonic() < until_s:
        time.sleep(0.001)
    assert watch.read().disk_free == 1e9

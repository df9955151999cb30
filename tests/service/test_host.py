"""What the computer has left."""

from __future__ import annotations

import pytest

from moar_companion.service.host import host, memory_available


def test_the_memory_that_linux_calls_available():
    text = "MemTotal:        4030000 kB\nMemFree:          100000 kB\nMemAvailable:     250000 kB\n"
    assert memory_available(text) == pytest.approx(256e6)
    assert memory_available("MemTotal: 4030000 kB\n") is None


def test_this_computer_tells_both(tmp_path):
    left = host(tmp_path)
    assert left.disk_free is not None
    assert left.disk_free > 0.0
    assert left.memory_available is None or left.memory_available > 0.0


def test_nothing_is_known_of_no_folder_or_one_that_is_gone(tmp_path):
    assert host(None).disk_free is None
    assert host(tmp_path / "gone").disk_free is None

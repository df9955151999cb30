"""The writer thread: it writes all data in order and delays no caller."""

from __future__ import annotations

import threading
import time

import pytest

from moar_companion.service import background_writer
from moar_companion.service.background_writer import BackgroundWriter


class Disk:
    """A disk that keeps the written data; it stalls while it is stopped."""

    def __init__(self):
        self.batches = []
        self.touched = threading.Event()
        self.goes = threading.Event()
        self.goes.set()

    @property
    def written(self):
        return [data for batch in self.batches for data in batch]

    def write(self, batches):
        for batch in batches:
            self.touched.set()
            assert self.goes.wait(20)
            self.batches.append(batch)


@pytest.fixture
def disk():
    item = Disk()
    yield item
    item.goes.set()


def test_everything_is_written_in_order(disk):
    writer = BackgroundWriter("test", disk.write)
    for number in range(1000):
        assert writer.put(b"%d" % number, b"")
    assert writer.close()
    assert disk.written == [(b"%d" % number, b"") for number in range(1000)]


def test_data_of_one_period_is_one_batch_and_close_does_not_wait_for_the_period(disk):
    writer = BackgroundWriter("test", disk.write, period_s=3600.0)
    writer.put(b"a")
    writer.put(b"b")
    assert writer.close()
    assert disk.batches == [[(b"a",), (b"b",)]]


def test_the_queue_for_a_stalled_disk_is_limited(disk):
    disk.goes.clear()
    writer = BackgroundWriter("test", disk.write, most_bytes=10)
    assert writer.put(b"first")
    assert disk.touched.wait(20)
    assert [writer.put(b"abcd"), writer.put(b"ef"), writer.put(b"g")] == [True, False, True]
    disk.goes.set()
    assert writer.close()
    assert disk.written == [(b"first",), (b"abcd",), (b"g",)]


def test_the_queue_accepts_data_again_when_the_disk_resumes(disk):
    disk.goes.clear()
    writer = BackgroundWriter("test", disk.write, most_bytes=3)
    assert writer.put(b"abc")
    assert not writer.put(b"d")
    disk.goes.set()
    until_s = time.monotonic() + 20.0
    while not (again := writer.put(b"e")) and time.monotonic() < until_s:
        time.sleep(0.001)
    assert again
    assert writer.close()
    assert disk.written == [(b"abc",), (b"e",)]


def test_close_does_not_wait_for_ever(disk, monkeypatch):
    monkeypatch.setattr(background_writer, "_LAST_WRITE_S", 0.1)
    disk.goes.clear()
    item = BackgroundWriter("test", disk.write)
    item.put(b"abc")
    assert not item.close()

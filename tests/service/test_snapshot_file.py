"""The file of the state: its bytes; complete at any moment; it never delays the service."""

from __future__ import annotations

import errno
import json
import logging
import os
import threading
import time

import pytest

from moar_companion.companion.mission.state_machine import MissionState, Task
from moar_companion.companion.mission_snapshot import MissionSnapshot
from moar_companion.service import background_writer, whole_file
from moar_companion.service.snapshot_file import SnapshotFile, decoded, encoded
from moar_companion.types import Mission

IDLE = MissionSnapshot(state=MissionState.IDLE, since_s=1.0)
FLYING = MissionSnapshot(state=MissionState.FLYING, since_s=2.0)
HOLDING = MissionSnapshot(state=MissionState.HOLDING, since_s=3.0)
INSPECTION = Task(mission=Mission.INSPECTION, stops=("splice-1", "splice-2"))
EXIT = Task(mission=Mission.EXIT, landing=0)
WHOLE = MissionSnapshot(state=MissionState.FLYING, since_s=100.0, task=INSPECTION, site="line")
WRITTEN = encoded(WHOLE, 0.0)


@pytest.mark.parametrize("state", MissionState)
@pytest.mark.parametrize("task", [None, INSPECTION, EXIT])
def test_a_snapshot_is_read_as_it_was_written(state, task):
    snapshot = MissionSnapshot(state=state, since_s=100.0, task=task, site="line")
    assert decoded(encoded(snapshot, 0.0), 0.0) == snapshot


def test_the_time_of_a_snapshot_is_wall_clock_time_whatever_clock_the_next_process_has():
    written = encoded(WHOLE, clock_offset_s=1_000.0)
    assert decoded(written, clock_offset_s=1_050.0).since_s == 50.0


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\0" * 300,
        WRITTEN[: len(WRITTEN) // 2],
        WRITTEN.replace(b'"version": 1', b'"version": 2'),
        WRITTEN.replace(b"flying", b"floating"),
        WRITTEN.replace(b"100.0", b"NaN"),
        WRITTEN.replace(b"100.0", b'"100"'),
        json.dumps({"mission": "inspection"}).encode(),
        b"[" * 100_000,
    ],
)
def test_an_incomplete_or_foreign_file_is_no_snapshot(data):
    with pytest.raises(ValueError):  # noqa: PT011 - whatever is wrong with it
        decoded(data, 0.0)


@pytest.fixture
def file(tmp_path):
    item = SnapshotFile(tmp_path / "state")
    yield item
    item.close()


def written(tmp_path):
    """Memory that the next process would find."""
    next_one = SnapshotFile(tmp_path / "state")
    next_one.close()
    return next_one.load(0.0)


def test_the_next_process_finds_the_last_saved_state(file, tmp_path):
    assert file.load(0.0) is None
    for memory in (IDLE, FLYING, HOLDING):
        file.save(memory, 0.0)
    file.close()
    assert written(tmp_path) == HOLDING
    assert [item.name for item in (tmp_path / "state").iterdir()] == ["mission.json"]


def test_a_slow_disk_delays_no_caller_and_gets_only_the_newest_state(file, tmp_path, monkeypatch):
    disk, syncs = threading.Event(), []

    def fsync(descriptor):
        disk.wait(10)
        syncs.append(descriptor)

    monkeypatch.setattr(os, "fsync", fsync)
    began_s = time.monotonic()
    for _ in range(100):
        file.save(FLYING, 0.0)
    file.save(HOLDING, 0.0)
    assert time.monotonic() - began_s < 1.0
    disk.set()
    file.close()
    assert len(syncs) <= 4  # two for a file and its folder: the first one, and the newest
    assert written(tmp_path) == HOLDING


class Killed(BaseException):
    """The process ends here."""


@pytest.mark.parametrize(
    ("moment", "where", "found"),
    [
        ("before the new file is on the disk", (os, "fsync"), IDLE),
        ("before it is renamed", (whole_file.Path, "replace"), IDLE),
        ("before the renaming is on the disk", (whole_file, "_sync"), FLYING),
    ],
)
def test_a_process_that_is_killed_leaves_the_old_file_or_the_new_one(
    moment, where, found, file, tmp_path, monkeypatch
):
    file._file.write(encoded(IDLE, 0.0))

    def die(*_):
        raise Killed

    with monkeypatch.context() as patch:
        patch.setattr(*where, die)
        with pytest.raises(Killed):
            file._file.write(encoded(FLYING, 0.0))
    assert written(tmp_path) == found


def test_a_full_disk_is_reported_once_and_the_outdated_file_is_removed(
    file, tmp_path, monkeypatch, caplog
):
    file._file.write(encoded(FLYING, 0.0))

    def full(_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        for _ in range(3):
            file._file.write(encoded(HOLDING, 0.0))
    reported = [record.getMessage() for record in caplog.records if record.levelno > logging.DEBUG]
    assert reported == [f"{tmp_path}/state/mission.json: not written: No space left on device"]
    assert list((tmp_path / "state").iterdir()) == []
    file._file.write(encoded(HOLDING, 0.0))
    assert written(tmp_path) == HOLDING


def reasons(file):
    return [f"{fault.reason}, {fault.action}" for fault in file.faults]


def test_a_last_write_that_takes_too_long_leaves_no_outdated_state(
    file, tmp_path, monkeypatch, caplog
):
    file.save(FLYING, 0.0)
    path = tmp_path / "state" / "mission.json"
    while not path.exists():
        time.sleep(0.001)
    goes_on, fsync = threading.Event(), os.fsync

    def slow(descriptor):
        goes_on.wait(20)
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", slow)
    monkeypatch.setattr(background_writer, "_LAST_WRITE_S", 0.1)
    file.save(IDLE, 0.0)
    file.close()
    assert not path.exists()
    assert "the last state is not written" in caplog.text
    goes_on.set()


def test_a_state_that_cannot_be_written_is_a_fault_until_it_is_written_again(file, tmp_path):
    assert reasons(file) == []
    (tmp_path / "state").rename(tmp_path / "elsewhere")
    file._file.write(encoded(FLYING, 0.0))
    assert reasons(file) == ["no state file: folder gone, restart goes idle"]
    (tmp_path / "elsewhere").rename(tmp_path / "state")
    file._file.write(encoded(FLYING, 0.0))
    assert reasons(file) == []


def test_a_folder_that_has_become_read_only_is_a_fault(file, monkeypatch):
    def read_only(*_):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr(whole_file.Path, "open", read_only)
    file._file.write(encoded(FLYING, 0.0))
    assert reasons(file) == ["no state file: read-only, restart goes idle"]


def test_a_file_of_the_start_that_is_unusable_remains_a_fault(file, tmp_path):
    (tmp_path / "state" / "mission.json").write_bytes(b"{")
    file.load(0.0)
    file._file.write(encoded(FLYING, 0.0))
    assert reasons(file) == ["state file unusable, starting idle"]


def test_a_file_of_the_start_that_cannot_be_read_is_a_fault(file, tmp_path):
    (tmp_path / "state" / "mission.json").mkdir()
    file.load(0.0)
    assert reasons(file) == ["state file unreadable, starting idle"]


@pytest.mark.parametrize("data", [b"", b"{", b"\xff\xfe", b"[]", b"x" * 1_000_000])
def test_a_broken_file_is_reported_in_one_line_and_renamed(data, file, tmp_path, caplog):
    path = tmp_path / "state" / "mission.json"
    path.write_bytes(data)
    assert file.load(0.0) is None
    (record,) = caplog.records
    assert record.getMessage().startswith(f"{path}: no memory of this version")
    assert path.with_suffix(".broken").read_bytes() == data
    assert not path.exists()


def test_a_file_that_cannot_be_read_is_reported_and_stays(file, tmp_path, caplog):
    (tmp_path / "state" / "mission.json").mkdir()
    assert file.load(0.0) is None
    (record,) = caplog.records
    assert record.getMessage().endswith("mission.json: not read: is a directory, must be a file")


def test_the_file_is_json_with_the_time_of_the_wall_clock(file, tmp_path):
    file.save(FLYING, 1_000.0)
    file.close()
    data = (tmp_path / "state" / "mission.json").read_bytes()
    assert decoded(data, 0.0).since_s == 1_002.0

import json
import shutil
import struct
import time

import pytest
from pymavlink import mavutil

from moar_companion.mavlink.codec import Codec
from moar_companion.mavlink.dialect import create
from moar_companion.service import background_writer
from moar_companion.service import recorder as recorder_module
from moar_companion.service.recorder import Recorder
from tests.stopped import make_recordings, stop_recordings

OFFSET_S = 1_700_000_000.0


def heartbeat() -> bytes:
    message = create(
        "HEARTBEAT",
        type=18,
        autopilot=8,
        base_mode=0,
        custom_mode=0,
        system_status=4,
        mavlink_version=3,
    )
    return Codec(system_id=1, component_id=195).encode(message)


def test_packets_are_a_tlog_that_other_programs_read(tmp_path):
    recorder = Recorder(tmp_path, OFFSET_S, 5.0)
    recorder.write([(5.0, heartbeat()), (5.5, heartbeat())], [])
    recorder.close()
    log = mavutil.mavlink_connection(str(recorder.folder / "flight.tlog"))
    times = [log.recv_match().__getattribute__("_timestamp") for _ in range(2)]
    log.close()
    assert times == pytest.approx([OFFSET_S + 5.0, OFFSET_S + 5.5])
    raw = (recorder.folder / "flight.tlog").read_bytes()
    assert struct.unpack(">Q", raw[:8])[0] == round((OFFSET_S + 5.0) * 1e6)


def test_decisions_are_one_json_object_a_line_with_wall_clock_times(tmp_path):
    recorder = Recorder(tmp_path, OFFSET_S, 0.0)
    recorder.write([], [(1.5, "state", {"state": "flying"}), (2.0, "text", {"text": "a\nb"})])
    recorder.close()
    lines = (recorder.folder / "decisions.jsonl").read_text().splitlines()
    assert [json.loads(line) for line in lines] == [
        {"time_s": OFFSET_S + 1.5, "kind": "state", "data": {"state": "flying"}},
        {"time_s": OFFSET_S + 2.0, "kind": "text", "data": {"text": "a\nb"}},
    ]


def test_written_records_are_in_the_files_before_they_are_closed(tmp_path, monkeypatch):
    monkeypatch.setattr(recorder_module, "_PERIOD_S", 0.0)
    recorder = Recorder(tmp_path, OFFSET_S, 0.0)
    recorder.write([(0.0, heartbeat())], [(0.0, "text", {})])
    until_s = time.monotonic() + 20.0
    while not (recorder.folder / "decisions.jsonl").read_text() and time.monotonic() < until_s:
        time.sleep(0.001)
    assert (recorder.folder / "flight.tlog").stat().st_size == 8 + len(heartbeat())
    assert (recorder.folder / "decisions.jsonl").read_text().count("\n") == 1
    recorder.close()


def test_a_full_disk_ends_the_recording_with_one_warning_and_no_error(
    tmp_path, monkeypatch, caplog
):
    def full(folder):
        (folder / "flight.tlog").symlink_to("/dev/full")

    make_recordings(monkeypatch, full)
    monkeypatch.setattr(recorder_module, "_PERIOD_S", 0.0)
    recorder = Recorder(tmp_path, OFFSET_S, 0.0)
    recorder.write([(0.0, heartbeat())], [(0.0, "text", {})])
    recorder.close()
    recorder.write([(0.0, heartbeat())], [(0.0, "text", {})])
    assert reported(caplog) == [f"recording ended: {recorder.folder}: No space left on device"]


def test_a_folder_that_was_deleted_ends_the_recording_which_would_be_lost(
    tmp_path, monkeypatch, caplog
):
    monkeypatch.setattr(recorder_module, "_PERIOD_S", 0.0)
    recorder = Recorder(tmp_path, OFFSET_S, 0.0)
    shutil.rmtree(recorder.folder)
    recorder.write([(0.0, heartbeat())], [(0.0, "text", {})])
    recorder.close()
    assert reported(caplog) == [f"recording ended: {recorder.folder}: the folder is gone"]
    assert isinstance(recorder.ended, FileNotFoundError)


def reported(caplog):
    return [record.getMessage() for record in caplog.records]


def test_a_stalled_disk_delays_no_caller_and_the_recorded_data_has_no_gap(
    tmp_path, monkeypatch, caplog
):
    monkeypatch.setattr(recorder_module, "_PERIOD_S", 0.0)
    monkeypatch.setattr(recorder_module, "_MOST_BYTES", 10_000)
    disks = stop_recordings(monkeypatch)
    recorder = Recorder(tmp_path, OFFSET_S, 0.0)
    record = 8 + len(heartbeat())
    for number in range(1000):
        recorder.write([(number, heartbeat())], [])
    assert reported(caplog) == [f"recording ended: {recorder.folder}: the disk is too slow"]
    (disk,) = disks
    disk.go_on()
    recorder.write([(1000.0, heartbeat())], [])
    recorder.close()
    data = disk.rest()
    stamps = [int.from_bytes(data[at : at + 8], "big") for at in range(0, len(data), record)]
    assert stamps == [round((OFFSET_S + number) * 1e6) for number in range(10_000 // record)]
    assert len(reported(caplog)) == 1


def test_the_end_does_not_wait_for_ever_for_a_stalled_disk(tmp_path, monkeypatch, caplog):
    monkeypatch.setattr(background_writer, "_LAST_WRITE_S", 0.1)
    disks = stop_recordings(monkeypatch)
    recorder = Recorder(tmp_path, OFFSET_S, 0.0)
    recorder.write([(0.0, heartbeat())], [])
    recorder.close()
    assert reported(caplog) == [f"recording ended: {recorder.folder}: the disk is too slow"]
    assert len(disks[0].rest()) == 8 + len(heartbeat())


def test_two_recordings_of_one_second_do_not_share_a_folder(tmp_path):
    recorders = [Recorder(tmp_path, OFFSET_S, 0.001 * number) for number in range(3)]
    assert len({recorder.folder for recorder in recorders}) == 3
    for recorder in recorders:
        recorder.close()
